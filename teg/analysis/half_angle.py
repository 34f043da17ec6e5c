"""Functions along a curve with rational coordinates as polynomials, whose roots have formulas or are isolated as such: those of cosine and
sine by the tangent of half the angle, and those with a power of a positive denominator."""

from __future__ import annotations

from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import ONE, ZERO, Add, Expr, Mul, Pow, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, integer_power, mul, sub
from teg.ir.traverse import fresh, rewrite, substitute

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
    rational = cast(Expr, substitute(p, {c: sub(mul(const(2.0), z), ONE), s: mul(const(2.0), t, z)}))
    return cast(Expr, substitute(cleared(rational, z, add(ONE, integer_power(t, 2)), degree), {t: half}))


def without_denominator(g: Expr, x: Var) -> Expr | None:
    """Returns g·Dⁿ, a polynomial in 1/D made one in D, for a function of x in which one denominator D = 1 + (squares) occurs; g itself if
    none does, and None for others."""
    denominators = {n.base for n in postorder([g]) if isinstance(n, Pow) and n.exponent < 0 and x in n.free}
    if not denominators:
        return g
    (whole, *more) = denominators
    if more or not _is_above_1(whole):
        return None
    z = fresh("z", g.free)

    def visit(_: Node, new: Node) -> Node:
        return integer_power(z, -new.exponent) if isinstance(new, Pow) and new.base is whole and new.exponent < 0 else new

    polynomial = cast(Expr, rewrite([g], visit)[g])
    degree = Shadow((z,)).degree(polynomial)
    return None if degree is None or degree > MAX_DEGREE else cleared(polynomial, z, whole, degree)


def cleared(p: Expr, z: Var, whole: Expr, degree: int) -> Expr:
    """Returns p·Dⁿ for a polynomial p of degree n in z = 1/D."""
    terms, factor = [], 1.0
    for k in range(degree + 1):
        terms.append(mul(const(1.0 / factor), cast(Expr, substitute(p, {z: ZERO})), integer_power(whole, degree - k)))
        p, factor = slope(p, z), factor * (k + 1)
    return add(*terms)


def _is_above_1(e: Expr) -> bool:
    """Returns whether an expression is written as 1 and squares."""
    squares = [c for c in e.children if c is not ONE] if isinstance(e, Add) else [e]
    return len(squares) < len(e.children) and all(
        isinstance(factor, Pow) and factor.exponent % 2 == 0
        for square in squares
        for factor in (square.children if isinstance(square, Mul) else (square,))
    )
