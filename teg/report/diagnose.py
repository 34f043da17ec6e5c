"""Where a program is not differentiable, and why; in a program with arrays, in which iteration of which sums.

Diagnosis one a reason, iteration and element of a batch
NumberWatch, LoopWatch          how a program without loops, and one with, is looked at
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from teg.analysis.evaluate import values_of
from teg.analysis.settings import Integration
from teg.analysis.surfaces import atoms_of
from teg.ir.arrays import Gather, Ranged, Sum, sum_over
from teg.ir.cells import Symbols
from teg.ir.expr import TRUE, ZERO, Call, Expr, Param, add, bracket, call, const, positive
from teg.ir.index import ArrayName
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.traverse import parameters, replace_node
from teg.pipeline import flatten, normal_form, program_for
from teg.program import Isolate, statements
from teg.program.arrays import ArrayProgram, Integers, Run, steps

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from teg.backends.numpy.kernel import NumpyKernel
    from teg.backends.numpy.ties import MetTie

    Numbers = npt.NDArray[np.float64]

BORDER = "a condition on parameters only"
CREASE = "a surface meets a corner or another surface: second derivatives differ from side to side, and their mean is given"
STEP = 2.0**-50
STEP_OVER_TIES = 2.0**-42
MOST_EVALUATIONS = 2**24
"""The largest number of evaluations of a gradient that is looked into: a diagnosis takes a dozen of them."""
NOT_LOOKED_AT = (
    "ties and one-sided derivatives were not looked for: the gradient takes more than {} evaluations here, as it does where surfaces touch "
    "all along a curve"
)
NOTHING = 1e-18
"""Smaller derivatives are rounding errors."""
CHANGE = 1e-3
"""A relative change of the gradient over two relative steps that exceeds that of smooth functions of ordinary curvature."""

STEPS = ("floor", "ceil", "round", "mod")
LONGER = 16
"""The factor of a longer step. It tells a kink, whose change stays the same, from a slope, whose change grows with the step."""
MOVES = 6
"""The largest number of one-sided derivatives in one message."""
DIRECTIONS = 2
"""The number of directions along which the gradient of a program with arrays is compared; all entries of all parameters move at once."""
MOST_NAMED = 8
"""The largest number of parameters that a diagnosis names when it is printed."""
MOST = 100
"""The largest number of diagnoses of one kind in one element of a batch."""


@dataclass(frozen=True)
class Diagnosis:
    """One reason why the derivative at a point is not the usual one.

        f.diagnose(t=1.0, a=0.0)[0].surfaces      # ('t - (x + a·y) = 0', 'the bound y = 1 or the bound x = 1')

    kind: "tie" (two surfaces, or a surface and a bound, coincide: the gradient given is the mean over the two orders, and the message
    tells it beside the one-sided ones), "parameter surface" (a condition on parameters only is at its border), "one-sided" (the gradient a
    few roundings away is another one: a region is born, two curves cross at a saddle), "infinite derivative", "second derivative", "not a
    number", "not looked at" (the gradient takes too many evaluations). `index` is the place in the batch, flattened. In a program with
    arrays `iteration` gives the indices of the sums around, outermost first, and `parameters` holds the entries that the surfaces are
    made of, too. `str()` is a sentence.
    """

    kind: str
    surfaces: tuple[str, ...]
    parameters: dict[str, float]
    message: str
    index: int = 0
    iteration: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        place = ", ".join(f"{name} = {value:.6g}" for name, value in [*self.parameters.items()][:MOST_NAMED])
        place += ", …" if len(self.parameters) > MOST_NAMED else ""
        element = f"in element {self.index} of the batch, " if self.index else ""
        start = f"{element}at {place}, " if place else element
        text = f"{start}{self.message}"
        return f"{text[:1].upper()}{text[1:]}." if start else f"{text}."

    def __repr__(self) -> str:
        return f"<teg.Diagnosis {self.kind}: {self}>"


class Arguments(Protocol):
    """The arguments of a call (`teg.evaluator.arguments.Call`)."""

    @property
    def n(self) -> int: ...
    @property
    def names(self) -> Sequence[str]: ...
    @property
    def doubles(self) -> Sequence[Numbers]: ...
    @property
    def arrays(self) -> Sequence[Numbers]: ...
    @property
    def shapes(self) -> Sequence[tuple[int, ...]]: ...


class Element(NamedTuple):
    """One element of a batch, its place in it, the values of its numbers, and the program's own values there."""

    columns: list[Numbers]
    arrays: list[Numbers]
    number: int
    values: dict[str, float]
    computed: Numbers


