"""Edges on lines of equal keys where several pairs of candidates have one line, in many squares at once.

What `teg.numerics.key_edges` does for one square.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.numerics.cells import BOX, EPSILON, NO_OWNER, ROUNDING

Array = npt.NDArray[Any]
BLOCK = 1 << 16
"""The number of pairs of an edge and a region that are compared at a time."""


class KeyEdges(NamedTuple):
    """Edges of cells on lines of equal keys: the cell, the place in it, both ends (edges, 2); and the row
    that made it with the owner, -1 if the owner is not one of that pair."""

    cell: Array
    place: Array
    start: Array
    end: Array
    partner: Array

    def take(self, which: Array) -> KeyEdges:
        return KeyEdges(*(field[which] for field in self))


class Late(NamedTuple):
    """Edges that belong to another pair than that of their line: cell, place, owner, the region beyond; squares with `ambiguous` ones."""

    cell: Array
    place: Array
    owner: Array
    beyond: Array
    ambiguous: Array


def late_edges(cells: Any, rows: Array, tied: Array) -> Late:
    """Returns the edges in `tied` squares of `cells` whose lines, of pairs `rows`, are not those of the owners of their sides."""
    p, first = cells.polygons, BOX + cells.known.cutting.size
    on_key = p.used() & (p.labels >= 2 * first) & (tied[cells.lane] & (cells.owner != NO_OWNER))[:, None]
    cell, place = np.nonzero(on_key)
    owner, pair = cells.owner[cell], rows[(p.labels[cell, place] >> 1) - first]
    mine = cells.regions.row[owner]
    partner = np.where(pair[:, 0] == mine, pair[:, 1], np.where(pair[:, 1] == mine, pair[:, 0], -1))
    edges = KeyEdges(cell, place, p.corners[cell, place], p.corners[cell, p.following()[cell, place]], partner)
    seen = np.concatenate([cells.known.order, cells.known.base[cells.known.base >= 0]])
    seen = seen[np.lexsort((seen, cells.regions.lane[seen]))]
    lanes = cells.regions.lane[seen]
    starts, stops = (np.searchsorted(lanes, cells.lane[cell], side) for side in ("left", "right"))
    beyond, ambiguous = np.full(len(cell), NO_OWNER), np.zeros(len(cell), dtype=bool)
    parts = 1 + int((stops - starts).sum()) // BLOCK
    for some in np.array_split(np.arange(len(cell)), parts):
        beyond[some], ambiguous[some] = _beyond(cells, edges.take(some), (seen, starts[some], stops[some]))
    (late,) = np.nonzero((beyond != NO_OWNER) & (cells.regions.row[beyond] != partner))
    return Late(cell[late], place[late], owner[late], beyond[late], np.unique(cells.lane[cell[ambiguous]]))


def _beyond(cells: Any, edges: KeyEdges, among: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Returns for each edge the region beyond it whose key is equal to the owner's along it, NO_OWNER for none; and which are ambiguous."""
    seen, starts, stops = among
    count = len(edges.cell)
    edge = np.repeat(np.arange(count), stops - starts)
    within = np.arange(len(edge)) - np.repeat(np.cumsum(stops - starts) - (stops - starts), stops - starts)
    region, owner = seen[starts[edge] + within], cells.owner[edges.cell[edge]]
    start, end = edges.start[edge], edges.end[edge]
    length = np.hypot(*(end - start).T)
    first, last, coincides = _held(cells, region, (start, end))
    own, key = cells.regions.key[owner], cells.regions.key[region]
    g = own - key
    scale = np.maximum(np.abs(own[:, 0]), np.abs(key[:, 0]))
    tolerance = EPSILON * np.hypot(g[:, 1], g[:, 2]) + ROUNDING * scale
    d, e = (g[:, 0] + g[:, 1] * at[:, 0] + g[:, 2] * at[:, 1] for at in (start, end))
    seen_there = ((last - first) * length > EPSILON) & (length > EPSILON)
    way = end - start
    slope = (g[:, 1] * way[:, 1] - g[:, 2] * way[:, 0]) / np.where(length > 0.0, length, 1.0)  # corners go round anticlockwise
    flat = ROUNDING * (np.abs(own) + np.abs(key)).sum(axis=1)
    equal = seen_there & ~coincides & (np.maximum(np.abs(d), np.abs(e)) <= tolerance) & (slope > flat)
    unknown = equal & ((last - first) * length < length - EPSILON) & (cells.regions.row[region] != edges.partner[edge])
    steepest = np.zeros(count)
    np.maximum.at(steepest, edge[equal], slope[equal])
    nearest = equal & (slope >= steepest[edge] - flat)
    unknown |= (
        equal & ~nearest & ((own[:, 2] != 0.0) | (key[:, 2] != 0.0))
    )  # three straight lines in one point: the pair that is there counts
    beyond = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(beyond, edge[nearest], region[nearest])
    ambiguous = np.bincount(edge[unknown], minlength=count) > 0
    return np.where(steepest > 0.0, beyond, NO_OWNER), ambiguous


def _held(cells: Any, region: Array, ends: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Returns the parts of edges where the guards of regions hold, and whether one of these has the line of the edge."""
    cutting = cells.known.cutting[region]
    units = np.where(cutting[..., None], cells.units[region], np.array([1.0, 0.0, 0.0]))
    d, e = (units[..., 0] + units[..., 1] * at[:, :1] + units[..., 2] * at[:, 1:] for at in ends)
    on = (np.abs(d) < EPSILON) & (np.abs(e) < EPSILON)
    outside = ((d < EPSILON) & (e < EPSILON) & ~on).any(axis=1)
    t = d / np.where(d * e < 0.0, d - e, 1.0)
    first = np.where((d < 0.0) & (e >= EPSILON) & ~on, t, 0.0).max(axis=1, initial=0.0)
    last = np.where((d >= EPSILON) & (e < 0.0) & ~on, t, 1.0).min(axis=1, initial=1.0)
    return first, np.where(outside, -1.0, last), on.any(axis=1)
