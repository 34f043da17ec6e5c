"""Points of `teg.numerics.sobol`, as JAX arrays, and the means over them: what the printed JAX programs call as `sampling`.

This module imports JAX: only a compiled kernel imports it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from teg.backends.jax.runtime import Note, Scalar, union, vector, where
from teg.backends.shared.samples import Points, coordinate, standard_error
from teg.numerics.sobol import replicated

Array = Any  # a JAX array
Block = Callable[..., tuple[tuple[Scalar, ...], Note]]  # coordinates -> values, note


def mean(
    rule: tuple[str, int, int, int], body: Block, results: int, *, chunk: int, when: Scalar = True, estimates: int = 0
) -> tuple[tuple[Scalar, ...], Note]:
    """Returns the means of the body's `results` values over the points of a rule (kind, seed, dimensions, count), the standard errors of
    the first `estimates` of them, and the note; so many points at a time."""
    kind, seed, dimensions, count = rule
    replicates, each = replicated(kind, count)
    chunk = min(each, chunk)

    def stretch(replicate: Array, carried: Any, start: Array) -> tuple[Any, None]:
        totals, shift, squares, note = carried
        index = start + jnp.arange(chunk)
        there = when & (index < each)
        at = points(kind, seed, dimensions, count, replicate, jnp.minimum(index, each - 1))
        found, notes = jax.vmap(lambda *u: vector(body(*u)))(*at)
        shift = jnp.where(start == 0, found[0, :estimates], shift)
        away = jnp.where(there[:, None], found[:, :estimates] - shift, 0.0)
        total = jnp.sum(jnp.where(there[:, None], found, 0.0), axis=0)
        return (totals + total, shift, squares + jnp.sum(away * away, axis=0), note | union(where(there, notes))), None

    def whole(replicate: Array) -> Any:
        nothing = (jnp.zeros(results), jnp.zeros(estimates), jnp.zeros(estimates), jnp.int32(0))
        return lax.scan(lambda carried, start: stretch(replicate, carried, start), nothing, jnp.arange(0, each, chunk))[0]

    totals, shift, squares, notes = lax.map(whole, jnp.arange(replicates))
    means = totals / each
    middle = jnp.mean(means, axis=0)
    errors = standard_error(jnp, each, means[:, :estimates], shift, squares)
    found = jnp.where(when, jnp.concatenate([middle, errors]), 0.0)
    return tuple(found[i] for i in range(results + estimates)), union(notes)


def points(kind: str, seed: int, dimensions: int, count: int, replicate: Array, index: Array) -> Array:
    """Returns the coordinates of points of a rule of `count` points, (dimensions, …), in (0, 1); `replicate` and `index` are
    integers (…)."""
    index = jnp.asarray(index, jnp.uint64)
    return jnp.stack([coordinate(jnp, Points(kind, seed, count), d, replicate, index) for d in range(dimensions)])
