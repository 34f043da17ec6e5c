"""Clipped polygons and segments with static shapes, which the printed JAX programs call as `polygons`.

A polygon gains one corner with each half-plane, whatever that cuts off: where fewer are left, some stand twice, and their triangles have no
area. Nothing is moved by index: a scatter for each cut would take long. `setup` and `scales` stand in the program before the call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from teg.backends.jax.runtime import TIED, Note, Scalar, union, where
from teg.backends.shared import polygons as half_planes
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import NEARLY, THIN, TIE_EPS

Body = Callable[..., tuple[tuple[Scalar, ...], Note]]
Plane = tuple[Scalar, Scalar, Scalar, bool]
Line = tuple[Scalar, Scalar, bool, bool, Scalar, Scalar, Scalar]
"""First, last, closed, whether it may tie, resolution, size, scale."""


def polygon(
    width: Scalar,
    height: Scalar,
    planes: Sequence[Plane],
    degree: int,
    factors: Sequence[Scalar],
    body: Body,
    zero: Scalar,
    *,
    when: Scalar = True,
    corners: Sequence[tuple[Scalar, Scalar]] = (),
    across: Scalar = 0.0,
) -> tuple[tuple[Scalar, ...], Note]:
    """The results of a `Polygon`, and the note; `zero` keeps a product and a sum apart (see `python_text`)."""
    fails, known, least, swings = meets(width, height, planes, zero)
    swing = jnp.max(jnp.stack(swings[:3]))
    thin = jnp.bool_(False)
    if corners:
        known &= jnp.isfinite(across)
        fails |= known & (across <= 0.0)
        thin = across < THIN * swing
    there = when & ~fails & known
    width, height = (jnp.where(there, x, 0.0) for x in (width, height))
    none = jnp.zeros_like(width)
    places = jnp.stack([jnp.stack([none, width, width, none]), jnp.stack([none, none, height, height])])
    places = jnp.concatenate([places, jnp.zeros((2, 4))]) if corners else places
    left = there
    for (a, b, c, _), low in zip(planes, least, strict=True):
        places, left = clipped(places, left, there & ~thin & (low < 0.0), a, b, c, zero)
    if corners:
        places, left = _with_coordinates(places, left, there & thin, width, height, planes, corners, across, zero)
    px, py = places[0], places[1]
    r, s, w = (jnp.array(column) for column in zip(*triangle_rule(degree), strict=True))
    ux, uy, vx, vy = px[1:-1] - px[0], py[1:-1] - py[0], px[2:] - px[0], py[2:] - py[0]
    area = jnp.where(left, 0.5 * ((ux * vy + zero) - (vx * uy + zero)), 0.0)
    nodes = [p[0] + (r * (p[1:-1] - p[0])[:, None] + zero) + (s * (p[2:] - p[0])[:, None] + zero) for p in places]
    found, note = jax.vmap(jax.vmap(lambda *at: _vector(body(*at))))(*nodes)
    weights = area[:, None] * w
    values = jnp.where((weights != 0.0)[..., None], weights[..., None] * found, 0.0)
    sums = jnp.sum(values, axis=(0, 1)) * jnp.stack([jnp.asarray(f, jnp.float64) for f in factors])
    sums = jnp.where(left, sums, jnp.where(when & ~fails & ~known, jnp.nan, 0.0))
    return tuple(sums[i] for i in range(len(factors))), union(where(left & (area != 0.0), jnp.max(jnp.asarray(note), axis=1)))


def meets(width: Scalar, height: Scalar, planes: Sequence[Plane], zero: Scalar) -> tuple[Scalar, Scalar, list[Scalar], list[Scalar]]:
    """Whether a half-plane fails on the box, whether all is finite, the least value of each half-plane, and its swing."""
    fails, known = jnp.bool_(False), jnp.isfinite(width) & jnp.isfinite(height)
    least: list[Scalar] = []
    swings: list[Scalar] = []
    for a, b, c, closed in planes:
        low, most = half_planes.least_and_most(jnp, a, b, c, width, height, zero)
        fails |= half_planes.fails(jnp, low, most, closed)
        known &= jnp.isfinite(most - low)
        least.append(low)
        swings.append(most - low)
    return fails, known, least, swings


def _vector(found: tuple[tuple[Scalar, ...], Note]) -> tuple[Any, Any]:
    values, note = found
    return jnp.stack([jnp.asarray(v, jnp.float64) for v in values]), jnp.asarray(note, jnp.int32)


def clipped(
    places: Any, left: Scalar, cuts: Scalar, a: Scalar, b: Scalar, c: Scalar, zero: Scalar, side: tuple[int, Scalar] | None = None
) -> tuple[Any, Any]:
    """A convex polygon cut by a half-plane, if it `cuts`: what its corners have, (coordinates, n + 1) for (coordinates, n), their place
    first, and whether anything is left. `side` is the number of a coordinate and what it is on the border.

    The corners from the one behind `before` to the one in front of `after` are cut off, and two come instead, the second one at `place`.
    Other corners that seem to be outside are on the border, but for rounding, and stay.
    """
    n = places.shape[1]
    number = jnp.arange(n + 1)
    d = jnp.where(cuts, c + (a * places[0] + zero) + (b * places[1] + zero), 1.0)
    inside, lowest = d >= 0.0, jnp.argmin(d)
    back, on = lowest - number[:-1], number[:-1] - lowest
    back, on = jnp.where(back < 0, back + n, back), jnp.where(on < 0, on + n, on)
    steps_back, steps_on = (jnp.min(jnp.where(inside, steps, n)) for steps in (back, on))
    cut = (back < steps_back) | (on < steps_on)
    before, after = (lowest - steps_back) % n, (lowest + steps_on) % n
    first, last = (before + 1) % n, (after - 1) % n
    leaves, enters = (_crossing(places, d, one, other, zero, side) for one, other in ((before, first), (after, last)))
    kept = jnp.where(cut, jnp.where(number[:-1] == first, leaves, enters), places)
    place = jnp.where(jnp.all(inside), n + 1, jnp.where(after == 0, 0, first + 1))
    same, shifted = (jnp.concatenate(parts, axis=1) for parts in ((kept, kept[:, -1:]), (kept[:, :1], kept)))
    return jnp.where(number < place, same, jnp.where(number == place, enters, shifted)), left & jnp.any(inside)


def _crossing(places: Any, d: Any, one: Scalar, other: Scalar, zero: Scalar, side: Any) -> Any:
    """What the point has, (coordinates, 1), at which an edge from a corner inside to one outside crosses the border."""
    start, stop = _corner(d, one), _corner(d, other)
    t = start / jnp.where(start == stop, 1.0, start - stop)
    p = _corner(places, one)
    new = p + (t * (_corner(places, other) - p) + zero)
    return (new if side is None else jnp.where(jnp.arange(new.shape[0]) == side[0], side[1], new))[:, None]


def _corner(values: Any, number: Scalar) -> Any:
    """What the corner of a number has, (…,) for (…, n): selected, as corners are few, and not gathered."""
    return jnp.sum(jnp.where(jnp.arange(values.shape[-1]) == number, values, 0.0), axis=-1)


def _with_coordinates(
    places: Any,
    left: Scalar,
    thin: Scalar,
    width: Scalar,
    height: Scalar,
    planes: Sequence[Plane],
    corners: Sequence[tuple[Scalar, Scalar]],
    across: Scalar,
    zero: Scalar,
) -> tuple[Any, Any]:
    """The corners of a polygon with barycentric coordinates, of a thin triangle those that the box leaves; and whether anything is left."""
    inverse = 1.0 / jnp.where(jnp.asarray(across, jnp.float64) == 0.0, 1.0, across)
    own = [(g[2] + (g[0] * places[0] + zero) + (g[1] * places[1] + zero)) * inverse for g in planes[1:3]]
    places = jnp.concatenate([places[:2], jnp.stack(own)])
    at = jnp.array([[jnp.asarray(x, jnp.float64) for x in p] for p in corners])
    su, sv = jnp.where(width < 0.0, -1.0, 1.0), jnp.where(height < 0.0, -1.0, 1.0)
    (ux, uy), (vx, vy) = at[1] - at[0], at[2] - at[0]
    turns = ((ux * vy + zero) - (vx * uy + zero)) * su * sv < 0.0
    at = jnp.concatenate([at.T, jnp.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])])
    cut, remains = jnp.where(turns, jnp.concatenate([at[:, :1], at[:, 2:], at[:, 1:2]], axis=1), at), thin
    left_and_right: list[tuple[Any, ...]] = [(su, 0.0, 0.0, (0, 0.0)), (-su, 0.0, su * width, (0, width))]
    for a, b, c, side in [*left_and_right, (0.0, sv, 0.0, (1, 0.0)), (0.0, -sv, sv * height, (1, height))]:
        cut, remains = clipped(cut, remains, thin, a, b, c, zero, side)
    for a, b, c, _ in planes[3:]:
        cut, remains = clipped(cut, remains, thin, a, b, c, zero)
    return jnp.where(thin, cut, places), jnp.where(thin, remains, left)


def segment(
    order: Scalar, lines: Sequence[Line], nodes: int, factors: Sequence[Scalar], body: Body, zero: Scalar, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Note]:
    """The results of a `Segment`, and the note: whether a tie was met."""
    start, stop = jnp.float64(0.0), jnp.float64(1.0)
    outside, undefined, met = jnp.bool_(False), jnp.bool_(False), jnp.bool_(False)
    for first, last, closed, may_tie, resolution, size, scale in lines:
        first, last = jnp.asarray(first, jnp.float64), jnp.asarray(last, jnp.float64)
        known = jnp.isfinite(first - last)
        ties, holds = jnp.bool_(False), jnp.bool_(False)
        if may_tie:
            most = jnp.maximum(jnp.abs(first), jnp.abs(last))
            ties = known & (most <= NEARLY * size) & (most <= TIE_EPS * scale)
            holds = jnp.where(order > 0, resolution, jnp.logical_not(resolution))
            met |= ties
        outside |= jnp.where(ties, ~holds, half_planes.misses(jnp, first, last, closed))
        undefined |= ~known & ~ties
        start, stop = half_planes.cut(jnp, start, stop, first, last, ties)
    there = when & ~outside & ~undefined & (start < stop)
    at, weights = (0.5 * jnp.array(column) for column in gauss_legendre(nodes))
    length = jnp.where(there, stop - start, 0.0)
    t = jnp.where(there, start + (length * (0.5 + at) + zero), 0.5)
    found, note = jax.vmap(lambda x: _vector(body(x)))(t)
    sums = jnp.sum(jnp.where(there, (length * weights)[:, None] * found, 0.0), axis=0)
    sums *= jnp.stack([jnp.asarray(f, jnp.float64) for f in factors])
    sums = jnp.where(there, sums, jnp.where(when & undefined & ~outside, jnp.nan, 0.0))
    tied = where(when & met, jnp.int32(TIED))
    return tuple(sums[i] for i in range(len(factors))), tied | union(where(there, note))
