"""Integrals over the cells of many squares, and along their edges: values, and derivatives by the numbers of all candidates.

What `Measured` in `teg.numerics.measured` does for one square, for all at once; the formulas are there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrangement import Arrangements
from teg.backends.numpy.twins import Twins
from teg.numerics.cells import BOX, NO_OWNER, Layout, monomials
from teg.numerics.quadrature import gauss_legendre, triangle_rule

Array = npt.NDArray[Any]
Point = tuple[Array, Array]


class Numbers(NamedTuple):
    """What the candidates of squares are: `forms` (rows, numbers); polynomials (owners, bodies · coefficients) and how these change along
    the direction. Owners are the rows of candidates and behind the last of each square the row of `otherwise`; `place` has the owner of a
    row, `beyond` that of the `otherwise` of a square, `square` the square of each owner."""

    forms: Array
    polynomials: Array
    changes: Array
    place: Array
    beyond: Array
    square: Array


class Line(NamedTuple):
    """The lines of edges: number, on which side the cells are (1 or -1), and whether the edge lies on the line that made it."""

    number: Array
    side: Array
    whole: Array


class Edges(NamedTuple):
    """Edges of cells: the cell, where the edge starts and the way to its end, and how both move along the direction, (edges, 2)."""

    cell: Array
    start: Array
    way: Array
    speed: Array
    faster: Array
    line: Line


class Measured:
    """Integrals over arrangements. `bodies` is the number of polynomials of each candidate, `square` has the square of each cell."""

    def __init__(self, shape: Layout, cells: Arrangements, numbers: Numbers, shift: tuple[float, float], square: Array) -> None:
        self.shape, self.cells, self.numbers, self.shift, self.square = shape, cells, numbers, shift, square
        self.exponents = monomials(shape.degree)
        self.width = len(self.exponents)
        self.bodies = numbers.polynomials.shape[1] // self.width
        self.wide = shape.forms + numbers.polynomials.shape[1]
        self.moving = bool(shape.order)
        rows = cells.regions.row
        owned = cells.owner != NO_OWNER
        self.owner = numbers.beyond[square]
        self.owner[owned] = numbers.place[rows[cells.owner[owned]]]
        if self.moving:
            self.rates = self._all_rates()
            self.speed = self._velocities()
        self.moments, self.growths = self._all_moments()

    def values(self, lanes: int) -> tuple[Array, Array]:
        """Returns the integrals, and bounds of those of absolute values: (bodies, squares)."""
        values, sizes = np.zeros((self.bodies, lanes)), np.zeros((self.bodies, lanes))
        for body in range(self.bodies):
            own = self.numbers.polynomials[self.owner, body * self.width : (body + 1) * self.width]
            values[body] = np.bincount(self.square, (own * self.moments).sum(axis=1), lanes)
            sizes[body] = np.bincount(self.square, self.moments[:, 0] * np.abs(own).sum(axis=1), lanes)
        return values, sizes

    def tables(self) -> list[Array]:
        """Returns the derivatives by every number of every owner; at order 1 those of the derivative along the direction first."""
        columns, forms = self.shape.columns, self.shape.forms
        tables = []
        edges = self._all_edges()
        ambiguous = np.zeros(len(self.numbers.beyond), dtype=bool)
        ambiguous[self.square[self.cells.ambiguous[self.cells.lane]]] = True
        for body in range(self.bodies):
            table = np.zeros((len(self.numbers.polynomials), columns * (1 + self.shape.order)))
            _add(table, self.owner, forms, self.growths if self.moving else self.moments)
            if self.moving:
                _add(table, self.owner, columns + forms, self.moments)
            self._edges(edges, slice(body * self.width, (body + 1) * self.width), table)
            if ambiguous.any():
                table[ambiguous[self.numbers.square], : None if self.moving else forms] = np.nan
            tables.append(table)
        return tables

    def _all_rates(self) -> Array:
        """Returns the derivatives of the lines' forms along the direction, divided by |(a, b)|: (lines, 3)."""
        lines = self.cells.lines
        total = np.zeros((len(lines.sizes), 3))
        for part, sign in enumerate((1.0, -1.0)):
            which = np.flatnonzero(lines.rows[:, part] >= 0)
            columns = self.wide + lines.columns[which, part, None] + np.arange(3)[None, :]
            total[which] += sign * self.numbers.forms[lines.rows[which, part, None], columns]
        total[:, 0] += total[:, 1] * self.shift[0] + total[:, 2] * self.shift[1]
        total[lines.late] = np.nan
        return total / lines.sizes[:, None]

    def _velocities(self) -> Array:
        """Returns the derivatives of the corners, (cells, places, 2): each is where the lines of its two edges meet."""
        p = self.cells.polygons
        before = np.where(np.arange(p.labels.shape[1])[None, :] > 0, np.arange(-1, p.labels.shape[1] - 1)[None, :], p.sizes[:, None] - 1)
        x, y = p.corners[..., 0], p.corners[..., 1]
        first, second = np.take_along_axis(p.labels, before, axis=1) >> 1, p.labels >> 1
        units = self.cells.lines.units
        (e, f), (g, h) = (units[line][..., 1:].transpose(2, 0, 1) for line in (first, second))
        r, s = (-(q[..., 0] + q[..., 1] * x + q[..., 2] * y) for q in (self.rates[first], self.rates[second]))
        across = e * h - f * g
        crossing = np.abs(across) > 1e-9
        safe = np.where(crossing, across, 1.0)
        u = np.where(crossing, (r * h - f * s) / safe, 0.5 * (r * e + s * g))
        v = np.where(crossing, (e * s - g * r) / safe, 0.5 * (r * f + s * h))
        return np.stack([u, v], axis=2)

    def _all_moments(self) -> tuple[Array, Array]:
        """Returns the moments of all cells, and their derivatives along the direction: (cells, monomials)."""
        moments = np.zeros((len(self.cells.lane), self.width))
        growths = np.zeros_like(moments) if self.moving else moments
        for which, (x, y), (p, q), weight, growth in self._nodes():
            for k, (i, j) in enumerate(self.exponents):
                at = x**i * y**j
                moments[which, k] += weight * at
                if self.moving:
                    growths[which, k] += growth * at + weight * _slope(i, j, (x, y), (p, q))
        return moments, growths

    def _nodes(self) -> Iterator[tuple[Array, Point, Point, Array, Array]]:
        """Yields nodes of a rule on polygons: which polygons, point, velocity, weight, derivative of the weight."""
        polygons = self.cells.polygons
        for k in range(1, polygons.labels.shape[1] - 1):
            which = np.flatnonzero(polygons.sizes > k + 1)
            start, (a, b), (c, d) = _fan(polygons.corners[which], k)
            from_, (e, f), (g, h) = _fan(self.speed[which], k) if self.moving else ((0.0 * a, 0.0 * a),) * 3
            area = 0.5 * (a * d - c * b)
            growth = 0.5 * (e * d + a * h - g * b - c * f)
            for r, s, w in triangle_rule(self.shape.degree):
                at = start[0] + r * a + s * c, start[1] + r * b + s * d
                speed = from_[0] + r * e + s * g, from_[1] + r * f + s * h
                yield which, at, speed, w * area, w * growth

    def _all_edges(self) -> Edges:
        """Returns the edges of all cells that lie on no side of the square, in parts that belong to one line each."""
        polygons = self.cells.polygons
        cell, place = np.nonzero(polygons.used() & (polygons.labels >= 2 * BOX))
        label, following = polygons.labels[cell, place], polygons.following()[cell, place]
        start, end = polygons.corners[cell, place], polygons.corners[cell, following]
        shares = Twins(self.cells).shares(label >> 1, start, end)
        edge, first, part = shares.edge, shares.first[:, None], (shares.last - shares.first)[:, None]
        way = (end - start)[edge]
        side = np.where(label[edge] & 1, -shares.sign, shares.sign)
        speed = faster = np.zeros_like(way)
        if self.moving:
            speed = self.speed[cell, place][edge]
            faster = self.speed[cell, following][edge] - speed
        return Edges(
            cell[edge],
            start[edge] + first * way,
            part * way,
            speed + first * faster,
            part * faster,
            Line(shares.line, side, shares.whole),
        )

    def _edges(self, edges: Edges, own: slice, table: Array) -> None:
        """Adds what edges give to the derivatives by the forms of their lines."""
        lines, columns = self.cells.lines, self.shape.columns
        plain, changed = self._along_edges(edges, own)
        number, side = edges.line.number, edges.line.side[:, None]
        changed[~edges.line.whole] = np.nan
        for part, sign in enumerate((1.0, -1.0)):
            rows = lines.rows[number, part]
            which = np.flatnonzero(rows >= 0)
            owners, first = self.numbers.place[rows[which]], lines.columns[number[which], part]
            share = sign * side[which]
            if self.moving:
                _add(table, owners, first, share * changed[which])
                _add(table, owners, columns + first, share * plain[which])
            else:
                _add(table, owners, first, share * plain[which])

    def _along_edges(self, edges: Edges, own: slice) -> tuple[Array, Array]:
        """Returns ∫ f·(1, u, v) ds/|(a, b)| along edges, and its derivatives along the direction: (edges, 3)."""
        lines, number, way, faster = self.cells.lines, edges.line.number, edges.way, edges.faster
        length = np.hypot(way[:, 0], way[:, 1])
        body, moving = (n[self.owner[edges.cell], own] for n in (self.numbers.polynomials, self.numbers.changes))
        plain, changed = np.zeros((len(length), 3)), np.zeros((len(length), 3))
        stretch = np.zeros(len(length))
        if self.moving:
            safe = np.where(length > 0.0, length, 1.0)
            stretch = (way * faster).sum(axis=1) / (safe * safe) * (length > 0.0)
            stretch -= (lines.units[number, 1:] * self.rates[number, 1:]).sum(axis=1)
        for node, weight in zip(*gauss_legendre((self.shape.degree + 1) // 2 + 1), strict=True):
            t = 0.5 + 0.5 * node
            (x, y), (p, q) = (edges.start + t * way).T, (edges.speed + t * faster).T
            h = 0.5 * weight * length / lines.sizes[number]
            f = self._polynomial(body, x, y)
            for k, at in enumerate((1.0, x, y)):
                plain[:, k] += h * f * at
            if not self.moving:
                continue
            df = self._polynomial(moving, x, y) + f * stretch
            for k, (i, j) in enumerate(self.exponents):
                df += body[:, k] * _slope(i, j, (x, y), (p, q))
            for k, (at, slope) in enumerate(((1.0, 0.0), (x, p), (y, q))):
                changed[:, k] += h * (df * at + f * slope)
        return plain, changed

    def _polynomial(self, coefficients: Array, x: Array, y: Array) -> Array:
        return sum((coefficients[:, k] * x**i * y**j for k, (i, j) in enumerate(self.exponents)), start=np.zeros(len(x)))


def _fan(points: Array, k: int) -> Sequence[Point]:
    """Returns the first point, and the ways from it to point k and the next one."""
    x0, y0 = points[:, 0, 0], points[:, 0, 1]
    return [(x0, y0), *((points[:, i, 0] - x0, points[:, i, 1] - y0) for i in (k, k + 1))]


def _slope(i: int, j: int, at: Point, speed: Point) -> Array:
    """Returns the derivative of xⁱyʲ along a velocity."""
    (x, y), (p, q) = at, speed
    rising = i * x ** (i - 1) * y**j * p if i else 0.0 * p
    return rising + (j * x**i * y ** (j - 1) * q if j else 0.0)


def _add(table: Array, rows: Array, first: Array | int, numbers: Array) -> None:
    """Adds rows of numbers to rows of a table, from their first column on; rows may repeat."""
    width = table.shape[1]
    places = (rows * width + first)[:, None] + np.arange(numbers.shape[1])[None, :]
    table += np.bincount(places.ravel(), numbers.ravel(), table.size).reshape(table.shape)
