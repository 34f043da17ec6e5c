"""Critical points of surfaces: where a region is born, or two branches of a curve meet.

A quadric g has one critical point, where ∇g = 0: from the middle o of a box the step d to it solves H·d = -∇g(o). If g is 0 there, the
region {g > 0} is a point, or the curve g = 0 is two crossing lines; the derivatives are then one-sided or infinite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.nest import Binder
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.squares import squares_in
from teg.analysis.tails import infinite_ends
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Cond, Expr, Mul, Var, const
from teg.ir.show import show
from teg.ir.simplify import add, call, conjunction, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute

ROUNDING = 8 * 2.0**-52
APART = 2.0**-45
"""What counts as 0 at the critical point, relative to Σ|terms| there."""
FINEST = 2.0**-100
"""The same, relative to the values on the box: the square of a length that is none beside it."""
LEAST = 1e-200
"""The least such distance: the square of a radius."""
NOTHING = 1e-12
"""A factor of the boundary term counts as 0 at the critical point if it is smaller there than this fraction of its values on the box."""


@dataclass(frozen=True)
class Critical:
    """The critical point of a quadric, the value of g there, det H, whether the point is in the box, Σ|terms| of that value, and the size
    of g on the box."""

    point: Mapping[Var, Expr]
    value: Expr
    determinant: Expr
    inside: Cond
    terms: Expr
    size: Expr


def critical_point(g: Expr, boxes: Sequence[Binder]) -> Critical | None:
    """Returns the critical point of a surface that is quadratic in the variables of the boxes together (two or three), else None."""
    variables = [b.var for b in boxes]
    if not 2 <= len(boxes) <= 3 or Shadow(tuple(variables)).degree(g) != 2:
        return None
    around = [finite_box(b) for b in boxes]
    middle = {b.var: mul(const(0.5), add(b.lo, b.hi)) for b in around}
    gradient = [slope(g, v) for v in variables]
    hessian = [[_at(slope(s, v), middle) for v in variables] for s in gradient]
    factors: Expr = ONE
    level: Expr | None = None
    vanishing = gradient
    split = squares_in(g, variables)
    if split is not None and len(split[0]) == len(variables):  # where their bases vanish, g is what is no square, without a difference
        factors, level = mul(*(mul(const(2.0), factor) for factor, _ in split[0])), add(*split[1])
        vanishing = [base for _, base in split[0]]
    rows = [[_at(slope(e, v), middle) for v in variables] for e in vanishing]
    down = [mul(MINUS_ONE, _at(e, middle)) for e in vanishing]
    whole = _determinant(rows)
    if is_null(whole):  # parallel lines or planes
        return None
    point: dict[Var, Expr] = {}
    for i, v in enumerate(variables):
        replaced = [[down[r] if c == i else entry for c, entry in enumerate(row)] for r, row in enumerate(rows)]
        point[v] = add(middle[v], mul(_determinant(replaced), integer_power(whole, -1)))
    scale = mul(*(add(*(call("magnitude", entry) for entry in row)) for row in rows))
    inside = conjunction(
        positive(sub(call("magnitude", whole), mul(const(ROUNDING), scale))),  # else the point is noise
        *(_between(point[b.var], b) for b in boxes),
    )
    determinant = whole if level is None else mul(factors, integer_power(whole, 2))
    value = _at(g, point) if level is None else level
    return Critical(point, value, determinant, inside, _terms_size(g, point, hessian), _size(g, around, middle))


def finite_box(b: Binder) -> Binder:
    """Returns a box of length 1 at the finite end of an infinite range, of length 2 around 0 if there is none; else the box itself."""
    lo, hi = infinite_ends(b)
    if not lo and not hi:
        return b
    end = add(b.lo if hi else b.hi, const(math.copysign(1.0, lo or hi)))
    return Binder(b.var, const(-1.0), ONE) if lo and hi else Binder(b.var, b.lo if hi else end, b.hi if lo else end)


def _between(point: Expr, b: Binder) -> Cond:
    """Returns whether a point is between the bounds, in either order."""
    lo, hi = infinite_ends(b)
    if lo and hi:
        return TRUE
    if lo or hi:
        away = sub(point, b.lo if hi else b.hi)
        return positive(away if lo + hi > 0.0 else mul(MINUS_ONE, away), strict=False)
    return positive(mul(sub(b.hi, point), sub(point, b.lo)), strict=False)


def is_above_birth(g: Expr, critical: Critical) -> Cond:
    """Returns whether g is positive at its critical point, with a tie where it is 0 to rounding.

    A region is born there (a disk of radius 0), the derivative is that of neither side, and the mean is taken.
    """
    return positive(critical.value, True, TRUE, (show(g, 300) + " = 0", "its own critical point, where a region is born or branches meet"))


def least_height(critical: Critical) -> Expr:
    """Returns the distance from its critical value at which a surface is taken if that value is 0 to rounding.

    It is not 0 where all numbers are: a circle has directions however small it is, and a side of the box through its centre leaves half
    of it.
    """
    return add(mul(const(APART), critical.terms), mul(const(FINEST), critical.size), const(LEAST))


def height_at_saddle(critical: Critical) -> Expr:
    """Returns the same, and more where curves cross: the integral over them is infinite, however near they are taken."""
    return add(least_height(critical), where(_is_crossing(critical), mul(const(APART), critical.size), ZERO))


def _is_crossing(critical: Critical) -> Cond:
    """Returns whether the critical value of a surface that has two branches beside it is 0 to rounding."""
    near = positive(sub(mul(const(ROUNDING), critical.terms), call("magnitude", critical.value)), strict=False)
    return conjunction(positive(mul(MINUS_ONE, critical.determinant)), near)


def infinite_at_saddle(g: Expr, coefficient: Expr, boxes: Sequence[Binder]) -> Expr:
    """Returns ±inf where ∫∫ coefficient·δ(g) diverges, else 0.

    It diverges in two variables if the curve crosses itself in the box and the coefficient is not 0 there.
    """
    variables = {b.var for b in boxes}
    if len(boxes) != 2 or coefficient.has_delta or coefficient.has_integral or not (g.free | coefficient.free) <= variables:
        return ZERO
    critical = critical_point(g, boxes)
    if critical is None:
        return ZERO
    sign = sign_at(coefficient, critical.point, boxes)
    endless = where(positive(sign), const(math.inf), where(positive(mul(MINUS_ONE, sign)), const(-math.inf), ZERO))
    return where(conjunction(_is_crossing(critical), critical.inside), endless, ZERO)


def sign_at(coefficient: Expr, point: Mapping[Var, Expr], boxes: Sequence[Binder]) -> Expr:
    """Returns 1 or -1, the sign of a coefficient that is not 0 at a point of the box; else 0."""
    around = [finite_box(b) for b in boxes]
    middle = {b.var: mul(const(0.5), add(b.lo, b.hi)) for b in around}
    corner = {b.var: b.lo for b in around}
    corners = (_at(coefficient, {**corner, around[-1].var: end}) for end in (around[-1].lo, around[-1].hi))  # middles may be on axes
    size = add(_size(coefficient, around, middle), *(call("magnitude", e) for e in corners))
    there, nothing = _at(coefficient, point), mul(const(NOTHING), size)
    sign = where(positive(sub(there, nothing)), ONE, where(positive(sub(mul(MINUS_ONE, there), nothing)), MINUS_ONE, ZERO))
    return where(conjunction(*(_between(point[b.var], b) for b in boxes)), sign, ZERO)


def _at(e: Expr, point: Mapping[Var, Expr]) -> Expr:
    return cast(Expr, substitute(e, point))


def _terms_size(g: Expr, point: Mapping[Var, Expr], hessian: Sequence[Sequence[Expr]]) -> Expr:
    """Returns Σ|terms| of a quadric at its critical point p, and ½Σ|Hᵢⱼpᵢpⱼ| times `APART`, of which the product with `APART` is that of
    squares of the roundings of p: lengths that are less than these are none."""
    reach = [call("magnitude", e) for e in point.values()]
    sizes = [
        mul(const(0.5 * APART), call("magnitude", h), here, there)
        for row, here in zip(hessian, reach, strict=True)
        for h, there in zip(row, reach, strict=True)
    ]
    waiting: list[tuple[Expr, Expr]] = [(ONE, g)]
    while waiting:
        factor, e = waiting.pop()
        moving = [c for c in e.children if any(v in c.free for v in point)] if isinstance(e, Mul) else []
        if isinstance(e, Add):
            waiting += [(factor, c) for c in e.children]
        elif isinstance(e, Mul) and len(moving) == 1 and isinstance(moving[0], Add):
            waiting.append((mul(factor, *(c for c in e.children if c is not moving[0])), moving[0]))
        else:
            sizes.append(call("magnitude", mul(factor, _at(e, point))))
    return add(*sizes)


def _size(e: Expr, boxes: Sequence[Binder], middle: Mapping[Var, Expr]) -> Expr:
    """Returns Σ|e| over the middles of the sides of the box."""
    return add(*(call("magnitude", _at(e, {**middle, b.var: end})) for b in boxes for end in (b.lo, b.hi)))


def _determinant(rows: Sequence[Sequence[Expr]]) -> Expr:
    """Returns the determinant of a matrix of one to three rows."""
    if len(rows) == 1:
        return rows[0][0]
    terms = []
    for c, entry in enumerate(rows[0]):
        minor = _determinant([[e for k, e in enumerate(row) if k != c] for row in rows[1:]])
        terms.append(mul(MINUS_ONE if c % 2 else ONE, entry, minor))
    return add(*terms)
