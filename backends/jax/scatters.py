"""Terms that are added to entries of an array: `added`, and `added_by_rows` for devices that add to one entry one term after the other.

Neighbouring lanes often belong to one entry: all pixels of a triangle move its three corners. So lanes are the rows of a matrix, and those
of a row that have the entry of its first or of its last lane are summed before they are added; all others are added one by one.
This module imports JAX.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

ROW, FEWEST = 32, 4096
"""Lanes of a row, and lanes that are worth it."""


def added(target: Any, places: Sequence[Any], terms: Any) -> Any:
    """Returns an array with terms added to its entries; terms whose entry does not exist are dropped."""
    return target.at[tuple(jnp.broadcast_to(p, terms.shape) for p in places)].add(terms, mode="drop", wrap_negative_indices=False)


def added_by_rows(target: Any, places: Sequence[Any], terms: Any) -> Any:
    """Returns the same, added in another order."""
    if len(terms) < FEWEST:
        return added(target, places, terms)
    entry: Any = 0
    exists: Any = True
    for place, length in zip(places, target.shape, strict=True):
        exists = exists & (place >= 0) & (place < length)
        entry = entry * length + place
    entry = jnp.broadcast_to(jnp.where(exists, entry, -1), terms.shape)
    short = (0, -len(terms) % ROW)
    rows, values = (jnp.pad(v, short, constant_values=fill).reshape(-1, ROW) for v, fill in ((entry, -1), (terms, 0)))
    first, last = rows[:, :1], rows[:, -1:]
    of_first = rows == first
    of_last = (rows == last) & ~of_first
    sums = [jnp.sum(jnp.where(of, values, 0.0), axis=1) for of in (of_first, of_last)]
    alone = jnp.where(of_first | of_last, -1, rows).reshape(-1)[: len(terms)]
    found = added(target.reshape(-1), [jnp.concatenate([first, jnp.where(last == first, -1, last)])[:, 0]], jnp.concatenate(sums))
    return added(found, [alone], terms).reshape(target.shape)
