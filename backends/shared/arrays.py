"""What NumPy and JAX do differently where they compute the same: whether elements that are not chosen are computed at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

Values = Sequence[Any]


class Arrays(NamedTuple):
    """An array module, and the operations for which NumPy and JAX need different code.

    `xp`: numpy or jax.numpy. `choose(mask, compute, operands, otherwise)`: arrays that are `compute(*operands)` where the mask, along the
    last axis, is true, and `otherwise` elsewhere. `rows(values, like)`: an array of values, each of the shape of `like`.
    `any_of(condition, values)`: where a condition holds for one of the values along the first axis, at least one.
    """

    xp: Any
    choose: Callable[[Any, Callable[..., Values], Values, Values], Values]
    rows: Callable[[Values, Any], Any]
    any_of: Callable[[Callable[[Any], Any], Any], Any]
