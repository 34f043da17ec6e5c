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

from collections.abc import Sequence
from typing import cast

from teg.analysis.expanded import expanded
from teg.analysis.radicals import Root, radical
from teg.ir.expr import FALSE, MINUS_ONE, TRUE, ZERO, Cond, Const, Expr, const
from teg.ir.simplify import add, conjunction, disjunction, integer_power, mul, negation, positive, sub


def without_radical(g: Expr, strict: bool) -> Cond | None:
    """Returns a condition without square roots that holds where g > 0; None if g has no root that ends, or more than a polynomial beside
    its roots. In one variable there is a formula for the roots as they are."""
    found = radical(g)
    if found is None or not found.roots or not found.ends:
        return None
    roots, rest = found
    return _of_one(roots[0], rest, strict, positive(roots[0].factor)) if len(roots) == 1 else _of_two(roots, rest, strict)


def _of_one(root: Root, v: Expr, strict: bool, rising: Cond) -> Cond:
    """Returns the condition root + v > 0 with polynomials; `rising` says whether the root is positive."""
    ends = positive(root.under, strict=False)
    if root.factor is ZERO:
        return conjunction(ends, positive(v, strict))
    norm = root.norm(v)
    more, less, above = (positive(e, strict) for e in (norm, mul(MINUS_ONE, norm), v))
    return conjunction(ends, disjunction(conjunction(rising, disjunction(more, above)), conjunction(negation(rising), less, above)))


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
