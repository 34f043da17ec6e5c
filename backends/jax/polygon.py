"""Clipped polygons and segments with static shapes, which the printed JAX programs call as `polygons`.

A polygon gains one corner with each half-plane, whatever that cuts off: where fewer are left, some stand twice, and their triangles have no
area. Nothing is moved by index: a scatter for each cut would take long. Few corners, and few nodes, are written out one by one (`corners`).
`setup` and `scales` stand in the program before the call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from teg.backends.jax import corners as written_out
from teg.backends.jax import entries
from teg.backends.jax.corners import Corner, Cut
from teg.backends.jax.runtime import TIED, Note, Run, Scalar, union, where
from teg.backends.shared import polygons as half_planes
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import NEARLY, THIN, TIE_EPS

FEW = 9
"""Corners of a clipped polygon up to which they are written out one by one: XLA computes few in few kernels, and compiles many slowly."""
MANY = 24
"""Nodes of a polygon beyond which they are computed as an array."""
Body = Callable[..., tuple[tuple[Scalar, ...], Note]]
Plane = tuple[Scalar, Scalar, Scalar, bool]
Line = tuple[Scalar, Scalar, bool, bool, Scalar, Scalar, Scalar]
"""First, last, closed, whether it may tie, resolution, size, scale."""


class Region(NamedTuple):
    """A box from (0, 0) and half-planes; of a triangle its corners, and twice its area."""

    width: Scalar
    height: Scalar
    planes: Sequence[Plane]
    corners: Sequence[tuple[Scalar, Scalar]] = ()
    across: Scalar = 0.0


def polygon(
    run: Run, region: Region, degree: int, factors: Sequence[Scalar], body: Body, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Note]:
    """The results of a `Polygon`, and the note."""
    (_, zero), (width, height, planes, corners, across) = run, region
    fails, known, least, swings = meets(width, height, planes, zero)
    swing = jnp.max(jnp.stack(swings[:3]))
    thin = jnp.bool_(False)
    if corners:
        known &= jnp.isfinite(across)
        fails |= known & (across <= 0.0)
        thin = across < THIN * swing
    there = when & ~fails & known
    width, height = (jnp.where(there, x, 0.0) for x in (width, height))
    cuts = [Cut(there & ~thin & (low < 0.0), *plane[:3]) for low, plane in zip(least, planes, strict=True)]
    clipped, left = clip(box(width, height), there, cuts, zero)
    if corners:
        region = region._replace(width=width, height=height)
        clipped, left = _with_coordinates(clipped, left, there & thin, region, zero)
    rule = triangle_rule(degree)
    fan = _fan_written_out if (len(clipped) - 2) * len(rule) <= MANY else _fan
    sums, note = fan(clipped, left, rule, body, zero)
    nothing = jnp.where(when & ~fails & ~known, jnp.nan, 0.0)
    return tuple(jnp.where(left, v * factor, nothing) for v, factor in zip(sums, factors, strict=True)), note


def _fan(corners: Sequence[Corner], left: Scalar, rule: Any, body: Body, zero: Scalar) -> tuple[Sequence[Scalar], Note]:
    """The sums over the nodes of the triangles between the first corner and the others, and the note."""
    places = [entries.stacked(row) for row in zip(*corners, strict=True)]
    px, py = places[0], places[1]
    r, s, w = (jnp.array(column) for column in zip(*rule, strict=True))
    ux, uy, vx, vy = px[1:-1] - px[0], py[1:-1] - py[0], px[2:] - px[0], py[2:] - py[0]
    area = jnp.where(left, 0.5 * ((ux * vy + zero) - (vx * uy + zero)), 0.0)
    nodes = [p[0] + (r * (p[1:-1] - p[0])[:, None] + zero) + (s * (p[2:] - p[0])[:, None] + zero) for p in places]
    found, note = jax.vmap(jax.vmap(lambda *at: vector(body(*at))))(*nodes)
    weights = area[:, None] * w
    values = jnp.where((weights != 0.0)[..., None], weights[..., None] * found, 0.0)
    return entries.entries(jnp.sum(values, axis=(0, 1))), union(where(left & (area != 0.0), jnp.max(jnp.asarray(note), axis=1)))


def _fan_written_out(corners: Sequence[Corner], left: Scalar, rule: Any, body: Body, zero: Scalar) -> tuple[Sequence[Scalar], Note]:
    """The same, node by node: few."""
    first, sums, noted = corners[0], None, jnp.int32(0)
    for one, other in pairwise(corners[1:]):
        u, v = ([p - q for p, q in zip(corner, first, strict=True)] for corner in (one, other))
        area = jnp.where(left, 0.5 * ((u[0] * v[1] + zero) - (v[0] * u[1] + zero)), 0.0)
        for r, s, w in rule:
            values, note = body(*(p + (r * du + zero) + (s * dv + zero) for p, du, dv in zip(first, u, v, strict=True)))
            weight = area * w
            terms = [jnp.where(weight != 0.0, weight * value, 0.0) for value in values]
            sums = terms if sums is None else [total + term for total, term in zip(sums, terms, strict=True)]
            noted = noted | where(left & (area != 0.0), note)
    assert sums is not None
    return sums, noted


def meets(width: Scalar, height: Scalar, planes: Sequence[Plane], zero: Scalar) -> tuple[Scalar, Scalar, list[Scalar], list[Scalar]]:
    """Whether a half-plane fails on the box, whether all is finite, the least value of each half-plane, and its swing."""
    fails, known = jnp.bool_(False), jnp.isfinite(width) & jnp.isfinite(height)
    least: list[Scalar] = []
    swings: list[Scalar] = []
    for a, b, c, closed in planes:
        low, most = half_planes.least_and_most(jnp, (a, b, c), (width, height), zero)
        fails |= half_planes.fails(jnp, low, most, closed)
        known &= jnp.isfinite(most - low)
        least.append(low)
        swings.append(most - low)
    return fails, known, least, swings


def vector(found: tuple[tuple[Scalar, ...], Note]) -> tuple[Any, Any]:
    """The values of a body as an array, and the note."""
    values, note = found
    return jnp.stack([jnp.asarray(v, jnp.float64) for v in values]), jnp.asarray(note, jnp.int32)


def box(width: Scalar, height: Scalar) -> list[Corner]:
    """The corners of a box from (0, 0)."""
    none = jnp.zeros_like(width)
    return [(none, none), (width, none), (width, height), (none, height)]


def clip(corners: Sequence[Corner], left: Scalar, cuts: Sequence[Cut], zero: Scalar) -> tuple[list[Corner], Scalar]:
    """A convex polygon cut by half-planes, one corner more for each, and whether anything is left."""
    if len(corners) + len(cuts) <= FEW:
        for cut in cuts:
            corners, left = written_out.clipped(corners, left, cut, zero)
        return list(corners), left
    places = jnp.stack([entries.stacked(row) for row in zip(*corners, strict=True)])
    for cut in cuts:
        places, left = clipped(places, left, cut, zero)
    return list(zip(*map(entries.entries, places), strict=True)), left


def clipped(places: Any, left: Scalar, by: Cut, zero: Scalar) -> tuple[Any, Any]:
    """What the corners of a cut polygon have, (coordinates, n + 1) for (coordinates, n), and whether anything is left: that of
    `corners.clipped`, for many corners.

    The corners from the one behind `before` to the one in front of `after` are cut off, and two come instead, the second one at `place`.
    Other corners that seem to be outside are on the border, but for rounding, and stay.
    """
    cuts, a, b, c, side = by
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


def _with_coordinates(clipped: Sequence[Corner], left: Scalar, thin: Scalar, region: Region, zero: Scalar) -> tuple[list[Corner], Scalar]:
    """The corners of a polygon with barycentric coordinates, of a thin triangle those that the box leaves; and whether anything is left."""
    width, height, planes, places, across = region
    inverse = 1.0 / jnp.where(jnp.asarray(across, jnp.float64) == 0.0, 1.0, across)
    plain = [(x, y, *((g[2] + (g[0] * x + zero) + (g[1] * y + zero)) * inverse for g in planes[1:3])) for x, y in clipped]
    at = [tuple(jnp.asarray(v, jnp.float64) for v in p) for p in places]
    su, sv = jnp.where(width < 0.0, -1.0, 1.0), jnp.where(height < 0.0, -1.0, 1.0)
    (ux, uy), (vx, vy) = ((p[0] - at[0][0], p[1] - at[0][1]) for p in at[1:])
    turns = ((ux * vy + zero) - (vx * uy + zero)) * su * sv < 0.0
    first, second, third = ((*p, *map(jnp.float64, c)) for p, c in zip(at, ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), strict=True))
    turned = [first, written_out.where(turns, third, second), written_out.where(turns, second, third)]
    sides = [(su, 0.0, 0.0, (0, 0.0)), (-su, 0.0, su * width, (0, width)), (0.0, sv, 0.0, (1, 0.0)), (0.0, -sv, sv * height, (1, height))]
    cuts = [*(Cut(thin, *side) for side in sides), *(Cut(thin, *plane[:3]) for plane in planes[3:])]
    cut, remains = clip(turned, thin, cuts, zero)
    return [written_out.where(thin, p, q) for p, q in zip(cut, plain, strict=True)], jnp.where(thin, remains, left)


def segment(
    run: Run, lines: Sequence[Line], nodes: int, factors: Sequence[Scalar], body: Body, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Note]:
    """The results of a `Segment`, and the note: whether a tie was met."""
    order, zero = run
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
    length = jnp.where(there, stop - start, 0.0)
    sums, note = (_along_written_out if nodes <= MANY else _along)((start, length), there, nodes, body, zero)
    nothing = jnp.where(when & undefined & ~outside, jnp.nan, 0.0)
    sums = [jnp.where(there, v * factor, nothing) for v, factor in zip(sums, factors, strict=True)]
    tied = where(when & met, jnp.int32(TIED))
    return tuple(sums), tied | where(there, note)


def _along(part: tuple[Scalar, Scalar], there: Scalar, nodes: int, body: Body, zero: Scalar) -> tuple[Sequence[Scalar], Note]:
    """The integrals along a part of a segment, with its start and its length, and the note."""
    start, length = part
    at, weights = (0.5 * jnp.array(column) for column in gauss_legendre(nodes))
    t = jnp.where(there, start + (length * (0.5 + at) + zero), 0.5)
    found, note = jax.vmap(lambda x: vector(body(x)))(t)
    return entries.entries(jnp.sum((length * weights)[:, None] * found, axis=0)), union(note)


def _along_written_out(part: tuple[Scalar, Scalar], there: Scalar, nodes: int, body: Body, zero: Scalar) -> tuple[Sequence[Scalar], Note]:
    """The same, node by node: few."""
    start, length = part
    sums: list[Scalar] = []
    noted = jnp.int32(0)
    for at, weight in zip(*gauss_legendre(nodes), strict=True):
        values, note = body(jnp.where(there, start + (length * (0.5 + 0.5 * float(at)) + zero), 0.5))
        terms = [(length * (0.5 * float(weight))) * value for value in values]
        sums = [total + term for total, term in zip(sums, terms, strict=True)] if sums else terms
        noted = noted | note
    return sums, noted
