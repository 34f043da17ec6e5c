"""Levels: the inside of each integral, and the outside of all, with the statements and names there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.analysis.breaks import Breaks
from teg.ir.expr import Compare, Cond, Expr, Var
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.program import Arg, Stmt

Truths = tuple[Arg, Arg]  # holds, fails


@dataclass
class Level:
    """The inside of one integral, or the outside of all: where statements go, and the nodes that have a name.

    An integral has two levels: the nodes of a piece, and its `middle`, where everything that is constant on the piece is evaluated.
    """

    var: Var | None
    outer: Level | None
    depth: int
    breaks: Breaks | None = None
    middle: Level | None = None
    block: list[Stmt] = field(default_factory=list)
    names: dict[Node, Arg | Truths] = field(default_factory=dict)
    computed: dict[tuple[str, tuple[Arg, ...]], str] = field(default_factory=dict)
    errors: dict[Expr, Arg] = field(default_factory=dict)
    groups: dict[Integral, list[Integral]] = field(default_factory=dict)
    guards: dict[Integral, Cond] = field(default_factory=dict)
    weights: dict[Integral, Expr] = field(default_factory=dict)  # the factors by which integrals are multiplied while they are computed
    relative: set[Integral] = field(default_factory=set)  # the integrals of which every digit counts, however small they are
    is_relative: bool = False  # whether this is inside of such an integral
    searches: dict[object, tuple[str | None, tuple[Arg, ...]]] = field(default_factory=dict)
    coincident: dict[Compare, Arg] = field(default_factory=dict)  # for a sum over roots: the conditions that may tie with its surface
    constant: dict[Node, bool] = field(default_factory=dict)  # on a piece
    elsewhere: Callable[[], Sequence[Level]] | None = None  # for a middle: other places of the piece, where its ties are evaluated again
    twisted: bool = False  # at a root of a surface that is not a polynomial of low degree: no function there is one
    coordinates: dict[Integral, str] | None = (
        None  # for the nest of integrals that is sampled here: the coordinates of all but the outermost one
    )
    constants: Level | None = None  # the level for values that are constant here, computed as one factor or term; powers here are products

    def inside(self, var: Var, name: Arg) -> Level:
        """Returns the level one deeper, where a variable has that name."""
        return Level(var, self, self.depth + 1, names={var: name}, coordinates=self.coordinates)

    def is_constant(self, node: Node) -> bool:
        """Returns whether the node depends on this level's variable only through conditions that are constant on a piece."""
        known, handled = self.constant, cast(Breaks, self.breaks).handled
        stack = [node]
        while stack:
            n = stack[-1]
            if n in known:
                stack.pop()
            elif self.var not in n.free:
                known[n] = True
                stack.pop()
            elif isinstance(n, Var | Integral):
                known[n] = False
                stack.pop()
            elif isinstance(n, Compare):
                known[n] = n.g in handled
                stack.pop()
            elif missing := [c for c in n.children if c not in known]:
                stack.extend(missing)
            else:
                known[n] = all(known[c] for c in n.children)
                stack.pop()
        return known[node]


Plan = Callable[[Level, Sequence[Expr]], None]
"""Finds the integrals that belong to a new level, before anything there is emitted."""
