"""The guard of an adaptive integral, for JAX: whether a sharp value is large where no node saw it (`Integrate` of `teg.program`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from teg.backends.jax.arrays import JAX
from teg.backends.jax.runtime import OnPiece
from teg.backends.shared.bends import place
from teg.backends.shared.rules import is_unseen
from teg.program import DEEP, GUARD_DEPTH

Scalar = Any


class Guard(NamedTuple):
    """The printed `block`: from (left, right, flags of the piece) to bounds of sizes, then the upper and the lower bounds of `sharp`
    values, and those of what is below the upper ones; and a note."""

    block: Callable[[Scalar, Scalar, tuple[Scalar, ...]], tuple[tuple[Scalar, ...], Any]]
    sharp: int

    def hides(
        self,
        piece: OnPiece,
        possible: tuple[int, ...],
        ends: tuple[Scalar, Scalar],
        nodes: tuple[Any, Any],
        enough: Any,
        depth: Scalar,
    ) -> tuple[Scalar, Any]:
        """Whether something is hidden in the interval (u0, u1) = `ends` of a piece: `nodes` in u, and the sharp values there, (nodes,
        sharp); `enough` is what does not matter, (tested,). And bounds of the integrals of |tested value|, infinite where
        they are not known, 0 where a value has no finite bound on a finite interval, as beside integrable singularities."""
        (at, seen), places = nodes, piece.places
        u = jnp.concatenate([jnp.stack([ends[0]]), at, jnp.stack([ends[1]])])
        x = place(JAX, places, possible, u)[0]
        x = jnp.where(u <= 0.0, places.p, jnp.where(u >= 1.0, places.q, x))
        left, right = jnp.concatenate([x[:1], x[:-1]]), jnp.concatenate([x[-1:], x[1:]])  # the whole interval, then the gaps
        found = jax.vmap(lambda a, b: jnp.stack([jnp.asarray(v, jnp.float64) for v in self.block(a, b, piece.flagged)[0]]))(left, right)
        tested, length = enough.shape[0], right - left
        finite = jnp.isfinite(length)
        sizes = found[:, :tested]
        small = jnp.all(jnp.where(finite[:, None], sizes * length[:, None] <= enough, sizes == 0.0), axis=1)
        whole = jnp.arange(length.shape[0]) == 0
        matters = ~small & (length != 0.0)  # a node that stands twice hides nothing
        beside = jnp.fmax(jnp.concatenate([seen[:1], seen]), jnp.concatenate([seen, seen[-1:]]))
        known = jnp.concatenate([_least(seen)[None], beside])
        upper, lower, change = jnp.split(found[:, tested:], 3, axis=1)
        within = (jnp.concatenate([u[:1], u[:-1]]) > 0.0) & (u < 1.0)
        large = is_unseen(jnp, upper, lower, known, (~whole & (~finite | (~within & (depth >= DEEP))))[:, None])
        large &= ~(change * length[:, None] <= jnp.min(enough))
        inside = ~finite | (within & (depth < GUARD_DEPTH))
        counts = ~jnp.isposinf(upper) | (inside | whole)[:, None]
        unseen = jnp.any(large & counts, axis=1) & matters
        hidden = jnp.where(jnp.isinf(sizes[0]) & jnp.isfinite(length[0]), 0.0, sizes[0] * length[0])
        return unseen[0] & jnp.any(unseen[1:]), jnp.where(jnp.isnan(hidden), jnp.inf, hidden)


def _least(seen: Any) -> Any:
    """The least of all that are numbers, (sharp,)."""
    return jnp.where(jnp.all(jnp.isnan(seen), axis=0), jnp.nan, jnp.min(jnp.where(jnp.isnan(seen), jnp.inf, seen), axis=0))
