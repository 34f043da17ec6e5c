"""The NumPy backend: the reference that the others are held against.

    compile_numpy(program)  ->  NumpyKernel: a call with columns of the batch gives (outputs, n)

`printer.py` has the text of the functions that a program becomes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from teg.backends.numpy import adaptive, integrals, isolate, lanes, locate, poles
from teg.backends.numpy import ellipse as ellipses
from teg.backends.numpy import guard as guards
from teg.backends.numpy import hyperbola as hyperbolas
from teg.backends.numpy import polygon as polygons
from teg.backends.numpy import polyhedron as polyhedra
from teg.backends.numpy import runtime as rt
from teg.backends.numpy import samples as sampling
from teg.backends.numpy.printer import print_numpy
from teg.program import (
    MAX_EVALUATIONS,
    TEXTS,
    WEIGHED,
    Assign,
    Outcome,
    Program,
    Stmt,
    Unbound,
    blocks,
    without_branches,
)

MEMORY = 256 * 2**20


def compile_numpy(program: Program, *, memory: int = MEMORY, most: int | None = None) -> NumpyKernel:
    """Returns a kernel that keeps its temporary arrays within about `memory` bytes; `most` bounds evaluations a point."""
    return NumpyKernel(program, memory, most)


class NumpyKernel:
    """A program as Python functions over NumPy arrays; `source` is their text."""

    def __init__(self, program: Program, memory: int = MEMORY, most: int | None = None) -> None:
        text, width = _kept(Unbound(program)) if program.functions else print_numpy(program)
        self.program = program
        self.memory, self.most = memory, MAX_EVALUATIONS if most is None else most
        functions = [_kept(Unbound(cast(Program, f.body)))[0] for f in program.functions]
        self.source = "\n".join([text, *(_titled(k, body) for k, body in enumerate(functions))])
        self._width = width
        self._room = max(1, memory // 8 // (1 + 2 * depth(without_branches(program).body)))
        scope: dict[str, Any] = {"np": np, "rt": rt, "sampling": sampling, "polygons": polygons, "polyhedra": polyhedra}
        scope |= {"integrals": integrals, "adaptive": adaptive, "isolate": isolate, "locate": locate, "lanes": lanes}
        scope |= {"poles": poles, "hyperbolas": hyperbolas, "ellipses": ellipses, "guards": guards}
        for k, body in enumerate(functions):
            scope[f"function_{k}"] = _made(body, dict(scope))
        self._function = _made(text, scope)

    def __reduce__(self) -> tuple[object, ...]:
        return (NumpyKernel, (self.program, self.memory, self.most))

    def __call__(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> npt.NDArray[np.float64]:
        """Returns the outputs of a batch of n, (outputs, n); a column is (n,), or () where the batch shares it."""
        return self._run(columns, n)[0]

    def outcome(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> Outcome:
        """Returns the outputs, whether a tolerance was missed, and how many evaluations it took."""
        out, _, run = self._run(columns, n)
        return Outcome(out, run.missed, run.evaluations, run.crowded, run.tied)

    def met_ties(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[int, ...]:
        """Returns the numbers k of the ties that a call with these arguments meets, ascending."""
        return tuple(sorted(self._run(columns, n)[1]))

    def values_and_ties(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[npt.NDArray[np.float64], tuple[int, ...], bool]:
        """Returns the outputs, the numbers k of the ties that were met, ascending, and whether evaluations ended before they were done."""
        out, met, run = self._run(columns, n)
        return out, tuple(sorted(met)), run.ended

    def in_order(self, columns: Sequence[npt.NDArray[np.float64]], n: int, order: int) -> npt.NDArray[np.float64]:
        """Returns the outputs with ties resolved in one order, +1 or -1, and no averaging; in one chunk."""
        with np.errstate(all="ignore"):
            return self._outputs(
                lanes.Run(order, self._room, most=self.most * float(n)), [np.asarray(c, dtype=np.float64)[()] for c in columns], n
            )

    def _run(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> tuple[npt.NDArray[np.float64], set[int], lanes.Run]:
        """Returns the outputs, the ties that were met, and a run that holds what all parts of the batch noted."""
        values = [np.asarray(column, dtype=np.float64) for column in columns]
        shared = all(v.ndim == 0 for v in values)
        out = np.empty((len(self.program.outputs), n))
        met: set[int] = set()
        noted = lanes.Run(+1, self._room)
        with np.errstate(all="ignore"):
            step = n if shared else lanes.Run(1, self._room).chunk(self._width)
            for start in range(0, n, max(1, step)):
                part = slice(start, start + step)
                arguments = [v[part] if v.ndim else v[()] for v in values]
                most = self.most * float(min(step, n - start))
                run = lanes.Run(+1, self._room, most=most)
                out[:, part] = self._outputs(run, arguments, min(step, n - start))
                if run.met:
                    again = lanes.Run(-1, self._room, most=most)
                    reverse = self._outputs(again, arguments, min(step, n - start))
                    noted.tied |= not self.program.weighs_ties or self._matters(out[:, part], reverse, arguments, most)
                    out[:, part] = 0.5 * out[:, part] + 0.5 * reverse
                    met |= run.met | again.met
                    noted.add(again)
                noted.add(run)
        return out, met, noted

    def _matters(self, one: npt.NDArray[np.float64], other: npt.NDArray[np.float64], arguments: Sequence[Any], most: float) -> bool:
        """Returns whether ties matter: results differ in both orders, or where all ties are true, or false."""
        if not _is_same(one, other):
            return True
        runs = (lanes.Run(order, self._room, most=most) for order in (2, -2))
        return not all(_is_same(one, self._outputs(run, arguments, one.shape[1])) for run in runs)

    def _outputs(self, run: lanes.Run, arguments: Iterable[Any], n: int) -> npt.NDArray[np.float64]:
        out = np.empty((len(self.program.outputs), n))
        for i, found in enumerate(self._function(run, *arguments)):
            out[i] = found
        return out


def _is_same(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> bool:
    """Returns whether results are the same in each lane, relative to the largest of the lane; NaN is the same as NaN."""
    most = np.abs(np.where(np.isfinite(one), one, 0.0)).max(axis=0, initial=0.0)
    return bool(((np.abs(one - other) <= WEIGHED * most) | (one == other) | (np.isnan(one) & np.isnan(other))).all())


@lru_cache(maxsize=TEXTS)
def _kept(unbound: Unbound) -> tuple[str, int]:
    """Returns what `print_numpy` does for a program that calls functions, or is the body of one: printed once for all bodies, and for all
    calls."""
    return print_numpy(unbound.program)


def _made(text: str, scope: dict[str, Any]) -> Any:
    """Returns the function of a printed program."""
    exec(compile(text, "<teg numpy kernel>", "exec"), scope)
    return scope["kernel"]


def _titled(k: int, body: str) -> str:
    """Returns the text of function k, as it is shown."""
    return f"\n# function_{k}: the kernel of\n{body}"


def depth(block: tuple[Stmt, ...]) -> int:
    """Returns the depth of integrals, searches for roots and sums inside one another."""
    inner = [1 + max((depth(b) for b in blocks(s)), default=0) for s in block if not isinstance(s, Assign)]
    return max(inner, default=0)
