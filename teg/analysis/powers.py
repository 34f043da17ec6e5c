"""Powers u^k whose exponents are parameters.

Where k is less than 1 the derivative of u^k by a parameter in u is singular on u = 0, a surface that moves (`singularities.py`), and
the integral is carried along with it. For larger k nothing has to be. Which it is, is not known before k is, so both are made. With
u²·u^(k - 2) for u^k the order of an expression at u = 0, which takes an unknown k for -½ at worst, is right for k >= 3/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.ir.expr import ONE, TRUE, ZERO, Add, Call, Cond, Const, Expr, Mul, Param, Pow, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, integer_power, mul, positive, sub
from teg.ir.traverse import rewrite

LEAST = 1.5
"""The least exponent k for which an order of -½ of u^(k - 2) is not too large."""


def raised_powers(e: Expr) -> tuple[Expr, Cond]:
    """Returns an expression in which powers u^k, of what depends on variables, by parameters k are written u²·u^(k - 2); and the condition
    under which it may replace the expression: no k is less than `LEAST`."""
    exponents = {n.children[1] for n in postorder([e]) if isinstance(n, Call) and n.name == "pow" and n.children[0].free}
    exponents = {k for k in exponents if not k.free and any(isinstance(n, Param) for n in postorder([k]))}

    def visit(old: Node, new: Node) -> Node:
        if not isinstance(new, Call) or new.name != "pow" or new.children[1] not in exponents:
            return new
        u, k = new.children
        if u is ZERO:
            return ZERO
        return mul(integer_power(u, 2), call("pow", u, sub(k, const(2.0)))) if u.free else new

    raised = cast(Expr, rewrite([e], visit)[e])
    return raised, conjunction(*(positive(sub(k, const(LEAST)), strict=False) for k in sorted(exponents, key=str))) if exponents else TRUE


def merged_powers(e: Expr) -> Expr:
    """Returns an expression with u^(k + n) for products of u^n and u^k."""

    def visit(old: Node, new: Node) -> Node:
        return _merged(new) if isinstance(new, Mul) else new

    return cast(Expr, rewrite([e], visit)[e])


def _merged(product: Mul) -> Expr:
    bases = {c.children[0] for c in product.children if isinstance(c, Call) and c.name == "pow"}
    if not bases:
        return product
    exponents: dict[Expr, list[Expr]] = {}
    rest: list[Expr] = []
    for factor in product.children:
        base: Expr = factor
        exponent: Expr = ONE
        if isinstance(factor, Call) and factor.name == "pow":
            base, exponent = factor.children
        elif isinstance(factor, Pow):
            base, exponent = factor.base, const(float(factor.exponent))
        if base in bases:
            exponents.setdefault(base, []).extend(exponent.children if isinstance(exponent, Add) else [exponent])
        else:
            rest.append(factor)
    return mul(*rest, *(call("pow", base, _sum(terms)) for base, terms in exponents.items()))


def _sum(terms: Sequence[Expr]) -> Expr:
    number = sum(term.data for term in terms if isinstance(term, Const))
    return add(*(term for term in terms if not isinstance(term, Const)), const(float(number)))
