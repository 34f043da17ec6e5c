"""A triangle mesh over a picture, and limits of its vertices' motion that keep it from folding.

Coordinates are in pixels, x to the right, y downwards, the picture is [0, width] × [0, height]. All triangles have positive signed area.
Vertices on the border slide along it, the four corners stay; a mesh that keeps its border and its positive areas covers every point of the
picture exactly once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from teg.errors import InputError

JITTER = 0.12  # as a fraction of a cell: irregularity of the first mesh
SHRINK = 0.5  # a triangle keeps this fraction of its area in one step …
FLOOR = 0.02  # … and this fraction of the mean area always
HALVINGS = 12


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 2), triangles (m, 3) as indices of vertices, and which coordinates may move, (n, 2) bool.

    A mesh that was read may have `colours`, (m, 3·terms).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    movable: np.ndarray
    size: tuple[int, int]  # width and height
    colours: np.ndarray | None = None

    @property
    def area(self) -> float:
        """Returns the area of the picture."""
        return float(self.size[0] * self.size[1])

    @property
    def floor(self) -> float:
        """Returns the area below which no triangle may fall."""
        return FLOOR * self.area / len(self.triangles)

    @property
    def cell(self) -> float:
        """Returns the length of a typical edge: that of an equilateral triangle of the mean area."""
        return math.sqrt(4 / math.sqrt(3) * self.area / len(self.triangles))


def extent(size: int | tuple[int, int]) -> tuple[int, int]:
    """Returns width and height; one number is both."""
    return (size, size) if isinstance(size, int) else size


def inner(vertices: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Returns which coordinates may move, (n, 2): those that are not on the border."""
    return np.asarray((vertices > 0) & (vertices < size))


def pin_border(mesh: Mesh) -> Mesh:
    """Returns the mesh with all vertices of the border where they are."""
    return replace(mesh, movable=mesh.movable & inner(mesh.vertices, mesh.size).all(axis=1, keepdims=True))


def make_mesh(triangles: int, size: int | tuple[int, int], seed: int = 0) -> Mesh:
    """Returns a mesh of about that many triangles, near equilateral: staggered rows of points, the inner ones slightly jittered."""
    if triangles < 2:
        raise InputError(f"a mesh of {triangles} triangles is not possible", None, "at least 2")
    width, height = extent(size)
    columns, rows = _grid(triangles, width / height)
    random = np.random.default_rng(seed)
    points: list[np.ndarray] = []
    lines: list[np.ndarray] = []
    for row in range(rows + 1):
        x = np.linspace(0, 1, columns + 1)
        if row % 2:
            x = np.concatenate([[0.0], (x[1:] + x[:-1]) / 2, [1.0]])
        lines.append(sum(map(len, points)) + np.arange(len(x)))
        points.append(np.column_stack([x, np.full(len(x), row / rows)]))
    unit = np.concatenate(points)
    movable = (unit > 0) & (unit < 1)
    noise = random.uniform(-JITTER, JITTER, unit.shape) / [columns, rows]
    unit = np.where(movable.all(axis=1, keepdims=True), unit + noise, unit)
    faces = [face for upper, lower in pairwise(lines) for face in _strip(upper, lower, unit)]
    return Mesh(unit * [width, height], np.array(faces, dtype=np.intp), movable, (width, height))


def signed_areas(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Returns the signed areas of the triangles, square pixels; positive in a mesh that has not folded."""
    x, y = (vertices[:, axis][triangles.T] for axis in range(2))
    return np.asarray(((x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])) / 2)


def limit_step(mesh: Mesh, vertices: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Returns the vertices after the largest part of `step` that folds no triangle.

    No triangle may fall below `SHRINK` of its present area, nor below `FLOOR` of the mean area of the mesh (if it is below already, it
    may not shrink). While one would, the step of its three vertices is halved, and after `HALVINGS` rounds dropped; a mesh whose areas
    were positive keeps them positive.
    """
    areas = signed_areas(vertices, mesh.triangles)
    least = np.minimum(areas, np.maximum(SHRINK * areas, mesh.floor))
    scale = np.ones(len(vertices))
    step = np.where(mesh.movable, step, 0.0)
    for halving in range(HALVINGS + len(vertices)):
        moved: np.ndarray = vertices + scale[:, None] * step
        folding = signed_areas(moved, mesh.triangles) < least
        if not folding.any():
            return moved
        touched = np.unique(mesh.triangles[folding])
        scale[touched] = scale[touched] / 2 if halving < HALVINGS else 0.0
    return vertices


def _grid(triangles: int, aspect: float) -> tuple[int, int]:
    """Returns columns and rows of cells whose triangles, rows · (2 columns + 1), are close to the number and equilateral."""

    def badness(shape: tuple[int, int]) -> float:
        columns, rows = shape
        return abs(rows * (2 * columns + 1) / triangles - 1) + abs(math.log(rows * math.sqrt(3) / 2 / columns * aspect)) / 4

    reach = math.isqrt(round(triangles * max(aspect, 1 / aspect))) + 2
    return min(((c, r) for c in range(1, reach) for r in range(1, reach)), key=badness)


def _strip(upper: np.ndarray, lower: np.ndarray, points: np.ndarray) -> list[tuple[int, int, int]]:
    """Returns the triangles between two rows of points, each time closing the shorter diagonal."""
    faces = []
    i = j = 0
    while i + 1 < len(upper) or j + 1 < len(lower):
        along_upper = np.inf if i + 1 == len(upper) else abs(points[upper[i + 1], 0] - points[lower[j], 0])
        along_lower = np.inf if j + 1 == len(lower) else abs(points[lower[j + 1], 0] - points[upper[i], 0])
        if along_upper <= along_lower:
            faces.append((upper[i], upper[i + 1], lower[j]))
            i += 1
        else:
            faces.append((lower[j], upper[i], lower[j + 1]))
            j += 1
    return faces
