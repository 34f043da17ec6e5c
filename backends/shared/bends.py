"""Substitutions on the pieces of an integral, for NumPy and JAX: where on a piece the coordinate u in (0, 1) is, and how fast it goes.

The rules which bend counts, and the formulas, are those of `teg.program`. All arrays have one entry a piece, shape () or (pieces,).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

from teg.backends.shared.arrays import Arrays, Values
from teg.program import FAR, NEAR, POLE

LINE, CUBIC, SQUARE, SINE, COSH, SINH, EXP, POWER, TAIL = range(9)
END = 1e-9
"""A zero within this part of a piece's length of its end is at its end."""
Bend = tuple[str, Any, Any, Any, Any]
"""Kind, c₀, c₁, c₂, and where the bend counts."""


class Substitution(NamedTuple):
    """v = centre + radius·φ(start + step·u) on the pieces (p, q), φ by `kind`."""

    p: Any
    q: Any
    kind: Any
    centre: Any
    radius: Any
    start: Any
    step: Any

    def part(self, index: Any) -> Substitution:
        """Returns the substitution of some of the pieces."""
        return Substitution(*(field[index] for field in self))


def functions(xp: Any) -> dict[int, Callable[[Any], tuple[Any, Any]]]:
    """Returns φ and its derivative, by kind."""
    return {
        LINE: lambda t: (t, xp.ones_like(t)),
        CUBIC: lambda t: (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)),
        SQUARE: lambda t: (t * t, 2.0 * t),
        SINE: lambda t: (xp.sin(t), xp.cos(t)),
        COSH: lambda t: (xp.cosh(t), xp.sinh(t)),
        SINH: lambda t: (xp.sinh(t), xp.cosh(t)),
        EXP: lambda t: (xp.exp(t), xp.exp(t)),
        POWER: lambda t: (t * t * t * t * t * t, 6.0 * (t * t * t * t * t)),
        TAIL: lambda t: (t / (1.0 - t), 1.0 / ((1.0 - t) * (1.0 - t))),
    }


def possible_kinds(bends: Sequence[str], cubic: bool, infinite: bool) -> tuple[int, ...]:
    """Returns the kinds of substitution that bends of these kinds can ask for."""
    kinds = {LINE} | ({CUBIC} if cubic or len(bends) > 1 else set()) | ({TAIL} if infinite else set())
    for bend in bends:
        kinds |= {EXP, SINH} if bend == "pole" else {SQUARE, SINE, COSH, SINH} | ({POWER} if bend == "end" else set())
    return tuple(sorted(kinds))


def place(arrays: Arrays, s: Substitution, kinds: Iterable[int], u: Any) -> tuple[Any, Any]:
    """Returns the places and dv/du of u, (…) or (nodes, pieces); `kinds` are all that occur in `s`."""
    xp, phis = arrays.xp, functions(arrays.xp)
    t = s.start + s.step * u
    first, *others = kinds
    values: Values = phis[first](t)
    for kind in others:
        values = arrays.choose(s.kind == kind, phis[kind], (t,), values)
    phi, slope = values
    at = s.centre + s.radius * phi
    at = xp.where(at > s.p, at, _beside(xp, s.p, s.q))
    return xp.where(at < s.q, at, _beside(xp, s.q, s.p)), s.radius * s.step * slope


def _beside(xp: Any, p: Any, q: Any) -> Any:
    """Returns the next normal number to p towards q. Subnormal numbers are left out, because XLA takes them for 0."""
    after, least = xp.nextafter(p, q), sys.float_info.min
    return xp.where(xp.abs(after) < least, xp.sign(q - p) * least, after)


def inside(xp: Any, p: Any, q: Any, part: float, infinite: bool, scale: Any) -> Any:
    """Returns the place of `part` on each piece, on a straight line or a tail."""
    straight = p + part * (q - p)
    if not infinite:
        return straight
    right = xp.where(xp.isposinf(q), p + scale * (part / (1.0 - part)), straight)
    return xp.where(xp.isneginf(p), q - scale * ((1.0 - part) / part), right)


