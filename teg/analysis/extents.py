"""Bounds of an expression as numbers, valid for all values of its parameters.

    extent(e, {x: (0, 1)})  =  (least, most)        with   least <= e <= most   for all parameters, and all x in (0, 1)

Natural interval extension on numbers. A parameter, and everything unknown, has the bounds (-∞, ∞). Roundings are not directed: a bound
may be off by a few of them. A bound that is exactly 0 comes from a square, an absolute value and the like, and is exact.
`teg.analysis.intervals` gives bounds at run time instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import cast

from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Const, Expr, Mul, Pow, Var, Where
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul, sub

Extent = tuple[float, float]
EVERYTHING: Extent = (-math.inf, math.inf)


def extent(e: Expr, box: Mapping[Var, Extent]) -> Extent:
    """Returns the least and the largest value of e over a box. A variable that is not in the box is unbounded."""
    return extents(postorder([e]), box)[e]


class Extents:
    """Extents over a box that may change; `box` returns it. Those over each box are kept: all together cost one visit of each node."""

    def __init__(self, box: Callable[[], Mapping[Var, Extent]]) -> None:
        self.box = box
        self._known: dict[tuple[tuple[Var, Extent], ...], dict[Node, Extent]] = {}

    def of(self, e: Expr) -> Extent:
        """Returns the least and the largest value of e over the box as it is now."""
        box = self.box()
        known = self._known.setdefault(tuple(box.items()), {})
        stack: list[Node] = [e]
        while stack:
            if missing := [c for c in stack[-1].children if c not in known]:
                stack.extend(missing)
            else:
                node = stack.pop()
                known[node] = _usable(_extent(node, box, known)) if isinstance(node, Expr) else EVERYTHING
        return known[e]


def extents(order: Iterable[Node], box: Mapping[Var, Extent]) -> dict[Node, Extent]:
    """Returns the least and the largest values over a box of all expressions among nodes, which are in order, children first."""
    known: dict[Node, Extent] = {}
    for node in order:
        if isinstance(node, Expr):
            known[node] = _usable(_extent(node, box, known))
    return known


def _usable(found: Extent) -> Extent:
    return EVERYTHING if found[0] != found[0] or found[1] != found[1] else found


def _extent(node: Expr, box: Mapping[Var, Extent], known: Mapping[Node, Extent]) -> Extent:
    match node:
        case Const():
            return node.data, node.data
        case Var():
            return box.get(node, EVERYTHING)
        case Add():
            parts = [known[c] for c in node.children]
            return sum(p[0] for p in parts), sum(p[1] for p in parts)
        case Mul():
            result = known[node.children[0]]
            for c in node.children[1:]:
                result = _product(result, known[c])
            return result
        case Pow():
            return _power(known[node.base], node.exponent)
        case Where():
            a, b = _where_it_counts(node, known)
            lo, hi = min(a[0], b[0]), max(a[1], b[1])
            if isinstance(node.condition, Compare) and node.condition.g is sub(node.then, node.otherwise):
                return max(a[0], b[0]), hi  # the maximum
            if isinstance(node.condition, Compare) and node.condition.g is sub(node.otherwise, node.then):
                return lo, min(a[1], b[1])  # the minimum
            return lo, hi
        case Call() if node.name == "pow" and not isinstance(node.children[1], Const) and known[node.children[0]][0] < 0.0:
            return EVERYTHING  # the exponent may be an odd integer
        case Call():
            rule = _RULES.get(node.name)
            return EVERYTHING if rule is None else rule(known[node.children[0]])
        case _:
            return EVERYTHING


def _where_it_counts(node: Where, known: Mapping[Node, Extent]) -> tuple[Extent, Extent]:
    """Returns the extents of both branches where they are taken: in where(u > 0, u, -u) both are at least 0."""
    a, b = known[node.then], known[node.otherwise]
    if isinstance(node.condition, Compare):
        g = node.condition.g
        if node.then is g:
            a = max(a[0], 0.0), max(a[1], 0.0)
        elif node.then is mul(MINUS_ONE, g):
            a = min(a[0], 0.0), min(a[1], 0.0)
        if node.otherwise is mul(MINUS_ONE, g):
            b = max(b[0], 0.0), max(b[1], 0.0)
        elif node.otherwise is g:
            b = min(b[0], 0.0), min(b[1], 0.0)
    return a, b


def _times(a: float, b: float) -> float:
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _product(a: Extent, b: Extent) -> Extent:
    corners = [_times(u, v) for u in a for v in b]
    return min(corners), max(corners)


def _sizes(u: Extent) -> Extent:
    return max(0.0, u[0], -u[1]), max(u[1], -u[0])


def _power(u: Extent, k: int) -> Extent:
    if k < 0:
        if u[0] < 0.0 < u[1]:
            return (0.0, math.inf) if k % 2 == 0 else EVERYTHING
        positive = u[0] >= 0.0
        size = _power(_sizes(u), -k)
        reciprocal = (1.0 / size[1] if size[1] else math.inf, 1.0 / size[0] if size[0] else math.inf)
        return reciprocal if positive or k % 2 == 0 else (-reciprocal[1], -reciprocal[0])
    lo, hi = u if k % 2 else _sizes(u)
    return _raised(lo, k), _raised(hi, k)


def _raised(x: float, k: int) -> float:
    try:
        return x**k
    except OverflowError:
        return math.inf if x > 0 or k % 2 == 0 else -math.inf


def _rising(f: Callable[[float], float], least: float, most: float) -> Callable[[Extent], Extent]:
    """Returns the extent map of an increasing function, defined from where it has the value `least`, with values up to `most`."""

    def rule(u: Extent) -> Extent:
        values = []
        for x, otherwise in zip(u, (least, most), strict=True):
            try:
                values.append(f(x))
            except (ValueError, OverflowError):
                values.append(otherwise)
        return values[0], values[1]

    return rule


_WAVE: Extent = (-1.0, 1.0)
_RULES: dict[str, Callable[[Extent], Extent]] = {
    "sin": lambda u: _WAVE,
    "cos": lambda u: _WAVE,
    "exp": _rising(math.exp, 0.0, math.inf),
    "expm1": _rising(math.expm1, -1.0, math.inf),
    "erf": _rising(math.erf, -1.0, 1.0),
    "erfc": lambda u: (math.erfc(u[1]), math.erfc(u[0])),
    "sinh": _rising(math.sinh, -math.inf, math.inf),
    "cosh": lambda u: cast(Extent, tuple(_rising(math.cosh, 1.0, math.inf)((x, x))[0] for x in _sizes(u))),
    "tanh": _rising(math.tanh, -1.0, 1.0),
    "atan": _rising(math.atan, -math.pi / 2, math.pi / 2),
    "asin": lambda u: (-math.pi / 2, math.pi / 2),
    "acos": lambda u: (0.0, math.pi),
    "sqrt": _rising(math.sqrt, 0.0, math.inf),
    "root": lambda u: (0.0, math.inf),
    "pow": lambda u: (0.0, math.inf),
    "log": _rising(math.log, -math.inf, math.inf),
    "log1p": _rising(math.log1p, -math.inf, math.inf),
    "magnitude": _sizes,
}
