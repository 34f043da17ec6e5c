"""The loss of a mesh against a picture with the best colours: exact, and plain JAX except for the covered areas.

    loss = 1/size² Σ_triangles Σ_pixels  ∫∫_pixel [(x, y) inside the triangle] · Σₖ (colourₖ - pictureₖ)² dx dy

It is quadratic in the colours, and the best colour of a triangle is the picture's mean over it. Substituted, the loss is a function of
the vertices alone, Σ_triangles ∫picture² - (∫picture)²/area, which JAX differentiates through the areas of the pixels' parts.

A triangle that is turned over covers nothing, and its neighbours then cover the same points twice and both pay for them, so no penalty
is needed to keep meshes from folding.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from teg.examples.mesh_network.coverage import Cover
from teg.examples.mesh_network.mesh import GridMesh

SMALLEST = 1e-3  # square pixels: for smaller areas a triangle's share of the loss is not that of its best colour


def mesh_loss(cover: Cover, mesh: GridMesh, vertices: Any, picture: Any) -> Any:
    """Returns the loss per pixel of vertices (n, 2) against a picture (size, size, 3), with the best colours."""
    areas, sums, squares = _moments(cover, mesh, vertices, picture)
    explained = jnp.sum(sums**2, axis=1) / jnp.maximum(areas, SMALLEST)
    return jnp.sum(squares - explained) / mesh.size**2


def best_colours(cover: Cover, mesh: GridMesh, vertices: Any, picture: Any) -> Any:
    """Returns the colours, (m, 3), with which these vertices come closest to the picture."""
    areas, sums, _ = _moments(cover, mesh, vertices, picture)
    return sums / jnp.maximum(areas, SMALLEST)[:, None]


def _moments(cover: Cover, mesh: GridMesh, vertices: Any, picture: Any) -> tuple[Any, Any, Any]:
    """Returns integrals over each triangle: of 1 (m,), of the picture's colours (m, 3), of the sum of their squares (m,)."""
    corners = jnp.asarray(vertices)[mesh.triangles][:, None, None] - mesh.pixels[..., None, :].astype(np.float32)
    covered = cover(corners)
    colours = jnp.asarray(picture)[mesh.pixels[..., 1], mesh.pixels[..., 0]]
    sums = jnp.einsum("mij,mijk->mk", covered, colours)
    return covered.sum(axis=(1, 2)), sums, jnp.einsum("mij,mijk,mijk->m", covered, colours, colours)
