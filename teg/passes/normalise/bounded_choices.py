"""Conditions on the least or the largest of many as conditions on all or on any of them.

    [min_k g < t]   →   any_k [g < t]          [max_k g < t]   →   all_k [g < t]

Written out, the least of n has a kink for every pair; a union of n regions is a partition if they are polygons, or n pieces. The extreme
may have a number in front of it and anything beside it. An empty range has no least: the condition is NaN there, or that of `otherwise`.
Choices with a condition of their own stay. Cost: a visit a node.
"""

from __future__ import annotations

from typing import cast

from teg.ir.cells import indices_apart
from teg.ir.choices import AnyOf, Nearest, is_nothing
from teg.ir.expr import MINUS_ONE, ONE, TRUE, Add, Compare, Cond, Const, Expr, Mul
from teg.ir.index import IndexConst
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, sub
from teg.ir.traverse import rebuild


def with_bounds_of_all(root: Expr) -> Expr:
    """Returns the program whose conditions on an extreme in variables of integration are conditions on its candidates."""
    if not any(isinstance(n, Compare) and _extreme(n) for n in postorder([root])):
        return root
    new: dict[Node, Node] = {}
    for node in postorder([indices_apart(root)]):  # beside a choice its index may stand for that of a sum around it
        result = rebuild(node, tuple([new[c] for c in node.children]))
        new[node] = _of_all(result) if isinstance(result, Compare) else result
    return cast(Expr, result)


def _extreme(atom: Compare) -> tuple[Const, Nearest, list[Expr]] | None:
    """Returns the number in front of the only choice of an atom, the choice, if it is its own key or minus that, and the other terms."""
    if not atom.g.free or atom.resolution is not None:
        return None
    found: list[tuple[Const, Nearest]] = []
    others: list[Expr] = []
    for term in atom.g.children if isinstance(atom.g, Add) else (atom.g,):
        number, choice = term.children if isinstance(term, Mul) and len(term.children) == 2 else (ONE, term)
        if isinstance(number, Const) and isinstance(choice, Nearest) and choice.free:
            found.append((number, choice))
        else:
            others.append(term)
    if len(found) != 1 or any(isinstance(n, Nearest) and n.free for n in postorder(others)):
        return None
    ((number, choice),) = found
    is_extreme = choice.value is choice.key or choice.key is mul(MINUS_ONE, choice.value)
    return (number, choice, others) if is_extreme and choice.condition is TRUE else None


def _of_all(atom: Compare) -> Cond:
    """Returns an atom as a condition on candidates, if it is one on an extreme."""
    found = _extreme(atom)
    if found is None:
        return atom
    number, choice, others = found
    one = positive(add(mul(number, choice.value), *others), atom.strict)
    over = (choice.index, choice.lo, choice.hi)
    rises = (number.data > 0.0) == (choice.value is choice.key)  # the extreme is the least of number·value
    decided = negation(AnyOf.make(over, (negation(one),))) if rises else AnyOf.make(over, (one,))
    if isinstance(choice.lo, IndexConst) and isinstance(choice.hi, IndexConst) and choice.lo.data < choice.hi.data:
        return decided
    count = sub(as_number(choice.hi), as_number(choice.lo))
    if is_nothing(choice.otherwise):
        some = positive(add(call("sqrt", sub(count, ONE)), ONE))  # no number if there is no candidate
        return conjunction(decided, some) if rises else disjunction(decided, negation(some))
    there = positive(count)
    empty = positive(add(mul(number, choice.otherwise), *others), atom.strict)
    return disjunction(conjunction(there, decided), conjunction(negation(there), empty))
