"""Surfaces without a formula for their roots: implicit ones, in one, two or three variables.

    ∫…∫ w δ(g) dx₁…dxₙ  =  Σᵢ ∫…∫ dxⱼ (j ≠ i)  Σ_{xᵢ : g = 0}  w·φᵢ/|gᵢ|·[inside],        φᵢ = (gᵢXᵢ)⁴ / Σⱼ (gⱼXⱼ)⁴

one chart a variable, with gᵢ = ∂g/∂xᵢ and Xᵢ the extent of the box, or of a quadric. The weights φ are a partition of unity that
vanishes, with the factor 1/|gᵢ|, where the surface turns back in xᵢ: no chart has a border, and no integrand a pole. The roots are
isolated at run time.
The sums over roots are `PointMasses`; they are not differentiated again: a further derivative carries the δ itself along
(`teg.passes.differentiate.forward`).
Source: the coarea formula; Saye 2022, section 3, for charts by the dominant slope, which have borders instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.births import at_births
from teg.analysis.calculus import slope
from teg.analysis.critical import critical_point, height_at_saddle, infinite_at_saddle, is_above_birth
from teg.analysis.isolation import isolate, widened
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.roots import solve
from teg.analysis.surfaces import free_of, ordered, restrict, signed_inside
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Expr, Var, const
from teg.ir.integral import Integral, PointMasses, delta, integral_over, masses_of
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, div, integer_power, mul, sub, where
from teg.ir.traverse import rebuild, replace_node, substitute

MAX_CHARTS = 3
NEARLY_FLAT, NOTHING = 1e-40, 1e-200
"""The least bend of a quadric beside the others, and in all."""


@dataclass(frozen=True)
class Implicit:
    """g = 0 is isolated in each of `variables` (outermost first)."""

    variables: tuple[Var, ...]

    name = "isolated at run time"
    moves = True
    """A further derivative moves the δ itself."""


def match_implicit(g: Expr, variables: Sequence[Var]) -> Implicit | None:
    """Returns the innermost variables, three at most, if the surface is smooth in all of them; else None."""
    mine = [v for v in variables if v in g.free][:MAX_CHARTS]
    if not mine or any(isolate(g, v) is None for v in mine):
        return None
    return Implicit(tuple(reversed(mine)))


def rewrite_implicit(g: Expr, coefficient: Expr, chain: Chain, data: Implicit, power: int = 4) -> Expr | None:
    """Returns the sum over the charts of the surface, with weights φ of this power. None if the range of a variable is not known."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, boxes = parts
    try:
        slopes = [slope(g, b.var) for b in mine]
    except NotDifferentiableError:
        return None
    weights = _chart_weights(slopes, boxes, power)
    at = {b.var: b.var for b in mine}
    value = restrict(coefficient, cast("dict[Var, Expr]", at), g, tuple(b.var for b in reversed(mine)))
    masses = PointMasses.make(None, (_apart_from_birth(g, boxes),))
    charts = []
    for i, box in enumerate(boxes):
        inside = mul(masses, weights[i], value)
        for b, limits in zip(mine, boxes, strict=True):
            if b.var is box.var or (limits.lo, limits.hi) != (b.lo, b.hi):
                inside = signed_inside(b.var, b.lo, b.hi, g, b, inside)
        summed = integral_over(inside, box.var, *widened(box.lo, box.hi))
        charts.append(nest(summed, (*(b for b in boxes if b is not box), *others)))
    charts.append(_at_critical_points(g, coefficient, boxes, mine, others))
    return add(*charts)


