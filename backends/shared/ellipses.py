"""Moments of an ellipse in a convex polygon, and of its arcs there, by NumPy or JAX: `Ellipse` of `teg.program`.

The polygon is a box, or what half-planes leave of it; a corner may stand there several times.

`xp` is numpy or jax.numpy. Everything is computed for all elements: there are masks, and no branches. Points are kept twice, as offsets
(u, v) from the point of the box that is nearest to the centre, and as w = A·((u, v) - centre), in which the ellipse is a circle around 0;
det A > 0. So neither a small ellipse in a large box nor a large one beside a small box loses its digits.

1. A corner is inside or not: one decision, which both of its sides share. So exits of the circle from the polygon and entries alternate.
2. A side has a chord inside the circle, of which both ends are known by the distance of the side from the centre.
3. The arc after an exit ends at the next entry. Without any, the circle is all in the polygon, or not at all: the lines decide.
4. About a point inside, no part of the border counts negatively:  ∫∫ uʲvᵏ = 1/(j + k + 2)·∮ uʲvᵏ (u dv - v du).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from teg.backends.shared.moments import Powers
from teg.numerics.arcs import MANY, parts_of_a_circle
from teg.numerics.quadrature import gauss_legendre
from teg.program import CLOSE_ENDS, TANGENT

Kind = tuple[str, tuple[Powers, ...], Powers]
"""The kind of a result, the powers of u and v in its terms, and the powers of both numbers of w."""
Point = tuple[Any, Any]
Plane = tuple[Any, Any, Any]
"""a, b and c of c + a·u + b·v > 0."""
CIRCLE = 2.0 * math.pi


def sorted_box(xp: Any, width: Any, height: Any) -> tuple[Any, Any, Any, Any]:
    """Returns the least and the largest u, the least and the largest v of a box."""
    return xp.minimum(width, 0.0), xp.maximum(width, 0.0), xp.minimum(height, 0.0), xp.maximum(height, 0.0)


def corners_of_box(xp: Any, width: Any, height: Any) -> Point:
    """Returns u and v of the corners of a box, counterclockwise."""
    low_u, high_u, low_v, high_v = sorted_box(xp, width, height)
    return xp.stack([low_u, high_u, high_u, low_u]), xp.stack([low_v, low_v, high_v, high_v])


class EllipseMoments:
    """The moments that the results of one statement need; `given` are u and v of the centre, the radius, width and height, `corners` those
    of the polygon, counterclockwise.

    Corners, sides and arcs are counted along a first axis: side i begins at corner i, arc i at the end of side i.
    """

    def __init__(
        self, xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind], corners: Point, planes: Sequence[Plane] = ()
    ) -> None:
        self.xp, self.matrix = xp, matrix
        u, v, self.radius, width, height = given
        low_u, high_u, low_v, high_v = sorted_box(xp, width, height)
        self.origin = xp.clip(u, low_u, high_u), xp.clip(v, low_v, high_v)
        self.centre = u - self.origin[0], v - self.origin[1]
        self.sign = sign_of(xp, width, height)
        self.flat = (width == 0.0) | (height == 0.0)
        sides: list[Plane] = [(1.0, 0.0, -low_u), (-1.0, 0.0, high_u), (0.0, 1.0, -low_v), (0.0, -1.0, high_v)]
        self.around = self._is_around(u, v, [*sides, *planes])
        self._sides(corners[0] - self.origin[0], corners[1] - self.origin[1])
        self._arcs()
        self._known: dict[int, tuple[Point, Point, Point, Any]] = {}
        inside = sorted({p for kind, powers, _ in kinds if kind != "border" for p in powers})
        border = sorted({(axes, p) for kind, powers, axes in kinds if kind == "border" for p in powers})
        self.inside: dict[Powers, Any] = self._within(inside) if inside else {}
        self.border: dict[tuple[Powers, Powers], Any] = self._along(border) if border else {}

    def _is_around(self, u: Any, v: Any, planes: Sequence[Plane]) -> Any:
        """Returns whether the disk is inside of all lines, or touches them to rounding."""
        a, b, c, d = self.matrix
        far = self.radius * ((1.0 - TANGENT) / (a * d - b * c))
        around = self.xp.isfinite(self.radius)
        for p, q, at_corner in planes:
            around = around & ((at_corner + p * u) + q * v >= far * self.xp.hypot(d * p - c * q, a * q - b * p))
        return around

    def _seen(self, u: Any, v: Any) -> Point:
        """Returns A·(u, v)."""
        a, b, c, d = self.matrix
        return a * u + b * v, c * u + d * v

    def _placed(self, p: Any, q: Any) -> Point:
        """Returns the inverse of A, times (p, q)."""
        a, b, c, d = self.matrix
        whole = a * d - b * c
        return (d / whole) * p + (-b / whole) * q, (-c / whole) * p + (a / whole) * q

    def _sides(self, u: Any, v: Any) -> None:
        """Finds the chord of each side: where it begins and ends, and whether the circle enters the box at its begin, and leaves it at its
        end."""
        xp, rho = self.xp, self.radius
        p, q = self._seen(u - self.centre[0], v - self.centre[1])
        first = p * p + q * q < rho * rho
        last = xp.roll(first, -1, 0)
        over, up = xp.roll(u, -1, 0) - u, xp.roll(v, -1, 0) - v
        dp, dq = self._seen(over, up)
        square = dp * dp + dq * dq
        some = square > 0.0
        length = xp.sqrt(xp.where(some, square, 1.0))
        dp, dq = dp / length, dq / length
        a, b, c, d = self.matrix
        away = (a * d - b * c) * ((u - self.centre[0]) * up - (v - self.centre[1]) * over) / length
        half = xp.sqrt(xp.maximum((rho - away) * (rho + away), 0.0))
        foot = -(p * dp + q * dq)
        self.chord = first | last | (~first & ~last & (half > 0.0) & (foot > 0.0) & (foot < length) & some)

        def end(at: Any, shift: Any, inside: Any) -> tuple[Point, Point]:
            """Returns an end of the chord, and the same as w: a short side has no digits of its direction, so w is the end's."""
            w = away * dq + shift * dp, shift * dq - away * dp
            (x, y), near = self._placed(*w), ~inside & some & (rho < length)
            along = xp.where(self.chord, xp.clip(xp.where(inside, at, at + shift) / length, 0.0, 1.0), 0.0)
            x, y = xp.where(near, self.centre[0] + x, u + along * over), xp.where(near, self.centre[1] + y, v + along * up)
            seen = self._seen(x - self.centre[0], y - self.centre[1])
            return (x, y), (xp.where(near, w[0], seen[0]), xp.where(near, w[1], seen[1]))

        self.start, self.entry = end(xp.where(first, 0.0, foot), -half, first)
        self.stop, self.exit = end(xp.where(last, length, foot), half, last)
        self.enters, self.leaves = self.chord & ~first, self.chord & ~last

    def _arcs(self) -> None:
        """Finds the arc after each exit: where it begins, and its angle. A whole circle is the first one's."""
        xp, rho = self.xp, self.radius
        any_chord = xp.any(self.chord, axis=0)
        self.whole = ~any_chord & self.around & ~self.flat
        self.some = any_chord | self.whole
        s = t = xp.zeros_like(rho)
        count = len(self.chord)
        ends: list[Point] = [(s, t)] * count
        for i in reversed(range(2 * count)):
            ends[i % count] = s, t
            s, t = (xp.where(self.enters[i % count], w[i % count], end) for w, end in zip(self.entry, (s, t), strict=True))
        s, t = (xp.stack([end[axis] for end in ends]) for axis in range(2))
        p, q = self.exit
        across = p * t - q * s
        angle = xp.arctan2(across, p * s + q * t)
        angle = xp.where(angle < 0.0, angle + CIRCLE, angle)
        apart = xp.sqrt((p - s) ** 2 + (q - t) ** 2) / xp.where(rho > 0.0, rho, 1.0)
        close = self.leaves & (apart < CLOSE_ENDS)
        number = xp.arange(count).reshape((count,) + (1,) * (angle.ndim - 1))
        around = self.around & xp.all(close == self.leaves, axis=0)
        behind = number == xp.argmin(xp.where(close, across, np.inf), axis=0)
        apart = xp.where(around & behind, CIRCLE - apart, apart)
        angle = xp.where(self.leaves, xp.where(close, apart, angle), 0.0)
        complete = self.whole & (number == 0)
        self.angle = xp.where(complete, CIRCLE, angle)
        self.heading = xp.where(complete, rho, p), xp.where(complete, 0.0, q)
        u, v = self._placed(rho, xp.zeros_like(rho))
        self.begin = xp.where(complete, self.centre[0] + u, self.stop[0]), xp.where(complete, self.centre[1] + v, self.stop[1])
        if xp is np:
            self._leave_out_empty_arcs()

    def _leave_out_empty_arcs(self) -> None:
        """Keeps as many arcs as the element that has most."""
        order = np.argsort(self.angle == 0.0, axis=0, kind="stable")[: int(np.max(np.sum(self.angle != 0.0, axis=0), initial=0))]
        u, v, p, q, self.angle = (np.take_along_axis(x, order, 0) for x in (*self.begin, *self.heading, self.angle))
        self.begin, self.heading = (u, v), (p, q)

    def _nodes(self, degree: int) -> tuple[Point, Point, Point, Any]:
        """Returns places (u, v) on all arcs, derivatives by the angle, the same places w, and weights; the nodes are the second axis."""
        count = parts_of_a_circle(degree)
        if count not in self._known:
            self._known[count] = self._nodes_in(count)
        return self._known[count]

    def _nodes_in(self, count: int) -> tuple[Point, Point, Point, Any]:
        """The same, for arcs in so many parts."""
        xp, (nodes, weights) = self.xp, gauss_legendre(MANY)
        begin_u, begin_v, p, q, angle = (part[:, None] for part in (*self.begin, *self.heading, self.angle))
        turns = xp.asarray([(2 * part + 1 + x) / (2 * count) for part in range(count) for x in nodes])
        weigh = xp.asarray([w / (2 * count) for _ in range(count) for w in weights])
        shape = (1, len(turns)) + (1,) * (angle.ndim - 2)
        turned, weigh = 0.5 * angle * turns.reshape(shape), angle * weigh.reshape(shape)
        sine, cosine = xp.sin(turned), xp.cos(turned)
        rise, run = -2.0 * sine * sine, 2.0 * sine * cosine  # cos α - 1 and sin α of the angle α from the begin
        u, v = self._placed(rise * p - run * q, rise * q + run * p)
        du, dv = self._placed(-run * p - (1.0 + rise) * q, -run * q + (1.0 + rise) * p)
        seen = p + (rise * p - run * q), q + (rise * q + run * p)
        return (begin_u + u, begin_v + v), (du, dv), seen, weigh

    def _along(self, wanted: Sequence[tuple[Powers, Powers]]) -> dict[tuple[Powers, Powers], Any]:
        """Returns ½/det A·∮ pᵐqⁿuʲvᵏ dφ for ((m, n), (j, k))."""
        a, b, c, d = self.matrix
        scale = self.sign * (0.5 / (a * d - b * c))
        if wanted == [((0, 0), (0, 0))]:
            return {wanted[0]: scale * self.xp.sum(self.angle, axis=0)}
        (u, v), _, seen, weights = self._nodes(max(sum(axes) + sum(powers) for axes, powers in wanted))
        u, v = u + self.origin[0], v + self.origin[1]
        found: dict[tuple[Powers, Powers], Any] = {}
        for axes, factor in _moments(weights, *seen, sorted({axes for axes, _ in wanted})).items():
            for powers, values in _moments(factor, u, v, [powers for other, powers in wanted if other == axes]).items():
                found[axes, powers] = scale * self.xp.sum(values, axis=(0, 1))
        return found

    def _within(self, wanted: Sequence[Powers]) -> dict[Powers, Any]:
        """Returns ∫∫ uʲvᵏ, from its like about a point inside."""
        xp, degree = self.xp, max(j + k for j, k in wanted)
        count = xp.maximum(2.0 * xp.sum(self.chord, axis=0), 1.0)
        at: list[Any] = []
        for first, last, centre in zip(self.start, self.stop, self.centre, strict=True):
            at.append(xp.where(self.whole, centre, xp.sum(xp.where(self.chord, first + last, 0.0), axis=0) / count))
        lower = lower_powers(wanted)
        (u, v), (du, dv), _, weights = self._nodes(degree + 2)
        u, v = u - at[0], v - at[1]
        about = {p: xp.sum(values, axis=(0, 1)) for p, values in _moments(weights * (u * dv - v * du), u, v, lower).items()}
        for powers, chords in _along_chords(xp, self.start, self.stop, at, self.chord, lower).items():
            about[powers] = about[powers] + chords
        found = _moved(about, (at[0] + self.origin[0], at[1] + self.origin[1]), wanted)
        return {powers: xp.where(self.some, self.sign * total, 0.0) for powers, total in found.items()}


