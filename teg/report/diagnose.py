"""Where an expression is not differentiable, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from teg.analysis.evaluate import values_of
from teg.analysis.settings import Integration
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import TRUE, Call, Expr, Param, bracket, call, const, positive
from teg.ir.node import Node, postorder
from teg.ir.show import show
from teg.ir.traverse import parameters, replace_node
from teg.pipeline import flatten, normal_form, program_for
from teg.program import Isolate, Program, statements

BORDER = "a condition on parameters only"
STEP = 2.0**-50
STEP_OVER_TIES = 2.0**-42
NOTHING = 1e-18
"""Derivatives below that are rounding."""
CHANGE = 1e-3
"""A relative change of the gradient over two relative steps that no smooth function of ordinary curvature makes."""

STEPS = ("floor", "ceil", "round", "mod")
LONGER = 16
"""A step so many times as long tells a kink, whose change stays what it is, from a slope, which changes as much more."""
MOVES = 6
"""One-sided derivatives that one message tells."""

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Diagnosis:
    """One reason why the derivative at a point is not the usual one.

    kind: "tie" (two surfaces, or a surface and a bound, coincide: the gradient given is the mean over the two orders; the
    message tells it beside the one-sided ones), "parameter
    surface" (a condition on parameters only is at its border), "one-sided" (the gradient a few roundings away is another one: a region
    is born, two curves cross at a saddle), "infinite derivative", "second derivative", "not a number". `index` is the place in the
    batch, flattened; `iteration` gives the indices of the sums around, in a program with arrays, outermost first, and `parameters` then
    holds the entries that the surfaces are made of, too.
    """

    kind: str
    surfaces: tuple[str, ...]
    parameters: dict[str, float]
    message: str
    index: int = 0
    iteration: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}"


class _Evaluator(Protocol):
    expression: Expr
    wrt: tuple[Param, ...]
    parameters: tuple[str, ...]
    _options: Any
    _kernels: dict[int, Any]
    _room: dict[tuple[str, int], Integration]
    _watched: dict[tuple[int, Any], Any]

    def output_names(self, derivatives: int = 0) -> list[str]: ...

    def outputs(self, orders: int) -> list[Expr]: ...


@dataclass(frozen=True)
class _Watched:
    """The program of a diagnosis: values and derivatives, and the conditions on parameters. It watches for ties."""

    kernel: Any
    program: Program
    results: int
    first_order: int
    searched: bool
    """Whether roots are searched for: those that meet to rounding are a tangency."""


def diagnose(f: _Evaluator, columns: Sequence[np.ndarray], n: int) -> list[Diagnosis]:
    """One Diagnosis a reason and batch element; runs the gradient (and the Hessian, if the evaluator was asked for one), the conditions on
    parameters, watches for ties, and looks at the gradient a few roundings to either side. The program is compiled once an evaluator."""
    import numpy as np

    watched = _watched(f)
    found: list[Diagnosis] = []
    for i in range(n):
        element = [c if c.ndim == 0 else c[i : i + 1] for c in columns]
        values = {k: float(c if c.ndim == 0 else c[0]) for k, c in zip(f.parameters, element, strict=True)}
        results, met = watched.kernel.values_and_ties(element, 1)
        results, differ = results[: watched.results], False
        here, finite = results[: watched.first_order, 0], all(np.isfinite(v) for v in values.values())
        if met:  # surfaces that merely cross are no tie
            one, other = (watched.kernel.in_order(element, 1, order)[: watched.results] for order in (1, -1))
            differ = not np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)
        pairs = [watched.program.ties[k].surfaces for k in met]
        pairs = _once([pair for pair in pairs if pair[1] == BORDER or differ])
        if pairs:
            moves = _moves(f, watched, element, values, here, STEP_OVER_TIES) if finite and np.isfinite(here).all() else []
            words = _steps_in_numbers(f.expression, values)
            found += [_of_pair((words.get(first, first), words.get(second, second)), moves, values, i) for first, second in pairs]
        if finite:
            found += _of_results(f, watched, results, values, i)
            if np.isfinite(results).all() and not any(d.index == i for d in found):
                found += _one_sided(
                    _moves(f, watched, element, values, here, STEP_OVER_TIES if met or watched.searched else STEP), values, i
                )
    return found


def _watched(f: _Evaluator) -> _Watched:
    from teg.backends.numpy.kernel import compile_numpy

    orders = 2 if 2 in f._kernels else 1
    how = f._room.get(("value", orders), f._options.integration)
    key = orders, how
    if key not in f._watched:
        outputs = [leaf for e in f.outputs(orders) for leaf in flatten(e)]
        program = program_for([*outputs, *_probes(f.expression)], f.parameters, how)
        first_order = sum(len(flatten(e)) for e in f.outputs(1))
        searched = any(isinstance(s, Isolate) for s in statements(program.body))
        f._watched[key] = _Watched(compile_numpy(program), program, len(outputs), first_order, searched)
    return f._watched[key]  # type: ignore[no-any-return]


def _probes(e: Expr) -> list[Expr]:
    """Expressions that meet a tie on the border of a condition on parameters, and on the steps of a floor of parameters.

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
    """Floors and their kin of parameters alone, as users write them: a text for their steps, and a function that is 0 there."""
    found: list[tuple[str, Expr]] = []
    for node in postorder([e]):
        if isinstance(node, Call) and node.name in STEPS and not node.free and parameters_in(node):
            u = node.children[0] if node.name != "mod" else node.children[0] / node.children[1]
            if node.name == "round":
                u = u + 0.5
            if only_in_steps(u):  # it changes where the steps inside do
                continue
            found.append((f"a step of {show(node, 300)}", u - call("floor", u + 0.5)))
    return found


