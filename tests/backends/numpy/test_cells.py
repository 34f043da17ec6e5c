"""Cells of many squares at once, beside `teg.numerics.cells` for each."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from teg.backends.numpy import arrangement, cells, tiles
from teg.backends.numpy.cells import cells_of_lanes
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import TILE_AT, Layout
from tests.backends.parted import assert_right, is_parted

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
        tables = [table[end + lane : end + count + lane + 1] for table in found.tables]
        if is_parted(shape, rows[end : end + count], otherwise[lane]):
            assert_both_right(shape, tables, one.tables, rows[end : end + count], otherwise[lane])
        else:
            np.testing.assert_allclose(np.array(tables), np.array(one.tables), rtol=1e-11, atol=1e-11)
        end += count


@pytest.mark.parametrize("kind", ["any", "coarse"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_tiles_do_not_matter(shape: Layout, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where edges of several candidates lie on each other, the derivative is that of all of them together."""
    rows, counts, otherwise = scenes(shape, kind)
    expected = cells_of_lanes(shape, rows, counts, otherwise, True)
    monkeypatch.setattr(tiles, "MOST", 0)
    monkeypatch.setattr(tiles, "LEVELS", 2)
    monkeypatch.setattr(tiles, "EACH", 0)
    found = cells_of_lanes(shape, rows, counts, otherwise, True)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-12, atol=1e-11)
    for one, two in zip(found.tables, expected.tables, strict=True):
        if kind == "any":
            np.testing.assert_allclose(one, two, rtol=1e-11, atol=1e-10)
        elif not shape.order:
            lane = np.repeat(np.arange(len(counts)), counts)
            forms = rows[:, : shape.forms].reshape(len(rows), -1, 3) @ np.array([0.0, 1.0, 0.7])  # how they change as all move
            moves = [np.bincount(lane, (t[np.arange(len(lane)) + lane, : shape.forms : 3] * forms).sum(axis=1)) for t in (one, two)]
            np.testing.assert_allclose(*moves, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("coarse", [2, 4])
def test_sites_on_a_grid_are_as_by_themselves(coarse: int) -> None:
    """Keys |x - s|² of which many are equal at one place, in whole squares and beside sides and corners, and their second derivatives. Some
    candidates are absent everywhere."""
    random = np.random.default_rng(coarse)
    shape, lanes, count = Layout(1, 1, 0, 1), 60, 5
    sites = random.integers(-coarse // 2, coarse + coarse // 2 + 1, (lanes * count, 2)) / coarse
    moves = random.integers(-3, 4, (lanes * count, 2))
    rows = np.zeros((lanes * count, 14))
    there = np.where(random.random(lanes * count) < 0.8, 1.0, -1.0)
    rows[:, 0], rows[:, 3], rows[:, 4:6], rows[:, 6] = there, (sites**2).sum(axis=1), -2 * sites, random.integers(0, 5, lanes * count)
    rows[:, 10], rows[:, 11:13] = 2 * (sites * moves).sum(axis=1), -2 * moves
    otherwise = np.zeros((lanes, 2))
    found = cells_of_lanes(shape, rows, np.full(lanes, count), otherwise, True)
    unknown = 0
    for lane in range(lanes):
        one = integrals(shape, rows[lane * count : (lane + 1) * count].tolist(), [0.0, 0.0], True)
        unknown += np.isnan(one.tables[0]).any()
        first = lane * (count + 1)
        np.testing.assert_allclose(found.tables[0][first : first + count + 1], one.tables[0], rtol=1e-9, atol=1e-9)
    assert 0 < unknown < lanes / 2


def test_a_line_on_the_side_of_a_tile() -> None:
    """Two half-planes meet on a line behind forty discs' tangents: on a side of tiles, or beside it, it has its derivatives."""
    shape, angle = Layout(1, 1, 0), 0.1 * np.arange(40)
    across = np.column_stack([np.cos(angle), np.sin(angle)])
    for at in (TILE_AT[0], TILE_AT[0] + 1e-7):
        rows = np.zeros((42, shape.forms + 1))
        rows[:2, :3], rows[:2, -1] = [[-at, 1, 0], [at, -1, 0]], [2, 5]
        rows[2:, 1:3], rows[2:, 0], rows[2:, 3] = across, -0.6 - 0.5 * across.sum(axis=1), -1.0 - angle
        assert len(tiles.tiled(*known_of(shape, rows)).square) == 4
        found = cells_of_lanes(shape, rows, np.array([42]), np.zeros((1, 1)), True)
        one = integrals(shape, rows.tolist(), [0.0], True)
        np.testing.assert_allclose(found.values[:, 0], one.values, atol=1e-13)
        np.testing.assert_allclose(found.tables[0], one.tables[0], atol=1e-9)


def known_of(shape: Layout, rows: np.ndarray[Any, Any]) -> tuple[arrangement.Regions, arrangement.Inserted]:
    regions = arrangement.regions_of(shape, rows, np.array([len(rows)]))
    return regions, arrangement.classified(regions, 1)


def test_many_candidates_of_one_square_are_compared_with_few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cells that are looked at, as the candidates grow: not their square."""
    seen: list[int] = []
    split = arrangement.split

    def counted(p: Any, lines: Any, units: Any) -> Any:
        seen.append(len(lines))
        return split(p, lines, units)

    monkeypatch.setattr(arrangement, "split", counted)
    shape, work = Layout(1, 0, 0), []
    for count in (60, 960):
        random = np.random.default_rng(count)
        sites, weights = random.uniform(size=(count, 2)), random.uniform(size=count) / count
        rows = np.column_stack([(sites**2).sum(axis=1) - weights, -2 * sites, np.ones(count)])
        seen.clear()
        cells_of_lanes(shape, rows, np.array([count]), np.zeros((1, 1)), True)
        work.append(sum(seen))
    assert work[1] < 1.6 * 16 * work[0]


def test_no_lanes_and_no_candidates() -> None:
    shape = Layout(1, 1, 0)
    none = cells_of_lanes(shape, np.zeros((0, 7)), np.zeros(0, dtype=int), np.zeros((0, 1)), True)
    assert none.values.shape == (1, 0)
    empty = cells_of_lanes(shape, np.zeros((0, 7)), np.zeros(2, dtype=int), np.array([[3.0], [4.0]]), True)
    assert empty.values.tolist() == [[3.0, 4.0]]
    assert empty.tables[0][:, -1].tolist() == [1.0, 1.0]


def triangles_on_a_grid(lanes: int, order: int) -> tuple[np.ndarray[Any, Any], ...]:
    """Returns triangles whose corners are nodes of a coarse grid, so that edges lie on few lines: some with corners on the edges of others,
    in either turn. In half of the squares each has a depth, in the others they cross each other."""
    random = np.random.default_rng(order)
    counts = random.integers(2, 9, lanes)
    rows = np.zeros((int(counts.sum()), 12 + 6))
    for k, lane in enumerate(np.repeat(np.arange(lanes), counts)):
        corners = np.zeros((3, 2))
        while abs(np.linalg.det(np.column_stack([np.ones(3), corners]))) < 0.05:
            corners = random.integers(-1, 4, (3, 2)) / 2 + (lane % 3) * 0.1
        matrix = np.linalg.inv(np.vstack([np.ones(3), corners.T]))  # barycentric coordinates = matrix · (1, u, v)
        depths = random.uniform(size=3) if lane % 2 else np.full(3, random.uniform())
        rows[k] = np.concatenate([matrix.ravel(), depths @ matrix, *(random.uniform(size=(2, 3)) @ matrix)])
    if order:
        rows = np.concatenate([rows, random.normal(size=rows.shape)], axis=1)
    return rows, counts, random.normal(size=(lanes, 6 * (1 + order)))


def by_lanes(shape: Layout, rows: Any, otherwise: Any) -> Any:
    return np.array(cells_of_lanes(shape, rows, np.array([len(rows)]), otherwise[None], True).tables)


def by_itself(shape: Layout, rows: Any, otherwise: Any) -> Any:
    return np.array(integrals(shape, rows.tolist(), otherwise.tolist(), True).tables)


def assert_both_right(shape: Layout, found: Any, expected: Any, rows: Any, otherwise: Any) -> None:
    """Compares second derivatives of one square, as NumPy has them and as the reference does, with differences."""
    for tables, way in ((found, by_lanes), (expected, by_itself)):
        assert_right(np.array(tables), partial(way, shape._replace(order=0)), rows, otherwise)


@pytest.mark.parametrize("order", [0, 1])
def test_edges_of_different_triangles_on_one_line(order: int) -> None:
    """Parts of lines belong to the regions whose edges lie there; second derivatives by their lines are not numbers, in the same places."""
    shape = Layout(1, 3, 1, order)
    rows, counts, otherwise = triangles_on_a_grid(60, order)
    found = cells_of_lanes(shape, rows, counts, otherwise, True)
    shared, end = 0, 0
    for lane, count in enumerate(counts):
        one = integrals(shape, rows[end : end + count].tolist(), otherwise[lane].tolist(), True)
        np.testing.assert_allclose(found.values[:, lane], one.values, rtol=1e-12, atol=1e-13)
        if is_parted(shape, rows[end : end + count], otherwise[lane]):
            tables = [table[end + lane : end + count + lane + 1] for table in found.tables]
            assert_both_right(shape, tables, one.tables, rows[end : end + count], otherwise[lane])
            shared += any(np.isnan(part).any() for part in one.tables)
            end += count
            continue
        for table, part in zip(found.tables, one.tables, strict=True):
            size = np.abs(np.nan_to_num(part)).max()
            off = (1e-9 if order else 1e-13) * max(1.0, size)  # second derivatives have slivers in them, where a line is on a side
            np.testing.assert_allclose(table[end + lane : end + count + lane + 1], part, rtol=1e-12, atol=off)
            shared += bool(order and np.isnan(part).any())
        end += count
    assert not order or shared > 10
