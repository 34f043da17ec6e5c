"""Squares with many candidates, cut into tiles before any cell is: most candidates of a square are absent from a tile, or hidden there.

Cells of tiles are cells of their square: nothing is scaled, and the sides of tiles, like those of the square, belong to no line. So many
candidates in one square cost nearly what they cost in many squares, all of which insert their next one in the same step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrangement import UNIT, Inserted, Regions, classified
from teg.numerics.cells import TILE_AT

Array = npt.NDArray[Any]
MOST = 16
"""The number of candidates seen in a tile up to which it is not cut."""
EACH = 1
"""The number of candidates of a square for each of its tiles, at least."""
LEVELS = 8
"""How often a tile is cut into four, at most."""


class Tiles(NamedTuple):
    """The regions of tiles, the square of each tile, and from where to where it goes: (tiles, 2, 2), the first and the last u and v."""

    regions: Regions
    known: Inserted
    square: Array
    boxes: Array


def tiled(regions: Regions, known: Inserted) -> Tiles:
    """Returns the tiles of squares; most squares are one."""
    lanes = len(known.base)
    tiles = Tiles(regions, known, np.arange(lanes), np.broadcast_to(UNIT, (lanes, 2, 2)))
    done: list[Tiles] = []
    count = np.bincount(regions.lane[known.order], minlength=lanes)
    for level in range(1, LEVELS + 1):
        seen = np.bincount(tiles.regions.lane[tiles.known.order], minlength=len(tiles.square))
        heavy = (seen > MOST) & (EACH * 4**level <= count[tiles.square])
        if not heavy.any():
            break
        done.append(_some(tiles, ~heavy))
        tiles = _quarters(_some(tiles, heavy))
    return _all([*done, tiles]) if done else tiles


def _some(tiles: Tiles, which: Array) -> Tiles:
    """Returns some tiles, without the regions that are not seen in them."""
    known, number = tiles.known, np.cumsum(which) - 1
    seen = np.zeros(len(tiles.regions.lane), dtype=bool)
    seen[known.order] = True
    seen[known.base[known.base >= 0]] = True
    regions = tiles.regions.take(np.flatnonzero(seen & which[tiles.regions.lane]))
    regions = regions._replace(lane=number[regions.lane])
    boxes = tiles.boxes[which]
    return Tiles(regions, classified(regions, len(boxes), boxes), tiles.square[which], boxes)


def _quarters(tiles: Tiles) -> Tiles:
    """Returns the quarters of all tiles."""
    low, high = tiles.boxes[..., 0], tiles.boxes[..., 1]
    middle = low + np.array(TILE_AT) * (high - low)
    ends = np.stack([low, middle, high], axis=1)  # (tiles, 3, coordinates)
    boxes = np.concatenate([np.stack([ends[:, [i, j], [0, 1]], ends[:, [i + 1, j + 1], [0, 1]]], axis=2) for i in (0, 1) for j in (0, 1)])
    count = len(tiles.square)
    four = tiles.regions.take(np.tile(np.arange(len(tiles.regions.lane)), 4))
    regions = four._replace(lane=four.lane + np.repeat(np.arange(4) * count, len(tiles.regions.lane)))
    return Tiles(regions, classified(regions, 4 * count, boxes), np.tile(tiles.square, 4), boxes)


def _all(parts: list[Tiles]) -> Tiles:
    """Returns the tiles of all parts."""
    before = np.cumsum([0, *(len(p.square) for p in parts)])
    shifted = [p.regions._replace(lane=p.regions.lane + n) for p, n in zip(parts, before[:-1], strict=True)]
    regions = Regions(*(np.concatenate(fields) for fields in zip(*shifted, strict=True)))
    boxes = np.concatenate([p.boxes for p in parts])
    return Tiles(regions, classified(regions, len(boxes), boxes), np.concatenate([p.square for p in parts]), boxes)
