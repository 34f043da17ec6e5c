"""Moments of hyperbolas, which the printed JAX programs call as `hyperbolas`. `scales` stand in the program before the call."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp

from teg.backends.jax.runtime import TIED, Note, Run, Scalar, where
from teg.backends.shared.moments import Kind, has_near_side, settled, totals


def moments(
    run: Run,
    corners: Sequence[Scalar],
    scales: Sequence[Scalar],
    kinds: Sequence[Kind],
    coefficients: Sequence[Sequence[Scalar]],
    *,
    when: Scalar = True,
) -> tuple[tuple[Scalar, ...], Note]:
    """Returns the results of a `Hyperbola`, and the note: whether a tie was met. `corners`: the values there, then where it turns."""
    order, zero = run
    *f, turn = [jnp.asarray(v, jnp.float64) for v in corners]
    above, met = [v > 0.0 for v in f], jnp.bool_(False)
    if scales:
        f, on, sides = settled(jnp, f, scales, has_near_side(f, jnp))
        above = [(v > 0.0) | (b & (order > 0)) for v, b in zip(f, on, strict=True)]
        turn = jnp.where(on[0] | on[1] | on[2] | on[3], jnp.nan, turn)
        met = sides[0] | sides[1] | sides[2] | sides[3]
    found = totals(jnp, [*f, turn], above, kinds, coefficients, zero)
    return tuple(jnp.where(when, v, 0.0) for v in found), where(when & met, jnp.int32(TIED))
