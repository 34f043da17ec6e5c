"""Lists of candidates: which boxes meet which squares of a grid, or of one grid out of many."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]


def binned(who: Integers, first: Integers, last: Integers, shape: tuple[int, int], grid: Integers | int = 0) -> tuple[Integers, Integers]:
    """Returns where the list of each square begins and ends, of shape (grids·size², 2), and the lists one after the other.

    Box m belongs to `who[m]` and meets the columns from `first[m, 0]` to `last[m, 0]` (excluded) and such rows of `grid[m]`; `shape` is
    (grids, size). Lists are in the order of the boxes. Time and memory are linear in their lengths and in the number of squares.
    """
    grids, size = shape
    wide, high = (last - first).clip(0).T
    count = wide * high
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)  # the number of a square in its box
    width = np.repeat(wide, count)
    corner = (np.asarray(grid) * size + first[:, 1]) * size + first[:, 0]
    where = np.repeat(corner, count) + within // width * size + within % width
    ends = np.cumsum(np.bincount(where, minlength=grids * size * size))
    return np.stack([np.concatenate([[0], ends[:-1]]), ends], axis=1), np.repeat(who, count)[np.argsort(where, kind="stable")]
