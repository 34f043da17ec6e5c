"""Clipped polyhedra with static shapes, which the printed JAX programs call as `polyhedra`: one turn of a loop for each half-space, and one
for each face whose tetrahedra have nodes. `setup` stands in the program before the call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from teg.backends.jax import entries
from teg.backends.jax.polygon import Body, vector
from teg.backends.jax.runtime import Note, Run, Scalar, union, where
from teg.backends.shared import polygons, polyhedra
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule

HalfSpace = tuple[Scalar, Scalar, Scalar, Scalar, bool]
"""Slopes, offset, and whether it is closed."""


def polyhedron(
    run: Run, box: tuple[Sequence[Scalar], Sequence[HalfSpace]], degree: int, factors: Sequence[Scalar], body: Body, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Note]:
    """The results of a `Polyhedron`, and the note."""
    (_, zero), (extents, spaces) = run, box
    extents = [jnp.asarray(e, jnp.float64) for e in extents]
    fails, known = jnp.bool_(False), jnp.isfinite(extents[0] + extents[1] + extents[2])
    rows: list[Any] = []
    for a, b, c, d, closed in spaces:
        least, most, scale = polyhedra.least_and_most(jnp, (a, b, c, d), extents, zero)
        fails |= polygons.fails(jnp, least, most, closed)
        known &= jnp.isfinite(most - least)
        rows.append(entries.stacked([jnp.asarray(v, jnp.float64) for v in (a, b, c, d, jnp.where(least < 0.0, scale, jnp.inf))]))
    there = when & ~fails & known
    numbers = jnp.where(there, jnp.stack(rows), jnp.zeros(5))
    solid = polyhedra.box(jnp, jnp.where(there, entries.stacked(extents), 0.0), polyhedra.faces_of(len(spaces)))

    def cut(k: Scalar, solid: polyhedra.Solid) -> polyhedra.Solid:
        a, b, c, d, scale = numbers[k]
        return polyhedra.clipped(jnp, solid, SIDES + k, (a, b, c, d), scale, zero)

    found = polyhedra.tetrahedra(jnp, jax.lax.fori_loop(0, len(spaces), cut, solid))
    sums, note = _at_centroid(found, body) if degree <= 1 else _on_tetrahedra(found, degree, body)
    nothing = jnp.where(when & ~fails & ~known, jnp.nan, 0.0)
    return tuple(jnp.where(there, v * factor, nothing) for v, factor in zip(sums, factors, strict=True)), where(there, note)


def _at_centroid(found: polyhedra.Tetrahedra, body: Body) -> tuple[Sequence[Scalar], Note]:
    """The integrals of linear functions, and the note."""
    at, volume = polyhedra.centroid(jnp, found)
    values, note = body(*entries.entries(at))
    return [jnp.where(volume != 0.0, volume * value, 0.0) for value in values], where(volume != 0.0, jnp.asarray(note, jnp.int32))


def _on_tetrahedra(found: polyhedra.Tetrahedra, degree: int, body: Body) -> tuple[Sequence[Scalar], Note]:
    """The sums over the nodes of all tetrahedra, and the note."""
    r, s, t, weights = (jnp.array(column) for column in zip(*tetrahedron_rule(degree), strict=True))
    at_node: Callable[..., Any] = jax.vmap(jax.vmap(lambda *at: vector(body(*at))))

    def of_face(parts: Any) -> Any:
        u, v, w, volumes = parts
        nodes = [o + r * x[:, None] + s * y[:, None] + q[:, None] * t for o, x, y, q in zip(found.middle, u, v, w, strict=True)]
        values, note = at_node(*nodes)
        size = volumes[:, None] * weights
        terms = jnp.where((size != 0.0)[..., None], size[..., None] * values, 0.0)
        return jnp.sum(terms, axis=(0, 1)), union(where(volumes != 0.0, jnp.max(note, axis=1)))

    sides = (jnp.moveaxis(jnp.broadcast_to(side, (3, *found.volumes.shape)), 1, 0) for side in found.sides)
    totals, notes = jax.lax.map(of_face, (*sides, found.volumes))
    return entries.entries(jnp.sum(totals, axis=0)), union(notes)
