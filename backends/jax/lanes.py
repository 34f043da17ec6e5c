"""A kernel of JAX as a function that maps well: both orders of a tie are evaluated where one was met, however many lanes there are.

A condition of one lane becomes a selection under `jax.vmap`, and both orders would always be evaluated. So this function has a rule of
its own for being mapped: the condition is that of all lanes together. It is pure, and not to be differentiated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import jax
import jax.numpy as jnp
from jax import lax

from teg.backends.jax.kernel import JaxKernel
from teg.backends.jax.runtime import TIED

Axes = tuple[int | None, ...]


def on_lanes(kernel: JaxKernel, batch: tuple[Axes, ...] = ()) -> Callable[..., tuple[Any, Any]]:
    """The function of scalars, or of arrays with the axes of `batch`, the outermost first: the outputs, (…, outputs), and a note."""

    def both(*arguments: Any) -> tuple[Any, Any]:
        found, notes = _once(kernel, batch, +1, arguments)
        tied = (notes & TIED) > 0
        if not kernel.program.ties:
            return found, notes

        def averaged() -> tuple[Any, Any]:
            other, again = _once(kernel, batch, -1, arguments)
            return jnp.where(tied[..., None], 0.5 * found + 0.5 * other, found), notes | again

        met = jnp.max(notes & TIED, initial=0) > 0  # a maximum: not every device can unite bits of several
        return cast("tuple[Any, Any]", lax.cond(met, averaged, lambda: (found, notes)))

    mapped = jax.custom_batching.custom_vmap(both)

    def rule(size: int, mapped: list[bool], *arguments: Any) -> tuple[Any, tuple[bool, bool]]:
        axes = tuple(0 if m else None for m in mapped)
        return on_lanes(kernel, (axes, *batch))(*arguments), (True, True)

    mapped.def_vmap(rule)
    return cast("Callable[..., tuple[Any, Any]]", mapped)


def _once(kernel: JaxKernel, batch: tuple[Axes, ...], order: int, arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    def run(*scalars: Any) -> tuple[Any, Any]:
        return kernel._once(order, scalars)

    for axes in reversed(batch):
        run = jax.vmap(run, in_axes=axes)
    return run(*arguments)
