"""Penalties on the shape of triangles, a compiled program like the loss: means over the triangles of the mesh.

    penalty = 1/triangles Σ_faces  smoothness · Σ |edge|² / (3·cell²)  +  keep_area · mean area / area

The first is least for short edges, which even the mesh out. The second is infinite for a triangle without area. Number of triangles, cell
and mean area are those of the first mesh, so that penalties of single triangles can be compared during a refinement.
"""

from __future__ import annotations

import numpy as np

import teg
from teg.evaluator.options import Backend
from teg.examples.triangulation.mesh import Mesh
from teg.examples.triangulation.scene import FACES, VERTICES, WEIGHTS
from teg.ir.expr import Expr

EDGES, AREAS = teg.params("edges areas")  # factors of the squared edges, and of the reciprocal area


def shape_penalty() -> Expr:
    """Returns the weighted sum over all triangles."""
    face = teg.index("face")
    a, b, c = [(VERTICES[FACES[face, k], 0], VERTICES[FACES[face, k], 1]) for k in range(3)]
    squares = sum((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 for p, q in ((a, b), (b, c), (c, a)))
    area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2
    return teg.sum(WEIGHTS[face] * (EDGES * squares + AREAS / area), (face, 0, teg.length(FACES, 0)))


class Penalty:
    """The penalty of a mesh with the units of a first `mesh`; `smoothness` and `keep_area` are dimensionless, 0 for none."""

    def __init__(self, mesh: Mesh, smoothness: float, keep_area: float, backend: Backend) -> None:
        self.program = teg.compile(shape_penalty(), [VERTICES, WEIGHTS], backend=backend)
        self.count = len(mesh.triangles)
        self.factors = {"edges": smoothness / (3 * mesh.cell**2), "areas": keep_area * mesh.area / self.count}

    def gradient(self, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Returns the derivative by the vertices, (n, 2)."""
        return np.asarray(self.program.grad(self._values(vertices, triangles))["vertices"])

    def of_triangles(self, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Returns the share of each triangle, (m,); their sum is the penalty."""
        return np.asarray(self.program.grad(self._values(vertices, triangles))["weights"]) / self.count

    def hessian_product(self, vertices: np.ndarray, triangles: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Returns the second derivative by the vertices times a direction, (n, 2)."""
        return np.asarray(self.program.hvp(self._values(vertices, triangles), {"vertices": direction})["vertices"])

    def _values(self, vertices: np.ndarray, triangles: np.ndarray) -> dict[str, np.ndarray | float]:
        weights = np.full(len(triangles), 1 / self.count)
        return {"vertices": vertices, "faces": triangles, "weights": weights, **self.factors}