class Look(NamedTuple):
    """The results at an element, the diagnoses of ties that were met, and the distance to go to either side."""

    results: Any
    ties: list[Diagnosis]
    step: float


class Watch(Protocol):
    """A program of values and derivatives that watches for ties, and for the borders of conditions on parameters."""

    def look(self, at: Element) -> Look: ...
    def of_results(self, look: Look, at: Element) -> list[Diagnosis]: ...
    def one_sided(self, look: Look, at: Element) -> list[Diagnosis]: ...


def diagnose(watch: Watch, given: Arguments, computed: Numbers) -> list[Diagnosis]:
    """Returns one Diagnosis for each reason, iteration and element: ties, and results that are infinite or NaN; `computed` are the values
    that the call gave, (entries, n).

    If there are none of these: gradients that change within a few roundings.
    """
    import numpy as np

    found: list[Diagnosis] = []
    for i in range(given.n):
        columns = [c if c.ndim == 0 else c[i : i + 1] for c in given.doubles]
        arrays = [a if a.ndim == len(own) else a[i : i + 1] for a, own in zip(given.arrays, given.shapes, strict=True)]
        numbers = {k: float(np.ravel(c)[0]) for k, c in zip(given.names, columns, strict=True)}
        at = Element(columns, arrays, i, numbers, computed[:, i])
        look = watch.look(at)
        mine = [*look.ties]
        if all(np.isfinite(v).all() for v in (*columns, *arrays)):
            mine += watch.of_results(look, at)
            if not mine:
                mine += watch.one_sided(look, at)
        found += mine
    return found


# -- programs without loops ----------------------------------------------------------------------------------------------


