"""Integrals of polynomials in closed form.

    ∫ₗʰ F dx          =  Σₖ F⁽ᵏ⁾(l)·(h - l)ᵏ⁺¹/(k + 1)!          F a polynomial in x
    ∫ₗʰ F([x > r]) dx =  ∫ₗᵐ F(0) dx + ∫ₘʰ F(1) dx               m = min(max(r, l), h)

The first formula uses powers of h - l instead of differences of powers, so nothing cancels where the bounds are close to each other and
far from 0. The second one is for conditions that are affine in x with a number as slope, a few of them.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import ordered
from teg.ir.expr import FALSE, TRUE, ZERO, Compare, Cond, Const, Expr, Var, Where, const
from teg.ir.integral import Integral
from teg.ir.node import postorder_through
from teg.ir.operands import less
from teg.ir.simplify import add, integer_power, mul, sub, where
from teg.ir.traverse import replace_node, substitute

MAX_DEGREE = 8
"""The largest degree of a polynomial that is integrated in closed form. Surfaces of a higher degree are isolated at run time anyway."""


MAX_CONDITIONS = 3
"""The largest number of conditions on the variable."""


def integrated(node: Integral) -> Expr | None:
    """Returns the value of an integral in closed form.

    None if the integrand is not a polynomial of low degree between few conditions, or if a bound is infinite.
    """
    x, lo, hi = node.var, node.lo, node.hi
    if any(isinstance(b, Const) and not math.isfinite(b.data) for b in (lo, hi)) or node.has_delta:
        return None
    pieces = [(node.body, lo, hi)]
    total: list[Expr] = []
    for _ in range(2 ** (MAX_CONDITIONS + 1)):
        if not pieces:
            return add(*total)
        body, lo, hi = pieces.pop()
        inside = postorder_through(body, (x,))
        atom = next((n for n in inside if isinstance(n, Compare) and x in n.free), None)
        if atom is None:
            value = None if any(isinstance(n, Where | Compare | Integral) for n in inside) else _polynomial(body, x, lo, hi)
            if value is None:
                return None
            total.append(value)
            continue
        parts = _on_both_sides(atom, x, (node.lo, node.hi))
        if parts is None:
            return None
        root, before, behind = parts
        middle = _between(lo, root, hi)
        pieces += [(cast(Expr, replace_node(body, atom, behind)), middle, hi), (cast(Expr, replace_node(body, atom, before)), lo, middle)]
    return None


def _on_both_sides(atom: Compare, x: Var, bounds: tuple[Expr, Expr]) -> tuple[Expr, Cond, Cond] | None:
    """Returns where an affine condition changes, and what it is before and behind; None where it is another one, or the bounds have no
    known order."""
    if atom.resolution is not None or atom.g.has_integral or Shadow((x,)).degree(atom.g) != 1 or ordered(*bounds) <= 0:
        return None
    rate = slope(atom.g, x)
    if not isinstance(rate, Const) or rate is ZERO:
        return None
    root = mul(const(-1.0 / rate.data), cast(Expr, substitute(atom.g, {x: ZERO})))
    return (root, FALSE, TRUE) if rate.data > 0 else (root, TRUE, FALSE)


def _between(lo: Expr, x: Expr, hi: Expr) -> Expr:
    """Returns min(max(x, lo), hi)."""
    above = where(less(lo, x, True), x, lo)
    return where(less(above, hi, True), above, hi)


def _polynomial(body: Expr, x: Var, lo: Expr, hi: Expr) -> Expr | None:
    degree = Shadow((x,)).degree(body)
    if degree is None or degree > MAX_DEGREE:
        return None
    terms, derivative, length = [], body, sub(hi, lo)
    for k in range(degree + 1):
        at_lo = cast(Expr, substitute(derivative, {x: lo}))
        terms.append(mul(const(1.0 / math.factorial(k + 1)), at_lo, integer_power(length, k + 1)))
        derivative = slope(derivative, x)
    return add(*terms)