def sign_of(xp: Any, width: Any, height: Any) -> Any:
    """Returns the sign of the area of a box."""
    return xp.where((width < 0.0) ^ (height < 0.0), -1.0, 1.0)


def lower_powers(wanted: Sequence[Powers]) -> list[Powers]:
    """Returns the powers of the moments about another point that these consist of."""
    return sorted({(a, b) for j, k in wanted for a in range(j + 1) for b in range(k + 1)})


def _along_chords(xp: Any, first: Point, last: Point, at: Sequence[Any], some: Any, wanted: Sequence[Powers]) -> dict[Powers, Any]:
    """Returns ∫ uʲvᵏ (u dv - v du) along the chords that count, about a point."""
    (p, q), (s, t) = ((x - at[0], y - at[1]) for x, y in (first, last))
    across = xp.where(some, p * t - q * s, 0.0)
    total: dict[Powers, Any] = dict.fromkeys(wanted, 0.0)
    for x, w in zip(*gauss_legendre(max(j + k for j, k in wanted) // 2 + 1), strict=True):
        u, v = 0.5 * ((1.0 - x) * p + (1.0 + x) * s), 0.5 * ((1.0 - x) * q + (1.0 + x) * t)
        for powers, values in _moments(0.5 * w * across, u, v, wanted).items():
            total[powers] = total[powers] + xp.sum(values, axis=0)
    return total


def _moved(about: dict[Powers, Any], at: Point, wanted: Sequence[Powers]) -> dict[Powers, Any]:
    """Returns ∫∫ uʲvᵏ by the integrals of uᵐvⁿ (u dv - v du) along the border about a point."""
    u, v = at
    found: dict[Powers, Any] = {}
    for j, k in wanted:
        ways = ((comb(j, i) * comb(k, m) / (i + m + 2), i, m) for i in range(j + 1) for m in range(k + 1))
        found[j, k] = sum(c * u ** (j - i) * v ** (k - m) * about[i, m] for c, i, m in ways)
    return found


def moments_of_box(width: Any, height: Any, kinds: Sequence[Kind]) -> dict[Powers, Any]:
    """Returns ∫∫ uʲvᵏ over a box, for results of insides."""
    wanted = {p for kind, powers, _ in kinds if kind != "border" for p in powers}
    return {(j, k): width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1)) for j, k in sorted(wanted)}


