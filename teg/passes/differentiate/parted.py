"""Alternatives of a condition as candidates of their own, where they may share a line.

    any_k (p_k ∨ q_k)   =   any_j ((j even ∧ p_k) ∨ (j odd ∧ q_k)),   k = j // 2,     j from 2·lo to 2·hi

What follows edges takes a candidate to be on one side of each of its edges. Two alternatives may end on one line from opposite sides, as
on x = a in (x > a ∧ y > b) ∨ (x < a ∧ y < b): there the candidate is on both. Where edges of different candidates lie on one line, it is
known which parts of it separate anything. So each alternative becomes a candidate. Alternatives of which at most one can hold, whatever
the variables of integration are, become one: those under `k != i` and under `k == i`, for instance.
Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.gates import are_apart
from teg.ir.cells import replace_integers, replaced
from teg.ir.expr import Cond, Expr, Not, const
from teg.ir.index import APART, IndexVar, index_call, index_const
from teg.ir.node import Node, nodes_of
from teg.ir.operands import as_number, less
from teg.ir.simplify import conjunction, disjunction, integer_power, sub
from teg.ir.uncovered import Uncovered
from teg.passes.normalise.partitions import disjunctive


def with_alternatives_apart(root: Expr) -> Expr:
    """Returns the program in which alternatives of a candidate that may end on one line are candidates of their own. Raises Refused if
    there are too many alternatives."""
    (root,) = replaced([root], {node: _apart(node) for node in nodes_of(Uncovered, root)})
    return root


def _apart(node: Uncovered) -> Expr:
    groups = _groups(disjunctive(node.condition))
    places = [parts if _may_share(parts) else [[_of(parts)]] for parts in groups]
    many = max(map(len, places))
    if many == 1:
        return node
    j, count = IndexVar.make(f"{node.index.name.split(APART)[0]}{APART}part", ()), index_const(many)
    number = as_number(index_call("mod", j, count))
    alternatives: list[Cond] = []
    for parts in places:
        gates = [c for c in parts[0] if not c.free and all(c in part for part in parts)]  # in front, so that groups are seen to be apart
        each = (conjunction(_is(number, i), *(c for c in part if c not in gates)) for i, part in enumerate(parts))
        alternatives.append(conjunction(*gates, disjunction(*each)))
    condition = disjunction(*alternatives)
    of_owner = replace_integers(cast(Expr, condition), {node.index: index_call("floordiv", j, count)})
    ends = (index_call("mul", count, end) for end in (node.lo, node.hi))
    return cast(Expr, Uncovered.make((j, *ends, *node.data[3:]), (cast(Cond, cast(Node, of_owner)), *node.children[1:])))


def _groups(parts: Sequence[list[Cond]]) -> list[list[list[Cond]]]:
    """Returns alternatives in groups of which at most one matters, whatever the variables of integration are."""
    groups: list[tuple[list[Cond], list[list[Cond]]]] = []
    for part in parts:
        gates = [conjunction(*(c for c in part if not c.free))]
        members = [part]
        for group in [g for g in groups if not all(are_apart(gate, gates[0]) for gate in g[0])]:
            groups.remove(group)
            gates, members = group[0] + gates, group[1] + members
        groups.append((gates, members))
    return [members for _, members in groups]


def _may_share(parts: Sequence[list[Cond]]) -> bool:
    """Returns whether alternatives may end on different parts of one line: where each is one condition, it does not matter where on it."""
    return len(parts) > 1 and any(len({_function(c) for c in part if c.free}) > 1 for part in parts)


def _function(atom: Cond) -> Node:
    """Returns the function whose sign an atom or its negation asks for."""
    return (atom.operand if isinstance(atom, Not) else atom).children[0]


def _of(parts: Sequence[list[Cond]]) -> Cond:
    return disjunction(*(conjunction(*part) for part in parts))


def _is(number: Expr, i: int) -> Cond:
    return less(integer_power(sub(number, const(float(i))), 2), const(0.25), True)
