"""Curves g(x, y) = 0 that can be solved for either variable, where another curve crosses them: δ(g)·δ(h) becomes a δ of one variable.

Two charts, so that neither sees the curve turn back: x is eliminated where the curve is steeper in x, |g_x|·X >= |g_y|·Y with X, Y the
extents of the box, and y elsewhere. Each root of g is a branch of its chart:

    ∫∫ w δ(g) dx dy = ∫ dy Σᵢ [root i exists][|g_x|X >= |g_y|Y] w/|g_x| · ([xᵢ < h] - [xᵢ < l])  +  the same with x and y exchanged, and >

All brackets are evaluated on the curve. If w holds another δ nothing is integrated, and the border of the charts costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.roots import Root, solve, tidy
from teg.analysis.surfaces import restrict, signed_inside
from teg.errors import NotDifferentiableError
from teg.ir import expr as ex
from teg.ir.expr import ZERO, Cond, Expr, Var
from teg.ir.simplify import add, call, conjunction, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute


@dataclass(frozen=True)
class Curve:
    """g can be solved for each of `variables` (outermost first); other variables may occur in it too."""

    variables: tuple[Var, Var]

    name = "a curve in two charts"


def match_curve(g: Expr, variables: Sequence[Var]) -> Curve | None:
    """Returns the two innermost variables of a surface, if it can be solved for both; else None."""
    mine = [v for v in variables if v in g.free][:2]
    if len(mine) != 2:
        return None
    try:
        for v in mine:
            roots = solve(g, v, ZERO, ex.ONE)
            if roots is None or not roots.certain or slope(g, v) is ZERO:
                return None
    except NotDifferentiableError:
        return None
    return Curve((mine[1], mine[0]))


def rewrite_curve(g: Expr, coefficient: Expr, chain: Chain, data: Curve) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) by both charts. None if the range of one variable is not known."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    (outer, inner), others, boxes = parts
    total: list[Expr] = []
    for pivot, other in ((1, 0), (0, 1)):
        box = boxes[pivot]
        roots = solve(g, box.var, box.lo, box.hi)
        if roots is None or not roots.certain:
            return None
        branches = [_branch(g, coefficient, (outer, inner), boxes, pivot, root) for root in roots.found]
        total.append(nest(add(*branches), (boxes[other], *others)))
    return add(*total)


def _branch(g: Expr, coefficient: Expr, binders: tuple[Binder, Binder], boxes: Sequence[Binder], pivot: int, root: Root) -> Expr:
    """Returns one root of one chart, under the integral over the variable that stays."""
    b, stay = binders[pivot], boxes[1 - pivot]
    at = {b.var: root.point}
    rate, across = (_simplest(cast(Expr, substitute(slope(g, v), at))) for v in (b.var, stay.var))
    value = mul(restrict(coefficient, at, g, (binders[1].var, binders[0].var)), integer_power(call("magnitude", rate), -1))
    point: dict[Var, Expr] = {b.var: root.point, stay.var: stay.var}
    for c, limits in zip(binders, boxes, strict=True):
        if c is b or (limits.lo, limits.hi) != (c.lo, c.hi):
            lo, hi = (cast(Expr, substitute(e, at)) for e in (c.lo, c.hi))
            value = signed_inside(point[c.var], lo, hi, g, c, value)
    steep = _steeper(rate, boxes[pivot], across, stay, strict=pivot == 0)
    return where(conjunction(root.exists, steep), value, ZERO)


def _steeper(rate: Expr, box: Binder, across: Expr, stay: Binder, strict: bool) -> Cond:
    """Returns |rate|·extent >= |across|·extent, as squares, which have no kinks."""
    left = integer_power(mul(rate, sub(box.hi, box.lo)), 2)
    right = integer_power(mul(across, sub(stay.hi, stay.lo)), 2)
    return positive(_simplest(sub(left, right)), strict)


def _simplest(e: Expr) -> Expr:
    """Returns the normal form, repeated until nothing changes: squaring a square root can make terms cancel."""
    for _ in range(3):
        shorter = tidy(e)
        if shorter is e:
            break
        e = shorter
    return e
