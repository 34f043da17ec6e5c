"""Edges on which the keys of several pairs are equal: they belong to the owners of their two sides."""

from __future__ import annotations

import math
from itertools import permutations

import pytest

from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout

SHAPE = Layout(parts=1, guards=0, degree=0)
SITES = {(0.25, 0.25): 1.0, (0.75, 0.25): 2.0, (0.25, 0.75): 5.0, (0.75, 0.75): 11.0}


@pytest.mark.parametrize("order", list(permutations(range(4))), ids=str)
def test_owners_of_both_sides_have_the_edge(order: tuple[int, ...]) -> None:
    rows = [[x * x + y * y, -2 * x, -2 * y, value] for (x, y), value in (list(SITES.items())[k] for k in order)]
    table = integrals(SHAPE, rows, [0.0], True).tables[0]
    for k, (x, y) in enumerate(list(SITES)[k] for k in order):  # edges of length 1/2 with |(a, b)| = 1
        beside = SITES[1 - x, y] + SITES[x, 1 - y] - 2 * SITES[x, y]
        assert table[k][0] == pytest.approx(0.5 * beside, abs=1e-14)


def test_three_on_a_line_are_ambiguous() -> None:
    rows = [[0.0, a, -a, value] for a, value in ((0.0, 1.0), (-2.0, 3.0), (-1.0, 7.0))]
    found = integrals(SHAPE, rows, [0.0], True)
    assert found.values[0] == pytest.approx(2.0)
    assert all(math.isnan(row[0]) for row in found.tables[0])


def test_three_straight_lines_in_one_point_are_the_pair_that_is_there() -> None:
    """Keys over an interval, of which the third is least nowhere."""
    rows = [[-0.5 * a, a, 0.0, value] for a, value in ((0.0, 1.0), (-2.0, 3.0), (-1.0, 7.0))]
    three, two = (integrals(SHAPE, some, [0.0], True) for some in (rows, rows[:2]))
    assert three.values[0] == pytest.approx(2.0)
    for found, expected in zip(three.tables[0][:2], two.tables[0][:2], strict=True):
        assert found == pytest.approx(expected, abs=1e-14)
    assert three.tables[0][2][0] == 0.0
