"""The loss of a whole picture, its gradient, and the best colours, by calls of the compiled program. Exact: nothing is sampled."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from teg.examples.triangulation.colour_fit import TERMS, anchors, least_squares
from teg.examples.triangulation.mesh import extent
from teg.examples.triangulation.regularisers import Penalty
from teg.examples.triangulation.scene import CompiledScene

TOUCHING = 1e-9  # pixels that only touch an edge are kept: half of its boundary term is theirs


class PictureLoss(Protocol):
    """The interface of a loss that a descent needs. `triangles` are those of the mesh; a refinement replaces them."""

    triangles: np.ndarray
    pairs: int
    seconds: float

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Returns the derivative of the loss by the vertices, (n, 2)."""

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the least loss that these vertices can have, and the colours that attain it."""


class ImageLoss:
    """The loss of meshes against one picture, its gradient, and the best colours.

    `target` is (rows, columns, 3), `triangles` (m, 3); below, vertices are (n, 2) and colours (m, 3·terms). `pairs` and `seconds` count
    the pairs of a triangle and a pixel that the kernels have evaluated, and their time. A `penalty` on shapes is part of the loss. With
    `keep_colours` the colours that are passed in count as the best ones.
    """

    def __init__(
        self, scene: CompiledScene, target: np.ndarray, triangles: np.ndarray, penalty: Penalty | None = None, keep_colours: bool = False
    ) -> None:
        self.scene = scene
        self.size = target.shape[1], target.shape[0]
        self.target = np.ascontiguousarray(target, dtype=float)
        self.triangles = triangles
        self.penalty, self.keep_colours = penalty, keep_colours
        self.pairs = 0
        self.seconds = 0.0

    @property
    def terms(self) -> int:
        """Returns the number of monomials of a colour."""
        return TERMS[self.scene.degree]

    def gradient(self, vertices: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Returns the derivative of the loss by the vertices, (n, 2)."""
        slopes = self._timed(self.scene.by_vertices.grad, self._values(vertices, colours))
        shape = self.penalty.gradient(vertices, self.triangles) if self.penalty else 0.0
        return np.asarray(slopes["vertices"] + shape)

    def hessian_product(self, vertices: np.ndarray, colours: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Returns the second derivative of the least loss by the vertices, at its colours, times a direction, (n, 2).

        While vertices move, colours follow, by -H_cc⁻¹·H_cv·d. The result is H_vv·d - H_vc·H_cc⁻¹·H_cv·d.
        """
        values = self._values(vertices, colours)

        def product(along: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
            return dict(self._timed(lambda v: self.scene.by_both.hvp(v, along), values))

        turned = product({"vertices": direction})
        if not self.keep_colours:
            follow = least_squares(turned["colours"], vertices[self.triangles], self.size[0] * self.size[1])
            turned = product({"vertices": direction, "colours": follow})
        shape = self.penalty.hessian_product(vertices, self.triangles, direction) if self.penalty else 0.0
        return np.asarray(turned["vertices"] + shape)

    def best_colours(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns the least loss that these vertices can have, and the colours that attain it."""
        losses, best = self.fit(vertices, colours)
        return math.fsum(losses), best

    def fit(self, vertices: np.ndarray, colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the least loss of each triangle, (m,), and the colours that attain it; any `colours` will do to begin with."""
        values = self._values(vertices, colours)
        slopes = self._timed(self.scene.by_colours.grad, values)
        losses = slopes["weights"] + self.penalties(vertices)
        if self.keep_colours:
            return losses, colours
        change = least_squares(slopes["colours"], vertices[self.triangles], self.size[0] * self.size[1])
        gained = np.einsum("mk,mk->m", change, slopes["colours"]) / 2
        return losses + gained, colours + change

    def penalties(self, vertices: np.ndarray) -> np.ndarray:
        """Returns the penalty of each triangle, (m,), a part of its loss."""
        return self.penalty.of_triangles(vertices, self.triangles) if self.penalty else np.zeros(len(self.triangles))

    def fit_apart(self, corners: np.ndarray) -> np.ndarray:
        """Returns the least losses of triangles that need not belong to a mesh, (m,); `corners` (m, 3, 2)."""
        apart = ImageLoss(self.scene, self.target, np.arange(3 * len(corners)).reshape(-1, 3), self.penalty)
        losses, _ = apart.fit(corners.reshape(-1, 2), np.full((len(corners), 3 * self.terms), 0.5 / self.terms))
        self.pairs, self.seconds = self.pairs + apart.pairs, self.seconds + apart.seconds
        return losses

    def _values(self, vertices: np.ndarray, colours: np.ndarray) -> dict[str, np.ndarray]:
        corners = vertices[self.triangles]
        values = {"vertices": vertices, "colours": colours, "weights": np.ones(len(corners)), "faces": self.triangles}
        values |= {"target": self.target, "boxes": bounding_boxes(corners, self.size)}
        return values | ({"anchors": anchors(corners)} if self.scene.degree else {})

    def _timed(self, function: Callable[[dict[str, np.ndarray]], Any], values: dict[str, np.ndarray]) -> Any:
        start = time.perf_counter()
        results = function(values)
        self.seconds += time.perf_counter() - start
        boxes = values["boxes"]
        self.pairs += int(np.sum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])))
        return results


def bounding_boxes(corners: np.ndarray, size: int | tuple[int, int]) -> np.ndarray:
    """Returns first and end column, first and end row of the pixels in each triangle's box, touched ones included;
    `corners` is (m, 3, 2)."""
    last = np.array(extent(size)) - 1
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    first = np.clip(np.ceil(np.minimum(np.minimum(a, b), c) - TOUCHING).astype(int) - 1, 0, last)
    end = np.clip(np.floor(np.maximum(np.maximum(a, b), c) + TOUCHING).astype(int), 0, last) + 1
    return np.stack([first[:, 0], end[:, 0], first[:, 1], end[:, 1]], axis=1)
