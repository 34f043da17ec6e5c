"""Integrals of polynomials in closed form.

    ∫ₗʰ F dx  =  Σₖ F⁽ᵏ⁾(l)·(h - l)ᵏ⁺¹/(k + 1)!          F a polynomial in x; conditions on x do not occur in it

The formula uses powers of h - l instead of differences of powers, so nothing cancels where the bounds are close to each other and far
from 0.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import Compare, Const, Expr, Where, add, const, integer_power, mul, sub
from teg.ir.integral import Integral
from teg.ir.node import postorder_through
from teg.ir.traverse import substitute

MAX_DEGREE = 8
"""The largest degree of a polynomial that is integrated in closed form. Surfaces of a higher degree are isolated at run time anyway."""


def integrated(node: Integral) -> Expr | None:
    """Returns the value of an integral in closed form. None if the integrand is not a polynomial of low degree, or a bound is infinite."""
    x, lo, hi = node.var, node.lo, node.hi
    if any(isinstance(b, Const) and not math.isfinite(b.data) for b in (lo, hi)) or node.has_delta:
        return None
    if any(isinstance(n, Where | Compare | Integral) for n in postorder_through(node.body, (x,))):
        return None
    degree = Shadow((x,)).degree(node.body)
    if degree is None or degree > MAX_DEGREE:
        return None
    terms, derivative, length = [], node.body, sub(hi, lo)
    for k in range(degree + 1):
        at_lo = cast(Expr, substitute(derivative, {x: lo}))
        terms.append(mul(const(1.0 / math.factorial(k + 1)), at_lo, integer_power(length, k + 1)))
        derivative = slope(derivative, x)
    return add(*terms)
