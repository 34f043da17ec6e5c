"""Jumps without a condition: the cut of atan2, and functions of a pole that have limits on both sides of it.

    atan2(v, u)    →   where(v >= 0, ½π - atan2(u, v), atan2(u, -v) - ½π)
    atan(p/q)      →   where(q > 0, atan2(p, q), atan2(-p, -q))
    f(p/q)         →   where(q > 0, f(p/|q|), f(-p/|q|))                  for exp, expm1, tanh, erf, erfc

atan2 jumps by 2π where v = 0 and u < 0, atan(1/x) by π at x = 0, and such a jump moves with the parameters of v or q. On the right no
function jumps where it is used: the second argument of each atan2 is not negative (`HalfAngle`, which stays as it is). Without parameters
a jump stays where it is, and has no derivative. Conditions stay as they are written. Linear.
"""

from __future__ import annotations

import math
from typing import cast

from teg.ir.expr import MINUS_ONE, Call, Compare, Const, Expr, HalfAngle, Mul, Pow, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import call, div, half_angle, mul, positive, sub, where
from teg.ir.traverse import parameters, rebuild
from teg.passes.normalise.canonicalise import cleared, has_variable_denominator, tangents_as_quotients

LIMITED = ("atan", "exp", "expm1", "tanh", "erf", "erfc")
"""Functions with limits at both infinities, of which one is finite at least."""


def with_cuts(root: Expr) -> Expr:
    """Returns the program with jumps of functions as conditions. Its value is the same."""
    order = postorder([root])
    if not any(isinstance(n, Call) and n.free and (n.name == "atan2" or n.name in LIMITED) for n in order):
        return root
    new: dict[Node, Node] = {}
    for node in order:
        children = (node.g, *node.children[1:]) if isinstance(node, Compare) else tuple(new[c] for c in node.children)
        result = rebuild(node, children)
        if isinstance(result, Call) and result.free and not isinstance(result, HalfAngle):
            result = _angle(result) if result.name == "atan2" else _limited(result) if result.name in LIMITED else result
        new[node] = result
    return cast(Expr, new[root])


def _angle(e: Call) -> Expr:
    v, u = cast("tuple[Expr, Expr]", e.children)
    if not v.free or not parameters(v) or (isinstance(u, Const) and u.data > 0.0):
        return e
    quarter = const(0.5 * math.pi)
    above = sub(quarter, half_angle(u, v))
    return where(positive(v, strict=False), above, sub(half_angle(u, mul(MINUS_ONE, v)), quarter))


def _limited(e: Call) -> Expr:
    argument = tangents_as_quotients(e.children[0])
    if not has_variable_denominator(argument):
        return e
    p, q = cleared(argument)
    if not q.free or not parameters(q) or _is_even(q):
        return e
    above = positive(q)
    if e.name == "atan":
        return where(above, half_angle(p, q), half_angle(mul(MINUS_ONE, p), mul(MINUS_ONE, q)))
    size = call("magnitude", q)
    return where(above, call(e.name, div(p, size)), call(e.name, div(mul(MINUS_ONE, p), size)))


def _is_even(q: Expr) -> bool:
    """Returns whether an expression is written as a product of even powers and sizes: it has one sign."""
    factors = q.children if isinstance(q, Mul) else (q,)
    return all(
        not f.free or (isinstance(f, Pow) and f.exponent % 2 == 0) or (isinstance(f, Call) and f.name == "magnitude") for f in factors
    )