def rewrite_by_formulas(g: Expr, coefficient: Expr, chain: Chain, data: Implicit, power: int = 4) -> Expr | None:
    """Returns the same sum over charts for a surface that can be solved for each variable, over ranges that may be infinite: the roots have
    formulas, so they are not isolated, and infinite extents count as 1. None if the range of a variable is not known."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, boxes = parts
    slopes = [slope(g, b.var) for b in mine]
    weights = _chart_weights(slopes, [b if not is_unbounded(b) else Binder(b.var, ZERO, ONE) for b in boxes], power, far=True)
    surface = _apart_from_birth(g, boxes)
    charts = []
    for i, box in enumerate(boxes):
        roots = solve(surface, box.var, box.lo, box.hi)
        if roots is None or not roots.certain:
            return None
        terms = []
        for root in roots.found:
            at = {box.var: root.point}
            inside = restrict(mul(weights[i], coefficient), at, g, tuple(b.var for b in reversed(mine)))
            for b, limits in zip(mine, boxes, strict=True):
                if b.var is box.var or (limits.lo, limits.hi) != (b.lo, b.hi):
                    lo, hi = (cast(Expr, substitute(e, at)) for e in (b.lo, b.hi))
                    inside = signed_inside(at.get(b.var, b.var), lo, hi, g, b, inside)
            terms.append(where(root.exists, inside, ZERO))
        charts.append(nest(add(*terms), (*(b for b in boxes if b is not box), *others)))
    charts.append(_at_critical_points(g, coefficient, boxes, mine, others))
    return add(*charts)


def _at_critical_points(g: Expr, coefficient: Expr, boxes: Chain, mine: Chain, others: Chain) -> Expr:
    """Returns what ∫∫ coefficient·δ(g) has at critical points of the surface that lie on it."""
    if critical_point(g, boxes) is not None:
        return ZERO if others else infinite_at_saddle(g, coefficient, boxes)
    return nest(at_births(g, coefficient, mine), others)


def _chart_weights(slopes: Sequence[Expr], boxes: Sequence[Binder], power: int, far: bool = False) -> list[Expr]:
    """Returns φᵢ/|gᵢ| of every chart. With m = Σⱼ|gⱼXⱼ|, rⱼ = |gⱼXⱼ|/m and power 4 it is rᵢ³Xᵢ/(m·Σⱼrⱼ⁴), where no power overflows. The
    sum, unlike the largest of them, has no kinks but theirs. Enclosures over boxes that reach `far` do not know that rⱼ and 1/Σⱼrⱼ⁴ are
    bounded: they are cut off there at limits that they never reach."""
    if len(slopes) == 1:
        return [integer_power(call("magnitude", slopes[0]), -1)]
    extents = _extents(slopes, boxes)
    sizes = [call("magnitude", mul(s, extent)) for s, extent in zip(slopes, extents, strict=True)]
    scale = integer_power(add(*sizes), -1)
    ratios = [mul(size, scale) for size in sizes]
    ratios = [call("min", r, const(2.0)) for r in ratios] if far else ratios
    powers = add(*(integer_power(r, power) for r in ratios))
    least = 0.5 * len(slopes) ** (1 - power)
    total = mul(scale, integer_power(call("max", powers, const(least)) if far else powers, -1))
    tops = [integer_power(r, power - 1) if power > 2 else call("min", r, const(2.0)) for r in ratios]  # else 1/m is squared in the product
    return [mul(top, extent, total) for top, extent in zip(tops, extents, strict=True)]


def _extents(slopes: Sequence[Expr], boxes: Sequence[Binder]) -> list[Expr]:
    """Returns the lengths that slopes are compared by, up to a common factor: those of the box, Xᵢ, or those of the surface if it is a
    quadric. Along a long ellipse in a wide box, the weights by Xᵢ would be exchanged within a part of the curve that no node sees.

    With gᵢᵢ = ∂²g/∂xᵢ² and H = Σ|gᵢ|Xᵢ over the variables of which g is linear (1 without any), they are √(H/|gᵢᵢ|), and Xᵢ of the
    linear ones."""
    extents = [sub(b.hi, b.lo) if ordered(b.lo, b.hi) > 0 else call("magnitude", sub(b.hi, b.lo)) for b in boxes]
    bends = [slope(s, b.var) for s, b in zip(slopes, boxes, strict=True)]
    linear = [i for i, bend in enumerate(bends) if bend is ZERO]
    steady = [slopes[i] if i in linear else bend for i, bend in enumerate(bends)]
    if len(linear) == len(bends) or any(not free_of(e, (b.var for b in boxes)) for e in steady):
        return extents
    height = add(*(call("magnitude", mul(slopes[i], extents[i])) for i in linear), const(NOTHING)) if linear else ONE
    sizes = [call("magnitude", bend) for bend in bends]
    least = add(mul(const(NEARLY_FLAT), add(*sizes)), const(NOTHING))
    return [e if i in linear else call("sqrt", div(height, call("max", sizes[i], least))) for i, e in enumerate(extents)]


def with_deltas(root: Expr) -> Expr:
    """Returns the program with δ(g)·|g′| for every sum over roots, so that it can be differentiated."""
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        masses = masses_of(result.body, result.var) if isinstance(result, Integral) else None
        if masses is not None and isinstance(result, Integral):
            weighted = mul(delta(masses.g), call("magnitude", slope(masses.g, result.var)))
            result = integral_over(cast(Expr, replace_node(result.body, masses, weighted)), result.var, result.lo, result.hi)
        new[node] = result
    return cast(Expr, new[root])


def _apart_from_birth(g: Expr, boxes: Sequence[Binder]) -> Expr:
    """Returns a quadric moved off its critical value if that is 0 to rounding inside the box, to one side in each order of the tie."""
    critical = critical_point(g, boxes)
    if critical is None:
        return g
    least = height_at_saddle(critical)
    above, below = call("max", critical.value, least), call("min", critical.value, mul(MINUS_ONE, least))
    moved = where(is_above_birth(g, critical), above, below)
    return add(g, where(critical.inside, sub(moved, critical.value), ZERO))
