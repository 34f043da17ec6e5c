"""The gaps that candidates leave on lines, one line a lane, with static shapes: as many places for gaps as intervals and lines."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from teg.program import PIECE_EPS
from teg.program.arrays import TIE_FROM, TIE_TO, TOUCH

MANY, SHORT = 8, 2**14
"""If lines have more intervals than MANY on average, all pieces of candidates are sorted, and so they are where these are not more than
SHORT."""
COMPARED = 2**20
"""Pairs of numbers that are compared, at most, where places are looked for: up to there that takes less time than a search."""


class LaneGaps(NamedTuple):
    """Places for gaps: their lanes, ends, and whether there is one; and the lanes where it is not known what is covered."""

    lane: Any
    left: Any
    right: Any
    live: Any
    lost: Any


def gaps_of_lanes(values: Any, candidates: tuple[Any, Any], first: Any, last: Any) -> LaneGaps:
    """The gaps between `first` and `last` of each lane.

    `values` are those of `Gaps`, (3·n + 3, candidates); `candidates` are the lane of each, and whether it is live (None: all are).
    """
    size, n = len(first), (len(values) - 3) // 3
    parent, live = candidates
    live = (first < last)[parent] if live is None else live & (first < last)[parent]
    places, flags, ties = values[:n], values[n : 2 * n + 1], values[2 * n + 1 : -1]
    ends = jnp.concatenate([first[parent][None], jnp.minimum(places, last[parent]), last[parent][None]])
    tie = (flags >= TIE_FROM) & (flags <= TIE_TO)
    touching = tie & (jnp.diff(ends, axis=0) < TOUCH * (last - first)[parent])
    before = lax.cummax(jnp.where(touching, -1, jnp.arange(n + 1)[:, None]), axis=0)
    from_piece = jnp.where(before < 0, jnp.argmin(touching, axis=0), before)
    flags = jnp.take_along_axis(jnp.where(tie, ties, flags), from_piece, axis=0, mode="clip")
    unknown = live & (jnp.isnan(places).any(axis=0) | jnp.isnan(flags).any(axis=0))
    lost = jnp.isnan(first) | jnp.isnan(last) | (jax.ops.segment_max(unknown.astype(jnp.int32), parent, size) > 0)
    covered = (flags > TIE_TO) & _is_piece(ends[:-1], ends[1:]) & live
    lanes, p, q = jnp.broadcast_to(parent, covered.shape).reshape(-1), ends[:-1].reshape(-1), ends[1:].reshape(-1)
    there, few = covered.reshape(-1), MANY * size
    if len(p) <= max(2 * few, SHORT):
        lane, left, right, live = _between(jnp.where(there, lanes, size), p, q, first, last)
    else:
        lane, left, right, live = _between_few((there, lanes, p, q), first, last, few)
    return LaneGaps(lane, left, right, live & ~lost[lane], lost)


def places_of(numbers: Any, counts: Any) -> Any:
    """Returns where the entries of these numbers stand, given how many there are up to each place."""
    compared = len(numbers) * len(counts) <= COMPARED
    return jnp.searchsorted(counts, numbers + 1, method="compare_all" if compared else "scan")


def _between_few(intervals: tuple[Any, ...], first: Any, last: Any, few: int) -> tuple[Any, ...]:
    """The places between intervals, of which most are not there: where no more than `few` are, these are brought together first."""
    there, lanes, p, q = intervals
    size, count = len(first), jnp.cumsum(there)

    def all_of_them(_: Any) -> tuple[Any, ...]:
        return _between(jnp.where(there, lanes, size), p, q, first, last)

    def those_there(_: Any) -> tuple[Any, ...]:
        at = places_of(jnp.arange(few), count)
        known, at = at < len(p), jnp.minimum(at, len(p) - 1)
        found = _between(jnp.where(known, lanes[at], size), p[at], q[at], first, last)
        return tuple(jnp.pad(v, (0, len(p) - few)) for v in found)

    return lax.cond(count[-1] <= few, those_there, all_of_them, None)  # type: ignore[no-any-return]


def _between(lane: Any, p: Any, q: Any, first: Any, last: Any) -> tuple[Any, ...]:
    """The places between intervals from p to q: their lanes, ends, and whether there is one. Intervals of the lane `size` are none."""
    size = len(first)
    lane = jnp.concatenate([lane, jnp.arange(size)])
    p, q = jnp.concatenate([p, last]), jnp.concatenate([q, last])  # the end of a line is an interval without length
    lane, p, q = lax.sort((lane, p, q), num_keys=2)
    first = jnp.append(first, 0.0)

    def joined(before: Any, after: Any) -> Any:
        (a, reached), (b, own) = before, after
        return b, jnp.where(a == b, jnp.maximum(reached, own), own)

    _, reached = lax.associative_scan(joined, (lane, q))
    begins = jnp.concatenate([jnp.ones(1, bool), lane[1:] != lane[:-1]])
    left = jnp.where(begins, first[lane], jnp.maximum(first[lane], jnp.roll(reached, 1)))
    return jnp.minimum(lane, size - 1), left, p, (lane < size) & _is_piece(left, p)


def _is_piece(p: Any, q: Any) -> Any:
    return q - p > PIECE_EPS * jnp.maximum(jnp.abs(p), jnp.abs(q))
