"""What covers places of a curve, with conditions in the terms of its chart: as polynomials, whose roots are found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

from teg.ir.cells import Symbols, replaced
from teg.ir.expr import Compare, Cond, Expr, Var
from teg.ir.function import Apply, Slot
from teg.ir.node import Node
from teg.ir.simplify import positive
from teg.ir.traverse import fresh, rewrite_below
from teg.ir.uncovered import marks_of

Moved = Callable[[Expr, Sequence[Var], Sequence[Var]], Expr]
"""A function of the variables of a place, as one with the same sign of the terms of a chart."""


def with_conditions_at(value: Expr, at: Sequence[Expr], moved: Moved, terms: Sequence[Expr]) -> Expr:
    """Returns a value in which what covers the place `at` has conditions on the `terms` of a chart, which `moved` makes."""
    found: dict[Node, Expr] = {}
    for mark in marks_of(value):
        around, names = cast(Slot, mark.callee).data[4]
        if (arguments := mark.children)[: len(at)] == tuple(at):
            about: list[Var] = []
            for _ in terms:
                about.append(fresh("term", [*names, *about]))
            condition, within = (_moved(c, names, about, moved) for c in (around.condition, around.within))
            n = len(names) + len(about)
            callee = Slot.make((0, n, n, None, (around._replace(condition=condition, within=within), (*names, *about))), ())
            found[mark] = Apply.make((callee, (0,) * n), (*arguments, *terms))
    return replaced([value], found)[0]


def _moved(condition: Cond, names: Sequence[Var], about: Sequence[Var], moved: Moved) -> Cond:
    symbols = Symbols()
    (cell,) = symbols.into([cast(Expr, condition)])

    def replacement(node: Node) -> Node | None:
        if not isinstance(node, Compare) or node.free.isdisjoint(names):
            return None
        return positive(moved(node.g, names, about), node.strict, node.resolution, node.rivals)

    return cast(Cond, symbols.out_of([cast(Expr, rewrite_below([cell], replacement)[cell])])[0])
