"""Polynomials in absolute coordinates, written by differences of coordinates.

    x₀y₁ - x₁y₀ + x(y₀ - y₁) + y(x₁ - x₀)   →   (x - x₀)(y₀ - y₁) + (y - y₀)(x₁ - x₀)
    x² - 2cx + c²                           →   (x - c)²

Far from the origin the products on the left are large and cancel: at 4096 an edge loses 24 bits. Both sides are one polynomial, because
it does not change when x, x₀ and x₁ move together: a *group*, a set of symbols with Σ ∂g/∂s = 0. So every symbol s of the group may be
replaced by s - o, with o one of them, and o by 0; differences are rounded once, if at all.

Groups are the vectors of zeros and ones in the null space of the gradients of g at random points of a finite field. A group is one of
coordinates if it contains a variable; a sum without variables (an area) is rewritten for groups that share a symbol with such a group.
Nothing changes if every factor of a product is itself invariant, as in (x - p)·(y - q). Among the possible origins the one with the
shortest result is chosen: a vertex on the surface makes terms vanish. Cost: one gradient a symbol, for sums of at most MAX_SYMBOLS.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

from teg.ir.expr import MINUS_ONE, ZERO, Add, Const, Expr, Mul, Param, Pow, Var
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul
from teg.ir.traverse import remake, size
from teg.numerics.field import residue

MAX_SYMBOLS = 24
MAX_NODES = 300
MAX_ORIGINS = 16
"""The largest number of combinations of origins that are compared."""
PRIME = 2**61 - 1

Group = tuple[Expr, ...]


@dataclass(frozen=True)
class Facts:
    """Properties of a polynomial, computed once. A sum that is too large has no symbols."""

    symbols: frozenset[Expr]
    nodes: int


def with_differences(root: Expr) -> Expr:
    """Returns the program with differences in those polynomials that do not change when coordinates move together."""
    order = postorder([root])
    groups = {e: groups_of(e) for e in outermost_polynomials(order) if _may_cancel(e)}
    axes = _axes([g for of_sum in groups.values() for g in of_sum])
    new: dict[Node, Node] = {}
    for node in order:
        unchanged = all(new[c] is c for c in node.children)
        result = node if unchanged else remake(node, tuple([new[c] for c in node.children]))
        if node in groups and (mine := groups[node]):
            result = _by_differences(cast(Expr, result), _of_coordinates(cast(Expr, result), mine, axes))
        new[node] = result
    return cast(Expr, new[root])


def outermost_polynomials(order: Sequence[Node]) -> list[Expr]:
    """Returns the polynomial sums that are not terms of another one and small enough to be analysed, of nodes in postorder."""
    facts: dict[Node, Facts] = {}
    outermost: dict[Expr, None] = {}
    for node in order:
        known = [facts.get(c) for c in node.children]
        if isinstance(node, Add | Mul | Pow) and all(known) and not (isinstance(node, Pow) and node.exponent < 0):
            facts[node] = _combined(node, cast("list[Facts]", known))
        elif isinstance(node, Param | Var | Const):
            facts[node] = Facts(frozenset(() if isinstance(node, Const) else (node,)), 1)
        is_sum = isinstance(node, Add) or (isinstance(node, Mul) and _scaled(node) is not None)
        for c in node.children:
            inner = _scaled(c) if isinstance(c, Mul) else c
            if isinstance(inner, Add) and inner in facts and not (is_sum and node in facts):
                outermost[inner] = None
    last = order[-1]
    if isinstance(last, Add) and last in facts:
        outermost[last] = None
    return [e for e in outermost if 2 <= len(facts[e].symbols) <= MAX_SYMBOLS]


def _combined(node: Node, parts: Sequence[Facts]) -> Facts:
    """Returns the properties of a sum, product or power; without symbols if it is too large to be analysed."""
    nodes = 1 + sum(p.nodes for p in parts)
    if nodes > MAX_NODES or (isinstance(node, Pow) and node.exponent > MAX_SYMBOLS):
        return Facts(frozenset(), MAX_NODES)
    return Facts(frozenset().union(*(p.symbols for p in parts)), nodes)


def _scaled(e: Node) -> Expr | None:
    """Returns the sum in a number times a sum; None for other nodes."""
    if isinstance(e, Mul) and len(e.children) == 2 and isinstance(e.children[0], Const) and isinstance(e.children[1], Add):
        return e.children[1]
    return None


def _may_cancel(e: Expr) -> bool:
    """Returns whether there is a product, and a symbol that occurs twice. Otherwise nothing can cancel."""
    seen: set[Node] = set()
    stack: list[Node] = [e]
    repeated = product = False
    while stack:
        node = stack.pop()
        if isinstance(node, Param | Var):
            repeated |= node in seen
            seen.add(node)
            continue
        stack.extend(node.children)
        repeated |= isinstance(node, Pow)
        product |= isinstance(node, Pow) or (isinstance(node, Mul) and sum(not isinstance(c, Const) for c in node.children) > 1)
    return repeated and product


def is_fixed(e: Expr, symbols: Collection[Expr]) -> bool:
    """Returns whether a polynomial stays the same when those of the symbols that it has move together."""
    order = postorder([e])
    fixed = _invariant(order, [tuple(s for s in symbols if s in order)])
    return fixed is not None and e in fixed[0]


def _axes(groups: Sequence[Group]) -> list[set[Expr]]:
    """Returns, for each variable, the symbols that move together with it in some polynomial."""
    axes: dict[Expr, set[Expr]] = {}
    for group in groups:
        for v in group:
            if isinstance(v, Var):
                axes.setdefault(v, set()).update(group)
    candidates = list(axes.values())
    return [axis for k, axis in enumerate(candidates) if all(axis.isdisjoint(other) for other in candidates[:k])]


def _of_coordinates(e: Expr, groups: Sequence[Group], axes: Sequence[set[Expr]]) -> list[Group]:
    """Returns the groups along axes: all symbols of an axis, if moving them does not change a polynomial; else the groups that share an
    axis."""
    order = postorder([e])
    whole = [tuple(s for s in order if s in axis) for axis in axes]
    fixed = _invariant(order, whole)
    if fixed is None:
        return []
    mine = [g for g, same in zip(whole, fixed, strict=True) if e in same and len(g) > 1]
    taken = {s for g in mine for s in g}
    return mine + [g for g in groups if taken.isdisjoint(g) and any(axis.issuperset(g) for axis in axes)]


# -- groups ----------------------------------------------------------------------------------------------------------


def groups_of(e: Expr) -> list[Group]:
    """Returns the sets of symbols that can move together without changing a polynomial, if these sets are disjoint."""
    order = postorder([e])
    symbols = [n for n in order if isinstance(n, Param | Var)]
    rows = []
    for k in range(len(symbols) + 1):
        row = _gradient(order, {s: _random(s.name, type(s).__name__, k) for s in symbols})
        if row is None:
            return []
        rows.append([row[s] for s in symbols])
    groups: list[Group] = [
        tuple(s for s, d in zip(symbols, v, strict=True) if d) for v in _null_space(rows) if all(d in (0, 1) for d in v) and sum(v) > 1
    ]
    return groups if len({s for group in groups for s in group}) == sum(map(len, groups)) else []


@lru_cache(maxsize=4096)
def _random(*key: object) -> int:
    return residue("origins", *key) % PRIME


def _values(order: Sequence[Node], at: Mapping[Node, int]) -> dict[Node, int] | None:
    """Returns the values of a polynomial's nodes in the field; None if a number in it is not finite."""
    value: dict[Node, int] = {}
    for node in order:
        match node:
            case Const():
                if node.data - node.data != 0.0:
                    return None
                numerator, denominator = node.data.as_integer_ratio()
                value[node] = numerator * pow(denominator, -1, PRIME) % PRIME if denominator != 1 else numerator % PRIME
            case Add():
                value[node] = sum(value[c] for c in node.children) % PRIME
            case Mul():
                total = 1
                for c in node.children:
                    total = total * value[c] % PRIME
                value[node] = total
            case Pow():
                value[node] = pow(value[node.base], node.exponent, PRIME)
            case _:
                value[node] = at[node]
    return value


