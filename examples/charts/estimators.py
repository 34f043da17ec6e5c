"""The chart of estimators: error of the gradient against time and evaluations, each estimator swept over its own knob."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend
from teg.examples.charts.ours import evaluations, seconds_of
from teg.examples.charts.problem import expression
from teg.examples.charts.scenes import SCENES

SAMPLES = (2**8, 2**13, 2**18)
REPEATS = 3
"""A call is timed so many times, each time the quickest of several calls."""
SECONDS = 1.0
"""The limit for one call. A sweep ends when the next point would take longer."""
Knob = Callable[[float], Mapping[str, Any]]


@dataclass(frozen=True)
class Sweep:
    """An estimator at increasing effort: what a setting means as options of `teg.compile`, and the settings, the quick ones first."""

    label: str
    options: Knob
    settings: Sequence[float]


def _sampled(name: str, **more: Any) -> Knob:
    return lambda n: {"discontinuities": name, "samples": int(n), **more}


SWEEPS: dict[str, Sweep] = {
    "exact": Sweep("exact, to a tolerance", lambda tol: {"tol": tol}, (1e-2, 1e-5, 1e-10)),
    "edge-mc": Sweep("edge-mc", _sampled("edge-mc"), SAMPLES),
    "edge-qmc": Sweep("edge-mc, Sobol' points", _sampled("edge-mc", rule="qmc"), SAMPLES),
    "edge-tree": Sweep("edge-mc, by importance", _sampled("edge-mc", estimator={"sampling": "importance", "parts": 2}), SAMPLES[::2]),
    "warp": Sweep("warp, known surfaces", _sampled("warp"), SAMPLES),
    "warp-4": Sweep("warp, 4 auxiliary points", _sampled("warp", estimator={"auxiliary": 4}), SAMPLES[:2]),
    "warp-blur": Sweep(
        "warp-blur, κ = N^(-1/4)/2", lambda n: {"discontinuities": "warp-blur", "samples": int(n), "sigma": n**-0.25 / 2}, SAMPLES
    ),
    "smooth": Sweep("smooth, σ = N^(-1/5)/4", lambda n: {"discontinuities": "smooth", "samples": int(n), "sigma": n**-0.2 / 4}, SAMPLES),
    "smooth-grid": Sweep(
        "smooth on a grid of n², σ = 1/(2n)",
        lambda n: {"discontinuities": "smooth", "rule": "midpoint", "order": int(n), "sigma": 0.5 / n},
        (16, 64, 256),
    ),
    "differences": Sweep("differences, h = N^(-1/5)", _sampled("differences"), SAMPLES),
    "spsa": Sweep("spsa, h = N^(-1/5)", _sampled("spsa"), SAMPLES),
    "ignore": Sweep("ignore (plain AD)", lambda tol: {"discontinuities": "ignore", "tol": tol}, (1e-8,)),
}


@dataclass(frozen=True)
class Point:
    """One measurement: `error` of the gradient, the length of the difference relative to the gradient's; `seconds` of one call."""

    scene: str
    method: str
    setting: float
    error: float
    seconds: float
    evaluations: int

    def data(self) -> dict[str, Any]:
        return asdict(self) | {"error": self.error if math.isfinite(self.error) else str(self.error)}


@dataclass(frozen=True)
class Task:
    """All points of one estimator for one scene."""

    scene: str
    method: str
    settings: tuple[float, ...]

    @property
    def key(self) -> str:
        return f"{self.scene} | {self.method}"


def tasks(quick: bool) -> list[Task]:
    """Returns the measurements to make, scene by scene; a quick run has two scenes, and the first setting of each sweep."""
    scenes = list(SCENES)[:2] if quick else list(SCENES)
    return [Task(s, m, tuple(sweep.settings[:1] if quick else sweep.settings)) for s in scenes for m, sweep in SWEEPS.items()]


def compiled(task: Task, setting: float, backend: Backend) -> Evaluator:
    """Returns the evaluator of one point."""
    e, parameters = expression(SCENES[task.scene])
    return teg.compile(e, parameters, backend=backend, inaccurate="ignore", **SWEEPS[task.method].options(setting))


def prepare(task: Task, backend: Backend) -> None:
    """Compiles the programs of a task, so that the C compiler's cache has them."""
    for setting in task.settings:
        compiled(task, setting, backend).kernel(1)


def measure(task: Task, exact: Mapping[str, float], backend: Backend) -> Iterator[Point]:
    """Yields the points of a task in the order of effort; ends early when they take too long."""
    values = SCENES[task.scene].parameters
    for setting in task.settings:
        f = compiled(task, setting, backend)
        found = f.grad(**values)
        seconds = min(seconds_of(f, values, 1) for _ in range(REPEATS))
        count = evaluations(compiled(task, setting, "numpy"), values, 1)  # the same in every backend, and nothing more to compile for C
        yield Point(task.scene, task.method, setting, relative_error(found, exact), seconds, count or 0)
        if seconds > SECONDS / 4:
            return


def relative_error(found: Mapping[str, Any], exact: Mapping[str, float]) -> float:
    """Returns the length of the difference of two gradients, relative to the length of the exact one."""
    away = math.sqrt(sum((float(found[k]) - d) ** 2 for k, d in exact.items()))
    error = away / math.sqrt(sum(d * d for d in exact.values()))
    return error if math.isfinite(error) else math.inf


def middle_and_worst(points: Sequence[Point], method: str) -> list[tuple[Point, Point]]:
    """Returns, for each setting that every scene has, the medians over the scenes, and the scene with the largest error."""
    mine = [p for p in points if p.method == method]
    scenes = {p.scene for p in points}
    found = []
    for setting in dict.fromkeys(p.setting for p in mine):
        row = sorted((p for p in mine if p.setting == setting), key=lambda p: p.error)
        if {p.scene for p in row} == scenes:
            seconds, counts = sorted(p.seconds for p in row), sorted(p.evaluations for p in row)
            k = len(row) // 2
            middle = Point("", method, setting, math.sqrt(row[k].error * row[(len(row) - 1) // 2].error), seconds[k], counts[k])
            found.append((middle, row[-1]))
    return found
