"""Denominators of a surface: an expression as p/q over its variables, and deltas of quotients, δ(p/q) = |q|·δ(p)."""

from __future__ import annotations

from typing import cast

from teg.ir import simplify
from teg.ir.expr import ONE, Add, Call, Expr, Mul, Pow, Where, called, calls_of
from teg.ir.integral import Delta, delta
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, mul
from teg.ir.traverse import formed_of, rebuild, rewrite, stands_in


def tangents_as_quotients(g: Expr) -> Expr:
    """Returns g with tan u = sin u / cos u and 1 + tan² u = 1 / cos² u: the sign of an atom also changes at the poles."""
    if not any(n.free for n in calls_of(called("tan"), g)):
        return g
    new: dict[Node, Node] = {}
    for node in postorder([g]):
        result = rebuild(node, tuple([new[c] for c in node.children]))
        if isinstance(node, Add) and (u := _angle_of_secant(node)) is not None:
            result = simplify.integer_power(simplify.call("cos", cast(Expr, new[u])), -2)
        elif isinstance(result, Call) and result.name == "tan" and result.free:
            result = simplify.div(simplify.call("sin", result.children[0]), simplify.call("cos", result.children[0]))
        new[node] = result
    return cast(Expr, new[g])


def _angle_of_secant(e: Add) -> Expr | None:
    """Returns the u of 1 + tan² u."""
    one, square = e.children if len(e.children) == 2 else (None, None)
    one, square = (square, one) if isinstance(one, Pow) else (one, square)
    if one is not ONE or not isinstance(square, Pow) or square.exponent != 2 or not isinstance(square.base, Call):
        return None
    return square.base.children[0] if square.base.name == "tan" and square.free else None


def has_variable_denominator(g: Expr) -> bool:
    """Returns whether g is divided by an expression with variables in it (outside of functions)."""
    return g.kinds & Pow.bit != 0 and stands_in(g, lambda n: isinstance(n, Pow) and n.exponent < 0 and bool(n.free), {}, formed_of)


def cleared(g: Expr) -> tuple[Expr, Expr]:
    """Returns numerator and denominator of g over its variables. The terms stay as they were written."""
    parts: dict[Expr, tuple[Expr, dict[Expr, int]]] = {}
    for node in postorder([g]):
        if not isinstance(node, Expr):
            continue
        numerator: Expr = node
        below: dict[Expr, int] = {}
        if isinstance(node, Pow) and node.exponent < 0 and node.free:
            inner, inner_below = parts[node.base]
            numerator = mul(*(simplify.integer_power(d, -node.exponent * k) for d, k in inner_below.items()))
            below = {inner: -node.exponent}
        elif isinstance(node, Pow) and parts[node.base][1]:
            inner, inner_below = parts[node.base]
            numerator, below = simplify.integer_power(inner, node.exponent), {d: k * node.exponent for d, k in inner_below.items()}
        elif isinstance(node, Mul):
            for c in node.children:
                for d, k in parts[c][1].items():
                    below[d] = below.get(d, 0) + k
            numerator = mul(*(parts[c][0] for c in node.children)) if below else node
        elif isinstance(node, Add | Where):
            terms = cast("list[Expr]", list(node.children[1:] if isinstance(node, Where) else node.children))
            for c in terms:
                for d, k in parts[c][1].items():
                    below[d] = max(below.get(d, 0), k)
            if below:
                over = [mul(parts[c][0], *(simplify.integer_power(d, k - parts[c][1].get(d, 0)) for d, k in below.items())) for c in terms]
                numerator = simplify.where(node.condition, *over) if isinstance(node, Where) else add(*over)
        parts[node] = (numerator, below)
    numerator, below = parts[g]
    return numerator, mul(*(simplify.integer_power(d, k) for d, k in below.items()))


def cleared_delta(g: Expr) -> Expr:
    """Returns δ(p/q) as |q|·δ(p): equal where q is not 0, and its surface has no poles."""
    g = tangents_as_quotients(g)
    if not has_variable_denominator(g):
        return delta(g)
    numerator, denominator = cleared(g)
    return mul(simplify.call("magnitude", denominator), delta(numerator))


def with_cleared_deltas(e: Expr) -> Expr:
    """Returns e with every δ(p/q) as |q|·δ(p)."""
    return cast(Expr, rewrite([e], lambda _, new: cleared_delta(new.g) if isinstance(new, Delta) else new)[e])
