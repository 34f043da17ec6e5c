"""The loss of a whole picture, its gradient, and the best colours, by calls of the compiled program. Exact: nothing is sampled."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from teg.examples.triangulation.scene import CompiledScene

TOUCHING = 1e-9  # pixels that only touch an edge are kept: half of its boundary term is theirs


class PictureLoss(Protocol):
    """The interface of a loss that a descent needs."""

    pairs: int
    seconds: float

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Returns the derivative of the loss by the vertices, (n, 2)."""

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the least loss that these vertices can have, and the colours that attain it."""


class ImageLoss:
    """The loss of meshes of one topology against one picture, its gradient, and the best colours.

    `target` is (size, size, 3), `triangles` (m, 3); below, vertices are (n, 2) and colours (m, 3). `pairs` and `seconds` count the pairs
    of a triangle and a pixel that the kernels have evaluated, and their time.
    """

    def __init__(self, scene: CompiledScene, target: np.ndarray, triangles: np.ndarray) -> None:
        self.scene = scene
        self.size = len(target)
        self.target = np.ascontiguousarray(target, dtype=float)
        self.triangles = triangles
        self.pairs = 0
        self.seconds = 0.0

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Returns the derivative of the loss by the vertices, (n, 2)."""
        slopes = self._timed(self.scene.by_vertices.grad, self._values(vertices, colours))
        return np.asarray(slopes["vertices"])

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the least loss that these vertices can have, and the colours that attain it.

        The loss is quadratic in the colours, and its second derivative is diagonal: the product of the Hessian with ones is that
        diagonal, and one Newton step from any colours is exact.
        """
        values = self._values(vertices, colours)
        loss, slopes = self._timed(self.scene.by_colours.value_and_grad, values)
        curvature = self._timed(lambda v: self.scene.by_colours.hvp(v, {"colours": np.ones_like(colours)}), values)["colours"]
        change = -slopes["colours"] / curvature
        return float(loss - np.sum(change**2 * curvature) / 2), colours + change

    def _values(self, vertices: np.ndarray, colours: np.ndarray) -> dict[str, np.ndarray]:
        boxes = bounding_boxes(vertices[self.triangles], self.size)
        return {"vertices": vertices, "colours": colours, "faces": self.triangles, "target": self.target, "boxes": boxes}

    def _timed(self, function: Callable[[dict[str, np.ndarray]], Any], values: dict[str, np.ndarray]) -> Any:
        start = time.perf_counter()
        results = function(values)
        self.seconds += time.perf_counter() - start
        boxes = values["boxes"]
        self.pairs += int(np.sum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])))
        return results


def bounding_boxes(corners: np.ndarray, size: int) -> np.ndarray:
    """Returns first and end column, first and end row of the pixels in each triangle's box, touched ones included;
    `corners` is (m, 3, 2)."""
    first = np.clip(np.ceil(corners.min(axis=1) - TOUCHING).astype(int) - 1, 0, size - 1)
    end = np.clip(np.floor(corners.max(axis=1) + TOUCHING).astype(int), 0, size - 1) + 1
    return np.stack([first[:, 0], end[:, 0], first[:, 1], end[:, 1]], axis=1)