def substitution(arrays: Arrays, p: Any, q: Any, base: Any, bends: Sequence[Bend], cubic: bool, infinite: bool, scale: Any) -> Substitution:
    """Returns the substitution of each piece; `infinite`: pieces may be tails, of that `scale`."""
    xp = arrays.xp
    kind = xp.full_like(p, CUBIC if cubic else LINE, dtype=xp.int32)
    result = Substitution(p, q, kind, p, q - p, xp.zeros_like(p), xp.ones_like(p))
    if bends:
        result = _bent(arrays, result, base, bends)
    if infinite:
        left, tail = xp.isneginf(p), ~xp.isfinite(q - p)
        sign, zero = xp.where(left, -1.0, 1.0), xp.where(left, 1.0, 0.0)
        end = Substitution(p, q, TAIL, xp.where(left, q, p), sign * scale, zero, sign)
        result = Substitution(*(xp.where(tail, new, old) for new, old in zip(end, result, strict=True)))
    return result


class _Zeros(NamedTuple):
    """The zeros m ± h, or m ± ih if they are `paired`, of a bend that counts where it is `near`, measured by an ellipse, and not infinitely
    far; whether there is one zero `alone`; whether one is at the end p, at q. Places are relative to the base."""

    near: Any
    m: Any
    h: Any
    alone: Any
    paired: Any
    at_p: Any
    at_q: Any


def _bent(arrays: Arrays, straight: Substitution, base: Any, bends: Sequence[Bend]) -> Substitution:
    """Returns the substitution by the nearest bend; flat ends where two bends are at the two ends."""
    xp, result = arrays.xp, straight
    p, q = straight.p - base, straight.q - base
    margin = POLE * xp.maximum(xp.abs(straight.p), xp.abs(straight.q))
    nearest = xp.full_like(p, NEAR)
    at_p = at_q = both = xp.zeros_like(p, dtype=bool)
    for kind, c0, c1, c2, when in bends:
        c0, c1, c2 = (xp.asarray(c, dtype=xp.float64) for c in (c0, c1, c2))
        zeros = _zeros(xp, kind, p, q, margin, c0, c1, c2, when)
        if kind != "pole":
            once = (zeros.near < xp.inf) & (zeros.at_p ^ zeros.at_q)
            both = both | (once & xp.where(zeros.at_p, at_q, at_p))
            at_p, at_q = at_p | (once & zeros.at_p), at_q | (once & zeros.at_q)
        better = zeros.near < nearest
        nearest = xp.where(better, zeros.near, nearest)
        bent = arrays.choose(better, partial(_around, xp, kind), (p, q, base, *zeros[1:]), result[2:])
        result = Substitution(straight.p, straight.q, *bent)
    if len(bends) > 1:
        flat = CUBIC, p + base, q - p, 0.0, 1.0
        result = Substitution(straight.p, straight.q, *(xp.where(both, new, old) for new, old in zip(flat, result[2:], strict=True)))
    return result


def _distance(xp: Any, y: Any, p: Any, q: Any) -> Any:
    """Returns the sum of the distances of y from the foci of the ellipses around (p, q), scaled to (-1, 1)."""
    return (xp.abs(y - p) + xp.abs(y - q)) * (2.0 / (q - p))