def _gradient(order: Sequence[Node], at: Mapping[Node, int]) -> dict[Node, int] | None:
    """Returns the derivatives of a polynomial by its nodes, in reverse."""
    value = _values(order, at)
    if value is None:
        return None
    weight = dict.fromkeys(order, 0)
    weight[order[-1]] = 1
    for node in reversed(order):
        w = weight[node]
        if isinstance(node, Add):
            for c in node.children:
                weight[c] = (weight[c] + w) % PRIME
        elif isinstance(node, Pow):
            weight[node.base] = (weight[node.base] + w * node.exponent * pow(value[node.base], node.exponent - 1, PRIME)) % PRIME
        elif isinstance(node, Mul):
            before = [1]
            for c in node.children[:-1]:
                before.append(before[-1] * value[c] % PRIME)
            after = w
            for c, left in zip(reversed(node.children), reversed(before), strict=True):
                weight[c] = (weight[c] + after * left) % PRIME
                after = after * value[c] % PRIME
    return weight


def _null_space(rows: list[list[int]]) -> list[list[int]]:
    """Returns a basis of the vectors orthogonal to all rows, with one free column each."""
    n = len(rows[0])
    pivots: dict[int, list[int]] = {}
    for row in rows:
        for column, other in pivots.items():
            if row[column]:
                row = [(a - row[column] * b) % PRIME for a, b in zip(row, other, strict=True)]
        lead = next((i for i, a in enumerate(row) if a), None)
        if lead is None:
            continue
        scale = pow(row[lead], -1, PRIME)
        row = [a * scale % PRIME for a in row]
        pivots = {c: [(a - r[lead] * b) % PRIME for a, b in zip(r, row, strict=True)] for c, r in pivots.items()}
        pivots[lead] = row
    basis = []
    for free in (i for i in range(n) if i not in pivots):
        vector = [0] * n
        vector[free] = 1
        for column, row in pivots.items():
            vector[column] = -row[free] % PRIME
        basis.append(vector)
    return basis


