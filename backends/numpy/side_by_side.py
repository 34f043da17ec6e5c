"""Many points with polygons and segments as one straight line of arithmetic, the one that C computes eight points by.

    live                where the outputs are not 0                      `teg.backends.c.lanes`
    outputs, good       where surfaces cross boxes, or do not            `teg.backends.c.crossed`

Clipping corner by corner takes NumPy some hundred calls with gathers and scatters; the line takes as many, of plain arithmetic, over blocks
that the cache holds. Points at which it is not good are computed as in a small batch. Arrays that are not needed any more give their
names, and so their memory, to others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from teg.backends.branches import with_branches
from teg.backends.c.crossed import Crossed, crossed
from teg.backends.c.items import Item, Nodes, defines
from teg.backends.c.lanes import Packed, packed
from teg.backends.numpy.kernel import MEMORY, NumpyKernel, compile_numpy
from teg.backends.numpy.printer import DIALECT
from teg.backends.text import assignment, inside, value
from teg.program import Arg, Assign, Outcome, Program
from teg.program.names import of_kind

Array = npt.NDArray[np.float64]
LEAST = 64
"""Points for which it pays."""
BLOCK, FEWEST = 8192, 512
"""Points that are computed together, at most, and at least if memory is short."""
MOSTLY = 0.75
"""The share of points that are live from which all are computed."""
SPELLED = {"lower": "min", "upper": "max"}
"""Operations of NumPy that are the same but for NaN, which they hand on: such points are not good."""


def compile_side_by_side(program: Program, *, memory: int = MEMORY) -> NumpyKernel | SideBySideKernel:
    """Returns a kernel that computes many points by straight lines where a program has them, else a plain one."""
    exact = compile_numpy(program, memory=memory)
    branched = with_branches(program)
    line = crossed(branched)
    if line is None:
        return exact
    known = packed(branched)
    return SideBySideKernel(exact, line, None if known is None or known.live is True else known)


def _written(items: Sequence[Item]) -> Iterator[Assign]:
    """Yields the assignments of a line, those at nodes once for each node."""
    inner = [s.name for item in items if isinstance(item, Nodes) for s in item.body]
    used = [*inner, *(name for item in items for name in defines(item))]
    names = count(1 + max((int(name[1:]) for name in used if name[1:].isdigit()), default=0))
    for item in items:
        if isinstance(item, Assign):
            yield Assign(item.name, SPELLED.get(item.op, item.op), item.args)
            continue
        terms: dict[str, list[Arg]] = {total: [] for total in item.sums}
        for i, weight in enumerate(item.weights):
            at: dict[Arg, Arg] = {variable: places[i] for variable, places in item.places.items()}
            for s in item.body:
                name = of_kind(s.name, next(names))
                yield Assign(name, SPELLED.get(s.op, s.op), tuple(at.get(a, a) for a in s.args))
                at[s.name] = name
            for number, total in zip(item.values, item.sums, strict=True):
                term = f"v{next(names)}"
                yield Assign(term, "mul", (weight, at.get(number, number)))
                terms[total].append(term)
        for total, parts in terms.items():
            yield Assign(total, "add" if len(parts) > 1 else "const", tuple(parts))


def _function(parameters: int, body: Sequence[Assign], outputs: Sequence[Arg]) -> tuple[str, int, Callable[..., Any]]:
    """Returns the text of a function of the parameters, how many arrays it holds, and the function."""
    last: dict[Arg, int] = {a: i for i, s in enumerate(body) for a in s.args}
    last |= dict.fromkeys(outputs, len(body))
    names: dict[Arg, str] = {}
    free: list[str] = []
    lines = [f"def line({', '.join(f'p{i}' for i in range(parameters))}):"]
    held = 0
    for i, s in enumerate(body):
        args = tuple(names.get(a, a) for a in s.args)
        free += [names[a] for a in dict.fromkeys(s.args) if a in names and last[a] == i]
        if not free:
            free.append(f"v{held}")
            held += 1
        names[s.name] = free.pop() if s.name in last else free[-1]
        lines += [f"    {line}" for line in assignment(Assign(names[s.name], s.op, args), DIALECT)]
    lines.append(f"    return ({inside(value(names.get(o, o), 'np') for o in outputs)})")
    text = "\n".join(lines)
    scope: dict[str, Any] = {"np": np}
    exec(compile(text, "<teg numpy lines>", "exec"), scope)
    return text, held + parameters, scope["line"]


class SideBySideKernel:
    """A program whose points are computed side by side where there are many; `exact` computes the others."""

    def __init__(self, exact: NumpyKernel, line: Crossed, known: Packed | None) -> None:
        """Points are not `live` only by what is `known`."""
        self.exact, self.program = exact, exact.program
        inputs = len(self.program.parameters)
        text, held, self._line = _function(inputs, list(_written(line.items)), (*line.outputs, line.good))
        decided, self._live = "", cast("Callable[..., Any] | None", None)
        if known is not None:
            decided, _, self._live = _function(inputs, known.settling, (known.live,))
        self._block = max(FEWEST, min(BLOCK, exact.memory // (8 * held)))
        self.source = "\n".join([exact.source, "\n# many points side by side", decided, text, ""])

    def __reduce__(self) -> tuple[object, ...]:
        return (partial(compile_side_by_side, memory=self.exact.memory), (self.program,))

    def __call__(self, columns: Sequence[Array], n: int) -> Array:
        """Returns the outputs of a batch of n, (outputs, n), as `NumpyKernel` does."""
        return self.outcome(columns, n).values

    def outcome(self, columns: Sequence[Array], n: int) -> Outcome:
        """Returns the outputs, and what was noted at points that are computed one by one."""
        values = [np.asarray(column, dtype=np.float64) for column in columns]
        if n < LEAST or all(v.ndim == 0 for v in values):
            return self.exact.outcome(columns, n)
        out = np.zeros((len(self.program.outputs), n))
        left: list[npt.NDArray[np.intp]] = []
        with np.errstate(all="ignore"):
            for start in range(0, n, self._block):
                part = slice(start, min(n, start + self._block))
                left.append(start + self._computed([v[part] if v.ndim else v[()] for v in values], out[:, part]))
        others = np.concatenate(left)
        if not others.size:
            return Outcome(out, False, 0)
        found = self.exact.outcome([v[others] if v.ndim else v for v in values], len(others))
        out[:, others] = found.values
        return found._replace(values=out)

    def _computed(self, values: Sequence[Any], out: Array) -> npt.NDArray[np.intp]:
        """Writes the outputs of a block; returns the points at which they are not good."""
        n = out.shape[1]
        live = np.ones(n, dtype=bool) if self._live is None else np.broadcast_to(self._live(*values)[0], (n,))
        few = np.count_nonzero(live) < MOSTLY * n
        chosen = np.flatnonzero(live) if few else np.arange(n)
        if not chosen.size:
            return chosen
        if few:
            values = [v[chosen] if v.ndim else v for v in values]
        *outputs, good = self._line(*values)
        for row, output in zip(out, outputs, strict=True):
            if few:
                row[chosen] = output
            else:
                row[:] = output
        bad: npt.NDArray[np.intp] = chosen[~np.broadcast_to(good, chosen.shape)]
        return bad
