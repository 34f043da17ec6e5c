"""Where a program with arrays is not differentiable, and why: in which iteration of which sums."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from teg.analysis.surfaces import atoms_of
from teg.backends.numpy.ties import MetTie, TieWatch
from teg.ir.arrays import Gather, Sum, sum_over
from teg.ir.cells import Symbols
from teg.ir.expr import TRUE, ZERO, Expr, Param, add, bracket, positive
from teg.ir.index import ArrayName
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.program import Isolate, statements
from teg.program.arrays import ArrayProgram, Integers, Run, steps
from teg.report.diagnose import BORDER, CHANGE, NOTHING, STEP, STEP_OVER_TIES, Diagnosis, only_in_steps

if TYPE_CHECKING:
    import numpy.typing as npt

    Numbers = npt.NDArray[np.float64]

DIRECTIONS = 2
"""Directions along which the gradient is compared with itself; all entries of all parameters move at once."""
MOST = 100
"""Diagnoses of one kind in one element of a batch."""


def diagnose_arrays(
    wrt: Sequence[Param | ArrayName], program: ArrayProgram, probes: ArrayProgram, call: Any, second: Any = None
) -> list[Diagnosis]:
    """One Diagnosis a reason, iteration and batch element. `program` gives values and derivatives, `probes` is that of `probes_of`;
    `second` says of each element whether its second derivatives are finite, if anyone has asked for them."""
    watch, borders = TieWatch(program), TieWatch(probes)
    flat = (s for step in steps(program.body) if isinstance(step, Run) for s in statements(step.program.body))
    searched = any(isinstance(s, Isolate) for s in flat)  # roots that meet to rounding are a tangency
    scalars, arrays = program.parameters, program.arrays
    found: list[Diagnosis] = []
    for i in range(call.n):
        columns = [c if c.ndim == 0 else c[i : i + 1] for c in call.doubles]
        given = [a if a.ndim == s.dimensions else a[i : i + 1] for a, s in zip(call.arrays, arrays, strict=True)]
        values = {k: float(np.ravel(c)[0]) for k, c in zip(scalars, columns, strict=True)}
        results, met = watch.ties(columns, given, 1)
        _, on_border = borders.ties(columns, given, 1)
        mine = [*_ties(met, values, i, _tie), *_ties(on_border, values, i, _border)]
        if all(np.isfinite(v).all() for v in (*columns, *given)):
            mine += _of_results(wrt, program, results.values, values, i)
            if not mine and second is not None and not second[i]:
                mine.append(Diagnosis("second derivative", (), values, "a second derivative is infinite, or not a number, here", i))
            if not mine:
                relative = STEP_OVER_TIES if watch.noted or searched else STEP
                mine += _one_sided(wrt, program, watch, (columns, given), results.values, (values, relative, i))
        found += mine
    return found


def probes_of(e: Expr) -> Expr:
    """An expression that meets a tie where the entries, parameters and sums of a normal form are on the border of a condition on them
    alone."""
    new: dict[Node, Expr] = {}  # of sums: the probes in their bodies
    order = postorder([e])
    for node in order:
        if isinstance(node, Sum):
            new[node] = sum_over(_probes(node.body, new), node.index, node.lo, node.hi)
    return _probes(e, new)


def _probes(cell: Expr, sums: dict[Node, Expr]) -> Expr:
    symbols = Symbols()
    (plain,) = symbols.into([cell])
    own = [a for a in atoms_of(plain) if not a.g.free and a.resolution is None and _varies(a.g, symbols) and not only_in_steps(a.g)]
    found = [bracket(positive(a.g, a.strict, TRUE, (f"{show(a.g, 300)} = 0", BORDER))) for a in own]
    inside = [sums[leaf] for leaf in symbols.of if isinstance(leaf, Sum)]
    return add(*symbols.out_of(found), *inside) if found or inside else ZERO


def _varies(g: Expr, symbols: Symbols) -> bool:
    """Whether it depends on more than indices."""
    return any(isinstance(n, Param) and isinstance(symbols.meaning.get(n, n), Param | Gather | Sum) for n in postorder([g]))


def _ties(
    met: Sequence[MetTie], values: dict[str, float], index: int, said: Callable[[tuple[str, str]], tuple[str, tuple[str, ...], str]]
) -> list[Diagnosis]:
    """Each pair of surfaces once an iteration."""
    found: dict[tuple[object, ...], Diagnosis] = {}
    for tie in met:
        key = tie.surfaces, tuple(tie.iteration.items())
        if key in found or len(found) >= MOST:
            continue
        kind, surfaces, message = said(tie.surfaces)
        if tie.iteration:
            message = f"in the iteration {', '.join(f'{k} = {n}' for k, n in tie.iteration.items())}: {message}"
        entries = {title: v for title, v in tie.inputs.items() if title not in tie.iteration and not re.fullmatch(r"[vb]\d+e?", title)}
        found[key] = Diagnosis(kind, surfaces, {**values, **entries}, message, index, tie.iteration)
    return list(found.values())


def _tie(surfaces: tuple[str, str]) -> tuple[str, tuple[str, ...], str]:
    first, second = surfaces
    return "tie", surfaces, f"{first} coincides with {second}; the derivative is the mean over the two orders"


def _border(surfaces: tuple[str, str]) -> tuple[str, tuple[str, ...], str]:
    return "parameter surface", surfaces[:1], f"the parameters lie on {surfaces[0]}; the derivative is that of one side"


def _slopes(wrt: Sequence[Param | ArrayName], results: Sequence[Numbers]) -> Iterator[tuple[str, Numbers]]:
    """Derivatives of every leaf by every parameter, with what they are by."""
    leaves = len(results) // (1 + len(wrt))
    for j, slopes in enumerate(results[leaves:]):
        yield wrt[j % len(wrt)].name, slopes


def _entry(name: str, place: tuple[int, ...]) -> str:
    return f"{name}[{', '.join(map(str, place))}]" if place else name


def _where(wrong: Numbers) -> tuple[int, ...]:
    return tuple(int(n) for n in np.argwhere(wrong)[0])


def _of_results(
    wrt: Sequence[Param | ArrayName],
    program: ArrayProgram,
    results: Sequence[Numbers],
    values: dict[str, float],
    index: int,
) -> list[Diagnosis]:
    """Derivatives that are infinite, values and derivatives that are no numbers."""
    for name, slopes in _slopes(wrt, results):
        if np.isinf(slopes).any():
            where = _entry(name, _where(np.isinf(slopes[0])))
            message = f"the derivative by {where} is infinite here: a region is born or meets a pole"
            return [Diagnosis("infinite derivative", (), values, message, index)]
    if any(np.isnan(v).any() for v in results):
        by = [_entry(name, _where(np.isnan(slopes[0]))) for name, slopes in _slopes(wrt, results) if np.isnan(slopes).any()]
        reason = f"the derivative by {by[0]} is not a number here" if by else "the value is not a number here"
        return [Diagnosis("not a number", (), values, reason, index)]
    return []


def _one_sided(
    wrt: Sequence[Param | ArrayName],
    program: ArrayProgram,
    kernel: TieWatch,
    given: tuple[Sequence[Numbers], Sequence[Numbers]],
    here: Sequence[Numbers],
    place: tuple[dict[str, float], float, int],
) -> list[Diagnosis]:
    """Derivatives that change at once where all parameters move a few roundings, in random directions."""
    values, relative, index = place
    counts = {program.parameters[int(s.args[0])] for s in steps(program.body) if isinstance(s, Integers) and s.op == "param"}
    names = {p.name for p in wrt} - counts
    for seed in range(DIRECTIONS):
        random = np.random.default_rng(seed)

        def moved(name: str, v: Numbers, shape: tuple[int, ...], random: np.random.Generator = random) -> Numbers:
            v = v.reshape(shape)
            if name not in names:
                return v
            step = relative * np.where(v == 0.0, 1.0, np.abs(v)) * random.choice([-1.0, 1.0], shape)
            return np.stack([v - step, v + step])

        columns = [moved(name, c, ()) for name, c in zip(program.parameters, given[0], strict=True)]
        arrays = [moved(s.name, a, a.shape[a.ndim - s.dimensions :]) for s, a in zip(program.arrays, given[1], strict=True)]
        results = kernel.results(columns, arrays, 2).values
        flat = [(name, slopes, now[0]) for (name, slopes), (_, now) in zip(_slopes(wrt, results), _slopes(wrt, here), strict=True)]
        largest = max((float(np.abs(now).max(initial=0.0)) for *_, now in flat), default=0.0)
        for name, (before, after), now in flat:
            scale = np.maximum(np.maximum(np.abs(before), np.abs(after)), largest * 1e-3 + NOTHING)
            change = np.maximum(np.abs(after - before), np.abs(now - 0.5 * (before + after))) / scale
            change = np.where(np.isfinite(change), change, 0.0)
            if change.size and change.max() > CHANGE:
                at = tuple(int(n) for n in np.unravel_index(int(np.argmax(change)), change.shape))
                message = (
                    f"within {relative:.1e} of these values, relative to each, the derivative by {_entry(name, at)} goes from "
                    f"{before[at]:.6g} to {after[at]:.6g}, and is given as {now[at]:.6g}"
                )
                return [Diagnosis("one-sided", (), values, message, index)]
    return []
