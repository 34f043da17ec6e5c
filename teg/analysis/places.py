"""Positions of chosen subexpressions: the nodes that contain them, whether the whole is affine in them, and their path conditions."""

from __future__ import annotations

from collections.abc import Callable

from teg.ir.expr import FALSE, TRUE, Add, Cond, Expr, Mul, Where
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import conjunction, disjunction, negation


def holding(root: Node, inner: Node) -> list[Node]:
    """Returns the nodes that contain `inner`, children first, without `inner` itself."""
    holders: set[Node] = {inner}
    order: list[Node] = []
    for node in postorder([root]):
        if any([c in holders for c in node.children]):
            holders.add(node)
            order.append(node)
    return order


def linear_places(root: Expr, is_chosen: Callable[[Node], bool]) -> dict[Expr, bool]:
    """Returns the chosen nodes, innermost first, each with whether `root` is affine in it as a number.

    It is affine if all nodes between are sums, products with factors that do not contain it, branches, and integrals. One visit a node;
    sets of nodes are the bits of integers.
    """
    chosen: list[Expr] = []
    below: dict[Node, int] = {}  # the chosen nodes in a node
    bent: dict[Node, int] = {}  # the chosen nodes in which a node is not affine
    for node in postorder([root]):
        every = several = curved = 0
        for i, c in enumerate(node.children):
            several |= every & below[c]
            every |= below[c]
            curved |= bent[c] if _keeps_lines(node, i) else below[c]
        if isinstance(node, Mul):
            curved |= several
        if isinstance(node, Expr) and is_chosen(node):
            every |= 1 << len(chosen)
            chosen.append(node)
        below[node], bent[node] = every, curved
    return {e: not bent[root] >> i & 1 for i, e in enumerate(chosen)}


def _keeps_lines(node: Node, i: int) -> bool:
    """Returns whether a node is affine in child number i, if that occurs in no other child."""
    match node:
        case Add() | Mul():
            return True
        case Where():
            return i > 0
        case Integral():
            return i == 0
        case _:
            return False


def reached(root: Node, inner: Node) -> Cond:
    """Returns the condition, on parameters only, under which the value of a subexpression is used."""
    order = holding(root, inner)
    chosen = {inner, *order}
    reach: dict[Node, Cond] = {root: TRUE}
    for node in reversed(order):
        for child in node.children:
            if child in chosen:
                path = reach[node]
                if isinstance(node, Where) and not node.condition.free and child is not node.condition:
                    path = conjunction(path, node.condition if child is node.then else negation(node.condition))
                reach[child] = disjunction(reach.get(child, FALSE), path)
    return reach[inner]
