"""Where lines through one place part along the direction: what `Measured.parting` in `teg.numerics.measured` finds for one square, for all
squares at once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.measured import Measured
from teg.numerics.cells import BOX, EPSILON, PARALLEL, PARTED, SIDES, SLOW

Array = npt.NDArray[Any]


class _Lines(NamedTuple):
    """Lines in the order of their lanes: unit forms and rates (n, 3)."""

    lane: Array
    units: Array
    rates: Array


class _Corners(NamedTuple):
    """Corners of cells: lane, place and velocity (n, 2), and the unit forms of the lines of both edges (n, 2, 3)."""

    lane: Array
    at: Array
    speed: Array
    edges: Array

    def take(self, which: Array) -> _Corners:
        return _Corners(*(field[which] for field in self))


def parting(measured: Measured, lanes: int) -> Array:
    """Returns the largest speed with which a corner leaves another line that it lies on, for each square; 0 if all of them stay,
    NaN if it is too slow."""
    cells = measured.cells
    cell, place = np.nonzero(cells.polygons.used())
    labels = cells.polygons.labels
    before = np.where(place > 0, place, cells.polygons.sizes[cell]) - 1
    edges = cells.lines.units[np.stack([labels[cell, before], labels[cell, place]], axis=1) >> 1]
    corners = _Corners(cells.lane[cell], cells.polygons.corners[cell, place], measured.speed[cell, place], edges)
    fastest, moving = np.zeros(lanes), np.zeros(lanes)
    square = measured.square[cell]
    np.maximum.at(moving, square, _size(corners.speed))
    for unit in SIDES:
        np.maximum.at(fastest, square, _speeds(np.array([unit]), np.zeros((1, 3)), corners))
    lines = _lines_of(measured)
    first, last = (np.searchsorted(lines.lane, corners.lane, side) for side in ("left", "right"))
    corner = np.repeat(np.arange(len(cell)), last - first)
    line = np.arange(len(corner)) - np.repeat(np.cumsum(last - first) - last, last - first)
    speeds = _speeds(lines.units[line], lines.rates[line], corners.take(corner))
    some = np.flatnonzero(speeds > 0.0)
    np.maximum.at(fastest, square[corner[some]], speeds[some])
    np.maximum.at(moving, square[corner[some]], _size(lines.rates[line[some]]))
    return np.where(fastest <= PARTED * moving, 0.0, np.where(fastest < SLOW * moving, np.nan, fastest))


def _size(rates: Array) -> Array:
    """Returns sizes of rates; 0 where they are not known, of edges that had another line before."""
    size = np.abs(rates).sum(axis=1)
    return np.where(np.isnan(size), 0.0, size)


def _lines_of(measured: Measured) -> _Lines:
    """Returns the lines of all lanes: those of guards that are seen, and those on which two keys are equal."""
    cells, guards = measured.cells, measured.cells.regions.guards.shape[1]
    seen = np.zeros(len(cells.regions.lane), dtype=bool)
    seen[cells.known.order] = True
    region, turn = np.nonzero(cells.known.cutting & seen[:, None])
    keys = np.arange(BOX + cells.known.cutting.size, len(cells.lines.sizes))
    number = np.concatenate([BOX + region * guards + turn, keys])
    lane = np.concatenate([cells.regions.lane[region], *cells.key_lanes])
    order = np.argsort(lane, kind="stable")
    return _Lines(lane[order], cells.lines.units[number[order]], measured.rates[number[order]])


def _speeds(units: Array, rates: Array, corners: _Corners) -> Array:
    """Returns the speeds of corners that lie on lines relative to these; 0 for those that do not, that stay, or whose edge is the line."""
    value = units[:, 0] + (units[:, 1:] * corners.at).sum(axis=1)
    found = np.abs(rates[:, 0] + (rates[:, 1:] * corners.at).sum(axis=1) + (units[:, 1:] * corners.speed).sum(axis=1))
    across = units[:, None, 1] * corners.edges[..., 2] - units[:, None, 2] * corners.edges[..., 1]
    apart = (np.abs(across) > PARALLEL).all(axis=1)
    return np.where((np.abs(value) <= EPSILON) & apart & ~np.isnan(found), found, 0.0)
