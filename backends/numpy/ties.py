"""Which iterations of a program with arrays meet ties, and whether the order of the surfaces matters there.

    TieWatch(program).ties(columns, arrays, n)  ->  the results, and a `MetTie` for each tie of each iteration that meets one

Flat programs run on all lanes first; those that note a tie run in both orders, and only lanes whose results differ are looked into one by
one. Cost: that of three runs, and one more a lane that has something to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.kernel import compile_numpy
from teg.backends.numpy.loops import LaneKernel, Lanes, Results, Running, lane_values
from teg.program.arrays import Arg, ArrayProgram, Loop, Run, Step
from teg.program.names import is_parameter

Array = npt.NDArray[Any]
AT_ONCE = 4096
"""Lanes that run in one order at a time."""
MOST = 64
"""Lanes of one flat program that are looked into, in one block of iterations."""


class MetTie(NamedTuple):
    """Two surfaces that coincide in one iteration: the element of the batch, the indices of the loops around, outermost first, and
    the parameters and entries of arrays that the flat program was given, by title."""

    surfaces: tuple[str, str]
    element: int
    iteration: dict[str, int]
    inputs: dict[str, float]


class TieWatch(LaneKernel):
    """A program whose runs note the ties they meet."""

    def __init__(self, program: ArrayProgram) -> None:
        super().__init__(program, compile_numpy)
        self.noted = False  # any tie, whether it matters or not
        self.around: dict[int, tuple[Loop, ...]] = {}
        stack: list[tuple[Step, tuple[Loop, ...]]] = [(s, ()) for s in program.body]
        while stack:
            step, around = stack.pop()
            self.around[id(step)] = around
            if isinstance(step, Loop):
                stack.extend((s, (*around, step)) for s in step.body)
        indices = frozenset[Arg](s.index for around in self.around.values() for s in around)
        self._used = {key: names | indices for key, names in self._used.items()}

    def ties(self, columns: Sequence[Array], arrays: Sequence[Array], n: int) -> tuple[Results, list[MetTie]]:
        """Returns the outputs of a batch, as `results` gives them, and the ties that were met and matter."""
        self.met: list[MetTie] = []
        self.noted = False
        return self.results(columns, arrays, n), self.met

    def _start(self, arrays: Sequence[Array], n: int) -> Running:
        return _Watching(self, arrays, n)


class _Watching(Running):
    kernel: TieWatch

    def _run(self, step: Run, lanes: Lanes) -> None:
        super()._run(step, lanes)
        if not step.program.ties:
            return
        columns = [np.asarray(lane_values(a, lanes), dtype=np.float64) for a in step.inputs]
        count = min(lanes.size, 1) if all(c.ndim == 0 for c in columns) else lanes.size
        kernel = self.kernel._kernels[id(step)]
        if not count or not kernel.met_ties(columns, count):
            return
        self.kernel.noted = True
        differ = np.concatenate([_differing(kernel, columns, s, min(s + AT_ONCE, count)) for s in range(0, count, AT_ONCE)])
        for lane in np.flatnonzero(differ)[:MOST]:
            given = [c if c.ndim == 0 else c[lane : lane + 1] for c in columns]
            titled = zip(step.program.parameters, step.inputs, given, strict=True)
            inputs = {title: float(np.ravel(c)[0]) for title, arg, c in titled if is_parameter(arg) or title.endswith("]")}
            elements = range(lanes.size) if count == 1 and not self.kernel.around[id(step)] else [lane]
            for k in kernel.met_ties(given, 1):
                for at in elements:
                    iteration = {s.title: int(_at(lanes.values[s.index], at)) for s in self.kernel.around[id(step)]}
                    tie = MetTie(step.program.ties[k].surfaces, int(lanes.element[at]), iteration, inputs)
                    self.kernel.met.append(tie)


def _differing(kernel: Any, columns: Sequence[Array], start: int, stop: int) -> Array:
    """Returns lanes whose results depend on the order; where surfaces merely cross they do not."""
    part = [c if c.ndim == 0 else c[start:stop] for c in columns]
    one, other = (kernel.in_order(part, stop - start, order) for order in (1, -1))
    return np.asarray(~np.isclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True).all(axis=0))


def _at(values: Array, lane: int) -> Any:
    return values if values.ndim == 0 else values[lane]
