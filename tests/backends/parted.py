"""Second derivatives of cells at places where lines part, by differences of first derivatives, which have no such places."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from teg.numerics.arrangement import Arrangement
from teg.numerics.cells import Layout
from teg.numerics.measured import Measured

Array = np.ndarray[Any, Any]
STEP, CONVERGED, RIGHT = 1e-6, 1e-4, 1e-3
"""Of differences; how far those of two steps may differ where there is a limit, and the result from that limit: relative, or absolute
below 1."""


def is_parted(shape: Layout, rows: Array, otherwise: Array) -> bool:
    """Returns whether lines through one place of a square part along the direction: then second derivatives are means of both sides."""
    numbers = rows.tolist()
    return bool(shape.order) and Measured(shape, Arrangement(shape, numbers), numbers, otherwise.tolist()).parting() != 0.0


def assert_right(found: Array, first: Callable[[Array, Array], Array], rows: Array, otherwise: Array) -> None:
    """Compares second derivatives, the first columns of `found`, with differences of first ones, where these have a limit.

    Elsewhere first derivatives jump, and there are no second ones.
    """
    half, own = rows.shape[1] // 2, otherwise.shape[0] // 2

    def difference(step: float) -> Array:
        one, other = (first(rows[:, :half] + s * rows[:, half:], otherwise[:own] + s * otherwise[own:]) for s in (step, -step))
        return (one - other) / (2.0 * step)

    near, far = difference(STEP), difference(2.0 * STEP)
    size, seconds = np.maximum(1.0, np.abs(near)), found[..., : near.shape[-1]]
    known = (np.abs(near - far) <= CONVERGED * size) & np.isfinite(seconds)
    assert known.sum() > 10
    off = np.abs(seconds - (2.0 * near - far)) / size
    assert off[known].max() < RIGHT
