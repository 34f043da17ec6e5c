"""Substitutions on the pieces of an integral, for NumPy and JAX: where on a piece the coordinate u in (0, 1) is, and how fast it goes.

The rules which bend counts, and the formulas, are those of `teg.program`. All arrays have one entry a piece, shape () or (pieces,).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

from teg.backends.shared.arrays import Arrays, Values
from teg.program import AT_END, AT_REACH, BEYOND, FAR, NEAR, POLE

LINE, CUBIC, SQUARE, SINE, COSH, SINH, EXP, POWER, TAIL, SLOW_TAIL = range(10)
Bend = tuple[str, Any, Any, Any, Any]
"""Kind, c₀, c₁, c₂, and where the bend counts."""


class Bends(NamedTuple):
    """The bends of an integrand: `each` is c₀ + c₁·y + c₂·y² of y = v - base."""

    base: Any = 0.0
    each: Sequence[Bend] = ()


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


def functions(xp: Any) -> dict[int, Callable[[Any, Any], tuple[Any, Any]]]:
    """Returns φ and its derivative, by kind, of t and the step."""
    return {
        LINE: lambda t, _: (t, xp.ones_like(t)),
        CUBIC: lambda t, _: (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)),
        SQUARE: lambda t, _: (t * t, 2.0 * t),
        SINE: lambda t, _: (xp.sin(t), xp.cos(t)),
        COSH: lambda t, _: (xp.cosh(t), xp.sinh(t)),
        SINH: lambda t, _: (xp.sinh(t), xp.cosh(t)),
        EXP: lambda t, _: (xp.exp(t), xp.exp(t)),
        POWER: lambda t, _: (t * t * t * t * t * t, 6.0 * (t * t * t * t * t)),
        TAIL: lambda t, _: (t / (1.0 - t), 1.0 / ((1.0 - t) * (1.0 - t))),
        SLOW_TAIL: partial(_slow_tail, xp),
    }


def _slow_tail(xp: Any, t: Any, step: Any) -> tuple[Any, Any]:
    reach = xp.abs(step)
    left, last = xp.maximum(1.0 - t / reach, 2.0**-53), 1.0 / (1.0 + AT_REACH)
    exponent = xp.minimum(t / AT_REACH / left, reach)
    return xp.sinh(exponent), xp.cosh(exponent) / (AT_REACH * left * xp.where(left > last, left, BEYOND * last))


def possible_kinds(bends: Sequence[str], cubic: bool, infinite: bool, slow: bool) -> tuple[int, ...]:
    """Returns the kinds of substitution that bends of these kinds can ask for, and tails, which may be slow."""
    kinds = {LINE} | ({CUBIC} if cubic or len(bends) > 1 else set())
    kinds |= {SLOW_TAIL if slow else TAIL} if infinite else set()
    for bend in bends:
        kinds |= {EXP, SINH} if bend == "pole" else {SQUARE, SINE, COSH, SINH} | ({POWER} if bend == "end" else set())
    return tuple(sorted(kinds))


def place(arrays: Arrays, s: Substitution, kinds: Iterable[int], u: Any) -> tuple[Any, Any]:
    """Returns the places and dv/du of u, (…) or (nodes, pieces); `kinds` are all that occur in `s`."""
    xp, phis = arrays.xp, functions(arrays.xp)
    t = s.start + s.step * u
    first, *others = kinds
    values: Values = phis[first](t, s.step)
    for kind in others:
        values = arrays.choose(s.kind == kind, phis[kind], (t, s.step), values)
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


class Tail(NamedTuple):
    """The scale of tails, and their reach; None where they have none."""

    scale: Any
    reach: Any = None


def substitution(arrays: Arrays, ends: tuple[Any, Any], bends: Bends, cubic: bool, tail: Tail | None) -> Substitution:
    """Returns the substitution of each piece, p to q; `tail`: pieces may be tails."""
    xp, (p, q) = arrays.xp, ends
    kind = xp.full_like(p, CUBIC if cubic else LINE, dtype=xp.int32)
    result = Substitution(p, q, kind, p, q - p, xp.zeros_like(p), xp.ones_like(p))
    if bends.each:
        result = _bent(arrays, result, bends)
    if tail is not None:
        left, endless = xp.isneginf(p), ~xp.isfinite(q - p)
        sign, zero = xp.where(left, -1.0, 1.0), xp.where(left, 1.0, 0.0)
        whole, way = (1.0, TAIL) if tail.reach is None else (tail.reach, SLOW_TAIL)
        end = Substitution(p, q, way, xp.where(left, q, p), sign * tail.scale, zero * whole, sign * whole)
        result = Substitution(*(xp.where(endless, new, old) for new, old in zip(end, result, strict=True)))
    return result


class _Zeros(NamedTuple):
    """The zeros m ± h, or m ± ih if they are `paired`, of a bend that counts where it is `near`, measured by an ellipse, and not infinitely
    far; whether there is one zero `alone`; whether one is at the end p, at q; whether the bend is a `pole`, or an `end`: one answer
    where all bends have the same. Places are relative to the base. A bend is a row."""

    near: Any
    m: Any
    h: Any
    alone: Any
    paired: Any
    at_p: Any
    at_q: Any
    pole: Any
    end: Any


def _bent(arrays: Arrays, straight: Substitution, bends: Bends) -> Substitution:
    """Returns the substitution by the nearest bend, of equally near ones by the first; flat ends where two bends are at the two ends.

    All bends are rows of one computation: XLA would compile each of them again.
    """
    xp, base = arrays.xp, bends.base
    p, q = straight.p - base, straight.q - base
    margin = POLE * xp.maximum(xp.abs(straight.p), xp.abs(straight.q))
    nearest, both = _nearest(xp, _zeros(arrays, p, q, margin, bends.each))
    kinds = frozenset(kind for kind, *_ in bends.each)
    bent = arrays.choose(nearest.near < NEAR, partial(_around, xp, kinds), (p, q, base, *nearest[1:]), straight[2:])
    if both is not None:
        flat = CUBIC, p + base, q - p, 0.0, 1.0
        bent = tuple(xp.where(both, new, old) for new, old in zip(flat, bent, strict=True))
    return Substitution(straight.p, straight.q, *bent)


def _nearest(xp: Any, zeros: _Zeros) -> tuple[_Zeros, Any]:
    """Returns the row of the nearest bend, and whether two bends are at the two ends, piece by piece; None if there is only one bend.

    All that is asked of the bends is one table, which XLA computes once.
    """
    if zeros.near.shape[0] == 1:
        return _Zeros(*(v if isinstance(v, bool) else v[0] for v in zeros)), None
    once = (zeros.near < xp.inf) & (zeros.at_p ^ zeros.at_q) & xp.logical_not(zeros.pole)
    answers = (once & zeros.at_p, once & zeros.at_q, *zeros[3:])
    said: Any = sum(xp.where(answer, float(1 << k), 0.0) for k, answer in enumerate(answers))
    table = xp.stack([xp.where(zeros.near < NEAR, zeros.near, xp.inf), zeros.m, zeros.h, said])
    first = xp.argmin(table[0], axis=0)
    mine = xp.arange(table.shape[1]).reshape(-1, *(1,) * first.ndim) == first
    near, m, h, chosen = xp.sum(xp.where(mine, table, 0.0), axis=1)
    given = [(chosen.astype(xp.int32) >> k) & 1 == 1 for k in range(2, len(answers))]
    given = [old if isinstance(old, bool) else new for old, new in zip(zeros[3:], given, strict=True)]
    at_p, at_q = (xp.any((table[3].astype(xp.int32) >> k) & 1 == 1, axis=0) for k in (0, 1))
    return _Zeros(near, m, h, *given), at_p & at_q


def _distance(xp: Any, y: Any, p: Any, q: Any) -> Any:
    """Returns the sum of the distances of y from the foci of the ellipses around (p, q), scaled to (-1, 1)."""
    return (xp.abs(y - p) + xp.abs(y - q)) * (2.0 / (q - p))


def _zeros(arrays: Arrays, p: Any, q: Any, margin: Any, bends: Sequence[Bend]) -> _Zeros:
    """Returns the zeros of bends; a pole counts if it is farther than `margin` from the piece."""
    xp = arrays.xp
    c0, c1, c2 = (arrays.rows([xp.asarray(b[k], dtype=xp.float64) for b in bends], p) for k in (1, 2, 3))
    when = arrays.rows([xp.asarray(b[4]) for b in bends], p)
    pole, end = (_of_kind(arrays, kind, bends, p) for kind in ("pole", "end"))
    length, width = q - p, xp.maximum(xp.abs(p), xp.abs(q))
    linear = xp.abs(c2) * width * width <= 1e-13 * (xp.abs(c1) * width + xp.abs(c0))
    active = when & xp.isfinite(c0) & xp.isfinite(c1) & xp.isfinite(c2) & xp.isfinite(length)
    active = active & ~(linear & (xp.abs(c1) * width <= 1e-13 * xp.abs(c0)))
    square, nearby = c1 * c1 - 4.0 * c0 * c2, AT_END * length
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
    at_p, at_q = (~paired & ((xp.abs(below - v) <= nearby) | (xp.abs(above - v) <= nearby)) for v in (p, q))
    if pole is not True:  # the substitution would leave out what is beyond a zero
        within = [(y > p + nearby) & (y < q - nearby) for y in (below, above)]
        active = active & (paired | pole | ~(within[0] | within[1]))
    if pole is not False:
        nearer = xp.where(to_below <= to_above, below, above)
        active = active & (paired | xp.logical_not(pole) | (nearer < p - margin) | (nearer > q + margin))
    return _Zeros(xp.where(active, near, xp.inf), m, h, alone, paired, at_p, at_q, pole, end)


def _of_kind(arrays: Arrays, kind: str, bends: Sequence[Bend], like: Any) -> Any:
    """Returns whether bends are of a kind: one answer where all have the same."""
    answers = [b[0] == kind for b in bends]
    return answers[0] if len(set(answers)) == 1 else arrays.rows([arrays.xp.asarray(a) for a in answers], like)


def _around(xp: Any, kinds: frozenset[str], p: Any, q: Any, base: Any, *zeros: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Returns kind, centre, radius, start and step of the substitution around `zeros`, all of _Zeros but the first, of bends of `kinds`."""
    at = _Zeros(None, *zeros)
    centre = 0.5 * (p + q)
    if at.pole is False:
        kind, m, h = _around_end(xp, centre, p, q, at)
    elif at.pole is True:
        kind, m, h = _around_pole(xp, p, q, at)
    else:
        both = zip(_around_pole(xp, p, q, at), _around_end(xp, centre, p, q, at), strict=True)
        kind, m, h = (xp.where(at.pole, one, other) for one, other in both)
    sign = xp.where((kind == SINH) | (kind == SINE) | (m <= centre), 1.0, -1.0)
    size, middle = xp.where((kind == EXP) | (kind == SQUARE), 1.0, h), m
    if "end" in kinds:
        power = kind == POWER
        sign = xp.where(power, xp.where(at.at_p, 1.0, -1.0), sign)
        size, middle = xp.where(power, q - p, size), xp.where(power, xp.where(at.at_p, p, q), m)

    def inverse(v: Any, at_power: Any) -> Any:
        t = sign * (v - m)
        s = t / h
        result = at_power if "end" in kinds else t
        if at.pole is not False:
            result = xp.where(kind == EXP, xp.log(t), result)
        if at.pole is not True:
            result = xp.where(kind == SQUARE, xp.sqrt(xp.maximum(0.0, t)), result)
            result = xp.where(kind == SINE, xp.arcsin(xp.clip(s, -1.0, 1.0)), result)
            result = xp.where(kind == COSH, xp.arccosh(xp.maximum(1.0, s)), result)
        return xp.where(kind == SINH, xp.arcsinh(s), result)

    start = inverse(p, xp.where(at.at_p, 0.0, 1.0))
    return kind, base + middle, sign * size, start, inverse(q, xp.where(at.at_p, 1.0, 0.0)) - start


