"""Numbers of candidates from tables: what depends on a datum alone is computed once for it, not once for each box where it is met.

    g(L[k], i, j)   →   c[L[k]] + a[L[k]]·(j - u[L[k]]) + b[L[k]]·(i - v[L[k]])        table[t]: c(t), a(t), b(t), u(t), v(t)

The numbers of a candidate (`teg.ir.partition`) depend on its index k by a datum L[k], and on the box by few numbers of the loops around, of
which they are affine functions. These are taken about an origin (u, v) of the datum, c = g(t, v, u), so that nothing cancels far from
0: the first difference in g of such a number and what a datum gives. An origin does not matter for the value, so it has no derivative.

The derivative by a table is a table, and the chain rule from there to the parameters is applied once for each row: forms in, derivatives
of forms out. Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Point, Shadow
from teg.errors import NotDifferentiableError
from teg.ir.arrays import Gather, Ranged, integers_of, open_indices
from teg.ir.cells import Symbols, cell_leaves, replace_integers, replaced
from teg.ir.expr import ZERO, Add, Const, Expr, Var, const
from teg.ir.index import (
    APART,
    ArrayName,
    Index,
    IndexGather,
    IndexValue,
    IndexVar,
    Length,
    free_indices,
    index_call,
    index_const,
    index_leaves,
)
from teg.ir.node import Node, postorder
from teg.ir.partition import Partition
from teg.ir.simplify import add, mul, sub
from teg.ir.still import with_still_parameters
from teg.ir.tables import Table, TableEntry
from teg.ir.traverse import rebuild, substitute

WORTH = 3
"""Operations for each column of a table, at least: else numbers are computed where they are used."""


def with_tables(root: Expr) -> Expr:
    """Returns the program in which partitions inside of loops read their numbers from tables."""
    order = postorder([root])
    partitions = [node for node in order if isinstance(node, Partition) and not node.layout.order]
    if not partitions:
        return root
    opened = open_indices(root)
    taken = {i.name for indices in opened.values() for i in indices} | {n.index.name for n in order if isinstance(n, Ranged)}
    row = IndexVar.make(f"row{APART}{len(taken)}", ())
    columns: dict[Index, _Columns] = {}
    split: dict[Node, tuple[_Columns, list[_Split | None]]] = {}
    for node in partitions:
        place = _datum(node.candidate, node.index)
        if place is not None and opened[node]:
            own = columns.setdefault(place, _Columns(place, row))
            split[node] = own, [own.split(number) for number in node.candidate]
            own.operations.update(n for n in postorder(node.candidate) if n.children)
    tables = {own: own.table() for own in columns.values()}
    new: dict[Node, Node] = {}
    for old in order:
        new[old] = rebuild(old, tuple([new[c] for c in old.children]))
        if old in split and (table := tables[split[old][0]]) is not None:
            new[old] = _from_table(cast(Partition, new[old]), split[old][0].place, table, split[old][1])
    return cast(Expr, new[root])


def _from_table(node: Partition, place: Index, table: Table, split: Sequence[_Split | None]) -> Partition:
    """Returns a partition whose numbers are read from a table."""

    def entry(column: int | Expr) -> Expr:
        return TableEntry.make((place, column), (table,)) if isinstance(column, int) else column

    numbers = [
        add(entry(s.constant), *(mul(entry(rate), sub(leaf, entry(origin))) for leaf, rate, origin in s.moving)) if s else number
        for number, s in zip(node.candidate, split, strict=True)
    ]
    return Partition.make(node.data, (*numbers, *node.otherwise))


def _datum(numbers: Sequence[Expr], k: IndexVar) -> IndexGather | None:
    """Returns the entry of an array of indices by which all numbers depend on the index of a candidate; None if there is more than one."""
    gathers = [i for n in postorder(numbers) for i in index_leaves(integers_of(n)) if isinstance(i, IndexGather) and k in free_indices(i)]
    innermost = {
        i for i in gathers if not any(isinstance(j, IndexGather) and j is not i and k in free_indices(j) for j in index_leaves([i]))
    }
    return innermost.pop() if len(innermost) == 1 else None


class _Split(NamedTuple):
    """constant + Σ rate·(leaf - origin): columns of a table, or expressions of the datum that need none."""

    constant: int | Expr
    moving: list[tuple[Expr, int | Expr, int | Expr]]


class _Columns:
    """The columns of a table, which are added as numbers are split."""

    def __init__(self, place: IndexGather, row: IndexVar) -> None:
        self.place, self.row = place, row
        self._columns: dict[object, int] = {}  # by the values of two points, or by an expression that has none
        self._numbers: list[Expr] = []
        self._arrays: dict[ArrayName, None] = {}
        self._origins: dict[Expr, Expr] = {}
        self.operations: set[Node] = set()
        self._symbols = Symbols()
        self._points = Point(), Point(salt="again")

    def table(self) -> Table | None:
        """Returns the table; None if computing its numbers costs little."""
        if not self._arrays or len(self.operations) < WORTH * len(self._numbers):
            return None
        lengths: list[Index] = [Length.make((a, 0), ()) for a in self._arrays]
        hi = lengths[0]
        for other in lengths[1:]:
            hi = index_call("min", hi, other)
        data = (self.row, index_const(0), hi, tuple(self._arrays), self.place.array)
        return Table.make(data, tuple(self._numbers))

    def split(self, number: Expr) -> _Split | None:
        """Returns a number as an affine function of what a box gives; None if it is none, or does not depend on the datum."""
        given: dict[Node, Expr] = {}
        outer: dict[Node, Var] = {}
        arrays: dict[ArrayName, None] = {}
        for leaf in cell_leaves([number]):
            own = replace_integers(leaf, {self.place: self.row}) if isinstance(leaf, Gather | IndexValue) else leaf
            opened = open_indices(own)[own]
            if self.row in opened:
                if opened != {self.row} or not self._is_row(own, arrays):
                    return None
                given[leaf] = own
            elif opened & open_indices(self.place_value)[self.place_value]:
                return None
            elif opened:
                outer[leaf] = Var.make(f"{APART}{len(outer)}", ())
        if not given:
            return None
        (moving,) = replaced([number], {**given, **outer})
        self._arrays.update(arrays)
        if not outer:
            return _Split(self._column(moving), [])
        return self._affine(moving, outer)

    @property
    def place_value(self) -> Expr:
        """Returns the datum as a number."""
        return cast(Expr, IndexValue.make(self.place, ()))

    def _is_row(self, leaf: Expr, arrays: dict[ArrayName, None]) -> bool:
        """Returns whether the row occurs as a number, or as the first subscript of arrays, which are added."""
        if isinstance(leaf, IndexValue) and leaf.index is self.row:
            return True
        for node in [leaf, *index_leaves(integers_of(leaf))]:
            places = node.subscripts if isinstance(node, Gather) else node.children
            if self.row in places:
                if not isinstance(node, Gather | IndexGather) or self.row in places[1:]:
                    return False
                arrays[node.array] = None
        return True

    def _affine(self, moving: Expr, outer: dict[Node, Var]) -> _Split | None:
        """Returns a number that moves with variables, if it is an affine function of them."""
        (cell,) = self._symbols.into([moving])
        variables = tuple(outer.values())
        degree = Shadow(variables).degree(cell)
        if not degree:
            still = self._symbols.out_of([cast(Expr, substitute(cell, dict.fromkeys(variables, ZERO)))])[0]
            return None if degree is None else _Split(self._column(still), [])
        if degree > 1:
            return None
        try:
            rates = [slope(cell, var) for var in variables]
        except NotDifferentiableError:
            return None
        origins = {var: self._origin(cast(Expr, leaf), var, cell) for leaf, var in outer.items()}
        at = {var: self._symbols.into([origin])[0] for var, origin in origins.items()}
        constant, *slopes = (cast(Expr, substitute(e, at)) for e in (cell, *rates))
        columns = [self._column(e) for e in self._symbols.out_of([constant, *slopes, *at.values()])]
        count = len(variables)
        return _Split(columns[0], list(zip(cast("list[Expr]", list(outer)), columns[1 : count + 1], columns[count + 1 :], strict=True)))

    def _origin(self, leaf: Expr, var: Var, cell: Expr) -> Expr:
        """Returns what a datum gives where a number of the box is subtracted from it first; 0 if it never is."""
        if leaf not in self._origins:
            for node in postorder([cell]):
                if not isinstance(node, Add) or node.free != {var} or Shadow((var,)).degree(node) != 1:
                    continue
                rate = slope(node, var)
                if isinstance(rate, Const) and rate.data:
                    (start,) = self._symbols.out_of([cast(Expr, substitute(node, {var: ZERO}))])
                    if self.row in open_indices(start)[start]:
                        self._origins[leaf] = with_still_parameters(mul(const(-1.0 / rate.data), start))
                        break
        return self._origins.setdefault(leaf, ZERO)

    def _column(self, number: Expr) -> int | Expr:
        """Returns the column of a number, or the number if it is a constant."""
        if isinstance(number, Const):
            return number
        (cell,) = self._symbols.into([number])
        values = tuple(point.value(cell) for point in self._points)
        key: object = number if None in values else values
        if key not in self._columns:
            self._columns[key] = len(self._numbers)
            self._numbers.append(number)
        return self._columns[key]
