"""Rows of a table in the place of alike expressions.

    c₀·[x < t₀],  c₁·[x < t₁],  …      →      T[row, 0]·[x < T[row, 1]],   T = ((c₀, t₀), (c₁, t₁), …)

Expressions are alike that differ in their parameters and numbers only; numbers that are the same in all rows stay in the template. Cost: a
visit a node.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.ir.arrays import Array, Gather
from teg.ir.expr import Const, Expr, Param
from teg.ir.index import IndexVar, index_const
from teg.ir.node import Node, postorder
from teg.ir.traverse import rebuild

ROW = "row"
"""The name of the index of rows."""
Row = tuple[Param | Const, ...]
Tables = dict[Array, tuple[Row, ...]]


class Shape(NamedTuple):
    """The structure of a term, and the parameters and numbers in it, in their order."""

    key: tuple[object, ...]
    parameters: tuple[Param, ...]
    numbers: tuple[Const, ...]


def shape_of(term: Expr) -> Shape:
    """Returns a key that is equal for alike terms. Every place of a number counts by itself; a parameter is one place."""
    number: dict[Node, int] = {}
    key: list[object] = []
    parameters: list[Param] = []
    numbers: list[Const] = []
    for node in postorder([term]):
        if _is_number(node):
            continue
        number[node] = len(number)
        if isinstance(node, Param):
            key.append(Param)
            parameters.append(node)
        else:
            key.append((type(node), node.data, *(None if _is_number(c) else number[c] for c in node.children)))
            numbers += [cast(Const, c) for c in node.children if _is_number(c)]
    return Shape(tuple(key), tuple(parameters), tuple(numbers))


def _is_number(node: Node) -> bool:
    return isinstance(node, Const) and math.isfinite(node.data)


def template_of(alike: Sequence[tuple[Expr, Shape]], tables: Tables) -> Expr | None:
    """Returns the expression of a row of a new table; None if all rows are equal."""
    first, shape = alike[0]
    table = Array.make((f"table {len(tables)}", 2), ())
    k = IndexVar.make(ROW, ())
    columns: list[Sequence[Param | Const]] = []

    def place(values: Sequence[Param | Const]) -> Expr:
        if all(v is values[0] for v in values):
            return values[0]
        if values not in columns:
            columns.append(values)
        return Gather.make((table, (k, index_const(columns.index(values)))), ())

    new: dict[Node, Node] = {}
    for j, p in enumerate(shape.parameters):
        new[p] = place([s.parameters[j] for _, s in alike])
    count = 0
    for node in postorder([first]):
        if node in new or _is_number(node):
            continue
        children: list[Node] = []
        for c in node.children:
            if _is_number(c):
                children.append(place([s.numbers[count] for _, s in alike]))
                count += 1
            else:
                children.append(new[c])
        new[node] = rebuild(node, tuple(children))
    if not columns:
        return None
    tables[table] = tuple(zip(*columns, strict=True))
    return cast(Expr, new[first])
