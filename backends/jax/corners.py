"""Polygons of few corners, clipped by half-planes: each corner is a tuple of its coordinates, scalars that are written out.

    clipped(corners, left, cut, zero)  ->  (corners, left)      one corner more, and whether anything is left

XLA keeps all of it in a few kernels, which it does not do for arrays of corners (`polygon`): there every step is an array in memory. The
results are the same, bit by bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from teg.backends.jax.runtime import Scalar

BITS = 16
"""Bits of an integer that may stand twice in it: more than a polygon has corners."""
ALL = 2**BITS - 1
Corner = tuple[Scalar, ...]
"""A place (x, y), and what else is linear along the sides."""


class Cut(NamedTuple):
    """A half-plane a·x + b·y + c > 0, and whether it `cuts`; `side` is the number of a coordinate and what it is on the border."""

    cuts: Scalar
    a: Scalar
    b: Scalar
    c: Scalar
    side: tuple[int, Scalar] | None = None


def clipped(corners: Sequence[Corner], left: Scalar, by: Cut, zero: Scalar) -> tuple[list[Corner], Scalar]:
    """Returns a convex polygon cut by a half-plane, and whether anything is left; `zero` keeps a product and a sum apart (see
    `python_text`).

    Around the lowest corner, those up to the next ones inside are cut off. Two come instead, the second one at a place of its own. Other
    corners that seem to be outside are on the border, but for rounding, and stay.
    """
    cuts, a, b, c, side = by
    n = len(corners)
    d = [c + (a * p[0] + zero) + (b * p[1] + zero) for p in corners]
    outside = jnp.where(cuts, _bits([v < 0.0 for v in d]), jnp.int32(0))
    cut = _cut_off(d, outside)
    before, behind = (cut << 1) | (cut >> (n - 1)), (cut >> 1) | (cut << (n - 1))  # whether the corner before, behind, is cut off
    first, last = cut & ~before, cut & ~behind
    leaves = [_has(behind & ~cut, i) for i in range(n)]  # the side from a corner to the next one
    enters = [_has(last, i) for i in range(n)]
    starts = [(v, *p) for v, p in zip(d, corners, strict=True)]
    stops = [*starts[1:], starts[0]]
    leaving = _crossing(_one_of(leaves, starts), _one_of(leaves, stops), zero, side)
    entering = _crossing(_one_of(enters, stops), _one_of(enters, starts), zero, side)
    kept = [where(_has(cut, i), where(_has(first, i), leaving, entering), p) for i, p in enumerate(corners)]
    reached = -(first << 1) | -((last >> (n - 1)) & 1)  # the places from that of the second new corner on
    placed = []
    for i in range(n + 1):
        here = where(_has(reached, i), entering, kept[min(i, n - 1)])
        placed.append(where(_has(reached, i - 1), kept[i - 1], here) if i else here)
    return placed, left & (outside != ALL >> (BITS - n))


def _bits(conditions: Sequence[Scalar]) -> Scalar:
    """Returns conditions as bits of an integer, the first one lowest."""
    found = jnp.where(conditions[0], jnp.int32(1), jnp.int32(0))
    for i, condition in enumerate(conditions[1:], 1):
        found = found | jnp.where(condition, jnp.int32(1 << i), jnp.int32(0))
    return found


def _has(bits: Scalar, i: int) -> Scalar:
    """Returns whether an integer has a bit."""
    return bits & (1 << i) != 0


def _cut_off(d: Sequence[Scalar], outside: Scalar) -> Scalar:
    """Returns the corners that are outside, with all others between them and the lowest one, on one of both ways around; as bits.

    All corners stand twice in an integer, (2n,). Upwards, the lowest one is added to those outside, and the carry goes through as many as
    have no gap. Downwards, all below the highest gap is none of them.
    """
    n, least = len(d), d[0]
    for v in d[1:]:
        least = jnp.minimum(least, v)
    equal = _bits([v == least for v in d])
    lowest, twice = equal & -equal, outside | (outside << n)
    upwards = twice & (twice ^ (twice + lowest))
    below = (lowest << n) - 1
    gaps = below & ~twice
    for shift in (1, 2, 4, 8, 16):
        gaps = gaps | (gaps >> shift) if shift < 2 * n else gaps
    downwards = below & ~gaps
    found = upwards | downwards
    return (found | (found >> n)) & (ALL >> (BITS - n))


def _crossing(start: Sequence[Scalar], stop: Sequence[Scalar], zero: Scalar, side: tuple[int, Scalar] | None) -> Corner:
    """Returns where a side from a corner inside to one outside crosses the border; what is given has the distances from it in front."""
    t = start[0] / jnp.where(start[0] == stop[0], 1.0, start[0] - stop[0])
    new = [p + (t * (q - p) + zero) for p, q in zip(start[1:], stop[1:], strict=True)]
    if side is not None:
        new[side[0]] = side[1]
    return tuple(new)


def where(condition: Scalar, one: Sequence[Scalar], other: Sequence[Scalar]) -> Corner:
    """Returns one corner where a condition holds, else another one."""
    return tuple(jnp.where(condition, u, v) for u, v in zip(one, other, strict=True))


def _one_of(conditions: Sequence[Scalar], of: Sequence[Sequence[Scalar]]) -> Corner:
    """Returns those whose condition holds."""
    found = tuple(of[0])
    for condition, values in zip(conditions[1:], of[1:], strict=True):
        found = where(condition, values, found)
    return found
