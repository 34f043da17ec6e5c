"""Integers in their ranges: exact operations, and the rows that index arrays name."""

from __future__ import annotations

import numpy as np
import pytest

from teg.backends.plan import TOGETHER, apply, column_intervals, exactly, listed_rows
from teg.errors import ArrayIndexError

BIG = np.array([2**62, 5], dtype=np.int64)


@pytest.mark.parametrize(("op", "expected"), [("add", [9, -3]), ("sub", [5, -7]), ("mul", [14, -10]), ("min", [2, -5]), ("max", [7, 2])])
def test_operations_on_lanes(op: str, expected: list[int]) -> None:
    a, b = np.array([7, -5]), np.array([2, 2])
    np.testing.assert_array_equal(apply(op, a, b), expected)
    np.testing.assert_array_equal(exactly(op, a, b), expected)


def test_quotients_round_down() -> None:
    np.testing.assert_array_equal(exactly("floordiv", np.array([7, -7]), np.array([2, 2])), [3, -4])


@pytest.mark.parametrize("op", ["add", "mul"])
def test_more_than_64_bits_are_an_error(op: str) -> None:
    with pytest.raises(ArrayIndexError):
        exactly(op, BIG, BIG)


def test_a_division_by_zero_is_an_error() -> None:
    with pytest.raises(ArrayIndexError):
        exactly("floordiv", np.array([1]), np.array([0]))


def test_rows_that_are_named() -> None:
    np.testing.assert_array_equal(listed_rows(np.array([[3, 0], [3, 9]]), 5), [0, 3])


@pytest.mark.parametrize("rows", [TOGETHER, TOGETHER + 1, 5 * TOGETHER, 9 * TOGETHER + 7])
def test_intervals_of_columns(rows: int) -> None:
    """Also where the extreme entry is in the last rows, which do not fill a block."""
    table = np.random.default_rng(rows).integers(-9, 9, (rows, 3))
    table[-1] = [50, -50, 0]
    assert column_intervals(table) == [(int(column.min()), int(column.max())) for column in table.T]
    assert column_intervals(table, rough=True) == column_intervals(table)
    table += 50
    assert column_intervals(table, rough=True) == [(0, int(column.max())) for column in table.T]
