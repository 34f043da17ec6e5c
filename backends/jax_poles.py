"""Integrals of rational functions with one pole, for JAX: `Rational` of `teg.program`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from teg.backends.jax_bends import Substitution
from teg.backends.jax_runtime import MISSED, Note, Pieces, Scalar, integrate, powi, rounding, union, where
from teg.program import EDGE, POLE, RESIDUE
from teg.quadrature import gauss_legendre, null_rules, pole_table


def weights(nodes: int, power: int, low: Scalar, high: Scalar) -> Any:
    """The weights of Gauss nodes for polynomials over a power of a function that goes from low to high, (nodes,)."""
    table, at = pole_table(nodes, power), gauss_legendre(nodes)[0]
    z = (high - low) / (high + low)
    square, near = z * z, jnp.abs(z) < table.border
    moments: list[Any] = [2.0 / (j + 1) if j % 2 == 0 else 0.0 for j in range(nodes)]
    for level in range(1, power + 1):
        top: Any = 0.0
        for c in reversed(table.series[level - 1]):
            top = top * square + c
        down: list[Any] = [-z * top if nodes % 2 == 0 else top]
        for before in reversed(moments[:-1]):
            down.insert(0, before - z * down[0])
        k = level - 1
        first = jnp.log(high / low) if k == 0 else (powi(0.5 * (high + low) / low, k) - powi(0.5 * (high + low) / high, k)) / k
        up: list[Any] = [first / z]
        for before in moments[:-1]:
            up.append((before - up[-1]) / z)
        moments = [jnp.where(near, d, u) for d, u in zip(down, up, strict=True)]
    rows = [sum(c * m for c, m in zip(row, moments, strict=True)) for row in table.lagrange]
    return jnp.stack([row * powi(1.0 + z * u, power) for row, u in zip(rows, at, strict=True)])


def rational(pieces: Pieces, nodes: int, power: int, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre with weights that know the pole, on each piece; the arguments are those of `integrate`."""

    def rule(places: Substitution, bends: Sequence[Any], active: Scalar, values: Callable[[Scalar], Any]) -> tuple[Any, Note]:
        base, ((_, c0, c1, _, counts),) = bends
        p, q = places.p, places.q
        first, last = p - base, q - base
        low, high = c0 + c1 * first, c0 + c1 * last
        counts = counts & jnp.isfinite(c0) & jnp.isfinite(c1)
        least = jnp.minimum(jnp.abs(low), jnp.abs(high))
        clear = counts & (low * high > 0.0) & (least > POLE * jnp.maximum(jnp.abs(p), jnp.abs(q)) * jnp.abs(c1))
        at, plain = map(jnp.float64, gauss_legendre(nodes))
        w = jnp.where(clear, weights(nodes, power, low, high), plain)[:, None]
        half = 0.5 * (q - p)
        found, notes = jax.vmap(values)(0.5 * (p + q) + half * at)
        sums = half * jnp.sum(w * found, axis=0)
        highest = jnp.abs(jnp.sum(jnp.float64(null_rules(nodes)[0])[:, None] * found, axis=0))
        endless = counts & ~clear & (highest > RESIDUE * jnp.sum(plain[:, None] * jnp.abs(found), axis=0))
        sums = jnp.where(endless, jnp.copysign(jnp.inf, sums), sums)
        if pieces.estimated:
            size = jnp.abs(c0) + jnp.abs(c1) * jnp.maximum(jnp.abs(first), jnp.abs(last))
            loss = jnp.where(clear, power * EDGE * size / least, 0.0)
            whole = half * jnp.sum(jnp.abs(w * found[:, : pieces.tested]), axis=0)
            sums = jnp.concatenate([sums, (rounding(places) + loss) * whole])
        return jnp.where(active, sums, 0.0), where(active, union(notes) | where(jnp.any(endless), MISSED))

    return integrate(pieces, rule, *integral, when=when)
