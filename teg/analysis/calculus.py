"""Derivatives of smooth nodes, and of surfaces: the table that forward mode, reverse mode and the roots of surfaces share."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import cast

from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Expr, Mul, Param, Pow, Var, Where, const
from teg.ir.function import Apply, apply_partials
from teg.ir.node import Node, postorder, postorder_through
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub, where

SMOOTH = frozenset(("exp", "expm1", "sin", "cos", "sinh", "cosh", "tanh", "atan", "erf", "erfc"))
"""Functions of all numbers without singularities, kinks or steps."""


def partials(node: Call) -> list[Expr]:
    """Returns ∂f/∂uᵢ of a function applied, in the order of its arguments."""
    if isinstance(node, Apply):
        return apply_partials(node)
    if node.name in ("chosen", "exact"):
        return [ZERO if node.name == "chosen" else ONE]
    u = node.children[0]
    match node.name:
        case "sin":
            return [call("cos", u)]
        case "cos":
            return [mul(MINUS_ONE, call("sin", u))]
        case "tan":
            return [add(ONE, integer_power(node, 2))]
        case "asin":
            return [integer_power(call("sqrt", sub(ONE, integer_power(u, 2))), -1)]
        case "acos":
            return [mul(MINUS_ONE, integer_power(call("sqrt", sub(ONE, integer_power(u, 2))), -1))]
        case "atan":
            return [integer_power(add(ONE, integer_power(u, 2)), -1)]
        case "atan2":
            x = node.children[1]
            square = add(integer_power(u, 2), integer_power(x, 2))
            return [div(x, square), mul(MINUS_ONE, div(u, square))]
        case "sinh" | "cosh":
            return [call("cosh" if node.name == "sinh" else "sinh", u)]
        case "tanh":
            return [sub(ONE, integer_power(node, 2))]
        case "exp":
            return [node]
        case "expm1":
            return [call("exp", u)]
        case "log":
            return [integer_power(u, -1)]
        case "log1p":
            return [integer_power(add(ONE, u), -1)]
        case "erfinv" | "erfcinv":
            steep = call("exp", integer_power(node, 2))
            return [mul(const(math.copysign(0.5 * math.sqrt(math.pi), 1.0 if node.name == "erfinv" else -1.0)), steep)]
        case "erf" | "erfc":
            bell = call("exp", mul(MINUS_ONE, integer_power(u, 2)))
            return [mul(const(math.copysign(2.0 / math.sqrt(math.pi), 1.0 if node.name == "erf" else -1.0)), bell)]
        case "sqrt" | "root":
            return [mul(const(0.5), integer_power(node, -1))]
        case "pow":
            k = node.children[1]
            return [mul(k, call("pow", u, sub(k, ONE))), _by_exponent(node, u, k)]
        case "magnitude":
            return [where(positive(u), ONE, MINUS_ONE)]
        case "min" | "max":
            first = positive(sub(node.children[1], u) if node.name == "min" else sub(u, node.children[1]))
            return [where(first, ONE, ZERO), where(first, ZERO, ONE)]
        case "floor" | "mod" | "round" | "ceil" if node.free:
            raise steps_error(node, node)
        case "floor" | "round" | "ceil":
            return [ZERO]
        case "mod":
            return [ONE, mul(MINUS_ONE, call("floor", div(u, node.children[1])))]
        case _:
            raise AssertionError(f"no derivative is known for {node.name}")


def _by_exponent(power: Call, u: Expr, k: Expr) -> Expr:
    """Returns ∂uᵏ/∂k. On a branch where u is 0, like that of max(x, 0), it is 0 for positive k, and not 0·∞."""
    rate = mul(call("log", u), power)
    return where(positive(k), ZERO, rate) if u is ZERO else rate


def steps_error(floor: Call, inside: Node) -> NotDifferentiableError:
    """Returns the error for a floor whose steps move with a parameter but could not be enumerated as brackets."""
    return NotDifferentiableError(
        f"{floor.name} jumps where its argument crosses a step, and these steps could not be enumerated",
        inside,
        "some hundred steps, and a thousand cells of several floors in one summand, are enumerated over bounds that are known: take a "
        "coarser step or narrower bounds, and integrate over all of its variables before differentiating",
    )


def factor_cofactors(node: Mul) -> list[Expr]:
    """Returns, for each factor, the product of the others. Linear time."""
    factors = node.children
    if len(factors) == 2:
        return [mul(factors[1]), mul(factors[0])]
    after: list[Expr] = [ONE] * len(factors)
    for i in range(len(factors) - 2, -1, -1):
        after[i] = mul(factors[i + 1], after[i + 1])
    before: Expr = ONE
    result = []
    for factor, behind in zip(factors, after, strict=True):
        result.append(mul(before, behind))
        before = mul(before, factor)
    return result


class Slopes:
    """Slopes by one variable of several expressions; those of their parts are kept."""

    def __init__(self, by: Var) -> None:
        self.by = by
        self._tangent: dict[Expr, Expr] = defaultdict(lambda: ZERO)

    def of(self, e: Expr) -> Expr:
        """Returns ∂e/∂by with conditions held constant. Raises NotDifferentiableError if an integral in e depends on the variable."""
        if e not in self._tangent:
            for node in postorder_through(e, (self.by,), self._unknown):
                if isinstance(node, Expr):
                    self._tangent[node] = _slope(node, self.by, self._tangent)
        return self._tangent[e]

    def _unknown(self, node: Node) -> list[Node]:
        return [c for c in _value_nodes(node) if c not in self._tangent]


@lru_cache(maxsize=1024)
def slope(e: Expr, by: Var | Param) -> Expr:
    """Returns ∂e/∂by with conditions held constant. For atoms; each is asked for its slope again and again.

    Raises NotDifferentiableError if an integral in e depends on a variable `by`; with a parameter `by` integrals are held constant too.
    """
    tangent: dict[Expr, Expr] = defaultdict(lambda: ZERO)
    for node in postorder_through(e, (by,), _value_nodes) if isinstance(by, Var) else _in_value_position(e):
        if isinstance(node, Expr):
            tangent[node] = _slope(node, by, tangent)
    return tangent[e]


def _slope(node: Expr, by: Var | Param, tangent: Mapping[Expr, Expr]) -> Expr:
    if node is by:
        return ONE
    chained = by_chain_rule(node, tangent)
    if chained is None and node.has_integral and isinstance(by, Var):
        raise NotDifferentiableError("the slope of a surface that holds an integral over the same variable is not known", node)
    return ZERO if chained is None else chained


def by_chain_rule(node: Expr, tangent: Mapping[Expr, Expr]) -> Expr | None:
    """Returns the tangent of a sum, a product, a power, a function or a `where`, from those of its operands; None for other nodes.

    Conditions are constant.
    """
    match node:
        case Add():
            return add(*(tangent[c] for c in node.children))
        case Mul():
            if all(tangent[c] is ZERO for c in node.children):
                return ZERO
            return _along(tangent, node.children, factor_cofactors(node))
        case Pow():
            t = tangent[node.base]
            return ZERO if t is ZERO else mul(const(node.exponent), t, integer_power(node.base, node.exponent - 1))
        case Call():
            if all(tangent[c] is ZERO for c in node.children):
                return ZERO
            return _along(tangent, node.children, partials(node))
        case Where():
            return where(node.condition, tangent[node.then], tangent[node.otherwise])
        case _:
            return None


def _along(tangent: Mapping[Expr, Expr], operands: Sequence[Expr], slopes: Sequence[Expr]) -> Expr:
    """Returns Σ slope · tangent over the operands that move."""
    return add(*(mul(tangent[c], p) for c, p in zip(operands, slopes, strict=True) if tangent[c] is not ZERO))


def _value_nodes(node: Node) -> tuple[Node, ...]:
    """Returns the children in value position of any node. Conditions are left out: a floor inside a condition needs no slope."""
    return node.children[1:] if isinstance(node, Where) else node.children


def _in_value_position(e: Expr) -> list[Node]:
    """Returns the nodes of e in value position, children before parents."""
    reached: set[Node] = {e}
    stack: list[Node] = [e]
    while stack:
        new = [c for c in _value_nodes(stack.pop()) if c not in reached]
        reached.update(new)
        stack += new
    return [node for node in postorder([e]) if node in reached]


def value_children(node: Expr) -> tuple[Expr, ...]:
    """Returns the children in value position, that is, without conditions."""
    if isinstance(node, Where):
        return (node.then, node.otherwise)
    return cast("tuple[Expr, ...]", node.children)
