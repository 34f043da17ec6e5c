"""From an outlined expression, and derivatives by arrays, to the loops of `teg.program.arrays`.

Level by level. What a level needs of sums becomes loops, those over the same range one loop; what the level computes itself is one cell,
scheduled to one flat program whose parameters are entries, integers, and the sums' results. Then each flat program is cut where its
statements stop depending on an index: what is the same for all iterations of a loop runs before it (`_split`).

A derivative by an array, Σ_k w_k·1[V; F[k]], is taken apart into its places and what is added there; a weight in front of a sum goes
inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from teg.errors import DeltaError
from teg.ir import expr as ex
from teg.ir.arrays import Array, Gather, Sum, Unit, open_indices
from teg.ir.cells import cell_leaves, replaced
from teg.ir.expr import ONE, ZERO, Add, Const, Expr, Mul, Param, Where, add, mul, where
from teg.ir.index import (
    ArrayName,
    Index,
    IndexArray,
    IndexCall,
    IndexConst,
    IndexGather,
    IndexParam,
    IndexValue,
    IndexVar,
    Length,
    index_leaves,
)
from teg.ir.node import Node, postorder
from teg.program import Assign, Program, Stmt, assigned, free_names, has_ties
from teg.program.arrays import Arg, ArrayProgram, ArraySpec, Integers, Like, Load, Loop, Number, Run, Scatter, Step
from teg.program.dce import without_dead_code
from teg.program.fields import renamed
from teg.program.verify import verified_arrays

Schedule = Callable[[Sequence[Expr], Sequence[str]], Program]
"""A flat program of scalar outputs, given them and the names of the parameters."""
Output = Expr | tuple[Array, Expr]
"""A number, or an array and the derivative by it."""


def schedule_arrays(outputs: Sequence[Output], parameters: Sequence[str], arrays: Sequence[ArrayName], flat: Schedule) -> ArrayProgram:
    """One program for several outputs."""
    return verified_arrays(_ArrayScheduler(parameters, arrays, flat).run(outputs), "after schedule arrays")


def output_of(e: Expr) -> Output:
    """A number, or what a derivative by an array is."""
    arrays = {n.array for n in postorder([e]) if isinstance(n, Unit)}
    return (arrays.pop(), e) if len(arrays) == 1 else e


def array_specs(arrays: Iterable[ArrayName]) -> tuple[ArraySpec, ...]:
    """How arrays are given."""
    return tuple(ArraySpec(a.name, a.dimensions, isinstance(a, IndexArray)) for a in arrays)


@dataclass(slots=True)
class _Level:
    """One loop: its index, its name, the steps so far, and what has a name there."""

    depth: int
    index: IndexVar | None
    outer: _Level | None
    names: dict[Node, Arg] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)


class _ArrayScheduler:
    def __init__(self, parameters: Sequence[str], arrays: Sequence[ArrayName], flat: Schedule) -> None:
        self.parameters = tuple(parameters)
        self.arrays = tuple(arrays)
        self.flat = flat
        self._number = {a: k for k, a in enumerate(self.arrays)}
        self._count = 0
        self._depth: dict[Arg, int] = {}  # of names: the level where they are given
        self._open: dict[Node, frozenset[IndexVar]] = {}

    def run(self, outputs: Sequence[Output]) -> ArrayProgram:
        top = _Level(0, None, None)
        for k, name in enumerate(self.parameters):
            top.names[Param.make(name, ())] = f"p{k}"
        scalars = [e for e in outputs if isinstance(e, Expr)]
        places = [(k, e[1], ONE) for k, e in enumerate(outputs) if not isinstance(e, Expr)]
        self._open = open_indices(ex.tuple_of(*scalars, *(e for _, e, _ in places)))
        names = iter(self._level(top, scalars, places))
        results = tuple(next(names) if isinstance(e, Expr) else Like(self._number[e[0]]) for e in outputs)
        return ArrayProgram(self.parameters, array_specs(self.arrays), tuple(top.steps), results)

    def _fresh(self, kind: str, level: _Level) -> str:
        self._count += 1
        name = f"{kind}{self._count}"
        self._depth[name] = level.depth
        return name

    # -- levels --------------------------------------------------------------------------------------------------------

    def _level(self, level: _Level, roots: Sequence[Expr], linear: Sequence[tuple[int, Expr, Expr]]) -> list[Arg]:
        """Steps for numbers, whose names are returned, and for arrays: (output, expression with units, weight). Recursion is as deep as
        sums stand inside each other."""
        units: list[tuple[int, Unit, Expr]] = []
        sums: list[tuple[int, Sum, Expr]] = []
        for output, e, weight in linear:
            for leaf, w in _taken_apart(e, weight):
                if isinstance(leaf, Sum):
                    sums.append((output, leaf, w))
                else:
                    units.append((output, leaf, w))
        self._open.update(open_indices(ex.tuple_of(*[w for _, _, w in (*units, *sums)])))
        self._loops(level, [*roots, *(w for _, _, w in units), *(w for _, _, w in sums)], sums)
        values = [*roots, *(w for _, _, w in units)]
        names = self._cell(level, values)
        for (output, unit, _), name in zip(units, names[len(roots) :], strict=True):
            level.steps.append(Scatter(output, self._number[unit.array], tuple(self._integer(i, level) for i in unit.subscripts), name))
        return names[: len(roots)]

    def _loops(self, level: _Level, roots: Sequence[Expr], linear: Sequence[tuple[int, Sum, Expr]]) -> None:
        """A loop for every sum that belongs to this level, those that others need first."""
        bodies = [*roots, *(s for _, s, _ in linear)]
        outside = self._indices(level)
        within = frozenset(self._bound(level))
        mine: list[Sum] = []
        height: dict[Node, int] = {}
        known = {s for at in outside for s in at.names if isinstance(s, Sum)}
        for node in _outside_of(known, bodies):
            height[node] = max((height.get(c, 0) for c in node.children), default=0)
            if isinstance(node, Sum) and self._open[node] <= within and not _has_units(node):
                height[node] += 1
                mine.append(node)
        groups: dict[tuple[int, IndexVar, Index, Index], tuple[list[Sum], list[tuple[int, Expr, Expr]]]] = {}
        for node in mine:
            groups.setdefault((height[node], node.index, node.lo, node.hi), ([], []))[0].append(node)
        for output, node, weight in linear:
            after = 1 + max(height.get(weight, 0), height.get(node.body, 0))
            groups.setdefault((after, node.index, node.lo, node.hi), ([], []))[1].append((output, node.body, weight))
        for (_, k, lo, hi), (scalars, places) in sorted(groups.items(), key=lambda item: item[0][0]):
            inner = _Level(level.depth + 1, k, level)
            index = self._fresh("i", inner)
            inner.names[k] = index
            bounds = self._integer(lo, level), self._integer(hi, level)
            values = self._level(inner, [s.body for s in scalars], places)
            results = tuple(self._fresh("v", level) for _ in scalars)
            level.steps.append(Loop(index, *bounds, tuple(inner.steps), tuple(values), results, k.name))
            level.names.update(zip(scalars, results, strict=True))

    def _bound(self, level: _Level | None) -> Iterable[IndexVar]:
        while level is not None:
            if level.index is not None:
                yield level.index
            level = level.outer

    def _indices(self, level: _Level) -> list[_Level]:
        found = []
        at: _Level | None = level
        while at is not None:
            found.append(at)
            at = at.outer
        return found

    def _known(self, node: Node, levels: Sequence[_Level]) -> Arg | None:
        return next((at.names[node] for at in levels if node in at.names), None)

    def _home(self, node: Node, level: _Level, opened: frozenset[IndexVar]) -> _Level:
        """The outermost level where the indices of a node exist."""
        at = level
        while at.outer is not None and at.index not in opened:
            at = at.outer
        return at

    # -- integers and leaves -------------------------------------------------------------------------------------------

    def _integer(self, root: Index, level: _Level) -> Arg:
        levels = self._indices(level)
        opened: dict[Node, frozenset[IndexVar]] = {}
        for node in index_leaves([root]):
            opened[node] = frozenset((node,)) if isinstance(node, IndexVar) else frozenset().union(*(opened[c] for c in node.children))
            if isinstance(node, IndexConst) or self._known(node, levels) is not None:
                continue
            home = self._home(node, level, opened[node])
            args = tuple(self._integer_name(c, levels) for c in node.children)
            name = self._fresh("i", home)
            match node:
                case IndexCall():
                    home.steps.append(Integers(name, node.data, args))
                case IndexGather():
                    home.steps.append(Integers(name, "gather", args, self._number[node.array]))
                case Length():
                    home.steps.append(Integers(name, "length", (node.axis,), self._number[node.array]))
                case IndexParam():
                    home.steps.append(Integers(name, "param", (self.parameters.index(node.param.name),)))
                case _:
                    raise AssertionError(f"the index {node} has no sum")
            home.names[node] = name
        return self._integer_name(root, levels)

    def _integer_name(self, node: Node, levels: Sequence[_Level]) -> Arg:
        if isinstance(node, IndexConst):
            return int(node.data)
        return cast(Arg, self._known(node, levels))

    def _leaf(self, leaf: Expr, level: _Level) -> Arg:
        """The name of an entry, an integer as a number, a parameter, or a sum."""
        levels = self._indices(level)
        known = self._known(leaf, levels)
        if known is not None:
            return known
        match leaf:
            case Gather():
                places = tuple(self._integer(i, level) for i in leaf.subscripts)
            case IndexValue():
                places = (self._integer(leaf.index, level),)
            case _:
                raise AssertionError(f"{type(leaf).__name__} has no name")
        depth = max((self._depth.get(i, 0) for i in places), default=0)
        home = next(at for at in levels if at.depth == depth)
        name = self._fresh("v", home)
        home.steps.append(Load(name, self._number[leaf.array], places) if isinstance(leaf, Gather) else Number(name, places[0]))
        home.names[leaf] = name
        return name

    # -- cells ---------------------------------------------------------------------------------------------------------

    def _cell(self, level: _Level, values: Sequence[Expr]) -> list[Arg]:
        """Names of numbers at a level: what is no leaf is computed by flat programs, cut where they stop depending on an index."""
        levels = self._indices(level)
        simple = {v for v in values if isinstance(v, Const | Gather | IndexValue) or self._known(v, levels) is not None}
        rest = list(dict.fromkeys(v for v in values if v not in simple))
        names: dict[Expr, Arg] = {v: float(v.data) if isinstance(v, Const) else self._leaf(v, level) for v in simple}
        if rest:
            names.update(zip(rest, self._flat(level, rest), strict=True))
        return [names[v] for v in values]

    def _flat(self, level: _Level, roots: Sequence[Expr]) -> list[Arg]:
        leaves = cell_leaves(roots)
        if any(isinstance(leaf, Unit) for leaf in leaves):
            raise DeltaError(
                "a derivative by an array stands in no linear position", roots[0], "it may be added, and multiplied by numbers"
            )
        symbols = {leaf: Param.make(f"\x01{k}", ()) for k, leaf in enumerate(leaves)}
        cells = replaced(roots, cast("Mapping[Node, Expr]", symbols))
        inputs = [self._leaf(leaf, level) for leaf in leaves]
        plain = [p for p in postorder(cells) if isinstance(p, Param) and p not in set(symbols.values())]
        given = [*inputs, *(self._leaf(p, level) for p in plain)]
        program = self.flat(cells, [*(s.name for s in symbols.values()), *(p.name for p in plain)])
        program = replace(program, parameters=(*(str(leaf)[:60] for leaf in leaves), *(p.name for p in plain)))
        depths = [self._depth.get(a, 0) if isinstance(a, str) else 0 for a in given]
        return self._split(level, program, given, depths)

    def _split(self, level: _Level, program: Program, given: Sequence[Arg], depths: Sequence[int]) -> list[Arg]:
        """A flat program, cut: statements that depend on no index of the inner levels go further out. What meets ties stays together."""
        depth: dict[str, int] = {f"p{k}": d for k, d in enumerate(depths)}
        home: list[int] = []
        for stmt in program.body:
            used = free_names(stmt)
            here = level.depth if has_ties((stmt,)) else max((depth[n] for n in used), default=0)
            home.append(here)
            depth.update(dict.fromkeys(assigned(stmt), here))
        asked = [o for o in dict.fromkeys(program.outputs) if isinstance(o, str)]
        name: dict[str, Arg] = {f"p{k}": a for k, a in enumerate(given)}
        for at in reversed(self._indices(level)):
            block = tuple(s for s, here in zip(program.body, home, strict=True) if here == at.depth)
            elsewhere = {n for s, here in zip(program.body, home, strict=True) if here != at.depth for n in free_names(s)}
            across = [n for s in block for n in assigned(s) if n in elsewhere or n in asked]
            name.update(zip(across, self._run(at, block, across, name, program), strict=True))
        return [name[o] if isinstance(o, str) else float(o) for o in program.outputs]

    def _run(self, at: _Level, block: tuple[Stmt, ...], across: Sequence[str], name: Mapping[str, Arg], program: Program) -> list[str]:
        """The results of a part of a flat program; a boolean is handed on as 1 or 0."""
        if not across:
            return []
        used = {n: None for s in block for n in free_names(s) if n in name}
        number = {n: f"p{k}" for k, n in enumerate(used)}
        truths = [n for n in used if n[0] == "b"]
        number.update((n, f"b{n}") for n in truths)
        before = [Assign(f"b{n}", "gt0", (f"p{k}",)) for k, n in enumerate(used) if n[0] == "b"]
        after = [Assign(f"v{n}", "select", (n, 1.0, 0.0)) for n in across if n[0] == "b"]
        results = tuple(f"v{n}" if n[0] == "b" else n for n in across)
        titles = tuple(program.parameters[int(n[1:])] if n[0] == "p" else n for n in used)
        body = (*before, *(renamed(s, number) for s in block), *after)
        ties = program.ties if has_ties(block) else ()
        part = without_dead_code(replace(program, parameters=titles, body=body, outputs=results, ties=ties))
        names = tuple(self._fresh("v", at) for _ in across)
        at.steps.append(Run(part, tuple(name[n] for n in used), names))
        return list(names)


def _outside_of(known: set[Sum], roots: Sequence[Node]) -> list[Node]:
    """Every node, children first, but for what has been computed and what is in it: there, an index may be that of another loop."""
    order: list[Node] = []
    done: set[Node] = set(known)
    stack: list[tuple[Node, bool]] = [(r, False) for r in reversed(roots)]
    while stack:
        node, finished = stack.pop()
        if finished:
            order.append(node)
        elif node not in done:
            done.add(node)
            stack.append((node, True))
            stack.extend((c, False) for c in reversed(node.children))
    return order


def _taken_apart(e: Expr, weight: Expr) -> list[tuple[Unit | Sum, Expr]]:
    """weight·e, e linear in units and in sums that hold some, as the weights of these."""
    parts: dict[Node, list[Expr]] = {e: [weight]}
    found: list[tuple[Unit | Sum, Expr]] = []
    order = postorder([e])
    holds: set[Node] = set()
    for node in order:
        if isinstance(node, Unit) or any(c in holds for c in node.children):
            holds.add(node)
    for node in reversed(order):
        if node not in parts:
            continue
        w = add(*parts.pop(node))
        if isinstance(node, Unit | Sum):
            found.append((node, w))
        elif isinstance(node, Add):
            for c in node.children:
                parts.setdefault(c, []).append(w)
        elif isinstance(node, Mul):
            holding = [c for c in node.children if c in holds]
            others = mul(*(c for c in node.children if c is not holding[0]))
            parts.setdefault(holding[0], []).append(mul(w, others))
        elif isinstance(node, Where):
            parts.setdefault(node.then, []).append(where(node.condition, w, ZERO))
            parts.setdefault(node.otherwise, []).append(where(node.condition, ZERO, w))
        elif node is not ZERO:
            raise DeltaError("a derivative by an array stands in no linear position", node, "it may be added, and multiplied by numbers")
    return found


def _has_units(root: Node) -> bool:
    return any(isinstance(n, Unit) for n in postorder([root]))