def moments_of_polygon(xp: Any, corners: Point, sign: Any, kinds: Sequence[Kind]) -> dict[Powers, Any]:
    """Returns ∫∫ uʲvᵏ over a polygon, for results of insides."""
    wanted = sorted({p for kind, powers, _ in kinds if kind != "border" for p in powers})
    if not wanted:
        return {}
    at = [xp.mean(x, axis=0) for x in corners]
    last = xp.roll(corners[0], -1, 0), xp.roll(corners[1], -1, 0)
    about = _along_chords(xp, corners, last, at, True, lower_powers(wanted))
    return {powers: sign * total for powers, total in _moved(about, (at[0], at[1]), wanted).items()}


def _moments(factor: Any, u: Any, v: Any, wanted: Sequence[Powers]) -> dict[Powers, Any]:
    """Returns factor·uʲvᵏ for powers in ascending order."""
    found: dict[Powers, Any] = {}
    for j, k in wanted:
        if (j, k - 1) in found:
            found[j, k] = found[j, k - 1] * v
        elif (j - 1, k) in found:
            found[j, k] = found[j - 1, k] * u
        else:
            found[j, k] = factor * u**j * v**k if j or k else factor
    return found


def oriented(xp: Any, matrix: Sequence[Any]) -> tuple[tuple[Any, ...], Any]:
    """Returns a matrix A with a determinant that is not negative, and the same |Aw|; and by which number its second row is multiplied."""
    a, b, c, d = matrix
    turn = xp.where(a * d - b * c < 0.0, -1.0, 1.0)
    return (a, b, turn * c, turn * d), turn


