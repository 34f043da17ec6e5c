"""Integrals in the order in which waves have few roots.

    ∫ dy ∫ [y < f(x)]·w dx = ∫ dx ∫ [y < f(x)]·w dy        for f with waves, over an infinite range of x

In x such a condition has endlessly many roots, in y one. Both bounds must be the same for all values of the other variable. Linear in the
size of the program. Source: Fubini's theorem.
"""

from __future__ import annotations

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import Call, Const, Expr, Mul, Var
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import rewritten

_WAVES = ("sin", "cos")


def with_few_roots(e: Expr) -> Expr:
    """Returns e with two neighbouring integrals exchanged where a condition with waves has a root by formula in the outer variable."""
    return e if e.has_delta or not e.has_integral else rewritten(e, Integral.bit, _visit)


def _visit(_: Node, outer: Node) -> Node:
    if not isinstance(outer, Integral):
        return outer
    factors = outer.body.children if isinstance(outer.body, Mul) else (outer.body,)
    inside = [f for f in factors if isinstance(f, Integral)]
    if len(inside) != 1:
        return outer
    (inner,) = inside
    if not is_unbounded(inner) or outer.var in inner.lo.free | inner.hi.free:
        return outer
    atoms = [a.g for a in atoms_of(inner.body, inner.var) if outer.var in a.g.free]
    if not any(_has_waves(g, inner.var) for g in atoms) or not all(_is_graph(g, outer.var) for g in atoms):
        return outer
    others = [f for f in factors if f is not inner]
    if any(inner.var in f.free for f in others):  # of an integral around both, which the inner one hides
        return outer
    return integral_over(integral_over(mul(*others, inner.body), outer.var, outer.lo, outer.hi), inner.var, inner.lo, inner.hi)


def _has_waves(g: Expr, x: Var) -> bool:
    return any(isinstance(n, Call) and n.name in _WAVES and x in n.free for n in postorder([g]))


def _is_graph(g: Expr, y: Var) -> bool:
    """Returns whether g is affine in y, with a slope that is a number."""
    try:
        return Shadow((y,)).degree(g) == 1 and isinstance(slope(g, y), Const)
    except NotDifferentiableError:
        return False
