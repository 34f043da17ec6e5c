"""Path conditions and supports: when the value of an integral is used, and where an integrand is not 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from teg.analysis.calculus import slope
from teg.ir.expr import FALSE, MINUS_ONE, TRUE, ZERO, Add, And, Compare, Cond, Const, Expr, Mul, Not, Or, Var, Where, const
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive
from teg.ir.traverse import substitute

GUARD_TERMS = 4
"""The largest number of terms of a guard. Longer guards cost more than they save."""
NEAR, EXACT = 2.0**-30, 2.0**-44
"""How near to the box a surface still counts as meeting it, because it may tie.

Relative to the change of the surface over the box, and relative to its terms.
"""


def guards(
    roots: Sequence[Expr],
    order: list[Node],
    inner: frozenset[Var],
    height: dict[Node, int],
    mine: set[Integral],
) -> dict[Integral, Cond]:
    """Returns, for each integral, the condition under which its value is used."""
    guard: dict[Node, Cond] = dict.fromkeys(roots, TRUE)
    for node in reversed(order):
        g = guard.get(node, FALSE)
        if node in mine and g is not TRUE and _height(g, height) >= height[node]:
            g = guard[node] = TRUE  # the condition would depend on the integral
        for child in node.children:
            path = g
            if isinstance(node, Where) and child is not node.condition and not node.condition.free & inner:
                c = node.condition if child is node.then else negation(node.condition)
                if node.then is not node.otherwise and (not isinstance(g, And) or len(g.children) < GUARD_TERMS):
                    path = conjunction(g, c)
            have = guard.get(child)
            if have is None:
                guard[child] = path
            elif have is not path and have is not TRUE:
                both = disjunction(have, path) if path is not TRUE else TRUE
                guard[child] = TRUE if isinstance(both, Or) and len(both.children) > GUARD_TERMS else both
    return {i: guard.get(i, TRUE) for i in mine}


def _height(c: Cond, height: dict[Node, int]) -> int:
    """Returns the number of integrals, each depending on the next, that must be known before a guard is. A guard consists of program
    conditions."""
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
    """Returns a condition outside of which the integrand is 0."""
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


def weakened(c: Cond, keeps: Callable[[Expr], bool]) -> Cond:
    """Returns a condition that holds wherever c does, made of those atoms g > 0 and g >= 0 of c of whose g `keeps` is true."""
    either: dict[Node, tuple[Cond, Cond]] = {}  # that a condition holds, and that it does not
    for node in postorder([c]):
        if isinstance(node, Compare):
            kept = keeps(node.g)
            either[node] = (positive(node.g, strict=False), positive(mul(MINUS_ONE, node.g), strict=False)) if kept else (TRUE, TRUE)
        elif isinstance(node, Not):
            either[node] = either[node.children[0]][::-1]
        elif isinstance(node, And | Or):
            holds, fails = zip(*(either[part] for part in node.children), strict=True)
            either[node] = (
                (conjunction(*holds), disjunction(*fails)) if isinstance(node, And) else (disjunction(*holds), conjunction(*fails))
            )
        elif isinstance(node, Cond):
            either[node] = TRUE, TRUE
    return either[c][0]


def middle_and_reach(g: Expr, corner: Mapping[Var, Expr], extents: Sequence[Expr]) -> tuple[Expr, Expr]:
    """Returns the value of an affine g in the middle of a box, and its largest deviation from it on the box, with room for ties.

    The box lies on one side of the surface where |middle| > reach. `corner` lists the variables outermost first, so that all callers get
    the same expressions.
    """
    at_corner = cast(Expr, substitute(g, corner))
    steps = [mul(cast(Expr, substitute(slope(g, v), corner)), d) for v, d in zip(corner, extents, strict=True)]
    terms = at_corner.children if isinstance(at_corner, Add) else (at_corner,)
    over_box = mul(const(0.5 + NEAR), add(*(_magnitude(step) for step in steps)))
    rounded = mul(const(EXACT), add(*(_magnitude(t) for t in terms)))
    return add(at_corner, mul(const(0.5), add(*steps))), add(over_box, rounded)


def _magnitude(e: Expr) -> Expr:
    return const(abs(e.data)) if isinstance(e, Const) else call("magnitude", e)