def _steps_in_numbers(e: Expr, values: dict[str, float]) -> dict[str, str]:
    """For the texts of surfaces that are steps of floors of variables: others, in which the number of the step is a number.

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
    """Whether parameters occur in g inside of floors and their kin only, so that it is constant between their steps; mod is none."""
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
    """Each pair of surfaces in one of its orders."""
    return list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1]


def _of_results(f: _Evaluator, watched: _Watched, results: np.ndarray, values: dict[str, float], index: int) -> list[Diagnosis]:
    """Derivatives that are infinite, values and derivatives that are not numbers."""
    import numpy as np

    first, second = results[: watched.first_order], results[watched.first_order :]
    if np.isinf(first).any():
        return [Diagnosis("infinite derivative", (), values, "a derivative is infinite here: a region is born or meets a pole", index)]
    if np.isnan(first).any():
        name = f.output_names(1)[int(np.argmax(np.isnan(first[:, 0])))]
        reason = f"{name} is not a number here"
        return [Diagnosis("not a number", (), values, reason, index)]
    if not np.isfinite(second).all():
        return [Diagnosis("second derivative", (), values, "a second derivative is infinite, or not a number, here", index)]
    return []


@dataclass(frozen=True)
class _Move:
    """What becomes of one result where one parameter moves a few roundings: below, above, and here."""

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


def _moves(
    f: _Evaluator, watched: _Watched, element: Sequence[np.ndarray], values: dict[str, float], here: np.ndarray, relative: float
) -> list[_Move]:
    """The results that change at once along a parameter, the largest change of each parameter first.

    What changes in proportion to the step is smooth: a step LONGER times as long shows it.
    """
    import numpy as np

    wrt = {p.name for p in f.wrt}
    names = f.output_names(1)
    found = []
    for k, name in enumerate(f.parameters):
        if name not in wrt:
            continue
        step = relative * (abs(values[name]) or 1.0)
        columns = [np.repeat(np.reshape(c, 1), 4) for c in element]
        columns[k] = columns[k] + step * np.array([-1.0, 1.0, -LONGER, LONGER])
        below, above, farther, beyond = watched.kernel(columns, 4)[: len(here)].T
        scale = np.maximum(np.maximum(np.abs(below), np.abs(above)), np.abs(here).max() * 1e-3 + NOTHING)
        change = np.maximum(np.abs(above - below), np.abs(here - 0.5 * (below + above)))
        longer = np.maximum(np.abs(beyond - farther), np.abs(here - 0.5 * (farther + beyond)))
        at_once = np.where(np.isfinite(change), change / scale, 0.0) > CHANGE
        at_once &= ~(longer > 0.5 * LONGER * change)
        for j in np.argsort(-np.nan_to_num(change / scale)):
            if at_once[j]:
                found.append(_Move(names[j], name, float(step), float(below[j]), float(above[j]), float(here[j])))
    return found


def _of_pair(pair: tuple[str, str], moves: Sequence[_Move], values: dict[str, float], index: int) -> Diagnosis:
    """Two surfaces that coincide, or parameters on the border of a condition; and which of the one-sided derivatives is given."""
    first, second = pair
    own = [m for m in moves if m.result.endswith(f"/ d {m.parameter}") or not m.result.startswith("d ")][:MOVES]
    sides = "; ".join(m.text for m in own)
    if second == BORDER:
        message = f"the parameters lie on {first}"
        return Diagnosis("parameter surface", (first,), values, f"{message}: {sides}" if sides else message, index)
    message = f"{first} coincides with {second}; "
    return Diagnosis("tie", pair, values, message + (sides or "the derivative is the mean over the two orders"), index)


def _one_sided(moves: Sequence[_Move], values: dict[str, float], index: int) -> list[Diagnosis]:
    """The largest change along each parameter."""
    first = {m.parameter: m for m in reversed(moves)}
    found = []
    for move in reversed(first.values()):
        message = (
            f"within {move.step:.1e} of {move.parameter} = {values[move.parameter]:.6g}, {move.result} goes from {move.below:.6g} to "
            f"{move.above:.6g}, and is given as {move.here:.6g}"
        )
        found.append(Diagnosis("one-sided", (), values, message, index))
    return found
