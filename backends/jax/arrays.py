"""JAX, as the formulas that it shares with NumPy see it. This module imports JAX."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from teg.backends.shared.arrays import Arrays, Values


def _choose(mask: Any, compute: Callable[..., Values], operands: Values, otherwise: Values) -> Values:
    return tuple(jnp.where(mask, new, old) for new, old in zip(compute(*operands), otherwise, strict=True))


JAX = Arrays(jnp, _choose)
