"""What the printed JAX programs call, as `rt`: powers, ties, and integrals with static shapes.

Everything is written for one element; the kernel maps it over the batch. The pieces and the nodes are mapped
axes here. What need not be evaluated is masked: its value is replaced by 0, never multiplied by it, so that
no NaN comes through. This module imports JAX: only a compiled kernel imports it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from teg.program import ABSOLUTE_FLOOR, INSIDE, MAX_DEPTH, MAX_INTERVALS, PIECE_EPS, ROUNDING, TIE_EPS, WATCH_WIDTH
from teg.quadrature import GAUSS_WEIGHTS, KRONROD_NODES, KRONROD_WEIGHTS, gauss_legendre

Scalar = Any  # a traced scalar, float64 or boolean, or a Python literal
Body = Callable[[Scalar, tuple[Scalar, ...]], tuple[tuple[Scalar, ...], Scalar]]  # x, flags -> values, tied
Flags = Callable[[Scalar], tuple[Scalar, tuple[Scalar, ...], Scalar]]  # middle -> need, flags, tied
Rule = Callable[[Scalar, Scalar, Scalar, Callable[[Scalar], Any]], tuple[Any, Scalar]]

END = 2**MAX_DEPTH
"""The coordinate u in (0, 1) of an adaptive interval is counted in units of 1/END."""


def powi(x: Scalar, n: int) -> Scalar:
    """x to an integer power, by squaring; 1/powi(x, -n) where n is negative."""
    if n < 0:
        return 1.0 / powi(x, -n)
    power = jnp.float64(1.0)
    while n:
        if n & 1:
            power = power * x
        n >>= 1
        if n:
            x = x * x
    return power


def tie(order: Scalar, g: Scalar, scale: Scalar, r: Scalar) -> tuple[Scalar, Scalar]:
    """g > 0, but where g vanishes to rounding the order decides; and whether it did."""
    near = (jnp.abs(g) <= TIE_EPS * scale) & jnp.isfinite(g)
    return jnp.where(near, jnp.where(order > 0, r, jnp.logical_not(r)), g > 0.0), near


def gauss(nodes: int, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Scalar]:
    """Gauss-Legendre on each piece; the arguments are those of `_integrate`."""
    return _integrate(partial(_gauss, nodes), *integral, when=when)


def adaptive(tol: float, smooth: bool, *integral: Any, when: Scalar = True, watched: int = 0) -> tuple[tuple[Scalar, ...], Scalar]:
    """Gauss-Kronrod (10, 21) with bisection on each piece; the arguments are those of `_integrate`.

    The last `watched` values of the body are conditions: an interval on which one changes is halved.
    """
    return _integrate(partial(_adaptive, tol, smooth, watched), *integral, when=when)


def _integrate(
    rule: Rule,
    lo: Scalar,
    hi: Scalar,
    breaks: tuple[Scalar, ...],
    flags: Flags | None,
    body: Body,
    results: int,
    *,
    when: Scalar,
) -> tuple[tuple[Scalar, ...], Scalar]:
    """The results, and whether a tie was met."""
    lo, hi = jnp.asarray(lo, jnp.float64), jnp.asarray(hi, jnp.float64)
    low, high = jnp.minimum(lo, hi), jnp.maximum(lo, hi)
    clamped = [jnp.where(jnp.isnan(b), low, jnp.clip(b, low, high)) for b in breaks]
    points = jnp.stack([low, *clamped, high])
    if len(breaks) > 1:
        points = jnp.sort(points)

    def piece(p: Scalar, q: Scalar) -> tuple[Any, Scalar]:
        active = when & (q - p > PIECE_EPS * jnp.maximum(jnp.abs(p), jnp.abs(q)))
        if flags is None:
            return rule(p, q, active, lambda x: vector(body(x, ())))
        need, flagged, tied = flags(p + INSIDE * (q - p))
        sums, tied_body = rule(p, q, active & need, lambda x: vector(body(x, flagged)))
        return sums, (active & tied) | tied_body

    sums, tied = jax.vmap(piece)(points[:-1], points[1:])
    total = jnp.where(lo <= hi, 1.0, -1.0) * jnp.sum(sums, axis=0)
    total = jnp.where(jnp.isnan(lo) | jnp.isnan(hi), jnp.nan, total)
    total = jnp.where(when, total, 0.0)
    return tuple(total[i] for i in range(results)), jnp.any(tied)


def vector(block: tuple[tuple[Scalar, ...], Scalar]) -> tuple[Any, Any]:
    """The values of a body as one vector, (results,)."""
    values, tied = block
    return jnp.stack([jnp.asarray(v, jnp.float64) for v in values]), jnp.asarray(tied)


def _gauss(nodes: int, p: Scalar, q: Scalar, active: Scalar, values: Callable[[Scalar], Any]) -> tuple[Any, Scalar]:
    """The integrals over one piece, (results,), and whether a tie was met."""
    at, weights = map(jnp.float64, gauss_legendre(nodes))
    half = 0.5 * (q - p)
    found, tied = jax.vmap(values)(0.5 * (p + q) + half * at)
    sums = half * jnp.sum(weights[:, None] * found, axis=0)
    return jnp.where(active, sums, 0.0), active & jnp.any(tied)


class _Progress(NamedTuple):
    """Adaptive quadrature of one piece, left to right; it is at the interval (start, start + width)/END."""

    start: Any
    width: Any
    used: Any
    enough: Any
    sums: Any
    tied: Any


def _adaptive(
    tol: float, smooth: bool, watched: int, p: Scalar, q: Scalar, active: Scalar, values: Callable[[Scalar], Any]
) -> tuple[Any, Scalar]:
    """The integrals over one piece, (results,), and whether a tie was met.

    The intervals are visited from left to right. No stack is needed: behind an accepted interval that ends at
    u, the next one waiting is the largest dyadic one that begins at u: its width is the lowest bit of u.
    """
    tables = (KRONROD_NODES, KRONROD_WEIGHTS, GAUSS_WEIGHTS)
    nodes, weights, gauss = (jnp.array(table, jnp.float64) for table in tables)
    if watched:
        nodes = jnp.concatenate([nodes, jnp.array([-1.0, 1.0])])
    results = jax.eval_shape(values, p)[0].shape[0] - watched

    def step(at: _Progress) -> _Progress:
        width = at.width / END
        u = at.start / END + 0.5 * width * (1.0 + nodes)
        x = p + (q - p) * (u * u * (3.0 - 2.0 * u) if smooth else u)
        weight = 0.5 * width * (q - p) * (6.0 * u * (1.0 - u) if smooth else jnp.ones_like(u))
        found, tied = jax.vmap(values)(x)
        conditions = found[:, results:] > 0.0
        if watched:  # at the ends, the last two rows, only the conditions count
            found, tied, weight = found[:-2, :results], tied[:-2], weight[:-2]
        found = found * weight[:, None]
        kronrod, size = (jnp.sum(weights[:, None] * f, axis=0) for f in (found, jnp.abs(found)))
        gap = jnp.abs(kronrod - jnp.sum(gauss[:, None] * found[1::2], axis=0))
        enough = jnp.where(at.used == 0, tol * (size + ABSOLUTE_FLOOR), at.enough)
        fine = jnp.all((gap <= jnp.maximum(enough, ROUNDING * size)) | ~jnp.isfinite(gap))
        if watched:
            changed = jnp.any(jnp.any(conditions, axis=0) & ~jnp.all(conditions, axis=0))
            fine = jnp.where(changed, width <= WATCH_WIDTH, fine)
        done = fine | (at.width == 1) | (at.used + 1 >= MAX_INTERVALS)
        start = jnp.where(done, at.start + at.width, at.start)
        return _Progress(
            start=start,
            width=jnp.where(done, start & -start, at.width // 2),
            used=at.used + 1,
            enough=enough,
            sums=jnp.where(done, at.sums + kronrod, at.sums),
            tied=at.tied | jnp.any(tied),
        )

    beginning = _Progress(
        start=jnp.where(active, jnp.int64(0), END),
        width=jnp.int64(END),
        used=jnp.int64(0),
        enough=jnp.zeros(results),
        sums=jnp.zeros(results),
        tied=jnp.bool_(False),
    )
    end = lax.while_loop(lambda at: at.start < END, step, beginning)
    return end.sums, end.tied
