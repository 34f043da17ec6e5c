"""Cells of one square: they tile it, and each has the owner that is nearest there."""

from __future__ import annotations

import random

import pytest

from teg.numerics.arrangement import Arrangement, Cell, split
from teg.numerics.cells import NO_OWNER, Layout, Point

SQUARE = Cell(0, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [4, 2, 6, 0])


def area(corners: list[Point]) -> float:
    return 0.5 * sum(x * v - u * y for (x, y), (u, v) in zip(corners, [*corners[1:], corners[0]], strict=True))


def test_both_sides_of_a_cut_share_its_points() -> None:
    front, back, _ = split(SQUARE, 4, (-0.25, 1.0, 0.0))
    assert front is not None
    assert back is not None
    assert (area(front.corners), area(back.corners)) == (0.75, 0.25)
    assert len(set(front.corners) & set(back.corners)) == 2
    assert {8, 9} <= {*front.labels, *back.labels}


@pytest.mark.parametrize(("unit", "side"), [((0.5, 1.0, 0.0), 0), ((-2.0, 1.0, 0.0), 1), ((0.0, 1.0, 0.0), 0)])
def test_a_line_outside_or_on_a_side_cuts_nothing(unit: tuple[float, float, float], side: int) -> None:
    parts = split(SQUARE, 4, unit)
    assert parts[side] is SQUARE
    assert parts[1 - side] is None
    assert sum(parts[2]) == (2 if unit[0] == 0.0 else 0)


def test_cells_tile_the_square_and_belong_to_the_nearest() -> None:
    drawn = random.Random(3)
    shape = Layout(parts=1, guards=1, degree=0)
    candidates = [[drawn.uniform(-0.5, 0.7), *(drawn.uniform(-1, 1) for _ in range(5)), 1.0] for _ in range(7)]
    arrangement = Arrangement(shape, candidates, (0.0, 0.0))
    assert sum(area(cell.corners) for cell in arrangement.cells) == pytest.approx(1.0, abs=1e-14)
    for cell in arrangement.cells:
        u, v = (sum(p[i] for p in cell.corners) / len(cell.corners) for i in (0, 1))
        keys = {k: d + e * u + f * v for k, (c, a, b, d, e, f, _) in enumerate(candidates) if c + a * u + b * v >= 0}
        assert cell.owner == (min(keys, key=keys.__getitem__) if keys else NO_OWNER)
