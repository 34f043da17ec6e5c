"""Known points of half-planes: surfaces that are sides from vertex to vertex, and half-planes that make a triangle.

    g(x, y) = (x₁ - x₀)·(y - y₀) - (y₁ - y₀)·(x - x₀) > 0        A = (x₀, y₀), B = (x₁, y₁)
    ∫∫ w δ(g) dx dy = ∫₀¹ w(A + s·(B - A))·[in the box] ds       where other conditions hold between A and B only

The points that an atom knows are those points (p, q) on its line whose coordinates it compares with x and y, as x - p and y - q, and the
ends of its direction (∂g/∂y, -∂g/∂x) from there. If the other sides through A and B are positive multiples of one number at the other
end, as in a triangle, the support lies between A and B, if it is not empty: the side is *whole*. Else its extent is decided at run time.

Whether functions vanish, or are proportional, is decided in the finite field of `teg.analysis.polynomial`.
Source: Liang and Barsky 1984 (a segment by its ends, clipped by a box).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import expanded
from teg.analysis.polynomial import Shadow
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, And, Compare, Cond, Expr, Mul, Not, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, div, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.numerics.field import P, divided

MAX_POINTS = 128
"""A longer conjunction is not searched for sides, which would cost every pair of a side and a point."""
MAX_SIDES = 8
"""Among more half-planes no triangle is searched for."""
SMALL = {divided(m, 2**k): m / 2**k for k in range(4) for m in range(-16, 17) if m}

Point = tuple[Expr, Expr]


@dataclass(frozen=True)
class Side:
    """The line of a surface by two points of it, `start` and `end`, and |end - start|/|∇g|.

    Also the values, with the sign they have in the support, of other sides: of those through `start` at `end`, and of those through
    `end` at `start`. `whole`: all of these are positive where one is.
    """

    start: Point
    end: Point
    weight: Expr
    beyond: tuple[Expr, ...]
    before: tuple[Expr, ...]
    whole: bool

    @property
    def direction(self) -> Point:
        """Returns end - start."""
        (ax, ay), (bx, by) = self.start, self.end
        return sub(bx, ax), sub(by, ay)

    def at(self, s: Expr) -> Point:
        """Returns the point of the chart."""
        dx, dy = self.direction
        return add(self.start[0], mul(dx, s)), add(self.start[1], mul(dy, s))

    def reach(self, box: Sequence[tuple[Expr, Expr]]) -> tuple[Expr, Expr, Cond]:
        """Returns the bounds of s between which the support lies, in a box, and the condition that the two points differ."""
        if self.whole:
            return ZERO, ONE, TRUE
        length = add(*(call("magnitude", d) for d in self.direction))
        away = add(*(call("magnitude", sub(end, p)) for p, ends in zip(self.start, box, strict=True) for end in ends))
        far = call("floor", mul(const(2.0), div(away, length)))  # rounded, and so without a derivative: the integrand is 0 there
        lo, hi = sub(MINUS_ONE, far), add(const(2.0), far)
        lo = where(positive(self.beyond[0]), ZERO, lo) if self.beyond else lo
        hi = where(positive(self.before[0]), ONE, hi) if self.before else hi
        return lo, hi, positive(length)


@dataclass(frozen=True)
class Line:
    """An affine function, +1 or -1 for its sign in the support, its coefficients in the field, and the points it knows."""

    g: Expr
    sign: int
    coefficients: tuple[int, int, int]
    points: tuple[Point, ...]


def match_side(g: Expr, support: Cond, variables: tuple[Var, Var]) -> Side | None:
    """Returns the side of a polygon that a surface is in a support, if other sides run through one or both of its ends; else None."""
    plane = Plane(variables)
    mine = plane.line(g)
    if mine is None:
        return None
    others = [line for line in map(plane.part, _conjuncts(support)) if line is not None and line.g is not g]
    if not 1 <= len(others) <= MAX_POINTS:
        return None
    points = plane.distinct(dict.fromkeys(p for line in (mine, *others) for p in line.points), mine)
    side = _between(plane, mine, others, points)
    if side is not None and side.beyond and side.before:
        return side
    ends = dict.fromkeys(p for line in (mine, *others) for p in (*line.points, *plane.ends(line)))
    return _between(plane, mine, others, plane.distinct(ends, mine)) or side


def _between(plane: Plane, mine: Line, others: Sequence[Line], points: Sequence[Point]) -> Side | None:
    """Returns the best side between two of these points: a whole one, one that others limit at both ends, or at one."""
    through = [[line for line in others if plane.at(line, p) == 0] for p in points]
    best: tuple[int, Side] | None = None
    for i, j in ((i, j) for i in range(len(points)) for j in range(len(points)) if i != j):
        start, end = points[i], points[j]
        first = [line for line in through[i] if plane.at(line, end)]
        last = [line for line in through[j] if plane.at(line, start)]
        if not first and not last:
            continue
        values = [cast(int, plane.at(line, end)) for line in first] + [cast(int, plane.at(line, start)) for line in last]
        whole = bool(first and last) and all(ratio(v, values[0]) > 0 for v in values)
        rank = 2 * whole + bool(first and last)
        if best is None or rank > best[0]:
            beyond, before = (tuple(plane.signed(line, p) for line in lines) for lines, p in ((first, end), (last, start)))
            best = rank, Side(start, end, plane.weight(mine, start, end), beyond, before, whole)
    return None if best is None else best[1]


def ratio(value: int, other: int) -> float:
    """Returns the quotient of two elements of the field if it is a small fraction; else NaN."""
    fraction = SMALL.get(divided(value, other))
    return math.nan if fraction is None else fraction


@dataclass(frozen=True)
class Triangle:
    """Three points, and three lines by their numbers: line k is 0 at the other two points, and `across` at point k."""

    points: tuple[Point, Point, Point]
    lines: tuple[int, int, int]
    across: Expr


def match_triangle(halves: Sequence[tuple[Expr, bool]], variables: tuple[Var, Var]) -> Triangle | None:
    """Returns the triangle that three of the half-planes make of known points, with equal values across; None if there is none.

    Half-planes are given as g and whether they are negated.
    """
    if not 3 <= len(halves) <= MAX_SIDES:
        return None
    plane = Plane(variables)
    candidates = [plane.line(g, -1 if negated else 1) for g, negated in halves]
    lines = [line for line in candidates if line is not None]
    if len(lines) < len(halves):
        return None
    points = dict.fromkeys(p for line in lines for p in (*line.points, *plane.ends(line)))
    places = [plane.distinct(points, line) for line in lines]
    for i, (first, on_it) in enumerate(zip(lines, places, strict=True)):
        for end, start in permutations(on_it, 2):
            second = next((j for j, line in enumerate(lines) if plane.at(line, start) == 0 and plane.at(line, end)), None)
            third = next((j for j, line in enumerate(lines) if plane.at(line, end) == 0 and plane.at(line, start)), None)
            if second is None or third is None or plane.at(lines[second], end) != plane.at(lines[third], start):
                continue
            for apex in places[second]:
                if plane.at(lines[third], apex) == 0 and plane.at(first, apex) == plane.at(lines[third], start):
                    return Triangle((apex, end, start), (i, second, third), plane.signed(first, apex))
    return None


def _conjuncts(support: Cond) -> Sequence[Node]:
    return support.children if isinstance(support, And) else (support,)


class Plane:
    """Points and lines of the plane of two variables, over the field."""

    def __init__(self, variables: tuple[Var, Var]) -> None:
        self.variables = variables
        self._shadow = Shadow(variables)

    def part(self, condition: Node) -> Line | None:
        """Returns the line of a condition in a conjunction."""
        atom = condition.operand if isinstance(condition, Not) else condition
        if not isinstance(atom, Compare) or atom.resolution is not None:
            return None
        return self.line(atom.g, -1 if isinstance(condition, Not) else 1)

    def line(self, g: Expr, sign: int = 1) -> Line | None:
        """Returns the line g = 0, if g is affine; else None."""
        if not any(v in g.free for v in self.variables):
            return None
        coefficients = self.coefficients(g)
        if coefficients is None or not any(coefficients[:2]):
            return None
        line = Line(g, sign, tuple(sign * c % P for c in coefficients), ())  # type: ignore[arg-type]
        columns = [_compared(g, v, self.variables) for v in self.variables]
        points = [(p, q) for p in columns[0] for q in columns[1] if self.at(line, (p, q)) == 0]
        return Line(g, sign, line.coefficients, tuple(points))

    def coefficients(self, e: Expr) -> tuple[int, int, int] | None:
        """Returns a, b and c of a·x + b·y + c, or None for other expressions."""
        poly = self._shadow.polynomial(e)
        if poly is None or any(sum(m) > 1 for m in poly):
            return None
        return poly.get((1, 0), 0), poly.get((0, 1), 0), poly.get((0, 0), 0)

    def ends(self, line: Line) -> list[Point]:
        """Returns the points that the direction of a line leads to from its known points, forth and back, written out."""
        ends = []
        for start in line.points[:2]:
            try:
                gx, gy = (cast(Expr, substitute(slope(line.g, v), dict(zip(self.variables, start, strict=True)))) for v in self.variables)
            except NotDifferentiableError:
                return []
            for back in (ONE, MINUS_ONE):
                p, q = (expanded(e) for e in (add(start[0], mul(back, gy)), sub(start[1], mul(back, gx))))
                if p is not None and q is not None and len(postorder([p, q])) <= 4:  # two names, not a formula
                    ends.append((p, q))
        return ends

    def value(self, e: Expr) -> int | None:
        """Returns the value in the field of an expression without the variables."""
        poly = self._shadow.polynomial(e)
        return None if poly is None or any(sum(m) for m in poly) else poly.get((0, 0), 0)

    def at(self, line: Line, point: Point) -> int | None:
        """Returns the value of a line's function at a point, with its sign in the support."""
        p, q = self.value(point[0]), self.value(point[1])
        if p is None or q is None:
            return None
        a, b, c = line.coefficients
        return (a * p + b * q + c) % P

    def signed(self, line: Line, point: Point) -> Expr:
        """Returns the same as an expression."""
        return mul(const(float(line.sign)), cast(Expr, substitute(line.g, dict(zip(self.variables, point, strict=True)))))

    def distinct(self, points: Iterable[Point], line: Line) -> list[Point]:
        """Returns the distinct points on a line."""
        kept: dict[tuple[int | None, int | None], Point] = {}
        for point in points:
            if len(kept) < MAX_POINTS and self.at(line, point) == 0:
                kept.setdefault((self.value(point[0]), self.value(point[1])), point)
        return list(kept.values())

    def weight(self, line: Line, start: Point, end: Point) -> Expr:
        """Returns |end - start|/|∇g|, a number if the distance of the points is a multiple of the slope of g."""
        dx, dy = sub(end[0], start[0]), sub(end[1], start[1])
        along, across = (self.value(dx), line.coefficients[1]) if line.coefficients[1] else (self.value(dy), line.coefficients[0])
        size = ratio(cast(int, along), across)
        if not math.isnan(size):
            return const(abs(size))
        gx, gy = (slope(line.g, v) for v in self.variables)
        sizes = [call("magnitude", e) for e in (dx, dy, gx, gy)]
        return where(positive(sub(sizes[0], sizes[1]), strict=False), div(sizes[0], sizes[3]), div(sizes[1], sizes[2]))


def _compared(g: Expr, v: Var, variables: tuple[Var, Var]) -> list[Expr]:
    """Returns the expressions p with which a variable is compared: those of v - p."""
    compared: dict[Expr, None] = {}
    for node in postorder([g]):
        if isinstance(node, Mul) and v in node.children:
            compared[ZERO] = None
        if not isinstance(node, Add) or v not in node.free:
            continue
        for sign, term in ((MINUS_ONE, v), (ONE, mul(MINUS_ONE, v))):
            if term in node.children:
                others = add(*(c for c in cast("Sequence[Expr]", node.children) if c is not term))
                if not any(w in others.free for w in variables):
                    compared[mul(sign, others)] = None
    return list(compared)
