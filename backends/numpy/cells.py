"""Integrals of the polynomial of the nearest candidate (`teg.numerics.cells`) on lanes.

Lanes in which nothing cuts the square (one candidate covers it and hides the others, or there is none) need no cells; the cells of all
other lanes are made together, `CHUNK` lanes at a time. Lanes with numbers that are not finite are left to `teg.numerics.cells`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrangement import UNMOVED, Arrangements, Moved, classified, regions_of
from teg.backends.numpy.measured import Measured, Numbers
from teg.backends.numpy.parting import parting
from teg.backends.numpy.side_lines import Squares, both_ways, squares_beside
from teg.backends.numpy.tiles import tiled
from teg.numerics.cell_integrals import integrals
from teg.numerics.cells import LIMIT, NO_OWNER, PARTING, SHIFT, SKEW, Layout, monomials

Array = npt.NDArray[Any]
CHUNK = 4096
"""The number of lanes whose cells are in memory at a time."""


class Results(NamedTuple):
    """Values and sizes, (results, lanes), and a table for each result with the rows of all lanes one below the other."""

    values: Array
    sizes: Array
    tables: list[Array]


class Lanes(NamedTuple):
    """Candidates of all lanes one below the other, the number of each lane, and a row for each lane where there is no candidate."""

    rows: Array
    counts: Array
    otherwise: Array

    def take(self, lanes: Array) -> tuple[Lanes, Array]:
        """Returns some lanes, and the places of their rows in a table, that of `otherwise` behind the candidates of each lane."""
        counts = self.counts[lanes]
        starts = np.cumsum(self.counts) - self.counts
        lane = np.repeat(np.arange(len(lanes)), counts + 1)
        within = np.arange(len(lane)) - np.repeat(np.cumsum(counts + 1) - (counts + 1), counts + 1)
        is_candidate = within < counts[lane]
        rows = starts[lanes][lane] + within
        return Lanes(self.rows[rows[is_candidate]], counts, self.otherwise[lanes]), rows + lanes[lane]


def cells_of_lanes(shape: Layout, candidates: Array, counts: Array, otherwise: Array, slopes: bool) -> Results:
    """Returns the integrals of lanes.

    `candidates` has the rows of all lanes one below the other, `counts` of each lane; `otherwise` has a row for each lane.
    """
    lanes, rows = len(counts), int(counts.sum())
    given = Lanes(candidates[:rows], counts, otherwise)
    half = otherwise.shape[1] // (1 + shape.order)
    bodies = half // shape.coefficients
    columns = shape.columns * (1 + shape.order)
    tables = [np.zeros((rows + lanes, columns)) for _ in range(bodies if slopes else 0)]
    results = Results(np.empty((bodies, lanes)), np.empty((bodies, lanes)), tables)
    regions = regions_of(shape, given.rows, counts)
    known = classified(regions, lanes)
    lost, cut = np.zeros(lanes, dtype=bool), np.zeros(lanes, dtype=bool)
    lost[regions.lane[known.lost]] = True
    cut[regions.lane[known.order]] = True
    owner = np.where(known.base >= 0, regions.row[known.base] if len(regions.row) else NO_OWNER, NO_OWNER)
    _fill(shape, given, (~(cut | lost), owner), results)
    for lane in np.flatnonzero(lost):
        _single(shape, given, int(lane), results)
    cut_lanes = np.flatnonzero(cut & ~lost)
    for first in range(0, len(cut_lanes), CHUNK):
        chunk = cut_lanes[first : first + CHUNK]
        some, places = given.take(chunk)
        found = _cut(shape, some, slopes)
        results.values[:, chunk], results.sizes[:, chunk] = found.values, found.sizes
        for table, part in zip(results.tables, found.tables, strict=False):
            table[places] = part
    return results


def _single(shape: Layout, given: Lanes, lane: int, results: Results) -> None:
    """Computes a lane by itself."""
    some, places = given.take(np.array([lane]))
    found = integrals(shape, some.rows.tolist(), some.otherwise[0].tolist(), bool(results.tables))
    results.values[:, lane], results.sizes[:, lane] = found.values, found.sizes
    for table, part in zip(results.tables, found.tables, strict=False):
        table[places] = part


def _cut(shape: Layout, given: Lanes, slopes: bool) -> Results:
    """Computes lanes that are cut; where lines through one place part along the direction, derivatives are the mean of both sides."""
    found, speeds = _beside(shape, given, slopes)
    lanes = np.flatnonzero(speeds)
    if not lanes.size or not slopes:
        return found
    some, places = given.take(lanes)
    steps = PARTING / speeds[lanes]
    sides = [_beside(shape, _moved(shape, some, factor * steps), True)[0].tables for factor in (1.0, -1.0, 2.0, -2.0)]
    lane, own = np.repeat(np.arange(len(lanes)), some.counts + 1), shape.columns
    for table, *several in zip(found.tables, *sides, strict=True):
        one, other, far, farther = (t[:, :own] for t in several)
        near, far = 0.5 * (one + other), 0.5 * (far + farther)
        size = np.zeros(len(lanes))
        np.maximum.at(size, lane, np.abs(np.where(np.isfinite(near), near, 0.0)).max(axis=1, initial=0.0))
        known = ~np.isnan(table[places, :own]) & (np.abs(near - far) <= LIMIT * size[lane][:, None])
        table[places, :own] = np.where(known, 2.0 * near - far, np.nan)
    return found


def _moved(shape: Layout, given: Lanes, steps: Array) -> Lanes:
    """Returns lanes whose numbers are moved along their direction."""
    rows, otherwise, wide = given.rows.copy(), given.otherwise.copy(), given.rows.shape[1] // 2
    half = otherwise.shape[1] // 2
    rows[:, :wide] += np.repeat(steps, given.counts)[:, None] * rows[:, wide:]
    otherwise[:, :half] += steps[:, None] * otherwise[:, half:]
    return given._replace(rows=rows, otherwise=otherwise)


def _beside(shape: Layout, given: Lanes, slopes: bool) -> tuple[Results, Array]:
    """Computes lanes; where a line lies on a side, or keys meet that have no second derivative there, derivatives are the mean of both
    sides. Also returns the speeds with which lines through one place part along the direction."""
    numbers = _numbers(shape, given)
    measured, touching, concurrent, guarded = _measured(shape, given, numbers, UNMOVED)
    values, sizes = measured.values(len(given.counts))
    if not slopes and not shape.order:
        return Results(values, sizes, []), np.zeros(len(given.counts))
    tables = measured.tables()
    meeting = (concurrent > 0) & ~touching
    moved = np.repeat(touching | meeting, given.counts + 1)
    for table in tables:
        table[moved] = 0.0
    for shift, squares in (
        (SHIFT, squares_beside(shape, given.rows, given.counts, np.flatnonzero(touching))),
        (0.0, both_ways(np.flatnonzero(meeting))),
    ):
        for sign in (1.0, -1.0):
            _add_squares(shape, given, tables, (squares[sign], sign * shift, sign * (concurrent > 0), concurrent > 1))
    if shape.order:
        values = np.stack([_along(shape, table, k, (given, numbers)) for k, table in enumerate(tables)])
    speeds = np.where(guarded, parting(measured, len(given.counts)), 0.0) if shape.order and slopes else np.zeros(len(given.counts))
    return Results(values, sizes, tables if slopes else []), speeds


def _add_squares(shape: Layout, given: Lanes, tables: list[Array], moved: tuple[Squares, float, Array, Array]) -> None:
    """Adds the tables of squares that are moved, or whose keys are taken apart; those that are lost are NaN."""
    squares, shift, nudge, lost = moved
    lanes = np.array(squares.lanes, dtype=int)
    if not lanes.size:
        return
    some, places = given.take(lanes)
    starts = np.cumsum(some.counts) - some.counts
    for k, rows in squares.candidates.items():
        some.rows[starts[k] : starts[k] + len(rows)] = rows
    own = _numbers(shape, some)
    taken_apart = nudge[lanes] if nudge[lanes].any() else None
    found = _measured(shape, some, own, Moved((shift, shift * SKEW), taken_apart))[0].tables()
    weights = np.where(lost[lanes], np.nan, squares.weights)[own.square, None]
    for table, part in zip(tables, found, strict=True):
        np.add.at(table, places, weights * part)


def _measured(shape: Layout, given: Lanes, numbers: Numbers, moved: Moved) -> tuple[Measured, Array, Array, Array]:
    """Returns squares as they are `moved`, and which of them are touching, concurrent and guarded (`Arrangements`)."""
    regions = regions_of(shape, given.rows, given.counts, moved)
    known = classified(regions, len(given.counts))
    guarded = np.zeros(len(given.counts), dtype=bool)
    guarded[regions.lane[known.order[known.cutting[known.order].any(axis=1)]]] = True
    tiles = tiled(regions, known)
    cells = Arrangements(shape, tiles.regions, tiles.known, tiles.boxes, guarded[tiles.square])
    if moved.nudge is not None:
        cells.ambiguous |= (cells.concurrent > 0) & (moved.nudge[tiles.square] != 0.0)
    touching, concurrent = np.zeros(len(given.counts), dtype=bool), np.zeros(len(given.counts), dtype=int)
    touching[tiles.square[cells.touching]] = True
    np.maximum.at(concurrent, tiles.square, cells.concurrent)
    ambiguous = np.bincount(tiles.square, cells.ambiguous, len(given.counts)) > 0
    concurrent[(touching | ambiguous) & (concurrent > 0)] = 2
    return Measured(shape, cells, numbers, moved.shift, tiles.square[cells.lane]), touching, concurrent, guarded


def _numbers(shape: Layout, given: Lanes) -> Numbers:
    rows, counts = len(given.rows), given.counts
    half = given.otherwise.shape[1] // (1 + shape.order)
    wide = shape.forms + half
    place = np.arange(rows) + np.repeat(np.arange(len(counts)), counts)
    beyond = np.cumsum(counts + 1) - 1
    both = []
    for order in range(1 + shape.order):
        polynomials = np.empty((rows + len(counts), half))
        polynomials[place] = given.rows[:, order * wide + shape.forms : (order + 1) * wide]
        polynomials[beyond] = given.otherwise[:, order * half : (order + 1) * half]
        both.append(polynomials)
    return Numbers(given.rows, both[0], both[-1], place, beyond, np.repeat(np.arange(len(counts)), counts + 1))


def _along(shape: Layout, table: Array, body: int, given: tuple[Lanes, Numbers]) -> Array:
    """Returns the derivatives along the direction, from a table of derivatives of order 1."""
    lanes, numbers = given
    half, width = lanes.rows.shape[1] // 2, shape.coefficients
    moving = np.zeros((len(table), shape.columns))
    moving[numbers.place, : shape.forms] = lanes.rows[:, half : half + shape.forms]
    moving[:, shape.forms :] = numbers.changes[:, body * width : (body + 1) * width]
    slopes = table[:, shape.columns :]  # 0 for a candidate that is not there, whose numbers may be infinite
    shares = np.where((moving != 0.0) & (slopes != 0.0), moving * slopes, 0.0).sum(axis=1)
    return np.bincount(np.repeat(np.arange(len(lanes.counts)), lanes.counts + 1), shares, len(lanes.counts))


def _fill(shape: Layout, given: Lanes, uncut: tuple[Array, Array], results: Results) -> None:
    """Computes the lanes that are not cut, from the row of their owner; -1 for none."""
    whole, owner = uncut
    moments = np.array([1.0 / ((i + 1) * (j + 1)) for i, j in monomials(shape.degree)])
    half = given.otherwise.shape[1] // (1 + shape.order)
    (lanes,) = np.nonzero(whole)
    owners = owner[lanes]
    seen = owners >= 0
    polynomials = given.otherwise[lanes]
    for order in range(1 + shape.order):
        first = shape.forms + order * (shape.forms + half)
        polynomials[seen, order * half : (order + 1) * half] = given.rows[owners[seen], first : first + half]
    for body, (value, size) in enumerate(zip(results.values, results.sizes, strict=True)):
        own = polynomials[:, body * len(moments) : (body + 1) * len(moments)]
        moving = polynomials[:, half * shape.order + body * len(moments) :][:, : len(moments)]
        value[lanes], size[lanes] = moving @ moments, np.abs(own).sum(axis=1)
    rows = np.where(seen, owners, np.cumsum(given.counts)[lanes]) + lanes
    last = shape.order * shape.columns + shape.forms
    for table in results.tables:
        table[rows, last : last + len(moments)] = moments
