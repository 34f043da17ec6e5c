"""JAX, as the formulas that it shares with NumPy see it. This module imports JAX."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from teg.backends.shared.arrays import Arrays, Values


def _choose(mask: Any, compute: Callable[..., Values], operands: Values, otherwise: Values) -> Values:
    return tuple(jnp.where(mask, new, old) for new, old in zip(compute(*operands), otherwise, strict=True))


def _towards(p: Any, q: Any) -> Any:
    """Next to 0 a normal number: arithmetic on CPUs takes subnormal numbers for 0."""
    after, least = jnp.nextafter(p, q), sys.float_info.min
    return jnp.where(jnp.abs(after) < least, jnp.sign(q - p) * least, after)


JAX = Arrays(jnp, _choose, _towards)
