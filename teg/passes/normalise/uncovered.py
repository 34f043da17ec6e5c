"""Integrals of `teg.any` over a box of two variables as those over what no candidate covers.

    ∫∫ f(any_k c_k)   =   ∫∫ f(true) - ∫∫ (f(true) - f(false))·[no k has c_k]

The second integral is `Uncovered`, which is followed along the edges of candidates (`teg.passes.differentiate.edges`), however many there
are. Cost: a visit a node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.tails import is_unbounded
from teg.ir.arrays import Sum
from teg.ir.cells import indices_apart
from teg.ir.choices import CHOICES, AnyOf
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Expr, Var
from teg.ir.integral import Integral, integral_over
from teg.ir.node import postorder
from teg.ir.simplify import add, mul, sub, where
from teg.ir.uncovered import Uncovered
from teg.passes.normalise.partitions import Refused, one_choice

Bounds = Sequence[tuple[Var, Expr, Expr]]


def over_uncovered(node: Integral) -> Expr:
    """Returns an integral of choices as one over what no candidate covers. Raises Refused."""
    bounds: list[tuple[Var, Expr, Expr]] = []
    body: Expr = node
    while isinstance(body, Integral) and _has_choice(body):
        if is_unbounded(body):
            raise Refused("a bound is infinite")
        if body.lo.free or body.hi.free:
            raise Refused("a bound depends on another variable of integration")
        bounds.append((body.var, body.lo, body.hi))
        body = body.body
    if len(bounds) != 2:
        raise Refused("it is over another number of variables than two")
    return add(*(_term(e, bounds) for e in (body.children if isinstance(body, Add) else (body,))))


def _has_choice(e: Expr) -> bool:
    return any(isinstance(n, CHOICES) and n.free for n in postorder([e]))


def _term(body: Expr, bounds: Bounds) -> Expr:
    if not _has_choice(body):
        return _nest(body, bounds)
    if any(isinstance(n, Integral | Sum) and n.free for n in postorder([body])):
        raise Refused("an integral or a sum stands beside it")
    choice = one_choice(indices_apart(body))
    over = choice.over
    if not isinstance(over, AnyOf):
        raise Refused("it is more than whether there is a candidate")
    children = choice.condition, sub(choice.value, choice.otherwise), *(end for _, lo, hi in bounds for end in (lo, hi))
    free = Uncovered.make((over.index, over.lo, over.hi, tuple(x for x, _, _ in bounds)), children)
    return add(_nest(choice.value, bounds), mul(MINUS_ONE, cast(Expr, free)))


def written(node: Uncovered) -> Expr:
    """Returns the integral with the choice in it."""
    covered = AnyOf.make((node.index, node.lo, node.hi), (node.condition,))
    bounds = [(x, lo, hi) for x, (lo, hi) in zip(node.variables, node.bounds, strict=True)]
    return _nest(mul(node.body, where(covered, ZERO, ONE)), bounds)


def _nest(body: Expr, bounds: Bounds) -> Expr:
    for x, lo, hi in reversed(bounds):
        body = integral_over(body, x, lo, hi)
    return body
