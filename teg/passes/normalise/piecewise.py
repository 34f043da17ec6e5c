"""Conditions on piecewise affine functions as conditions on affine functions.

    g > 0   →   ∨ᵢ ∧ⱼ gᵢⱼ > 0                          if g = maxᵢ minⱼ gᵢⱼ, as all sums of abs, minimum and maximum are
    g > 0   →   (c ∧ g₁ > 0) ∨ (¬c ∧ g₂ > 0)           if where(c, …, …) is another branch of g, and g₁, g₂ are g on its sides

The first form has no condition where two functions of a maximum are equal, because no border of g > 0 is there. Cost: the number of
results, at most `MOST_ATOMS` for a condition; where it had more a condition stays as it is. Conditions on functions that are smooth but not
affine get the first form, if it is short (`with_smooth_atoms`): `[minimum(f, g) < 0]` is [f < 0] or [g < 0].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import cast

from teg.analysis.calculus import SMOOTH
from teg.analysis.expanded import expanded
from teg.analysis.extents import EVERYTHING, Extent, extents
from teg.analysis.kinks import EXTREMES, Kinks, kinks_of, value_nodes
from teg.ir.cells import Symbols
from teg.ir.expr import Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Where, const
from teg.ir.function import Apply
from teg.ir.integral import Integral
from teg.ir.node import Node, nodes_of, postorder
from teg.ir.simplify import add, conjunction, disjunction, mul, negation, positive
from teg.ir.traverse import replace_node, rewrite, rewrite_below

MOST_ATOMS = 64
FEW_ATOMS = 12
"""The largest number of smooth functions that a condition on extremes of them is written as."""
MOST_DEPTH = 8
"""The number of branches that may stand in conditions of each other."""

Alternatives = list[list[Expr]]
"""maxᵢ minⱼ gᵢⱼ."""


def with_affine_atoms(condition: Cond) -> Cond:
    """Returns an equivalent condition whose atoms have no branches that depend on variables of integration, where that is possible."""
    if not any(isinstance(n, Where) and n.condition.free for n in postorder([condition])):
        return condition
    symbols, kinks = Symbols(), Kinks()

    def replacement(node: Node) -> Node | None:  # from the outside: a condition that decides an extreme must be known as such
        if isinstance(node, Compare) and node.resolution is None and node.free and kinks_of(node.g):
            return cast(Node, written_out(node, kinks))
        return None

    (cell,) = symbols.into([cast(Expr, cast(Node, condition))])
    for _ in range(MOST_DEPTH):
        before, cell = cell, cast(Expr, rewrite_below([cell], replacement)[cell])
        if cell is before:
            break
    return cast(Cond, cast(Node, symbols.out_of([cell])[0]))


def with_smooth_atoms(root: Expr) -> Expr:
    """Returns the program with conditions on extremes as conditions on what these are taken of, where they are few and numbers everywhere.

    The condition that decides an extreme itself stays: it is no border. An extreme that is always the same one of both is that one.
    """
    kinks = Kinks()
    root = _without_decided(root, kinks)
    own = {n.condition for n in nodes_of(Where, root) if n.condition.free and kinks.sign(n)}
    bounds = extents(postorder([root]), {}) if own else {}
    chosen: dict[Node, Cond] = {}
    for atom in nodes_of(Compare, root) if own else ():
        if atom.free and atom.resolution is None and atom not in own and kinks_of(atom.g):
            parts = alternatives(atom.g, kinks) if _is_a_number(atom.g, bounds) else None
            if isinstance(parts, list) and sum(map(len, parts)) <= FEW_ATOMS:
                chosen[atom] = disjunction(*(conjunction(*(positive(_cancelled(f), atom.strict) for f in part)) for part in parts))
    return cast(Expr, rewrite([root], lambda old, new: chosen.get(old, new))[root]) if chosen else root


def _without_decided(root: Expr, kinks: Kinks) -> Expr:
    """Returns the program without extremes of which bounds, as numbers, say which of both they are: minimum(maximum(x, 0), -1) is -1."""
    signs = {n: kinks.sign(n) for n in nodes_of(Where, root) if n.condition.free}
    bounds = extents(postorder([root]), {}) if any(signs.values()) else {}
    decided: dict[Node, int] = {}
    for kink, sign in signs.items():
        if sign:
            (least, most), (least_other, most_other) = (bounds[side][::sign] for side in (kink.then, kink.otherwise))
            side = 1 if sign * least >= sign * most_other else 2 if sign * least_other >= sign * most else 0
            if side and _is_a_number(kink, bounds):
                decided[kink] = side

    def visit(old: Node, new: Node) -> Node:
        return new.children[decided[old]] if old in decided and isinstance(new, Where) else new

    return cast(Expr, rewrite([root], visit)[root]) if decided else root


def _is_a_number(g: Expr, bounds: Mapping[Node, Extent]) -> bool:
    """Returns whether a function has a value everywhere, as far as `bounds` say: what NaN does depends on the form of a condition."""
    for n in value_nodes(g):
        least, most = bounds[n.children[0]] if isinstance(n, Call | Pow) and not isinstance(n, Apply) else EVERYTHING
        match n:
            case Integral() | Apply():
                return False
            case Pow() if n.exponent < 0 and n.free and least <= 0.0 <= most:
                return False
            case Call(name="sqrt") if n.free and least < 0.0:
                return False
            case Call(name="pow" | "log") if n.free and least <= 0.0:
                return False
            case Call() if n.free and n.name not in SMOOTH and n.name not in EXTREMES and n.name not in ("sqrt", "pow", "log"):
                return False
    return True


def written_out(atom: Compare, kinks: Kinks) -> Cond:
    """Returns an atom as a condition on functions without branches in value position, or as it is if that is too long."""
    cases: list[Cond] = []
    waiting: list[tuple[tuple[Cond, ...], Expr]] = [((), atom.g)]
    count = 0
    while waiting:
        sides, g = waiting.pop()
        result = alternatives(g, kinks)
        if isinstance(result, Where):
            then, otherwise = (cast(Expr, replace_node(g, result, side)) for side in (result.then, result.otherwise))
            waiting += [((*sides, negation(result.condition)), otherwise), ((*sides, result.condition), then)]
        elif result is not None:
            parts = [conjunction(*(positive(_cancelled(f), atom.strict) for f in part)) for part in result]
            cases.append(conjunction(*sides, disjunction(*parts)))
            count += len(sides) + sum(map(len, result))
        if result is None or count + len(waiting) > MOST_ATOMS:
            return atom
    return disjunction(*cases)


def _cancelled(f: Expr) -> Expr:
    """Returns a function without variables that cancel in it, as x does in (x - a) - x: it is no surface in them."""
    short = expanded(f) if f.free and isinstance(f, Add) else None
    return short if short is not None and len(short.free) < len(f.free) else f


def alternatives(g: Expr, kinks: Kinks) -> Alternatives | Where | None:
    """Returns g as a maximum of minima, or a branch that must be decided first; None if there are too many."""
    lattice: dict[Expr, Alternatives] = {}  # of nodes with branches below them
    for node in value_nodes(g):
        branching = [c for c in node.children if c in lattice]
        if isinstance(node, Where) and node.condition.free:
            sign = kinks.sign(node)
            if not sign:
                return node
            sides = [lattice.get(side, [[side]]) for side in (node.then, node.otherwise)]
            joined = [*sides[0], *sides[1]] if sign > 0 else _each_with_each(sides, lambda parts: [f for part in parts for f in part])
            result = _absorbed(joined)
        elif not branching:
            continue
        elif isinstance(node, Add):
            terms = [lattice.get(c, [[c]]) for c in node.children]
            result = _each_with_each(terms, lambda parts: [add(*fs) for fs in product(*parts)])
        elif isinstance(node, Mul) and len(branching) == 1 and all(isinstance(c, Const) for c in node.children if c not in lattice):
            factor = math.prod(cast(float, c.data) for c in node.children if c not in lattice)
            result = _times(factor, lattice[branching[0]])
        else:
            return kinks_of(node)[0]
        if sum(map(len, result)) > MOST_ATOMS or not result:
            return None
        lattice[node] = result
    return lattice.get(g, [[g]])


def _times(factor: float, alternatives: Alternatives) -> Alternatives:
    """Returns a number times a maximum of minima: for a negative number max min is min max, which is the maximum over all selections."""
    if factor >= 0:
        return [[mul(const(factor), f) for f in part] for part in alternatives]
    if math.prod(map(len, alternatives)) > MOST_ATOMS:
        return []
    return _absorbed([[mul(const(factor), f) for f in chosen] for chosen in product(*alternatives)])


def _absorbed(alternatives: Alternatives) -> Alternatives:
    """Returns a maximum of minima without functions that stand twice, and without minima over more functions than another one's."""
    parts = {frozenset(part): list(dict.fromkeys(part)) for part in alternatives}
    return [part for functions, part in parts.items() if not any(fewer < functions for fewer in parts)]


def _each_with_each(terms: Sequence[Alternatives], joined: Callable[[Sequence[list[Expr]]], list[Expr]]) -> Alternatives:
    """Returns a part for every selection of one part of each term; none if these are too many."""
    if math.prod(sum(map(len, parts)) for parts in terms) > MOST_ATOMS:
        return []
    return [joined(parts) for parts in product(*terms)]
