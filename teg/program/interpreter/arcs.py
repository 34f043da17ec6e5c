"""The meaning of `Ellipse`: moments of an ellipse on a convex polygon, by its chords on the sides and nodes along its arcs inside."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from math import comb
from typing import TYPE_CHECKING

from teg.numerics.arcs import MANY, parts_of_a_circle
from teg.numerics.quadrature import gauss_legendre
from teg.program.interpreter.clipped import Line, Vertex, any_fails, clipped, lines_of, range_on_box
from teg.program.limits import CLOSE_ENDS, TANGENT
from teg.program.statements import Ellipse, Moments

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

CIRCLE = 2.0 * math.pi


def ellipse(machine: Machine, stmt: Ellipse) -> list[float]:
    """Returns the results."""
    place = machine.numbers(stmt.place)
    width, height, least = place[3:]
    a, b, c, d = machine.numbers(stmt.matrix)
    turn = math.copysign(1.0, a * d - b * c)  # |A(x - c)| is the same if a row is negated
    matrix = a, b, turn * c, turn * d
    planes = lines_of(machine, stmt.half_planes)
    ranges = [range_on_box(line, width, height) for line in planes]
    if not abs(a * d - b * c) > 0.0:
        return [math.nan] * len(stmt.results)
    if any_fails(stmt.half_planes, ranges):
        return [0.0] * len(stmt.results)
    if not all(math.isfinite(most - low) for low, most in ranges):
        return [math.nan] * len(stmt.results)
    domain = _Domain(width, height, [line for line, (low, _) in zip(planes, ranges, strict=True) if low < 0.0])
    finite = all(map(math.isfinite, (*place[:2], width, height)))
    if not finite or not all(map(math.isfinite, place)):
        holds = finite and place[2] == math.inf and all(math.isfinite(x * x) for x in (*place[:2], width, height))
        beside = any(map(math.isinf, place[:2])) and not any(map(math.isnan, place[:2])) and all(map(math.isfinite, place[2:]))
        return [_whole(machine, m, domain, holds) if holds or beside else math.nan for m in stmt.moments]
    curve = _Curve(matrix, place[:3], domain)
    borders = curve if place[2] >= least else _Curve(matrix, [*place[:2], least], domain)
    results = []
    for wanted in stmt.moments:
        total = 0.0
        for j, k, factor in wanted.terms:
            moment = borders.border(j, k, wanted.axes) if wanted.kind == "border" else curve.inside(j, k)
            if wanted.kind == "below":
                moment = domain.moment(j, k) - moment
            total += machine.number(factor) * moment
        results.append(total * turn if wanted.axes[1] % 2 else total)
    return results


def _whole(machine: Machine, wanted: Moments, domain: _Domain, inside: bool) -> float:
    """Returns a result on a domain that is all inside the ellipse, or all outside."""
    if wanted.kind != ("above" if inside else "below"):
        return 0.0
    return sum(machine.number(c) * domain.moment(j, k) for j, k, c in wanted.terms)


class _Domain:
    """A box, and the convex polygon that lines leave of it: its vertices, counterclockwise, and the sign of its area."""

    def __init__(self, width: float, height: float, lines: list[Line]) -> None:
        self.width, self.height, self.lines = width, height, lines
        self.sign = -1.0 if (width < 0.0) != (height < 0.0) else 1.0
        (low_u, high_u), (low_v, high_v) = sorted((0.0, width)), sorted((0.0, height))
        self.vertices: list[Vertex] = [(low_u, low_v), (high_u, low_v), (high_u, high_v), (low_u, high_v)]
        for line in lines:
            self.vertices = clipped(self.vertices, line) if self.vertices else []
        sides = ((1.0, 0.0, -low_u), (-1.0, 0.0, high_u), (0.0, 1.0, -low_v), (0.0, -1.0, high_v))
        self.borders: list[Line] = [*sides, *lines]
        self.is_flat = width == 0.0 or height == 0.0 or len(self.vertices) < 3

    def moment(self, j: int, k: int) -> float:
        """Returns ∫∫ uʲvᵏ over the polygon."""
        if not self.lines:
            return self.width ** (j + 1) * self.height ** (k + 1) / ((j + 1) * (k + 1))
        sides = list(zip(self.vertices, self.vertices[1:] + self.vertices[:1], strict=True))
        return self.sign * _moved(j, k, _mean(self.vertices), lambda m, n, at: _along_chords(sides, at, m, n)) if self.vertices else 0.0


def _mean(points: Sequence[Vertex]) -> tuple[float, float]:
    return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)


def _along_chords(chords: Sequence[tuple[Vertex, Vertex]], at: tuple[float, float], j: int, k: int) -> float:
    """Returns ∫ uʲvᵏ (u dv - v du) along chords, about a point."""
    total = 0.0
    for first, last in chords:
        p, q, s, t = first[0] - at[0], first[1] - at[1], last[0] - at[0], last[1] - at[1]
        for r, weight in zip(*gauss_legendre((j + k) // 2 + 1), strict=True):
            x, y = 0.5 * ((1.0 - r) * p + (1.0 + r) * s), 0.5 * ((1.0 - r) * q + (1.0 + r) * t)
            total += 0.5 * weight * (p * t - q * s) * x**j * y**k
    return total


def _moved(
    j: int, k: int, at: tuple[float, float], along: Callable[[int, int, tuple[float, float]], float], origin: Sequence[float] = (0.0, 0.0)
) -> float:
    """Returns ∫∫ uʲvᵏ by the integrals ∮ uᵐvⁿ (u dv - v du) along the border about a point."""
    about = {(m, n): along(m, n, at) / (m + n + 2) for m in range(j + 1) for n in range(k + 1)}
    u, v = at[0] + origin[0], at[1] + origin[1]
    return sum(comb(j, m) * comb(k, n) * u ** (j - m) * v ** (k - n) * value for (m, n), value in about.items())


class _Curve:
    """An ellipse on a convex polygon. Points are offsets from the point of the box that is nearest to the centre. Complex numbers are the
    points w = A·((u, v) - c) of the plane in which it is a circle around 0.
    """

    def __init__(self, matrix: tuple[float, ...], place: Sequence[float], domain: _Domain) -> None:
        self.matrix, self.radius, self.sign = matrix, place[2], domain.sign
        ends_of = [sorted((0.0, extent)) for extent in (domain.width, domain.height)]
        self.origin = [min(max(c, low), high) for c, (low, high) in zip(place[:2], ends_of, strict=True)]
        self.centre = place[0] - self.origin[0], place[1] - self.origin[1]
        self.round = all(self._is_inside(line, place) for line in domain.borders)
        self.chords: list[tuple[tuple[float, float], tuple[float, float]]] = []
        self.whole = False
        ends: list[tuple[bool, complex, tuple[float, float]]] = []  # whether the circle leaves the polygon there
        vertices = [(u - self.origin[0], v - self.origin[1]) for u, v in domain.vertices]
        for first, last in zip(vertices, vertices[1:] + vertices[:1], strict=True):
            self._side(first, last, ends)
        self.arcs = [] if domain.is_flat else self._arcs(ends)

    def _is_inside(self, line: Line, place: Sequence[float]) -> bool:
        """Returns whether the disk is on the inner side of a line, or touches it."""
        (a, b, c, d), (slope_u, slope_v, at_corner) = self.matrix, line
        reach = math.hypot(d * slope_u - c * slope_v, a * slope_v - b * slope_u) / (a * d - b * c)
        return (at_corner + slope_u * place[0]) + slope_v * place[1] >= self.radius * (1.0 - TANGENT) * reach

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
        (a, b, c, d), over, up = self.matrix, last[0] - first[0], last[1] - first[1]
        away = (a * d - b * c) * ((first[0] - self.centre[0]) * up - (first[1] - self.centre[1]) * over) / length
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
            u, v, w = first[0] + t * over, first[1] + t * up, normal + shift * unit
            if not within and self.radius < length:
                u, v = (c + x for c, x in zip(self.centre, self._placed(w), strict=True))
            elif not within:  # a short side has no digits of its direction
                w = self._seen(u - self.centre[0], v - self.centre[1])
            points.append((u, v))
            if not within:
                ends.append((len(points) == 2, w, (u, v)))
        self.chords.append((points[0], points[1]))

    def _arcs(self, ends: list[tuple[bool, complex, tuple[float, float]]]) -> list[tuple[complex, tuple[float, float], float]]:
        """Returns the arcs in the box: where they begin, and their angles."""
        if not self.chords:
            self.whole = self.round
            u, v = self._placed(complex(self.radius))
            return [(complex(self.radius), (self.centre[0] + u, self.centre[1] + v), CIRCLE)] if self.whole else []
        arcs: list[tuple[complex, tuple[float, float], float]] = []
        behind: list[tuple[float, int]] = []
        for i, (leaves, w, place) in enumerate(ends):
            if leaves:
                _, entered, _ = ends[(i + 1) % len(ends)]
                apart = abs(w - entered) / self.radius
                turn = w.conjugate() * entered
                angle = apart if apart < CLOSE_ENDS else math.atan2(turn.imag, turn.real) % CIRCLE
                behind += [(turn.imag, len(arcs))] if apart < CLOSE_ENDS else []
                arcs.append((w, place, angle))
        if self.round and arcs and len(behind) == len(arcs):
            w, place, angle = arcs[min(behind)[1]]
            arcs[min(behind)[1]] = w, place, CIRCLE - angle
        return arcs

    def _nodes(self, degree: int) -> list[tuple[float, float, float, float, complex, float]]:
        """Returns nodes u, v on the arcs, the derivatives by the angle, the nodes w, and weights."""
        found = []
        parts, rule = parts_of_a_circle(degree), gauss_legendre(MANY)
        for w, (u, v), angle in self.arcs:
            for part in range(parts):
                for x, weight in zip(*rule, strict=True):
                    turned = angle * (2 * part + 1 + x) / (2 * parts)
                    du, dv = self._placed(w * complex(-2.0 * math.sin(0.5 * turned) ** 2, math.sin(turned)))
                    slope_u, slope_v = self._placed(w * complex(-math.sin(turned), math.cos(turned)))
                    at = w * complex(math.cos(turned), math.sin(turned))
                    found.append((u + du, v + dv, slope_u, slope_v, at, weight * angle / (2 * parts)))
        return found

    def border(self, j: int, k: int, axes: tuple[int, int]) -> float:
        """Returns ∫∫ uʲvᵏpᵐqⁿ δ(g), (p, q) = w; `axes` is (m, n)."""
        (a, b, c, d), (o, p), (m, n) = self.matrix, self.origin, axes
        total = 0.0
        for u, v, _, _, w, weight in self._nodes(j + k + m + n):
            total += weight * (u + o) ** j * (v + p) ** k * w.real**m * w.imag**n
        return 0.5 * self.sign / (a * d - b * c) * total

    def inside(self, j: int, k: int) -> float:
        """Returns ∫∫ [g > 0] uʲvᵏ, from its like about a point inside."""
        if not self.chords and not self.whole:
            return 0.0

        def along(m: int, n: int, at: tuple[float, float]) -> float:
            total = _along_chords(self.chords, at, m, n)
            for u, v, du, dv, _, weight in self._nodes(j + k + 2):
                x, y = u - at[0], v - at[1]
                total += weight * (x * dv - y * du) * x**m * y**n
            return total

        at = _mean([p for chord in self.chords for p in chord]) if self.chords else self.centre
        return self.sign * _moved(j, k, at, along, self.origin)
