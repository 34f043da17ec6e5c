"""Moments of an ellipse in a box, and of its arcs there, by NumPy or JAX: `Ellipse` of `teg.program`.

`xp` is numpy or jax.numpy. Everything is computed for all elements: there are masks, and no branches. Points are kept twice, as offsets
(u, v) from the point of the box that is nearest to the centre, and as w = A·((u, v) - centre), in which the ellipse is a circle around 0;
det A > 0. So neither a small ellipse in a large box nor a large one beside a small box loses its digits.

1. A corner is inside or not: one decision, which both of its sides share. So exits of the circle from the box and entries alternate.
2. A side has a chord inside the circle, of which both ends are known by the distance of the side from the centre.
3. The arc after an exit ends at the next entry. Without any, the circle is all in the box, or not at all.
4. About a point inside, no part of the border counts negatively:  ∫∫ uʲvᵏ = 1/(j + k + 2)·∮ uʲvᵏ (u dv - v du).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import comb
from typing import Any

import numpy as np

from teg.backends.shared.moments import Kind, Powers
from teg.numerics.arcs import MANY, parts_of_a_circle
from teg.numerics.quadrature import gauss_legendre
from teg.program import CLOSE_ENDS, TANGENT

Point = tuple[Any, Any]
CIRCLE = 2.0 * math.pi


class EllipseMoments:
    """The moments that the results of one statement need; `given` are u and v of the centre, the radius, width and height.

    Corners, sides and arcs are counted along a first axis: side i begins at corner i, arc i at the end of side i.
    """

    def __init__(self, xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind]) -> None:
        self.xp, self.matrix = xp, matrix
        u, v, self.radius, width, height = given
        low_u, high_u = xp.minimum(width, 0.0), xp.maximum(width, 0.0)
        low_v, high_v = xp.minimum(height, 0.0), xp.maximum(height, 0.0)
        self.origin = xp.clip(u, low_u, high_u), xp.clip(v, low_v, high_v)
        self.centre = u - self.origin[0], v - self.origin[1]
        self.sign = xp.where((width < 0.0) ^ (height < 0.0), -1.0, 1.0)
        self.flat = (width == 0.0) | (height == 0.0)
        self._sides(
            xp.stack([low_u, high_u, high_u, low_u]) - self.origin[0],
            xp.stack([low_v, low_v, high_v, high_v]) - self.origin[1],
        )
        self._arcs()
        inside = sorted({p for kind, powers in kinds if kind != "border" for p in powers})
        border = sorted({p for kind, powers in kinds if kind == "border" for p in powers})
        self.inside: dict[Powers, Any] = self._within(inside) if inside else {}
        self.border: dict[Powers, Any] = self._along(border) if border else {}

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
        a, b, c, d = self.matrix  # a side is along u or along v, so the distance of its line is one product
        away = (a * d - b * c) * ((u - self.centre[0]) * up - (v - self.centre[1]) * over) / length
        half = xp.sqrt(xp.maximum((rho - away) * (rho + away), 0.0))
        foot = -(p * dp + q * dq)
        self.chord = first | last | (~first & ~last & (half > 0.0) & (foot > 0.0) & (foot < length) & some)
        self.entry, self.exit = (away * dq - half * dp, -away * dp - half * dq), (away * dq + half * dp, -away * dp + half * dq)

        def end(at: Any, w: Point, inside: Any) -> Point:
            (x, y), small = self._placed(*w), ~inside & (rho < length)
            along = xp.where(self.chord, xp.clip(at / length, 0.0, 1.0), 0.0)
            return xp.where(small, self.centre[0] + x, u + along * over), xp.where(small, self.centre[1] + y, v + along * up)

        self.start = end(xp.where(first, 0.0, foot - half), self.entry, first)
        self.stop = end(xp.where(last, length, foot + half), self.exit, last)
        self.enters, self.leaves = self.chord & ~first, self.chord & ~last
        self.around = xp.isfinite(rho) & xp.all(~some | (away >= rho * (1.0 - TANGENT)), axis=0)
        """Whether the centre has all sides on its left, further away than the radius to rounding."""

    def _arcs(self) -> None:
        """Finds the arc after each exit: where it begins, and its angle. A whole circle is the first one's."""
        xp, rho = self.xp, self.radius
        any_chord = xp.any(self.chord, axis=0)
        self.whole = ~any_chord & self.around & ~self.flat
        self.some = any_chord | self.whole
        s = t = xp.zeros_like(rho)
        ends: list[Point] = [(s, t)] * 4
        for i in reversed(range(8)):
            ends[i % 4] = s, t
            s, t = (xp.where(self.enters[i % 4], w[i % 4], end) for w, end in zip(self.entry, (s, t), strict=True))
        s, t = (xp.stack([end[axis] for end in ends]) for axis in range(2))
        p, q = self.exit
        angle = xp.arctan2(p * t - q * s, p * s + q * t)
        angle = xp.where(angle < 0.0, angle + CIRCLE, angle)
        apart = xp.sqrt((p - s) ** 2 + (q - t) ** 2) / xp.where(rho > 0.0, rho, 1.0)
        short = xp.where(self.around, CIRCLE - apart, apart)
        angle = xp.where(self.leaves, xp.where(apart < CLOSE_ENDS, short, angle), 0.0)
        is_first = xp.arange(4).reshape((4,) + (1,) * (angle.ndim - 1)) == 0
        complete = self.whole & is_first
        self.angle = xp.where(complete, CIRCLE, angle)
        self.heading = xp.where(complete, rho, p), xp.where(complete, 0.0, q)
        u, v = self._placed(rho, xp.zeros_like(rho))
        self.begin = xp.where(complete, self.centre[0] + u, self.stop[0]), xp.where(complete, self.centre[1] + v, self.stop[1])

    def _nodes(self, degree: int) -> tuple[Point, Point, Any]:
        """Returns places on all arcs, derivatives by the angle, and weights; the nodes are the second axis."""
        xp = self.xp
        (nodes, weights), count = gauss_legendre(MANY), parts_of_a_circle(degree)
        begin_u, begin_v, p, q, angle = (part[:, None] for part in (*self.begin, *self.heading, self.angle))
        turns = xp.asarray([(2 * part + 1 + x) / (2 * count) for part in range(count) for x in nodes])
        weigh = xp.asarray([w / (2 * count) for _ in range(count) for w in weights])
        shape = (1, len(turns)) + (1,) * (angle.ndim - 2)
        turned, weigh = 0.5 * angle * turns.reshape(shape), angle * weigh.reshape(shape)
        sine, cosine = xp.sin(turned), xp.cos(turned)
        rise, run = -2.0 * sine * sine, 2.0 * sine * cosine  # cos α - 1 and sin α of the angle α from the begin
        u, v = self._placed(rise * p - run * q, rise * q + run * p)
        du, dv = self._placed(-run * p - (1.0 + rise) * q, -run * q + (1.0 + rise) * p)
        return (begin_u + u, begin_v + v), (du, dv), weigh

    def _along(self, wanted: Sequence[Powers]) -> dict[Powers, Any]:
        """Returns ½/det A·∮ uʲvᵏ dφ."""
        a, b, c, d = self.matrix
        scale = self.sign * (0.5 / (a * d - b * c))
        if wanted == [(0, 0)]:
            return {(0, 0): scale * self.xp.sum(self.angle, axis=0)}
        (u, v), _, weights = self._nodes(max(j + k for j, k in wanted))
        found = _moments(weights, u + self.origin[0], v + self.origin[1], wanted)
        return {powers: scale * self.xp.sum(values, axis=(0, 1)) for powers, values in found.items()}

    def _within(self, wanted: Sequence[Powers]) -> dict[Powers, Any]:
        """Returns ∫∫ uʲvᵏ, from its like about a point inside."""
        xp, degree = self.xp, max(j + k for j, k in wanted)
        count = xp.maximum(2.0 * xp.sum(self.chord, axis=0), 1.0)
        at: list[Any] = []
        for first, last, centre in zip(self.start, self.stop, self.centre, strict=True):
            at.append(xp.where(self.whole, centre, xp.sum(xp.where(self.chord, first + last, 0.0), axis=0) / count))
        lower = sorted({(a, b) for j, k in wanted for a in range(j + 1) for b in range(k + 1)})
        (u, v), (du, dv), weights = self._nodes(degree + 2)
        u, v = u - at[0], v - at[1]
        about = {p: xp.sum(values, axis=(0, 1)) for p, values in _moments(weights * (u * dv - v * du), u, v, lower).items()}
        (p, q), (s, t) = ((x - at[0], y - at[1]) for x, y in (self.start, self.stop))
        across = xp.where(self.chord, p * t - q * s, 0.0)
        for x, w in zip(*gauss_legendre(degree // 2 + 1), strict=True):
            u, v = 0.5 * ((1.0 - x) * p + (1.0 + x) * s), 0.5 * ((1.0 - x) * q + (1.0 + x) * t)
            for powers, values in _moments(0.5 * w * across, u, v, lower).items():
                about[powers] = about[powers] + xp.sum(values, axis=0)
        u, v = at[0] + self.origin[0], at[1] + self.origin[1]
        found: dict[Powers, Any] = {}
        for j, k in wanted:
            ways = ((comb(j, i) * comb(k, m) / (i + m + 2), i, m) for i in range(j + 1) for m in range(k + 1))
            total = sum(c * u ** (j - i) * v ** (k - m) * about[i, m] for c, i, m in ways)
            found[j, k] = xp.where(self.some, self.sign * total, 0.0)
        return found


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


def oriented(xp: Any, matrix: Sequence[Any]) -> tuple[Any, ...]:
    """Returns a matrix A with a determinant that is not negative, and the same |Aw|."""
    a, b, c, d = matrix
    turn = xp.where(a * d - b * c < 0.0, -1.0, 1.0)
    return a, b, turn * c, turn * d


def certain(xp: Any, matrix: Sequence[Any], given: Sequence[Any]) -> tuple[Any, Any]:
    """Returns whether the ellipse of a place has all of the box inside, and whether its disk is beside the box, beyond one side of it."""
    a, b, c, d = matrix
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


def whole_boxes(xp: Any, given: Sequence[Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]], inside: bool) -> list[Any]:
    """Returns the results on boxes that are all inside the ellipse, or all outside."""
    width, height = given[3:5]
    results = []
    for (kind, powers), factors in zip(kinds, coefficients, strict=True):
        total = xp.zeros_like(width)
        if (kind == "above") == inside and kind != "border":
            for (j, k), factor in zip(powers, factors, strict=True):
                total = total + factor * (width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1)))
        results.append(total)
    return results