# -- differences -----------------------------------------------------------------------------------------------------


def _by_differences(e: Expr, groups: Sequence[Group]) -> Expr:
    """Returns the polynomial with differences in the place of symbols, for the groups in whose absolute coordinates it is written."""
    order = postorder([e])
    fixed = _invariant(order, groups)
    if fixed is None:
        return e
    needed = [g for g, same in zip(groups, fixed, strict=True) if any(_is_absolute(n, same) for n in order)]
    if not needed:
        return e
    fixed = [same for g, same in zip(groups, fixed, strict=True) if g in needed]
    settled = _settled(order, fixed)
    origins: list[list[Expr]] = [[s for s in g if isinstance(s, Param)] or [g[-1]] for g in needed]
    best: Expr | None = None
    for choice in itertools.islice(itertools.product(*origins), MAX_ORIGINS):
        written = _relative(order, settled, {s: o for g, o in zip(needed, choice, strict=True) for s in g})
        if best is None or size(written) < size(best):
            best = written
    return cast(Expr, best)


def _invariant(order: Sequence[Node], groups: Sequence[Group]) -> list[set[Node]] | None:
    """Returns, for each group, the nodes that do not change when its symbols move together."""
    symbols = [n for n in order if isinstance(n, Param | Var)]
    at: dict[Node, int] = {s: _random(s.name, type(s).__name__, 0) for s in symbols}
    before = _values(order, at)
    if before is None:
        return None
    result = []
    for group in groups:
        there = cast("dict[Node, int]", _values(order, {s: v + _random("shift") if s in group else v for s, v in at.items()}))
        result.append({n for n in order if before[n] == there[n]})
    return result


def _is_absolute(node: Node, fixed: set[Node]) -> bool:
    """Returns whether a node is a product, or a power, with a factor that moves with the group."""
    if isinstance(node, Pow):
        return node.base not in fixed
    if not isinstance(node, Mul) or sum(not isinstance(c, Const) for c in node.children) < 2:
        return False
    return any(c not in fixed for c in node.children)


def _settled(order: Sequence[Node], fixed: Sequence[set[Node]]) -> set[Node]:
    """Returns the nodes that may stay as they are: invariant in all groups, with no product in absolute coordinates inside."""
    clean: set[Node] = set()
    for node in order:
        if all(c in clean for c in node.children) and not any(_is_absolute(node, same) for same in fixed):
            clean.add(node)
    return {n for n in clean if all(n in same for same in fixed)}


def _relative(order: Sequence[Node], settled: set[Node], origin: Mapping[Expr, Expr]) -> Expr:
    """Returns the polynomial with differences from the origins in the place of symbols."""
    new: dict[Node, Node] = {}
    for node in order:
        if node in settled:
            new[node] = node
        elif isinstance(node, Param | Var):
            o = origin.get(node)
            new[node] = node if o is None else ZERO if o is node else add(node, mul(MINUS_ONE, o))
        else:
            new[node] = remake(node, tuple([new[c] for c in node.children]))
    return cast(Expr, new[order[-1]])