def _zeros(xp: Any, kind: str, p: Any, q: Any, margin: Any, c0: Any, c1: Any, c2: Any, when: Any) -> _Zeros:
    """Returns the zeros of a bend; a pole counts if it is farther than `margin` from the piece."""
    length, width = q - p, xp.maximum(xp.abs(p), xp.abs(q))
    linear = xp.abs(c2) * width * width <= 1e-13 * (xp.abs(c1) * width + xp.abs(c0))
    active = when & xp.isfinite(c0) & xp.isfinite(c1) & xp.isfinite(c2) & xp.isfinite(length)
    active = active & ~(linear & (xp.abs(c1) * width <= 1e-13 * xp.abs(c0)))
    square, end = c1 * c1 - 4.0 * c0 * c2, END * length
    paired = ~linear & (square < 0.0)
    larger = -0.5 * (c1 + xp.copysign(xp.sqrt(xp.abs(square)), c1))
    one, other = xp.where(linear, -c0 / c1, c0 / larger), xp.where(linear, -c0 / c1, larger / c2)
    to_one, to_other = _distance(xp, one, p, q), _distance(xp, other, p, q)
    alone = ~paired & (linear | (xp.maximum(to_one, to_other) > FAR) | ~xp.isfinite(to_one + to_other))
    one = xp.where(alone & ~(to_one <= to_other), other, one)
    other = xp.where(alone, one, other)
    below, above = xp.minimum(one, other), xp.maximum(one, other)
    m = xp.where(paired, -0.5 * c1 / c2, 0.5 * (below + above))
    h = xp.where(paired, xp.sqrt(xp.abs(square)) * xp.abs(0.5 / c2), 0.5 * (above - below))
    active = active & (alone | (h >= xp.where(paired, 1e-100, 1e-12) * length))
    to_below, to_above = _distance(xp, below, p, q), _distance(xp, above, p, q)
    to_pair = (xp.hypot(m - p, h) + xp.hypot(m - q, h)) * (2.0 / length)
    near = xp.where(paired, to_pair, xp.minimum(to_below, to_above))
    at_p, at_q = (~paired & ((xp.abs(below - v) <= end) | (xp.abs(above - v) <= end)) for v in (p, q))
    if kind == "pole":
        nearer = xp.where(to_below <= to_above, below, above)
        active = active & (paired | (nearer < p - margin) | (nearer > q + margin))
    else:  # the substitution would leave out what is beyond a zero
        within = [(y > p + end) & (y < q - end) for y in (below, above)]
        active = active & (paired | ~(within[0] | within[1]))
    return _Zeros(xp.where(active, near, xp.inf), m, h, alone, paired, at_p, at_q)


def _around(
    xp: Any, bend: str, p: Any, q: Any, base: Any, m: Any, h: Any, alone: Any, paired: Any, at_p: Any, at_q: Any
) -> tuple[Any, Any, Any, Any, Any]:
    """Returns kind, centre, radius, start and step of the substitution around zeros."""
    centre, below, above = 0.5 * (p + q), m - h, m + h
    if bend == "pole":
        nearer = xp.where(xp.abs(below - p) + xp.abs(below - q) <= xp.abs(above - p) + xp.abs(above - q), below, above)
        m = xp.where(paired, m, nearer)
        kind = xp.where(paired, SINH, EXP)
    else:
        curved = xp.where(xp.abs(centre - m) <= h, SINE, COSH)
        kind = xp.where(paired, SINH, xp.where(alone, SQUARE, curved))
        if bend == "end":
            kind = xp.where(~paired & (at_p ^ at_q), POWER, kind)
        end = END * (q - p)
        left = xp.where(at_p, xp.minimum(0.0, p - xp.where(xp.abs(above - p) <= end, above, below)), 0.0)
        right = xp.where(at_q, xp.maximum(0.0, q - xp.where(xp.abs(below - q) <= end, below, above)), 0.0)
        m = m + xp.where(kind == SINE, 0.5, 1.0) * (left + right)  # zeros at ends do not stay inside
        h = h + xp.where(kind == SINE, 0.5, 0.0) * (right - left)
    sign = xp.where((kind == SINH) | (kind == SINE) | (m <= centre), 1.0, -1.0)
    sign = xp.where(kind == POWER, xp.where(at_p, 1.0, -1.0), sign)

    def inverse(v: Any, at_power: Any) -> Any:
        t = sign * (v - m)
        s = t / h
        result = xp.where(kind == SQUARE, xp.sqrt(xp.maximum(0.0, t)), xp.where(kind == EXP, xp.log(t), at_power))
        result = xp.where(kind == SINH, xp.arcsinh(s), xp.where(kind == SINE, xp.arcsin(xp.clip(s, -1.0, 1.0)), result))
        return xp.where(kind == COSH, xp.arccosh(xp.maximum(1.0, s)), result)

    start = inverse(p, xp.where(at_p, 0.0, 1.0))
    step = inverse(q, xp.where(at_p, 1.0, 0.0)) - start
    size = xp.where((kind == EXP) | (kind == SQUARE), 1.0, xp.where(kind == POWER, q - p, h))
    middle = base + xp.where(kind == POWER, xp.where(at_p, p, q), m)
    return kind, middle, sign * size, start, step
