"""How a program without loops is looked at: its derivatives, their ties, and its conditions on parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from teg.analysis.evaluate import values_of
from teg.analysis.settings import Integration
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import TRUE, Call, Expr, Param, const
from teg.ir.index import ArrayName
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.simplify import bracket, positive
from teg.ir.traverse import parameters, replace_node
from teg.passes.lower.integrals import About
from teg.pipeline import flatten, normal_form, program_for
from teg.program import Isolate, statements
from teg.report.diagnose import BORDER, CHANGE, NOTHING, STEP, STEP_OVER_TIES, Diagnosis, Element, Look
from teg.report.parameter_steps import only_in_steps, steps_of_parameters, vanishing

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from teg.backends.numpy.kernel import NumpyKernel

    Numbers = npt.NDArray[np.float64]


EVERYWHERE = "all of an integral"
"""In the place of a second surface: the first one is everything at these parameters."""
MOST_EVALUATIONS = 2**24
"""The largest number of evaluations of a gradient that is looked into: a diagnosis takes a dozen of them."""
NOT_LOOKED_AT = (
    "ties and one-sided derivatives were not looked for: the gradient takes more than {} evaluations here, as it does where surfaces touch "
    "all along a curve"
)
LONGER = 16
"""The factor of a longer step. It tells a kink, whose change stays the same, from a slope, whose change grows with the step."""
MOVES = 6
"""The largest number of one-sided derivatives in one message."""


class NumberWatch:
    """The program of derivatives, and of the conditions on parameters. Values may take far more evaluations: they are known from the call,
    and their changes are looked at only where a condition on parameters is at its border.

    `outputs` are the values and the first derivatives, called `names`.
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

        leaves = flatten(outputs[1])
        self.expression, self.names, self.parameters = e, names, parameters
        self._value = flatten(outputs[0])
        self._outputs, self._how = [leaf for output in outputs for leaf in flatten(output)], how
        self.wrt = {p.name for p in wrt}
        self.program = program_for([*leaves, *_probes(e)], parameters, how, about=About(differentiated=flatten(outputs[0])))
        self.kernel = compile_numpy(self.program, most=MOST_EVALUATIONS)
        self.results = len(leaves)
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
        results, differ = results[: self.results], False
        here = results[:, 0]
        if met:
            one, other = (self.kernel.in_order(at.columns, 1, order)[: self.results, 0] for order in (1, -1))
            differ = not np.isclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True).all()
        pairs = [self.program.ties[k].surfaces for k in met]
        pairs = _once([pair for pair in pairs if pair[1] in (BORDER, EVERYWHERE) or differ])
        ties: list[Diagnosis] = []
        if (
            at.second and at.second.finite and at.second.message and not differ
        ):  # surfaces that meet on the boundary: their formulas are the compiler's
            ties = [Diagnosis("second derivative", (), at.values, at.second.message, at.number)]
        if pairs:
            finite = all(np.isfinite(v) for v in at.values.values()) and np.isfinite(here).all()
            moves = []
            if finite and any(pair[1] in (BORDER, EVERYWHERE) for pair in pairs):
                whole = compile_numpy(
                    program_for(self._outputs, self.parameters, self._how, about=About(differentiated=self._value)), most=MOST_EVALUATIONS
                )
                moves = self._moves(whole, at, np.concatenate([at.computed, here]), STEP_OVER_TIES)
            elif finite:
                moves = self._moves(self.kernel, at, here, STEP_OVER_TIES)
            words = _steps_in_numbers(self.expression, at.values)
            pairs = [pair for pair in pairs if moves or pair[1] != EVERYWHERE]
            ties += [_of_pair((words.get(first, first), words.get(second, second)), moves, at) for first, second in pairs]
        return Look(results, ties, STEP_OVER_TIES if met or self.searched else STEP)

    def of_results(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns diagnoses of infinite derivatives, and of values and derivatives that are NaN."""
        import numpy as np

        first = np.concatenate([at.computed, look.results[:, 0]])
        kind, message = "", ""
        if np.isinf(first).any():
            kind, message = "infinite derivative", "a derivative is infinite here: a region is born or meets a pole"
        elif np.isnan(first).any():
            kind, message = "not a number", f"{self.names[int(np.argmax(np.isnan(first)))]} is not a number here"
        elif at.second and not at.second.finite and not look.ties:
            kind, message = "second derivative", at.second.message
        return [Diagnosis(kind, (), at.values, message, at.number)] if kind else []

    def one_sided(self, look: Look, at: Element) -> list[Diagnosis]:
        """Returns a diagnosis of the largest change along each parameter."""
        first = {m.parameter: m for m in reversed(self._moves(self.kernel, at, look.results[:, 0], look.step))}
        found = []
        for move in reversed(first.values()):
            place = f"within {move.step:.1e} of {move.parameter} = {at.values[move.parameter]:.6g}"
            message = f"{place}, {move.result} goes from {move.below:.6g} to {move.above:.6g}, and is given as {move.here:.6g}"
            found.append(Diagnosis("one-sided", (), at.values, message, at.number))
        return found

    def _moves(self, kernel: NumpyKernel, at: Element, here: Numbers, relative: float) -> list[_Move]:
        """Returns the first results of a kernel that jump along a parameter, the largest jump of each parameter first; `here` are their
        values at the element.

        A change in proportion to the step is smooth: a step LONGER times as long shows it. Infinite results beside a finite one are a jump.
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
            with np.errstate(all="ignore"):  # results may be infinite beside a finite one
                scale = np.maximum(np.maximum(np.abs(below), np.abs(above)), np.abs(here).max() * 1e-3 + NOTHING)
                change = np.maximum(np.abs(above - below), np.abs(here - 0.5 * (below + above)))
                longer = np.maximum(np.abs(beyond - farther), np.abs(here - 0.5 * (farther + beyond)))
                at_once = np.where(np.isfinite(change), change / scale, 0.0) > CHANGE
                at_once &= ~(longer > 0.5 * LONGER * change)
                endless = np.isfinite(here) & (np.isinf(below) | np.isinf(above))
                order = np.argsort(np.where(endless, -np.inf, -np.nan_to_num(change / scale)))
            for j in order:
                if at_once[j] or endless[j]:
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
    if second in (BORDER, EVERYWHERE):
        message = f"the parameters lie on {first}"
        return Diagnosis("parameter surface", (first,), at.values, f"{message}: {sides}" if sides else message, at.number)
    message = f"{first} coincides with {second}; "
    return Diagnosis("tie", pair, at.values, message + (sides or "the derivative is the mean over the two orders"), at.number)


def _probes(e: Expr) -> list[Expr]:
    """Returns expressions that meet a tie on the border of a condition on parameters, on the steps of a floor of parameters, and where a
    surface is everything.

    A condition on such floors alone, [floor(a) > 0], is on its border on whole intervals: it changes at their steps only.
    """
    found: dict[str, Expr] = {}
    for atom in atoms_of(normal_form(e)):
        title = f"{show(atom.g, 300)} = 0"
        if not atom.g.free and atom.resolution is None and not only_in_steps(atom.g):
            found.setdefault(title, bracket(positive(atom.g, atom.strict, TRUE, (title, BORDER))))
        elif atom.g.free and atom.resolution is None and (size := vanishing(atom.g)) is not None:
            found.setdefault(title, bracket(positive(size, True, TRUE, (title, EVERYWHERE))))
    for title, g in steps_of_parameters(e):
        found.setdefault(title, bracket(positive(g, True, TRUE, (title, BORDER))))
    return list(found.values())


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


def _once(pairs: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Returns each pair of surfaces in one of its orders."""
    return list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1]
