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
    """Places for gaps: their lanes, whether there is one, and their ends, left and right, behind which the velocities of these stand if
    ends move; and the lanes where it is not known what is covered."""

    lane: Any
    live: Any
    ends: tuple[Any, ...]
    lost: Any


class Line(NamedTuple):
    """The ends of the line of each lane, and if they move their velocities, and those of the places of candidates, (n, candidates)."""

    first: Any
    last: Any
    outer: tuple[Any, ...] = ()
    velocities: Any = None


def gaps_of_lanes(values: Any, candidates: tuple[Any, Any], line: Line) -> LaneGaps:
    """The gaps between the ends of the line of each lane.

    `values` are those of `Gaps`, (3·n + 3, candidates); `candidates` are the lane of each, and whether it is live (None: all are).
    """
    first, last = line.first, line.last
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
    intervals = [ends[:-1], ends[1:]]
    if line.outer:
        moving = jnp.pad(line.velocities, ((1, 1), (0, 0)))  # those of first and last are not asked for: nothing is seen on the other side
        intervals += [moving[:-1], moving[1:]]
    lanes, *intervals = (v.reshape(-1) for v in (jnp.broadcast_to(parent, covered.shape), *intervals))
    there, few = covered.reshape(-1), MANY * size
    if len(there) <= max(2 * few, SHORT):
        lane, live, *found = _between((jnp.where(there, lanes, size), *intervals), line)
    else:
        lane, live, *found = _between_few((there, lanes, *intervals), line, few)
    return LaneGaps(lane, live & ~lost[lane], tuple(found), lost)


def places_of(numbers: Any, counts: Any) -> Any:
    """Returns where the entries of these numbers stand, given how many there are up to each place."""
    compared = len(numbers) * len(counts) <= COMPARED
    return jnp.searchsorted(counts, numbers + 1, method="compare_all" if compared else "scan")


def _between_few(intervals: tuple[Any, ...], line: Line, few: int) -> tuple[Any, ...]:
    """The places between intervals, of which most are not there: where no more than `few` are, these are brought together first."""
    there, lanes, *ends = intervals
    size, count, every = len(line.first), jnp.cumsum(there), len(there)

    def all_of_them(_: Any) -> tuple[Any, ...]:
        return _between((jnp.where(there, lanes, size), *ends), line)

    def those_there(_: Any) -> tuple[Any, ...]:
        at = places_of(jnp.arange(few), count)
        known, at = at < every, jnp.minimum(at, every - 1)
        found = _between((jnp.where(known, lanes[at], size), *(end[at] for end in ends)), line)
        return tuple(jnp.pad(v, (0, every - few)) for v in found)

    return lax.cond(count[-1] <= few, those_there, all_of_them, None)  # type: ignore[no-any-return]


def _between(intervals: tuple[Any, ...], line: Line) -> tuple[Any, ...]:
    """The places between intervals, of which the lanes and ends are given: their lanes, whether there is one, and its ends. Intervals of
    the lane `size` are none."""
    size = len(line.first)
    last = jnp.arange(size), line.last, line.last, *(line.outer[1:] * 2)  # the end of a line is an interval without length
    lane, p, q, *velocities = lax.sort(tuple(jnp.concatenate(pair) for pair in zip(intervals, last, strict=True)), num_keys=2)

    def joined(before: Any, after: Any) -> Any:
        (a, reached, *v), (b, own, *w) = before, after
        further = (a == b) & (reached > own)
        return b, jnp.where(further, reached, own), *(jnp.where(further, x, y) for x, y in zip(v, w, strict=True))

    _, *reached = lax.associative_scan(joined, (lane, q, *velocities[1:]))
    begins = jnp.concatenate([jnp.ones(1, bool), lane[1:] != lane[:-1]])
    first, *outer = (jnp.append(v, 0.0)[lane] for v in (line.first, *line.outer[:1]))
    before = [jnp.roll(v, 1) for v in reached]
    here = begins | (before[0] < first)
    left, *moving = (jnp.where(here, v, w) for v, w in zip((first, *outer), before, strict=True))
    return jnp.minimum(lane, size - 1), (lane < size) & _is_piece(left, p), left, p, *moving, *velocities[:1]


def _is_piece(p: Any, q: Any) -> Any:
    return q - p > PIECE_EPS * jnp.maximum(jnp.abs(p), jnp.abs(q))
