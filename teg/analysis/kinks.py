"""Continuous branches as extremes, so that a surface with many kinks stays one surface.

    where(h > 0, p, q)  =  max(p, q)  or  min(p, q)        if p - q = k·h with a number k, by the sign of k

`abs`, `minimum` and `maximum` are such branches. Hoisting n of them out of a condition makes 2ⁿ cases. As extremes (the functions `max`,
`min`, and `magnitude` for abs, which have no surface of their own) they make none, and the roots of the whole are isolated at run time,
between the kinks. Linear.
"""

from __future__ import annotations

from collections.abc import Container
from typing import cast

from teg.analysis.polynomial import Point
from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Cond, Expr, Mul, Pow, Var, Where, called
from teg.ir.node import Node
from teg.ir.simplify import call, mul, positive, sub, where
from teg.ir.traverse import rebuild
from teg.numerics.field import P, divided, sign_of_residue

EXTREMES = ("magnitude", "min", "max")
_EXTREMES = called(*EXTREMES)
"""The functions with kinks."""


def is_extreme(e: Node) -> bool:
    """Returns whether a node is a function with a kink."""
    return isinstance(e, Call) and e.name in EXTREMES


def kink_of(e: Call) -> Expr:
    """Returns what is 0 at the kink of an extreme."""
    return e.children[0] if e.name == "magnitude" else sub(*e.children)


def kinks_of(g: Expr) -> list[Where]:
    """Returns the branches in value position whose conditions depend on variables."""
    return [node for node in value_nodes(g) if isinstance(node, Where) and node.condition.free]


class Kinks:
    """Which branches are continuous. What expressions share is visited once."""

    def __init__(self) -> None:
        self._points = (Point("first"), Point("second"))

    def sign(self, e: Where) -> int:
        """Returns 1 for the maximum of both branches of `e`, -1 for their minimum, and 0 for another branch."""
        return self.sign_of(e.condition, e.then, e.otherwise)

    def sign_of(self, condition: Cond, then: Expr, otherwise: Expr) -> int:
        """Returns the same for where(condition, then, otherwise)."""
        if not isinstance(condition, Compare) or condition.resolution is not None:
            return 0
        h, difference = condition.g, sub(then, otherwise)
        found: list[tuple[int, int]] = []
        for point in self._points:
            of_h, of_difference = point.value(h), point.value(difference)
            if not of_h or of_difference is None:
                return 0
            found.append((of_h, of_difference))
        (first, times_first), (second, times_second) = found
        is_one_number = (times_first * second - times_second * first) % P == 0
        return int(sign_of_residue(divided(times_first, first)) or 0) if is_one_number else 0


class Extremes:
    """Functions with their continuous branches written as extremes. What functions share is written once."""

    def __init__(self) -> None:
        self._new: dict[Expr, Expr] = {}
        self._kinks = Kinks()

    def of(self, g: Expr) -> Expr:
        """Returns g with its continuous branches, in value position, written as extremes."""
        new = self._new
        for node in value_nodes(g, new):
            result = cast(Expr, rebuild(node, tuple([new.get(cast(Expr, c), c) for c in node.children])))
            if isinstance(result, Where) and result.condition.free:
                result = self._as_extreme(result)
            new[node] = result
        return new[g]

    def is_kink(self, e: Where) -> bool:
        """Returns whether `e` is continuous where its condition is 0, which may have extremes where the branches of `e` have branches."""
        if self._kinks.sign(e):
            return True
        if not isinstance(e.condition, Compare) or not any(map(is_extreme, value_nodes(e.condition.g))):
            return False
        return bool(self._kinks.sign_of(e.condition, self.of(e.then), self.of(e.otherwise)))

    def _as_extreme(self, e: Where) -> Expr:
        sign = self._kinks.sign(e)
        if not sign:
            return e
        if e.otherwise is mul(MINUS_ONE, e.then):
            size = call("magnitude", e.then)
            return size if sign > 0 else mul(MINUS_ONE, size)
        return call("max" if sign > 0 else "min", e.then, e.otherwise)


def without_extremes(f: Expr, x: Var) -> Expr:
    """Returns f with its extremes of functions of x, in value position, written as branches."""
    if not f.kinds & _EXTREMES:
        return f
    new: dict[Expr, Expr] = {}
    for node in value_nodes(f):
        result = cast(Expr, rebuild(node, tuple([new.get(cast(Expr, c), c) for c in node.children])))
        if isinstance(result, Call) and result.name in EXTREMES and x in result.free:
            first, *others = result.children
            other = others[0] if others else mul(MINUS_ONE, first)
            above = positive(kink_of(result))
            result = where(above, other, first) if result.name == "min" else where(above, first, other)
        new[node] = result
    return new[f]


def value_nodes(g: Expr, known: Container[Expr] = ()) -> list[Expr]:
    """Returns the nodes of g in value position, children first, but for those that are `known`; nodes of conditions and inside integrals
    are left out."""
    order: list[Expr] = []
    done: set[Expr] = set()
    stack: list[tuple[Expr, bool]] = [(g, False)]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.append(node)
        elif node not in done and node not in known:
            done.add(node)
            stack.append((node, True))
            if isinstance(node, Where):
                stack += [(node.otherwise, False), (node.then, False)]
            elif isinstance(node, Add | Mul | Pow | Call):
                stack.extend((cast(Expr, c), False) for c in reversed(node.children))
    return order
