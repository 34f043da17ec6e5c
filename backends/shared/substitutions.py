"""The substitutions v = centre + radius·φ(t) of `teg.program`, by kind, for NumPy and JAX."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

LINE, CUBIC, SQUARE, SINE, COSH, SINH, EXP, POWER, TAIL = range(9)
END = 1e-9
"""A zero within this part of a piece's length of its end is at its end."""


def functions(xp: Any) -> dict[int, Callable[[Any], tuple[Any, Any]]]:
    """φ and its derivative, by kind; `xp` is numpy or jax.numpy."""
    return {
        LINE: lambda t: (t, xp.ones_like(t)),
        CUBIC: lambda t: (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)),
        SQUARE: lambda t: (t * t, 2.0 * t),
        SINE: lambda t: (xp.sin(t), xp.cos(t)),
        COSH: lambda t: (xp.cosh(t), xp.sinh(t)),
        SINH: lambda t: (xp.sinh(t), xp.cosh(t)),
        EXP: lambda t: (xp.exp(t), xp.exp(t)),
        POWER: lambda t: (t * t * t * t * t * t, 6.0 * (t * t * t * t * t)),
        TAIL: lambda t: (t / (1.0 - t), 1.0 / ((1.0 - t) * (1.0 - t))),
    }
