"""Quadrature tables on (-1, 1), to full double precision, for every backend.

Gauss-Legendre: the nodes are the roots of the Legendre polynomial P_n, the weights 2/((1 - x²)·P_n'(x)²).
They are found by Newton's method, in doubles and then in 40 decimal digits, and rounded once at the end.

Null rules: what the values at the n Gauss nodes say of the highest coefficients of the integrand in Legendre polynomials, and so of the
error (Lyness 1965; Laurie 1994; Berntsen and Espelid 1991). Gauss-Legendre integrates degree 2n - 1, the nodes see degree n - 1: where the
coefficients decay by r from one pair of degrees to the next, the error is about r^(n/2) times the last pair.
"""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from functools import cache
from typing import TypeVar

Table = tuple[tuple[float, ...], tuple[float, ...]]
Number = TypeVar("Number", float, Decimal)


@cache
def gauss_legendre(n: int) -> Table:
    """The n nodes (ascending) and weights (of sum 2) of Gauss-Legendre on (-1, 1); exact to degree 2n - 1."""
    if n < 1:
        raise ValueError(f"a Gauss rule has at least one node, not {n}")
    with localcontext() as context:
        context.prec = 40
        right = [_node(n, i) for i in range(n // 2)]
        middle = [(0.0, _weight(n, Decimal(0)))] if n % 2 else []
    left = [(-x, w) for x, w in right]
    nodes, weights = zip(*left, *middle, *reversed(right), strict=True)
    return nodes, weights


def _node(n: int, i: int) -> tuple[float, float]:
    """The i-th node from the right, and its weight."""
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
    """P_n(x) and its derivative, by the three-term recurrence."""
    before, value = x * 0 + 1, x
    for k in range(2, n + 1):
        before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
    return value, n * (before - x * value) / (1 - x * x)


NULL_RULES = 6


@cache
def null_rules(n: int) -> tuple[tuple[float, ...], ...]:
    """Six rows of weights on the n Gauss nodes, of the highest degree first: they measure what a polynomial of degree n - 1 misses.

    Row i gives the coefficient of f in the orthonormal Legendre polynomial of degree n - 1 - i; a row below degree 1 is 0. With one node
    the first row is the rule itself.
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
    return tuple(rows)


def decay_power(n: int) -> int:
    """How often the decay from one pair of coefficients to the next is counted on, beyond the last pair, for n nodes: half of the (n + 1)/2
    times that an analytic function allows. More of it misses what a slow part hidden behind a fast one does (tests/bench/estimates.py)."""
    return round(0.25 * (n + 1)) if n >= 8 else n // 6
