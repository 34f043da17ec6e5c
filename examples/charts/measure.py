"""The chart's points: error, time and evaluations of every method at increasing effort, for every region."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass

from teg.errors import OptionError
from teg.evaluator.options import Backend
from teg.examples.charts.ours import call, compiled, seconds_in_a_batch
from teg.examples.charts.peers import PEERS, best_step, differences, gradient_error, relative_error
from teg.examples.charts.problem import OutOfTimeError, Problem
from teg.examples.charts.references import Reference
from teg.examples.charts.regions import REGIONS

SECONDS = 0.7
"""The limit for one point. A series ends when the next point would take longer."""
QUANTITIES = ("value", "gradient")


@dataclass(frozen=True)
class Series:
    """A method at increasing effort: the settings, and those of a quick run. `rule` names our rule, "" for another package."""

    label: str
    rule: str
    settings: Sequence[float]
    quick: Sequence[float]


SERIES: dict[str, Series] = {
    "auto": Series("Teg, to a tolerance", "auto", (1e-2, 1e-5, 1e-8, 1e-12), (1e-4, 1e-10)),
    "gauss": Series("Teg, Gauss of order n", "gauss", (2, 4, 8, 12, 20), (4, 12)),
    "midpoint": Series("uniform midpoint", "midpoint", (16, 128, 1024), (16, 32)),
    "montecarlo": Series("Monte Carlo", "montecarlo", (100, 10**4, 10**6), (100,)),
    "qmc": Series("quasi-Monte Carlo", "qmc", (2**8, 2**14, 2**20), (2**8,)),
    "dblquad": Series("SciPy dblquad", "", (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8), (1e-1,)),
    "cubature": Series("SciPy cubature", "", (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8), (1e-1,)),
    "vegas": Series("vegas", "", (100, 1000, 10**4, 10**5), (100,)),
}


@dataclass(frozen=True)
class Point:
    """One measurement: `error` relative, `seconds` of one call from Python, `batch_seconds` of one element of a batch of 256 (ours)."""

    region: str
    quantity: str
    method: str
    setting: float
    error: float
    seconds: float
    evaluations: int | None
    batch_seconds: float | None = None

    @property
    def key(self) -> str:
        return point_key(self.region, self.quantity, self.method, self.setting)

    def data(self) -> dict[str, object]:
        return asdict(self) | {"error": self.error if math.isfinite(self.error) else str(self.error)}


def point_key(region: str, quantity: str, method: str, setting: float) -> str:
    return f"{region} | {quantity} | {method} | {setting:g}"


@dataclass(frozen=True)
class Task:
    """All points of one method for one quantity of one region."""

    region: str
    quantity: str
    method: str
    settings: tuple[float, ...]

    @property
    def key(self) -> str:
        return f"{self.region} | {self.quantity} | {self.method}"


def tasks(quick: bool) -> list[Task]:
    """Returns the measurements to make, region by region."""
    return [
        Task(region, quantity, method, tuple(s.quick if quick else s.settings))
        for region in REGIONS
        for quantity in QUANTITIES
        for method, s in SERIES.items()
    ]


def measure(task: Task, exact: Reference, backend: Backend, known: Callable[[str], float | None]) -> Iterator[Point]:
    """Yields the points of a task in the order of effort, except those whose seconds are `known`; ends early when they take too long.

    A rule that this version of the compiler does not have yields none.
    """
    last = 0.0
    for setting in task.settings:
        if last > SECONDS / 3:
            return
        seconds = known(point_key(task.region, task.quantity, task.method, setting))
        if seconds is None:
            try:
                point = _point(task, setting, exact, backend)
            except (OptionError, OutOfTimeError):
                return
            seconds = point.seconds
            yield point
        last = seconds


def prepare(task: Task, backend: Backend) -> None:
    """Compiles the programs of a task, so that the C compiler's cache has them."""
    rule, problem = SERIES[task.method].rule, REGIONS[task.region]
    for setting in task.settings if rule else ():
        try:
            f = compiled(problem, rule, setting, backend)
        except OptionError:
            return
        if task.quantity == "gradient":
            f.grad(**problem.parameters)
        else:
            f(**problem.parameters)


def _point(task: Task, setting: float, exact: Reference, backend: Backend) -> Point:
    problem, derivatives = REGIONS[task.region], QUANTITIES.index(task.quantity)
    rule = SERIES[task.method].rule
    if rule:
        f = compiled(problem, rule, setting, backend)
        timed = call(f, problem.parameters, derivatives)
        if timed.gradient is None:
            error = relative_error(timed.value, exact.value)
        else:
            error = gradient_error(timed.gradient, exact.gradient)
        batch = seconds_in_a_batch(f, problem.parameters, derivatives) if rule in ("auto", "gauss") else None
        return Point(task.region, task.quantity, task.method, setting, error, timed.seconds, timed.evaluations, batch)
    return _peer_point(task, problem, setting, exact)


def _peer_point(task: Task, problem: Problem, setting: float, exact: Reference) -> Point:
    method = PEERS[task.method]
    begun = time.perf_counter()
    outcome = method(problem, problem.parameters, setting, begun + SECONDS)
    seconds = time.perf_counter() - begun
    error = relative_error(outcome.value, exact.value)
    if task.quantity == "value":
        return Point(task.region, task.quantity, task.method, setting, error, seconds, outcome.evaluations)
    step = best_step(task.method, setting, error)
    slopes, evaluations, seconds = differences(method, problem, setting, step, time.perf_counter() + SECONDS)
    error = gradient_error({k: o.value for k, o in slopes.items()}, exact.gradient)
    return Point(task.region, task.quantity, task.method, setting, error, seconds, evaluations)
