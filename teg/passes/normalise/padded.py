"""Ranges that are data, padded: what is written out has a place for each candidate, so many as a call has at most.

    any_{k = lo}^{lo + n % 3} c(V[k])   =   a₀·c(v₀) ∨ a₁·c(v₁)        a_j = [j < n % 3],  v_j = Σ V[k] over k from lo + j to lo + j + a_j

A choice or a sum inside an integral that must be written out needs the number of its candidates. Where that is data (the list of a pixel),
a call says what the largest one is (`ranges_of_data`, `longest`), and the range is written so that its length is bounded by that
(`with_most`). A place that is empty has no entries, and its condition does not hold. Cost: a visit a node; written out, a body a place.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from teg.ir.arrays import Ranged, Sum, open_indices, sum_over
from teg.ir.cells import cell_leaves, replace_integers, replaced
from teg.ir.choices import CHOICES, Nearest
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Cond, Expr, const
from teg.ir.index import Index, IndexCall, IndexConst, IndexGather, IndexParam, IndexValue, IndexVar, index_call, index_const, index_leaves
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul, positive, sub
from teg.ir.traverse import rebuild


def ranges_of_data(root: Expr) -> list[Ranged]:
    """Returns the sums and choices that depend on variables of integration and whose lengths are data, innermost first."""
    found = (n for n in postorder([root]) if isinstance(n, (Sum, *CHOICES)) and n.free)
    data = (IndexGather, IndexParam, IndexVar)
    return [n for n in found if most_of(n) is None and any(isinstance(i, data) for i in index_leaves([n.lo, n.hi]))]


def longest(root: Expr, ranges: list[Ranged]) -> list[Expr]:
    """Returns the largest length of each range, over all values of the indices around it, as an expression. Indices of the program must
    be distinct (`indices_apart`)."""
    around = {n.index: (n.lo, n.hi) for n in postorder([root]) if isinstance(n, Ranged)}  # inner ones first
    found: list[Expr] = []
    for node in ranges:
        length = sum_over(ONE, node.index, node.lo, node.hi, as_written=True)
        for k, (lo, hi) in around.items():
            if k in open_indices(length)[length]:
                length = cast(Expr, Nearest.make((k, lo, hi), (length, mul(MINUS_ONE, length), TRUE, ZERO)))
        found.append(length)
    return found


def with_most(root: Expr, most: Mapping[Node, int]) -> Expr:
    """Returns the program with ranges whose lengths are bounded: these lengths are at most those given."""
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        children = tuple([new[c] for c in node.children])
        new[node] = rebuild(node, children)
        if isinstance(node, Ranged) and node in most:
            length = index_call("mod", index_call("sub", node.hi, node.lo), index_const(most[node] + 1))
            new[node] = node.over(children, node.index, node.lo, index_call("add", node.lo, length))
    return cast(Expr, new[root])


def most_of(node: Ranged) -> int | None:
    """Returns how many places a range must have: its length, or what bounds it; None if neither is known."""
    if isinstance(node.lo, IndexConst) and isinstance(node.hi, IndexConst):
        return max(int(node.hi.data) - int(node.lo.data), 0)
    bounded = _bounded_length(node)
    return None if bounded is None else bounded[1]


def _bounded_length(node: Ranged) -> tuple[Index, int] | None:
    """Returns the length of a range that is n % m, and m - 1; None if it is something else."""
    length: Node = node.hi
    if isinstance(length, IndexCall) and length.data == "add" and length.children[0] is node.lo:
        length = length.children[1]
    elif not isinstance(node.lo, IndexConst) or node.lo.data:
        return None
    divided = isinstance(length, IndexCall) and length.data == "mod"
    divisor = length.children[1] if divided else None
    return (cast(Index, length), int(divisor.data) - 1) if isinstance(divisor, IndexConst) and divisor.data > 0 else None


def at_place(node: Ranged, j: int) -> tuple[Cond, tuple[Node, ...]]:
    """Returns whether there is a candidate at a place of a range, and the children of the node there."""
    if isinstance(node.lo, IndexConst) and isinstance(node.hi, IndexConst):
        number: dict[Index, Index] = {node.index: index_const(node.lo.data + j)}
        return TRUE, tuple(replace_integers(cast(Expr, c), number) for c in node.children)
    bounded = _bounded_length(node)
    assert bounded is not None
    length, most = bounded
    there = index_call("floordiv", index_call("add", length, index_const(most - j)), index_const(most + 1))  # 1 if j < length, else 0
    lo = index_call("add", node.lo, index_const(j))
    hi = index_call("add", lo, there)
    leaves = [leaf for leaf in cell_leaves(node.children) if node.index in open_indices(leaf)[leaf]]
    own: dict[Node, Expr] = {leaf: sum_over(leaf, node.index, lo, hi) for leaf in leaves}
    holds = positive(sub(cast(Expr, IndexValue.make(there, ())), const(0.5)))
    return holds, tuple(replaced(cast("list[Expr]", list(node.children)), own))
