"""Integrals of the nearest candidate over one square, and their derivatives, against sampling and differences."""

from __future__ import annotations

import random

import pytest

from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout

SHAPE = Layout(parts=1, guards=1, degree=1)
DRAWN = random.Random(5)
ROWS = [[DRAWN.uniform(-0.4, 0.8), *(DRAWN.uniform(-1, 1) for _ in range(8))] for _ in range(4)]
OTHERWISE = [0.3, 0.0, -0.2]


def at(u: float, v: float) -> float:
    """The polynomial of the nearest candidate at one point."""
    nearest, numbers = 1e300, OTHERWISE
    for c, a, b, d, e, f, *own in ROWS:
        if c + a * u + b * v >= 0 and d + e * u + f * v < nearest:
            nearest, numbers = d + e * u + f * v, own
    return numbers[0] + numbers[1] * u + numbers[2] * v


def test_the_value_is_that_of_many_points() -> None:
    n = 300
    mean = sum(at((i + 0.5) / n, (j + 0.5) / n) for i in range(n) for j in range(n)) / n**2
    assert integrals(SHAPE, ROWS, OTHERWISE, False).values[0] == pytest.approx(mean, abs=3e-3)


def test_the_table_has_the_derivatives_by_every_number() -> None:
    table = integrals(SHAPE, ROWS, OTHERWISE, True).tables[0]
    step = 1e-6
    for k, row in enumerate(ROWS):
        for i in range(len(row)):
            moved = [[[*r[:i], r[i] + s, *r[i + 1 :]] if j == k else r for j, r in enumerate(ROWS)] for s in (step, -step)]
            up, down = (integrals(SHAPE, rows, OTHERWISE, False).values[0] for rows in moved)
            assert table[k][i] == pytest.approx((up - down) / (2 * step), abs=1e-7)
