"""What must hold, free of variables of integration, for atoms of a condition to matter, and on which side of them it holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.ir.expr import FALSE, TRUE, And, Compare, Cond, Not, Or
from teg.ir.node import Node, postorder
from teg.ir.simplify import conjunction, disjunction, negation


def gates_of(condition: Cond, atoms: Sequence[Compare]) -> tuple[Cond, Cond]:
    """Returns the conditions under which any of some atoms stands in a condition as it is, and under which as its negation.

    a & (g > 0) | ~a & ~(g > 0), with `a` free of variables, gives `a` and `~a` for the atom g > 0. What may tie is left
    out, for there both sides count. Cost: a visit a node.
    """
    gates: dict[tuple[Node, bool], list[Cond]] = {(condition, True): [TRUE]}
    for node in reversed(postorder([condition])):
        for upright in (True, False):
            gate = disjunction(*gates.get((node, upright), ()))
            for child in node.children if isinstance(node, And | Or | Not) and gate is not FALSE else ():
                others = (cast(Cond, c) for c in node.children if c is not child and not c.free and not _may_tie(cast(Cond, c)))
                matters = (negation(c) for c in others) if isinstance(node, Or) else others
                key = child, upright ^ isinstance(node, Not)
                gates.setdefault(key, []).append(conjunction(gate, *matters))
    as_it_is, negated = (disjunction(*(g for a in atoms for g in gates.get((a, sign), ()))) for sign in (True, False))
    return as_it_is, negated


def are_apart(first: Cond, second: Cond) -> bool:
    """Returns whether two conditions exclude each other, as far as their forms say: each alternative of the one, each of the other."""

    def alternatives(condition: Cond) -> Sequence[Cond]:
        return cast("Sequence[Cond]", condition.children) if isinstance(condition, Or) else (condition,)

    return all(conjunction(a, b) is FALSE for a in alternatives(first) for b in alternatives(second))


def _may_tie(condition: Cond) -> bool:
    return any(isinstance(n, Compare) and n.resolution is not None for n in postorder([condition]))
