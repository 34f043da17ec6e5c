"""When a value is needed at all: the conditions under which anybody looks at an integral, and outside of which an integrand is 0."""

from __future__ import annotations

from collections.abc import Sequence

from teg.expr import FALSE, TRUE, ZERO, And, Cond, Expr, Mul, Or, Var, Where, conjunction, disjunction, negation
from teg.integral import Integral
from teg.node import Node

GUARD_TERMS = 4
"""Longer guards cost more than they save."""


def guards(
    roots: Sequence[Expr],
    order: list[Node],
    inner: frozenset[Var],
    height: dict[Node, int],
    mine: set[Integral],
) -> dict[Integral, Cond]:
    """For each integral the condition under which anybody looks at its value."""
    guard: dict[Node, Cond] = dict.fromkeys(roots, TRUE)
    for node in reversed(order):
        g = guard.get(node, FALSE)
        if node in mine and g is not TRUE and _height(g, height) >= height[node]:
            g = guard[node] = TRUE  # the condition would wait for the integral
        for child in node.children:
            here = g
            if isinstance(node, Where) and child is not node.condition and not node.condition.free & inner:
                c = node.condition if child is node.then else negation(node.condition)
                if node.then is not node.otherwise and (not isinstance(g, And) or len(g.children) < GUARD_TERMS):
                    here = conjunction(g, c)
            have = guard.get(child)
            if have is None:
                guard[child] = here
            elif have is not here and have is not TRUE:
                both = disjunction(have, here) if here is not TRUE else TRUE
                guard[child] = TRUE if isinstance(both, Or) and len(both.children) > GUARD_TERMS else both
    return {i: guard.get(i, TRUE) for i in mine}


def _height(c: Cond, height: dict[Node, int]) -> int:
    """How many integrals, one waiting for the other, must be known before a guard (made of conditions of the program) is."""
    stack: list[Node] = [c]
    most = 0
    while stack:
        node = stack.pop()
        if node in height:
            most = max(most, height[node])
        else:
            stack.extend(node.children)
    return most


def support(e: Expr) -> Cond:
    """A condition outside of which an integrand is 0."""
    if isinstance(e, Where):
        if e.otherwise is ZERO:
            return e.condition
        if e.then is ZERO:
            return negation(e.condition)
        if isinstance(e.then, Where) or isinstance(e.otherwise, Where):
            then = conjunction(e.condition, e.then.condition) if isinstance(e.then, Where) and e.then.otherwise is ZERO else e.condition
            other = negation(e.condition)
            if isinstance(e.otherwise, Where) and e.otherwise.otherwise is ZERO:
                other = conjunction(other, e.otherwise.condition)
            elif isinstance(e.otherwise, Where) and e.otherwise.then is ZERO:
                other = conjunction(other, negation(e.otherwise.condition))
            return disjunction(then, other)
    if isinstance(e, Mul):
        parts = [support(f) for f in e.children if isinstance(f, Where)]
        return conjunction(*parts)
    return TRUE
