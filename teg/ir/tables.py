"""Tables: numbers that are computed once for each row of an array, whatever reads them and how often.

    e ::= … | entry[i, c]  of  table[t: i..i](e, …)         column c of row i: the expression e_c with t = i
    d ::= … | 1[table; i, c]                                in derivatives: the table that is 1 at one place and 0 elsewhere
    e ::= … | collected[i, c]  of  d                        the number at a place of a sum of such tables

A table is closed: it depends on no index but its own. Users do not write them; `teg.passes.normalise.tables` makes them.
"""

from __future__ import annotations

from typing import cast

from teg.ir.arrays import Placed, Ranged, Sum
from teg.ir.expr import Expr
from teg.ir.index import ArrayName, Index, IndexArray, IndexVar
from teg.ir.node import Node


class Table(Ranged, Expr):
    """Numbers (the children) for each index from lo up to hi - 1; data are (index, lo, hi, arrays, listed).

    Rows are those of the first axes of `arrays`; only the rows that are entries of the array of indices `listed` are read.
    """

    __slots__ = ()

    @property
    def arrays(self) -> tuple[ArrayName, ...]:
        return cast("tuple[ArrayName, ...]", self.data[3])

    @property
    def listed(self) -> IndexArray:
        return cast(IndexArray, self.data[4])

    @property
    def numbers(self) -> tuple[Expr, ...]:
        return cast("tuple[Expr, ...]", self.children)


class RowSum(Sum):
    """A sum over the rows that are entries of an array of indices; data are (index, lo, hi, listed)."""

    __slots__ = ()

    def over(self, children: tuple[Node, ...], k: IndexVar, lo: Index, hi: Index) -> Node:
        return type(self).make((k, lo, hi, self.listed), cast("tuple[Expr, ...]", children))

    @property
    def listed(self) -> IndexArray:
        return cast(IndexArray, self.data[3])


class TableEntry(Placed):
    """The number in a column of a row of a `Table`."""

    __slots__ = ()


class TableUnit(Placed):
    """The table, of the shape of a `Table`, that is 1 at a place and 0 elsewhere."""

    __slots__ = ()


class Collected(Placed):
    """The number at a place of an expression that is linear in `TableUnit`s."""

    __slots__ = ()
