"""Integrals to infinity on finite intervals, by rational maps, under which algebraic surfaces stay algebraic:

(l, ∞)    x = l + s/(1 - s)      0 < s < 1         dx = ds/(1 - s)²
(-∞, h)   x = h - s/(1 - s)      the same, from right to left
(-∞, ∞)   x = s/(1 - s²)        -1 < s < 1         dx = (1 + s²)/(1 - s²)² ds
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from teg.analysis.nest import Binder
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Const, Expr, Var
from teg.ir.integral import Integral
from teg.ir.simplify import add, div, integer_power, sub
from teg.ir.traverse import fresh


def infinite_ends(node: Integral | Binder) -> tuple[float, float]:
    """Returns the bounds that are infinite as written, and 0 for the others."""
    lo, hi = (float(b.data) if isinstance(b, Const) and math.isinf(b.data) else 0.0 for b in (node.lo, node.hi))
    return lo, hi


def is_unbounded(node: Integral | Binder) -> bool:
    """Returns whether a bound is infinite as written."""
    return infinite_ends(node) != (0.0, 0.0)


def finite_place(node: Integral, taken: Iterable[Var]) -> tuple[Var, tuple[Expr, Expr], Expr, Expr]:
    """Returns a new variable s, its bounds, x as a function of s, and |dx/ds|, for an unbounded integral with ascending bounds."""
    lo, hi = infinite_ends(node)
    s = fresh(node.var.name, taken)
    if lo and hi:
        below = sub(ONE, integer_power(s, 2))
        return s, (MINUS_ONE, ONE), div(s, below), div(add(ONE, integer_power(s, 2)), integer_power(below, 2))
    below = sub(ONE, s)
    step, rate = div(s, below), div(ONE, integer_power(below, 2))
    return s, (ZERO, ONE), add(node.lo, step) if hi else sub(node.hi, step), rate
