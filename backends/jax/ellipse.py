"""Moments of ellipses, which the printed JAX programs call as `ellipses`."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp

from teg.backends.jax.polygon import Plane, clipped, meets
from teg.backends.jax.runtime import Scalar
from teg.backends.shared.ellipses import box_domain, corners_of_box, polygon_domain, totals
from teg.backends.shared.moments import Kind


def moments(
    matrix: Sequence[Scalar],
    place: Sequence[Scalar],
    kinds: Sequence[Kind],
    coefficients: Sequence[Sequence[Scalar]],
    zero: Scalar,
    *,
    planes: Sequence[Plane] = (),
    when: Scalar = True,
) -> tuple[Scalar, ...]:
    """Returns the results of an `Ellipse`."""
    place = [jnp.asarray(v, jnp.float64) for v in place]
    matrix = [jnp.asarray(v, jnp.float64) for v in matrix]
    if not planes:
        found = totals(jnp, matrix, place, kinds, coefficients, box_domain(jnp, place, kinds))
        return tuple(jnp.where(when, v, 0.0) for v in found)
    width, height = place[3:5]
    fails, known, least, _ = meets(width, height, planes, zero)
    left = ~fails & known
    places = jnp.stack(corners_of_box(jnp, width, height))
    for (a, b, c, _), low in zip(planes, least, strict=True):
        places, left = clipped(places, left, left & (low < 0.0), a, b, c, zero)
    domain = polygon_domain(jnp, place, kinds, (places[0], places[1]), [plane[:3] for plane in planes])
    found = totals(jnp, matrix, place, kinds, coefficients, domain)
    regular = abs(matrix[0] * matrix[3] - matrix[1] * matrix[2]) > 0.0
    without = jnp.where(regular & (fails | known), 0.0, jnp.nan)
    return tuple(jnp.where(when, jnp.where(left, v, without), 0.0) for v in found)