def on_crossed_boxes(
    xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]]
) -> list[Any]:
    """Returns the results on boxes that the ellipse may cross; `matrix` is `oriented`."""
    u, v, radius, width, height, least = given
    inside, border = ([k for k in kinds if (k[0] == "border") == wanted] for wanted in (False, True))
    if xp is np and not np.any(radius < least):
        moments = borders = EllipseMoments(xp, matrix, given[:5], kinds)
    else:
        moments = EllipseMoments(xp, matrix, given[:5], inside)
        borders = EllipseMoments(xp, matrix, (u, v, xp.maximum(radius, least), width, height), border)
    known = xp.isfinite(sum(abs(v) for v in given)) & (matrix[0] * matrix[3] - matrix[1] * matrix[2] > 0.0)
    results = []
    for (kind, powers), factors in zip(kinds, coefficients, strict=True):
        total: Any = 0.0
        for (j, k), factor in zip(powers, factors, strict=True):
            if kind == "border":
                moment = borders.border[j, k]
            elif kind == "above":
                moment = moments.inside[j, k]
            else:
                moment = width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1)) - moments.inside[j, k]
            total = total + factor * moment
        results.append(xp.where(known, total, xp.nan))
    return results


def totals(xp: Any, matrix: Sequence[Any], given: Sequence[Any], kinds: Sequence[Kind], coefficients: Sequence[Sequence[Any]]) -> list[Any]:
    """Returns the results of an `Ellipse` on any boxes; `coefficients` has those of each result."""
    matrix = oriented(xp, matrix)
    holds, beside = certain(xp, matrix, given)
    apart = (whole_boxes(xp, given, kinds, coefficients, inside) for inside in (True, False))
    crossed = on_crossed_boxes(xp, matrix, given, kinds, coefficients)
    return [xp.where(holds, h, xp.where(beside, b, total)) for h, b, total in zip(*apart, crossed, strict=True)]
