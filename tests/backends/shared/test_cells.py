"""Cells of a fixed number of candidates, in NumPy, against the plain routine: values at any placement, derivatives where there is one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from teg.backends.shared.cells import integrals_of_lanes, line_count, most_candidates
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import Layout

TRIANGLES = Layout(1, 3, 1)


def forms(corners: Any, depths: Any) -> Any:
    """The guards and the key of a triangle."""
    p, q, r = corners

    def across(a: Any, b: Any) -> Any:
        ex, ey = b - a
        return np.array([ey * a[0] - ex * a[1], -ey, ex])

    sides = np.array([across(q, r), across(r, p), across(p, q)])
    sides = sides / (across(p, q) @ np.array([1.0, *r]))
    return np.concatenate([sides.ravel(), depths @ sides])


def scene(rng: Any, corners: Any, depths: Any, faces: Any) -> tuple[Any, Any, Any]:
    """Triangles that may be seen in the unit square, with random colours, how their forms move with random corners, and the background."""
    move, sink = rng.normal(size=corners.shape), rng.normal(size=depths.shape)
    rows, rates = [], []
    for face in faces:
        row = forms(corners[face] + 1e-30j * move[face], depths[face] + 1e-30j * sink[face])
        guards = row.real[:9].reshape(3, 3)
        if (guards[:, 0] + np.maximum(guards[:, 1], 0) + np.maximum(guards[:, 2], 0) >= 0).all():
            rows.append([*row.real, *rng.normal(size=3)])
            rates.append([*row.imag * 1e30, 0, 0, 0])
    return np.array(rows)[:9], np.array(rates)[:9], rng.normal(size=3)


def random_triangles(rng: Any) -> tuple[Any, Any, Any]:
    count = int(rng.integers(1, 9))
    corners = (rng.uniform(size=(count, 1, 2)) + rng.normal(0, 0.4, (count, 3, 2))).reshape(-1, 2)
    return scene(rng, corners, rng.uniform(size=3 * count), np.arange(3 * count).reshape(-1, 3))


def grid(rng: Any, jitter: float = 0.0) -> tuple[Any, Any]:
    n = 4
    ticks = np.linspace(0, 1, n + 1)
    corners = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2) + jitter * rng.normal(size=((n + 1) ** 2, 2))
    first = [i * (n + 1) + j for i in range(n) for j in range(n)]
    return corners, np.array([f for a in first for f in ([a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1])])


def pixel(rng: Any, jitter: float) -> tuple[Any, Any, Any]:
    """A pixel of a regular mesh: many edges in one line, corners in one point, sides on the border."""
    corners, faces = grid(rng, jitter)
    parts = int(rng.choice([3, 4, 5, 8]))
    corner = rng.integers(0, parts, 2) / parts
    return scene(rng, (corners - corner) * parts, rng.uniform(size=len(corners)), faces)


def coincident(rng: Any) -> tuple[Any, Any, Any]:
    """A triangle twice, one on half of an edge of it, and one across."""
    corners = rng.uniform(-0.3, 1.3, (6, 2))
    return scene(rng, corners, rng.uniform(size=6), np.array([[0, 1, 2], [0, 1, 2], [3, 4, 5], [0, 1, 4]]))


SCENES: dict[str, Any] = {
    "random": random_triangles,
    "regular": lambda rng: pixel(rng, 0.0),
    "mesh": lambda rng: pixel(rng, 0.03),
    "coincident": coincident,
}


@pytest.mark.parametrize("name", SCENES)
def test_against_the_plain_routine(name: str) -> None:
    """The gradient along a motion of the corners against differences, with which plain cells on one line do not always agree."""
    rng = np.random.default_rng(1)
    for _ in range(15):
        rows, rates, other = SCENES[name](rng)
        values, tables = integrals_of_lanes(np, TRIANGLES, rows[None], np.ones((1, len(rows)), bool), other[None])

        def plain(step: float, given: tuple[Any, Any, Any] = (rows, rates, other)) -> float:
            return integrals(TRIANGLES, (given[0] + step * given[1]).tolist(), given[2].tolist(), False).values[0]

        assert values[0, 0] == pytest.approx(plain(0.0), abs=1e-11)
        slope, size = (tables[0, 0, :-1] * rates).sum(), np.abs(tables[0, 0, :-1] * rates).sum()
        one, two = ((plain(h) - plain(-h)) / (2 * h) for h in (1e-5, 1e-6))
        assert slope == pytest.approx(two, abs=1e-6 * (1 + size) + 3 * abs(one - two))


@pytest.mark.parametrize("shape", [Layout(1, 0, 2), Layout(2, 4, 1), Layout(1, 3, 4)], ids=str)
def test_tables_of_other_layouts(shape: Layout) -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        rows = rng.normal(size=(4, shape.columns))
        rows[:, : shape.forms - 3 : 3] += 0.5
        other = rng.normal(size=shape.coefficients)
        expected = integrals(shape, rows.tolist(), other.tolist(), True)
        values, tables = integrals_of_lanes(np, shape, rows[None], np.ones((1, 4), bool), other[None])
        np.testing.assert_allclose(values[0], expected.values, atol=1e-12)
        np.testing.assert_allclose(tables[0], expected.tables, atol=1e-11)


def test_edges_in_one_line_belong_to_their_own_triangles() -> None:
    """u >= ¼ below v = ¼, and u <= ¼ above: two edges on u = ¼, far from each other, with derivatives of their own."""
    shape = Layout(1, 2, 0)
    rows = np.array([[-1.0, 4, 0, 1, 0, -4, 0.3, 0, 0, 2], [1, -4, 0, -1, 0, 4, 0.2, 0, 0, 5]])
    _, tables = integrals_of_lanes(np, shape, rows[None], np.ones((1, 2), bool), np.zeros((1, 1)))
    assert tables[0, 0, 0, 0] == pytest.approx(2 / 16)  # the length ¼ of the edge, by 4, times the colour
    assert tables[0, 0, 1, 0] == pytest.approx(5 * 3 / 16)


def test_lanes_that_are_not_filled_and_forms_that_are_not_finite() -> None:
    rng = np.random.default_rng(3)
    rows, _, other = random_triangles(rng)
    few = rows[:1]
    wide = np.full((3, 4, rows.shape[1]), np.nan)
    wide[:, :1] = few
    wide[1, 1], wide[1, 1, :3] = np.inf, [-1.0, 0.0, 0.0]  # absent: its other numbers do not matter
    live = np.array([[True, False, False, False], [True, True, False, False], [True, False, True, False]])
    with np.errstate(all="ignore"):
        values, _ = integrals_of_lanes(np, TRIANGLES, wide, live, np.tile(other, (3, 1)))
    assert values[0, 0] == values[1, 0] == pytest.approx(integrals(TRIANGLES, few.tolist(), other.tolist(), False).values[0], abs=1e-13)
    assert np.isnan(values[2, 0])


def test_the_most_candidates() -> None:
    for shape in (TRIANGLES, Layout(1, 0, 2), Layout(4, 4, 0)):
        most = most_candidates(shape)
        assert line_count(shape, most) <= 100 < line_count(shape, most + 1)
    assert [most_candidates(s) for s in (TRIANGLES, Layout(1, 0, 2))] == [11, 14]
