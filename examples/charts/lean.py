"""What a call of value and gradient does, counted while it runs, and its nanoseconds, beside the least known.

scene → program → counts by the interpreter, statements, nanoseconds in C  |  the same by hand in C, or a figure with its source
"""

from __future__ import annotations

import ctypes
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import teg
from teg.evaluator.evaluator import Evaluator
from teg.evaluator.options import Backend
from teg.examples.charts.lean_scenes import Scene
from teg.program import Program, size
from teg.program.arrays import ArrayProgram, array_size
from teg.program.interpreter.counts import Counts, counts_of, counts_of_arrays
from teg.program.tabled import Table, TabledProgram

COUNTED = 8
"""Elements of a batch whose runs are counted."""
RUNS = 9
SEED = 1
BY_HAND = Path(__file__).with_name("by_hand.c")


@dataclass(frozen=True)
class Row:
    """One scene: means an element of what a call of value and gradient does, and what the least known does.

    `least` is None where no time is known; `measured` says whether it was measured in the same run; `difference` is the largest
    one between the results and those by hand, relative to max(1, |result|).
    """

    scene: str
    evaluations: float
    least_evaluations: int
    decisions: float
    statements: int
    nanoseconds: float
    least: float | None
    measured: bool
    source: str
    difference: float | None

    @property
    def ratio(self) -> float | None:
        return None if self.least is None else self.nanoseconds / self.least

    def data(self) -> dict[str, Any]:
        return asdict(self)


def measure(scene: Scene, backend: Backend, quick: bool = False) -> Row:
    """Returns the row of a scene. By hand is C, so other backends are compared with stored figures only."""
    e, wrt = scene.build()
    f = teg.compile(e, wrt, backend=backend)
    counts, statements = counted(f, scene)
    least: float | None = None if math.isnan(scene.least.nanoseconds) else scene.least.nanoseconds
    source, measured, difference, share = scene.least.source, False, None, scene.share
    draw = scene.draw
    if quick and scene.small is not None:
        draw, share = scene.small
    values = draw(np.random.default_rng(SEED))
    if quick and scene.small is None:
        values = {name: column[:64] for name, column in values.items()}
    elements = share * (1 if scene.small else max(np.size(v) for v in values.values()))
    run = runner(f, values, scene.small is None)
    if scene.least.by_hand and backend == "c":
        hand = ByHand(scene.least.by_hand, values, columns_by_hand(scene, wrt), len(wrt))
        taken, least = (nanoseconds / elements for nanoseconds in in_turn(run, hand))
        source, measured, difference = "by hand in C, `by_hand.c`, in the same run", True, hand.difference(f, values, wrt)
    else:
        taken = in_turn(run)[0] / elements
    return Row(
        scene.name, counts.evaluations, scene.least.evaluations, counts.decisions, statements, taken, least, measured, source, difference
    )  # fmt: skip


# -- counts ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Means:
    """Means of counts over elements."""

    evaluations: float
    decisions: float


def counted(f: Evaluator, scene: Scene) -> tuple[Means, int]:
    """Returns the counts of one element, from runs of the program that the evaluator runs, and the number of its statements."""
    draw, share = scene.small or (scene.draw, 1)
    values = draw(np.random.default_rng(SEED))
    if scene.small is not None:
        f.value_and_grad(values)  # the lengths of its arrays
    kernel = f.kernel(1)
    tabled: TabledProgram | None = getattr(kernel, "tabled", None)
    program: Program | ArrayProgram = kernel.program if tabled is None else tabled.program
    statements = size(program) if isinstance(program, Program) else array_size(program)
    if isinstance(program, ArrayProgram) and tabled is None:
        arguments = [float(values[name]) for name in program.parameters]
        found = [counts_of_arrays(program, arguments, [np.asarray(values[a.name]) for a in program.arrays])]
    else:
        length = max(np.size(v) for v in values.values())
        found = [_at(program, tabled, f, values, i) for i in range(0, length, -(-length // COUNTED))]
    share *= len(found)
    return Means(sum(c.evaluations for c in found) / share, sum(c.decisions for c in found) / share), statements


def _at(program: Program | ArrayProgram, tabled: TabledProgram | None, f: Evaluator, values: Mapping[str, Any], i: int) -> Counts:
    """Returns the counts of element i of a batch."""
    if tabled is None:
        assert isinstance(program, Program)
        return counts_of(program, [float(values[name][i]) for name in program.parameters])
    columns = [float(values[name][i]) for name in tabled.parameters]
    return counts_of_arrays(tabled.program, [columns[k] for k in tabled.given], [_filled(table, columns) for table in tabled.tables])


def _filled(table: Table, columns: Sequence[float]) -> np.ndarray:
    entries = [columns[e] if isinstance(e, int) else e for e in table.entries]
    return np.array(entries, dtype=float).reshape(table.rows, table.columns)


# -- nanoseconds -------------------------------------------------------------------------------------------------------


def runner(f: Evaluator, values: Mapping[str, Any], batch: bool) -> Callable[[], object]:
    """Returns a call of value and gradient: of the kernel for a batch, where what Python adds is that of one call."""
    kernel = f.kernel(1)
    if not batch:
        return lambda: f.value_and_grad(values)
    names = getattr(kernel, "tabled", kernel.program).parameters
    columns = [np.ascontiguousarray(values[name], dtype=np.float64) for name in names]
    return lambda: kernel.outcome(columns, len(columns[0]))


def in_turn(*actions: Callable[[], object]) -> list[float]:
    """Returns nanoseconds that this thread was busy with each action, medians of runs that take turns."""
    times: list[list[float]] = [[] for _ in actions]
    for action in actions:
        action()
    for _ in range(RUNS):
        for action, taken in zip(actions, times, strict=True):
            start = time.thread_time_ns()
            action()
            taken.append(time.thread_time_ns() - start)
    return [statistics.median(taken) for taken in times]


class ByHand:
    """A function of by_hand.c on a batch; a call fills `results`, (outputs, n)."""

    def __init__(self, name: str, values: Mapping[str, Any], names: Sequence[str], derivatives: int) -> None:
        from teg.backends.c.build import load_library

        self._columns = [np.ascontiguousarray(values[k], dtype=np.float64) for k in names]
        n = len(self._columns[0])
        self.results = np.zeros((1 + derivatives, n))
        self._inputs = np.array([c.ctypes.data for c in self._columns], dtype=np.uintp)
        self._outputs = np.array([row.ctypes.data for row in self.results], dtype=np.uintp)
        self._function = getattr(load_library(BY_HAND.read_text(encoding="utf-8")), name)
        self._arguments = [ctypes.c_long(n), ctypes.c_void_p(self._inputs.ctypes.data), ctypes.c_void_p(self._outputs.ctypes.data)]

    def __call__(self) -> None:
        self._function(*self._arguments)

    def difference(self, f: Evaluator, values: Mapping[str, Any], wrt: Sequence[Any]) -> float:
        """Returns the largest difference from the results of an evaluator."""
        self()
        value, slopes = f.value_and_grad(values)
        found = np.stack([np.asarray(value), *(np.asarray(slopes[p.name]) for p in wrt)])
        return float((np.abs(found - self.results) / np.maximum(1.0, np.abs(found))).max())


def columns_by_hand(scene: Scene, wrt: Sequence[Any]) -> list[str]:
    """Returns the names of the columns of a function by hand: what it differentiates by, then the other parameters as they were drawn."""
    moving = [p.name for p in wrt]
    return [*moving, *(name for name in scene.draw(np.random.default_rng(SEED)) if name not in moving)]
