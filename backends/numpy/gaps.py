"""The gaps that candidates leave on lines, one line a lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.program import PIECE_EPS
from teg.program.arrays import TIE_FROM, TIE_TO, TOUCH

Array = npt.NDArray[Any]


def covered_by(values: Array, first: Array, last: Array, velocities: Array | None = None) -> tuple[Array, tuple[Array, ...]]:
    """Returns the candidates of which it is not known what they cover, and what the others cover: a candidate, p and q for each interval,
    and if places move the velocities of p and q. Those of first and last are not asked for: nothing is seen on the other side.

    `values` are those of `Gaps`, (3·n + 3, candidates); `first` and `last` are the ends of the line of each candidate; `velocities` are
    those of the n places.
    """
    n = (len(values) - 3) // 3
    places, flags, ties = values[:n], values[n : 2 * n + 1], values[2 * n + 1 : -1]
    ends = np.concatenate([first[None], np.minimum(places, last), last[None]])
    tie = (flags >= TIE_FROM) & (flags <= TIE_TO)
    flags = settled(np.where(tie, ties, flags), tie & (np.diff(ends, axis=0) < TOUCH * (last - first)))
    lost = np.isnan(places).any(axis=0) | np.isnan(flags).any(axis=0)
    piece, candidate = np.nonzero((flags > TIE_TO) & is_piece(ends[:-1], ends[1:]) & ~lost)
    found = [ends]
    if velocities is not None:
        found.append(np.pad(velocities, ((1, 1), (0, 0))))
    return np.flatnonzero(lost), (candidate, *(v[piece + side, candidate] for v in found for side in (0, 1)))


def settled(flags: Array, touching: Array) -> Array:
    """Returns whether pieces are covered; those that only touch as the piece before them that does not, or else the one behind."""
    if not touching.any():
        return flags
    n = np.arange(len(flags))[:, None]
    before = np.maximum.accumulate(np.where(touching, -1, n), axis=0)
    behind = np.argmin(touching, axis=0)
    return np.take_along_axis(flags, np.where(before < 0, behind, before), axis=0)


def gaps_of_lanes(lane: Array, covered: Sequence[Array], first: Array, last: Array, outer: tuple[Array, ...] = ()) -> tuple[Array, ...]:
    """Returns the gaps between intervals (p, q) of lanes, which are covered, with the lane of each, lane by lane, ascending. With the
    velocities of p and q behind these, and those of first and last, the velocities of the ends of gaps follow."""
    count = len(first)
    lane = np.concatenate([lane, np.arange(count)])  # the end of the line is an interval without length
    ends = [np.concatenate([end, v]) for end, v in zip(covered, (last, last, *(outer[1:] * 2)), strict=True)]
    order = np.lexsort((ends[0], lane))
    lane = lane[order]
    p, q, *velocities = (end[order] for end in ends)
    reached = first[lane].copy()
    before = outer[0][lane].copy() if velocities else reached  # the velocity of what is reached
    begin = np.searchsorted(lane, np.arange(count))
    for k in range(int(np.diff(np.append(begin, len(lane))).max(initial=0)) - 1):  # one interval of each lane at a time
        at = begin + k
        at = at[(at + 1 < len(lane)) & (lane[np.minimum(at + 1, len(lane) - 1)] == np.arange(count))]
        if velocities:
            before[at + 1] = np.where(q[at] > reached[at], velocities[1][at], before[at])
        reached[at + 1] = np.maximum(reached[at], q[at])
    gap = is_piece(reached, p)
    return lane[gap], reached[gap], p[gap], *((before[gap], velocities[0][gap]) if velocities else ())


def is_piece(p: Array, q: Array) -> Array:
    """Returns whether (p, q) is wide enough to be integrated over."""
    return q - p > PIECE_EPS * np.maximum(np.abs(p), np.abs(q))
