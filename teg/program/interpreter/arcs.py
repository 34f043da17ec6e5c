"""The meaning of `Ellipse`: moments of an ellipse on a box, by its chords on the sides and nodes along its arcs in the box."""

from __future__ import annotations

import math
from math import comb
from typing import TYPE_CHECKING

from teg.numerics.arcs import MANY, parts_of_a_circle
from teg.numerics.quadrature import gauss_legendre
from teg.program.limits import CLOSE_ENDS, TANGENT
from teg.program.statements import Ellipse, Moments

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

CIRCLE = 2.0 * math.pi
Powers = tuple[int, int]


def ellipse(machine: Machine, stmt: Ellipse) -> list[float]:
    """Returns the results."""
    place = machine.numbers(stmt.place)
    width, height, least = place[3:]
    a, b, c, d = machine.numbers(stmt.matrix)
    turn = math.copysign(1.0, a * d - b * c)  # |A(x - c)| is the same if a row is negated
    matrix = a, b, turn * c, turn * d
    if not abs(a * d - b * c) > 0.0:
        return [math.nan] * len(stmt.results)
    finite = all(map(math.isfinite, (*place[:2], width, height)))
    if not finite or not all(map(math.isfinite, place)):
        holds = finite and place[2] == math.inf and all(math.isfinite(x * x) for x in (*place[:2], width, height))
        beside = any(map(math.isinf, place[:2])) and not any(map(math.isnan, place[:2])) and all(map(math.isfinite, place[2:]))
        return [_whole(machine, m, width, height, holds) if holds or beside else math.nan for m in stmt.moments]
    curve = _Curve(matrix, place)
    borders = curve if place[2] >= least else _Curve(matrix, [*place[:2], least, width, height])
    results = []
    for wanted in stmt.moments:
        total = 0.0
        for j, k, factor in wanted.terms:
            moment = borders.border(j, k) if wanted.kind == "border" else curve.inside(j, k)
            if wanted.kind == "below":
                moment = width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1)) - moment
            total += machine.number(factor) * moment
        results.append(total)
    return results


def _whole(machine: Machine, wanted: Moments, width: float, height: float, inside: bool) -> float:
    """Returns a result on a box that is all inside the ellipse, or all outside."""
    if wanted.kind != ("above" if inside else "below"):
        return 0.0
    return sum(machine.number(c) * width ** (j + 1) * height ** (k + 1) / ((j + 1) * (k + 1)) for j, k, c in wanted.terms)


