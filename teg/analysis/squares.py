"""Quadratics that are written as sums of squares: Σ cᵢ·(pᵢx + qᵢ)² + k.

    B² - 4AC  =  -4·(Σᵢ<ⱼ cᵢcⱼ·(pᵢqⱼ - pⱼqᵢ)² + k·Σ cᵢpᵢ²)                                             (Lagrange's identity)

On the right, terms of the size of cᵢ²pᵢ²qᵢ² have cancelled: for a thin ellipse that leans they are larger by the square of its aspect.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.ir.expr import ONE, Add, Expr, Mul, Pow, Var, const
from teg.ir.simplify import add, integer_power, mul, sub
from teg.ir.traverse import substitute

Squares = list[tuple[Expr, Expr]]
"""Factors, which do not depend on the variables, and affine functions of these, whose squares they multiply."""


def squares_in(g: Expr, variables: Sequence[Var]) -> tuple[Squares, list[Expr]] | None:
    """Returns the squares of which g is a sum in some variables, and the terms without the variables; None if there are other terms."""
    moving = set(variables)
    squares: Squares = []
    others: list[Expr] = []
    terms: Squares = [(ONE, g)]
    while terms:
        factor, term = terms.pop()
        if term.free.isdisjoint(moving):
            others.append(mul(factor, term))
        elif isinstance(term, Add):
            terms += [(factor, c) for c in reversed(cast("Sequence[Expr]", term.children))]
        elif isinstance(term, Mul):
            parts = cast("Sequence[Expr]", term.children)
            inside = [c for c in parts if not c.free.isdisjoint(moving)]
            if len(inside) != 1:
                return None
            terms.append((mul(factor, *(c for c in parts if c is not inside[0])), inside[0]))
        elif isinstance(term, Pow) and term.exponent == 2:
            squares.append((factor, term.base))
        else:
            return None
    return (squares, others) if all(Shadow(variables).degree(base) == 1 for _, base in squares) else None


def discriminant_of_squares(g: Expr, x: Var, origin: Expr) -> Expr | None:
    """Returns B² - 4AC of a quadratic in x by Lagrange's identity; None if it is not written with squares."""
    split = squares_in(g, (x,))
    if split is None:
        return None
    factors, bases = zip(*split[0], strict=True)
    rates = [slope(base, x) for base in bases]
    values = [cast(Expr, substitute(base, {x: origin})) for base in bases]
    products = [
        mul(factors[i], factors[j], integer_power(sub(mul(rates[i], values[j]), mul(rates[j], values[i])), 2))
        for i, j in combinations(range(len(bases)), 2)
    ]
    leading = add(*(mul(c, integer_power(p, 2)) for c, p in zip(factors, rates, strict=True)))
    return mul(const(-4.0), add(*products, mul(add(*split[1]), leading)))
