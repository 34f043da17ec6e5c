"""Rectangles over one another that end at the same sides of the square, against differences of areas counted cell by cell."""

from __future__ import annotations

import random
from collections.abc import Sequence
from itertools import pairwise, product
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.numpy.cells import cells_of_lanes
from teg.backends.shared.cells import integrals_of_lanes
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import SHIFT, Layout
from teg.numerics.side_lines import displaced, side_of

SHAPE = Layout(parts=1, guards=4, degree=0)
SIDES = (0, 3, 6, 9)
"""The columns of the constants of x - left, right - x, y - low, high - y."""
OTHERWISE = 0.7
STEP = 2e-6

Rectangle = tuple[float, float, float, float, float, float]
"""left, right, low, high, depth, colour."""


def scene(seed: int, count: int) -> list[Rectangle]:
    """Rectangles each of whose sides is within the square, on its side or beyond it."""
    drawn = random.Random(seed)

    def ends() -> tuple[float, float]:
        return drawn.choice([0.0, drawn.uniform(0.05, 0.45), -0.3]), drawn.choice([1.0, drawn.uniform(0.55, 0.95), 1.4])

    return [(*ends(), *ends(), drawn.random(), drawn.uniform(-1.0, 1.0)) for _ in range(count)]


def seen(rectangles: Sequence[Sequence[float]]) -> float:
    """The integral of the nearest rectangle's colour over the square."""
    total = 0.0
    cuts = [sorted({0.0, 1.0} | {min(max(r[k], 0.0), 1.0) for r in rectangles for k in pair}) for pair in ((0, 1), (2, 3))]
    for (a, b), (c, d) in product(*map(pairwise, cuts)):
        x, y = 0.5 * (a + b), 0.5 * (c + d)
        there = [(r[4], r[5]) for r in rectangles if r[0] < x < r[1] and r[2] < y < r[3]]
        total += (b - a) * (d - c) * (min(there)[1] if there else OTHERWISE)
    return total


def slopes(rectangles: list[Rectangle]) -> np.ndarray[Any, Any]:
    """The derivatives by left, right, low and high of each: means of both sides, since areas are linear in each."""
    found = np.zeros((len(rectangles), 4))
    for k, own in enumerate(rectangles):
        for j in range(4):
            moved = [[*rectangles[:k], (*own[:j], own[j] + s, *own[j + 1 :]), *rectangles[k + 1 :]] for s in (STEP, -STEP)]
            found[k, j] = (seen(moved[0]) - seen(moved[1])) / (2.0 * STEP)
    return found


def rows(rectangles: list[Rectangle]) -> list[list[float]]:
    return [
        [-left, 1.0, 0.0, right, -1.0, 0.0, -low, 0.0, 1.0, high, 0.0, -1.0, depth, 0.0, 0.0, colour]
        for left, right, low, high, depth, colour in rectangles
    ]


SCENES = [(seed, 1 + seed % 5) for seed in range(30)]


@pytest.mark.parametrize(("seed", "count"), SCENES)
def test_every_line_moves_by_itself(seed: int, count: int) -> None:
    rectangles = scene(seed, count)
    expected = slopes(rectangles) * (-1.0, 1.0, -1.0, 1.0)
    own, some = rows(rectangles), np.array([count])
    tables = {
        "interpreter": np.array(integrals(SHAPE, own, [OTHERWISE], True).tables[0]),
        "numpy": cells_of_lanes(SHAPE, np.array(own), some, np.array([[OTHERWISE]]), True).tables[0],
        "shared": integrals_of_lanes(np, SHAPE, np.array([own]), np.ones((1, count), dtype=bool), np.array([[OTHERWISE]]))[1][0, 0],
    }
    for name, table in tables.items():
        assert table[:count, SIDES] == pytest.approx(expected, abs=1e-9), name


