"""A polynomial on half-planes over a box as arithmetic without branches: moments by Green's formula, weights of fixed nodes from them.

    the box                  [-1, 1]² in X and Y, u = width·(1 + X)/2, v = height·(1 + Y)/2; a half-plane is g = a·X + b·Y + c > 0
    the line g = 0           the point (px, py) nearest to the middle, and steps s of (b, -a): an interval [s₀, s₁] between the sides of
                             the box and the crossings with the other lines
    moments                  ∫∫ XᵖY^q = Σ over lines ∫ (X^(p+1) - (-1)^(p+1))/(p + 1)·Y^q dY, and the same over what is left of the
                             side X = 1
    weights                  at (d + 1)(d + 2)/2 nodes of the box, linear in the moments: exact for every polynomial of degree d

The crossing of two lines is computed once, and both intervals end there; the side X = 1 is cut where the lines meet it. So the border
stays closed, however flat the angle is: its errors are roundings of the box. A line that nearly runs along a side, and two lines that are
nearly one, are left to the polygon that is clipped corner by corner, and so are thin triangles: on the box, their barycentric
coordinates are large.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from itertools import count
from typing import NamedTuple

from teg.numerics.quadrature import gauss_legendre
from teg.program import Arg, Assign, HalfPlane

MOST_LINES, MOST_DEGREE = 8, 4
"""Half-planes, and the degree of the polynomial, beyond which polygons are clipped corner by corner."""
ALONG = 2.0**-10
"""A line this near to a side of the box, in slope and in distance, runs along it."""
NEARLY_PARALLEL = 2.0**-30
"""The sine of an angle between lines that may be one line."""
AWAY = 64.0
"""The crossing of nearly parallel lines is this far from the box if they are two."""
LEVEL = 2.0**-60
"""Lines are turned by this angle: it has no effect on results, and reciprocals are finite."""
BEYOND = 1.0 + 2.0**-40
"""Where a side of the box is for lines parallel to it."""
STOUT = (2.0**-3, 2.0**-3, 2.0**-3, 2.0**-2, 2.0**-2)
"""A triangle is stout if its value opposite to an edge is at least this part of the change of its half-planes over the box, by degree."""
SPECK = 2.0**-14
"""A smaller part of the box is clipped corner by corner: the weights have errors relative to the box."""
WIDEST = 2.0**20
"""A box is of an ordinary size below this: a corner of it that rounds to nothing has an area of less than 2⁻⁶⁴."""
LARGEST = 1.7976931348623157e308
FRACTIONS = (Fraction(0), Fraction(1), Fraction(-1), Fraction(1, 2), Fraction(-1, 2))


class Writer:
    """Assignments in the making. Sums and products with literals 0 and 1 are not written."""

    def __init__(self, numbers: count[int]) -> None:
        self.lines: list[Assign] = []
        self._numbers = numbers

    def put(self, letter: str, op: str, *args: Arg) -> str:
        """Returns the name of op(args)."""
        name = f"{letter}{next(self._numbers)}"
        self.lines.append(Assign(name, op, args))
        return name

    def add(self, *terms: Arg) -> Arg:
        """Returns the sum."""
        kept = [t for t in terms if t != 0.0]
        return 0.0 if not kept else kept[0] if len(kept) == 1 else self.put("v", "add", *kept)

    def mul(self, *factors: Arg) -> Arg:
        """Returns the product."""
        kept = [f for f in factors if f != 1.0]
        if 0.0 in kept:
            return 0.0
        if len(kept) > 1 and kept[0] == -1.0:
            return self.neg(self.mul(*kept[1:]))
        return 1.0 if not kept else kept[0] if len(kept) == 1 else self.put("v", "mul", *kept)

    def sub(self, a: Arg, b: Arg) -> Arg:
        """Returns the difference."""
        return a if b == 0.0 else self.neg(b) if a == 0.0 else self.put("v", "sub", a, b)

    def neg(self, a: Arg) -> Arg:
        """Returns -a."""
        return self.put("v", "neg", a) if isinstance(a, str) else -a

    def abs(self, a: Arg) -> Arg:
        """Returns |a|."""
        return self.put("v", "abs", a) if isinstance(a, str) else abs(a)

    def div(self, a: Arg, b: Arg) -> str:
        """Returns a/b."""
        return self.put("v", "div", a, b)

    def lower(self, a: Arg, b: Arg) -> str:
        """Returns the smaller of two numbers, b if one is NaN."""
        return self.put("v", "lower", a, b)

    def upper(self, a: Arg, b: Arg) -> str:
        """Returns the larger of two numbers, b if one is NaN."""
        return self.put("v", "upper", a, b)

    def positive(self, a: Arg) -> str:
        """Returns whether a > 0."""
        return self.put("b", "gt0", a)

    def any(self, *conditions: Arg) -> str:
        """Returns whether one of the conditions holds."""
        return self.put("b", "or", *conditions)

    def select(self, condition: Arg, a: Arg, b: Arg) -> str:
        """Returns a where the condition holds, else b."""
        return self.put("v", "select", condition, a, b)

    def finite(self, *numbers: Arg) -> str:
        """Returns whether the sum of numbers is finite. If it is, all of them are."""
        return self.put("b", "le0", self.sub(self.abs(self.add(*numbers)), LARGEST))

    def least_size(self, a: Arg, least: Arg) -> str:
        """Returns a, or `least` where |a| is smaller."""
        return self.select(self.put("b", "lt0", self.sub(self.abs(a), least)), least, a)


Moments = dict[tuple[int, int], Arg]
"""∫∫ XᵖY^q by (p, q)."""


class _Line(NamedTuple):
    """A line: slopes, constant, the point nearest to the middle, reciprocals. The sides that cut it are at X = ±`right` and Y = ±`top`. It
    is `tied` if it lies along a side, the box inside of its half-plane."""

    a: Arg
    b: Arg
    c: Arg
    px: Arg
    py: Arg
    per_square: Arg
    per_a: Arg
    per_b: Arg
    right: Arg = 1.0
    top: Arg = 1.0
    tied: Arg = False


class _Chord(NamedTuple):
    """What the box and the other half-planes leave of a line: s from middle - half to middle + half. `last` is s where X = 1."""

    middle: Arg
    half: Arg
    last: Arg


class Crossing(NamedTuple):
    """The moments, relative to the area width·height/4, the scaled slopes and constants of the half-planes, the lines and chords of those
    that cut the box, and the conditions under which the moments are right."""

    moments: Moments
    scaled: list[tuple[Arg, Arg, Arg]]
    lines: dict[int, _Line]
    chords: dict[int, _Chord]
    conditions: list[Arg]

    def middle_of(self, w: Writer, number: int) -> tuple[Arg, Arg]:
        """Returns the middle (X, Y) of a chord."""
        line, chord = self.lines[number], self.chords[number]
        return w.add(line.px, w.mul(chord.middle, line.b)), w.sub(line.py, w.mul(chord.middle, line.a))

    def runs_along_no_side(self, w: Writer, number: int) -> list[Arg]:
        """Returns the conditions that a line runs along no side of the box."""
        line = self.lines[number]
        size_a, size_b = w.abs(line.a), w.abs(line.b)

        def away(size: Arg, other: Arg, at: Arg) -> Arg:
            return w.positive(w.upper(w.sub(size, w.mul(ALONG, other)), w.sub(w.abs(w.sub(w.abs(at), 1.0)), ALONG)))

        both = [away(size_b, size_a, line.px), away(size_a, size_b, line.py)]
        return both if line.tied is False else [w.any(w.put("b", "and", *both), line.tied)]


def crossing(
    w: Writer, planes: Sequence[HalfPlane], extents: tuple[Arg, Arg], degree: int, apart: int, alone: int | None = None
) -> Crossing:
    """Returns the moments for polynomials of a degree where all half-planes hold on the box. The first `apart` are sides of a stout
    triangle: no two of them are nearly parallel. If one stands `alone`, the others hold on all of the box, which is a condition."""
    width, height = extents
    half_width, half_height = w.mul(0.5, width), w.mul(0.5, height)
    scaled: list[tuple[Arg, Arg, Arg]] = []
    for g in planes:
        a, b = w.mul(g.a, half_width), w.mul(g.b, half_height)
        scaled.append((a, b, w.add(g.c, w.add(a, b))))
    conditions: list[Arg] = []
    numbers = range(len(scaled)) if alone is None else [alone]
    lines = [_line(w, *scaled[number], conditions, len(numbers) == 1) for number in numbers]
    conditions += [w.positive(w.sub(c, w.add(w.abs(a), w.abs(b)))) for number, (a, b, c) in enumerate(scaled) if number not in numbers]
    cuts = _cuts(w, lines, conditions, apart)
    chords = [_chord(w, *g) for g in zip(lines, cuts, strict=True)]
    total = _moments(w, lines, chords, degree)
    area = total[0, 0]
    conditions.append(w.any(w.positive(w.sub(area, 4.0 * SPECK)), *_nothing_left(w, area, width, height)))
    return Crossing(total, scaled, dict(zip(numbers, lines, strict=True)), dict(zip(numbers, chords, strict=True)), conditions)


def _nothing_left(w: Writer, area: Arg, width: Arg, height: Arg) -> list[Arg]:
    """Returns conditions, one of which holds if the half-planes leave nothing of the box: an area of 0 in a box of an ordinary size. In a
    larger one a corner that rounds to nothing may matter."""
    empty = w.put("b", "le0", w.abs(area))
    large = w.upper(width, height) if isinstance(width, str) or isinstance(height, str) else max(width, height)
    if isinstance(large, str):
        return [w.put("b", "and", empty, w.positive(w.sub(WIDEST, large)))]
    return [empty] if large < WIDEST else []


def _line(w: Writer, a: Arg, b: Arg, c: Arg, conditions: list[Arg], alone: bool) -> _Line:
    """Returns a line; it must not run along the side X = 1. (Along X = -1 the primitives are 0, along the others Y does not change.) If no
    other one cuts the box, it may lie on a side."""
    size_a, size_b = w.abs(a), w.abs(b)
    right, top, tied = _on_a_side(w, size_a, size_b, c) if alone else (1.0, 1.0, False)
    a, b = w.add(a, w.mul(LEVEL, size_b)), w.add(b, w.mul(LEVEL, size_a))
    per_square = w.div(1.0, w.add(w.mul(a, a), w.mul(b, b)))
    f = w.neg(w.mul(c, per_square))
    px, py = w.mul(f, a), w.mul(f, b)
    conditions.append(w.positive(per_square))  # not NaN, no overflow
    beside = w.positive(w.upper(w.sub(size_b, w.mul(ALONG, size_a)), w.sub(w.abs(w.sub(px, 1.0)), ALONG)))
    conditions.append(beside if tied is False else w.any(beside, tied))
    return _Line(a, b, c, px, py, per_square, w.div(1.0, a), w.div(1.0, b), right, top, tied)


def _on_a_side(w: Writer, size_a: Arg, size_b: Arg, c: Arg) -> tuple[Arg, Arg, Arg]:
    """Returns where the sides are that cut a line, a little beyond 1 if it is parallel to them: a line on a side is not cut by it. And
    whether it is one, the box inside of its half-plane. The moments are those of the box then: along X = 1, its part is the line's."""
    vertical, level = w.put("b", "le0", size_b), w.put("b", "le0", size_a)
    right, top = (w.select(parallel, BEYOND, 1.0) for parallel in (vertical, level))
    distance = w.select(vertical, size_a, w.select(level, size_b, -1.0))
    near = w.put("b", "le0", w.abs(w.sub(c, distance)))
    return right, top, w.put("b", "and", w.put("b", "gt0", distance), near)


