"""Where lines through one place part along the direction: what `Measured.parting` in `teg.numerics.measured` finds for one square, for all
squares at once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrangement import Arrangements
from teg.backends.numpy.measured import Measured
from teg.numerics.cells import BOX, EPSILON, PARTED, SIDES

Array = npt.NDArray[Any]


class _Lines(NamedTuple):
    """Lines in the order of their lanes: unit forms and rates (n, 3), and the region whose guards must hold, -1 for none."""

    lane: Array
    units: Array
    rates: Array
    region: Array


class _Corners(NamedTuple):
    """Corners of cells: lane, place and velocity (n, 2)."""

    lane: Array
    at: Array
    speed: Array


def parting(measured: Measured, lanes: int) -> Array:
    """Returns the largest speed with which a corner leaves another line that it lies on, for each square; 0 if all of them stay."""
    cells = measured.cells
    cell, place = np.nonzero(cells.polygons.used())
    corners = _Corners(cells.lane[cell], cells.polygons.corners[cell, place], measured.speed[cell, place])
    fastest = np.zeros(lanes)
    square = measured.square[cell]
    for unit in SIDES:
        none = np.zeros((1, 3))
        np.maximum.at(fastest, square, _speeds(np.array([unit]), none, corners.at, corners.speed))
    lines = _lines_of(measured)
    first, last = (np.searchsorted(lines.lane, corners.lane, side) for side in ("left", "right"))
    corner = np.repeat(np.arange(len(cell)), last - first)
    line = np.arange(len(corner)) - np.repeat(np.cumsum(last - first) - last, last - first)
    speeds = _speeds(lines.units[line], lines.rates[line], corners.at[corner], corners.speed[corner])
    some = np.flatnonzero(speeds > 0.0)
    some = some[_held(cells, lines.region[line[some]], corners.at[corner[some]])]
    np.maximum.at(fastest, square[corner[some]], speeds[some])
    return fastest


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
    of = np.concatenate([region, np.full(len(keys), -1)])
    return _Lines(lane[order], cells.lines.units[number[order]], measured.rates[number[order]], of[order])


def _speeds(units: Array, rates: Array, at: Array, speed: Array) -> Array:
    """Returns the speeds of corners that lie on lines relative to these, 0 for those that do not, or that stay."""
    value = units[:, 0] + (units[:, 1:] * at).sum(axis=1)
    parts = np.concatenate([rates[:, :1] + np.zeros((len(at), 1)), rates[:, 1:] * at, units[:, 1:] * speed], axis=1)
    found = np.abs(parts.sum(axis=1))
    with np.errstate(invalid="ignore"):
        return np.where((np.abs(value) <= EPSILON) & (found > PARTED * np.abs(parts).sum(axis=1)), found, 0.0)


def _held(cells: Arrangements, region: Array, at: Array) -> Array:
    """Returns whether all guards of regions hold at places; -1 has none."""
    units, cutting = cells.units[region], cells.known.cutting[region]
    values = units[..., 0] + units[..., 1] * at[:, :1] + units[..., 2] * at[:, 1:]
    return np.asarray((region < 0) | (~cutting | (values >= -EPSILON)).all(axis=1))
