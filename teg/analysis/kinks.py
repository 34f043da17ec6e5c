"""Continuous branches as absolute values, so that a surface with many kinks stays one surface.

    where(h > 0, p, q)  =  ½(p + q) ± ½|p - q|        if p - q = k·h with a number k; ± is the sign of k

`abs`, `minimum` and `maximum` are such branches. Hoisting n of them out of a condition makes 2ⁿ cases. As |·| (the function `magnitude`,
which has no surface of its own) they make none, and the roots of the whole are isolated at run time, between the kinks. Linear.
"""

from __future__ import annotations

from typing import cast

from teg.analysis.polynomial import Point
from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Expr, Mul, Pow, Where, const
from teg.ir.node import Node
from teg.ir.simplify import add, call, mul, sub
from teg.ir.traverse import rebuild
from teg.numerics.field import divided, sign_of_residue


def kinks_of(g: Expr) -> list[Where]:
    """Returns the branches in value position whose conditions depend on variables."""
    kinks: dict[Where, None] = {}
    for node in value_nodes(g):
        if isinstance(node, Where) and node.condition.free:
            kinks[node] = None
    return list(kinks)


def with_sizes(g: Expr) -> Expr:
    """Returns g with its continuous branches written as absolute values."""
    new: dict[Node, Node] = {}
    for node in value_nodes(g):
        result = cast(Expr, rebuild(node, tuple([new.get(c, c) for c in node.children])))
        if isinstance(result, Where) and result.condition.free:
            result = _as_size(result)
        new[node] = result
    return cast(Expr, new[g])


def sign_of_kink(e: Where) -> int:
    """Returns 1 for the maximum of both branches of `e`, -1 for their minimum, and 0 for another branch."""
    if not isinstance(e.condition, Compare) or e.condition.resolution is not None:
        return 0
    h, difference = e.condition.g, sub(e.then, e.otherwise)
    ratios: list[int] = []
    for trial in ("first", "second"):
        of_h, of_difference = (Point(trial).value(u) for u in (h, difference))
        if not of_h or of_difference is None:
            return 0
        ratios.append(divided(of_difference, of_h))
    sign = sign_of_residue(ratios[0]) if ratios[0] == ratios[1] else None
    return int(sign or 0)


def _as_size(e: Where) -> Expr:
    sign, difference = sign_of_kink(e), sub(e.then, e.otherwise)
    if not sign:
        return e
    size = mul(const(0.5), call("magnitude", difference))
    return add(mul(const(0.5), add(e.then, e.otherwise)), size if sign > 0 else mul(MINUS_ONE, size))


def value_nodes(g: Expr) -> list[Expr]:
    """Returns the nodes of g in value position, children first; nodes of conditions and inside integrals are left out."""
    order: list[Expr] = []
    done: set[Expr] = set()
    stack: list[tuple[Expr, bool]] = [(g, False)]
    while stack:
        node, ready = stack.pop()
        if ready:
            order.append(node)
        elif node not in done:
            done.add(node)
            stack.append((node, True))
            if isinstance(node, Where):
                stack += [(node.otherwise, False), (node.then, False)]
            elif isinstance(node, Add | Mul | Pow | Call):
                stack.extend((cast(Expr, c), False) for c in reversed(node.children))
    return order
