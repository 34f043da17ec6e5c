"""Conditions on a square root of a polynomial beside a polynomial, by squares.

    k·√u + v > 0   ⇔   u >= 0  and  (u - (v/k)² > 0  or  v > 0)        for k > 0
                        u >= 0  and   u - (v/k)² < 0  and  v > 0        for k < 0

The sphere over a disk, √(a - x² - y²), is such a root: light on it (`0.4·x + 0.3·y + 0.5·√(a - x² - y²) > t`) ends at an ellipse that
touches the border of the disk, and there the slope of the root is infinite. The ellipse has a slope everywhere, and a formula. Which one of
two spheres is nearer, √u - √w + c > 0, is squared twice. Only roots that end somewhere (u < 0) are treated in this way, where all that is
left are polynomials. k has no variables; if its sign is not known, u is multiplied by k² instead. What these conditions say about each
other on their surfaces is decided in `teg.analysis.implied`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import expanded
from teg.analysis.extents import extent
from teg.analysis.polynomial import Shadow
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Call, Cond, Const, Expr, Var, const
from teg.ir.node import postorder
from teg.ir.simplify import add, conjunction, disjunction, integer_power, mul, negation, positive, sub
from teg.ir.traverse import fresh, rewrite, substitute

MOST_DEGREE = 2
"""The largest degree of a polynomial under a root."""


class Root(NamedTuple):
    """factor·√under, where the factor has no variables."""

    factor: Expr
    under: Expr


def without_radical(g: Expr, strict: bool) -> Cond | None:
    """Returns a condition without square roots that is g > 0; None if g has no root that ends, or more than polynomials beside roots."""
    if len(g.free) < 2:
        return None  # in one variable there is a formula as it is
    roots = [cast(Call, n) for n in postorder([g]) if isinstance(n, Call) and n.free]
    if not 0 < len(roots) <= 2 or any(n.name != "sqrt" for n in roots):
        return None
    under = [cast(Expr, r.children[0]) for r in roots]
    if all(extent(u, {})[0] >= 0.0 for u in under) or not all(_is_polynomial(u, MOST_DEGREE) for u in under):
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
    terms = [Root(k, u) for k, u in zip(factors, under, strict=True)]
    return _of_one(terms[0], rest, strict) if len(terms) == 1 else _of_two(terms, rest, strict)


def _of_one(root: Root, v: Expr, strict: bool, rising: Cond | None = None) -> Cond:
    """Returns the condition k·√u + v > 0 with polynomials; `rising` says whether k > 0."""
    k, u = root
    ends = positive(u, strict=False)
    if k is ZERO:
        return conjunction(ends, positive(v, strict))
    if rising is None:
        rising = positive(k)
    weight, scale = (ONE, const(k.data**-2)) if isinstance(k, Const) else (integer_power(k, 2), ONE)
    difference = sub(mul(weight, u), mul(scale, integer_power(v, 2)))
    more, less, above = (positive(e, strict) for e in (difference, mul(MINUS_ONE, difference), v))
    inside = disjunction(conjunction(rising, disjunction(more, above)), conjunction(negation(rising), less, above))
    return conjunction(ends, inside)


def _of_two(roots: Sequence[Root], c: Expr, strict: bool) -> Cond | None:
    """Returns the condition that a difference of roots and c, which has no variables, is positive; None for sums of roots.

    Both sides are squared where both are positive: √u > √w - c for c <= 0, √u + c > √w otherwise.
    """
    if c.free or not all(isinstance(r.factor, Const) for r in roots):
        return None
    (k, u), (j, w) = sorted(roots, key=lambda r: -cast(Const, r.factor).data)
    if not cast(Const, j).data < 0.0 < cast(Const, k).data:
        return None
    difference = sub(mul(integer_power(k, 2), u), mul(integer_power(j, 2), w))
    if (short := expanded(difference)) is not None:
        difference = short
    higher, square, two = positive(c), integer_power(c, 2), const(2.0)
    above = _of_one(Root(mul(two, c, k), u), add(difference, square), strict, TRUE)
    below = _of_one(Root(mul(MINUS_ONE, two, c, j), w), sub(difference, square), strict, FALSE)
    ends = (positive(e, strict=False) for e in (u, w))
    return conjunction(*ends, disjunction(conjunction(higher, above), conjunction(negation(higher), below)))


def _is_polynomial(e: Expr, most: float = math.inf) -> bool:
    degree = Shadow(tuple(e.free)).degree(e)
    return degree is not None and degree <= most
