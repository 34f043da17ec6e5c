"""Polynomials in sines and cosines of one variable: how many nodes of Gauss's rule integrate them to rounding.

    f(x) = Σ c_m·Π cos(kᵢx + …)^mᵢ,      highest frequency ω = max Σ mᵢ·|kᵢ|

On an interval of length L the error of the rule with n nodes is at most L^(2n+1)·(n!)⁴/((2n + 1)·(2n)!³)·max|f⁽²ⁿ⁾|, and the last factor
at most ω²ⁿ·Σ|c_m|, so the number of nodes for a relative error of 2⁻⁵³ follows from ω·L.
Source: Davis & Rabinowitz 1984, section 2.7.
"""

from __future__ import annotations

import math
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import Call, Const, Expr, Var
from teg.ir.integral import Integral
from teg.ir.node import postorder_through
from teg.ir.traverse import fresh, replace_node

MAX_NODES = 12
MAX_WAVES = 16
"""The largest number of different sines and cosines in an integrand."""
LOST = 53.0 * math.log(2.0)


def frequency(body: Expr, x: Var) -> float | None:
    """Returns the highest frequency of a polynomial in sines and cosines of affine functions of x; None for anything else."""
    if body.has_integral:
        return None
    waves: dict[Call, float] = {}  # to the size of the slope of its argument
    shadow = Shadow((x,))
    for n in postorder_through(body, (x,)):
        if isinstance(n, Call) and n.name in ("sin", "cos"):
            rate = slope(n.children[0], x) if shadow.degree(n.children[0]) == 1 else None
            if not isinstance(rate, Const) or len(waves) == MAX_WAVES:
                return None
            waves[n] = abs(float(rate.data))
    if not waves:
        return None
    marks: list[Var] = []
    for n in waves:
        marks.append(fresh("wave", [*body.free, *marks]))
        body = cast(Expr, replace_node(body, n, marks[-1]))
    polynomial = Shadow((x, *marks), kinks=True).polynomial(body)
    if polynomial is None or any(m[0] for m in polynomial):
        return None
    return max((math.fsum(k * rate for k, rate in zip(m[1:], waves.values(), strict=True)) for m in polynomial), default=0.0)


def gauss_nodes(node: Integral) -> int | None:
    """Returns the number of Gauss nodes for the integrand on a part of its interval; None if no such number is known."""
    if not (isinstance(node.lo, Const) and isinstance(node.hi, Const) and math.isfinite(node.hi.data - node.lo.data)):
        return None
    omega = frequency(node.body, node.var)
    if omega is None:
        return None
    return next((n for n in range(1, MAX_NODES + 1) if _log_error(n, omega * abs(float(node.hi.data - node.lo.data))) <= -LOST), None)


def _log_error(n: int, phase: float) -> float:
    """Returns the logarithm of the largest error of n nodes relative to the length, for ω·L = `phase`."""
    if phase == 0.0:
        return -math.inf
    return 2 * n * math.log(phase) + 4 * math.lgamma(n + 1) - math.log(2 * n + 1) - 3 * math.lgamma(2 * n + 1)
