"""Polynomials on boxes in two variables, by their coefficients about a corner: what moments in closed form are multiplied with."""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial
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
from teg.ir.simplify import add, integer_power, mul, nonzero_part, where
from teg.ir.traverse import substitute

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
    if e.has_integral or e.has_delta or any(atoms_of(e, v) for v in (x, y)):
        return None
    poly = Shadow((x, y)).polynomial(e)
    if poly is None:
        return None
    found: Coefficients = {}
    corner: dict[Var, Expr] = {x: inner.lo, y: outer.lo}
    width, height = distance(inner.lo, inner.hi), distance(outer.lo, outer.hi)
    try:
        for j in range(max((m[0] for m in poly), default=-1) + 1):
            along = e
            for k in range(max(m[1] for m in poly) + 1):
                extents = (integer_power(width, j), integer_power(height, k)) if scaled else ()
                scale = mul(const(1.0 / (factorial(j) * factorial(k))), *extents)
                value = mul(scale, cast(Expr, substitute(along, corner)))
                if value is not ZERO and any(j <= m and k <= n for m, n in poly):
                    found[j, k] = value
                along = slope(along, y)
            e = slope(e, x)
    except NotDifferentiableError:
        return None
    return found
