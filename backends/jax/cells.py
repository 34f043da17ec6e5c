"""Integrals of the polynomial of the nearest candidate (`teg.numerics.cells`) in programs of XLA.

A program is traced for the largest number of candidates that a box has. Up to `most_candidates` it is computed by
`teg.backends.shared.cells`, on the device; above by NumPy on the host, whose cost does not grow as fast. This module imports JAX.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from teg.backends.numpy.cells import cells_of_lanes
from teg.backends.shared.cells import CLOSED, Integrated, integrals_of_lanes, integrated, line_count
from teg.numerics.cells import Layout

STEADY = 1e-7
"""The speed at which borders may fail to stay closed, relative to that of their lengths."""
NUMBERS = 2**22
"""The numbers of one array that are computed at a time, about."""


def cells_with_most(shape: Layout, rows: Any, counts: Any, otherwise: Any, most: int) -> tuple[Any, Any]:
    """Returns the values (bodies, lanes) and the tables of lanes with at most so many candidates each.

    `rows` are the candidates of all lanes one below the other, `counts` of each lane, `otherwise` a row for each lane. Tables are
    (bodies, lanes·(most + 1), columns); in each lane the row behind the last candidate is that of `otherwise`, then come zeros.
    """
    lanes, height = len(counts), len(rows)
    live = jnp.arange(most) < counts[:, None]
    places = (jnp.cumsum(counts) - counts)[:, None] + jnp.arange(most)
    padded = rows[jnp.clip(places, 0, height - 1)] if height else jnp.zeros((lanes, most, rows.shape[1]))
    values, tables = _over_lanes(shape, most)(padded, live, otherwise)
    last = tables[:, :, most:]
    behind = jnp.arange(most + 1) == counts[:, None]
    candidates = jnp.concatenate([jnp.where(live[:, None, :, None], tables[:, :, :most], 0.0), jnp.zeros_like(last)], axis=2)
    tables = jnp.where(behind[:, None, :, None], last, candidates)
    return values.T, jnp.moveaxis(tables, 1, 0).reshape(tables.shape[1], lanes * (most + 1), tables.shape[3])


def _over_lanes(shape: Layout, most: int) -> Callable[..., Any]:
    """Returns the computation of padded lanes; the axis of a `vmap` becomes lanes too, so that as many run at a time as fit."""

    @jax.custom_batching.custom_vmap
    def compute(rows: Any, live: Any, otherwise: Any) -> Any:
        lanes = len(rows)
        block = max(1, min(NUMBERS // (line_count(shape, most) ** 2 * (most + 1)), lanes))
        count = -(-lanes // block)
        missing = count * block - lanes
        padded = [jnp.pad(v, ((0, missing), *[(0, 0)] * (v.ndim - 1))).reshape(count, block, *v.shape[1:]) for v in (rows, live, otherwise)]
        if count == 1:
            return _block(shape, *(v[0] for v in padded))
        found = lax.map(lambda part: _block(shape, *part), tuple(padded))
        return tuple(v.reshape(-1, *v.shape[2:])[:lanes] for v in found)

    @compute.def_vmap
    def _batched(size: int, batched: Any, *operands: Any) -> Any:
        whole = [v if b else jnp.broadcast_to(v, (size, *v.shape)) for v, b in zip(operands, batched, strict=True)]
        found = compute(*(v.reshape(-1, *v.shape[2:]) for v in whole))
        return tuple(v.reshape(size, -1, *v.shape[1:]) for v in found), (True, True)

    return compute


def _block(shape: Layout, rows: Any, live: Any, otherwise: Any) -> tuple[Any, Any]:
    """Returns the values (lanes, bodies) and the tables (lanes, bodies, most + 1, columns)."""
    if not shape.order:
        return integrals_of_lanes(jnp, shape, rows, live, otherwise)
    numbers, directions = jnp.split(rows, 2, axis=2)
    own, moving = jnp.split(otherwise, 2, axis=1)
    forms = shape.forms

    def compute(numbers: Any, own: Any) -> tuple[Any, Any]:
        done = integrated(jnp, shape, numbers, live, own)
        return done, done.lost

    done: Integrated
    done, moved, lost = jax.jvp(compute, (numbers, own), (directions, moving), has_aux=True)
    # a corner of four cells may open as it moves: what is decided on intervals without length has no limit there
    steady = jnp.abs(moved.gaps).max(axis=1) <= STEADY * (1.0 + jnp.abs(moved.lengths).max(axis=1))
    unknown = lost | ~steady | ~(jnp.abs(done.gaps).max(axis=1) <= CLOSED)
    tables, along = (jnp.where(unknown[:, None, None, None], jnp.nan, v) for v in (done.tables, moved.tables))
    lanes, bodies = tables.shape[:2]
    slopes = jnp.concatenate([directions[..., forms:], moving[:, None]], axis=1).reshape(lanes, len(live[0]) + 1, bodies, -1)
    slopes = jnp.moveaxis(slopes, 2, 1)
    by_form = jnp.pad(directions[..., :forms], ((0, 0), (0, 1), (0, 0)))[:, None]
    whole = jnp.concatenate([jnp.broadcast_to(by_form, (lanes, bodies, *by_form.shape[2:])), slopes], axis=3)
    values = jnp.where((tables != 0.0) & (whole != 0.0), whole * tables, 0.0).sum(axis=(2, 3))
    return jnp.where(unknown[:, None], jnp.nan, values), jnp.concatenate([along, tables], axis=3)


def cells_on_host(shape: Layout, rows: Any, counts: Any, otherwise: Any, slopes: bool) -> tuple[Any, Any]:
    """Returns the values (bodies, lanes) and the tables (bodies, rows + lanes, columns) of lanes, computed by NumPy on the host."""
    lanes, bodies = len(counts), otherwise.shape[1] // (1 + shape.order) // shape.coefficients
    height, columns = len(rows) + lanes if slopes else 0, shape.columns * (1 + shape.order)

    def host(rows: Any, counts: Any, otherwise: Any) -> tuple[Any, Any]:
        values, _, tables = cells_of_lanes(shape, np.asarray(rows), np.asarray(counts), np.asarray(otherwise), slopes)
        whole = np.zeros((bodies, height, columns))
        for table, part in zip(whole, tables, strict=False):
            table[: len(part)] = part
        return values, whole

    kinds = (_doubles(bodies, lanes), _doubles(bodies, height, columns))
    values, tables = jax.pure_callback(host, kinds, rows, counts, otherwise, vmap_method="sequential")
    return values, tables


def _doubles(*shape: int) -> Any:
    """What tells JAX the shape of an array that the host computes."""
    kind: Any = jax.ShapeDtypeStruct
    return kind(shape, np.float64)
