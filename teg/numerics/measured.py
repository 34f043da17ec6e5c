"""The integrals over the cells of one square, and their derivatives by the forms of candidates (`cells.py`)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from teg.numerics.arrangement import Arrangement, Cell, Line
from teg.numerics.cells import BOX, EPSILON, NO_OWNER, PARALLEL, PARTED, PLACES, SAME, SLOW, Form, Layout, Point, Row, monomials
from teg.numerics.quadrature import gauss_legendre, triangle_rule


def twins(arrangement: Arrangement) -> dict[int, list[tuple[int, float]]]:
    """Returns, for each guard's line that is that of guards of other regions too, these, and whether they have the same sides.

    The nearest region comes first.
    """
    known: list[tuple[float, float, int, float]] = []
    for rank, line in enumerate(arrangement.inserted):
        c, a, b = arrangement.lines[line].unit
        sign = math.copysign(1.0, a if abs(a) > SAME else b)
        known.append((round(sign * b / (1.0 + sign * a), PLACES), sign * c, rank, sign))
    known.sort()
    found: dict[int, list[tuple[int, float]]] = {}
    first = 0
    for k in range(1, len(known) + 1):
        if k < len(known) and known[k][0] == known[k - 1][0] and known[k][1] - known[k - 1][1] < SAME:
            continue
        group = [(arrangement.inserted[rank], sign) for _, _, rank, sign in sorted(known[first:k], key=lambda entry: entry[2])]
        for line, sign in group if len(group) > 1 else ():
            found[line] = [(other, sign * turned) for other, turned in group if other not in arrangement.guards[line]]
        first = k
    return found


def known(speed: float) -> float:
    """Returns a speed; 0 if it is not known, of edges that had another line before."""
    return 0.0 if math.isnan(speed) else speed


class Measured:
    """Integrals over the cells of an arrangement, and along their edges."""

    def __init__(self, shape: Layout, arrangement: Arrangement, candidates: Sequence[Row], otherwise: Row) -> None:
        self.shape, self.arrangement = shape, arrangement
        self.count = len(candidates)
        self.exponents = monomials(shape.degree)
        half = len(otherwise) // (1 + shape.order)
        self.bodies = half // shape.coefficients
        wide = shape.forms + half
        self.coefficients = [list(row[shape.forms : wide]) for row in candidates] + [list(otherwise[:half])]
        self.forms = candidates
        self.moving = bool(shape.order)
        self.wide = wide
        self.changes = [list(row[wide + shape.forms : 2 * wide]) for row in candidates] + [list(otherwise[half:])]
        self.moments = self._all_moments()
        self.twins = twins(arrangement)

    def _owner(self, cell: Cell) -> int:
        """Returns the row of a cell's owner."""
        return self.count if cell.owner == NO_OWNER else cell.owner // self.shape.parts

    def _rate(self, line: int) -> Form:
        """Returns the derivative of a line's form along the direction, divided by |(a, b)|."""
        c = a = b = math.nan if self.arrangement.lines[line].late else 0.0
        x, y = self.arrangement.shift
        for sign, candidate, column in self.arrangement.lines[line].of:
            p, q, r = self.forms[candidate][self.wide + column : self.wide + column + 3]
            c, a, b = c + sign * (p + q * x + r * y), a + sign * q, b + sign * r
        size = self.arrangement.lines[line].size
        return c / size, a / size, b / size

    def velocities(self, cell: Cell) -> list[Point]:
        """Returns the derivatives of the corners: each is where the lines of its two edges meet."""
        found: list[Point] = []
        for i, (x, y) in enumerate(cell.corners):
            rates = []
            for label in (cell.labels[i - 1], cell.labels[i]):
                (c, a, b), (_, e, f) = self._rate(label >> 1), self.arrangement.lines[label >> 1].unit
                rates.append((e, f, -(c + a * x + b * y)))
            (e, f, r), (g, h, s) = rates
            across = e * h - f * g
            if abs(across) > 1e-9:
                found.append(((r * h - f * s) / across, (e * s - g * r) / across))
            else:  # a corner on a straight line
                found.append((0.5 * (r * e + s * g), 0.5 * (r * f + s * h)))
        return found

    def parting(self) -> float:
        """Returns the largest speed with which a corner leaves another line that it lies on; 0 if all of them stay, NaN if it is too slow.
        Lines that coincide with an edge at the corner are left out."""
        fastest = moving = 0.0
        for cell in self.arrangement.cells:
            for i, ((x, y), (p, q)) in enumerate(zip(cell.corners, self.velocities(cell), strict=True)):
                moving = max(moving, known(abs(p) + abs(q)))
                edges = [self.arrangement.lines[label >> 1].unit for label in (cell.labels[i - 1], cell.labels[i])]
                for number, line in enumerate(self.arrangement.lines):
                    c, a, b = line.unit
                    if abs(c + a * x + b * y) > EPSILON or any(abs(a * f - b * e) <= PARALLEL for _, e, f in edges):
                        continue
                    d, e, f = self._rate(number)
                    moving = max(moving, known(abs(d) + abs(e) + abs(f)))
                    fastest = max(fastest, known(abs(d + e * x + f * y + a * p + b * q)))
        return 0.0 if fastest <= PARTED * moving else math.nan if fastest < SLOW * moving else fastest

    def _all_moments(self) -> dict[int, tuple[list[float], list[float]]]:
        """Returns the moments of every owner's cells, and their derivatives along the direction."""
        every: dict[int, tuple[list[float], list[float]]] = {}
        zeros = [0.0] * len(self.exponents)
        for cell in self.arrangement.cells:
            total, change = every.setdefault(self._owner(cell), (list(zeros), list(zeros)))
            speed = self.velocities(cell) if self.moving else [(0.0, 0.0)] * len(cell.corners)
            for (x, y), (p, q), weight, growth in _nodes(cell.corners, speed, self.shape.degree):
                for k, (i, j) in enumerate(self.exponents):
                    at = x**i * y**j
                    total[k] += weight * at
                    if self.moving:
                        slope = (i * x ** (i - 1) * y**j * p if i else 0.0) + (j * x**i * y ** (j - 1) * q if j else 0.0)
                        change[k] += growth * at + weight * slope
        return every

    def values(self) -> tuple[list[float], list[float]]:
        """Returns the integrals, and bounds of those of absolute values."""
        values, sizes = [0.0] * self.bodies, [0.0] * self.bodies
        width = len(self.exponents)
        for owner, (moments, _) in self.moments.items():
            for body in range(self.bodies):
                own = self.coefficients[owner][body * width : (body + 1) * width]
                values[body] += sum(c * m for c, m in zip(own, moments, strict=True))
                sizes[body] += moments[0] * sum(map(abs, own))
        return ([math.nan] * self.bodies, sizes) if self.arrangement.undefined else (values, sizes)

    def tables(self) -> list[list[list[float]]]:
        """Returns the derivatives by every number of every candidate; at order 1 those of the derivative along the direction first."""
        columns, forms, width = self.shape.columns, self.shape.forms, len(self.exponents)
        blank = math.nan if self.arrangement.undefined or self.arrangement.ambiguous else 0.0
        tables = [[[blank] * (columns * (1 + self.shape.order)) for _ in range(self.count + 1)] for _ in range(self.bodies)]
        for body, table in enumerate(tables):
            for owner, (moments, changes) in self.moments.items():
                table[owner][forms:columns] = changes if self.moving else moments
                if self.moving:
                    table[owner][columns + forms : 2 * columns] = moments
            for cell in self.arrangement.cells:
                owner = self._owner(cell)
                own = slice(body * width, (body + 1) * width)
                self._edges(cell, self.coefficients[owner][own], self.changes[owner][own], table)
        if self.moving and self.arrangement.ambiguous:
            return [[[math.nan] * len(row) for row in table] for table in tables]
        return tables

    def _edges(self, cell: Cell, own: Sequence[float], moving: Sequence[float], table: list[list[float]]) -> None:
        """Adds what the edges of a cell give to the derivatives by the forms of their lines."""
        speed = self.velocities(cell) if self.moving else [(0.0, 0.0)] * len(cell.corners)
        n, columns = len(cell.corners), self.shape.columns
        for i, label in enumerate(cell.labels):
            if label < 2 * BOX:
                continue
            ends = (cell.corners[i], cell.corners[(i + 1) % n]), (speed[i], speed[(i + 1) % n])
            shares = self._shares(label >> 1, *ends[0])
            for first, last, number, turned in shares:
                line = self.arrangement.lines[number]
                turning = self._rate(number) if self.moving else (0.0, 0.0, 0.0)
                plain, changed = self._along_edge(_between(ends, first, last), (own, moving), line, turning)
                side = -turned if label & 1 else turned
                changed = changed if len(shares) == 1 and number == label >> 1 else [math.nan] * 3
                for sign, candidate, column in line.of:
                    for k in range(3):
                        if self.moving:
                            table[candidate][column + k] += sign * side * changed[k]
                            table[candidate][columns + column + k] += sign * side * plain[k]
                        else:
                            table[candidate][column + k] += sign * side * plain[k]

    def _shares(self, line: int, start: Point, stop: Point) -> list[tuple[float, float, int, float]]:
        """Returns the parts of an edge, the line that each belongs to, and whether it has the same sides.

        A cut goes on beyond the region that made it. Where the edge of another region lies on it, what is there is that one's.
        """
        if line not in self.twins:
            return [(0.0, 1.0, line, 1.0)]
        found: list[tuple[float, float, int, float]] = []
        length = math.hypot(stop[0] - start[0], stop[1] - start[1])
        left = [(0.0, 1.0)]
        for number, sign in ((line, 1.0), *self.twins[line]):
            first, last = self._edge_of(number, start, stop)
            rest: list[tuple[float, float]] = []
            for low, high in left:
                begin, end = max(low, first), min(high, last)
                if (end - begin) * length <= EPSILON:
                    rest.append((low, high))
                    continue
                found.append((begin, end, number, sign))
                rest += [part for part in ((low, begin), (end, high)) if (part[1] - part[0]) * length > EPSILON]
            left = rest
        if all(number == line for _, _, number, _ in found):
            return [(0.0, 1.0, line, 1.0)]
        return found + [(low, high, line, 1.0) for low, high in left]

    def _edge_of(self, line: int, start: Point, stop: Point) -> tuple[float, float]:
        """Returns the part of a straight line where the other guards of a line's region hold."""
        first, last = 0.0, 1.0
        for other in self.arrangement.guards[line]:
            if other != line:
                c, a, b = self.arrangement.lines[other].unit
                d, e = c + a * start[0] + b * start[1], c + a * stop[0] + b * stop[1]
                if d < 0.0 and e < 0.0:
                    return 1.0, 0.0
                first = max(first, d / (d - e)) if d < 0.0 else first
                last = min(last, d / (d - e)) if e < 0.0 else last
        return first, last

    def _along_edge(
        self,
        ends: tuple[tuple[Point, Point], tuple[Point, Point]],
        body: tuple[Sequence[float], Sequence[float]],
        line: Line,
        turning: Form,
    ) -> tuple[list[float], list[float]]:
        """Returns ∫ f·(1, u, v) ds/|(a, b)| along an edge, and its derivative along the direction."""
        ((x0, y0), (x1, y1)), ((p0, q0), (p1, q1)) = ends
        length = math.hypot(x1 - x0, y1 - y0)
        plain, changed = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        nodes, weights = gauss_legendre((self.shape.degree + 1) // 2 + 1)
        stretch = ((x1 - x0) * (p1 - p0) + (y1 - y0) * (q1 - q0)) / (length * length) if self.moving and length else 0.0
        stretch -= line.unit[1] * turning[1] + line.unit[2] * turning[2]
        for node, weight in zip(nodes, weights, strict=True):
            t = 0.5 + 0.5 * node
            x, y, p, q = x0 + t * (x1 - x0), y0 + t * (y1 - y0), p0 + t * (p1 - p0), q0 + t * (q1 - q0)
            h = 0.5 * weight * length / line.size
            f = sum(c * x**i * y**j for c, (i, j) in zip(body[0], self.exponents, strict=True))
            for k, at in enumerate((1.0, x, y)):
                plain[k] += h * f * at
            if self.moving:
                df = sum(c * x**i * y**j for c, (i, j) in zip(body[1], self.exponents, strict=True))
                df += sum(c * i * x ** (i - 1) * y**j * p for c, (i, j) in zip(body[0], self.exponents, strict=True) if i)
                df += sum(c * j * x**i * y ** (j - 1) * q for c, (i, j) in zip(body[0], self.exponents, strict=True) if j)
                df += f * stretch
                for k, (at, slope) in enumerate(((1.0, 0.0), (x, p), (y, q))):
                    changed[k] += h * (df * at + f * slope)
        return plain, changed


def _between(ends: tuple[tuple[Point, Point], tuple[Point, Point]], first: float, last: float) -> Any:
    """Returns the part of an edge, and of the velocities of its ends."""
    if (first, last) == (0.0, 1.0):
        return ends
    at = [[tuple(p + t * (q - p) for p, q in zip(*pair, strict=True)) for t in (first, last)] for pair in ends]
    return (at[0][0], at[0][1]), (at[1][0], at[1][1])


def _nodes(corners: Sequence[Point], speed: Sequence[Point], degree: int) -> Iterator[tuple[Point, Point, float, float]]:
    """Yields the nodes of a rule on a polygon: point, velocity, weight, derivative of the weight."""
    (x0, y0), (p0, q0) = corners[0], speed[0]
    for k in range(1, len(corners) - 1):
        (a, b), (c, d) = ((x - x0, y - y0) for x, y in corners[k : k + 2])
        (e, f), (g, h) = ((p - p0, q - q0) for p, q in speed[k : k + 2])
        area = 0.5 * (a * d - c * b)
        growth = 0.5 * (e * d + a * h - g * b - c * f)
        for r, s, w in triangle_rule(degree):
            yield (x0 + r * a + s * c, y0 + r * b + s * d), (p0 + r * e + s * g, q0 + r * f + s * h), w * area, w * growth
