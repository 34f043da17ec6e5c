"""From an outlined expression, and derivatives by arrays, to the loops of `teg.program.arrays`.

Level by level. The sums that a level needs become loops, one loop for sums over the same range. The level's own values are one cell,
lowered to one flat program whose parameters are entries, integers, and the sums' results. Then each flat program is cut where its
statements stop depending on an index: values that are the same for all iterations of a loop are computed before it (`_split`).

A derivative by an array, Σ_k w_k·1[V; F[k]], is taken apart into its places and the numbers added there; a weight in front of a sum goes
inside. So is a derivative by a table, which is complete before what is collected from it is used: such outputs are a stage of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import cast

from teg.errors import DeltaError
from teg.ir import simplify, uncovered
from teg.ir.arrays import Array, Gather, Ranged, Slope, Sum, Unit, open_indices
from teg.ir.cells import cell_leaves, replaced
from teg.ir.choices import Product, Winner
from teg.ir.expr import ONE, TRUE, ZERO, Const, Expr, Param, Var
from teg.ir.index import (
    APART,
    ArrayName,
    Index,
    IndexArray,
    IndexValue,
    IndexVar,
)
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.partition import Partition, Pullback, SeenSum
from teg.ir.show import shortened
from teg.ir.tables import RowSum, Table, TableUnit
from teg.numerics.cells import Layout
from teg.passes.lower.cut import parts_of, program_of
from teg.passes.lower.linear import has_units, outside_of, stages, taken_apart
from teg.passes.lower.nest import Level, Names
from teg.program import Assign, Program
from teg.program.arrays import (
    AddTo,
    Arg,
    ArrayProgram,
    ArraySpec,
    Blank,
    Cells,
    Combined,
    Factors,
    Gaps,
    Least,
    Like,
    Loop,
    Rows,
    Run,
    Scatter,
    SeenLoop,
    Step,
)
from teg.program.verify import verified_arrays

Schedule = Callable[[Sequence[Expr], Sequence[str], Sequence[Expr]], Program]
"""Returns a flat program of scalar outputs, given these, the names of the parameters, and the integrals whose derivatives they may hold."""
Places = Callable[[Sequence[Expr], Sequence[str], Var], Program]
"""Returns a flat program of the places where a candidate begins and ends to cover a line, which is a variable: given whether it covers it,
and the same at ties, the names of the parameters, and the variable. Of whether there is a place that matters, given where it does."""
_BEGIN = Program(("some", "first", "last"), (Assign("b0", "gt0", ("p0",)), Assign("v0", "select", ("b0", "p1", "p2"))), ("v0",))
FIRST_LAST = Param.make(f"{APART}first", ()), Param.make(f"{APART}last", ())
"""The ends of a line, for these programs."""
Output = Expr | tuple[Array, Expr]
"""A number, or an array and the derivative by it."""
_Place = tuple[int | str, Expr, Expr]
"""An output, or the name of a table; an expression with units that is added to it; a weight."""


def schedule_arrays(
    outputs: Sequence[Output],
    parameters: Sequence[str],
    arrays: Sequence[ArrayName],
    flat: tuple[Schedule, Places],
    differentiated: Sequence[Expr] = (),
) -> ArrayProgram:
    """Returns one program for several outputs, which may be derivatives of the `differentiated` expressions."""
    return verified_arrays(_Scheduler(parameters, arrays, flat, differentiated).run(outputs), "after schedule arrays")


def output_of(e: Expr) -> Output:
    """Returns a number as it is, and a derivative by an array with its array."""
    arrays = {n.array for n in postorder([e]) if isinstance(n, Unit)}
    return (arrays.pop(), e) if len(arrays) == 1 else e


def array_specs(arrays: Iterable[ArrayName]) -> tuple[ArraySpec, ...]:
    """Returns the form in which arrays are given."""
    return tuple(ArraySpec(a.name, a.dimensions, isinstance(a, IndexArray)) for a in arrays)


class _Scheduler:
    def __init__(
        self, parameters: Sequence[str], arrays: Sequence[ArrayName], flat: tuple[Schedule, Places], differentiated: Sequence[Expr]
    ) -> None:
        self.parameters, self.arrays = tuple(parameters), tuple(arrays)
        self.flat, self.places = flat
        self._sources = _sources(differentiated)
        self._names = Names(self.parameters, self.arrays)
        self._number, self._tables, self._rows = self._names.number, self._names.tables, self._names.rows
        self._fresh, self._integer, self._leaf = self._names.fresh, self._names.integer, self._names.leaf
        self._title: Callable[[Expr], str] = cache(lambda leaf: shortened(leaf, 60))
        self._open: dict[Node, frozenset[IndexVar]] = {}
        self._sloped: set[Node] = set()  # partitions of which derivatives are used

    def run(self, outputs: Sequence[Output]) -> ArrayProgram:
        top = Level(0, None, None)
        for k, name in enumerate(self.parameters):
            top.names[Param.make(name, ())] = f"p{k}"
        scalars = [e for e in outputs if isinstance(e, Expr)]
        derivatives = [(k, e[1], ONE) for k, e in enumerate(outputs) if not isinstance(e, Expr)]
        whole = simplify.tuple_of(*scalars, *(e for _, e, _ in derivatives))
        self._open = open_indices(whole)
        every = postorder([whole])
        self._sloped = {n.table for n in every if isinstance(n, Slope)}
        self._sloped.update(p for n in every if isinstance(n, Pullback) for p in n.partitions)
        names: dict[Expr, Arg] = {}
        for numbers, added in stages(scalars, derivatives):
            places: list[_Place] = []
            for to, leaf, weight in added:
                if not isinstance(to, int) and to not in self._rows:
                    self._rows[to] = self._blank(top, leaf)
                places.append((to if isinstance(to, int) else self._rows[to], leaf, weight))
            names.update(zip(numbers, self._level(top, numbers, places), strict=True))
        results = tuple(names[e] if isinstance(e, Expr) else Like(self._number[e[0]]) for e in outputs)
        return ArrayProgram(self.parameters, array_specs(self.arrays), tuple(top.steps), results)

    def _blank(self, top: Level, leaf: Expr) -> str:
        """Emits an empty table for a derivative by a table."""
        table = next(cast(Table, n.table) for n in postorder([leaf]) if isinstance(n, TableUnit))
        rows, name = self._integer(table.hi, top), self._fresh("i", top)
        top.steps.append(Blank(name, rows, len(table.numbers), tuple(self._number[a] for a in table.arrays)))
        return name

    # -- levels --------------------------------------------------------------------------------------------------------

    def _level(self, level: Level, roots: Sequence[Expr], linear: Sequence[_Place]) -> list[Arg]:
        """Emits steps for numbers, whose names are returned, and for arrays and tables: (output or table, expression with units, weight).

        The recursion is as deep as sums are nested.
        """
        units: list[tuple[int | str, Unit | TableUnit, Expr]] = []
        sums: list[tuple[int | str, Sum, Expr]] = []
        for output, e, weight in linear:
            for leaf, w in taken_apart(e, weight):
                if isinstance(leaf, Sum):
                    sums.append((output, leaf, w))
                else:
                    units.append((output, leaf, w))
        self._open.update(open_indices(simplify.tuple_of(*[w for _, _, w in (*units, *sums)])))
        self._loops(level, [*roots, *(w for _, _, w in units), *(w for _, _, w in sums)], sums)
        values = [*roots, *(w for _, _, w in units)]
        names = self._cell(level, values)
        for (output, unit, _), name in zip(units, names[len(roots) :], strict=True):
            if isinstance(unit, TableUnit):
                level.steps.append(AddTo(str(output), self._integer(unit.row, level), unit.column, name))
            else:
                places = tuple(self._integer(i, level) for i in unit.subscripts)
                level.steps.append(Scatter(int(output), self._number[unit.array], places, name))
        return names[: len(roots)]

    def _loops(self, level: Level, roots: Sequence[Expr], linear: Sequence[tuple[int | str, Sum, Expr]]) -> None:
        """Emits a loop for every sum of this level, in the order of their dependence."""
        bodies = [*roots, *(s for _, s, _ in linear)]
        outside = level.outwards()
        within = frozenset(at.index for at in outside if at.index is not None)
        mine: list[Ranged] = []
        height: dict[Node, int] = {}
        known = {s for at in outside for s in at.names if isinstance(s, Ranged)}
        for node in outside_of(known, bodies):
            height[node] = max((height.get(c, 0) for c in node.children), default=0)
            if isinstance(node, Ranged) and self._open[node] <= within and not has_units(node):
                height[node] += 1
                mine.append(node)
        groups: dict[tuple[int, IndexVar, Index, Index, int | Pullback], tuple[list[Node], list[_Place]]] = {}
        for node in mine:
            groups.setdefault((height[node], node.index, node.lo, node.hi, self._only(node)), ([], []))[0].append(node)
        for output, node, weight in linear:
            after = 1 + max(height.get(weight, 0), height.get(node.body, 0))
            groups.setdefault((after, node.index, node.lo, node.hi, self._only(node)), ([], []))[1].append((output, node.body, weight))
        for (_, k, lo, hi, only), (nodes, places) in sorted(groups.items(), key=lambda item: item[0][0]):
            sums = [n for n in nodes if isinstance(n, Sum)]
            if sums or places:
                loop, values = self._around(k, lo, hi, level, [s.body for s in sums], places)
                results = tuple(self._fresh("v", level) for _ in sums)
                title = k.name.split(APART)[0]
                if isinstance(only, Pullback):
                    level.steps.append(SeenLoop(*loop, values, results, title, -1, self._tables[only][0]))
                else:
                    level.steps.append(Loop(*loop, values, results, title, only))
                level.names.update(zip(sums, results, strict=True))
            products = [n for n in nodes if isinstance(n, Product)]
            if products:
                loop, values = self._around(k, lo, hi, level, [n.body for n in products])
                results = tuple(self._fresh("v", level) for _ in products)
                level.steps.append(Factors(*loop, values, results, k.name))
                level.names.update(zip(products, results, strict=True))
            winners = [n for n in nodes if isinstance(n, Winner)]
            if winners:
                numbers = [cast(Expr, n.children[i]) for i in (0, 1) for n in winners]
                loop, values = self._around(k, lo, hi, level, numbers)
                results = tuple(self._fresh("v", level) for _ in winners)
                level.steps.append(Least(*loop, values[: len(winners)], results, k.name, eligible=values[len(winners) :]))
                level.names.update(zip(winners, results, strict=True))
            self._partitions([n for n in nodes if isinstance(n, Partition)], level)
            self._gaps([n for n in nodes if isinstance(n, uncovered.Gaps)], level)
            for node in nodes:
                if isinstance(node, Table):
                    self._rows[node] = self._table(node, level)
                elif isinstance(node, Pullback):
                    self._pullback(node, level)

    def _around(
        self,
        k: IndexVar,
        lo: Index,
        hi: Index,
        level: Level,
        numbers: Sequence[Expr],
        places: Sequence[_Place] = (),
    ) -> tuple[tuple[str, Arg, Arg, tuple[Step, ...]], tuple[Arg, ...]]:
        """Returns the first fields of a loop, and the names of the numbers that an iteration computes."""
        inner = Level(level.depth + 1, k, level)
        index = self._fresh("i", inner)
        inner.names[k] = index
        bounds = self._integer(lo, level), self._integer(hi, level)
        values = self._level(inner, numbers, places)
        return (index, *bounds, tuple(inner.steps)), tuple(values)

    def _listed(self, node: Ranged) -> int:
        """Returns the array of indices whose entries are the only iterations, or -1."""
        return self._number[node.listed] if isinstance(node, Table | RowSum) else -1

    def _only(self, node: Ranged) -> int | Pullback:
        """Returns what says which iterations matter: a pullback, or the array of indices of `_listed`."""
        return node.pullback if isinstance(node, SeenSum) else self._listed(node)

    def _pullback(self, node: Pullback, level: Level) -> None:
        """Emits the table of a weighted sum of partitions."""
        name = self._fresh("i", level)
        weights = tuple(self._cell(level, node.weights))
        level.steps.append(Combined(name, tuple(self._tables[p][0] for p in node.partitions), weights, node.layout))
        level.names[node] = name
        self._tables[node] = name, node.layout

    def _table(self, node: Table, level: Level) -> str:
        """Emits the rows of a table; returns its name."""
        loop, values = self._around(node.index, node.lo, node.hi, level, node.numbers)
        name = self._fresh("i", level)
        arrays = tuple(self._number[a] for a in node.arrays)
        level.steps.append(Rows(*loop, values, (), node.index.name.split(APART)[0], self._listed(node), name, arrays))
        level.names[node] = name
        return name

    def _partitions(self, nodes: Sequence[Partition], level: Level) -> None:
        """Emits the cells of partitions over one range; those with the same guards and keys share their cells."""
        shared: dict[tuple[Layout, tuple[Expr, ...]], list[Partition]] = {}
        for node in nodes:
            shape = node.layout
            first = shape.columns
            decide = (*node.candidate[: shape.forms], *node.candidate[first : first + shape.forms])
            shared.setdefault((shape._replace(degree=0), decide), []).append(node)
        for (_, decide), group in shared.items():
            shape = group[0].layout._replace(degree=max(n.layout.degree for n in group))
            forms, orders = shape.forms, range(1 + shape.order)
            numbers: list[Expr] = []
            others: list[Expr] = []
            for order in orders:
                numbers += decide[order * forms : (order + 1) * forms]
                numbers += [c for n in group for c in _padded(n, order, shape, n.candidate[forms:], n.layout.columns)]
                others += [c for n in group for c in _padded(n, order, shape, n.otherwise, n.layout.coefficients)]
            k = group[0].index
            loop, values = self._around(k, group[0].lo, group[0].hi, level, numbers)
            otherwise = tuple(self._cell(level, others))
            results = tuple(self._fresh("v", level) for _ in group)
            tables = tuple(self._fresh("i", level) for _ in group) if any(n in self._sloped for n in group) else ()
            level.steps.append(Cells(*loop, values, results, k.name, -1, shape, otherwise, tables))
            level.names.update(zip(group, results, strict=True))
            self._tables.update((n, (table, shape)) for n, table in zip(group, tables, strict=False))

    def _gaps(self, nodes: Sequence[uncovered.Gaps], level: Level) -> None:
        """Emits sums over gaps; those over the same gaps share them."""
        shared: dict[tuple[object, ...], list[uncovered.Gaps]] = {}
        for node in sorted(nodes, key=lambda n: n.is_moving, reverse=True):  # there is one direction in which ends move
            shared.setdefault(node.line, []).append(node)
        for group in shared.values():
            node = group[0]
            assert all(n.children[6:] in ((), node.children[6:]) for n in group), "ends of the same gaps have the same velocities"
            first, last = self._ends(group, level)
            outer = tuple(self._cell(level, node.outer_velocities))
            inner, gap = Level(level.depth + 1, node.index, level), Level(level.depth + 1, None, level)
            index, (left, right) = self._fresh("i", inner), (self._fresh("v", gap) for _ in node.ends)
            moving = tuple(self._fresh("v", gap) for _ in outer)
            inner.names.update({node.index: index, FIRST_LAST[0]: first, FIRST_LAST[1]: last})
            gap.names.update(zip((*node.ends, *uncovered.VELOCITIES), (left, right, *moving), strict=False))
            bounds = self._integer(node.lo, level), self._integer(node.hi, level)
            numbers = tuple(self._flat(inner, [node.covered, node.tie, *node.velocities], line=node.variable))
            count = 3 * ((len(numbers) - 3) // 4) + 3 if node.is_moving else len(numbers)
            values, velocities = numbers[:count], numbers[count:]
            terms = tuple(self._level(gap, [n.term for n in group], ()))
            results = tuple(self._fresh("v", level) for _ in group)
            loop = Gaps(index, *bounds, tuple(inner.steps), values, results, node.index.name.split(APART)[0])
            line = replace(loop, first=first, last=last, left=left, right=right, inside=tuple(gap.steps), terms=terms)
            level.steps.append(replace(line, velocities=velocities, outer=outer, moving=moving))
            level.names.update(zip(group, results, strict=True))

    def _ends(self, group: Sequence[uncovered.Gaps], level: Level) -> tuple[Arg, Arg]:
        """Returns the ends of a line, which is a point where no place matters."""
        first, last = self._cell(level, cast("Sequence[Expr]", group[0].children[:2]))
        matters = simplify.disjunction(*(simplify.nonzero_part(n.matters)[0] for n in group))
        if matters is TRUE:
            return first, last
        level.names.update({FIRST_LAST[0]: first, FIRST_LAST[1]: last})
        (some,) = self._flat(level, [simplify.bracket(matters)], line=group[0].variable)
        begin = self._fresh("v", level)
        level.steps.append(Run(_BEGIN, (some, first, last), (begin,)))
        return begin, last

    # -- cells ---------------------------------------------------------------------------------------------------------

    def _cell(self, level: Level, values: Sequence[Expr]) -> list[Arg]:
        """Returns names of numbers at a level. Expressions are computed by flat programs, cut where they stop depending on an index."""
        simple = dict.fromkeys(v for v in values if isinstance(v, Const | Gather | IndexValue) or level.known(v) is not None)
        rest = list(dict.fromkeys(v for v in values if v not in simple))
        names: dict[Expr, Arg] = {v: float(v.data) if isinstance(v, Const) else self._leaf(v, level) for v in simple}
        if rest:
            names.update(zip(rest, self._flat(level, rest), strict=True))
        return [names[v] for v in values]

    def _flat(self, level: Level, roots: Sequence[Expr], line: Var | None = None) -> list[Arg]:
        leaves = cell_leaves(roots)
        if any(isinstance(leaf, Unit) for leaf in leaves):
            raise DeltaError(
                "a derivative by an array stands in no linear position", roots[0], "it may be added, and multiplied by numbers"
            )
        symbols = {leaf: Param.make(f"\x01{k}", ()) for k, leaf in enumerate(leaves)}
        cells = replaced(roots, cast("Mapping[Node, Expr]", symbols))
        inputs = [self._leaf(leaf, level) for leaf in leaves]
        plain = [p for p in postorder(cells) if isinstance(p, Param) and p not in set(symbols.values())]
        plain += FIRST_LAST if line is not None else ()
        given = [*inputs, *(self._leaf(p, level) for p in plain)]
        names = [*(s.name for s in symbols.values()), *(p.name for p in plain)]
        program = self.flat(cells, names, self._sources_of(symbols)) if line is None else self.places(cells, names, line)
        program = replace(program, parameters=(*map(self._title, leaves), *(p.name for p in plain)))
        return self._split(level, program, given, [self._names.depth(a) for a in given])

    def _sources_of(self, symbols: Mapping[Expr, Param]) -> list[Expr]:
        """Returns the integrals whose derivatives may be in a cell: those that need no other leaves than it has."""
        near = [source for first in (None, *symbols) for source in self._sources.get(first, ())]
        return replaced([i for i, leaves in near if leaves <= symbols.keys()], cast("Mapping[Node, Expr]", symbols)) if near else []

    def _split(self, level: Level, program: Program, given: Sequence[Arg], depths: Sequence[int]) -> list[Arg]:
        """Returns the results of a flat program that is cut: statements without an inner index go further out."""
        name: dict[str, Arg] = {f"p{k}": a for k, a in enumerate(given)}
        levels = list(reversed(level.outwards()))
        for at, part in zip(levels, parts_of(program, depths, [at.depth for at in levels]), strict=True):
            if part.across:
                flat, used = program_of(part, program)
                results = tuple(self._fresh("v", at) for _ in part.across)
                at.steps.append(Run(flat, tuple(name[n] for n in used), results))
                name.update(zip(part.across, results, strict=True))
        return [name[o] if isinstance(o, str) else float(o) for o in program.outputs]


def _padded(node: Partition, order: int, shape: Layout, numbers: Sequence[Expr], length: int) -> Sequence[Expr]:
    """Returns the coefficients of a polynomial, or their direction, with 0 for those that a polynomial of lower degree does not have;
    `length` is the distance between both."""
    own = node.layout.coefficients
    return [*numbers[order * length : order * length + own], *[ZERO] * (shape.coefficients - own)]


def _sources(roots: Sequence[Expr]) -> dict[Expr | None, list[tuple[Expr, frozenset[Expr]]]]:
    """Returns all integrals, each with its leaves, by the first of these; None for one without leaves."""
    found: dict[Expr | None, list[tuple[Expr, frozenset[Expr]]]] = {}
    for node in postorder(roots):
        if isinstance(node, Integral):
            leaves = cell_leaves([node])
            found.setdefault(leaves[0] if leaves else None, []).append((node, frozenset(leaves)))
    return found
