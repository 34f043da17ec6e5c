"""Finite intervals for integrals to infinity whose deltas stand on surfaces of several variables.

An integral with an infinite bound stays as it is where possible: its last piece is a tail (`teg.program`). But the charts of a surface
compare the extents of the variables, which must be finite. So those integrals are mapped to finite ones (`teg.analysis.tails`).
"""

from __future__ import annotations

from typing import cast

from teg.analysis.tails import finite_place, infinite_ends, is_unbounded
from teg.ir.expr import MINUS_ONE, Expr, Var
from teg.ir.integral import Delta, Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import rewrite, substitute


def with_finite_bounds(e: Expr) -> Expr:
    """Returns e with a finite interval for every infinite integral around a δ of several variables that depends on its variable."""
    if not e.has_delta or not any(isinstance(n, Integral) and is_unbounded(n) for n in postorder([e])):
        return e
    return cast(Expr, rewrite([e], _visit)[e])


def _visit(old: Node, new: Node) -> Node:
    if not isinstance(new, Integral) or not is_unbounded(new) or not _is_charted(new):
        return new
    lo, hi = infinite_ends(new)
    if lo > 0 or hi < 0:
        return mul(MINUS_ONE, cast(Expr, _visit(old, integral_over(new.body, new.var, new.hi, new.lo))))
    taken = [v for v in new.body.free | new.lo.free | new.hi.free if isinstance(v, Var)]
    s, bounds, place, rate = finite_place(new, taken)
    return integral_over(mul(rate, cast(Expr, substitute(new.body, {new.var: place}))), s, *bounds)


def _is_charted(node: Integral) -> bool:
    """Returns whether a δ inside stands on a surface of the integral's variable and another one."""
    deltas = [n for n in postorder([node.body]) if isinstance(n, Delta) and node.var in n.g.free]
    return any(len([v for v in d.g.free if isinstance(v, Var)]) > 1 for d in deltas)
