"""The levels of a nest of loops, and what has a name at one: entries of arrays, integers, parameters, sums, rows of tables.

What is loaded or computed for a name goes to the outermost level where the indices that it needs exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.ir.arrays import Gather, Placed, Slope
from teg.ir.expr import Expr
from teg.ir.index import ArrayName, Index, IndexCall, IndexConst, IndexGather, IndexParam, IndexValue, IndexVar, Length, index_leaves
from teg.ir.node import Node
from teg.ir.partition import Partition, Pullback
from teg.numerics.cells import Layout
from teg.program.arrays import Arg, Integers, Load, Number, Step, Take


@dataclass(slots=True)
class Level:
    """One loop: its index, its name, the steps so far, and the nodes that have a name there."""

    depth: int
    index: IndexVar | None
    outer: Level | None
    names: dict[Node, Arg] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)

    def outwards(self) -> list[Level]:
        """Returns this level and those around it."""
        found = [self]
        while found[-1].outer is not None:
            found.append(found[-1].outer)
        return found

    def known(self, node: Node) -> Arg | None:
        """Returns the name of a node, here or further out; None if it has none."""
        return _known(node, self.outwards())


class Names:
    """The names of a program of loops, each of which is defined once.

    `number` has the place of each array among the arguments; `tables` the name and the layout of tables of partitions; `rows` the name of
    a table, or of a derivative by one.
    """

    def __init__(self, parameters: Sequence[str], arrays: Sequence[ArrayName]) -> None:
        self.parameters = tuple(parameters)
        self.number = {a: k for k, a in enumerate(arrays)}
        self.tables: dict[Expr, tuple[str, Layout]] = {}
        self.rows: dict[Node, str] = {}
        self._depth: dict[str, int] = {}

    def fresh(self, kind: str, level: Level) -> str:
        """Returns a new name for a number (v) or an integer (i) of a level."""
        name = f"{kind}{len(self._depth) + 1}"
        self._depth[name] = level.depth
        return name

    def depth(self, name: Arg) -> int:
        """Returns the depth of the level where a name is defined: 0 for parameters and literal numbers."""
        return self._depth.get(name, 0) if isinstance(name, str) else 0

    def integer(self, root: Index, level: Level) -> Arg:
        """Returns the name of an integer."""
        levels = level.outwards()
        opened: dict[Node, frozenset[IndexVar]] = {}
        for node in index_leaves([root]):
            opened[node] = frozenset((node,)) if isinstance(node, IndexVar) else frozenset().union(*(opened[c] for c in node.children))
            if isinstance(node, IndexConst) or _known(node, levels) is not None:
                continue
            home = next(at for at in levels if at.outer is None or at.index in opened[node])
            args = tuple(_integer_name(c, levels) for c in node.children)
            name = self.fresh("i", home)
            match node:
                case IndexCall():
                    home.steps.append(Integers(name, node.data, args))
                case IndexGather():
                    home.steps.append(Integers(name, "gather", args, self.number[node.array]))
                case Length():
                    home.steps.append(Integers(name, "length", (node.axis,), self.number[node.array]))
                case IndexParam():
                    home.steps.append(Integers(name, "param", (self.parameters.index(node.param.name),)))
                case _:
                    raise AssertionError(f"the index {node} has no sum")
            home.names[node] = name
        return _integer_name(root, levels)

    def leaf(self, leaf: Expr, level: Level) -> Arg:
        """Returns the name of an entry, an integer as a number, a parameter, or a sum."""
        levels = level.outwards()
        known = _known(leaf, levels)
        if known is not None:
            return known
        match leaf:
            case Gather():
                places = tuple(self.integer(i, level) for i in leaf.subscripts)
            case IndexValue():
                places = (self.integer(leaf.index, level),)
            case Slope():
                table, shape = self.tables[leaf.table]
                places = (self.integer(leaf.row, level), table)
            case Placed():
                places = (self.integer(leaf.row, level), self.rows[leaf.table])
            case _:
                raise AssertionError(f"{type(leaf).__name__} has no name")
        depth = max(map(self.depth, places), default=0)
        home = next(at for at in levels if at.depth == depth)
        name = self.fresh("v", home)
        match leaf:
            case Gather():
                home.steps.append(Load(name, self.number[leaf.array], places))
            case Slope():
                columns = cast("Partition | Pullback", leaf.table).layout.columns
                column = leaf.column % columns + shape.columns * (leaf.column // columns)
                home.steps.append(Take(name, table, places[0], column))
            case Placed():
                home.steps.append(Take(name, str(places[1]), places[0], leaf.column))
            case _:
                home.steps.append(Number(name, places[0]))
        home.names[leaf] = name
        return name


def _known(node: Node, levels: Sequence[Level]) -> Arg | None:
    return next((at.names[node] for at in levels if node in at.names), None)


def _integer_name(node: Node, levels: Sequence[Level]) -> Arg:
    if isinstance(node, IndexConst):
        return int(node.data)
    return cast(Arg, _known(node, levels))
