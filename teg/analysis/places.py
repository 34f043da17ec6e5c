"""Where chosen subexpressions stand: what contains them, whether the whole is affine in them, and when anybody looks at them."""

from __future__ import annotations

from collections.abc import Callable

from teg.ir.expr import FALSE, TRUE, Add, Cond, Expr, Mul, Where, conjunction, disjunction, negation
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder


def holding(root: Node, inner: Node) -> list[Node]:
    """The nodes that contain one, children first; not itself."""
    found: set[Node] = {inner}
    order: list[Node] = []
    for node in postorder([root]):
        if any([c in found for c in node.children]):
            found.add(node)
            order.append(node)
    return order


def linear_places(root: Expr, is_chosen: Callable[[Node], bool]) -> dict[Expr, bool]:
    """The chosen nodes, innermost first, and whether the expression is affine in each as a number: on the way to it there is no more than
    a sum, a product with something free of it, a branch, or an integral. One visit a node; sets of nodes are the bits of integers."""
    chosen: list[Expr] = []
    below: dict[Node, int] = {}  # the chosen nodes in a node
    bent: dict[Node, int] = {}  # those of them that it is not affine in
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
    """Is a node affine in child number i, as long as that is in no other child?"""
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
    """The condition, on parameters only, under which anybody looks at a subexpression."""
    order = holding(root, inner)
    found = {inner, *order}
    reach: dict[Node, Cond] = {root: TRUE}
    for node in reversed(order):
        for child in node.children:
            if child in found:
                here = reach[node]
                if isinstance(node, Where) and not node.condition.free and child is not node.condition:
                    here = conjunction(here, node.condition if child is node.then else negation(node.condition))
                reach[child] = disjunction(reach.get(child, FALSE), here)
    return reach[inner]
