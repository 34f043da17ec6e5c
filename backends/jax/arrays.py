"""JAX, as the formulas that it shares with NumPy see it. This module imports JAX."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from teg.backends.jax.entries import array_of
from teg.backends.shared.arrays import Arrays, Values


def _choose(mask: Any, compute: Callable[..., Values], operands: Values, otherwise: Values) -> Values:
    return tuple(jnp.where(mask, new, old) for new, old in zip(compute(*operands), otherwise, strict=True))


def _rows(values: Values, like: Any) -> Any:
    return array_of(values) if jnp.ndim(like) == 0 else jnp.stack([jnp.broadcast_to(v, jnp.shape(like)) for v in values])


def _any_of(condition: Callable[[Any], Any], values: Any) -> Any:
    return jnp.any(jax.vmap(condition)(values), axis=0)


JAX = Arrays(jnp, _choose, _rows, _any_of)
