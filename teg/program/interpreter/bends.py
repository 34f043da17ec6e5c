"""The place of u in (0, 1) on a piece: straight, cubic, a tail, or by the nearest bend (`Bend`)."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from teg.program.limits import AT_END, AT_REACH, BEYOND, FAR, NEAR, POLE
from teg.program.operations import divide

LINE, CUBIC, SQUARE, SINE, COSH, SINH, EXP, POWER, TAIL, SLOW_TAIL = range(10)
FUNCTIONS: dict[int, Callable[[float], tuple[float, float]]] = {
    LINE: lambda t: (t, 1.0),
    CUBIC: lambda t: (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)),
    SQUARE: lambda t: (t * t, 2.0 * t),
    SINE: lambda t: (math.sin(t), math.cos(t)),
    COSH: lambda t: (math.cosh(t), math.sinh(t)),
    SINH: lambda t: (math.sinh(t), math.cosh(t)),
    EXP: lambda t: (math.exp(t), math.exp(t)),
    POWER: lambda t: (t * t * t * t * t * t, 6.0 * (t * t * t * t * t)),
    TAIL: lambda t: (divide(t, 1.0 - t), divide(1.0, (1.0 - t) * (1.0 - t))),
}
"""φ and its derivative, by kind."""
Given = tuple[str, Sequence[float]]
"""The kind of a bend, and c₀, c₁, c₂."""


@dataclass(frozen=True, slots=True)
class Substitution:
    """v = centre + radius·φ(t), t = start + step·u, on the piece (p, q)."""

    p: float
    q: float
    kind: int
    centre: float
    radius: float
    start: float
    step: float

    def __call__(self, u: float) -> tuple[float, float]:
        """Returns the place of u, kept inside the piece, and dv/du."""
        t = self.start + self.step * u
        phi, slope = _slow_tail(t, abs(self.step)) if self.kind == SLOW_TAIL else FUNCTIONS[self.kind](t)
        place = self.centre + self.radius * phi
        place = place if place > self.p else beside(self.p, self.q)
        return place if place < self.q else beside(self.q, self.p), self.radius * self.step * slope


def _slow_tail(t: float, reach: float) -> tuple[float, float]:
    """Returns φ and its derivative, 0 < t < reach."""
    left, last = max(1.0 - t / reach, 2.0**-53), 1.0 / (1.0 + AT_REACH)
    exponent = min((t / AT_REACH) / left, reach)
    return math.sinh(exponent), math.cosh(exponent) / (AT_REACH * left * (left if left > last else BEYOND * last))


def beside(p: float, q: float) -> float:
    """Returns the next normal number to p towards q."""
    after = math.nextafter(p, q)
    return math.copysign(sys.float_info.min, q - p) if abs(after) < sys.float_info.min else after


def tail_place(p: float, q: float, u: float, scale: float) -> float:
    """Returns the place of u on an infinite piece."""
    return q - scale * ((1.0 - u) / u) if math.isinf(p) else p + scale * (u / (1.0 - u))


def tail(p: float, q: float, scale: float, reach: float | None) -> Substitution:
    """Returns the substitution on an infinite piece."""
    kind, whole = (TAIL, 1.0) if reach is None else (SLOW_TAIL, reach)
    return Substitution(p, q, kind, q, -scale, whole, -whole) if math.isinf(p) else Substitution(p, q, kind, p, scale, 0.0, whole)


def substitution(p: float, q: float, base: float, bends: Sequence[Given], cubic: bool) -> Substitution:
    """Returns the substitution on a finite piece: the place of u in (0, 1) and its speed."""
    chosen = Substitution(p, q, CUBIC if cubic else LINE, p, q - p, 0.0, 1.0)
    nearest = NEAR
    sharp_p = sharp_q = both = False
    for given in bends:
        bend = _zeros(given, p, q, base)
        if bend is None:
            continue
        if bend.kind != "pole" and bend.at_p != bend.at_q:
            both |= sharp_q if bend.at_p else sharp_p
            sharp_p, sharp_q = sharp_p or bend.at_p, sharp_q or bend.at_q
        if bend.size < nearest:
            nearest = bend.size
            way = _bent(bend)
            chosen = replace(way, p=p, q=q, centre=way.centre + base)
    return Substitution(p, q, CUBIC, (p - base) + base, (q - base) - (p - base), 0.0, 1.0) if both else chosen


@dataclass(frozen=True, slots=True)
class _Bend:
    """The zeros of D on a piece (p, q), all relative to the base: middle ± half, or middle ± i·half for `complex` ones; `single`: one zero.
    `at_p`, `at_q`: a zero is at that end."""

    kind: str
    p: float
    q: float
    middle: float
    half: float
    size: float
    complex: bool
    single: bool
    at_p: bool
    at_q: bool


def _zeros(given: Given, first: float, last: float, base: float) -> _Bend | None:
    """Returns the zeros of a bend, if it counts on the piece (first, last)."""
    kind, (c0, c1, c2) = given
    p, q = first - base, last - base
    length, width = q - p, max(abs(p), abs(q))
    if not all(map(math.isfinite, (c0, c1, c2, length))):
        return None
    linear = abs(c2) * width * width <= 1e-13 * (abs(c1) * width + abs(c0))
    if linear and abs(c1) * width <= 1e-13 * abs(c0):
        return None
    square = c1 * c1 - 4.0 * c0 * c2
    if not linear and square < 0.0:
        middle, half = -0.5 * c1 / c2, math.sqrt(-square) * abs(0.5 / c2)
        size = (math.hypot(middle - p, half) + math.hypot(middle - q, half)) * (2.0 / length)
        return _Bend(kind, p, q, middle, half, size, True, False, False, False) if half >= 1e-100 * length else None

    def size_of(y: float) -> float:
        return (abs(y - p) + abs(y - q)) * (2.0 / length)

    if linear:
        zeros = (divide(-c0, c1),)
    else:
        larger = -0.5 * (c1 + math.copysign(math.sqrt(square), c1))
        zeros = one, other = divide(c0, larger), larger / c2  # type: ignore[assignment]
        far = max(size_of(one), size_of(other)) > FAR or not math.isfinite(size_of(one) + size_of(other))
        zeros = (one if size_of(one) <= size_of(other) else other,) if far else zeros
    below, above = min(zeros), max(zeros)
    middle, half = 0.5 * (below + above), 0.5 * (above - below)
    single = len(zeros) == 1
    if not single and half < 1e-12 * length:
        return None
    reach = AT_END * length
    if kind == "pole":
        near = below if size_of(below) <= size_of(above) else above
        margin = POLE * max(abs(first), abs(last))
        if not (near < p - margin or near > q + margin):
            return None
    elif any(p + reach < y < q - reach for y in zeros):
        return None
    at_p, at_q = (any(abs(y - end) <= reach for y in zeros) for end in (p, q))
    return _Bend(kind, p, q, middle, half, min(map(size_of, zeros)), False, single, at_p, at_q)


def _bent(bend: _Bend) -> Substitution:
    """Returns the substitution by a bend, relative to the base."""
    p, q, m, h = bend.p, bend.q, bend.middle, bend.half
    centre = 0.5 * (p + q)
    below, above = m - h, m + h
    if bend.complex:
        kind = SINH
    elif bend.kind == "pole":
        kind = EXP
        m = below if abs(below - p) + abs(below - q) <= abs(above - p) + abs(above - q) else above
    else:
        power = bend.kind == "end" and bend.at_p != bend.at_q
        kind = POWER if power else SQUARE if bend.single else SINE if abs(centre - m) <= h else COSH
        reach = AT_END * (q - p)
        left = min(0.0, p - (above if abs(above - p) <= reach else below)) if bend.at_p else 0.0
        right = max(0.0, q - (below if abs(below - q) <= reach else above)) if bend.at_q else 0.0
        m += (0.5 if kind == SINE else 1.0) * (left + right)  # zeros at ends do not stay inside
        h += (0.5 if kind == SINE else 0.0) * (right - left)
    if kind == POWER:
        start, end = (0.0, 1.0) if bend.at_p else (1.0, 0.0)
        radius = (q - p) * (1.0 if bend.at_p else -1.0)
        return Substitution(p, q, kind, p if bend.at_p else q, radius, start, end - start)
    sign = 1.0 if kind in (SINH, SINE) or m <= centre else -1.0
    start, end = (_coordinate(kind, sign * (x - m), h) for x in (p, q))
    return Substitution(p, q, kind, m, sign * (1.0 if kind in (EXP, SQUARE) else h), start, end - start)


def _coordinate(kind: int, offset: float, h: float) -> float:
    """Returns the t of a place."""
    if kind == EXP:
        return math.log(offset)
    if kind == SQUARE:
        return math.sqrt(max(0.0, offset))
    if kind == SINE:
        return math.asin(min(1.0, max(-1.0, offset / h)))
    return math.asinh(offset / h) if kind == SINH else math.acosh(max(1.0, offset / h))
