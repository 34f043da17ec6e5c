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
from teg.numerics.sobol import BITS, GAMMA, LOW_BITS, MIX, SCRAMBLE, key, replicated, reversed_directions

Array = Any  # a JAX array
Block = Callable[..., tuple[tuple[Scalar, ...], Note]]  # coordinates -> values, note


def mean(
    rule: tuple[str, int, int, int], body: Block, results: int, *, chunk: int, when: Scalar = True, estimates: int = 0
) -> tuple[tuple[Scalar, ...], Note]:
    """The means of the body's `results` values over the points of a rule (kind, seed, dimensions, count), the standard errors of the first
    `estimates` of them, and the note; so many points at a time."""
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
    tested = middle[:estimates]
    if kind == "montecarlo":
        variance = jnp.maximum(squares[0] - each * jnp.square(tested - shift[0]), 0.0) / (each - 1.0) / each
    else:
        variance = jnp.sum(jnp.square(means[:, :estimates] - tested), axis=0) / (replicates * (replicates - 1.0))
    found = jnp.where(when, jnp.concatenate([middle, jnp.sqrt(variance)]), 0.0)
    return tuple(found[i] for i in range(results + estimates)), union(notes)


def points(kind: str, seed: int, dimensions: int, count: int, replicate: Array, index: Array) -> Array:
    """The coordinates of points of a rule of `count` points, (dimensions, …), in (0, 1); `replicate` and `index` are integers (…)."""
    replicates, each = replicated(kind, count)
    index = jnp.asarray(index, jnp.uint64)
    columns = []
    for d in range(dimensions):
        keys = jnp.array([key(seed, r, d) for r in range(replicates)], jnp.uint64)[replicate]
        columns.append(_random(keys, index) if kind == "montecarlo" else _sobol(keys, index, d, each))
    return jnp.stack(columns)


def _random(keys: Array, index: Array) -> Array:
    """Coordinates of pseudo-random points."""
    return _unit(_mix(keys + index * jnp.uint64(GAMMA)) >> 12)


def _sobol(keys: Array, index: Array, dimension: int, each: int) -> Array:
    """Coordinates of scrambled Sobol' points, whose numbers are below `each`."""
    gray = (index ^ index >> 1).astype(jnp.uint32)
    x = jnp.zeros(index.shape, jnp.uint32)
    columns = reversed_directions(dimension)
    for j in range(min(BITS, (each - 1).bit_length())):
        x ^= (gray >> j & 1) * jnp.uint32(columns[j])
    y = _reverse(_scramble(x, keys)).astype(jnp.uint64)
    low = _mix(keys + y * jnp.uint64(GAMMA)) >> (64 - LOW_BITS)
    return _unit(y << LOW_BITS | low)


def _unit(cell: Array) -> Array:
    """The centre of a cell of width 2⁻⁵²."""
    return (2 * cell + 1).astype(jnp.float64) * 2.0**-53


def _mix(z: Array) -> Array:
    """64 bits well mixed, of each."""
    for shift, factor in MIX:
        z = (z ^ z >> shift) * jnp.uint64(factor)
    return z


def _scramble(x: Array, keys: Array) -> Array:
    """A nested uniform scramble of reversed bits."""
    before, *after = SCRAMBLE
    x = x ^ x * jnp.uint32(before)
    x = (x + keys.astype(jnp.uint32)) * ((keys >> 32).astype(jnp.uint32) | jnp.uint32(1))
    for factor in after:
        x = x ^ x * jnp.uint32(factor)
    return x


def _reverse(x: Array) -> Array:
    """32 bits in reverse: halves, then quarters of them, and so on, change places."""
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        x = (x >> shift & jnp.uint32(mask)) | (x & jnp.uint32(mask)) << shift
    return x
