"""Cells of many squares at once, beside `teg.numerics.cells` for each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from teg.backends.numpy import arrangement, cells
from teg.backends.numpy.cells import cells_of_lanes
from teg.numerics.cells import Layout, integrals

SHAPES = [Layout(1, 3, 0), Layout(1, 3, 1), Layout(2, 2, 2), Layout(1, 0, 1), Layout(3, 1, 1), Layout(1, 3, 1, 1), Layout(2, 2, 2, 1)]


def scenes(shape: Layout, kind: str, lanes: int = 40, bodies: int = 2) -> tuple[np.ndarray[Any, Any], ...]:
    """Returns candidates, counts and otherwise of lanes; numbers of a coarse grid make ties and lines on sides."""
    random = np.random.default_rng([SHAPES.index(shape), len(kind)])
    counts = random.integers(0, 7, lanes)
    width = shape.forms + bodies * shape.coefficients
    rows = random.normal(size=(int(counts.sum()), width * (1 + shape.order)))
    rows[:, 0 : shape.forms - 3 : 3] += 0.5
    if kind == "coarse":
        rows = np.round(rows * 2) / 2
    if kind == "not finite":
        rows[random.integers(0, len(rows), 6), random.integers(0, shape.forms, 6)] = np.nan
        rows[random.integers(0, len(rows), 3), random.integers(0, shape.forms, 3)] = np.inf
    return rows, counts, random.normal(size=(lanes, bodies * shape.coefficients * (1 + shape.order)))


@pytest.mark.parametrize("kind", ["any", "coarse", "not finite"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_every_square_is_as_by_itself(shape: Layout, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cells, "CHUNK", 11)
    rows, counts, otherwise = scenes(shape, kind)
    found = cells_of_lanes(shape, rows, counts, otherwise, True)
    values = cells_of_lanes(shape, rows, counts, otherwise, False)
    np.testing.assert_array_equal(found.values, values.values)
    end = 0
    for lane, count in enumerate(counts):
        one = integrals(shape, rows[end : end + count].tolist(), otherwise[lane].tolist(), True)
        np.testing.assert_allclose(found.values[:, lane], one.values, rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(found.sizes[:, lane], one.sizes, rtol=1e-12, atol=1e-13)
        for table, part in zip(found.tables, one.tables, strict=True):
            np.testing.assert_allclose(table[end + lane : end + count + lane + 1], part, rtol=1e-11, atol=1e-11)
        end += count


@pytest.mark.parametrize("kind", ["any", "coarse"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_cells_that_are_put_aside_do_not_matter(shape: Layout, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rows, counts, otherwise = scenes(shape, kind)
    monkeypatch.setattr(arrangement, "MANY_CELLS", 1)
    found = cells_of_lanes(shape, rows, counts, otherwise, True)
    monkeypatch.setattr(arrangement, "MANY_CELLS", np.inf)
    expected = cells_of_lanes(shape, rows, counts, otherwise, True)
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(np.stack(found.tables), np.stack(expected.tables))


def test_no_lanes_and_no_candidates() -> None:
    shape = Layout(1, 1, 0)
    none = cells_of_lanes(shape, np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros((0, 1)), True)
    assert none.values.shape == (1, 0)
    empty = cells_of_lanes(shape, np.zeros((0, 7)), np.zeros(2, dtype=int), np.array([[3.0], [4.0]]), True)
    assert empty.values.tolist() == [[3.0, 4.0]]
    assert empty.tables[0][:, -1].tolist() == [1.0, 1.0]
