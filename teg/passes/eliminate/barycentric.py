"""Expressions by their values at vertices: on a side of a polygon, and in a triangle.

On the chart A + s·(B - A) an affine function g is (1 - s)·g(A) + s·g(B). If it is 0 at A it is s·g(B), 0 at s = 0 exactly, whatever the
angle between its line and the side; on a whole side its condition is that of the number g(B). So nearly parallel lines are never
intersected, and the boundary term of a sliver is exact to rounding. In a triangle a function is Σ λₖ·g(pₖ) in the same way. A function
whose values are small fractions of 1, of the area, or of B - A, is written by these: a barycentric coordinate becomes s, 1 - s or 0, or
λₖ itself, however the user wrote the area that it is divided by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from teg.analysis.expanded import expanded
from teg.analysis.polynomial import Shadow
from teg.ir.expr import FALSE, ONE, TRUE, ZERO, Add, Compare, Cond, Const, Expr, Mul, Pow, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, integer_power, mul, positive, sub
from teg.ir.traverse import rewrite, substitute
from teg.numerics.field import P
from teg.passes.eliminate.vertices import SMALL, Plane, Side, Triangle, ratio


class Along:
    """Expressions on the chart of a side, of `unit` in (0, 1). Affine ones are written by their values at the ends."""

    def __init__(self, side: Side, unit: Var) -> None:
        self.unit = unit
        self._whole = side.whole
        self._shadow = Shadow((unit,))
        self._rest = sub(ONE, unit)
        self._known: dict[int, Expr] = {}
        for e in (*side.before, *reversed(side.beyond), *side.direction, ONE):
            value = self._constant(e)
            for small, factor in SMALL.items() if value else ():
                self._known[value * small % P] = mul(const(factor), e)
        self._across = self._constant((*side.beyond, *side.before)[0])

    def _constant(self, e: Expr) -> int:
        """Returns the value in the field of an expression that does not depend on the unit; 0 also if that is not known."""
        return (self._shadow.polynomial(e) or {}).get((0,), 0)

    def simplified(self, e: Expr) -> Expr:
        """Returns the same on the open chart. On a whole side, conditions on another side through an end of it become conditions on a
        number."""
        return cast(Expr, rewrite([e], self._visit)[e])

    def _visit(self, old: Node, node: Node) -> Node:
        if self.unit not in old.free:
            return node
        if isinstance(old, Compare):
            return self._atom(old, node) if isinstance(node, Compare) else node
        if isinstance(old, Add | Mul | Pow):
            exact = self._exact(old)
            return node if exact is None else exact
        return node

    def _ends(self, e: Expr) -> tuple[int, int] | None:
        """Returns the values at 0 and at 1, in the field, of an affine expression; None for others."""
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
        resolution = node.resolution
        first, last = (self._at(end, value, node.g) for end, value in zip((ZERO, ONE), ends, strict=True))
        if self._whole and (first is ZERO or last is ZERO):
            sign = ratio(sum(ends) % P, self._across)
            if resolution is not None and not math.isnan(sign):
                resolution = TRUE if sign > 0 else FALSE  # for a triangle without an area all sides count, or none
            return positive(first if last is ZERO else last, old.strict, resolution, old.rivals)
        if first is last:
            return positive(first, old.strict, resolution, old.rivals)
        return positive(add(mul(first, self._rest), mul(last, self.unit)), old.strict, resolution, old.rivals)

    def _at(self, end: Expr, value: int, g: Expr) -> Expr:
        known = self._number(value)
        if known is not None:
            return known
        e = cast(Expr, substitute(g, {self.unit: end}))
        if any(isinstance(n, Mul) and (len(n.children) > 2 or not isinstance(n.children[0], Const)) for n in postorder([e])):
            return e
        short = expanded(e, 4)  # h - (x₀ + (x₁ - x₀))
        return e if short is None else short


class Inside:
    """Expressions in a triangle, in its barycentric coordinates. Affine ones are written by their values at the three points."""

    def __init__(self, triangle: Triangle, variables: tuple[Var, Var], coordinates: tuple[Var, Var]) -> None:
        self._plane = Plane(variables)
        self._variables = variables
        self._points = [tuple(cast(int, self._plane.value(e)) for e in p) for p in triangle.points]
        self._coordinates = (sub(sub(ONE, coordinates[0]), coordinates[1]), *coordinates)
        self._known: dict[int, Expr] = {}
        self._across = triangle.across
        for e in (triangle.across, ONE):
            value = self._plane.value(e)
            for small, factor in SMALL.items() if value else ():
                self._known[cast(int, value) * small % P] = mul(const(factor), e)

    def simplified(self, e: Expr) -> Expr:
        """Returns the expression with its affine parts of known values simplified; the other parts stay in the variables."""
        return cast(Expr, rewrite([e], self._visit)[e])

    def _visit(self, old: Node, node: Node) -> Node:
        if not isinstance(old, Add | Mul | Pow) or not any(v in old.free for v in self._variables):
            return node
        if isinstance(node, Add) and all(_has_factor(t, self._across) for t in node.children):
            node = mul(self._across, add(*(mul(t, integer_power(self._across, -1)) for t in cast("Sequence[Expr]", node.children))))
        coefficients = self._plane.coefficients(old)
        if coefficients is None:
            return node
        a, b, c = coefficients
        values = [(a * p + b * q + c) % P for p, q in self._points]
        known = [self._known.get(v) if v else ZERO for v in values]
        if any(k is None for k in known):
            return node
        if known[0] is known[1] is known[2]:
            return cast(Expr, known[0])
        return add(*(mul(cast(Expr, k), u) for k, u in zip(known, self._coordinates, strict=True)))


def _has_factor(e: Node, factor: Expr) -> bool:
    return isinstance(e, Mul) and factor in e.children
