"""Sides of polygons: where the surface of an atom is the line through two known points, the part of it between them is its chart.

    g(x, y) = (x₁ - x₀)·(y - y₀) - (y₁ - y₀)·(x - x₀) > 0        A = (x₀, y₀), B = (x₁, y₁)
    ∫∫ w δ(g) dx dy = ∫₀¹ w(A + s·(B - A))·[in the box] ds       where other conditions hold between A and B only

The *points* an atom knows are the pairs (p, q) of what x and y are compared with in it, x - p and y - q, where it vanishes, and the ends of
its direction (∂g/∂y, -∂g/∂x) from there. On the chart every affine function is given by its values at A and B: a side that shares A is
s·g(B), zero at s = 0 whatever the angle between them, and its condition is that of the number g(B). So nothing that is nearly parallel
is intersected, and a sliver's boundary term is exact to rounding. What is affine on the chart with coefficients among 1, x₁ - x₀, y₁ - y₀
and g(B), up to a small fraction, is written so: a barycentric coordinate becomes s, 1 - s or 0.

Whether functions vanish, or are proportional, is asked in the finite field of `teg.polynomial`.
Source: Liang and Barsky 1984 (a segment by its ends, clipped by a box).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from teg.calculus import slope
from teg.errors import NotDifferentiableError
from teg.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
    Add,
    And,
    Compare,
    Cond,
    Expr,
    Mul,
    Not,
    Pow,
    Var,
    add,
    call,
    const,
    div,
    mul,
    positive,
    sub,
    where,
)
from teg.node import Node, postorder
from teg.polynomial import P, Shadow, expanded
from teg.traverse import rewrite, substitute

MAX_POINTS = 128
"""Of a longer conjunction the sides are not looked at: every pair of a side and a point would be."""
_SMALL = {m * pow(2**k, -1, P) % P: m / 2**k for k in range(4) for m in range(-16, 17) if m}

Point = tuple[Expr, Expr]


@dataclass(frozen=True)
class Side:
    """The line of a surface by two points of it, `start` and `end`, between which a support lies; `weight` is |end - start|/|∇g|, and
    `across` what another side through one of the points is at the other one."""

    start: Point
    end: Point
    weight: Expr
    across: Expr

    @property
    def direction(self) -> Point:
        """end - start."""
        (ax, ay), (bx, by) = self.start, self.end
        return sub(bx, ax), sub(by, ay)

    def at(self, s: Expr) -> Point:
        """The point of the chart."""
        dx, dy = self.direction
        return add(self.start[0], mul(dx, s)), add(self.start[1], mul(dy, s))


@dataclass(frozen=True)
class _Line:
    """An affine function, +1 or -1 for the sign it has in the support, its coefficients in the field, and the points it knows."""

    g: Expr
    sign: int
    coefficients: tuple[int, int, int]
    points: tuple[Point, ...]


def match_side(g: Expr, support: Cond, variables: tuple[Var, Var]) -> Side | None:
    """The side that a surface is in a support, if it is one of a triangle: two others run through the ends of it, and both are positive at
    the other end where one is."""
    plane = _Plane(variables)
    mine = plane.line(g)
    if mine is None:
        return None
    others = [line for line in map(plane.part, _conjuncts(support)) if line is not None and line.g is not g]
    if not 2 <= len(others) <= MAX_POINTS:
        return None
    points = plane.distinct((*mine.points, *(p for line in others for p in line.points)), mine)
    through = [[line for line in others if plane.at(line, p) == 0] for p in points]
    for i, start in enumerate(points):
        for j, end in enumerate(points):
            if i == j:
                continue
            pairs = [(a, b) for a in through[i] for b in through[j] if plane.at(a, end) and plane.at(b, start)]
            for a, b in pairs:
                if _SMALL.get(plane.at(a, end) * pow(plane.at(b, start), -1, P) % P, -1.0) > 0:
                    across = cast(Expr, substitute(a.g, dict(zip(variables, end, strict=True))))
                    return Side(start, end, plane.weight(mine, start, end), across)
    return None


def _conjuncts(support: Cond) -> Sequence[Node]:
    return support.children if isinstance(support, And) else (support,)


class _Plane:
    """Points and lines of the plane of two variables, over the field."""

    def __init__(self, variables: tuple[Var, Var]) -> None:
        self.variables = variables
        self._shadow = Shadow(variables)

    def part(self, condition: Node) -> _Line | None:
        """The line of a condition in a conjunction."""
        atom = condition.operand if isinstance(condition, Not) else condition
        if not isinstance(atom, Compare) or atom.resolution is not None:
            return None
        return self.line(atom.g, -1 if isinstance(condition, Not) else 1)

    def line(self, g: Expr, sign: int = 1) -> _Line | None:
        """The line g = 0, if it is one."""
        if not any(v in g.free for v in self.variables):
            return None
        poly = self._shadow.polynomial(g)
        if poly is None or any(sum(m) > 1 for m in poly):
            return None
        coefficients = (poly.get((1, 0), 0), poly.get((0, 1), 0), poly.get((0, 0), 0))
        if not any(coefficients[:2]):
            return None
        line = _Line(g, sign, tuple(sign * c % P for c in coefficients), ())  # type: ignore[arg-type]
        columns = [_compared(g, v, self.variables) for v in self.variables]
        found = [(p, q) for p in columns[0] for q in columns[1] if self.at(line, (p, q)) == 0]
        return _Line(g, sign, line.coefficients, (*found, *(end for p in found[:2] for end in self._ends(g, p))))

    def _ends(self, g: Expr, start: Point) -> list[Point]:
        """Where the direction of a line leads from a point of it, there and back, written out."""
        try:
            gx, gy = (cast(Expr, substitute(slope(g, v), dict(zip(self.variables, start, strict=True)))) for v in self.variables)
        except NotDifferentiableError:
            return []
        ends = []
        for back in (ONE, MINUS_ONE):
            p, q = (expanded(e) for e in (add(start[0], mul(back, gy)), sub(start[1], mul(back, gx))))
            if p is not None and q is not None and len(postorder([p, q])) <= 4:  # two names, not a formula
                ends.append((p, q))
        return ends

    def value(self, e: Expr) -> int | None:
        """An expression without the variables in the field."""
        poly = self._shadow.polynomial(e)
        return None if poly is None or any(sum(m) for m in poly) else poly.get((0, 0), 0)

    def at(self, line: _Line, point: Point) -> int | None:
        """The value of a line's function, as it counts in the support, at a point."""
        p, q = self.value(point[0]), self.value(point[1])
        if p is None or q is None:
            return None
        a, b, c = line.coefficients
        return (a * p + b * q + c) % P

    def distinct(self, points: Iterable[Point], line: _Line) -> list[Point]:
        """The points on a line, once each."""
        found: dict[tuple[int | None, int | None], Point] = {}
        for point in points:
            if len(found) < MAX_POINTS and self.at(line, point) == 0:
                found.setdefault((self.value(point[0]), self.value(point[1])), point)
        return list(found.values())

    def weight(self, line: _Line, start: Point, end: Point) -> Expr:
        """|end - start|/|∇g|: a number where the points are as far apart as g is steep."""
        dx, dy = sub(end[0], start[0]), sub(end[1], start[1])
        along, across = (self.value(dx), line.coefficients[1]) if line.coefficients[1] else (self.value(dy), line.coefficients[0])
        ratio = _SMALL.get(cast(int, along) * pow(across, -1, P) % P)
        if ratio is not None:
            return const(abs(ratio))
        gx, gy = (slope(line.g, v) for v in self.variables)
        sizes = [call("magnitude", e) for e in (dx, dy, gx, gy)]
        return where(positive(sub(sizes[0], sizes[1]), strict=False), div(sizes[0], sizes[3]), div(sizes[1], sizes[2]))