def _cuts(w: Writer, lines: Sequence[_Line], conditions: list[Arg], stout: int) -> list[list[tuple[Arg, Arg]]]:
    """Returns, for each line, the places at which the other lines cross it, each with a number that is positive if the other half-plane
    holds beyond that place."""
    cuts: list[list[tuple[Arg, Arg]]] = [[] for _ in lines]
    for j, g in enumerate(lines):
        for i, h in enumerate(lines[:j]):
            first, second = w.mul(h.a, g.b), w.mul(g.a, h.b)
            turn: Arg = w.sub(first, second)
            size = w.add(w.abs(first), w.abs(second)) if j >= stout else 0.0
            steep = w.least_size(turn, w.mul(LEVEL, size)) if j >= stout else turn
            inverse = w.div(1.0, steep)
            x = w.mul(w.sub(w.mul(g.c, h.b), w.mul(h.c, g.b)), inverse)
            y = w.mul(w.sub(w.mul(g.a, h.c), w.mul(h.a, g.c)), inverse)
            if j >= stout:
                apart = w.sub(w.add(w.abs(x), w.abs(y)), AWAY)
                conditions.append(w.any(w.positive(w.sub(w.abs(turn), w.mul(NEARLY_PARALLEL, size))), w.positive(apart)))
            for line, number, beyond in ((h, i, w.neg(steep)), (g, j, steep)):
                at = w.mul(w.sub(w.mul(x, line.b), w.mul(y, line.a)), line.per_square)
                cuts[number].append((at, beyond))
    return cuts


