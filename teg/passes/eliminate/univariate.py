"""Surfaces that can be solved for one variable: quadratic ones, f(u) = c with f invertible, and these inside each other.

    ∫ₗʰ w δ(g) dx = Σᵢ [root i exists] · w(xᵢ)/|g′(xᵢ)| · ([xᵢ < h] - [xᵢ < l])

over the formulas of `teg.analysis.roots`, every branch inside the bounds. Where two roots are born together g′ is 0 and the weight
infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import solve
from teg.analysis.surfaces import restrict, signed_inside
from teg.errors import NotDifferentiableError
from teg.ir import simplify
from teg.ir.expr import ZERO, Expr, Var
from teg.ir.simplify import add, call, mul, where
from teg.ir.traverse import fresh, substitute


@dataclass(frozen=True)
class Solvable:
    """g can be solved for `variable`."""

    variable: Var
    degree: int | None

    moves = False

    @property
    def name(self) -> str:
        return "quadratic in one variable" if self.degree == 2 else "solved for one variable"

    @property
    def variables(self) -> tuple[Var, ...]:
        return (self.variable,)


def match_solvable(g: Expr, variables: Sequence[Var]) -> Solvable | None:
    """Returns the innermost variable that g can be solved for, with no other variable in g; else None."""
    mine = [v for v in variables if v in g.free]
    if len(mine) != 1:
        return None
    try:
        slope(g, mine[0])
    except NotDifferentiableError:
        return None
    somewhere = fresh("lo", g.free), fresh("hi", g.free)
    roots = solve(g, mine[0], *somewhere)
    if roots is None or not roots.certain:  # certain for any bounds
        return None
    return Solvable(mine[0], Shadow((mine[0],)).degree(g))


def rewrite_solvable(g: Expr, coefficient: Expr, chain: Chain, data: Solvable) -> Expr | None:
    """Returns the sum over the roots inside the bounds."""
    (b,) = [b for b in chain if b.var is data.variable]
    others = tuple(c for c in chain if c.var is not data.variable)
    if any(data.variable in e.free for c in others for e in (c.lo, c.hi)):
        return None
    total = sum_over_roots(g, coefficient, b, (b.var,))
    return None if total is None else nest(total, others)


def sum_over_roots(g: Expr, coefficient: Expr, b: Binder, directions: Sequence[Var]) -> Expr | None:
    """Returns the sum, over the roots of g in one variable inside the bounds of its integral, of coefficient/|g′|."""
    roots = solve(g, b.var, b.lo, b.hi)
    if roots is None or not roots.certain:
        return None
    rate = slope(g, b.var)
    terms = []
    for root in roots.found:
        at = {b.var: root.point}
        rate_there = cast(Expr, substitute(rate, at))
        if rate_there is ZERO:
            return None  # g′ = 0 all along the surface: the formula does not apply
        weight = simplify.integer_power(call("magnitude", rate_there) if root.rate is None else root.rate, -1)
        value = mul(weight, restrict(coefficient, at, g, directions))
        inside = signed_inside(root.point, b.lo, b.hi, g, b, value)
        terms.append(where(root.exists, inside, ZERO))
    return add(*terms)
