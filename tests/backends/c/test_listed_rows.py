"""Runs and rows in lists of integers, beside a loop over neighbours in plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from teg.backends.c.listed_rows import listed_rows
from tests.backends.c_checks import in_c

pytestmark = in_c
PIECE = 4096


def by_hand(columns: list[list[int]], fixed: int, piece: int) -> tuple[list[int], list[list[int]]]:
    rows: list[list[int]] = []
    runs: list[int] = []
    entries = list(zip(*columns, strict=True))
    for i, here in enumerate(entries):
        before = entries[i - 1] if i else None
        new_run = before is None or i % piece == 0 or here[:fixed] != before[:fixed]
        if before is None or new_run or here[:-1] != before[:-1] or here[-1] != before[-1] + 1:
            runs += [len(rows)] if new_run else []
            rows.append([*here, here[-1] + 1])
        else:
            rows[-1][-1] = here[-1] + 1
    return [*runs, len(rows)], rows


def check(columns: list[np.ndarray], fixed: int) -> None:
    found = listed_rows(columns, fixed, PIECE)
    assert found is not None
    runs, rows = by_hand([c.tolist() for c in columns], fixed, PIECE)
    assert found[0].tolist() == runs
    assert found[1].tolist() == rows


@pytest.mark.parametrize("size", [1, 2, 7, 8, 9, 4095, 4096, 4097, 10_000])
@pytest.mark.parametrize("longest", [1, 3, 40, 9000])
def test_as_by_hand(size: int, longest: int) -> None:
    """Rows of random lengths, in the columns of one table."""
    rng = np.random.default_rng(size + longest)
    table = np.zeros((size, 3), dtype=np.int64)
    at = 0
    while at < size:
        length = int(rng.integers(1, longest + 1))
        row = table[at : at + length]
        row[:, 0], row[:, 1] = rng.integers(-2, 2, 2)
        row[:, 2] = rng.integers(-50, 50) + np.arange(len(row))
        at += length
    for fixed in (1, 2):
        check([table[:, c] for c in range(3)], fixed)
        check([np.asfortranarray(table)[::-1, c] for c in range(3)], fixed)


def test_the_end_of_all_integers() -> None:
    """From the largest to the least one nothing goes up by one; behind the largest one a row has no end."""
    top = 2**63 - 1
    fixed, counting = np.zeros(4, dtype=np.int64), np.array([top - 1, top, -top - 1, -top])
    assert listed_rows([fixed, counting], 1, PIECE) is None
    check([fixed, counting - np.array([1, 1, 0, 0])], 1)
