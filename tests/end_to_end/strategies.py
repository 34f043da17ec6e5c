"""Random programs of affine brackets and smooth factors, each with an integrator of its own that shares nothing with the compiler.

A `Scene` is an integrand in two forms that were built side by side: as an expression, and as a NumPy function. The reference integral
cuts the box into convex cells along every line and takes a Gauss rule of high order on each, so it sees no jump.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

import teg

Array = Any
Function = Callable[[dict[str, float], Array, Array], Array]
Line = Callable[[dict[str, float]], tuple[float, float, float]]
Point = tuple[float, float]

x, y = teg.vars("x y")
PARAMETERS = teg.params("p0 p1 p2 p3")
NODES = 60
_GAUSS, _WEIGHTS = (a.copy() for a in np.polynomial.legendre.leggauss(NODES))


@dataclass(frozen=True)
class Part:
    """An expression or condition, the same as a NumPy function, and the lines a·x + b·y + c = 0 where it jumps or has a kink."""

    node: Any
    function: Function
    lines: tuple[Line, ...] = ()


@dataclass(frozen=True)
class Scene:
    """An integrand over a box, at parameter values."""

    part: Part
    values: dict[str, float]
    box: tuple[float, float, float, float]
    dimension: int

    @property
    def integrand(self) -> teg.Expr:
        return self.part.node  # type: ignore[no-any-return]

    @property
    def expression(self) -> teg.Expr:
        return self.over(self.integrand)

    def over(self, integrand: teg.Expr) -> teg.Expr:
        """The integral of another integrand over this box."""
        x0, x1, y0, y1 = self.box
        domain = ((x, x0, x1), (y, y0, y1))[: self.dimension]
        return teg.integral(integrand, *domain)

    @property
    def parameters(self) -> list[teg.Expr]:
        return list(PARAMETERS)

    def reference(self) -> float:
        """The integral, cell by cell."""
        x0, x1, y0, y1 = self.box
        lines = [line(self.values) for line in self.part.lines]
        if self.dimension == 1:
            roots = [-c / a for a, _, c in lines if a != 0]
            ends = sorted({x0, x1, *(r for r in roots if x0 < r < x1)})
            return math.fsum(self._piece(p, q) for p, q in itertools.pairwise(ends))
        cells: list[list[Point]] = [[(x0, y0), (x1, y0), (x1, y1), (x0, y1)]]
        for line in lines:
            cells = [part for cell in cells for part in _split(cell, line)]
        return math.fsum(self._cell(cell) for cell in cells)

    def _piece(self, p: float, q: float, depth: int = 4) -> float:
        """The integral from p to q; halves where their sum is another number than the whole."""
        middle = 0.5 * (p + q)
        whole, halves = self._gauss(p, q), self._gauss(p, middle) + self._gauss(middle, q)
        if depth == 0 or abs(whole - halves) <= 1e-13 * (1 + abs(halves)):
            return halves
        return self._piece(p, middle, depth - 1) + self._piece(middle, q, depth - 1)

    def _gauss(self, p: float, q: float) -> float:
        xs = 0.5 * (p + q) + 0.5 * (q - p) * _GAUSS
        return float(np.sum(_WEIGHTS * np.broadcast_to(self.part.function(self.values, xs, 0.0), xs.shape)) * 0.5 * (q - p))

    def _cell(self, cell: list[Point]) -> float:
        first, *rest = cell
        return math.fsum(self._triangle(first, b, c) for b, c in itertools.pairwise(rest))

    def _triangle(self, a: Point, b: Point, c: Point, depth: int = 3) -> float:
        """The integral over a triangle; four triangles where their sum is another number than the whole."""
        (ab, bc, ca) = (((p[0] + q[0]) / 2, (p[1] + q[1]) / 2) for p, q in ((a, b), (b, c), (c, a)))
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        whole, quarters = self._duffy(a, b, c), math.fsum(self._duffy(*part) for part in parts)
        if depth == 0 or abs(whole - quarters) <= 1e-13 * (1 + abs(quarters)):
            return quarters
        return math.fsum(self._triangle(*part, depth - 1) for part in parts)

    def _duffy(self, a: Point, b: Point, c: Point) -> float:
        """The integral over a triangle by a product rule on the square that is contracted to `a` on one side."""
        u, w = 0.5 * (1 + _GAUSS), 0.5 * _WEIGHTS
        s, r = np.meshgrid(u, u)
        (ax, ay), (bx, by), (cx, cy) = a, b, c
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        xs = ax + s * ((bx - ax) * (1 - r) + (cx - ax) * r)
        ys = ay + s * ((by - ay) * (1 - r) + (cy - ay) * r)
        values = np.broadcast_to(self.part.function(self.values, xs, ys), xs.shape)
        return area * float(np.sum(np.outer(w, w) * s * values))


def _split(cell: list[Point], line: tuple[float, float, float]) -> list[list[Point]]:
    """A convex polygon cut along a line."""
    a, b, c = line
    sides = [a * px + b * py + c for px, py in cell]
    parts: tuple[list[Point], list[Point]] = ([], [])
    for (p, q), (f, g) in zip(zip(cell, [*cell[1:], cell[0]], strict=True), zip(sides, [*sides[1:], sides[0]], strict=True), strict=True):
        for k, sign in enumerate((1, -1)):
            if sign * f >= 0:
                parts[k].append(p)
            if f * g < 0:
                t = f / (f - g)
                parts[k].append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    return [part for part in parts if len(part) > 2]


@st.composite
def atoms(draw: st.DrawFn, dimension: int) -> Part:
    """k·x + m·y + c against a parameter, or a parameter times a variable against a number; strict or not."""
    k = draw(st.sampled_from([1.0, -1.0, 0.5, 2.0, -3.0, 0.0] if dimension == 2 else [1.0, -1.0, 0.5, 2.0, -3.0]))
    m = draw(st.sampled_from([1.0, -1.0, 0.25, -2.0])) if dimension == 2 else 0.0
    p = draw(st.sampled_from(PARAMETERS))
    name = p.name
    strict = draw(st.booleans())
    if dimension == 2 and draw(st.booleans()):
        q = draw(st.sampled_from(PARAMETERS))
        left, right = k * x + q * y, p
        line: Line = lambda v: (k, v[q.name], -v[name])  # noqa: E731
        f: Function = lambda v, X, Y: v[name] - (k * X + v[q.name] * Y)  # noqa: E731
    else:
        left, right = (k * x + m * y if dimension == 2 else k * x), p
        line = lambda v: (k, m, -v[name])  # noqa: E731
        f = lambda v, X, Y: v[name] - (k * X + m * Y)  # noqa: E731
    node = left < right if strict else left <= right
    return Part(node, lambda v, X, Y: f(v, X, Y) > 0, (line,))


@st.composite
def conditions(draw: st.DrawFn, dimension: int, depth: int = 2) -> Part:
    """Atoms joined by & | ~."""
    kind = draw(st.sampled_from(["atom", "and", "or", "not"])) if depth else "atom"
    if kind == "atom":
        return draw(atoms(dimension))
    a = draw(conditions(dimension, depth - 1))
    if kind == "not":
        return Part(~a.node, lambda v, X, Y: ~a.function(v, X, Y), a.lines)
    b = draw(conditions(dimension, depth - 1))
    if kind == "and":
        return Part(a.node & b.node, lambda v, X, Y: a.function(v, X, Y) & b.function(v, X, Y), a.lines + b.lines)
    return Part(a.node | b.node, lambda v, X, Y: a.function(v, X, Y) | b.function(v, X, Y), a.lines + b.lines)


@st.composite
def smooth_factors(draw: st.DrawFn, dimension: int) -> Part:
    """A smooth function of variables and a parameter."""
    p = draw(st.sampled_from(PARAMETERS))
    name = p.name
    factors = [
        Part(1 + p * x, lambda v, X, Y: 1 + v[name] * X),
        Part(x**2 - p, lambda v, X, Y: X**2 - v[name]),
        Part(teg.exp(p * x), lambda v, X, Y: np.exp(v[name] * X)),
        Part(teg.cos(2 * x + p), lambda v, X, Y: np.cos(2 * X + v[name])),
        Part(1 / (x + 4), lambda v, X, Y: 1 / (X + 4)),
        Part(p + 2, lambda v, X, Y: v[name] + 2 + 0 * X),
    ]
    if dimension == 2:
        factors += [
            Part(x * y + p, lambda v, X, Y: X * Y + v[name]),
            Part(teg.sin(y - p * x), lambda v, X, Y: np.sin(Y - v[name] * X)),
            Part((x + 2 * y) ** 3, lambda v, X, Y: (X + 2 * Y) ** 3),
        ]
    return draw(st.sampled_from(factors))


@st.composite
def integrands(draw: st.DrawFn, dimension: int) -> Part:
    """Σ factor·[condition], possibly under a non-linear function: jumps belong to the whole integrand."""
    parts = []
    for _ in range(draw(st.integers(1, 3 if dimension == 1 else 2))):
        c, f = draw(conditions(dimension)), draw(smooth_factors(dimension))
        other = draw(st.sampled_from([0.0, 1.0, -0.5]))
        parts.append(
            Part(
                teg.where(c.node, f.node, other),
                lambda v, X, Y, c=c, f=f, other=other: np.where(c.function(v, X, Y), f.function(v, X, Y), other),  # type: ignore[misc]
                c.lines,
            )
        )
    total = Part(
        sum((p.node for p in parts[1:]), parts[0].node),
        lambda v, X, Y: sum(p.function(v, X, Y) for p in parts),
        sum((p.lines for p in parts), ()),
    )
    wrap = draw(st.sampled_from(["none", "none", "square", "sine"]))
    if wrap == "square":
        return Part(total.node**2, lambda v, X, Y: total.function(v, X, Y) ** 2, total.lines)
    if wrap == "sine":
        return Part(teg.sin(total.node), lambda v, X, Y: np.sin(total.function(v, X, Y)), total.lines)
    return total


@st.composite
def scenes(draw: st.DrawFn, dimension: int) -> Scene:
    """A program at parameter values in general position: ties have probability nearly 0, and tests of their own."""
    values = {p.name: draw(st.integers(-150, 150)) / 100 + (i + 1) * math.sqrt(2) / 1000 for i, p in enumerate(PARAMETERS)}
    box = draw(st.sampled_from([(0.0, 1.0, 0.0, 1.0), (-1.0, 1.0, -1.0, 1.0), (-0.5, 2.0, 0.25, 1.0)]))
    return Scene(draw(integrands(dimension)), values, box, dimension)
