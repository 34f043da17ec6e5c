"""A square picture in square cells of two triangles each, and the pixels that each triangle can reach.

Coordinates are in pixels, x to the right, y downwards. Each vertex has a place of its own, from which the network may move it by less
than REACH along x and y. So the pixels that a triangle can touch are known in advance, as JAX requires. Vertices on the border slide
along it, the four corners stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np

CELL = 4  # pixels per side
REACH = 1.8  # pixels: vertices may come close to each other, and two of them may even change sides


@dataclass(frozen=True)
class GridMesh:
    """Places of the vertices (n, 2), triangles (m, 3) in positive order, and which coordinates may move, (n, 2) of 0 and 1.

    `pixels`, (m, w, w, 2), are column and row of the pixels in each triangle's window.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    movable: np.ndarray
    pixels: np.ndarray
    cells: int

    @property
    def size(self) -> int:
        """Returns the number of pixels per side."""
        return self.cells * CELL


def make_mesh(cells: int) -> GridMesh:
    """Returns a mesh of cells² cells, their diagonals in alternating directions."""
    line = np.arange(cells + 1)
    unit = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    a = (line[:-1, None] * (cells + 1) + line[:-1]).ravel()  # the upper left corner of each cell
    b, c, d = a + 1, a + cells + 1, a + cells + 2
    even = (unit[a].sum(axis=1) % 2 == 0)[:, None, None]
    falling, rising = ([(a, b, d), (a, d, c)], [(a, b, c), (b, d, c)])
    faces = np.where(even, *(np.moveaxis(np.array(pair), 2, 0) for pair in (falling, rising))).reshape(-1, 3)
    movable = (unit > 0) & (unit < cells)
    pixels = _windows(unit[faces].min(axis=1) * CELL, cells * CELL)
    return GridMesh((unit * CELL).astype(np.float32), faces, movable.astype(np.float32), pixels, cells)


def signed_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Returns the signed areas of the triangles, square pixels; negative for one that is turned over."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    return np.asarray((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2)


def _windows(first: np.ndarray, size: int) -> np.ndarray:
    """Returns column and row of the pixels around cells that begin at `first`, (m, 2), equally many for each, all inside of the picture."""
    width = min(size, ceil(CELL + REACH) - floor(-REACH))
    start = np.clip(first + floor(-REACH), 0, size - width)
    across = np.stack(np.meshgrid(np.arange(width), np.arange(width)), axis=-1)
    return np.asarray(start[:, None, None, :] + across)
