"""The bounds of integrals over (0, 1), drawn in to where affine conditions hold: what is outside needs no samples.

    ∫₀¹ [a + b·s > 0]·f ds  →  ∫ₗʰ [a + b·s > 0]·f ds,     l or h = -a/b, where b is not 0 to rounding

The conditions stay, so a bound that is off by rounding does no harm. Linear in the size of the program.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.surfaces import atoms_of
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, And, Compare, Cond, Expr, Not, Var, Where, const
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node
from teg.ir.simplify import add, call, conjunction, div, mul, positive, sub, where
from teg.ir.traverse import rewrite, substitute

FLAT = 2.0**-26
"""The rate of a condition along a chart, relative to its terms, below which it does not clip: rounding alone would say where."""


def clipped(e: Expr) -> Expr:
    """Returns e with the bounds of each integral over (0, 1) drawn in to where affine conditions hold."""

    def visit(old: Node, new: Node) -> Node:
        if isinstance(new, Integral) and new.lo is ZERO and new.hi is ONE:
            lo, hi = _limits(new.body, new.var)
            return integral_over(new.body, new.var, lo, call("max", lo, hi) if lo is not ZERO or hi is not ONE else hi)
        return new

    return cast(Expr, rewrite([e], visit)[e])


def _limits(body: Expr, s: Var) -> tuple[Expr, Expr]:
    """Returns the part of (0, 1) outside of which a body is 0 because an affine condition fails."""
    lo: Expr = ZERO
    hi: Expr = ONE
    for condition in _conditions(body):
        atom, sign = (condition.operand, MINUS_ONE) if isinstance(condition, Not) else (condition, ONE)
        if not isinstance(atom, Compare) or s not in atom.g.free or any(s in a.free for a in atoms_of(atom.g)):
            continue
        rate = slope(atom.g, s)
        if s in rate.free or atom.g.free - rate.free - {s} - body.free:
            continue
        start = cast(Expr, substitute(atom.g, {s: ZERO}))
        place = div(mul(MINUS_ONE, start), rate)
        steep = positive(sub(call("magnitude", rate), mul(const(FLAT), _size(atom.g, s))))
        rises = positive(mul(sign, rate))
        lo = call("max", lo, where(conjunction(steep, rises), place, ZERO))
        hi = call("min", hi, where(conjunction(steep, Not.make(None, (rises,))), place, ONE))
    return lo, hi


def _conditions(body: Expr) -> Sequence[Cond]:
    """Returns conditions without which a body is 0."""
    if not isinstance(body, Where) or body.otherwise is not ZERO:
        return ()
    return body.condition.children if isinstance(body.condition, And) else (body.condition,)


def _size(g: Expr, s: Var) -> Expr:
    """Returns the size of the terms of g on (0, 1)."""
    match g:
        case Add():
            return add(*(_size(c, s) for c in g.children))
        case Where():
            return where(g.condition, _size(g.then, s), _size(g.otherwise, s))
        case _ if s in g.free:
            return add(*(call("magnitude", cast(Expr, substitute(g, {s: end}))) for end in (ZERO, ONE)))
        case _:
            return call("magnitude", g)
