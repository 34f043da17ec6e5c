"""Derivatives by arrays and tables taken apart: into what is added where, and when it is known.

    Σ_k w_k·1[V; F[k]]      weights of units, and of sums of them

What is collected from a derivative by a table (`Collected`) is known when that derivative is complete: outputs that need it are a stage of
their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

from teg.errors import DeltaError
from teg.ir import simplify
from teg.ir.arrays import Ranged, Sum, Unit
from teg.ir.expr import ONE, ZERO, Add, Cond, Expr, Mul, Where
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul, nonzero_part, where
from teg.ir.tables import Collected, TableUnit

Part = tuple[int | Expr, Expr, Expr]
"""An output, or a derivative by a table; a unit or a sum that is added to it, and its weight."""


def stages(numbers: Sequence[Expr], places: Sequence[tuple[int, Expr, Expr]]) -> list[tuple[list[Expr], list[Part]]]:
    """Returns numbers, and what is added to outputs and to the tables of derivatives by tables, in the order in which they are known."""
    parts: list[Part] = [(to, leaf, v) for to, e, w in places for leaf, v in taken_apart(e, w)]
    whole = simplify.tuple_of(*numbers, *(e for part in parts for e in part[1:]))
    derivatives = dict.fromkeys(n.table for n in postorder([whole]) if isinstance(n, Collected))
    parts += [(e, leaf, w) for e in derivatives for leaf, w in taken_apart(e, ONE)]
    stage: dict[Node, int] = {}
    for node in postorder([simplify.tuple_of(whole, *(e for part in parts for e in part[1:]))]):
        stage[node] = max((stage[c] for c in node.children), default=0) + isinstance(node, Collected)
    early = [n for e in (*numbers, *(w for _, _, w in parts)) for n in _sums_before(e, stage)]
    return [
        (
            list(dict.fromkeys(e for e in (*numbers, *early) if stage[e] == k)),
            [part for part in parts if max(stage[part[1]], stage[part[2]]) == k],
        )
        for k in range(stage[whole] + 1)
    ]


def _sums_before(e: Expr, stage: Mapping[Node, int]) -> list[Expr]:
    """Returns the sums in an expression that are known before it, so that they share the loops of their stage."""
    found: list[Expr] = []
    seen: set[Node] = set()
    stack: list[Node] = [e] if stage[e] else []
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if isinstance(node, Ranged):
            found += [cast(Expr, node)] if stage[node] < stage[e] else []
        elif not isinstance(node, Collected):
            stack.extend(node.children)
    return found


def taken_apart(e: Expr, weight: Expr) -> list[tuple[Unit | TableUnit | Sum, Expr]]:
    """Returns weight·e as weights of units and sums; e is linear in units and in sums that contain units.

    Where a term of e does not count, its weights do not either, even if they are no numbers.
    """
    terms: dict[Cond, list[Expr]] = {}
    for term in e.children if isinstance(e, Add) else (e,):
        condition, rest = nonzero_part(term)
        terms.setdefault(condition, []).append(rest)
    found = ((condition, _weights_in(add(*several), weight)) for condition, several in terms.items())
    return [(leaf, where(condition, w, ZERO)) for condition, weights in found for leaf, w in weights]


def _weights_in(e: Expr, weight: Expr) -> list[tuple[Unit | TableUnit | Sum, Expr]]:
    parts: dict[Node, list[Expr]] = {e: [weight]}
    found: list[tuple[Unit | TableUnit | Sum, Expr]] = []
    order = postorder([e])
    holds: set[Node] = set()
    for node in order:
        if isinstance(node, Unit | TableUnit) or (not isinstance(node, Collected) and any(c in holds for c in node.children)):
            holds.add(node)
    for node in reversed(order):
        if node not in parts:
            continue
        w = add(*parts.pop(node))
        if isinstance(node, Unit | TableUnit | Sum):
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


def has_units(root: Node) -> bool:
    return bool(root.kinds & (Unit.bit | TableUnit.bit)) and any(isinstance(n, Unit | TableUnit) for n in outside_of(set(), [root]))


def outside_of(known: set[Ranged], roots: Sequence[Node]) -> list[Node]:
    """Returns every node, children first, without computed nodes and their insides, where an index may be that of another loop."""
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
            if not isinstance(node, Collected):  # which is complete
                stack.extend((c, False) for c in reversed(node.children))
    return order
