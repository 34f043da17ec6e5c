"""Lists of candidates: those of every square, counted one by one."""

from __future__ import annotations

import numpy as np

from teg.examples.bins import binned


def test_lists_are_those_of_a_count_one_by_one() -> None:
    rng = np.random.default_rng(0)
    first = rng.integers(0, 5, (40, 2))
    last = np.minimum(first + rng.integers(-1, 4, (40, 2)), 5)  # boxes of no squares too
    grid, who = rng.integers(0, 3, 40), rng.integers(0, 100, 40)
    ranges, owners = binned(who, first, last, (3, 5), grid)
    for square, (start, end) in enumerate(ranges.tolist()):
        row, column = square % 25 // 5, square % 5
        met = (grid == square // 25) & (first[:, 0] <= column) & (column < last[:, 0]) & (first[:, 1] <= row) & (row < last[:, 1])
        assert owners[start:end].tolist() == who[met].tolist()
    assert ranges[-1, 1] == len(owners)


def test_nothing_meets_nothing() -> None:
    none = np.zeros((0, 2), dtype=np.int64)
    ranges, owners = binned(none[:, 0], none, none, (1, 2))
    assert ranges.tolist() == [[0, 0]] * 4
    assert len(owners) == 0
