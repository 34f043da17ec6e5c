"""How much an integral counts in the results: the factors in front of it.

The tolerance of an adaptive integral is relative, down to an absolute floor. An integral of 1e-27 that a factor of 1e27 stands in front of
is below every floor, so such an integral is computed times that factor, and divided by it afterwards. Linear.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.expr import ONE, Add, Const, Expr, Mul, Tuple, Where, call, const, mul
from teg.integral import Border, Integral, PointMasses
from teg.node import Node

SMALL_FACTOR = 100.0
"""A number that is no larger in front of an integral does not matter."""
LARGEST_FACTOR = 1e200
MAX_PLACES = 4
"""An integral that stands in more places counts as in the first of them."""


def weights(roots: Sequence[Expr], order: Sequence[Node]) -> dict[Integral, Expr]:
    """Returns by how much to multiply the integrals of one level: between 1 and LARGEST_FACTOR, where that is not 1.

    `order` has the nodes below the roots, children first. An integral that a result does not depend on linearly counts as it is.
    """
    fronts: dict[Node, dict[Expr, None]] = {root: {ONE: None} for root in roots}
    found: dict[Integral, Expr] = {}
    for node in reversed(order):
        if node not in fronts or not node.has_integral:
            continue
        places = list(fronts[node])[:MAX_PLACES]
        front = places[0] if len(places) == 1 else largest([call("magnitude", f) for f in places])
        match node:
            case Integral():
                weight = _bounded(front)
                if weight is not ONE:
                    found[node] = weight
            case Add() | Tuple():
                _put(fronts, node.children, front)
            case Where():
                _put(fronts, (node.then, node.otherwise), front)
            case Mul():
                factors = [c for c in node.children if not (c.has_integral or isinstance(c, PointMasses | Border))]
                _put(fronts, [c for c in node.children if c.has_integral], mul(front, *factors))
            case _:
                _put(fronts, node.children, ONE)
    return found


def _put(fronts: dict[Node, dict[Expr, None]], children: Sequence[Node], front: Expr) -> None:
    for child in children:
        fronts.setdefault(child, {})[front] = None


def largest(sizes: Sequence[Expr]) -> Expr:
    """Returns the largest of numbers, none of them negative."""
    distinct = list(dict.fromkeys(sizes))
    result = distinct[0]
    for size in distinct[1:]:
        result = call("max", result, size)
    return result


def _bounded(front: Expr) -> Expr:
    if isinstance(front, Const):
        return const(min(abs(front.data), LARGEST_FACTOR)) if abs(front.data) > SMALL_FACTOR else ONE
    return call("min", call("max", call("magnitude", front), ONE), const(LARGEST_FACTOR))
