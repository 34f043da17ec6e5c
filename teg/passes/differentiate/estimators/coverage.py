"""Conditions as numbers from 0 to 1: sigmoids of the distances to their surfaces.

    [g > 0] → 1/(1 + exp(-g/(|∇g|·σ)));    & is a product, | is 1 - Π(1 - ·), ~ is 1 - ·

A condition whose surface has no scale keeps its truth value, 0 or 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from teg.ir.expr import MINUS_ONE, ONE, ZERO, And, Compare, Cond, Expr, Not, Or, Truth, Var, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, div, mul, sub, where
from teg.passes.differentiate.estimators.nests import squared_slopes


def scale_of(g: Expr, sigma: float) -> Expr:
    """Returns |∇g|·sigma, by which g is divided in the sigmoid."""
    variables = sorted((v for v in g.free if isinstance(v, Var)), key=lambda v: v.name)
    return mul(call("sqrt", squared_slopes(g, variables)[1]), const(sigma))


def coverage(condition: Cond, sigma: float) -> Expr:
    """Returns the softened truth of a condition, each surface with its own scale."""
    scales = {n.g: scale_of(n.g, sigma) for n in postorder([condition]) if isinstance(n, Compare) and n.g.free}
    truths: dict[Node, Expr] = {}
    for node in postorder([condition]):
        if isinstance(node, Cond):
            truths[node] = truth_of(node, node, truths, scales, with_tail)
    return truths[condition]


def truth_of(node: Cond, result: Cond, truths: Mapping[Node, Expr], scales: Mapping[Expr, Expr], sigmoid: Callable[[Expr], Expr]) -> Expr:
    """Returns the softened truth of a condition from those of its operands. Its operands may have become those of `result`."""
    match node:
        case Compare() if node.g in scales:
            return sigmoid(div(result.g if isinstance(result, Compare) else node.g, scales[node.g]))
        case Not() if isinstance(node.operand, Compare) and node.operand.g in scales:
            g = result.operand.g if isinstance(result, Not) and isinstance(result.operand, Compare) else node.operand.g
            return sigmoid(div(mul(MINUS_ONE, g), scales[node.operand.g]))
        case Not():
            return sub(ONE, truths[node.operand])
        case And():
            return mul(*(truths[c] for c in node.children))
        case Or():
            return sub(ONE, mul(*(sub(ONE, truths[c]) for c in node.children)))
        case Truth():
            return ONE if node.data else ZERO
        case _:
            return where(result, ONE, ZERO)


def plain(z: Expr) -> Expr:
    """Returns 1/(1 + exp(-z)) = (1 + tanh(z/2))/2."""
    return mul(const(0.5), add(ONE, call("tanh", mul(const(0.5), z))))


def with_tail(z: Expr) -> Expr:
    """Returns the same as a quotient, which keeps its digits where it is small; constant below exp(-70)."""
    return div(ONE, add(ONE, call("exp", call("min", mul(MINUS_ONE, z), const(70.0)))))
