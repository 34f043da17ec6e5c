"""The gaps that candidates leave on lines, one line a lane."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from teg.program import PIECE_EPS
from teg.program.arrays import TIE_FROM, TIE_TO

Array = npt.NDArray[Any]


def covered_by(values: Array, first: Array, last: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Returns the candidates of which it is not known what they cover, and what the others cover: a candidate, p and q for each interval.

    `values` are those of `Gaps`, (3·n + 2, candidates); `first` and `last` are the ends of the line of each candidate.
    """
    n = (len(values) - 2) // 3
    places, flags, ties = values[:n], values[n : 2 * n + 1], values[2 * n + 1 :]
    flags = np.where((flags >= TIE_FROM) & (flags <= TIE_TO), ties, flags)
    lost = np.isnan(places).any(axis=0) | np.isnan(flags).any(axis=0)
    ends = np.concatenate([first[None], np.minimum(places, last), last[None]])
    piece, candidate = np.nonzero((flags > TIE_TO) & is_piece(ends[:-1], ends[1:]) & ~lost)
    return np.flatnonzero(lost), (candidate, ends[piece, candidate], ends[piece + 1, candidate])


def gaps_of_lanes(lane: Array, p: Array, q: Array, first: Array, last: Array) -> tuple[Array, Array, Array]:
    """Returns the gaps between intervals (p, q) of lanes, with the lane of each, lane by lane, ascending."""
    count = len(first)
    lane = np.concatenate([lane, np.arange(count)])  # the end of the line is an interval without length
    p, q = np.concatenate([p, last]), np.concatenate([q, last])
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
