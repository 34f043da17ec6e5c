"""Derivatives that lack the cut of an angle, or a curve that has become a line: NaN where that is met.

    [θ(x)² + sin x·θ(x) > t]       with θ = atan2(v, u), which jumps where v = 0 and u < 0

A condition on an angle beside affine terms is half-planes (`teg.passes.normalise.cuts`), so its cut is a surface. In any other condition
the cut is none, and its own boundary term is missing. Values are right, since cuts are breaks of integrals; so are first derivatives
where no parameter moves the cut, since roots on it have no mass. Others by the condition's parameters, and all second ones, as its
surface may end on the cut, are not known if bounds of v and u over the box, taken at run time, allow the cut.

A surface c²·u - v² = 0, as that of c·√u + v = 0 (`teg.passes.normalise.radicals`), is the line v = 0, taken twice, where c is 0. Its two
arcs may have different conditions, and boundary terms of both are 0/0 there. Linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.evaluate import values_of
from teg.analysis.implied import factors_beside_squares
from teg.analysis.intervals import Enclosure, Interval
from teg.errors import NotDifferentiableError, OperandError
from teg.ir.expr import MINUS_ONE, TRUE, Call, Compare, Cond, Expr, Param, Tuple, Var, Where, const
from teg.ir.integral import Delta, Integral
from teg.ir.node import Node, postorder, postorder_to
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, tuple_of, where
from teg.ir.traverse import parameters
from teg.passes.normalise.cuts import cut_angles

NO_NUMBER = const(float("nan"))
TRIALS, SAME = 64, 1e-9
"""Points at which both sides of a cut are compared, and how much they may differ."""


class _Missed(NamedTuple):
    """The parameters of a condition or a δ with a cut, whether first derivatives by them lack it, and where it is met."""

    parameters: frozenset[Param]
    moves: bool
    met: Cond


class MissedCuts:
    """The cuts of angles in conditions of a normal form that are no surfaces, and surfaces that may become lines."""

    def __init__(self, normal: Expr) -> None:
        self._met: list[_Missed] = []
        if cut_angles(normal):
            self._collect(normal)
        for g in dict.fromkeys(n.g for n in postorder_to([normal], Compare.bit | Delta.bit) if isinstance(n, Compare | Delta)):
            for c in factors_beside_squares(g):
                self._met.append(_Missed(frozenset(parameters(g)), True, negation(positive(c))))

    def guarded(self, slopes: Expr, wrt: Sequence[Param | Var], again: bool = False) -> Expr:
        """Returns the derivatives by some parameters, in their order, with NaN for those that lack a cut; for a tuple of tuples, each.
        `again`: derivatives of derivatives."""
        if not self._met or not isinstance(slopes, Tuple):
            return slopes
        if slopes.children and isinstance(slopes.children[0], Tuple):
            return tuple_of(*(self.guarded(s, wrt, again) for s in slopes.children))
        return tuple_of(*(self.checked(s, (p,), again) for s, p in zip(slopes.children, wrt, strict=True)))

    def checked(self, slope: Expr, wrt: Sequence[Param | Var], again: bool = False) -> Expr:
        """Returns a derivative along some parameters, NaN if it lacks a cut."""
        missed = [m for m in self._met if (again or m.moves) and m.parameters & set(wrt)]
        symbols = sorted({p for m in missed for p in m.parameters}, key=lambda p: p.name)
        unknown = mul(NO_NUMBER, add(*symbols))  # its own derivatives are NaN, too
        return where(disjunction(*(m.met for m in missed)), unknown, slope)

    def _collect(self, root: Expr) -> None:
        """Adds the conditions under which cuts are met. A variable that several integrals bind has the bounds of each in turn."""
        seen: set[tuple[Node, tuple[Integral, ...]]] = set()
        stack: list[tuple[Node, tuple[Integral, ...]]] = [(root, ())]
        while stack:
            node, around = stack.pop()
            if (node, around) in seen:
                continue
            seen.add((node, around))
            if isinstance(node, Compare | Delta) and (angles := _missed(node.g)):
                met = disjunction(*(_met(*cast("tuple[Expr, Expr]", a.children), around) for a in angles))
                moves = isinstance(node, Delta) or bool(parameters(*(a.children[0] for a in angles)))
                self._met.append(_Missed(frozenset(parameters(node.g)), moves, met))
            inside = (*around, node) if isinstance(node, Integral) else around
            stack.extend((c, inside if isinstance(node, Integral) and c is node.body else around) for c in node.children)


def _missed(g: Expr) -> list[Call]:
    """Returns the angles in a condition whose cut counts: not that of θ² < t or r < cos 5θ, which is none, nor one inside of an integral,
    which is smooth in what is outside."""
    return [a for a in cut_angles(g) if a.free <= g.free and any(_differs(part, a) for part in _parts(g, a))]


def _parts(g: Expr, angle: Call) -> list[Expr]:
    """Returns g, and of choices in it that an angle takes part in what both branches and their conditions are: random points may all
    choose one branch."""
    parts = [g]
    for node in postorder([g]):
        if isinstance(node, Where):
            inside = (node.then, node.otherwise, *(c.g for c in postorder([node.condition]) if isinstance(c, Compare)))
            parts += [e for e in inside if angle in postorder([e])]
    return parts


def _differs(e: Expr, angle: Call) -> bool:
    """Returns whether an expression has other values at an angle of π than at -π: asked at random points of all sizes, positive ones
    among them, where it is a number. Linear."""
    import numpy as np  # imported here, so that `import teg` stays fast

    random = np.random.default_rng(TRIALS)
    size = 10.0 ** random.uniform(-1.0, 1.0, TRIALS)
    points = {}
    for symbol in (*e.free, *parameters(e)):
        near = random.uniform(-1.0, 1.0, TRIALS)
        points[symbol] = size * np.where(np.arange(TRIALS) % 2 == 0, near, np.abs(near))
    try:
        (one,), (other,) = (values_of([e], {**points, angle: sign * math.pi}) for sign in (1.0, -1.0))
    except OperandError:
        return True
    known = np.isfinite(one) & np.isfinite(other)
    return not known.any() or not np.allclose(np.where(known, one, 0.0), np.where(known, other, 0.0), rtol=SAME, atol=SAME)


def _met(v: Expr, u: Expr, around: Sequence[Integral]) -> Cond:
    """Returns the condition that v may be 0, and u negative, in the ranges of the integrals around, outermost first."""
    box: dict[Var, Interval] = {}
    touches = bool(parameters(v))  # a cut that stays on a side of the box has no derivative
    try:
        for node in around:
            boxed = Enclosure(box)
            (low, least), (high, most) = boxed.of(node.lo), boxed.of(node.hi)
            box[node.var] = call("min", low, high), call("max", least, most)
        boxed = Enclosure(box)
        (below, above), (left, _) = boxed.of(v), boxed.of(u)
    except NotDifferentiableError:
        return TRUE
    return conjunction(positive(above, not touches), positive(mul(MINUS_ONE, below), not touches), positive(mul(MINUS_ONE, left)))
