"""Moments of ellipses, which the printed JAX programs call as `ellipses`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from teg.backends.jax import entries
from teg.backends.jax.corners import Cut
from teg.backends.jax.polygon import Plane, clip, meets
from teg.backends.jax.runtime import Scalar
from teg.backends.shared.ellipses import Kind, box_domain, corners_of_box, polygon_domain, totals


class Polygon(NamedTuple):
    """A box that half-planes clip: its corners, the half-planes, whether anything is left, and the result where nothing is."""

    corners: tuple[Any, Any]
    planes: Sequence[tuple[Scalar, Scalar, Scalar]]
    left: Scalar
    without: Scalar


def polygon(width: Scalar, height: Scalar, planes: Sequence[Plane], zero: Scalar) -> Polygon:
    """Returns what half-planes leave of a box; `zero` keeps a product and a sum apart (see `python_text`)."""
    width, height = (jnp.asarray(v, jnp.float64) for v in (width, height))
    fails, known, least, _ = meets(width, height, planes, zero)
    left = ~fails & known
    cuts = [Cut(left & (low < 0.0), *plane[:3]) for low, plane in zip(least, planes, strict=True)]
    corners = list(zip(*map(tuple, corners_of_box(jnp, width, height)), strict=True))
    corners, left = clip(corners, left, cuts, zero)
    u, v = (entries.stacked(row) for row in zip(*corners, strict=True))
    return Polygon((u, v), [plane[:3] for plane in planes], left, jnp.where(fails | known, 0.0, jnp.nan))


def moments(
    matrix: Sequence[Scalar],
    place: Sequence[Scalar],
    kinds: Sequence[Kind],
    coefficients: Sequence[Sequence[Scalar]],
    *,
    clip: Polygon | None = None,
    when: Scalar = True,
) -> tuple[Scalar, ...]:
    """Returns the results of an `Ellipse`."""
    matrix, place = ([jnp.asarray(v, jnp.float64) for v in numbers] for numbers in (matrix, place))
    domain = box_domain(jnp, place, kinds) if clip is None else polygon_domain(jnp, place, kinds, clip.corners, clip.planes)
    found = totals(jnp, matrix, place, kinds, coefficients, domain)
    if clip is not None:
        without = jnp.where(abs(matrix[0] * matrix[3] - matrix[1] * matrix[2]) > 0.0, clip.without, jnp.nan)
        found = [jnp.where(clip.left, v, without) for v in found]
    return tuple(jnp.where(when, v, 0.0) for v in found)
