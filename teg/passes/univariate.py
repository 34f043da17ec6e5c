"""Surfaces of one variable that are quadratic in it.

    g = A·x² + B·x + C,  D = B² - 4AC > 0:      q = -½(B + sgn(B)·√D),  x₁ = q/A,  x₂ = C/q,      |g'(xᵢ)| = √D

D is taken from the exact normal form, so for (x - c)² < t it is 4t and not a difference of squares; neither root cancels, and A → 0 sends
x₁ to infinity, outside of every bound (Press et al., Numerical Recipes, section 5.6). At D = 0 a region is born: the weight is infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from teg import expr as ex
from teg.expr import ZERO, Expr, Var, add, call, mul, positive, where
from teg.nest import Chain, nest
from teg.polynomial import Shadow
from teg.roots import quadratic_roots
from teg.surfaces import restrict, signed_inside


@dataclass(frozen=True)
class Quadratic:
    """g is of degree 2 in `variable` alone; no other variable occurs."""

    variable: Var

    name = "quadratic in one variable"

    @property
    def variables(self) -> tuple[Var, ...]:
        return (self.variable,)


def match_quadratic(g: Expr, variables: Sequence[Var]) -> Quadratic | None:
    """A surface of one variable, of degree 2 in it."""
    mine = [v for v in variables if v in g.free]
    if len(mine) != 1 or Shadow((mine[0],)).degree(g) != 2:
        return None
    return Quadratic(mine[0])


def rewrite_quadratic(g: Expr, coefficient: Expr, chain: Chain, data: Quadratic) -> Expr | None:
    """Σ over the two roots of coefficient/√D inside the bounds."""
    (b,) = [b for b in chain if b.var is data.variable]
    rest = tuple(c for c in chain if c.var is not data.variable)
    if any(data.variable in e.free for c in rest for e in (c.lo, c.hi)):
        return None
    roots = quadratic_roots(g, data.variable, b.lo)
    terms = []
    for root in roots.points:
        value = mul(
            ex.integer_power(call("sqrt", roots.discriminant), -1),
            restrict(coefficient, {b.var: root}, g, (b.var,)),
        )
        terms.append(signed_inside(root, b.lo, b.hi, g, b.var, (b.lo, b.hi), value))
    total = where(positive(roots.discriminant, strict=False), add(*terms), ZERO)
    return nest(total, rest)