class NumberWatch:
    """The program of derivatives, and of the conditions on parameters. Values may take far more evaluations: they are known from the call,
    and their changes are looked at only where a condition on parameters is at its border.

    `outputs` begin with the values and the first derivatives, called `names`; the first `first_order` results are those derivatives.
    Derivatives are taken by `wrt`; `parameters` are the arguments.
    """

    def __init__(
        self,
        e: Expr,
        outputs: Sequence[Expr],
        names: Sequence[str],
        wrt: Sequence[Param | ArrayName],
        parameters: Sequence[str],
        how: Integration,
    ) -> None:
        from teg.backends.numpy.kernel import compile_numpy

        leaves = [leaf for output in outputs[1:] for leaf in flatten(output)]
        self.expression, self.names, self.parameters = e, names, parameters
        self._outputs, self._how = [leaf for output in outputs[:2] for leaf in flatten(output)], how
        self.wrt = {p.name for p in wrt}
        self.program = program_for([*leaves, *_probes(e)], parameters, how)
        self.kernel = compile_numpy(self.program, most=MOST_EVALUATIONS)
        self.results, self.first_order = len(leaves), len(names) - len(flatten(e))
        self.searched = any(isinstance(s, Isolate) for s in statements(self.program.body))  # roots that meet to rounding are a tangency

    def look(self, at: Element) -> Look:
        """Returns the results and ties. For coinciding surfaces the derivative is given beside the one-sided ones; surfaces that merely
        cross do not tie."""
        import numpy as np

        from teg.backends.numpy.kernel import compile_numpy

        results, met, ended = self.kernel.values_and_ties(at.columns, 1)
        if ended:
            message = NOT_LOOKED_AT.format(MOST_EVALUATIONS)
            return Look(results[: self.results], [Diagnosis("not looked at", (), at.values, message, at.number)], STEP)
        results, differ = results[: self.results], np.zeros(self.results, dtype=bool)
        here = results[: self.first_order, 0]
        if met:
            one, other = (self.kernel.in_order(at.columns, 1, order)[: self.results, 0] for order in (1, -1))
            differ = ~np.isclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)
        pairs = [self.program.ties[k].surfaces for k in met]
        pairs = _once([pair for pair in pairs if pair[1] == BORDER or differ[: self.first_order].any()])
        ties: list[Diagnosis] = []
        if differ.any() and not differ[: self.first_order].any():  # surfaces that meet on the boundary: their formulas are the compiler's
            ties = [Diagnosis("second derivative", (), at.values, CREASE, at.number)]
        if pairs:
            finite = all(np.isfinite(v) for v in at.values.values()) and np.isfinite(here).all()
            moves = []
            if finite and any(pair[1] == BORDER for pair in pairs):
                whole = compile_numpy(program_for(self._outputs, self.parameters, self._how), most=MOST_EVALUATIONS)
                moves = self._moves(whole, at, np.concatenate([at.computed, here]), STEP_OVER_TIES)
            elif finite:
                moves = self._moves(self.kernel, at, here, STEP_OVER_TIES)
            words = _steps_in_numbers(self.expression, at.values)
            ties += [_of_pair((words.get(first, first), words.get(second, second)), moves, at) for first, second in pairs]
        return Look(results, ties, STEP_OVER_TIES if met or self.searched else STEP)

    def of_results(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns diagnoses of infinite derivatives, and of values and derivatives that are NaN."""
        import numpy as np

        first, second = np.concatenate([at.computed, look.results[: self.first_order, 0]]), look.results[self.first_order :]
        kind, message = "", ""
        if np.isinf(first).any():
            kind, message = "infinite derivative", "a derivative is infinite here: a region is born or meets a pole"
        elif np.isnan(first).any():
            kind, message = "not a number", f"{self.names[int(np.argmax(np.isnan(first)))]} is not a number here"
        elif not np.isfinite(second).all():
            kind, message = "second derivative", "a second derivative is infinite, or not a number, here"
        return [Diagnosis(kind, (), at.values, message, at.number)] if kind else []

    def one_sided(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns a diagnosis of the largest change along each parameter."""
        first = {m.parameter: m for m in reversed(self._moves(self.kernel, at, look.results[: self.first_order, 0], look.step))}
        found = []
        for move in reversed(first.values()):
            place = f"within {move.step:.1e} of {move.parameter} = {at.values[move.parameter]:.6g}"
            message = f"{place}, {move.result} goes from {move.below:.6g} to {move.above:.6g}, and is given as {move.here:.6g}"
            found.append(Diagnosis("one-sided", (), at.values, message, at.number))
        return found

    def _moves(self, kernel: NumpyKernel, at: Element, here: Numbers, relative: float) -> list[_Move]:
        """Returns the first results of a kernel that jump along a parameter, the largest jump of each parameter first; `here` are their
        values at the element.

        A change in proportion to the step is smooth: a step LONGER times as long shows it.
        """
        import numpy as np

        found = []
        for k, name in enumerate(self.parameters):
            if name not in self.wrt:
                continue
            step = relative * (abs(at.values[name]) or 1.0)
            columns = [np.repeat(np.reshape(c, 1), 4) for c in at.columns]
            columns[k] = columns[k] + step * np.array([-1.0, 1.0, -LONGER, LONGER])
            below, above, farther, beyond = kernel(columns, 4)[: len(here)].T
            scale = np.maximum(np.maximum(np.abs(below), np.abs(above)), np.abs(here).max() * 1e-3 + NOTHING)
            change = np.maximum(np.abs(above - below), np.abs(here - 0.5 * (below + above)))
            longer = np.maximum(np.abs(beyond - farther), np.abs(here - 0.5 * (farther + beyond)))
            at_once = np.where(np.isfinite(change), change / scale, 0.0) > CHANGE
            at_once &= ~(longer > 0.5 * LONGER * change)
            for j in np.argsort(-np.nan_to_num(change / scale)):
                if at_once[j]:
                    found.append(
                        _Move(
                            self.names[len(self.names) - len(here) + j], name, float(step), float(below[j]), float(above[j]), float(here[j])
                        )
                    )
        return found


@dataclass(frozen=True)
class _Move:
    """The values of one result while one parameter moves a few roundings: below, above, and at the point."""

    result: str
    parameter: str
    step: float
    below: float
    above: float
    here: float

    @property
    def text(self) -> str:
        mean, size = 0.5 * (self.below + self.above), max(abs(self.below), abs(self.above))
        which = "neither of the two, nor their mean"
        for what, is_what in (("their mean", mean), ("the one below", self.below), ("the one above", self.above)):
            if abs(self.here - is_what) <= CHANGE * size:
                which = what
                break
        return f"{self.result} is {self.below:.6g} below {self.parameter} and {self.above:.6g} above, given as {self.here:.6g}, {which}"


def _of_pair(pair: tuple[str, str], moves: Sequence[_Move], at: Element) -> Diagnosis:
    """Returns the diagnosis of two coinciding surfaces, or of parameters on the border of a condition, and says which one-sided derivative
    is given."""
    first, second = pair
    own = [m for m in moves if m.result.endswith(f"/ d {m.parameter}") or not m.result.startswith("d ")][:MOVES]
    sides = "; ".join(m.text for m in own)
    if second == BORDER:
        message = f"the parameters lie on {first}"
        return Diagnosis("parameter surface", (first,), at.values, f"{message}: {sides}" if sides else message, at.number)
    message = f"{first} coincides with {second}; "
    return Diagnosis("tie", pair, at.values, message + (sides or "the derivative is the mean over the two orders"), at.number)


def _probes(e: Expr) -> list[Expr]:
    """Returns expressions that meet a tie on the border of a condition on parameters, and on the steps of a floor of parameters.

    A condition on such floors alone, [floor(a) > 0], is on its border on whole intervals: it changes at their steps only.
    """
    found: dict[str, Expr] = {}
    for atom in atoms_of(normal_form(e)):
        if not atom.g.free and atom.resolution is None and not only_in_steps(atom.g):
            title = f"{show(atom.g, 300)} = 0"
            found.setdefault(title, bracket(positive(atom.g, atom.strict, TRUE, (title, BORDER))))
    for title, g in steps_of_parameters(e):
        found.setdefault(title, bracket(positive(g, True, TRUE, (title, BORDER))))
    return list(found.values())


def steps_of_parameters(e: Expr) -> list[tuple[str, Expr]]:
    """Returns floors and their kin of parameters alone, as users write them: a text for their steps, and a function that is 0 there."""
    found: list[tuple[str, Expr]] = []
    for node in postorder([e]):
        if isinstance(node, Call) and node.name in STEPS and not node.free and parameters_in(node):
            u = node.children[0] if node.name != "mod" else node.children[0] / node.children[1]
            if node.name == "round":
                u = u + 0.5
            if only_in_steps(u):  # it changes where the inner steps do
                continue
            found.append((f"a step of {show(node, 300)}", u - call("floor", u + 0.5)))
    return found


def _steps_in_numbers(e: Expr, values: dict[str, float]) -> dict[str, str]:
    """Returns other texts for surfaces that are steps of floors of variables, with the number of the step as a number.

    The steps are counted from a floor that users did not write, the least one over the range.
    """
    own = {node for node in postorder([e]) if isinstance(node, Call) and node.name == "floor"}
    found: dict[str, str] = {}
    for atom in atoms_of(normal_form(e)):
        bases = [n for n in postorder([atom.g]) if isinstance(n, Call) and n.name == "floor" and not n.free and n not in own]
        if bases:
            numbers = values_of(bases, {p: values[p.name] for p in parameters(atom.g)})
            new: Node = atom.g
            for base, number in zip(bases, numbers, strict=True):
                new = replace_node(new, base, const(float(number)))
            found[f"{show(atom.g, 300)} = 0"] = f"{show(new, 300)} = 0"
    return found


def only_in_steps(g: Expr) -> bool:
    """Returns whether parameters occur in g only inside of floors and their kin, so that g is constant between their
    steps; mod is not one."""
    stack: list[Node] = [g]
    seen: set[Node] = set()
    while stack:
        node = stack.pop()
        if node in seen or (isinstance(node, Call) and node.name in ("floor", "ceil", "round")):
            continue
        seen.add(node)
        if isinstance(node, Param):
            return False
        stack.extend(node.children)
    return True


def parameters_in(e: Expr) -> bool:
    return any(isinstance(n, Param) for n in postorder([e]))


def _once(pairs: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Returns each pair of surfaces in one of its orders."""
    return list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1]


# -- programs with loops -------------------------------------------------------------------------------------------------


class LoopWatch:
    """A program of values and derivatives by `wrt`, and `probes_of` the normal form of the values.

    `second` returns, for each element, whether its second derivatives are finite, if they were asked for before.
    """

    def __init__(self, wrt: Sequence[Param | ArrayName], program: ArrayProgram, probes: ArrayProgram, second: Any = None) -> None:
        from teg.backends.numpy.ties import TieWatch

        self.wrt, self.program, self.second = wrt, program, second
        self.watch, self.borders = TieWatch(program), TieWatch(probes)
        flat = (s for step in steps(program.body) if isinstance(step, Run) for s in statements(step.program.body))
        self.searched = any(isinstance(s, Isolate) for s in flat)

    def look(self, at: Element) -> Look:
        """Returns the results, and the ties of every iteration."""
        results, met = self.watch.ties(at.columns, at.arrays, 1)
        _, on_border = self.borders.ties(at.columns, at.arrays, 1)
        ties = [*_ties(met, at, _tie), *_ties(on_border, at, _border)]
        return Look(results.values, ties, STEP_OVER_TIES if self.watch.noted or self.searched else STEP)

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
        if not look.ties and self.second is not None and not self.second[at.number]:
            message = "a second derivative is infinite, or not a number, here"
            return [Diagnosis("second derivative", (), at.values, message, at.number)]
        return []

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
                step = relative * np.where(v == 0.0, 1.0, np.abs(v)) * random.choice([-1.0, 1.0], shape)
                return np.stack([v - step, v + step])

            columns = [moved(name, c, ()) for name, c in zip(program.parameters, at.columns, strict=True)]
            arrays = [moved(s.name, a, a.shape[a.ndim - s.dimensions :]) for s, a in zip(program.arrays, at.arrays, strict=True)]
            results = self.watch.results(columns, arrays, 2).values
            flat = [
                (name, slopes, now[0])
                for (name, slopes), (_, now) in zip(_slopes(self.wrt, results), _slopes(self.wrt, look.results), strict=True)
            ]
            largest = max((float(np.abs(now).max(initial=0.0)) for *_, now in flat), default=0.0)
            for name, (before, after), now in flat:
                scale = np.maximum(np.maximum(np.abs(before), np.abs(after)), largest * 1e-3 + NOTHING)
                change = np.maximum(np.abs(after - before), np.abs(now - 0.5 * (before + after))) / scale
                change = np.where(np.isfinite(change), change, 0.0)
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
        key = tie.surfaces, tuple(tie.iteration.items())
        if key in found or len(found) >= MOST:
            continue
        kind, surfaces, message = said(tie.surfaces)
        if tie.iteration:
            message = f"in the iteration {', '.join(f'{k} = {n}' for k, n in tie.iteration.items())}: {message}"
        entries = {title: v for title, v in tie.inputs.items() if title not in tie.iteration and not re.fullmatch(r"[vb]\d+e?", title)}
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
