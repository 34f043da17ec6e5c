"""The loss of a whole picture: gather pairs, call the compiled kernel, scatter its results.

    loss = 1/size² Σ over pairs (triangle, pixel) of the integral of `scene.pixel_loss`

per pixel, and exact: no sample is taken anywhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from teg.examples.triangulation.scene import COLOUR, CORNER, TARGET, VERTICES, CompiledScene

BLOCK = 2**20  # pairs in one call of a kernel, about: bounds the memory
JAX_MULTIPLE = 2**15  # JAX compiles for each length of a batch: pad to few different ones
TOUCHING = 1e-9  # pixels that only touch an edge are kept: half of its boundary term is theirs


class ImageLoss:
    """The loss of meshes of one topology against one picture, its gradient, and the best colours.

    `target` is (size, size, 3), `triangles` (m, 3); below, vertices are (n, 2) and colours (m, 3).
    `pairs` and `seconds` count what the kernels have evaluated, and in what time.
    """

    def __init__(self, scene: CompiledScene, target: np.ndarray, triangles: np.ndarray) -> None:
        self.scene = scene
        self.size = len(target)
        self.target = np.ascontiguousarray(target.reshape(-1, 3).T, dtype=float)
        self.triangles = triangles
        self.pairs = 0
        self.seconds = 0.0

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """The derivative of the loss by the vertices, (n, 2)."""
        gradient = np.zeros(vertices.shape)
        for face, values in self._gather(vertices, colours):
            slopes = self._timed(self.scene.loss.grad, values)
            for k, name in enumerate(VERTICES):
                owner = self.triangles[face, k // 2]
                gradient[:, k % 2] += np.bincount(owner, slopes[name][: len(face)], len(vertices))
        return gradient / self.size**2

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """The least loss that these vertices can have, and the colours that give it.

        The loss is quadratic in the colours: one Newton step from any colours is exact.
        """
        sums = np.zeros((5, len(self.triangles)))
        for face, values in self._gather(vertices, colours):
            for total, result in zip(sums, self._timed(self.scene.colours, values), strict=True):
                total += np.bincount(face, result[: len(face)], len(self.triangles))
        loss, slopes, curvature = sums[0], sums[1:4].T, sums[4]
        change = -slopes / curvature[:, None]
        gain = np.sum(change**2, axis=1) * curvature / 2
        return float(np.sum(loss - gain)) / self.size**2, colours + change

    def _gather(self, vertices: np.ndarray, colours: np.ndarray) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
        """The triangle of each pair and the columns of the kernel, block by block."""
        corners = vertices[self.triangles]
        for block in _blocks(corners, self.size):
            face, column, row = overlapping_pairs(corners[block], self.size)
            face += block.start
            pixel = row * self.size + column
            columns = [
                *(corners[:, k // 2, k % 2][face] for k in range(6)),
                *(colours[:, k][face] for k in range(3)),
                *(channel[pixel] for channel in self.target),
                column.astype(float),
                row.astype(float),
            ]
            yield face, dict(zip(VERTICES + COLOUR + TARGET + CORNER, columns, strict=True))

    def _timed(self, function: Callable[[dict[str, np.ndarray]], Any], values: dict[str, np.ndarray]) -> Any:
        n = len(values[CORNER[0]])
        if self.scene.backend == "jax":
            values = {k: np.pad(v, (0, -n % JAX_MULTIPLE), mode="edge") for k, v in values.items()}
        start = time.perf_counter()
        results = function(values)
        self.seconds += time.perf_counter() - start
        self.pairs += n
        return results


def overlapping_pairs(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle, column and row of every pair that may overlap or touch; `corners` is (m, 3, 2).

    From the triangles' bounding boxes, less the pixels that lie wholly outside one edge: the largest value of
    the edge's function over the pixel is negative there, and the integral exactly zero.
    """
    first, extent = _bounding_boxes(corners, size)
    width, count = extent[:, 0], extent.prod(axis=1)
    face = np.repeat(np.arange(len(corners)), count)
    row, column = np.divmod(np.arange(len(face)) - (np.cumsum(count) - count)[face], width[face])
    column += first[face, 0]
    row += first[face, 1]
    kept = np.ones(len(face), dtype=bool)
    for k in range(3):
        (x, y), (dx, dy) = corners[:, k].T, (corners[:, (k + 1) % 3] - corners[:, k]).T
        reach = (np.abs(dx) + np.abs(dy)) * (0.5 + TOUCHING)
        highest_at_zero = dx * (0.5 - y) - dy * (0.5 - x) + reach
        kept &= dx[face] * row - dy[face] * column + highest_at_zero[face] >= 0
    return face[kept], column[kept], row[kept]


def _bounding_boxes(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The first pixel and the number of pixels of each triangle's box, (m, 2) each as (x, y), touched ones included."""
    first = np.clip(np.ceil(corners.min(axis=1) - TOUCHING).astype(int) - 1, 0, size - 1)
    last = np.clip(np.floor(corners.max(axis=1) + TOUCHING).astype(int), 0, size - 1)
    return first, last - first + 1


def _blocks(corners: np.ndarray, size: int) -> Iterator[slice]:
    """Consecutive triangles whose boxes hold about BLOCK pixels together."""
    _, extent = _bounding_boxes(corners, size)
    block = np.cumsum(extent.prod(axis=1)) // BLOCK
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    for start, stop in zip(starts, [*starts[1:], len(corners)], strict=True):
        yield slice(int(start), int(stop))
