"""Quadrature tables on (-1, 1), to full double precision, for every backend.

Gauss-Legendre: the nodes are the roots of the Legendre polynomial P_n, the weights 2/((1 - x²)·P_n'(x)²). They are found by Newton's
method, in doubles and then in 40 decimal digits, and rounded once at the end.

Null rules: estimates, from the values at the n Gauss nodes, of the highest coefficients of the integrand in Legendre polynomials, and so
of the error (Lyness 1965; Laurie 1994; Berntsen and Espelid 1991). Gauss-Legendre integrates degree 2n - 1, the nodes see degree n - 1:
where the coefficients decay by r from one pair of degrees to the next, the error is about r^(n/2) times the last pair.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache
from typing import TypeVar

Table = tuple[tuple[float, ...], tuple[float, ...]]
Number = TypeVar("Number", float, Decimal)


@cache
def gauss_legendre(n: int) -> Table:
    """Returns the n nodes (ascending) and weights (of sum 2) of Gauss-Legendre on (-1, 1); exact to degree 2n - 1."""
    if n < 1:
        raise ValueError(f"a Gauss rule has at least one node, not {n}")
    with localcontext() as context:
        context.prec = 40
        right = [_node(n, i) for i in range(n // 2)]
        middle = [(0.0, _weight(n, Decimal(0)))] if n % 2 else []
    left = [(-x, w) for x, w in right]
    nodes, weights = zip(*left, *middle, *reversed(right), strict=True)
    return nodes, weights


@cache
def triangle_rule(degree: int) -> tuple[tuple[float, float, float], ...]:
    """Returns nodes (r, s) and weights (of sum 1) on the triangle (0, 0), (1, 0), (0, 1), exact to a degree in r and s together.

    To degree 1 its centre, to 2 the middles of its sides, to 4 the six nodes of Cowper (1973; Strang and Fix); above that Gauss-Legendre
    in r = u and s = (1 - u)·v, with one more node in u where the Jacobian 1 - u needs it (Stroud 1971). All weights are positive.
    """
    if degree <= 1:
        return ((1 / 3, 1 / 3, 1.0),)
    if degree == 2:
        return ((0.5, 0.0, 1 / 3), (0.5, 0.5, 1 / 3), (0.0, 0.5, 1 / 3))
    if degree <= 4:
        root = math.sqrt(38.0 - 44.0 * math.sqrt(0.4))
        rule: list[tuple[float, float, float]] = []
        for sign in (1.0, -1.0):
            near = (8.0 - math.sqrt(10.0) + sign * root) / 18.0
            weight = (620.0 + sign * math.sqrt(213125.0 - 53320.0 * math.sqrt(10.0))) / 3720.0
            far = 1.0 - 2.0 * near
            rule += [(near, near, weight), (near, far, weight), (far, near, weight)]
        return tuple(rule)
    (us, uw), (vs, vw) = gauss_legendre(degree // 2 + degree % 2 + 1), gauss_legendre(degree // 2 + 1)
    return tuple(
        (0.5 + 0.5 * u, (0.5 - 0.5 * u) * (0.5 + 0.5 * v), (0.5 - 0.5 * u) * 0.5 * wu * wv)
        for u, wu in zip(us, uw, strict=True)
        for v, wv in zip(vs, vw, strict=True)
    )


@cache
def tetrahedron_rule(degree: int) -> tuple[tuple[float, float, float, float], ...]:
    """Returns nodes (r, s, t) and weights (of sum 1) on the tetrahedron of the origin and the unit vectors, exact to a degree in r, s and t
    together.

    To degree 1 its centre, to 2 the four nodes of Hammer and Stroud (1956); above that Gauss-Legendre in r = u, s = (1 - u)·v and
    t = (1 - u)·(1 - v)·w, with more nodes where the Jacobian needs them (Stroud 1971). All weights are positive.
    """
    if degree <= 1:
        return ((0.25, 0.25, 0.25, 1.0),)
    if degree == 2:
        near, far = (5.0 - math.sqrt(5.0)) / 20.0, (5.0 + 3.0 * math.sqrt(5.0)) / 20.0
        return (near, near, near, 0.25), (far, near, near, 0.25), (near, far, near, 0.25), (near, near, far, 0.25)
    (us, uw), (vs, vw), (ws, ww) = (gauss_legendre((degree + more) // 2 + 1) for more in (2, 1, 0))
    rule: list[tuple[float, float, float, float]] = []
    for u, wu in zip(us, uw, strict=True):
        r, left = 0.5 + 0.5 * u, 0.5 - 0.5 * u
        for v, wv in zip(vs, vw, strict=True):
            s, rest = left * (0.5 + 0.5 * v), left * (0.5 - 0.5 * v)
            rule += [(r, s, rest * (0.5 + 0.5 * w), 0.75 * wu * wv * wt * left * rest) for w, wt in zip(ws, ww, strict=True)]
    return tuple(rule)


def _node(n: int, i: int) -> tuple[float, float]:
    """Returns the i-th node from the right, and its weight."""
    guess = math.cos(math.pi * (i + 0.75) / (n + 0.5))
    for _ in range(8):
        value, slope = _legendre(n, guess)
        guess -= value / slope
    x = Decimal(guess)
    for _ in range(2):
        exact, steep = _legendre(n, x)
        x -= exact / steep
    return float(x), _weight(n, x)


def _weight(n: int, x: Decimal) -> float:
    slope = _legendre(n, x)[1]
    return float(2 / ((1 - x * x) * slope * slope))


def _legendre(n: int, x: Number) -> tuple[Number, Number]:
    """Returns P_n(x) and its derivative, by the three-term recurrence."""
    before, value = x * 0 + 1, x
    for k in range(2, n + 1):
        before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
    return value, n * (before - x * value) / (1 - x * x)


SERIES_DIGITS = 17


@dataclass(frozen=True)
class PoleTable:
    """Tables for the weights of n Gauss nodes for polynomials over (1 + z·u)^m, by the moments μ(l, j) = ∫ uʲ/(1 + z·u)ˡ du.

    With μ(0, j) = 2/(j + 1) or 0, they satisfy μ(l, j) + z·μ(l, j + 1) = μ(l - 1, j). For |z| < `border` the highest one of each l, j =
    n - 1, is Σ series[l - 1][k]·z²ᵏ (times -z if n is even) and the others follow downwards, which is stable; beyond it the lowest one
    has a closed form, and the steps upwards lose no more than LOST. The weights are `lagrange` (n, n) times the moments of l = m.
    """

    border: float
    series: tuple[tuple[float, ...], ...]
    lagrange: tuple[tuple[float, ...], ...]


LOST = 32.0
"""The largest growth of rounding errors in the steps upwards."""


@cache
def pole_table(n: int, m: int) -> PoleTable:
    """Returns the table of n nodes and the power m of the pole."""
    border = max(0.2, LOST ** (-1.0 / max(1, n - 1)))
    terms = 4 * math.ceil((SERIES_DIGITS / (-2.0 * math.log10(border)) + m) / 4)
    top = n - 1
    series = []
    for power in range(1, m + 1):
        first = top % 2  # ∫ u^(i + top) du is 0 for odd i + top
        series.append(tuple(math.comb(power - 1 + i, i) * 2.0 / (i + top + 1) for i in range(first, first + 2 * terms, 2)))
    nodes = [Fraction(x) for x in gauss_legendre(n)[0]]
    rows = []
    for k, x in enumerate(nodes):
        coefficients = [Fraction(1)]
        for i, y in enumerate(nodes):
            if i != k:
                raised, same = [Fraction(0), *coefficients], [*coefficients, Fraction(0)]
                coefficients = [(a - y * b) / (x - y) for a, b in zip(raised, same, strict=True)]
        rows.append(tuple(map(float, coefficients)))
    return PoleTable(border, tuple(series), tuple(rows))


NULL_RULES = 6


@cache
def null_rules(n: int) -> tuple[tuple[float, ...], ...]:
    """Returns six rows of weights on the n Gauss nodes, of the highest degree first: they measure what a polynomial of degree n - 1 misses.

    Row i gives the coefficient of f in the orthonormal Legendre polynomial of degree n - 1 - i; a row below degree 1 is 0. With one node
    the first row is the rule itself, and with two nodes the second one, since the first is 0 for every even function.
    """
    nodes, weights = gauss_legendre(n)
    if n == 1:
        return (weights, *((0.0,),) * (NULL_RULES - 1))
    rows = []
    for degree in range(n - 1, n - 1 - NULL_RULES, -1):
        if degree < 1:
            rows.append((0.0,) * n)
        else:
            norm = math.sqrt(degree + 0.5)
            rows.append(tuple(w * norm * _legendre(degree, x)[0] for x, w in zip(nodes, weights, strict=True)))
    if n == 2:
        rows[1] = weights
    return tuple(rows)


@cache
def end_rule(n: int, inside: float) -> tuple[float, tuple[tuple[float, ...], ...]]:
    """Returns the distance of the outermost of n Gauss nodes from the ends of (-1, 1), and two rows of weights on the nodes: the values at
    both ends, or 2·`inside` away from them, of the polynomial through the values at the nodes."""
    nodes = [Fraction(x) for x in gauss_legendre(n)[0]]
    ends = [sign * (1 - 2 * Fraction(inside)) for sign in (-1, 1)]
    rows = [[math.prod((e - y) / (x - y) for y in nodes if y != x) for x in nodes] for e in ends]
    return float(1 - nodes[-1]), tuple(tuple(map(float, row)) for row in rows)


def decay_power(n: int, closed: bool = False) -> int:
    """Returns the power of the decay, from one pair of coefficients to the next, in the error estimate of n nodes.

    An analytic function allows (n + 1)/2. But its slow part may be hidden behind a fast one: two branch points beside the interval, 1e-4 of
    it apart, show in the last coefficients only, and each power counts on ten to a hundred times what was seen (tests/bench/estimates.py).
    The more so with a closed rule, beside whose intervals there may be branch points that are not known.
    """
    return 4 if n >= 16 and not closed else 2 if n >= 8 else n // 6
