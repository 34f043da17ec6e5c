"""Where a line meets the border between two distances and a number, √u - √w + c = 0: at most twice.

    u = a·(t² + h²),  t = x - m,       w - u - c² = α + β·t       u and w have the same leading coefficient a > 0
    √w = √u + c   ⇔   α + β·t = γ·√(t² + h²) and √u + c >= 0,       γ = 2c·√a

    t = (-αβ + s·γ·S)/(β² - γ²) = (α² - γ²h²)/(-αβ - s·γ·S),       S² = α² + h²·(β² - γ²),       s = 1, -1
    √(t² + h²) = (α² + β²h²)/(sβ·S + αγ)                            a root only where that is positive

Both forms of t are computed, and that without a difference is taken. Where c is 0 one root is left, which is as exact as others; the
square of the equation would have it twice.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.preimages import is_not_zero
from teg.analysis.radicals import radical_in
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Cond, Const, Expr, Var, const
from teg.ir.simplify import add, call, conjunction, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import substitute

LARGE = 1e50
"""A quotient that is larger counts as this: no difference of two distances is."""


def bounded_quotient(number: Expr, scale: Expr) -> Expr:
    """Returns number/scale, or LARGE where that is larger, as at a scale of 0."""
    if isinstance(scale, Const):
        return div(number, scale)
    fits = positive(sub(mul(const(LARGE), call("magnitude", scale)), call("magnitude", number)))
    return where(fits, div(number, where(fits, scale, ONE)), const(LARGE))


def equal_distances(g: Expr, x: Var) -> list[tuple[Expr, Cond]] | None:
    """Returns the roots in x of a difference of two distances and a number, each with the condition under which it is one; None for other
    functions."""
    found = radical_in(g) if x in g.free else None
    if found is None or len(found.roots) != 2 or x in found.rest.free:
        return None
    (k, u), (j, w) = found.roots
    lead = _lead(u, x)
    if lead is None or x not in u.free or not (is_null(add(k, j)) and _lead(w, x) is lead):
        return None
    shift = bounded_quotient(found.rest, k)
    middle = mul(const(-0.5 / lead.data), cast(Expr, substitute(slope(u, x), {x: ZERO})))
    square, other = (cast(Expr, substitute(e, {x: middle})) for e in (u, w))
    height = mul(const(1.0 / lead.data), square)  # h²
    alpha = sub(sub(other, square), integer_power(shift, 2))
    beta = cast(Expr, substitute(slope(sub(w, u), x), {x: middle}))
    gamma = mul(const(2.0 * math.sqrt(lead.data)), shift)
    whole = sub(integer_power(beta, 2), integer_power(gamma, 2))
    under = add(integer_power(alpha, 2), mul(height, whole))
    root = call("sqrt", call("max", under, ZERO))
    results: list[tuple[Expr, Cond]] = []
    for sign in (ONE, MINUS_ONE):
        centre, step = mul(MINUS_ONE, alpha, beta), mul(sign, gamma, root)
        agree = positive(mul(centre, step), strict=False)
        below = where(agree, whole, sub(centre, step))
        above = where(agree, add(centre, step), sub(integer_power(alpha, 2), mul(integer_power(gamma, 2), height)))
        there = add(mul(sign, beta, root), mul(alpha, gamma))
        length = mul(const(math.sqrt(lead.data)), add(integer_power(alpha, 2), mul(integer_power(beta, 2), height)))
        exists = conjunction(positive(under, strict=False), positive(there), positive(add(length, mul(shift, there)), strict=False))
        is_finite = is_not_zero(below)
        place = div(above, where(is_finite, below, ONE))
        results.append((add(middle, place), conjunction(exists, is_finite)))
    return results


def _lead(u: Expr, x: Var) -> Const | None:
    """Returns the coefficient of x² of a polynomial of degree 2, if it is a positive number."""
    if Shadow((x,)).degree(u) != 2:
        return None
    lead = mul(const(0.5), slope(slope(u, x), x))
    return lead if isinstance(lead, Const) and lead.data > 0.0 else None
