"""Conditions that are equivalent in other words: shorter forms of a surface, and whether two surfaces coincide.

    f(u) - f(v) > 0   is   u - v > 0           where f increases on all numbers: exp, sinh, tanh, atan, erf, odd powers
    f(u) - f(v) > 0   is   v - u > 0           where f decreases on all numbers: erfc
    f(u) - f(v) > 0   is   (u - v)(u + v) > 0  where f increases with |u|: cosh, even powers
    eᵘ - 1 > 0        is   u > 0
    eᵘ¹·eᵘ² - eᵛ > 0  is   u1 + u2 - v > 0     however many factors there are
    c·hᵏ > 0          is   c > 0               almost everywhere for even k; it is c·h > 0 for odd k, also where the power is written out

A surface whose slope is 0 all along it has no δ; the shorter form has one. Functions that are not defined everywhere (log, √, other
powers, asin) keep their form, because a condition on them is NaN outside of their domain; `coincide` looks through them all the same,
and through sums of logarithms: log u + 2·log v - log w is 0 where u·v² = w.
Whether a polynomial is a power, or shares a factor with another one, is decided by its values in GF(P), like all questions of structure
(`teg.analysis.polynomial`); where functions obey an identity, by numbers (`teg.analysis.numeric_zeros`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import islice
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import perfect_power
from teg.analysis.field_polynomials import coefficients, common_factor, derivative, one_root
from teg.analysis.numeric_zeros import is_zero_on
from teg.analysis.polynomial import Point, Shadow
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Const, Expr, Mul, Param, Pow, Var, const
from teg.ir.node import postorder
from teg.ir.simplify import add, call, integer_power, mul, sub
from teg.ir.traverse import substitute
from teg.numerics.field import P, divided

MAX_DEGREE = 24
"""The largest degree of polynomials whose common factors are computed."""
MAX_ROOT_DEGREE = 8
"""The largest degree of polynomials whose roots in the field are computed."""
TRIALS = 40
"""The largest number of random points tried. Half of all quadratics have no root in the field, so a few may not do."""
SMALLEST = Fraction(2) ** -1000
"""Numbers from it to its inverse are float64, and so are their roots."""
POINTS = 2
"""The number of points that are enough."""

_INCREASING = frozenset(("exp", "expm1", "sinh", "tanh", "atan", "erf"))
_INCREASING_WHERE_DEFINED = _INCREASING | {"log", "log1p", "sqrt", "root", "asin", "erfinv"}


def short_form(g: Expr) -> Expr:
    """Returns a surface with the sign of g almost everywhere: no increasing function in front, no power written out."""
    g = peeled(g)
    power = perfect_power(g) if isinstance(g, Add) and any(_is_multiple(g, v) for v in sorted(g.free, key=lambda v: v.name)) else None
    if power is None:
        return _as_lines(g) if isinstance(g, Add) and len(g.free) > 1 else g
    factor, base, k = power
    return mul(ONE if factor > 0 else MINUS_ONE, integer_power(base, 2) if k % 2 == 0 else base)


def _as_lines(g: Add) -> Expr:
    """Returns two factors with the sign of a quadratic polynomial that has them, u² - 3uv + 2v² = (u - v)(u - 2v), and of one without real
    factors, u² + v², its curvature; g where it is no product.

    A product of surfaces crosses itself, and where it does second derivatives have terms of their own.
    """
    for v in sorted(g.free, key=lambda v: v.name):
        if Shadow((v,)).degree(g) != 2:
            continue
        rate = slope(g, v)
        curvature = slope(rate, v)
        at_zero = cast(Expr, substitute(rate, {v: ZERO}))
        discriminant = sub(integer_power(at_zero, 2), mul(const(2.0), curvature, cast(Expr, substitute(g, {v: ZERO}))))
        if not isinstance(curvature, Const) or not any(_is_multiple(discriminant, w) for w in sorted(g.free - {v}, key=lambda w: w.name)):
            continue
        power = perfect_power(discriminant)
        if power is None or power[2] % 2:
            continue
        factor, base, k = power
        if factor < 0:
            return curvature
        if not SMALLEST < factor < 1 / SMALLEST:
            continue
        middle, apart = add(mul(curvature, v), at_zero), mul(const(math.sqrt(factor)), integer_power(base, k // 2))
        return mul(curvature, sub(middle, apart), add(middle, apart))
    return g


def peeled(g: Expr, partial: bool = False) -> Expr:
    """Returns a surface with the sign of g, without an increasing function in front of both of its terms.

    With `partial`, functions that are not defined everywhere count too: then only the zeros are the same, where both are defined.
    """
    while True:
        inner = _without_function(g, partial)
        if inner is None:
            return g
        g = inner


def coincide(f: Expr, g: Expr) -> bool:
    """Returns whether two surfaces have a component in common: they then meet all along it, and not at places of their own.

    A polynomial of one symbol shares a factor with the other one, or the other one is 0 at its roots. A no is no proof.
    """
    f, g = peeled(f, partial=True), peeled(g, partial=True)
    return any(_share_zeros(f, g, v) for v in sorted(f.free & g.free, key=lambda v: v.name))


def _share_zeros(f: Expr, g: Expr, v: Var) -> bool:
    p, q = _coefficients(f, v), _coefficients(g, v)
    if p and q:
        return max(len(p), len(q)) <= MAX_DEGREE + 1 and len(common_factor(p, q)) > 1
    return (bool(p) and ZeroSet(f).annuls(g)) or (bool(q) and ZeroSet(g).annuls(f)) or is_zero_on(f, g)


class ZeroSet:
    """Random points of the surface g = 0. All symbols but one get random values; the remaining one is solved for in the field.

    A variable in which g is affine is preferred, then a parameter, then a variable in which g is a polynomial of low degree.
    """

    def __init__(self, g: Expr) -> None:
        self._surface = peeled(g, partial=True)
        self._points = _points_on(self._surface)

    def annuls(self, e: Expr) -> bool:
        """Returns whether e is 0 at all of the points, where a wrong yes has probability below 1e-100; or else numerically."""
        return (bool(self._points) and all(point.value(e) == 0 for point in self._points)) or is_zero_on(e, self._surface)


def _points_on(g: Expr) -> list[Point]:
    """Returns random points of a surface."""
    return [Point(salt, {symbol: place}) for salt, symbol, place in _places_on(g)]


@lru_cache(maxsize=256)
def _places_on(g: Expr) -> tuple[tuple[str, Expr, int], ...]:
    """Returns random points of a surface: a salt for all its symbols but one, this one, and where it is then.

    Kept for the next time: one surface is compared with all others of its integrals.
    """
    symbols = sorted((n for n in postorder([g]) if isinstance(n, Var | Param)), key=lambda n: isinstance(n, Param))
    for pivot in symbols:
        first = _affine_zero(g, pivot, "0")
        second = None if first is None else _affine_zero(g, pivot, "1")
        if first is not None and second is not None and not _is_everywhere(g, "0", pivot, first):
            return ("0", pivot, first), ("1", pivot, second)
    for v in symbols:
        if isinstance(v, Var) and 2 <= (Shadow((v,)).degree(g) or 0) <= MAX_ROOT_DEGREE:
            roots = ((str(trial), one_root(_coefficients(g, v, str(trial)))) for trial in range(TRIALS))
            return tuple(islice(((trial, v, root) for trial, root in roots if root is not None), POINTS))
    return ()


def _affine_zero(g: Expr, pivot: Expr, trial: str) -> int | None:
    """Returns where the pivot is on g = 0 if g is affine in it, else None."""
    zero, one, two = (Point(trial, {pivot: k}).value(g) for k in range(3))
    if zero is None or one is None or two is None or (two - 2 * one + zero) % P or (one - zero) % P == 0:
        return None
    return divided(-zero, one - zero)


def _is_everywhere(g: Expr, trial: str, pivot: Expr, place: int) -> bool:
    """Returns whether g is 0 there whatever its variables are, as a·(y - b) is at a = 0: that is no point of the surface."""
    if not g.free or isinstance(pivot, Var):
        return False
    others = {v: Point(trial + " moved").value(v) for v in g.free}
    return Point(trial, {pivot: place, **{v: cast(int, k) for v, k in others.items()}}).value(g) == 0


def _coefficients(g: Expr, v: Var, salt: str = "") -> list[int]:
    """Returns the coefficients of g as a polynomial of v in the field; those of 0 if it is none."""
    return coefficients(Shadow((v,), salt=salt).polynomial(g) or {})


def _is_multiple(g: Expr, v: Var) -> bool:
    """Returns whether g is a polynomial of v with a repeated factor."""
    p = _coefficients(g, v)
    return 2 < len(p) <= MAX_DEGREE + 1 and len(common_factor(p, derivative(p))) > 1


def _without_function(g: Expr, partial: bool) -> Expr | None:
    if not isinstance(g, Add):
        return None
    product = _without_logarithms(g) if partial else None
    if product is not None or len(g.children) != 2:
        return product
    (a, first), (b, second) = (_split(c) for c in g.children)
    if a != -b or not a:
        return None
    above, below = (first, second) if a > 0 else (second, first)
    if below is ONE and isinstance(above, Call) and above.name == "exp":
        return above.children[0]
    if above is ONE and isinstance(below, Call) and below.name == "exp":
        return mul(MINUS_ONE, below.children[0])
    exponents = [_exponent_of_e(e) for e in (above, below)]
    if exponents[0] is not None and exponents[1] is not None:
        return sub(exponents[0], exponents[1])
    if {e.name for e in (above, below) if isinstance(e, Call)} == {"log", "log1p"}:  # log1p of variables is written log(1 + u)
        above, below = (call("log", add(ONE, e.children[0])) if e.name == "log1p" else e for e in cast("tuple[Call, Call]", (above, below)))
    if isinstance(above, Call) and isinstance(below, Call) and above.name == below.name:
        u, v = above.children[0], below.children[0]
        if above.name in (_INCREASING_WHERE_DEFINED if partial else _INCREASING):
            return sub(u, v)
        if above.name == "erfc":
            return sub(v, u)
        if partial and (above.name == "acos" or (above.name == "pow" and above.children[1] is below.children[1])):
            return sub(u, v) if above.name == "pow" else sub(v, u)
        if above.name == "cosh":  # cosh increases with |u|
            return sub(integer_power(u, 2), integer_power(v, 2))
    for k in sorted({k for e in (above, below) for k in _exponents(e) if k > 1}, reverse=True):
        roots = [_root_of(e, k) for e in (above, below)]
        if roots[0] is None or roots[1] is None:
            continue
        if k % 2:
            return sub(roots[0], roots[1])
        return mul(sub(roots[0], roots[1]), add(roots[0], roots[1]))
    return None


def without_denominators(*terms: Expr) -> list[Expr]:
    """Returns the terms times all of their denominators, each in its largest power, and the product of these."""
    below: dict[Expr, int] = {}
    for term in terms:
        for f in _factors(term):
            if isinstance(f, Pow) and f.exponent < 0:
                below[f.base] = max(below.get(f.base, 0), -f.exponent)
    product = mul(*(integer_power(base, k) for base, k in below.items()))
    return [*(mul(term, product) for term in terms), product]


def _without_logarithms(g: Add) -> Expr | None:
    """Returns u·v² - w for log u + 2·log v - log w; None if g is no sum of logarithms with small whole factors."""
    sides: tuple[list[Expr], list[Expr]] = ([], [])
    terms: list[tuple[float, Expr]] = [(1.0, g)]
    while terms:
        outer, term = terms.pop()
        if len(terms) + len(sides[0]) + len(sides[1]) > MAX_DEGREE:
            return None
        inner, e = _split(term)
        k = outer * inner
        if isinstance(e, Add):
            terms += [(k, c) for c in reversed(e.children)]
            continue
        if not (isinstance(e, Call) and e.name in ("log", "log1p") and k == int(k) and 0 < abs(k) <= MAX_ROOT_DEGREE):
            return None
        u = e.children[0]
        sides[k < 0].append(integer_power(add(ONE, u) if e.name == "log1p" else u, abs(int(k))))
    return sub(mul(*sides[0]), mul(*sides[1]))


def _exponent_of_e(e: Expr) -> Expr | None:
    """Returns u + v for eᵘ·eᵛ; None if e is no product of exponentials."""
    exponentials = [f for f in _factors(e) if isinstance(f, Call) and f.name == "exp"]
    return add(*(f.children[0] for f in exponentials)) if len(exponentials) == len(_factors(e)) else None


def _split(e: Expr) -> tuple[float, Expr]:
    """Returns the numerical factor of a term, and the term without it."""
    if isinstance(e, Const):
        return e.data, ONE
    if isinstance(e, Mul) and isinstance(e.children[0], Const):
        return e.children[0].data, mul(*e.children[1:])
    return 1.0, e


def _factors(e: Expr) -> Sequence[Expr]:
    return cast("Sequence[Expr]", e.children if isinstance(e, Mul) else (e,))


def _exponents(e: Expr) -> list[int]:
    return [f.exponent for f in _factors(e) if isinstance(f, Pow)]


def _root_of(e: Expr, k: int) -> Expr | None:
    """Returns the k-th root of a product of k-th powers; None if e is no such product."""
    if not all(f is ONE or (isinstance(f, Pow) and f.exponent % k == 0) for f in _factors(e)):
        return None
    return mul(*(integer_power(f.base, f.exponent // k) if isinstance(f, Pow) else f for f in _factors(e)))
