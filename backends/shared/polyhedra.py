"""Boxes cut by half-spaces, for NumPy and JAX: `Polyhedron` of `teg.program`.

A convex polyhedron is a matrix over its faces: in row f and column g stands the edge that both share, if `there` says so, as the corner at
which it starts on its way around face f; it stops at the one in row g and column f. Faces 0 to 5 are the sides of the box, number 6 + k is
half-space k. A half-space cuts all edges at once. Arrays are (3, faces, faces, …) and (faces, faces, …).

`zero` keeps a product and a sum apart (see `teg.backends.text`), and is 0.0 in NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from teg.numerics.polyhedra import CORNERS, SIDES, box_edges
from teg.program import CLIP_EPS

Scalar = Any
Half = tuple[Scalar, Scalar, Scalar, Scalar]
"""The slopes of a half-space, and its offset."""


class Solid(NamedTuple):
    """A convex polyhedron for each element of the batch."""

    starts: Any
    there: Any


class Tetrahedra(NamedTuple):
    """One for each edge of each face: the mean of all ends of edges, and from there the mean of the face's, and the ends of the edge; with
    volumes, 0 where there is no edge."""

    middle: Any
    sides: tuple[Any, Any, Any]
    volumes: Any


@cache
def _unit_box(faces: int) -> tuple[Any, Any]:
    """Returns the starts of the edges of the unit cube, and where there is one."""
    starts, there = np.zeros((3, faces, faces)), np.zeros((faces, faces), bool)
    for face, other, start, stop in box_edges():
        starts[:, face, other], starts[:, other, face] = CORNERS[start], CORNERS[stop]
        there[face, other] = there[other, face] = True
    return starts, there


def least_and_most(xp: Any, half: Half, extents: Sequence[Scalar], zero: Scalar = 0.0) -> tuple[Any, Any, Any]:
    """Returns the bounds of a function on a box, and the size of its terms there."""
    *slopes, offset = half
    least, most, scale = offset, offset, xp.abs(offset)
    for slope, extent in zip(slopes, extents, strict=True):
        end = slope * extent + zero
        least, most = least + xp.where(end >= 0.0, 0.0, end), most + xp.where(end <= 0.0, 0.0, end)
        scale = scale + xp.abs(end)
    return least, most, scale


def box(xp: Any, extents: Any, faces: int) -> Solid:
    """Returns boxes with these extents, (3, …), and room for so many faces."""
    starts, there = _unit_box(faces)
    lanes = (1,) * (extents.ndim - 1)
    starts = starts.reshape(*starts.shape, *lanes) * extents[:, None, None]
    return Solid(starts, xp.broadcast_to(there.reshape(*there.shape, *lanes), starts.shape[1:]))


def clipped(xp: Any, solid: Solid, number: Scalar, half: Half, scale: Scalar, zero: Scalar = 0.0) -> Solid:
    """Returns the part of polyhedra inside a half-space, whose terms have this size; `number` is that of the new face."""
    (starts, there), (a, b, c, d) = solid, half
    heights = ((d + (a * starts[0] + zero)) + (b * starts[1] + zero)) + (c * starts[2] + zero)
    inside = heights >= -CLIP_EPS * scale
    stops_inside = xp.swapaxes(inside, 0, 1)
    leaves = there & inside & ~stops_inside
    high, low = xp.maximum(heights, 0.0), xp.swapaxes(heights, 0, 1)
    t = high / xp.where(leaves, high - low, 1.0)
    new = xp.where(leaves, starts + (t * (xp.swapaxes(starts, 1, 2) - starts) + zero), 0.0)
    back = xp.swapaxes(new, 1, 2)
    starts = xp.where(xp.swapaxes(leaves, 0, 1), back, starts)
    lanes = (1,) * (there.ndim - 2)
    column = (np.arange(there.shape[0]) == number).reshape(-1, *lanes)
    row = column[:, None]
    cut = xp.any(leaves, axis=1)
    starts = xp.where(row, xp.sum(back, axis=2)[:, None], xp.where(column, xp.sum(new, axis=2)[:, :, None], starts))
    there = (there & (inside | stops_inside)) | (row & cut[None]) | (column & cut[:, None])
    return Solid(starts, there)


def tetrahedra(xp: Any, solid: Solid) -> Tetrahedra:
    """Returns the tetrahedra between the middle of polyhedra and their edges."""
    starts, there = solid
    kept = xp.where(there, starts, 0.0)
    around = xp.sum(there, axis=1)
    middle = xp.sum(kept, axis=(1, 2)) / xp.maximum(xp.sum(around, axis=0), 1)
    of_face = xp.sum(kept, axis=2) / xp.maximum(around, 1)
    u = (of_face - middle[:, None])[:, :, None]
    v = xp.where(there, starts - middle[:, None, None], 0.0)
    w = xp.swapaxes(v, 1, 2)
    across = (v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0])
    return Tetrahedra(middle, (u, v, w), sum(u[j] * across[j] for j in range(3)) / 6.0)


def centroid(xp: Any, found: Tetrahedra) -> tuple[Any, Any]:
    """Returns the centroids of polyhedra, and their volumes."""
    u, v, w = found.sides
    volume = xp.sum(found.volumes, axis=(0, 1))
    moments = xp.sum(0.25 * found.volumes * (u + v + w), axis=(1, 2))
    return found.middle + moments / xp.where(volume == 0.0, 1.0, volume), volume


def faces_of(half_spaces: int) -> int:
    """Returns the largest number of faces of a box cut by half-spaces."""
    return SIDES + half_spaces