class _Curve:
    """An ellipse on a box. Points are offsets from the point of the box that is nearest to the centre. Complex numbers are the points
    w = A·((u, v) - c) of the plane in which it is a circle around 0.
    """

    def __init__(self, matrix: tuple[float, ...], place: list[float]) -> None:
        self.matrix, self.radius = matrix, place[2]
        ends_of = [sorted((0.0, extent)) for extent in place[3:5]]
        self.origin = [min(max(c, low), high) for c, (low, high) in zip(place[:2], ends_of, strict=True)]
        self.centre = place[0] - self.origin[0], place[1] - self.origin[1]
        (low_u, high_u), (low_v, high_v) = ((low - o, high - o) for o, (low, high) in zip(self.origin, ends_of, strict=True))
        corners = [(low_u, low_v), (high_u, low_v), (high_u, high_v), (low_u, high_v)]
        self.sign = -1.0 if (place[3] < 0.0) != (place[4] < 0.0) else 1.0
        self.chords: list[tuple[tuple[float, float], tuple[float, float]]] = []
        self.whole, self.round = False, True
        ends: list[tuple[bool, complex, tuple[float, float]]] = []  # whether the circle leaves the box there
        for i in range(4):
            self._side(corners[i], corners[(i + 1) % 4], ends)
        self.arcs = self._arcs(ends) if low_u < high_u and low_v < high_v else []

    def _seen(self, u: float, v: float) -> complex:
        a, b, c, d = self.matrix
        return complex(a * u + b * v, c * u + d * v)

    def _placed(self, w: complex) -> tuple[float, float]:
        a, b, c, d = self.matrix
        whole = a * d - b * c
        return (d * w.real - b * w.imag) / whole, (a * w.imag - c * w.real) / whole

    def _side(self, first: tuple[float, float], last: tuple[float, float], ends: list[tuple[bool, complex, tuple[float, float]]]) -> None:
        """Finds the chord of a side, and appends where the circle crosses it."""
        start, stop = (self._seen(u - self.centre[0], v - self.centre[1]) for u, v in (first, last))
        along = self._seen(last[0] - first[0], last[1] - first[1])
        length = abs(along)
        if length == 0.0:
            return
        unit = along / length
        (a, b, c, d), over, up = self.matrix, last[0] - first[0], last[1] - first[1]  # one of which is 0
        away = (a * d - b * c) * ((first[0] - self.centre[0]) * up - (first[1] - self.centre[1]) * over) / length
        self.round &= away >= self.radius * (1.0 - TANGENT)
        half = math.sqrt(max((self.radius - away) * (self.radius + away), 0.0))
        foot = -(start.conjugate() * unit).real
        inside = [abs(w) < self.radius for w in (start, stop)]
        if not any(inside) and not (half > 0.0 and 0.0 < foot < length):
            return
        at = [0.0 if inside[0] else (foot - half) / length, 1.0 if inside[1] else (foot + half) / length]
        normal = complex(unit.imag, -unit.real) * away
        points = []
        for t, shift, within in zip(at, (-half, half), inside, strict=True):
            t = min(max(t, 0.0), 1.0)
            u, v = self._placed(normal + shift * unit)
            near = not within and self.radius < length
            place = (
                (self.centre[0] + u, self.centre[1] + v)
                if near
                else (first[0] + t * (last[0] - first[0]), first[1] + t * (last[1] - first[1]))
            )
            points.append(place)
            if not within:
                ends.append((len(points) == 2, normal + shift * unit, place))
        self.chords.append((points[0], points[1]))

    def _arcs(self, ends: list[tuple[bool, complex, tuple[float, float]]]) -> list[tuple[complex, tuple[float, float], float]]:
        """Returns the arcs in the box: where they begin, and their angles."""
        if not self.chords:
            self.whole = self.round
            u, v = self._placed(complex(self.radius))
            return [(complex(self.radius), (self.centre[0] + u, self.centre[1] + v), CIRCLE)] if self.whole else []
        arcs = []
        for i, (leaves, w, place) in enumerate(ends):
            if leaves:
                _, entered, _ = ends[(i + 1) % len(ends)]
                apart = abs(w - entered) / self.radius
                turn = w.conjugate() * entered
                angle = math.atan2(turn.imag, turn.real) % CIRCLE
                if apart < CLOSE_ENDS:
                    angle = CIRCLE - apart if self.round else apart
                arcs.append((w, place, angle))
        return arcs

    def _nodes(self, degree: int) -> list[tuple[float, float, float, float, float]]:
        """Returns nodes u, v on the arcs, the derivatives by the angle, and weights."""
        found = []
        parts, rule = parts_of_a_circle(degree), gauss_legendre(MANY)
        for w, (u, v), angle in self.arcs:
            for part in range(parts):
                for x, weight in zip(*rule, strict=True):
                    turned = angle * (2 * part + 1 + x) / (2 * parts)
                    du, dv = self._placed(w * complex(-2.0 * math.sin(0.5 * turned) ** 2, math.sin(turned)))
                    slope_u, slope_v = self._placed(w * complex(-math.sin(turned), math.cos(turned)))
                    found.append((u + du, v + dv, slope_u, slope_v, weight * angle / (2 * parts)))
        return found

    def border(self, j: int, k: int) -> float:
        """Returns ∫∫ uʲvᵏ δ(g)."""
        (a, b, c, d), (o, p) = self.matrix, self.origin
        return 0.5 * self.sign / (a * d - b * c) * sum(weight * (u + o) ** j * (v + p) ** k for u, v, _, _, weight in self._nodes(j + k))

    def inside(self, j: int, k: int) -> float:
        """Returns ∫∫ [g > 0] uʲvᵏ, from its like about a point inside."""
        if not self.chords and not self.whole:
            return 0.0
        ends = [p for chord in self.chords for p in chord]
        at = [sum(p[axis] for p in ends) / len(ends) for axis in range(2)] if ends else list(self.centre)
        about: dict[Powers, float] = {}
        nodes, weights = gauss_legendre((j + k) // 2 + 1)
        for m in range(j + 1):
            for n in range(k + 1):
                total = 0.0
                for u, v, du, dv, weight in self._nodes(j + k + 2):
                    x, y = u - at[0], v - at[1]
                    total += weight * (x * dv - y * du) * x**m * y**n
                for (p, q), (s, t) in self.chords:
                    p, q, s, t = p - at[0], q - at[1], s - at[0], t - at[1]
                    for r, weight in zip(nodes, weights, strict=True):
                        x, y = 0.5 * ((1.0 - r) * p + (1.0 + r) * s), 0.5 * ((1.0 - r) * q + (1.0 + r) * t)
                        total += 0.5 * weight * (p * t - q * s) * x**m * y**n
                about[m, n] = total / (m + n + 2)
        at = [a + o for a, o in zip(at, self.origin, strict=True)]
        return self.sign * sum(comb(j, m) * comb(k, n) * at[0] ** (j - m) * at[1] ** (k - n) * value for (m, n), value in about.items())
