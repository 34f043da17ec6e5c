"""Substitutions on the pieces of an integral, for NumPy: where on a piece the coordinate u in (0, 1) is, and how fast it goes.

The rules which bend counts, and the formulas, are those of `teg.program`. A substitution has a kind, a centre, a radius and the range of
its own coordinate t; pieces of one kind are placed together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.shared.substitutions import COSH, CUBIC, END, EXP, LINE, POWER, SINE, SINH, SQUARE, TAIL, functions
from teg.program import FAR, NEAR, POLE

Array = npt.NDArray[Any]


@dataclass(slots=True)
class Substitution:
    """One a piece, (pieces,): v = centre + radius·φ(t) with t = start + step·u, φ by `kind`."""

    p: Array
    q: Array
    kind: Array
    centre: Array
    radius: Array
    start: Array
    step: Array

    def part(self, index: Array) -> Substitution:
        """That of some of the pieces."""
        fields = (self.p, self.q, self.kind, self.centre, self.radius, self.start, self.step)
        return Substitution(*(field[index] for field in fields))

    def __call__(self, u: Array) -> tuple[Array, Array]:
        """The places and dv/du of u, (nodes, pieces)."""
        place, rate = np.empty(u.shape), np.empty(u.shape)
        for kind in np.unique(self.kind):
            chosen = np.flatnonzero(self.kind == kind)
            t = self.start[chosen] + self.step[chosen] * u[:, chosen]
            phi, slope = _PLACES[kind](t)
            place[:, chosen] = self.centre[chosen] + self.radius[chosen] * phi
            rate[:, chosen] = self.radius[chosen] * self.step[chosen] * slope
        place = np.where(place > self.p, place, np.nextafter(self.p, self.q))
        return np.where(place < self.q, place, np.nextafter(self.q, self.p)), rate


_PLACES = functions(np)


def inside(p: Array, q: Array, part: float, scale: Any) -> Array:
    """The place of `part` on each piece, on a straight line or a tail."""
    with np.errstate(invalid="ignore"):
        straight = p + part * (q - p)
        right = np.where(np.isposinf(q), p + scale * (part / (1.0 - part)), straight)
        return np.where(np.isneginf(p), q - scale * ((1.0 - part) / part), right)


def substitution(
    p: Array,
    q: Array,
    base: Any,
    bends: Sequence[tuple[str, Any, Any, Any, Any]],
    cubic: bool,
    scale: Any,
) -> Substitution:
    """The substitution of each piece; a bend is (kind, c₀, c₁, c₂, when), each value () or (pieces,)."""
    length = q - p
    result = Substitution(p, q, np.full(p.size, CUBIC if cubic else LINE), p.copy(), length, np.zeros(p.size), np.ones(p.size))
    if bends:
        _bent(result, np.broadcast_to(base, p.shape), bends)
    tails = np.flatnonzero(~np.isfinite(length))
    if tails.size:
        left = np.isneginf(p[tails])
        result.kind[tails] = TAIL
        result.centre[tails] = np.where(left, q[tails], p[tails])
        result.radius[tails] = np.where(left, -1.0, 1.0) * np.broadcast_to(scale, p.shape)[tails]
        result.start[tails], result.step[tails] = np.where(left, 1.0, 0.0), np.where(left, -1.0, 1.0)
    return result


def _bent(result: Substitution, base: Array, bends: Sequence[tuple[str, Any, Any, Any, Any]]) -> None:
    """Replace the substitution where a bend is near."""
    p, q = result.p - base, result.q - base
    length = q - p
    nearest = np.full(p.size, NEAR)
    sharp = np.full((2, p.size), -1)  # which bend has a zero at the end p, at q
    both = np.zeros(p.size, dtype=np.bool_)
    for number, (kind, *given) in enumerate(bends):
        c0, c1, c2, when = (np.broadcast_to(g, p.shape) for g in given)
        width = np.maximum(np.abs(p), np.abs(q))
        linear = np.abs(c2) * width * width <= 1e-13 * (np.abs(c1) * width + np.abs(c0))
        active = when.astype(np.bool_) & np.isfinite(c0) & np.isfinite(c1) & np.isfinite(c2) & np.isfinite(length)
        active &= ~(linear & (np.abs(c1) * width <= 1e-13 * np.abs(c0)))
        if not active.any():
            continue
        square = c1 * c1 - 4.0 * c0 * c2
        complex_ = ~linear & (square < 0.0)
        larger = -0.5 * (c1 + np.copysign(np.sqrt(np.abs(square)), c1))
        one, other = np.where(linear, -c0 / c1, c0 / larger), np.where(linear, -c0 / c1, larger / c2)
        s_one, s_other = ((np.abs(y - p) + np.abs(y - q)) * (2.0 / length) for y in (one, other))
        alone = ~complex_ & (linear | (np.maximum(s_one, s_other) > FAR) | ~np.isfinite(s_one + s_other))
        one = np.where(alone & ~(s_one <= s_other), other, one)
        other = np.where(alone, one, other)
        below, above = np.minimum(one, other), np.maximum(one, other)
        middle = np.where(complex_, -0.5 * c1 / c2, 0.5 * (below + above))
        half = np.where(complex_, np.sqrt(np.abs(square)) * np.abs(0.5 / c2), 0.5 * (above - below))
        active &= alone | (half >= np.where(complex_, 1e-100, 1e-12) * length)
        linear = alone
        s_below, s_above = ((np.abs(y - p) + np.abs(y - q)) * (2.0 / length) for y in (below, above))
        s = np.where(
            complex_,
            (np.hypot(middle - p, half) + np.hypot(middle - q, half)) * (2.0 / length),
            np.minimum(s_below, s_above),
        )
        at_p = ~complex_ & ((np.abs(below - p) <= END * length) | (np.abs(above - p) <= END * length))
        at_q = ~complex_ & ((np.abs(below - q) <= END * length) | (np.abs(above - q) <= END * length))
        if kind == "pole":
            near = np.where(s_below <= s_above, below, above)
            margin = POLE * np.maximum(np.abs(result.p), np.abs(result.q))
            active &= complex_ | (near < p - margin) | (near > q + margin)
        else:  # the substitution would leave out what is beyond a zero
            active &= complex_ | ~(_within(below, p, q, length) | _within(above, p, q, length))
            once = active & (at_p ^ at_q)
            both |= once & np.where(at_p, sharp[1] >= 0, sharp[0] >= 0)
            sharp[0][once & at_p], sharp[1][once & at_q] = number, number
        chosen = np.flatnonzero(active & (s < nearest))
        nearest[chosen] = s[chosen]
        _place(result, chosen, kind, p, q, middle, half, linear, complex_, at_p, at_q)
    i = np.flatnonzero(both)
    result.kind[i], result.centre[i], result.radius[i] = CUBIC, p[i], length[i]
    result.start[i], result.step[i] = 0.0, 1.0
    result.centre += np.where(nearest < NEAR, base, np.where(both, base, 0.0))


def _within(y: Array, p: Array, q: Array, length: Array) -> Array:
    """Whether a zero is inside a piece, and not at an end of it."""
    return (y > p + END * length) & (y < q - END * length)


def _place(
    result: Substitution,
    chosen: Array,
    kind: str,
    p: Array,
    q: Array,
    middle: Array,
    half: Array,
    linear: Array,
    complex_: Array,
    at_p: Array,
    at_q: Array,
) -> None:
    """The substitution of the chosen pieces by a bend; places relative to its base."""
    if not chosen.size:
        return
    a, b, m, h, straight, paired, near_p, near_q = (v[chosen] for v in (p, q, middle, half, linear, complex_, at_p, at_q))
    centre = 0.5 * (a + b)
    if kind == "pole":
        below, above = m - h, m + h
        nearer = np.where(np.abs(below - a) + np.abs(below - b) <= np.abs(above - a) + np.abs(above - b), below, above)
        m = np.where(paired, m, nearer)
        way = np.where(paired, SINH, EXP)
    else:
        power = ~paired & (near_p ^ near_q) if kind == "end" else np.zeros_like(straight)
        way = np.select([paired, power, straight, np.abs(centre - m) <= h], [SINH, POWER, SQUARE, SINE], COSH)
        below, above, reach = m - h, m + h, END * (b - a)
        left = np.where(near_p, np.minimum(0.0, a - np.where(np.abs(above - a) <= reach, above, below)), 0.0)
        right = np.where(near_q, np.maximum(0.0, b - np.where(np.abs(below - b) <= reach, below, above)), 0.0)
        m = m + np.where(way == SINE, 0.5, 1.0) * (left + right)  # zeros at ends do not stay inside
        h = h + np.where(way == SINE, 0.5, 0.0) * (right - left)
    sign = np.where((way == SINH) | (way == SINE) | (m <= centre), 1.0, -1.0)
    sign = np.where(way == POWER, np.where(near_p, 1.0, -1.0), sign)
    left, right = sign * (a - m), sign * (b - m)
    scaled_left, scaled_right = left / h, right / h
    starts_and_ends = {
        SINH: (np.arcsinh(scaled_left), np.arcsinh(scaled_right)),
        EXP: (np.log(left), np.log(right)),
        POWER: (np.where(near_p, 0.0, 1.0), np.where(near_p, 1.0, 0.0)),
        SQUARE: (np.sqrt(np.maximum(0.0, left)), np.sqrt(np.maximum(0.0, right))),
        SINE: (np.arcsin(np.clip(scaled_left, -1.0, 1.0)), np.arcsin(np.clip(scaled_right, -1.0, 1.0))),
        COSH: (np.arccosh(np.maximum(1.0, scaled_left)), np.arccosh(np.maximum(1.0, scaled_right))),
    }
    ways = list(starts_and_ends)
    start, end = (np.select([way == w for w in ways], [starts_and_ends[w][i] for w in ways]) for i in (0, 1))
    size = np.where((way == EXP) | (way == SQUARE), 1.0, np.where(way == POWER, b - a, h))
    result.kind[chosen] = way
    result.centre[chosen] = np.where(way == POWER, np.where(near_p, a, b), m)
    result.radius[chosen] = sign * size
    result.start[chosen], result.step[chosen] = start, end - start