def certain(xp: Any, matrix: Sequence[Any], given: Sequence[Any]) -> tuple[Any, Any]:
    """Returns whether the ellipse of a place has all of the box inside, and whether its disk is beside the box, beyond one side of it."""
    (a, b, c, d), _ = oriented(xp, matrix)
    u, v, radius, width, height, least = given
    least_u, most_u, least_v, most_v = (f(extent, 0.0) for extent in (width, height) for f in (xp.minimum, xp.maximum))
    inside = (radius >= least) & xp.isfinite(abs(u) + abs(v) + abs(width) + abs(height))
    for x, y in ((least_u, least_v), (most_u, least_v), (most_u, most_v), (least_u, most_v)):
        p, q = a * (x - u) + b * (y - v), c * (x - u) + d * (y - v)
        inside = inside & (p * p + q * q < radius * radius)
    whole = a * d - b * c
    largest = xp.maximum(radius, least) * (1.0 + TANGENT)
    reach_u, reach_v = largest * (xp.hypot(d, b) / whole), largest * (xp.hypot(a, c) / whole)
    beside = (u - reach_u > most_u) | (u + reach_u < least_u) | (v - reach_v > most_v) | (v + reach_v < least_v)
    return inside & (whole > 0.0), beside & xp.isfinite(abs(width) + abs(height) + largest) & (whole > 0.0)


