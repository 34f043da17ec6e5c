"""Polynomials on boxes in two variables, by their coefficients about a corner: what moments in closed form are multiplied with."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial, prod
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import distance
from teg.analysis.nest import Binder, Chain
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import TRUE, ZERO, Add, Expr, Mul, Var, const
from teg.ir.integral import Integral, masses_of
from teg.ir.simplify import add, div, integer_power, mul, nonzero_part, where
from teg.ir.traverse import fresh, replace_node, substitute

Coefficients = dict[tuple[int, int], Expr]
"""The coefficients of xʲyᵏ about the corner of both lower bounds of a box, x being the inner variable."""


def nest_of_two(node: Integral, guarded: bool = False) -> tuple[Chain, Expr] | None:
    """Returns the two integral signs of a nest and its integrand; None for other integrals.

    The body of the outer one may be a sum of products with integrals over one interval; if it may be `guarded`, also 0 where a condition
    of the outer variable fails.
    """
    box: Integral | None = None
    total: list[Expr] = []
    condition, body = nonzero_part(node.body) if guarded else (TRUE, node.body)
    for term in body.children if isinstance(body, Add) else (body,):
        factors = cast("Sequence[Expr]", term.children) if isinstance(term, Mul) else (term,)
        found = [f for f in factors if isinstance(f, Integral)]
        if len(found) != 1 or found[0].body.has_integral or is_unbounded(found[0]) or masses_of(found[0].body, found[0].var) is not None:
            return None
        (inner,) = found
        box = inner if box is None else box
        if (inner.var, inner.lo, inner.hi) != (box.var, box.lo, box.hi) or inner.var is node.var:
            return None
        rest = mul(*(f for f in factors if f is not inner))
        if inner.var in rest.free:
            return None
        total.append(mul(rest, inner.body))
    if box is None:
        return None
    return (Binder(node.var, node.lo, node.hi), Binder(box.var, box.lo, box.hi)), where(condition, add(*total), ZERO)


def coefficients(e: Expr, chain: Chain, scaled: bool = False) -> Coefficients | None:
    """Returns the coefficients of a polynomial that are not known to be 0, relative to the extents of the box if they are `scaled`; None
    if it is none."""
    outer, inner = chain
    x, y = inner.var, outer.var
    width, height = distance(inner.lo, inner.hi), distance(outer.lo, outer.hi)
    found = _taylor(e, {x: inner.lo, y: outer.lo})
    if found is None or not scaled:
        return cast("Coefficients | None", found)
    return {(j, k): mul(c, integer_power(width, j), integer_power(height, k)) for (j, k), c in found.items()}


def coefficients_along(e: Expr, chain: Chain, bases: Sequence[Expr]) -> dict[tuple[int, int, int, int], Expr] | None:
    """Returns the coefficients of xʲyᵏpᵐqⁿ in a polynomial, p and q being affine `bases` as they stand in it; None if it is none."""
    outer, inner = chain
    x, y = inner.var, outer.var
    p = fresh("p", e.free)
    q = fresh("q", {*e.free, p})
    written: dict[Expr, Expr] = {}
    for base, name in zip(bases, (p, q), strict=True):
        factors = cast("Sequence[Expr]", base.children) if isinstance(base, Mul) else (base,)
        moving = [f for f in factors if f.free & {x, y}]
        if len(moving) == 1:
            written[moving[0]] = div(name, mul(*(f for f in factors if f is not moving[0])))
    for node in sorted(written, key=lambda node: isinstance(node, Var)):  # a variable may be in the other one
        e = cast(Expr, replace_node(e, node, written[node]))
    return cast("dict[tuple[int, int, int, int], Expr] | None", _taylor(e, {x: inner.lo, y: outer.lo, p: ZERO, q: ZERO}))


def _taylor(e: Expr, place: dict[Var, Expr]) -> dict[tuple[int, ...], Expr] | None:
    """Returns the coefficients of a polynomial about a place that are not known to be 0; None if it is none."""
    variables = tuple(place)
    if e.has_integral or e.has_delta or any(atoms_of(e, v) for v in variables):
        return None
    poly = Shadow(variables).polynomial(e)
    if poly is None:
        return None
    found: dict[tuple[int, ...], Expr] = {}

    def expand(e: Expr, powers: tuple[int, ...], monomials: Sequence[tuple[int, ...]]) -> None:
        i = len(powers)
        if i == len(variables):
            value = mul(const(1.0 / prod(map(factorial, powers))), cast(Expr, substitute(e, place)))
            if value is not ZERO:
                found[powers] = value
            return
        for k in range(max((m[i] for m in monomials), default=-1) + 1):
            expand(e, (*powers, k), [m for m in monomials if m[i] >= k])
            e = slope(e, variables[i])

    try:
        expand(e, (), list(poly))
    except NotDifferentiableError:
        return None
    return found
