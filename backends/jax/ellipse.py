"""Moments of ellipses, which the printed JAX programs call as `ellipses`."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp

from teg.backends.jax.runtime import Scalar
from teg.backends.shared.ellipses import totals
from teg.backends.shared.moments import Kind


def moments(
    matrix: Sequence[Scalar],
    place: Sequence[Scalar],
    kinds: Sequence[Kind],
    coefficients: Sequence[Sequence[Scalar]],
    *,
    when: Scalar = True,
) -> tuple[Scalar, ...]:
    """Returns the results of an `Ellipse`."""
    place = [jnp.asarray(v, jnp.float64) for v in place]
    found = totals(jnp, matrix, place, kinds, coefficients)
    return tuple(jnp.where(when, v, 0.0) for v in found)
