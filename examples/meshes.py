"""Closed meshes made of a grid of points that closes both ways: a torus, and a tube around a knot."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]


def grid_of(triangles: int) -> tuple[int, int]:
    """Returns how many points along a tube and around it give about as many triangles."""
    around = max(3, round((triangles / 4.8) ** 0.5))
    return max(3, round(triangles / (2 * around))), around


def closed(points: Array) -> tuple[Array, Faces]:
    """Returns vertices and faces of a grid of points of shape (along, around, 3) whose last row and column are beside the first.

    Faces turn to the left when they are seen from the side on which `around` turns to the left of `along`.
    """
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    one, two = np.roll(number, -1, 0), np.roll(number, -1, 1)
    both = np.roll(one, -1, 1)
    faces = np.concatenate([np.stack([number, one, both], -1).reshape(-1, 3), np.stack([number, both, two], -1).reshape(-1, 3)])
    return points.reshape(-1, 3), faces


def torus(along: int, around: int) -> tuple[Array, Faces]:
    """Returns vertices and faces, which turn to the left when they are seen from outside, of a torus with the radii 1 and 0.42."""
    a, b = (2 * np.pi * np.arange(n) / n for n in (along, around))
    ring = 1 + 0.42 * np.cos(b)
    return closed(np.stack([np.outer(np.cos(a), ring), np.outer(np.sin(a), ring), np.tile(0.42 * np.sin(b), (along, 1))], axis=-1))


def knot(along: int, around: int) -> tuple[Array, Faces]:
    """Returns vertices and faces, which turn to the left when they are seen from outside, of a tube around a trefoil of size 1."""
    a, b = (2 * np.pi * np.arange(n) / n for n in (along, around))
    middle = np.stack([np.sin(a) + 2 * np.sin(2 * a), np.cos(a) - 2 * np.cos(2 * a), -np.sin(3 * a)], axis=-1) / 3
    tangent = np.stack([np.cos(a) + 4 * np.cos(2 * a), 4 * np.sin(2 * a) - np.sin(a), -3 * np.cos(3 * a)], axis=-1)
    bend = np.stack([-np.sin(a) - 8 * np.sin(2 * a), 8 * np.cos(2 * a) - np.cos(a), 9 * np.sin(3 * a)], axis=-1)
    second = np.cross(tangent, bend)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    first = np.cross(second, tangent)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    offset = -np.cos(b)[:, None] * first[:, None] + np.sin(b)[:, None] * second[:, None]
    return closed(middle[:, None] + 0.19 * offset)


def normals_of(vertices: Array, faces: Faces) -> Array:
    """Returns the unit normals of faces, outwards."""
    u, v = (vertices[faces[:, n]] - vertices[faces[:, 0]] for n in (1, 2))
    normals = np.cross(u, v)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
