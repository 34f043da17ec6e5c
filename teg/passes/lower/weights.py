"""The weight of an integral in the results: the factors in front of it.

The tolerance of an adaptive integral is relative, down to an absolute floor. An integral of 1e-27 behind a factor of 1e27 is below every
floor, so such an integral is computed times that factor, and divided by it afterwards. In log ∫ f dx or ∫ x·f dx/∫ f dx every digit counts,
however small the integrals are, and how small is not known before: their tolerance has no floor (`relative`). Linear.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.ir.arrays import Sum
from teg.ir.expr import ONE, TRUE, Add, Call, Cond, Const, Expr, Mul, Pow, Tuple, Where, const
from teg.ir.integral import ClosedForm, Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.simplify import call, conjunction, mul, negation, where

SMALL_FACTOR = 100.0
"""A factor up to this size in front of an integral is ignored."""
LARGEST_FACTOR = 1e200
STEEP = ("log", "sqrt", "root", "pow", "atan2")
"""Functions that magnify relative errors where their arguments are small."""
MAX_PLACES = 4
"""An integral in more places has the weight of the first of them."""


Front = tuple[Expr, Cond]
"""The product of the factors in front of a node, and the condition under which its value is used."""


def weights(roots: Sequence[Expr], order: Sequence[Node]) -> dict[Integral, Expr]:
    """Returns the factors by which to multiply the integrals of one level: between 1 and LARGEST_FACTOR, without those that are 1.

    `order` has the nodes below the roots, children first. An integral on which no result depends linearly has the weight 1.
    """
    fronts: dict[Node, dict[Front, None]] = {root: {(ONE, TRUE): None} for root in roots}
    found: dict[Integral, Expr] = {}
    for node in reversed(order):
        if node not in fronts or not node.has_integral:
            continue
        places = list(fronts[node])[:MAX_PLACES]
        front, path = places[0] if len(places) == 1 else (largest([call("magnitude", _guarded(p)) for p in places]), TRUE)
        match node:
            case Integral():
                weight = _bounded(_guarded((front, path)))
                if weight is not ONE:
                    found[node] = weight
            case Add() | Tuple():
                _put(fronts, node.children, (front, path))
            case Where() if not node.condition.has_integral:
                _put(fronts, (node.then,), (front, conjunction(path, node.condition)))
                _put(fronts, (node.otherwise,), (front, conjunction(path, negation(node.condition))))
            case Mul():
                factors = [c for c in node.children if not (c.has_integral or isinstance(c, PointMasses | ClosedForm))]
                _put(fronts, [c for c in node.children if c.has_integral], (mul(front, *factors), path))
            case _:
                _put(fronts, node.children, (ONE, TRUE))
    return found


def relative(order: Sequence[Node], roots: Sequence[Expr]) -> set[Integral]:
    """Returns the integrals of one level of which all digits count: those in a function that is not smooth at 0, or beside one of an
    integral in a product, and those of which `roots` are made.

    `order` has the nodes of the level, children first.
    """
    return {n for n in _counting(order, roots) if isinstance(n, Integral)}


def has_relative_sums(outputs: Sequence[Expr]) -> bool:
    """Returns whether there are sums over data of integrals of which all digits count, as in log Σ ∫ f dx."""
    return any(e.kinds & Sum.bit for e in outputs) and any(isinstance(n, Sum) for n in _counting(postorder(outputs), ()))


def _counting(order: Sequence[Node], roots: Sequence[Expr]) -> set[Node]:
    """Returns the nodes of which all digits count."""
    steep: set[Node] = set()  # the nodes with such a function of an integral below them
    for node in order:
        if node.has_integral and not isinstance(node, Integral) and (_is_steep(node) or any(c in steep for c in node.children)):
            steep.add(node)
    counting: set[Node] = set(roots)
    for node in reversed(order):
        inner = [c for c in node.children if c.has_integral]
        if isinstance(node, Integral):
            continue
        if node in counting or _is_steep(node) or (isinstance(node, Mul) and len(inner) > 1 and not steep.isdisjoint(inner)):
            counting.update(inner)
    return counting


def _is_steep(node: Node) -> bool:
    """Returns whether a node is a function that is not smooth at 0, of an integral."""
    return node.has_integral and ((isinstance(node, Pow) and node.exponent < 0) or (isinstance(node, Call) and node.name in STEEP))


def _put(fronts: dict[Node, dict[Front, None]], children: Sequence[Node], front: Front) -> None:
    for child in children:
        fronts.setdefault(child, {})[front] = None


def _guarded(front: Front) -> Expr:
    """Returns the factor under its condition: in a branch that is not taken it may be NaN."""
    return where(front[1], front[0], ONE)


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
