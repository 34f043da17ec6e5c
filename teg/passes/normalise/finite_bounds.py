"""Finite intervals for integrals to infinity whose deltas stand on surfaces of several variables.

An integral with an infinite bound stays as it is where possible: its last piece is a tail (`teg.program`). But the charts of a surface
compare the extents of the variables, which must be finite. So those integrals are mapped to finite ones (`teg.analysis.tails`). Planes,
ellipses that are followed by angle, and surfaces with formulas for their roots need no extents (`teg.passes.eliminate.families`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import cast

from teg.analysis.tails import finite_place, infinite_ends, is_unbounded
from teg.ir.expr import MINUS_ONE, Expr, Var
from teg.ir.integral import Delta, Integral, integral_over
from teg.ir.node import Node, nodes_of, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import rewrite, substitute

Endless = Callable[[Expr, Sequence[Var], Collection[Var]], bool]
"""Whether a surface can be followed however far its variables run, innermost first; bounds depend on the variables that come last."""


def with_finite_bounds(e: Expr, endless: Endless | None = None) -> Expr:
    """Returns e with a finite interval for every infinite integral around a δ of several variables that depends on its variable. Those of
    `endless` surfaces stay."""
    integrals = nodes_of(Integral, e) if e.has_delta else []
    if not any(map(is_unbounded, integrals)):
        return e
    outer = {v for n in integrals for v in n.lo.free | n.hi.free if isinstance(v, Var)}
    variables = list(dict.fromkeys(n.var for n in integrals))
    surfaces: dict[Expr, list[Var]] = {}
    for d in nodes_of(Delta, e):
        surfaces[d.g] = [v for v in variables if v in d.g.free]
    charted = {g for g, mine in surfaces.items() if len(mine) > 1 and (endless is None or not endless(g, mine, outer))}
    unbounded = {n.var for n in integrals if is_unbounded(n)}
    waiting = list(charted)
    while waiting:  # in the new variables of one surface another one is no longer endless
        mapped = unbounded.intersection(surfaces[waiting.pop()])
        more = [g for g, mine in surfaces.items() if g not in charted and len(mine) > 1 and not mapped.isdisjoint(mine)]
        charted.update(more)
        waiting += more
    return cast(Expr, rewrite([e], partial(_visit, charted))[e])


def _visit(charted: Collection[Expr], old: Node, new: Node) -> Node:
    if not isinstance(new, Integral) or not is_unbounded(new) or not _is_charted(old, charted):
        return new
    lo, hi = infinite_ends(new)
    if lo > 0 or hi < 0:
        return mul(MINUS_ONE, cast(Expr, _visit(charted, old, integral_over(new.body, new.var, new.hi, new.lo))))
    taken = [v for v in new.body.free | new.lo.free | new.hi.free if isinstance(v, Var)]
    s, bounds, place, rate = finite_place(new, taken)
    return integral_over(mul(rate, cast(Expr, substitute(new.body, {new.var: place}))), s, *bounds)


def _is_charted(node: Node, charted: Collection[Expr]) -> bool:
    """Returns whether a δ inside stands on a surface of an integral's variable that needs finite extents."""
    assert isinstance(node, Integral)
    return any(n.g in charted for n in postorder([node.body]) if isinstance(n, Delta) and node.var in n.g.free)
