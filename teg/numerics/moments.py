"""Integrals along a branch of a hyperbola with axes along a box, in closed form.

A branch of g = 0, g affine in u and in v, runs from one side of the box to another one. With ξ and η the offsets from the middle of its
chord, from -1 to 1, and z = g_uv·½Δu/g_v there, the measure of its boundary integrals is that of a logarithm,

    η = (ξ + z)/(1 + zξ),   dτ = du/g_v = rate·dξ/(1 + zξ),   rate = ½Δu/g_v

so that on it ξη = (ξ + z - η)/z. All moments are integer combinations of few numbers, which need one logarithm,

    I_jk = ∫ ξʲηᵏ dξ/(1 + zξ)  over (-1, 1)  =  z^((j+k) mod 2)·Σ_q a_q·G_q       (a_q integers)
    G_q = ∫ t^(2q)/(1 - z²t²) dt  over (0, 1) = 1/(2q + 1) + z²·G_(q+1),    G_0 = artanh(z)/z

by I_j0 = T_j, I_0k = (-1)ᵏ·T_k, T_2q = 2·G_q, T_(2q-1) = -2z·G_q, and I_jk = (I_j(k-1) + z·I_(j-1)(k-1) - I_(j-1)k)/z, a division that
is exact. G is computed by a series and downwards if z² is small, and from the logarithm upwards otherwise.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

AMPLIFIED = 50.0
"""The largest growth of the logarithm's rounding errors on the way upwards, at the border to the series."""
LEAST_BORDER = 0.04


@cache
def moment(j: int, k: int) -> tuple[int, ...]:
    """Returns the integers a_q of I_jk, q = 0, 1, …"""
    if k == 0:
        q = (j + 1) // 2
        return (*[0] * q, -2 if j % 2 else 2)
    if j == 0:
        return tuple(-a for a in moment(k, 0)) if k % 2 else moment(k, 0)
    left, corner, below = moment(j, k - 1), moment(j - 1, k - 1), moment(j - 1, k)
    if (j + k) % 2 == 0:
        return _sum((1, left), (1, corner), (-1, below))
    steady = _sum((1, left), (-1, below))  # Σ a_q·G_q, which is z²·Σ a_q·G_(q+1) as its terms 1/(2q + 1) cancel
    return _sum((1, (0, *steady)), (1, corner))


def _sum(*terms: tuple[int, tuple[int, ...]]) -> tuple[int, ...]:
    total = [0] * max(len(row) for _, row in terms)
    for factor, row in terms:
        for q, a in enumerate(row):
            total[q] += factor * a
    while len(total) > 1 and total[-1] == 0:
        total.pop()
    return tuple(total)


class Series(NamedTuple):
    """G of the highest index as a polynomial in z², lowest coefficient first, for z² below the border."""

    border: float
    coefficients: tuple[float, ...]


@cache
def series(top: int) -> Series:
    """Returns the series of G_top."""
    border = max(LEAST_BORDER, AMPLIFIED ** (-1.0 / top)) if top else LEAST_BORDER
    terms = math.ceil(-56 * math.log(2.0) / math.log(border))
    return Series(border, tuple(1.0 / (2 * (top + n) + 1) for n in range(terms)))


def highest(moments: frozenset[tuple[int, int]]) -> int:
    """Returns the highest index of the G needed for some moments, and for the moments of lower powers into which they are shifted."""
    below = {(a, b) for j, k in moments for a in range(j + 1) for b in range(k + 1)}
    return max((len(moment(j, k)) for j, k in below), default=1) - 1
