"""Quadrature tables on (-1, 1), to full double precision, for every backend.

Gauss-Legendre: the nodes are the roots of the Legendre polynomial P_n, the weights 2/((1 - x²)·P_n'(x)²).
They are found by Newton's method, in doubles and then in 40 decimal digits, and rounded once at the end.

Gauss-Kronrod (10, 21): the published constants of QUADPACK's QK21 (Piessens et al., 1983).
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


_KRONROD_HALF = (  # node, Kronrod weight, from the right end to the middle
    (0.995657163025808080735527280689003, 0.011694638867371874278064396062192),
    (0.973906528517171720077964012084452, 0.032558162307964727478818972459390),
    (0.930157491355708226001207180059508, 0.054755896574351996031381300244580),
    (0.865063366688984510732096688423493, 0.075039674810919952767043140916190),
    (0.780817726586416897063717578345042, 0.093125454583697605535065465083366),
    (0.679409568299024406234327365114874, 0.109387158802297641899210590325805),
    (0.562757134668604683339000099272694, 0.123491976262065851077958109831074),
    (0.433395394129247190799265943165784, 0.134709217311473325928054001771707),
    (0.294392862701460198131126603103866, 0.142775938577060080797094273138717),
    (0.148874338981631210884826001129720, 0.147739104901338491374841515972068),
    (0.000000000000000000000000000000000, 0.149445554002916905664936468389821),
)
_GAUSS_HALF = (  # the weights of the 10-point Gauss rule, on every second of those nodes
    0.066671344308688137593568809893332,
    0.149451349150580593145776339657697,
    0.219086362515982043995534934228163,
    0.269266719309996355091226921569469,
    0.295524224714752870173892994651338,
)

KRONROD_NODES = (*(-x for x, _ in _KRONROD_HALF[:10]), *(x for x, _ in reversed(_KRONROD_HALF)))
"""The 21 Kronrod nodes, ascending."""

KRONROD_WEIGHTS = (*(w for _, w in _KRONROD_HALF[:10]), *(w for _, w in reversed(_KRONROD_HALF)))
"""Their weights, of sum 2."""

GAUSS_WEIGHTS = (*_GAUSS_HALF, *reversed(_GAUSS_HALF))
"""The weights of the embedded 10-point Gauss rule, whose nodes are KRONROD_NODES[1::2]."""
