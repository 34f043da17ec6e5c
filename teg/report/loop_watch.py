"""How a program with loops is looked at: its derivatives, and the ties of every iteration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from teg.analysis.surfaces import atoms_of
from teg.ir.arrays import Gather, Ranged, Sum, sum_over
from teg.ir.cells import Symbols
from teg.ir.expr import TRUE, ZERO, Expr, Param
from teg.ir.index import ArrayName
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import add, bracket, positive
from teg.program import Isolate, statements
from teg.program.arrays import ArrayProgram, Cells, Integers, Run, steps
from teg.report.diagnose import BORDER, CHANGE, NOTHING, STEP, STEP_OVER_TIES, Diagnosis, Element, Look
from teg.report.parameter_steps import only_in_steps

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from teg.backends.numpy.ties import MetTie

    Numbers = npt.NDArray[np.float64]


DIRECTIONS = 2
"""The number of directions along which the gradient of a program with arrays is compared; all entries of all parameters move at once."""
STEP_OVER_CELLS = 2.0**-36
"""The step in programs with cells of choices, where keys closer than `teg.numerics.cells.EPSILON` are equal."""
LONGER = 16
"""The factor of a longer step. It tells a jump, whose change stays the same, from a slope, whose change grows with the step."""
LONGEST = 3.0
"""The largest step of an entry, in parts of the least one: steps differ, since equal entries that move together stay equal."""
MOST = 100
"""The largest number of diagnoses of one kind in one element of a batch."""


class LoopWatch:
    """A program of values and derivatives by `wrt`, and `probes_of` the normal form of the values.

    `creases` returns the ties of second derivatives at an element of the batch, if they were asked for before.
    """

    def __init__(
        self,
        wrt: Sequence[Param | ArrayName],
        program: ArrayProgram,
        probes: ArrayProgram,
        creases: Callable[[int], Sequence[MetTie]] | None = None,
    ) -> None:
        from teg.backends.numpy.ties import TieWatch

        self.wrt, self.program, self.creases = wrt, program, creases
        self.watch, self.borders = TieWatch(program), TieWatch(probes)
        flat = (s for step in steps(program.body) if isinstance(step, Run) for s in statements(step.program.body))
        self.searched = any(isinstance(s, Isolate) for s in flat)
        self.has_cells = any(isinstance(s, Cells) for s in steps(program.body))

    def look(self, at: Element) -> Look:
        """Returns the results, and the ties of every iteration."""
        results, met = self.watch.ties(at.columns, at.arrays, 1)
        _, on_border = self.borders.ties(at.columns, at.arrays, 1)
        ties = [*_ties(met, at, _tie), *_ties(on_border, at, _border)]
        step = STEP_OVER_TIES if self.watch.noted or self.searched else STEP
        return Look(results.values, ties, STEP_OVER_CELLS if self.has_cells else step)

    def of_results(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns diagnoses of infinite derivatives, and of values and derivatives that are NaN."""
        import numpy as np

        for name, slopes in _slopes(self.wrt, look.results):
            if np.isinf(slopes).any():
                where = _entry(name, _where(np.isinf(slopes[0])))
                message = f"the derivative by {where} is infinite here: a region is born or meets a pole"
                return [Diagnosis("infinite derivative", (), at.values, message, at.number)]
        if any(np.isnan(v).any() for v in look.results):
            by = [_entry(name, _where(np.isnan(slopes[0]))) for name, slopes in _slopes(self.wrt, look.results) if np.isnan(slopes).any()]
            reason = f"the derivative by {by[0]} is not a number here" if by else "the value is not a number here"
            return [Diagnosis("not a number", (), at.values, reason, at.number)]
        if look.ties or at.second is None or not at.second.message:
            return []
        return self._second(at, at.second.message)

    def _second(self, at: Element, message: str) -> list[Diagnosis]:
        """Returns diagnoses of second derivatives, in each iteration whose surfaces meet, if these are known."""
        met = [] if self.creases is None else self.creases(at.number)
        ties = _ties(met, at, lambda surfaces: ("second derivative", (), message))
        once = list({tuple(tie.iteration.items()): tie for tie in ties}.values())
        return once or [Diagnosis("second derivative", (), at.values, message, at.number)]

    def one_sided(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns diagnoses of derivatives that jump while all parameters move a few roundings, in random directions."""
        import numpy as np

        program, relative = self.program, look.step
        counts = {program.parameters[int(s.args[0])] for s in steps(program.body) if isinstance(s, Integers) and s.op == "param"}
        names = {p.name for p in self.wrt} - counts
        for seed in range(DIRECTIONS):
            random = np.random.default_rng(seed)

            def moved(name: str, v: Numbers, shape: tuple[int, ...], random: np.random.Generator = random) -> Numbers:
                v = v.reshape(shape)
                if name not in names:
                    return v
                sizes = random.choice([-1.0, 1.0], shape) * random.uniform(1.0, LONGEST, shape)
                step = relative * np.where(v == 0.0, 1.0, np.abs(v)) * sizes
                return np.stack([v - step, v + step, v - LONGER * step, v + LONGER * step])

            columns = [moved(name, c, ()) for name, c in zip(program.parameters, at.columns, strict=True)]
            arrays = [moved(s.name, a, a.shape[a.ndim - s.dimensions :]) for s, a in zip(program.arrays, at.arrays, strict=True)]
            results = self.watch.results(columns, arrays, 4).values
            flat = [
                (name, slopes, now[0])
                for (name, slopes), (_, now) in zip(_slopes(self.wrt, results), _slopes(self.wrt, look.results), strict=True)
            ]
            largest = max((float(np.abs(now).max(initial=0.0)) for *_, now in flat), default=0.0)
            for name, (before, after, earlier, later), now in flat:
                scale = np.maximum(np.maximum(np.abs(before), np.abs(after)), largest * 1e-3 + NOTHING)
                change = np.maximum(np.abs(after - before), np.abs(now - 0.5 * (before + after)))
                longer = np.maximum(np.abs(later - earlier), np.abs(now - 0.5 * (earlier + later)))
                at_once = np.isfinite(change) & ~(longer > 0.5 * LONGER * change)
                change = np.where(at_once, change, 0.0) / scale
                if change.size and change.max() > CHANGE:
                    place = tuple(int(n) for n in np.unravel_index(int(np.argmax(change)), change.shape))
                    message = (
                        f"within {relative:.1e} of these values, relative to each, the derivative by {_entry(name, place)} goes from "
                        f"{before[place]:.6g} to {after[place]:.6g}, and is given as {now[place]:.6g}"
                    )
                    return [Diagnosis("one-sided", (), at.values, message, at.number)]
        return []


def probes_of(e: Expr) -> Expr:
    """Returns an expression that meets a tie where entries, parameters and sums are on the border of a condition on them alone."""
    new: dict[Node, Expr] = {}  # for sums: the probes in their bodies
    order = postorder([e])
    for node in order:
        if isinstance(node, Sum):
            new[node] = sum_over(_cell_probes(node.body, new), node.index, node.lo, node.hi)
    return _cell_probes(e, new)


def _cell_probes(cell: Expr, sums: dict[Node, Expr]) -> Expr:
    symbols = Symbols()
    (plain,) = symbols.into([cell])
    own = [a for a in atoms_of(plain) if not a.g.free and a.resolution is None and _varies(a.g, symbols) and not only_in_steps(a.g)]
    found = [bracket(positive(a.g, a.strict, TRUE, (f"{show(a.g, 300)} = 0", BORDER))) for a in own]
    inside = [sums[leaf] for leaf in symbols.of if isinstance(leaf, Sum)]
    return add(*symbols.out_of(found), *inside) if found or inside else ZERO


def _varies(g: Expr, symbols: Symbols) -> bool:
    """Returns whether an expression depends on more than indices."""
    return any(isinstance(n, Param) and isinstance(symbols.meaning.get(n, n), Param | Gather | Ranged) for n in postorder([g]))


def _ties(met: Sequence[MetTie], at: Element, said: Callable[[tuple[str, str]], tuple[str, tuple[str, ...], str]]) -> list[Diagnosis]:
    """Returns each pair of surfaces once for each iteration."""
    found: dict[tuple[object, ...], Diagnosis] = {}
    for tie in met:
        key = frozenset(tie.surfaces), tuple(tie.iteration.items())
        if key in found or len(found) >= MOST:
            continue
        kind, surfaces, message = said(tie.surfaces)
        if tie.iteration:
            message = f"in the iteration {', '.join(f'{k} = {n}' for k, n in tie.iteration.items())}: {message}"
        entries = {title: v for title, v in tie.inputs.items() if title not in tie.iteration}
        found[key] = Diagnosis(kind, surfaces, {**at.values, **entries}, message, at.number, tie.iteration)
    return list(found.values())


def _tie(surfaces: tuple[str, str]) -> tuple[str, tuple[str, ...], str]:
    first, second = surfaces
    return "tie", surfaces, f"{first} coincides with {second}; the derivative is the mean over the two orders"


def _border(surfaces: tuple[str, str]) -> tuple[str, tuple[str, ...], str]:
    return "parameter surface", surfaces[:1], f"the parameters lie on {surfaces[0]}; the derivative is that of one side"


def _slopes(wrt: Sequence[Param | ArrayName], results: Sequence[Numbers]) -> Iterator[tuple[str, Numbers]]:
    """Yields derivatives of every leaf by every parameter, with the name of the parameter."""
    leaves = len(results) // (1 + len(wrt))
    for j, slopes in enumerate(results[leaves:]):
        yield wrt[j % len(wrt)].name, slopes


def _entry(name: str, place: tuple[int, ...]) -> str:
    return f"{name}[{', '.join(map(str, place))}]" if place else name


def _where(wrong: npt.NDArray[np.bool_]) -> tuple[int, ...]:
    import numpy as np

    return tuple(int(n) for n in np.argwhere(wrong)[0])
