"""Integers as numbers, in sums: the number of i + 1 is the number of i, plus 1.

    ∫ from i to i + 1, i an index        the bounds differ by 1, whatever i is

So the box of a pixel has a size that is known before the program runs, and what depends on it and not on i is computed once for all pixels.
Integers are below 2⁵³ in numbers: nothing is rounded.
"""

from __future__ import annotations

from typing import cast

from teg.ir.expr import Expr, const
from teg.ir.index import Index, IndexCall, IndexConst, IndexValue
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul
from teg.ir.traverse import rebuild


def with_sums_of_integers(root: Expr) -> Expr:
    """Returns the program in which integers that are sums, or multiples, of others are numbers of these others."""
    order = postorder([root])
    if not any(isinstance(node, IndexValue) and isinstance(node.index, IndexCall) for node in order):
        return root
    new: dict[Node, Node] = {}
    for node in order:
        new[node] = _number(node.index) if isinstance(node, IndexValue) else rebuild(node, tuple([new[c] for c in node.children]))
    return cast(Expr, new[root])


def _number(index: Index) -> Expr:
    """Returns the number of an integer. Only sums and products with a number are taken apart."""
    factor, constant = 1, 0
    while isinstance(index, IndexCall):
        a, b = cast("tuple[Index, Index]", index.children)
        if isinstance(b, IndexConst) and index.data in ("add", "sub"):
            constant, index = constant + factor * (b.data if index.data == "add" else -b.data), a
        elif isinstance(a, IndexConst) and index.data in ("add", "sub"):
            constant, factor, index = constant + factor * a.data, factor if index.data == "add" else -factor, b
        elif index.data == "mul" and (isinstance(a, IndexConst) or isinstance(b, IndexConst)):
            times, index = (a, b) if isinstance(a, IndexConst) else (b, a)
            factor *= times.data
        else:
            break
    if isinstance(index, IndexConst):
        return const(float(constant + factor * index.data))
    return add(mul(const(float(factor)), cast(Expr, IndexValue.make(index, ()))), const(float(constant)))
