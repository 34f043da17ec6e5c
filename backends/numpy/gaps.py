"""The gaps that candidates leave on lines, one line a lane."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from teg.program import PIECE_EPS
from teg.program.arrays import TIE_FROM, TIE_TO, TOUCH

Array = npt.NDArray[Any]


def covered_by(values: Array, first: Array, last: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Returns the candidates of which it is not known what they cover, and what the others cover: a candidate, p and q for each interval.

    `values` are those of `Gaps`, (3·n + 3, candidates); `first` and `last` are the ends of the line of each candidate.
    """
    n = (len(values) - 3) // 3
    places, flags, ties = values[:n], values[n : 2 * n + 1], values[2 * n + 1 : -1]
    ends = np.concatenate([first[None], np.minimum(places, last), last[None]])
    tie = (flags >= TIE_FROM) & (flags <= TIE_TO)
    flags = settled(np.where(tie, ties, flags), tie & (np.diff(ends, axis=0) < TOUCH * (last - first)))
    lost = np.isnan(places).any(axis=0) | np.isnan(flags).any(axis=0)
    piece, candidate = np.nonzero((flags > TIE_TO) & is_piece(ends[:-1], ends[1:]) & ~lost)
    return np.flatnonzero(lost), (candidate, ends[piece, candidate], ends[piece + 1, candidate])


def settled(flags: Array, touching: Array) -> Array:
    """Returns whether pieces are covered; those that only touch as the piece before them that does not, or else the one behind."""
    if not touching.any():
        return flags
    n = np.arange(len(flags))[:, None]
    before = np.maximum.accumulate(np.where(touching, -1, n), axis=0)
    behind = np.argmin(touching, axis=0)
    return np.take_along_axis(flags, np.where(before < 0, behind, before), axis=0)


def gaps_of_lanes(lane: Array, covered: tuple[Array, Array], first: Array, last: Array) -> tuple[Array, Array, Array]:
    """Returns the gaps between intervals (p, q) of lanes, which are covered, with the lane of each, lane by lane, ascending."""
    count = len(first)
    lane = np.concatenate([lane, np.arange(count)])  # the end of the line is an interval without length
    p, q = (np.concatenate([end, last]) for end in covered)
    order = np.lexsort((p, lane))
    lane, p, q = lane[order], p[order], q[order]
    reached = first[lane].copy()
    begin = np.searchsorted(lane, np.arange(count))
    for k in range(int(np.diff(np.append(begin, len(lane))).max(initial=0)) - 1):  # one interval of each lane at a time
        at = begin + k
        at = at[(at + 1 < len(lane)) & (lane[np.minimum(at + 1, len(lane) - 1)] == np.arange(count))]
        reached[at + 1] = np.maximum(reached[at], q[at])
    gap = is_piece(reached, p)
    return lane[gap], reached[gap], p[gap]


def is_piece(p: Array, q: Array) -> Array:
    """Returns whether (p, q) is wide enough to be integrated over."""
    return q - p > PIECE_EPS * np.maximum(np.abs(p), np.abs(q))
