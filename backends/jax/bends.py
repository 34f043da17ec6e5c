"""Substitutions on one piece of an integral, for JAX: where on it the coordinate u in (0, 1) is, and how fast it goes.

The rules which bend counts, and the formulas, are those of `teg.program`. Everything is computed and selected, no more kinds than the
program's bends can ask for.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from teg.backends.shared.substitutions import COSH, CUBIC, END, EXP, LINE, POWER, SINE, SINH, SQUARE, TAIL, functions
from teg.program import FAR, NEAR, POLE

Scalar = Any


class Substitution(NamedTuple):
    """v = centre + radius·φ(start + step·u), φ by kind."""

    p: Scalar
    q: Scalar
    kind: Scalar
    centre: Scalar
    radius: Scalar
    start: Scalar
    step: Scalar


_PLACES = functions(jnp)


def ways(kinds: Sequence[str], cubic: bool, infinite: bool) -> tuple[int, ...]:
    """The kinds of substitution that bends of these kinds can ask for."""
    found = {LINE} | ({CUBIC} if cubic or len(kinds) > 1 else set()) | ({TAIL} if infinite else set())
    for kind in kinds:
        found |= {EXP, SINH} if kind == "pole" else {SQUARE, SINE, COSH, SINH} | ({POWER} if kind == "end" else set())
    return tuple(sorted(found))


def place(s: Substitution, possible: Sequence[int], u: Scalar) -> tuple[Scalar, Scalar]:
    """The places and dv/du of u."""
    t = s.start + s.step * u
    phi, rate = _PLACES[possible[0]](t)
    for kind in possible[1:]:
        other, slope = _PLACES[kind](t)
        phi, rate = jnp.where(s.kind == kind, other, phi), jnp.where(s.kind == kind, slope, rate)
    at = s.centre + s.radius * phi
    at = jnp.where(at > s.p, at, _next(s.p, s.q))
    return jnp.where(at < s.q, at, _next(s.q, s.p)), s.radius * s.step * rate


def _next(p: Scalar, q: Scalar) -> Scalar:
    """The next number to p towards q; next to 0 a normal one, as arithmetic on CPUs takes subnormal numbers for 0."""
    after, least = jnp.nextafter(p, q), sys.float_info.min
    return jnp.where(jnp.abs(after) < least, jnp.sign(q - p) * least, after)


def inside(p: Scalar, q: Scalar, part: float, infinite: bool, scale: Scalar) -> Scalar:
    """The place of `part` on a piece, on a straight line or a tail."""
    straight = p + part * (q - p)
    if not infinite:
        return straight
    right = jnp.where(jnp.isposinf(q), p + scale * (part / (1.0 - part)), straight)
    return jnp.where(jnp.isneginf(p), q - scale * ((1.0 - part) / part), right)


def substitution(
    p: Scalar,
    q: Scalar,
    base: Scalar,
    bends: Sequence[tuple[str, Scalar, Scalar, Scalar, Scalar]],
    cubic: bool,
    infinite: bool,
    scale: Scalar,
) -> Substitution:
    """The substitution of a piece; a bend is (kind, c₀, c₁, c₂, when)."""
    one, nothing = jnp.float64(1.0), jnp.float64(0.0)
    best = Substitution(p, q, jnp.int32(CUBIC if cubic else LINE), jnp.asarray(p, jnp.float64), q - p, nothing, one)
    nearest = jnp.float64(NEAR)
    at_p_before = at_q_before = both = jnp.bool_(False)
    for kind, c0, c1, c2, when in bends:
        found, near, at_p, at_q = _bend(kind, p, q, base, jnp.float64(c0), jnp.float64(c1), jnp.float64(c2), when)
        better = near < nearest
        best = Substitution(*(jnp.where(better, new, old) for new, old in zip(found, best, strict=True)))
        nearest = jnp.where(better, near, nearest)
        if kind != "pole":
            both = both | (at_p & at_q_before) | (at_q & at_p_before)
            at_p_before, at_q_before = at_p_before | at_p, at_q_before | at_q
    if len(bends) > 1:
        flat = Substitution(p, q, jnp.int32(CUBIC), p, q - p, nothing, one)
        best = Substitution(*(jnp.where(both, new, old) for new, old in zip(flat, best, strict=True)))
    if infinite:
        left, tail = jnp.isneginf(p), ~jnp.isfinite(q - p)
        sign = jnp.where(left, -1.0, 1.0)
        end = Substitution(p, q, jnp.int32(TAIL), jnp.where(left, q, p), sign * scale, jnp.where(left, 1.0, 0.0), sign)
        best = Substitution(*(jnp.where(tail, new, old) for new, old in zip(end, best, strict=True)))
    return best


def _size(y: Scalar, p: Scalar, q: Scalar) -> Scalar:
    """The sum of the distances of y from the foci of the ellipses around (p, q), scaled to (-1, 1)."""
    return (jnp.abs(y - p) + jnp.abs(y - q)) * (2.0 / (q - p))


def _bend(
    kind: str, left: Scalar, right: Scalar, base: Scalar, c0: Scalar, c1: Scalar, c2: Scalar, when: Scalar
) -> tuple[Substitution, Scalar, Scalar, Scalar]:
    """The substitution of one bend, its nearness (infinite if it does not count), and whether it alone is at the left or the right end."""
    p, q = left - base, right - base
    length, width, centre = q - p, jnp.maximum(jnp.abs(p), jnp.abs(q)), 0.5 * (p + q)
    linear = jnp.abs(c2) * width * width <= 1e-13 * (jnp.abs(c1) * width + jnp.abs(c0))
    active = when & jnp.isfinite(c0) & jnp.isfinite(c1) & jnp.isfinite(c2) & jnp.isfinite(length)
    active &= ~(linear & (jnp.abs(c1) * width <= 1e-13 * jnp.abs(c0)))
    square, end = c1 * c1 - 4.0 * c0 * c2, END * length
    paired = ~linear & (square < 0.0)
    larger = -0.5 * (c1 + jnp.copysign(jnp.sqrt(jnp.abs(square)), c1))
    one, other = jnp.where(linear, -c0 / c1, c0 / larger), jnp.where(linear, -c0 / c1, larger / c2)
    to_one, to_other = (_size(y, p, q) for y in (one, other))
    linear = ~paired & (linear | (jnp.maximum(to_one, to_other) > FAR) | ~jnp.isfinite(to_one + to_other))
    one = jnp.where(linear & ~(to_one <= to_other), other, one)
    other = jnp.where(linear, one, other)
    below, above = jnp.minimum(one, other), jnp.maximum(one, other)
    m = jnp.where(paired, -0.5 * c1 / c2, 0.5 * (below + above))
    h = jnp.where(paired, jnp.sqrt(jnp.abs(square)) * jnp.abs(0.5 / c2), 0.5 * (above - below))
    active &= linear | (h >= jnp.where(paired, 1e-100, 1e-12) * length)
    to_below, to_above = _size(below, p, q), _size(above, p, q)
    near = jnp.where(paired, (jnp.hypot(m - p, h) + jnp.hypot(m - q, h)) * (2.0 / length), jnp.minimum(to_below, to_above))
    at_p = ~paired & ((jnp.abs(below - p) <= end) | (jnp.abs(above - p) <= end))
    at_q = ~paired & ((jnp.abs(below - q) <= end) | (jnp.abs(above - q) <= end))
    if kind == "pole":
        y = jnp.where(to_below <= to_above, below, above)
        margin = POLE * jnp.maximum(jnp.abs(left), jnp.abs(right))
        active &= paired | (y < p - margin) | (y > q + margin)
        m = jnp.where(paired, m, y)
        way = jnp.where(paired, SINH, EXP)
    else:  # the substitution would leave out what is beyond a zero
        active &= paired | ~(_within(below, p, q, end) | _within(above, p, q, end))
        curved = jnp.where(jnp.abs(centre - m) <= h, SINE, COSH)
        way = jnp.where(paired, SINH, jnp.where(linear, SQUARE, curved))
        if kind == "end":
            way = jnp.where(~paired & (at_p ^ at_q), POWER, way)
        left_move = jnp.where(at_p, jnp.minimum(0.0, p - jnp.where(jnp.abs(above - p) <= end, above, below)), 0.0)
        right_move = jnp.where(at_q, jnp.maximum(0.0, q - jnp.where(jnp.abs(below - q) <= end, below, above)), 0.0)
        m = m + jnp.where(way == SINE, 0.5, 1.0) * (left_move + right_move)  # zeros at ends do not stay inside
        h = h + jnp.where(way == SINE, 0.5, 0.0) * (right_move - left_move)
    sign = jnp.where((way == SINH) | (way == SINE) | (m <= centre), 1.0, -1.0)
    sign = jnp.where(way == POWER, jnp.where(at_p, 1.0, -1.0), sign)

    def at(v: Scalar, power: Scalar) -> Scalar:
        t = sign * (v - m)
        found = jnp.where(way == SQUARE, jnp.sqrt(jnp.maximum(0.0, t)), jnp.where(way == EXP, jnp.log(t), power))
        s = t / h
        found = jnp.where(way == SINH, jnp.arcsinh(s), jnp.where(way == SINE, jnp.arcsin(jnp.clip(s, -1.0, 1.0)), found))
        return jnp.where(way == COSH, jnp.arccosh(jnp.maximum(1.0, s)), found)

    start = at(p, jnp.where(at_p, 0.0, 1.0))
    step = at(q, jnp.where(at_p, 1.0, 0.0)) - start
    size = jnp.where((way == EXP) | (way == SQUARE), 1.0, jnp.where(way == POWER, length, h))
    middle = base + jnp.where(way == POWER, jnp.where(at_p, p, q), m)
    alone = active & (at_p ^ at_q)
    found = Substitution(left, right, way.astype(jnp.int32), middle, sign * size, start, step)
    return found, jnp.where(active, near, jnp.inf), alone & at_p, alone & at_q


def _within(y: Scalar, p: Scalar, q: Scalar, end: Scalar) -> Scalar:
    """Whether a zero is inside a piece, and not at an end of it."""
    return (y > p + end) & (y < q - end)
