"""Quotients by the size of an expression, whose denominator is 0 on the border of its own branch.

    u·where(u > 0, 1/u, -1/u)   →   where(u > 0, 1, -1)

On the border the left side is 0·∞, of which no derivative knows the jump. Where nothing cancels, `teg.analysis.limits` has the limits.
Linear.
"""

from __future__ import annotations

from teg.analysis.singularities import Keys
from teg.ir.expr import Compare, Expr, Mul, Pow, Where
from teg.ir.simplify import mul, where


def with_whole_branches(e: Mul) -> Expr:
    """Returns a product with one factor that has a pole at the border of its branches with the other factors inside of these."""
    kinks = [f for f in e.children if isinstance(f, Where) and _has_pole_at_border(f)]
    if len(kinks) != 1:
        return e
    (kink,) = kinks
    others = [f for f in e.children if f is not kink]
    return where(kink.condition, mul(*others, kink.then), mul(*others, kink.otherwise))


def _has_pole_at_border(e: Where) -> bool:
    """Returns whether a branch has a denominator that is a multiple of what its condition is about."""
    if not isinstance(e.condition, Compare) or not e.condition.free:
        return False
    factors = [f for b in (e.then, e.otherwise) for f in (b.children if isinstance(b, Mul) else (b,))]
    bases = [f.base for f in factors if isinstance(f, Pow) and f.exponent < 0]
    keys = Keys()
    return any(keys.of(b) == keys.of(e.condition.g) for b in bases)
