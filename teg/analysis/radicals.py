"""Sums of square roots and a polynomial: Σ kᵢ·√uᵢ + v, with quadratic polynomials uᵢ and factors kᵢ without variables."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.extents import extent
from teg.analysis.polynomial import Shadow
from teg.ir.expr import ONE, ZERO, Call, Const, Expr, Var, const
from teg.ir.node import nodes_of
from teg.ir.simplify import integer_power, mul, sub
from teg.ir.traverse import fresh, rewrite, substitute

MOST_ROOTS = 2
"""The largest number of roots in a sum: the difference of two is squared twice."""
MOST_DEGREE = 2
"""The largest degree of a polynomial under a root."""


class Root(NamedTuple):
    """factor·√under, where the factor has no variables."""

    factor: Expr
    under: Expr

    def norm(self, v: Expr) -> Expr:
        """Returns the product of v + root and v - root, up to a negative factor: u - (v/k)², or k²·u - v² if the sign of k is not known."""
        k, u = self
        weight, scale = (ONE, const(k.data**-2)) if isinstance(k, Const) else (integer_power(k, 2), ONE)
        return sub(mul(weight, u), mul(scale, integer_power(v, 2)))


class Radical(NamedTuple):
    """A sum of roots and a polynomial."""

    roots: tuple[Root, ...]
    rest: Expr

    @property
    def ends(self) -> bool:
        """Whether one of the roots is not real everywhere."""
        return any(extent(r.under, {})[0] < 0.0 for r in self.roots)


def radical(g: Expr) -> Radical | None:
    """Returns an expression as a sum of one or two roots and a polynomial; None if it is none, or depends on one variable alone."""
    return radical_in(g) if len(g.free) > 1 else None


def radical_in(g: Expr) -> Radical | None:
    """Returns the same in any number of variables."""
    roots = [n for n in nodes_of(Call, g) if n.free]
    if not 0 < len(roots) <= MOST_ROOTS or any(n.name != "sqrt" for n in roots):
        return None
    under = [r.children[0] for r in roots]
    if not all(_is_polynomial(u, MOST_DEGREE) for u in under):
        return None
    names: list[Var] = []
    for _ in roots:
        names.append(fresh("s", [*g.free, *names]))
    known = dict(zip(roots, names, strict=True))
    linear = cast(Expr, rewrite([g], lambda old, new: known.get(cast(Call, old), new))[g])
    factors = [slope(linear, s) for s in names]
    rest = cast(Expr, substitute(linear, dict.fromkeys(names, ZERO)))
    if any(k.free for k in factors) or not _is_polynomial(rest):
        return None
    return Radical(tuple(Root(k, u) for k, u in zip(factors, under, strict=True) if k is not ZERO), rest)


def most_zeros(g: Expr, x: Var) -> int | None:
    """Returns the largest number of zeros in x: the degree of the polynomial that squares make of it. None if g is no sum of roots."""
    found = radical_in(g)
    if found is None or not found.roots or any(r.factor.free for r in found.roots):
        return None
    (k, u), *more = found.roots
    square, rest = mul(integer_power(k, 2), u), integer_power(found.rest, 2)
    if not more:
        return Shadow((x,)).degree(sub(square, rest))
    ((j, w),) = more
    other = sub(sub(mul(integer_power(j, 2), w), square), rest)
    return Shadow((x,)).degree(sub(mul(const(4.0), rest, square), integer_power(other, 2)))


def _is_polynomial(e: Expr, most: float = math.inf) -> bool:
    degree = Shadow(tuple(e.free)).degree(e)
    return degree is not None and degree <= most
