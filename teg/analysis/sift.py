"""Bringing a δ to the front: its nest of integrals and its coefficient.

    C(y)·∫ₗʰ w(x, y) δ(g) dx + …   under ∫ dy      =      ∫ dy ∫ₗʰ (C·w) δ(g) dx + the terms without this δ

A δ stands in linear positions only (sums, products, branches, inner integrals), so outer factors can be moved inside.
"""

from __future__ import annotations

from typing import cast

from teg.analysis.nest import Binder, Chain
from teg.errors import DeltaError
from teg.ir.expr import ONE, ZERO, Add, Call, Expr, Mul, Pow, Where
from teg.ir.integral import Delta, Integral
from teg.ir.node import nodes_of, postorder_to
from teg.ir.simplify import add, mul, negation, where
from teg.ir.traverse import rewritten


def deltas_of(e: Expr) -> list[Delta]:
    """Returns the distinct deltas below e, including those in inner integrals."""
    return nodes_of(Delta, e)


def linear_part(e: Expr, target: Delta) -> dict[Chain, Expr]:
    """Returns the coefficient of a δ for each nest of inner integrals (outermost first) in which it stands."""
    parts: dict[Expr, dict[Chain, Expr]] = {}
    for node in postorder_to([e], Delta.bit):
        if not isinstance(node, Expr):
            continue
        match node:
            case Delta():
                parts[node] = {(): ONE} if node is target else {}
            case Add():
                merged: dict[Chain, list[Expr]] = {}
                for c in node.children:
                    for chain, k in parts.get(c, {}).items():
                        merged.setdefault(chain, []).append(k)
                parts[node] = {chain: add(*ks) for chain, ks in merged.items()}
            case Mul():
                carriers = [c for c in node.children if parts.get(c)]
                if len(carriers) > 1:
                    raise DeltaError("the same delta twice in one product has no meaning", node)
                if carriers:
                    others = [c for c in node.children if c is not carriers[0]]
                    parts[node] = {chain: mul(k, *others) for chain, k in parts[carriers[0]].items()}
            case Where():
                branches = ((node.condition, node.then), (negation(node.condition), node.otherwise))
                parts[node] = _merge({chain: where(c, k, ZERO) for chain, k in parts.get(branch, {}).items()} for c, branch in branches)
            case Integral():
                binder = Binder(node.var, node.lo, node.hi)
                if node.lo.has_delta or node.hi.has_delta:
                    raise DeltaError("a delta in a bound has no meaning", node)
                parts[node] = {(binder, *chain): k for chain, k in parts.get(node.body, {}).items()}
            case Pow() | Call():
                raise DeltaError(
                    "a Dirac delta inside a non-linear function has no meaning",
                    node,
                    "a delta may be added and multiplied",
                )
            case _:
                parts[node] = {}
    return parts.get(e, {})


def _merge(dictionaries: object) -> dict[Chain, Expr]:
    merged: dict[Chain, Expr] = {}
    for d in cast("list[dict[Chain, Expr]]", dictionaries):
        for chain, k in d.items():
            merged[chain] = add(merged[chain], k) if chain in merged else k
    return merged


def without(e: Expr, targets: set[Delta]) -> Expr:
    """Returns e with these deltas replaced by 0."""
    return rewritten(e, Delta.bit, lambda old, new: ZERO if old in targets else new)