def _chord(w: Writer, line: _Line, crossings: Sequence[tuple[Arg, Arg]]) -> _Chord:
    """Returns what the box and the crossings leave of a line."""
    first, last = w.mul(w.sub(w.neg(line.right), line.px), line.per_b), w.mul(w.sub(line.right, line.px), line.per_b)
    bottom, top = w.mul(w.sub(line.py, w.neg(line.top)), line.per_a), w.mul(w.sub(line.py, line.top), line.per_a)
    start: Arg = w.upper(w.lower(first, last), w.lower(bottom, top))
    stop: Arg = w.lower(w.upper(first, last), w.upper(bottom, top))
    for at, beyond in crossings:
        up = w.positive(beyond)
        start, stop = w.select(up, w.upper(start, at), start), w.select(up, stop, w.lower(stop, at))
    return _Chord(w.mul(0.5, w.add(start, stop)), w.mul(0.5, w.upper(w.sub(stop, start), 0.0)), last)


def _moments(w: Writer, lines: Sequence[_Line], chords: Sequence[_Chord], degree: int) -> Moments:
    """Returns the moments to a degree of what all half-planes leave of [-1, 1]²."""
    terms: dict[tuple[int, int], list[Arg]] = {(p, q): [] for p in range(degree + 1) for q in range(degree + 1 - p)}
    nodes, node_weights = gauss_legendre((degree + 3) // 2)
    lowest: Arg = -1.0
    highest: Arg = 1.0
    for line, (middle, half, last) in zip(lines, chords, strict=True):
        rise = w.neg(w.mul(half, line.a))
        for u, weight in zip(nodes, node_weights, strict=True):
            s = w.add(middle, w.mul(half, float(u)))
            x, y = w.add(line.px, w.mul(s, line.b)), w.sub(line.py, w.mul(s, line.a))
            _along(w, terms, x, y, w.mul(rise, float(weight)), degree)
        meets = w.sub(line.py, w.mul(last, line.a))  # the side X = 1
        up = w.positive(line.b)
        lowest, highest = w.select(up, w.upper(lowest, meets), lowest), w.select(up, highest, w.lower(highest, meets))
    lowest = w.lower(lowest, 1.0)
    highest = w.upper(highest, lowest)
    _at_the_side(w, terms, lowest, highest, degree)
    return {(p, q): w.mul(1.0 / (p + 1), w.add(*parts)) for (p, q), parts in terms.items()}


def _along(w: Writer, terms: dict[tuple[int, int], list[Arg]], x: Arg, y: Arg, rise: Arg, degree: int) -> None:
    """Adds a node of a line to the terms of the moments."""
    power = x
    for p in range(degree + 1):
        primitive = w.mul(rise, w.sub(power, (-1.0) ** (p + 1)))
        for q in range(degree + 1 - p):
            terms[p, q].append(primitive)
            primitive = w.mul(primitive, y) if q < degree - p else primitive
        power = w.mul(power, x) if p < degree else power


def _at_the_side(w: Writer, terms: dict[tuple[int, int], list[Arg]], lowest: Arg, highest: Arg, degree: int) -> None:
    """Adds the side X = 1 between two places to the terms of the moments: even powers of X have 2/(p + 1) there, odd ones nothing."""
    length = w.sub(highest, lowest)
    powers: list[Arg] = [1.0]  # Σ highestᵏ·lowest^(q - k)
    of_lowest: Arg = 1.0
    for _ in range(degree):
        of_lowest = w.mul(of_lowest, lowest)
        powers.append(w.add(w.mul(powers[-1], highest), of_lowest))
    sides = [w.mul(length, power) for power in powers]
    for (p, q), parts in terms.items():
        if p % 2 == 0:
            parts.append(w.mul(2.0 / (q + 1), sides[q]))


# -- nodes and their weights ---------------------------------------------------------------------------------------------


@cache
def nodes_of(degree: int) -> tuple[tuple[float, float], ...]:
    """Returns the nodes (X, Y) that determine a polynomial of a degree in two variables."""
    return tuple((float(x), float(y)) for x, y in _places(degree))


def _places(degree: int) -> list[tuple[Fraction, Fraction]]:
    return [(FRACTIONS[i], FRACTIONS[j]) for i in range(degree + 1) for j in range(degree + 1 - i)]


@cache
def weights_of(degree: int) -> tuple[tuple[tuple[tuple[int, int], float], ...], ...]:
    """Returns for each node the moments in its weight, with their factors."""
    places, powers = _places(degree), [(p, q) for p in range(degree + 1) for q in range(degree + 1 - p)]
    rows = [[x**p * y**q for x, y in places] + [Fraction(int(k == r)) for k in range(len(powers))] for r, (p, q) in enumerate(powers)]
    for column in range(len(rows)):
        pivot = next(r for r in range(column, len(rows)) if rows[r][column] != 0)
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [v / rows[column][column] for v in rows[column]]
        for r, row in enumerate(rows):
            if r != column and row[column] != 0:
                rows[r] = [v - row[column] * by for v, by in zip(row, rows[column], strict=True)]
    inverse = [row[len(rows) :] for row in rows]
    return tuple(tuple((key, float(v)) for key, v in zip(powers, row, strict=True) if v != 0) for row in inverse)


def weights(w: Writer, moments: Moments, degree: int) -> list[Arg]:
    """Returns the weights of `nodes_of(degree)`."""
    scaled: Callable[[tuple[int, int], float], Arg] = lambda key, factor: w.mul(factor, moments[key])  # noqa: E731
    return [w.add(*(scaled(key, factor) for key, factor in row)) for row in weights_of(degree)]
