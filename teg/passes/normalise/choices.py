"""Choices among data (`teg.any`, `teg.prod`, `teg.nearest`) in forms that are compiled.

    ∫∫ f(nearest_k(v, g | c; o)) dx dy   →  partition                   affine c, differences of g; polynomial f(v): `partitions.py`
    Π_k a·[c]                            →  Π_k a·[all_k(c)]            a without variables of integration
    nearest_k(v, g | c; o), without      →  Σ_k [k = w]·v  where w >= 0, else o,      w = winner_k(g | c)
    any_k(c), without                    →  winner_k(0 | c) > -1/2

Cost: written out, the square of the number of candidates; everything else a visit a node.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, NoReturn, cast

from teg.analysis.kinks import value_nodes
from teg.analysis.singularities import is_singular
from teg.errors import ArrayIndexError
from teg.ir.arrays import Ranged, Sum, open_indices, sum_over
from teg.ir.cells import rename_indices, replaced
from teg.ir.choices import CHOICES, AnyOf, Nearest, Product, Winner
from teg.ir.expr import ONE, TRUE, ZERO, Call, Cond, Expr, Mul, Where, const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.operands import as_number, less
from teg.ir.simplify import add, bracket, conjunction, disjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import rebuild, replace_node
from teg.ir.uncovered import Uncovered
from teg.passes.normalise.bounded_choices import with_bounds_of_all
from teg.passes.normalise.increasing import plain_key
from teg.passes.normalise.padded import at_place, most_of
from teg.passes.normalise.partitions import MOST_WRITTEN, Refused, partitioned
from teg.passes.normalise.sums import NeedsLengths
from teg.passes.normalise.uncovered import over_uncovered, written


def without_choices(root: Expr, edges: bool = False) -> Expr:
    """Returns the program whose choices are partitions, winners, and products without variables of integration; with `edges`, integrals
    over what no candidate covers, too.

    Raises NeedsLengths if a range must be written out whose length is known at run time only, ArrayIndexError if it cannot be.
    """
    if not has_choices(root):
        return root
    root = rename_indices(_rewritten(with_bounds_of_all(root), _prepared))
    new: dict[Node, Expr] = {}
    for node in postorder([root]):
        if isinstance(node, Integral) and not node.free and has_choices(node, inside=True):
            closed = node
            if any(n in new for n in postorder([node]) if n is not node):
                closed = cast(Integral, replaced([node], new)[0])
            try:
                new[node] = partitioned(closed)
            except Refused as refused:
                uncovered = _over_uncovered(closed, edges)
                new[node] = _written_out(closed, refused.reason) if uncovered is None else uncovered
    (root,) = replaced([root], new)
    return rename_indices(_folded(_written_out(root, "it stands in no integral")))


def _over_uncovered(closed: Integral, edges: bool) -> Expr | None:
    if not edges:
        return None
    try:
        return over_uncovered(closed)
    except Refused:
        return None


def without_uncovered(root: Expr, reason: str) -> Expr:
    """Returns the program with the candidates of integrals over what they do not cover written out. Raises as `without_choices` does."""
    root = rename_indices(_with_owners_written(root, reason))
    new: dict[Node, Expr] = {n: _written_out(written(n), reason) for n in postorder([root]) if isinstance(n, Uncovered)}
    (root,) = replaced([root], new)
    return rename_indices(root)


def _with_owners_written(root: Expr, reason: str) -> Expr:
    """Returns the program with sums over candidates, of what no other candidate covers, written out as their terms: a candidate is then
    compared with others only."""
    opened = open_indices(root)
    new: dict[Node, Expr] = {}
    for node in postorder([root]):
        inside = [n for n in postorder([node]) if isinstance(n, Uncovered)] if isinstance(node, Sum) else []
        if isinstance(node, Sum) and any((n.lo, n.hi) == (node.lo, node.hi) and node.index in opened[n] for n in inside):
            places = (at_place(node, j) for j in range(_places(node, reason)))
            new[node] = add(*(where(there, cast(Expr, body), ZERO) for there, (body,) in places))
    return replaced([root], new)[0]


def has_choices(root: Node, inside: bool = False) -> bool:
    """Returns whether there are choices; `inside`: with variables of integration."""
    return any(isinstance(n, CHOICES) and (n.free or not inside) for n in postorder([root]))


def _rewritten(root: Expr, change: Callable[[Ranged], Node]) -> Expr:
    """Returns the expression with choices replaced, bottom up."""
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        new[node] = change(result) if isinstance(result, CHOICES) else result
    return cast(Expr, new[root])


def _prepared(node: Ranged) -> Ranged | Expr:
    """Returns a product of brackets as a condition, and the nearest of candidates by a plain key; others as they are."""
    match node:
        case Product():
            return _without_brackets(node)
        case Nearest() if node.key.free:
            value, key, condition, otherwise = node.children
            plain = plain_key(cast(Expr, key), node.index)
            return node if plain is key else Nearest.make(node.data, (value, plain, condition, otherwise))
        case _:
            return node


# -- products of brackets ----------------------------------------------------------------------------------------------


def _without_brackets(node: Product) -> Ranged | Expr:
    """Returns a product of brackets, and of numbers without variables of integration, as a condition on all; others as they are."""
    if not node.free:
        return node
    conditions: list[Cond] = []
    numbers: list[Expr] = []
    for factor in node.body.children if isinstance(node.body, Mul) else (node.body,):
        sides = _sides(factor)
        if sides is None:
            return node
        condition, number = sides
        conditions.append(condition)
        numbers.append(number)
    over = (node.index, node.lo, node.hi)
    failing = AnyOf.make(over, (negation(conjunction(*conditions)),))
    return mul(cast(Expr, Product.make(over, (mul(*numbers),))), bracket(negation(failing)))


def _sides(factor: Expr) -> tuple[Cond, Expr] | None:
    """Returns the condition outside of which a factor is 0, and the factor where it holds; None if that depends on variables."""
    if not factor.free:
        return TRUE, factor
    branches = [n for n in value_nodes(factor) if isinstance(n, Where) and n.condition.free]
    if len(branches) != 1:
        return None
    branch = branches[0]
    then, otherwise = (cast(Expr, replace_node(factor, branch, side)) for side in (branch.then, branch.otherwise))
    if not then.free and otherwise is ZERO:
        return branch.condition, then
    if not otherwise.free and then is ZERO:
        return negation(branch.condition), otherwise
    return None


# -- without variables of integration ----------------------------------------------------------------------------------


def _folded(root: Expr) -> Expr:
    """Returns the expression with winners in the place of choices."""

    def change(node: Ranged) -> Node:
        match node:
            case AnyOf():
                return positive(add(_winner(node, ZERO, node.condition), const(0.5)))
            case Nearest():
                winner = _winner(node, node.key, node.condition)
                distance = integer_power(sub(as_number(node.index), winner), 2)
                value = sum_over(where(less(distance, const(0.25), True), node.value, ZERO), node.index, node.lo, node.hi)
                return where(less(winner, const(-0.5), True), node.otherwise, value)
            case _:
                return node

    return _rewritten(root, change)


def _winner(node: Ranged, key: Expr, condition: Cond) -> Winner:
    return Winner.make((node.index, node.lo, node.hi), (key, bracket(condition)))


# -- written out -------------------------------------------------------------------------------------------------------


def _written_out(root: Expr, reason: str) -> Expr:
    """Returns the expression with every choice that depends on variables of integration written out as its terms; as branches where roots,
    logarithms and powers of a choice are."""
    roots = [n.children[0] for n in postorder([root]) if isinstance(n, Call) and is_singular(n)]
    below = set(postorder(roots)) if roots else set()
    new: dict[Node, Node] = {}
    for node in postorder([root]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        new[node] = _terms_of(result, node in below, reason) if isinstance(result, CHOICES) and result.free else result
    return cast(Expr, new[root])


def _terms_of(node: Ranged, branches: bool, reason: str) -> Node:
    """Returns a choice written out, that of the least key as `branches` or as a sum."""
    at = candidates_of(node, reason)
    match node:
        case AnyOf():
            return disjunction(*(c for (c,) in cast("list[tuple[Cond]]", at)))
        case Product():
            return mul(*(e for (e,) in cast("list[tuple[Expr]]", at)))
        case _:
            terms = _nearest(cast("list[tuple[Expr, Expr, Cond, Expr]]", at), cast(Nearest, node).otherwise)
            if branches:
                return reduce(lambda last, term: where(term[0], term[1], last), terms[-2::-1], terms[-1][1])
            return add(*(where(*term, ZERO) for term in terms))


def candidates_of(node: Ranged, reason: str) -> list[tuple[Any, ...]]:
    """Returns the children of a choice at each index; of `Nearest` value, key, condition and what there is otherwise.

    Raises NeedsLengths if the length of the range is known at run time only, ArrayIndexError if it cannot be written out; the `reason` is
    why it must be.
    """
    return [_at(node, j) for j in range(_places(node, reason))]


def _at(node: Ranged, j: int) -> tuple[Node, ...]:
    """Returns the children of a choice at one place; where there is no candidate, its condition does not hold."""
    there, children = at_place(node, j)
    match node:
        case AnyOf():
            return (conjunction(there, cast(Cond, children[0])),)
        case Product():
            return (where(there, cast(Expr, children[0]), ONE),)
        case _:
            value, key, condition, otherwise = children
            return value, key, conjunction(there, cast(Cond, condition)), otherwise


def _nearest(candidates: list[tuple[Expr, Expr, Cond, Expr]], otherwise: Expr) -> list[tuple[Cond, Expr]]:
    """Returns the values and where each of them is taken, the last one where no candidate is."""
    terms: list[tuple[Cond, Expr]] = []
    for i, (value, key, condition, _) in enumerate(candidates):
        before = (disjunction(negation(c), less(key, other, True)) for _, other, c, _ in candidates[:i])
        after = (disjunction(negation(c), less(key, other, False)) for _, other, c, _ in candidates[i + 1 :])
        terms.append((conjunction(condition, *before, *after), value))
    return [*terms, (conjunction(*(negation(c) for _, _, c, _ in candidates)), otherwise)]


def _places(node: Ranged, reason: str) -> int:
    """Returns how many places a choice has."""
    most = most_of(node)
    if most is None or most > MOST_WRITTEN[type(node)]:
        raise_unwritten(node, reason)
    return most


def raise_unwritten(node: Ranged, reason: str) -> NoReturn:
    """Raises NeedsLengths if the number of candidates is known at run time only, else ArrayIndexError: there are too many to be written
    out."""
    most = most_of(node)
    if most is None:
        raise NeedsLengths(node)
    kinds = {Nearest: "nearest", Sum: "nearest", AnyOf: "any or all", Product: "product"}
    hint = "affine conditions and keys, and polynomials, over a box of one or two variables are loops over any number of candidates; "
    hint += "of others, give every box the list of those that reach into it"
    text = f"this {kinds.get(type(node), 'choice')} must be written out ({reason}), and has {most} candidates"
    if type(node) in MOST_WRITTEN:
        text += f"; {MOST_WRITTEN[type(node)]} at most"
    raise ArrayIndexError(text, node if isinstance(node, CHOICES) else None, hint)