def _around_pole(xp: Any, p: Any, q: Any, at: _Zeros) -> tuple[Any, Any, Any]:
    """Returns kind, m and h around a pole: its nearer zero, or both that are paired."""
    below, above = at.m - at.h, at.m + at.h
    nearer = xp.where(xp.abs(below - p) + xp.abs(below - q) <= xp.abs(above - p) + xp.abs(above - q), below, above)
    return xp.where(at.paired, SINH, EXP), xp.where(at.paired, at.m, nearer), at.h


def _around_end(xp: Any, centre: Any, p: Any, q: Any, at: _Zeros) -> tuple[Any, Any, Any]:
    """Returns kind, m and h around zeros at which a root or a power ends. Zeros at ends of the piece do not stay inside."""
    below, above, nearby = at.m - at.h, at.m + at.h, AT_END * (q - p)
    curved = xp.where(xp.abs(centre - at.m) <= at.h, SINE, COSH)
    kind = xp.where(at.paired, SINH, xp.where(at.alone, SQUARE, curved))
    if at.end is not False:
        kind = xp.where(at.end & ~at.paired & (at.at_p ^ at.at_q), POWER, kind)
    left = xp.where(at.at_p, xp.minimum(0.0, p - xp.where(xp.abs(above - p) <= nearby, above, below)), 0.0)
    right = xp.where(at.at_q, xp.maximum(0.0, q - xp.where(xp.abs(below - q) <= nearby, below, above)), 0.0)
    sine = kind == SINE
    return kind, at.m + xp.where(sine, 0.5, 1.0) * (left + right), at.h + xp.where(sine, 0.5, 0.0) * (right - left)
