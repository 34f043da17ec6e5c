"""Integrals of sums of conditions, taken apart where every term has a closed form on one interval.

    ∫ f·(c₁·[x < t₁] + c₂·[x < t₂] + …) dx   →   ∫ f·c₁·[x < t₁] dx + ∫ f·c₂·[x < t₂] dx + …

The integral of the whole has as many pieces as there are places at which it breaks, in an order that is known at run time only. Its terms
have one piece each (`teg.passes.lower.intervals`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.breaks import BreakAnalysis
from teg.ir.expr import ONE, Add, Compare, Expr, Mul, Tuple
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import add, mul, tuple_of
from teg.ir.traverse import rewritten
from teg.passes.lower.intervals import interval_of

MOST = 24
"""Terms into which an integral is taken apart, at most."""


def with_terms_apart(outputs: Sequence[Expr], analysis: BreakAnalysis) -> list[Expr]:
    """Returns programs in which integrals of sums are taken apart, where that gives closed forms."""

    def visit(old: Node, node: Node) -> Node:
        if not isinstance(node, Integral) or node.body.has_integral:
            return node
        terms = _terms(node.body, node)
        if not 1 < len(terms) <= MOST or interval_of([node], analysis.of(node)) is not None:
            return node
        parts = [integral_over(term, node.var, node.lo, node.hi) for term in terms]
        closed = all(isinstance(p, Integral) and interval_of([p], analysis.of(p)) is not None for p in parts)
        return add(*parts) if closed else node

    return list(cast(Tuple, rewritten(tuple_of(*outputs), Integral.bit, visit)).children)


def _terms(body: Expr, node: Integral) -> list[Expr]:
    """Returns integrands whose sum is an integrand: one for each set of conditions that stand together."""
    classes: dict[frozenset[Node], list[Expr]] = {}
    stack: list[tuple[Expr, Expr]] = [(ONE, body)]
    while stack:
        factor, e = stack.pop()
        sums = [c for c in e.children if isinstance(c, Add) and _atoms(c, node)]
        if isinstance(e, Add):
            stack.extend((factor, c) for c in reversed(cast("Sequence[Expr]", e.children)))
        elif isinstance(e, Mul) and len(sums) == 1:
            others = mul(*(c for c in cast("Sequence[Expr]", e.children) if c is not sums[0]))
            stack.append((mul(factor, others), sums[0]))
        else:
            term = mul(factor, e)
            classes.setdefault(_atoms(term, node), []).append(term)
    return [add(*terms) for terms in classes.values()]


def _atoms(e: Node, node: Integral) -> frozenset[Node]:
    """Returns the conditions of an expression on the variable of integration."""
    return frozenset(n for n in nodes_of(Compare, e) if node.var in n.free)
