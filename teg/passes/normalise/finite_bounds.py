"""Finite intervals for integrals to infinity whose deltas stand on surfaces of several variables.

An integral with an infinite bound stays as it is where possible: its last piece is a tail (`teg.program`). But the charts of a surface
compare the extents of the variables, which must be finite. So those integrals are mapped to finite ones (`teg.analysis.tails`). A plane is
solved for one of its variables instead, which needs no extents.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.surfaces import is_affine
from teg.analysis.tails import finite_place, infinite_ends, is_unbounded
from teg.ir.expr import MINUS_ONE, Const, Expr, Var
from teg.ir.integral import Delta, Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import rewrite, substitute


def with_finite_bounds(e: Expr, planes: bool = False) -> Expr:
    """Returns e with a finite interval for every infinite integral around a δ of several variables that depends on its variable; those of
    `planes` in boxes only if they are asked for."""
    integrals = [n for n in postorder([e]) if isinstance(n, Integral)]
    if not e.has_delta or not any(map(is_unbounded, integrals)):
        return e
    outer = {v for n in integrals for v in n.lo.free | n.hi.free if isinstance(v, Var)}
    return cast(Expr, rewrite([e], partial(_visit, None if planes else outer))[e])


def _visit(outer: set[Var] | None, old: Node, new: Node) -> Node:
    if not isinstance(new, Integral) or not is_unbounded(new) or not _is_charted(new, outer):
        return new
    lo, hi = infinite_ends(new)
    if lo > 0 or hi < 0:
        return mul(MINUS_ONE, cast(Expr, _visit(outer, old, integral_over(new.body, new.var, new.hi, new.lo))))
    taken = [v for v in new.body.free | new.lo.free | new.hi.free if isinstance(v, Var)]
    s, bounds, place, rate = finite_place(new, taken)
    return integral_over(mul(rate, cast(Expr, substitute(new.body, {new.var: place}))), s, *bounds)


def _is_charted(node: Integral, outer: set[Var] | None) -> bool:
    """Returns whether a δ inside stands on a surface of the integral's variable and another one, that is no plane which can be solved for a
    variable. Bounds depend on the `outer` ones; None: planes count too."""
    for d in (n for n in postorder([node.body]) if isinstance(n, Delta) and node.var in n.g.free):
        mine = [v for v in d.g.free if isinstance(v, Var)]
        if len(mine) > 1 and (outer is None or not _is_plane(d.g, mine, outer)):
            return True
    return False


def _is_plane(g: Expr, mine: Sequence[Var], outer: set[Var]) -> bool:
    if not is_affine(g, mine):
        return False
    return outer.isdisjoint(mine) or any(v not in outer and isinstance(slope(g, v), Const) for v in mine)
