"""The gaps that candidates leave on lines, one line a lane, with static shapes: as many places for gaps as intervals and lines."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from teg.program import PIECE_EPS
from teg.program.arrays import TIE_FROM, TIE_TO, TOUCH


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
    live = jnp.ones(parent.shape, bool) if live is None else live
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
    lane = jnp.concatenate([jnp.where(covered, parent, size).reshape(-1), jnp.arange(size)])
    p = jnp.concatenate([ends[:-1].reshape(-1), last])  # the end of a line is an interval without length
    q = jnp.concatenate([ends[1:].reshape(-1), last])
    order = jnp.lexsort((p, lane))
    lane, p, q = lane[order], p[order], q[order]
    first = jnp.append(first, 0.0)

    def joined(before: Any, after: Any) -> Any:
        (a, reached), (b, own) = before, after
        return b, jnp.where(a == b, jnp.maximum(reached, own), own)

    _, reached = lax.associative_scan(joined, (lane, q))
    begins = jnp.concatenate([jnp.ones(1, bool), lane[1:] != lane[:-1]])
    left = jnp.where(begins, first[lane], jnp.maximum(first[lane], jnp.roll(reached, 1)))
    there = (lane < size) & _is_piece(left, p)
    lane = jnp.minimum(lane, size - 1)
    return LaneGaps(lane, left, p, there & ~lost[lane], lost)


def _is_piece(p: Any, q: Any) -> Any:
    return q - p > PIECE_EPS * jnp.maximum(jnp.abs(p), jnp.abs(q))
