"""Integrals of the polynomial of the nearest candidate over the unit square, and their derivatives by every number of every candidate.

    V = Σ_k ∫∫ over R_k of f_k,        R_k: where the guards of k are >= 0 and its key is less than those of others that are present there

*Forms in, derivatives of forms out.* A candidate is a few affine forms c + a·u + b·v: the guards of its parts, its key; and a polynomial.
The square is cut into convex cells with one owner each. Candidates are inserted one by one, nearest first: a cell behind its owner all over
is left alone; else it is clipped by the guards, and by the line on which both keys are equal. Both sides of a cut share its points, so the
cells tile the square. Every edge knows the line it lies on.

    ∂V/∂(coefficient of f_k)  =  ∫∫ of its monomial over R_k                                         moments
    ∂V/∂(c, a, b) of a form   =  Σ over edges on its line of ±∫ f_owner·(1, u, v) ds/|(a, b)|         + on the side g >= 0, - on the other

The jump across an edge is never looked up: the cells on both sides give their shares, and cuts that separate nothing cancel. Where an edge
of another region lies on such a cut, as in a regular mesh, what is there is that region's, the nearest one's of several (second derivatives
there are NaN). Edges of several candidates that lie on each other have the derivative of moving together. The line of
two keys belongs to the key of one with + and to that of the other with -. Along a direction (`order` 1) the corners of the cells move as
the intersections of the lines of their edges do, and with them everything above, by the product rule.

A candidate is absent where one of its guards is below 0 on all of the square, whatever its other numbers are; a guard or a key of another
one that is not finite makes everything NaN. Equal keys: the lower index. A corner nearer than EPSILON to a line lies on it: common edges of
a mesh then cut nothing off. A line on a side of the square has one derivative for moving inwards and another one outwards: the mean counts
where the candidate is there, not farther than BESIDE from that side of a cell.
Cost: linear in the candidates, for those that are not hidden or outside the square of their number at worst; C compares these with the few
cells around them only, NumPy cuts the square into tiles first. Method: cells with owners (a planar arrangement built by insertion; there a
binary space partition finds them); derivatives by Reynolds' transport theorem.

This file is the meaning, in plain Python numbers; the backends compute the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from teg.numerics.quadrature import gauss_legendre, triangle_rule

EPSILON = 1e-12
"""The distance within which a point lies on a line; the side of the square is 1."""
BESIDE = 1e-9
"""The distance from which on a cell is beside a candidate, whatever is rounded."""
SHIFT = 1e-11
"""The distance by which the square is moved where a line lies on its side."""
SKEW = 0.7
"""The second coordinate of that step, in units of the first."""
ROUNDING = 1e-13
"""The rounding of a key, relative to its constant."""
SAME, PLACES = 1e-10, 8
"""The distance within which lines of different regions are one, and the decimal places in which their angles are."""
TILE_AT = (0.4871, 0.5119)
"""Where backends cut a square with many candidates into tiles, and these again: lines of a regular mesh lie on none of these."""
NOBODY = -1
MOST_DEGREE = 8
"""The largest degree of a polynomial."""
BOX = 4
"""Lines 0 to 3 are the sides of the square: u = 0, u = 1, v = 0, v = 1."""
SIDES = ((0.0, 1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, -1.0))

Form = tuple[float, float, float]
Point = tuple[float, float]
Row = Sequence[float]


class Layout(NamedTuple):
    """The numbers of one candidate of a partition: `parts` times `guards` affine forms, one for the key, a polynomial of a degree.

    Forms are (c, a, b) for c + a·u + b·v. A polynomial has its coefficients in the order 1, u, v, u², uv, v², …. With `order` 1 the node
    is the derivative of a partition along a direction, whose components follow the numbers.
    """

    parts: int
    guards: int
    degree: int
    order: int = 0

    @property
    def forms(self) -> int:
        """Returns the count of the numbers of forms."""
        return 3 * self.parts * self.guards + 3

    @property
    def coefficients(self) -> int:
        """Returns the count of the coefficients of a polynomial."""
        return (self.degree + 1) * (self.degree + 2) // 2

    @property
    def columns(self) -> int:
        """Returns the count of the numbers of a candidate, without directions."""
        return self.forms + self.coefficients


def monomials(degree: int) -> list[tuple[int, int]]:
    """Returns the exponents of u and v in the order of coefficients."""
    return [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]


class Line(NamedTuple):
    """The line of a form, divided by |(a, b)|; which numbers the form consists of: (+1 or -1, candidate, first column)."""

    unit: Form
    size: float
    of: tuple[tuple[int, int, int], ...]


class Cell(NamedTuple):
    """A convex polygon: the region that owns it, its corners, and the label of the edge behind each: 2·line, + 1 on the negative side."""

    owner: int
    corners: list[Point]
    labels: list[int]


class Integrals(NamedTuple):
    """Values, bounds of the integrals of absolute values, and for each value a table: a row for each candidate, and one for `otherwise`."""

    values: list[float]
    sizes: list[float]
    tables: list[list[list[float]]]


def integrals(shape: Layout, candidates: Sequence[Row], otherwise: Row, slopes: bool) -> Integrals:
    """Returns the integrals of polynomials of the nearest candidate.

    A candidate is a row: guards part by part, key, the coefficients of each polynomial; and the direction of all these if
    `shape.order` is 1. `otherwise` are the coefficients where there is no candidate, and their direction. Then the values are the
    derivatives along the direction, and a table has the derivatives of these by the numbers, and behind them by the direction.
    """
    here = _Arrangement(shape, candidates, (0.0, 0.0))
    measured = _Measured(shape, here, candidates, otherwise)
    values, sizes = measured.values()
    if not slopes and not shape.order:
        return Integrals(values, sizes, [])
    tables = measured.tables()
    if here.touching:
        moved = []
        for sign in (1.0, -1.0):
            there = _Arrangement(shape, candidates, (sign * SHIFT, sign * SHIFT * SKEW))
            moved.append(_Measured(shape, there, candidates, otherwise).tables())
        tables = [
            [[0.5 * (a + b) for a, b in zip(r, s, strict=True)] for r, s in zip(p, q, strict=True)] for p, q in zip(*moved, strict=True)
        ]
    if shape.order:
        values = [_along(table, shape, k, candidates, otherwise) for k, table in enumerate(tables)]
    return Integrals(values, sizes, tables)


def _along(table: Sequence[Row], shape: Layout, body: int, candidates: Sequence[Row], otherwise: Row) -> float:
    """Returns the derivative along the direction, from a table of derivatives of order 1."""
    total = 0.0
    count = shape.coefficients
    for row, numbers in zip(table, candidates, strict=False):
        half = len(numbers) // 2
        first = half + shape.forms + body * count
        moving = (*numbers[half : half + shape.forms], *numbers[first : first + count])
        total += sum(d * s for d, s in zip(moving, row[shape.columns :], strict=True) if s)
    half = len(otherwise) // 2
    moving = tuple(otherwise[half + body * count : half + (body + 1) * count])
    return total + sum(d * s for d, s in zip(moving, table[-1][shape.columns + shape.forms :], strict=True) if s)


def split(cell: Cell, line: int, unit: Form) -> tuple[Cell | None, Cell | None, list[bool]]:
    """Returns the parts of a cell on the sides g >= 0 and g <= 0 of a line, the cell itself where all of it is on one; and, where it is not
    cut, which corners are on the line."""
    c, a, b = unit
    d = [c + a * x + b * y for x, y in cell.corners]
    d = [0.0 if abs(v) < EPSILON else v for v in d]
    if max(d) <= 0.0 or min(d) >= 0.0:
        on = [v == 0.0 for v in d]
        return (None, cell, on) if max(d) <= 0.0 else (cell, None, on)
    return _half(cell, d, 1.0, 2 * line), _half(cell, d, -1.0, 2 * line + 1), [False] * len(d)


def _half(cell: Cell, d: Sequence[float], side: float, label: int) -> Cell:
    corners: list[Point] = []
    labels: list[int] = []
    n = len(d)
    for i, (x, y) in enumerate(cell.corners):
        j = (i + 1) % n
        di, dj = side * d[i], side * d[j]
        if di >= 0.0:
            corners.append((x, y))
            labels.append(label if di == 0.0 and dj < 0.0 else cell.labels[i])
        if di * dj < 0.0:
            t = d[i] / (d[i] - d[j])
            u, v = cell.corners[j]
            corners.append((x + t * (u - x), y + t * (v - y)))
            labels.append(label if di > 0.0 else cell.labels[i])
    return Cell(cell.owner, corners, labels)


class _Arrangement:
    """The cells of the square, moved by `shift`. Regions are parts of candidates: part j of candidate k is region k·parts + j."""

    def __init__(self, shape: Layout, candidates: Sequence[Row], shift: Point) -> None:
        self.shape, self.candidates, self.shift = shape, candidates, shift
        self.lines = [Line(side, 1.0, ()) for side in SIDES]
        self.guards: dict[int, list[int]] = {}  # of a line that is one: all lines of its region
        self.touching = False
        self.undefined = False
        present: list[tuple[int, list[int]]] = []
        for region in range(len(candidates) * shape.parts):
            cutting = self._cutting(region)
            if cutting is not None:
                present.append((region, cutting))
                self.undefined |= not all(map(math.isfinite, self._key(region)))
        if self.undefined:
            present = []
        base = min((self._most(r), r) for r, cutting in present if not cutting)[1] if any(not c for _, c in present) else NOBODY
        box = Cell(base, [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], [2 * 2, 2 * 1, 2 * 3, 2 * 0])
        self.cells = [box]
        self.key_lines: dict[tuple[int, int], int] = {}
        rest = [(self._middle(r), r, cutting) for r, cutting in present if r != base and not self._is_hidden(r, base)]
        self.inserted: list[int] = []  # the lines of guards, nearest region first
        for _, region, cutting in sorted(rest, key=lambda entry: entry[:2]):
            self.inserted += cutting
            self._insert(region, cutting)

    def form(self, candidate: int, column: int) -> Form:
        """Returns a form of a candidate in the coordinates of the square."""
        c, a, b = self.candidates[candidate][column : column + 3]
        return c + a * self.shift[0] + b * self.shift[1], a, b

    def _cutting(self, region: int) -> list[int] | None:
        """Returns the lines of the guards that may cut the square; None if the region is outside of it."""
        candidate, part = divmod(region, self.shape.parts)
        columns = range(3 * part * self.shape.guards, 3 * (part + 1) * self.shape.guards, 3)
        forms = [self.form(candidate, column) for column in columns]
        lines: list[Line] = []
        for (c, a, b), column in zip(forms, columns, strict=True):
            size = math.hypot(a, b)
            most = c + max(a, 0.0) + max(b, 0.0)
            least = c + min(a, 0.0) + min(b, 0.0)
            if most < -EPSILON * size or (size == 0.0 and c < 0.0):
                return None  # whatever the other guards are
            if least <= EPSILON * size and 0.0 < size < math.inf:
                lines.append(Line((c / size, a / size, b / size), size, ((1, candidate, column),)))
        self.undefined |= not all(math.isfinite(v) for form in forms for v in form)
        self.lines += lines
        cutting = list(range(len(self.lines) - len(lines), len(self.lines)))
        self.guards.update(dict.fromkeys(cutting, cutting))
        return cutting

    def _key(self, region: int) -> Form:
        return self.form(region // self.shape.parts, self.shape.forms - 3)

    def _most(self, region: int) -> float:
        c, a, b = self._key(region)
        return c + max(a, 0.0) + max(b, 0.0)

    def _middle(self, region: int) -> float:
        c, a, b = self._key(region)
        return c + 0.5 * a + 0.5 * b

    def _difference(self, behind: int, before: int) -> tuple[Form, float]:
        """Returns key - key, and the value below which it counts as 0."""
        (c, a, b), (d, e, f) = self._key(behind), self._key(before)
        g = (c - d, a - e, b - f)
        return g, EPSILON * math.hypot(g[1], g[2]) + ROUNDING * max(abs(c), abs(d))

    def _is_hidden(self, region: int, base: int) -> bool:
        """Returns whether the base is nearer than a region everywhere."""
        if base == NOBODY:
            return False
        (c, a, b), tolerance = self._difference(region, base)
        return c + min(a, 0.0) + min(b, 0.0) > tolerance

    def _insert(self, region: int, cutting: Sequence[int]) -> None:
        for number in range(len(self.cells)):
            cell = self.cells[number]
            needed: int | None = None
            if cell.owner != NOBODY:
                if cell.owner // self.shape.parts == region // self.shape.parts:
                    continue  # another part of the same candidate
                g, tolerance = self._difference(cell.owner, region)
                d = [g[0] + g[1] * x + g[2] * y for x, y in cell.corners]
                most, least = max(d), min(d)
                if not (most > tolerance and least < -tolerance) and (most > tolerance or least < -tolerance):
                    self.touching |= self._is_touching(cell, [abs(v) <= tolerance for v in d], cutting)
                if most <= tolerance and (least < -tolerance or region > cell.owner):
                    continue
                if most > tolerance and least < -tolerance:
                    needed = self._key_line(cell.owner, region, g)
            self._clip(number, region, cutting, needed)

    def _is_touching(self, cell: Cell, on: Sequence[bool], lines: Sequence[int]) -> bool:
        """Returns whether a region is at an edge of a cell on a side of the square, both ends of which are `on` a line."""
        n = len(on)
        edges = [i for i in range(n) if cell.labels[i] < 2 * BOX and on[i] and on[(i + 1) % n]]
        return any(self._is_at((cell.corners[i], cell.corners[(i + 1) % n]), lines) for i in edges)

    def _is_at(self, ends: tuple[Point, Point], lines: Sequence[int]) -> bool:
        first, last = 0.0, 1.0
        for line in lines:
            c, a, b = self.lines[line].unit
            d, e = (c + BESIDE + a * x + b * y for x, y in ends)
            if d < 0.0 and e < 0.0:
                return False
            first = max(first, d / (d - e)) if d < 0.0 else first
            last = min(last, d / (d - e)) if e < 0.0 else last
        return first <= last

    def _key_line(self, owner: int, region: int, g: Form) -> int:
        """Returns the line on which two keys are equal, of the form that is positive where `region` is nearer."""
        parts, column = self.shape.parts, self.shape.forms - 3
        pair = owner // parts, region // parts
        if pair not in self.key_lines:
            self.key_lines[pair] = len(self.lines)
            size = math.hypot(g[1], g[2])
            unit = (g[0] / size, g[1] / size, g[2] / size)
            self.lines.append(Line(unit, size, ((1, pair[0], column), (-1, pair[1], column))))
        return self.key_lines[pair]

    def _clip(self, number: int, region: int, cutting: Sequence[int], needed: int | None) -> None:
        """Gives a region its part of a cell; what is cut off stays with the owner."""
        cell, outside = self.cells[number], []
        for line in [*cutting, *([] if needed is None else [needed])]:
            inside, other, on = split(cell, line, self.lines[line].unit)
            self.touching |= self._is_touching(cell, on, cutting)
            if inside is None:
                return
            if other is not None:
                outside.append(other)
            cell = inside
        self.cells[number] = cell._replace(owner=region)
        self.cells += outside


def twins(arrangement: _Arrangement) -> dict[int, list[tuple[int, float]]]:
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


class _Measured:
    """Integrals over the cells of an arrangement, and along their edges."""

    def __init__(self, shape: Layout, arrangement: _Arrangement, candidates: Sequence[Row], otherwise: Row) -> None:
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
        return self.count if cell.owner == NOBODY else cell.owner // self.shape.parts

    def _rate(self, line: int) -> Form:
        """Returns the derivative of a line's form along the direction, divided by |(a, b)|."""
        c = a = b = 0.0
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
        blank = math.nan if self.arrangement.undefined else 0.0
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
