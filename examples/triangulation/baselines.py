"""Meshes to compare with, and the usual measure of likeness."""

from __future__ import annotations

import math

import numpy as np

from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import Mesh, inner, signed_areas

ROUNDING = 1e-12  # of a loss


def random_delaunay(triangles: int, size: tuple[int, int], seed: int) -> Mesh:
    """Returns Delaunay's triangulation of random points, with about that many triangles; points on the border are evenly spaced."""
    from scipy.spatial import Delaunay

    width, height = size
    columns, rows = (max(1, round(math.sqrt(triangles / 2 * a / b))) for a, b in ((width, height), (height, width)))
    x, y = np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1)
    sides = [[(a, b) for a in x for b in (0, height)], [(a, b) for a in (0, width) for b in y[1:-1]]]
    border = np.array([point for side in sides for point in side], dtype=float)
    count = max(0, round((triangles + 2 - len(border)) / 2))
    points = np.concatenate([border, np.random.default_rng(seed).uniform(0.01, 0.99, (count, 2)) * size])
    faces = Delaunay(points).simplices.astype(np.intp)
    areas = signed_areas(points, faces)
    faces = np.where((areas < 0)[:, None], faces[:, ::-1], faces)[np.abs(areas) > 1e-9 * width * height / triangles]
    return Mesh(points, faces, inner(points, size), size)


def best_loss(image: ImageLoss, mesh: Mesh) -> float:
    """Returns the loss of a mesh in its best colours, without penalties."""
    bare = ImageLoss(image.scene, image.target, mesh.triangles)
    return float(bare.fit_apart(mesh.vertices[mesh.triangles]).sum())


def psnr(loss: float) -> float:
    """Returns the peak signal-to-noise ratio in dB, of a loss that is the squared difference summed over three channels.

    A loss of 0 to rounding has 125 dB.
    """
    return 10 * math.log10(3 / max(loss, ROUNDING))