@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
def test_gradients_of_programs(backend: str, x64_for_jax: ModuleType) -> None:
    x, y = teg.vars("x y")
    k, table = teg.index("k"), teg.array("R", 2)
    inside = (x > table[k, 0]) & (x < table[k, 1]) & (y > table[k, 2]) & (y < table[k, 3])
    colour = teg.nearest(table[k, 5], table[k, 4], (k, 0, teg.length(table)), where=inside, otherwise=OTHERWISE)
    f = teg.compile(teg.integral(colour, (x, 0, 1), (y, 0, 1)), backend=backend)
    for seed in range(40, 44 if backend == "jax" else 60):
        rectangles = scene(seed, 4)
        value, gradient = f.value_and_grad(R=np.array(rectangles))
        assert value == pytest.approx(seen(rectangles), abs=1e-13)
        assert gradient["R"][:, :4] == pytest.approx(slopes(rectangles), abs=1e-9)


def test_a_union_of_two_that_end_at_one_side() -> None:
    """Behind the other one a border moves nothing."""
    x, y = teg.vars("x y")
    k, table = teg.index("k"), teg.array("R", 2)
    inside = (x < table[k, 0]) & (y > table[k, 1]) & (y < table[k, 2])
    union = teg.integral(teg.bracket(teg.any(inside, (k, 0, teg.length(table)))), (x, 0, 1), (y, 0, 1))
    for backend in ("c", "numpy"):
        gradient = teg.compile(union, backend=backend).grad(R=[[1.0, 0.25, 0.75], [1.0, -1.0, 2.0]])["R"]
        assert gradient[:, 0] == pytest.approx([0.0, 0.25], abs=1e-9)


@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
def test_a_common_edge_on_a_side_before_a_background(backend: str, x64_for_jax: ModuleType) -> None:
    """Two rectangles, one of them beyond the square, move with their common edge: it shows the second one, not the background."""
    x, y = teg.vars("x y")
    s = teg.params("s")[0]
    k, table = teg.index("k"), teg.array("R", 2)
    inside = (x > table[k, 0] + table[k, 1] * s) & (x < table[k, 2] + table[k, 3] * s)
    colour = teg.nearest(table[k, 5], table[k, 4], (k, 0, teg.length(table)), where=inside)
    f = teg.compile(teg.integral(colour, (x, 0, 1), (y, 0, 1)), s, backend=backend)
    within, beyond, background = [0.0, 0.0, 0.0, 1.0, 0.1, 3.0], [0.0, 1.0, 2.0, 0.0, 0.1, 5.0], [0.0, 0.0, 1.0, 0.0, 0.9, 7.0]
    assert f.grad(s=1.0, R=[within, beyond, background])["s"] == pytest.approx(0.5 * (3.0 - 5.0), abs=1e-9)


def test_the_number_of_squares_is_that_of_rectangles_over_one_another() -> None:
    beside = [(0.0, 1.0, 0.1 * k, 0.1 * k + 0.1, 0.5, 1.0) for k in range(9)]
    assert [square.weight for square in displaced(SHAPE, rows(beside))] == [0.5, 0.5]
    stacked = [(0.0, 0.5 + 0.1 * k, 0.2, 0.8, 0.1 * k, 1.0) for k in range(3)]
    squares = displaced(SHAPE, rows(stacked))
    assert [square.weight for square in squares] == [-0.5, 0.5, 0.5, 0.5]
    assert sum(square.weight * square.sign for square in squares) == 0.0
    lefts = [[row[0] + square.sign * SHIFT > 0.0 for row in square.candidates] for square in squares]
    assert lefts == [[True] * 3, [False, True, True], [True, False, True], [True, True, False]]


def test_the_side_of_a_line() -> None:
    assert side_of((0.0, 2.0, 0.0)) == (0, False)
    assert side_of((-3.0, 3.0, 0.0)) == (1, True)
    assert side_of((2.0, 0.0, -2.0)) == (3, False)
    assert side_of((0.0, 1.0, 1e-9)) is None
    assert side_of((0.0, 0.0, 0.0)) is None
