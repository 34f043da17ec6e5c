"""Surfaces that are affine in each of two variables but not in both together: hyperbolas with axes along the box, as in a pixel of
bilinearly interpolated values.

    g = g₀ + b·(x - l) + c·(y - m) + d·(x - l)(y - m),   E = b·c - d·g₀        on g = 0:  g_x·g_y = E

Two charts: x is eliminated where |g_x|·X >= κ·|g_y|·Y, X and Y being the extents, and y elsewhere. On the curve the first is g_x² >=
κ·|E|·Y/X, a condition on y alone, and the second g_y² > |E|·X/(κ·Y), one on x alone. Each is two affine atoms, and they are
complementary on the curve, so that their fluxes cancel in higher derivatives. κ is near 1, but not a ratio that a user's coefficients
would have: if the charts are equally good all along a curve that is nearly a line, the border between them is lost in rounding. Neither
chart has a denominator much below √(|E|·Y/X), and at the saddle value, E = 0, where the curve becomes two lines, each chart has one of
them whole.

If g_x at the ends of y's range is r and s with r·s >= EVEN·(r² + s²), the denominator is of one size everywhere, and the first chart
takes the whole curve. Else, if this is so of g_y at the ends of x's range, the second one does. Most pixels have one chart then.

A polynomial along the curve in a box needs no chart if it is not differentiated again: its moments have a closed form
(`teg.passes.intrinsics.hyperbola`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.critical import infinite_at_saddle
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import tidy
from teg.analysis.surfaces import restrict, signed_inside
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import FALSE, ZERO, Cond, Expr, Var, const
from teg.ir.simplify import add, call, conjunction, disjunction, div, mul, negation, positive, sub, where
from teg.ir.traverse import substitute

ODDS = 1.3706
"""κ."""
EVEN = 0.02
"""Slopes within a factor of 50 of each other count as even."""


@dataclass(frozen=True)
class Bilinear:
    """g is affine in each of `variables` (outermost first) with the other one fixed, and in no other variable."""

    variables: tuple[Var, Var]

    name = "bilinear"
    moves = True


def match_bilinear(g: Expr, variables: Sequence[Var]) -> Bilinear | None:
    """Returns two variables, given innermost first, with a mixed term and no squares; None for other surfaces."""
    mine = [v for v in variables if v in g.free]
    if len(mine) != 2:
        return None
    poly = Shadow(tuple(mine)).polynomial(g)
    if poly is None or (1, 1) not in poly or any(max(m) > 1 for m in poly):
        return None
    return Bilinear((mine[1], mine[0]))


def rewrite_bilinear(g: Expr, coefficient: Expr, chain: Chain, data: Bilinear) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) by the two charts. None if the range of one variable is not known."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    (outer, inner), outside, boxes = parts
    curve = _Curve(g, coefficient, (outer, inner), boxes, _invariant(g, boxes), outside)
    first, second = (_is_even(g, boxes[pivot], boxes[1 - pivot]) for pivot in (1, 0))
    total = []
    for pivot, mine, others in ((1, first, conjunction(negation(first), second)), (0, conjunction(negation(first), second), first)):
        total.append(_chart(curve, pivot, mine, others))
    if not outside:
        total.append(infinite_at_saddle(g, coefficient, boxes))
    return add(*total)


def _is_even(g: Expr, box: Binder, stay: Binder) -> Cond:
    """Returns whether the slope along one variable is of one size for all values of the other one. FALSE if it depends
    on outer variables."""
    rate = slope(g, box.var)
    low, high = (cast(Expr, substitute(rate, {box.var: box.lo, stay.var: end})) for end in (stay.lo, stay.hi))
    squares = add(simplify.integer_power(low, 2), simplify.integer_power(high, 2))
    even = positive(sub(mul(low, high), mul(const(EVEN), squares)))
    return FALSE if even.free else even


def _extent(b: Binder) -> Expr:
    return call("magnitude", sub(b.hi, b.lo))


def _invariant(g: Expr, boxes: Sequence[Binder]) -> Expr:
    """Returns |E| = |g_x·g_y - g_xy·g|, the same everywhere, and at least its rounding error: so near the crossing of two lines a root is
    noise."""
    x, y = boxes[0].var, boxes[1].var
    gx, gy = slope(g, x), slope(g, y)
    corner = {b.var: b.lo for b in boxes}
    first, second = (cast(Expr, substitute(e, corner)) for e in (mul(gx, gy), mul(slope(gx, y), g)))
    noise = mul(const(8 * 2.0**-52), add(call("magnitude", first), call("magnitude", second)))
    exact = call("magnitude", tidy(sub(first, second)))
    return where(positive(sub(exact, noise)), exact, noise)


@dataclass(frozen=True)
class _Curve:
    """A curve g = 0 with the coefficient of its δ, in the integrals `binders` (outer, inner).

    `boxes` are these integrals with bounds that do not depend on each other, `invariant` is |E|, `others` are the other integrals of the
    chain.
    """

    g: Expr
    coefficient: Expr
    binders: tuple[Binder, Binder]
    boxes: tuple[Binder, ...]
    invariant: Expr
    others: Chain


def _chart(curve: _Curve, pivot: int, whole: Cond, nothing: Cond) -> Expr:
    """Returns the part of the curve where variable number `pivot` is eliminated and the other one stays.

    It is the whole curve where `whole` holds, and empty where `nothing` does.
    """
    g, binders, boxes = curve.g, curve.binders, curve.boxes
    b, box, stay = binders[pivot], boxes[pivot], boxes[1 - pivot]
    origin = {b.var: box.lo}
    rate = cast(Expr, substitute(slope(g, b.var), origin))
    root = sub(box.lo, div(cast(Expr, substitute(g, origin)), rate))
    odds = const(ODDS if pivot else 1 / ODDS)
    least = where(whole, ZERO, call("sqrt", mul(curve.invariant, odds, div(_extent(stay), _extent(box)))))
    strict = pivot == 0
    steep: Cond = disjunction(positive(sub(rate, least), strict), positive(sub(mul(ex.MINUS_ONE, rate), least), strict))
    at = {b.var: root}
    value = mul(restrict(curve.coefficient, at, g, (binders[1].var, binders[0].var)), simplify.integer_power(call("magnitude", rate), -1))
    point: dict[Var, Expr] = {b.var: root, stay.var: stay.var}
    for c, limits in zip(binders, boxes, strict=True):
        if c is b or (limits.lo, limits.hi) != (c.lo, c.hi):
            lo, hi = (cast(Expr, substitute(e, at)) for e in (c.lo, c.hi))
            value = signed_inside(point[c.var], lo, hi, g, c, value)
    value = where(conjunction(negation(nothing), steep), value, ZERO)
    return nest(value, (Binder(stay.var, stay.lo, stay.hi), *curve.others))
