"""Polynomials of cosine and sine as polynomials of the tangent of half the angle, whose roots have formulas or are isolated as such."""

from __future__ import annotations

from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import ONE, ZERO, Expr, Var, const
from teg.ir.simplify import add, integer_power, mul, sub
from teg.ir.traverse import fresh, substitute

MAX_DEGREE = 8
"""The largest degree of a condition that is made a polynomial of t."""


def in_half_angle(p: Expr, c: Var, s: Var, half: Expr) -> Expr | None:
    """Returns p(c, s)·(1 + t²)ⁿ for a polynomial p of degree n in cosine and sine, with t the tangent of half the angle; None for others.

    As c² + s² = 1, another circle is a polynomial of degree 1.
    """
    degree = Shadow((c, s)).degree(p)
    if degree is None or degree > MAX_DEGREE:
        return None
    if degree == 2:
        square = mul(const(0.5), slope(slope(p, c), c))
        on_circle = sub(p, mul(square, sub(add(integer_power(c, 2), integer_power(s, 2)), ONE)))
        if Shadow((c, s)).degree(on_circle) == 1:
            p, degree = on_circle, 1
    t, z = fresh("t", p.free), fresh("z", p.free)  # z = 1/(1 + t²)
    rate = cast(Expr, substitute(p, {c: sub(mul(const(2.0), z), ONE), s: mul(const(2.0), t, z)}))
    terms, factor = [], 1.0
    for k in range(degree + 1):
        power = integer_power(add(ONE, integer_power(t, 2)), degree - k)
        terms.append(mul(const(1.0 / factor), cast(Expr, substitute(rate, {z: ZERO})), power))
        rate, factor = slope(rate, z), factor * (k + 1)
    return cast(Expr, substitute(add(*terms), {t: half}))