def on_one_side(
    xp: Any, whole: dict[Powers, Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]], inside: bool, like: Any
) -> list[Any]:
    """Returns the results on polygons with the moments `whole` that are all inside the ellipse, or all outside, of the shape of `like`."""
    results = []
    for (kind, powers, _), factors in zip(kinds, coefficients, strict=True):
        total = xp.zeros_like(like)
        if (kind == "above") == inside and kind != "border":
            for p, factor in zip(powers, factors, strict=True):
                total = total + factor * whole[p]
        results.append(total)
    return results


@dataclass(frozen=True)
class Domain:
    """What half-planes leave of a box: the corners of the polygon, its moments, and the half-planes."""

    corners: Point
    whole: dict[Powers, Any]
    planes: Sequence[Plane] = ()


def box_domain(xp: Any, place: Sequence[Any], kinds: Sequence[Kind]) -> Domain:
    """Returns a box as a domain."""
    width, height = place[3:5]
    return Domain(corners_of_box(xp, width, height), moments_of_box(width, height, kinds))


def polygon_domain(xp: Any, place: Sequence[Any], kinds: Sequence[Kind], corners: Point, planes: Sequence[Plane]) -> Domain:
    """Returns a clipped box as a domain, from its corners counterclockwise."""
    width, height = place[3:5]
    return Domain(corners, moments_of_polygon(xp, corners, sign_of(xp, width, height), kinds), planes)


def on_crossed(
    xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]], domain: Domain
) -> list[Any]:
    """Returns the results on domains that the ellipse may cross."""
    u, v, radius, width, height, least = given
    matrix, turn = oriented(xp, matrix)
    inside, border = ([k for k in kinds if (k[0] == "border") == wanted] for wanted in (False, True))
    place = domain.corners, domain.planes
    if xp is np and not np.any(radius < least):
        moments = borders = EllipseMoments(xp, matrix, given[:5], kinds, *place)
    else:
        moments = EllipseMoments(xp, matrix, given[:5], inside, *place)
        borders = EllipseMoments(xp, matrix, (u, v, xp.maximum(radius, least), width, height), border, *place)
    known = xp.isfinite(sum(abs(v) for v in given)) & (matrix[0] * matrix[3] - matrix[1] * matrix[2] > 0.0)
    results = []
    for (kind, powers, axes), factors in zip(kinds, coefficients, strict=True):
        total: Any = 0.0
        for p, factor in zip(powers, factors, strict=True):
            moment = borders.border[axes, p] if kind == "border" else moments.inside[p]
            total = total + factor * (domain.whole[p] - moment if kind == "below" else moment)
        results.append(xp.where(known, turn * total if axes[1] % 2 else total, xp.nan))
    return results


def totals(
    xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]], domain: Domain
) -> list[Any]:
    """Returns the results of an `Ellipse` on any domains; `coefficients` has those of each result."""
    holds, beside = certain(xp, matrix, given)
    apart = (on_one_side(xp, domain.whole, kinds, coefficients, inside, given[3]) for inside in (True, False))
    crossed = on_crossed(xp, matrix, given, kinds, coefficients, domain)
    return [xp.where(holds, h, xp.where(beside, b, total)) for h, b, total in zip(*apart, crossed, strict=True)]
