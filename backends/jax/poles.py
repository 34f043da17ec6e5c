"""Integrals of rational functions with one pole, for JAX: `Rational` of `teg.program`."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from teg.backends.jax.runtime import MISSED, Note, OnPiece, Pieces, Scalar, integrate, union, where
from teg.backends.shared.bends import Bends
from teg.backends.shared.poles import pole_at, pole_weights
from teg.backends.shared.rules import rounding
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import RESIDUE


def rational(pieces: Pieces, nodes: int, power: int, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre with weights that know the pole, on each piece; the arguments are those of `integrate`."""

    def rule(piece: OnPiece, bends: Bends, active: Scalar) -> tuple[Any, Note]:
        base, ((_, c0, c1, _, counts),) = bends
        p, q = piece.places.p, piece.places.q
        pole = pole_at(jnp, power, (p, q), base, (c0, c1), counts)
        at, plain = map(jnp.float64, gauss_legendre(nodes))
        w = jnp.where(pole.clear, pole_weights(jnp, nodes, power, pole.low, pole.high), plain)[:, None]
        half = 0.5 * (q - p)
        found, notes = piece.at(0.5 * (p + q) + half * at)
        sums = half * jnp.sum(w * found, axis=0)
        highest = jnp.abs(jnp.sum(jnp.float64(null_rules(nodes)[0])[:, None] * found, axis=0))
        endless = pole.met & (highest > RESIDUE * jnp.sum(plain[:, None] * jnp.abs(found), axis=0))
        sums = jnp.where(endless, jnp.copysign(jnp.inf, sums), sums)
        if pieces.estimated:
            whole = half * jnp.sum(jnp.abs(w * found[:, : pieces.tested]), axis=0)
            sums = jnp.concatenate([sums, (rounding(jnp, p, q) + pole.loss) * whole])
        return jnp.where(active, sums, 0.0), where(active, union(notes) | where(jnp.any(endless), MISSED))

    return integrate(pieces, rule, *integral, when=when)