def _compared(g: Expr, v: Var, variables: tuple[Var, Var]) -> list[Expr]:
    """What a variable is compared with: p of v - p."""
    found: dict[Expr, None] = {}
    for node in postorder([g]):
        if isinstance(node, Mul) and v in node.children:
            found[ZERO] = None
        if not isinstance(node, Add) or v not in node.free:
            continue
        for sign, term in ((MINUS_ONE, v), (ONE, mul(MINUS_ONE, v))):
            if term in node.children:
                rest = add(*(cast(Expr, c) for c in node.children if c is not term))
                if not any(w in rest.free for w in variables):
                    found[mul(sign, rest)] = None
    return list(found)


class Along:
    """Expressions on the chart of a side, of `unit` in (0, 1), with what is affine there by its values at the ends."""

    def __init__(self, side: Side, unit: Var) -> None:
        self.unit = unit
        self._shadow = Shadow((unit,))
        self._rest = sub(ONE, unit)
        self._known: dict[int, Expr] = {}
        for e in (side.across, *side.direction, ONE):
            value = self._shadow.polynomial(e)
            for small, factor in _SMALL.items() if value else ():
                self._known[cast("Mapping[tuple[int, ...], int]", value)[0,] * small % P] = mul(const(factor), e)

    def simplified(self, e: Expr) -> Expr:
        """The same on the open chart; conditions on a side that shares an end are conditions on a number."""
        return cast(Expr, rewrite([e], self._visit)[e])

    def _visit(self, old: Node, node: Node) -> Node:
        if self.unit not in old.free:
            return node
        if isinstance(old, Compare):
            return self._atom(old, cast(Compare, node)) if isinstance(node, Compare) else node
        if isinstance(old, Add | Mul | Pow):
            exact = self._exact(old)
            return node if exact is None else exact
        return node

    def _ends(self, e: Expr) -> tuple[int, int] | None:
        """The values at 0 and at 1 in the field of what is affine."""
        poly = self._shadow.polynomial(e)
        if poly is None or any(m[0] > 1 for m in poly):
            return None
        first = poly.get((0,), 0)
        return first, (first + poly.get((1,), 0)) % P

    def _number(self, value: int) -> Expr | None:
        return self._known.get(value) if value else ZERO

    def _exact(self, e: Expr) -> Expr | None:
        ends = self._ends(e)
        if ends is None:
            return None
        first, rate = self._number(ends[0]), self._number((ends[1] - ends[0]) % P)
        if ends[1] == 0 and first is not None:
            return mul(first, self._rest)
        return None if first is None or rate is None else add(first, mul(rate, self.unit))

    def _atom(self, old: Compare, node: Compare) -> Cond:
        ends = self._ends(old.g)
        if ends is None or not any(ends):
            return node
        resolution = cast("Cond | None", node.resolution)
        first, last = (self._at(end, value, node.g) for end, value in zip((ZERO, ONE), ends, strict=True))
        if first is ZERO or last is ZERO or first is last:
            return positive(first if last is ZERO else last, old.strict, resolution, old.rivals)
        return positive(add(mul(first, self._rest), mul(last, self.unit)), old.strict, resolution, old.rivals)

    def _at(self, end: Expr, value: int, g: Expr) -> Expr:
        known = self._number(value)
        if known is not None:
            return known
        e = cast(Expr, substitute(g, {self.unit: end}))
        short = expanded(e, 4)
        return e if short is None else short
