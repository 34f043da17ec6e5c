"""Exponentials in one product as one exponential, where a factor rises without end in several variables.

    ∫ dx ∫ exp(s·(x + y))·exp(-x²/2)·exp(-y²/2) dy  =  ∫ dx ∫ exp(s·(x + y) - x²/2 - y²/2) dy        x, y to infinity
    (exp(s·(x + y)) - a)·exp(-x²/2)                 =  exp(s·(x + y) - x²/2) - a·exp(-x²/2)

The product of all factors falls off, but the first one has no bound over a range of x to infinity that holds for all y. So an
integral over y of the first factor overflows beside a second one that is 0, and nothing is known between the nodes of the outer
integral. The exponents are polynomials in the variables that reach to infinity; those of which one is linear are meant. A sum of
such exponentials is multiplied out. Linear in the size of the program.
"""

from __future__ import annotations

from typing import cast

from teg.analysis.polynomial import Shadow
from teg.analysis.tails import is_unbounded
from teg.ir.expr import Add, Call, Expr, Mul, Var
from teg.ir.integral import Integral
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import add, call, mul
from teg.ir.traverse import rewritten, stands_in

MOST_TERMS = 16
"""A sum of more terms is not multiplied out."""


def with_common_exponents(e: Expr) -> Expr:
    """Returns e with one exponential in every product that holds one which rises without end in several variables."""
    endless = tuple(dict.fromkeys(i.var for i in nodes_of(Integral, e) if is_unbounded(i)))
    if len(endless) < 2:
        return e
    exponents = _Exponents(endless)
    return e if not any(map(exponents.rises, nodes_of(Call, e))) else rewritten(e, Mul.bit, exponents.visit)


class _Exponents:
    """What is known of the exponentials of polynomials in the variables that reach to infinity."""

    def __init__(self, endless: tuple[Var, ...]) -> None:
        self.endless = endless
        self.all = Shadow(endless)
        self.each = {v: Shadow((v,)) for v in endless}
        self.holding: dict[Node, bool] = {}

    def is_exponential(self, e: Expr) -> bool:
        """Returns whether a node is the exponential of a polynomial, no number, in these variables."""
        return (
            isinstance(e, Call) and e.name == "exp" and not e.free.isdisjoint(self.endless) and self.all.degree(e.children[0]) is not None
        )

    def rises(self, e: Expr) -> bool:
        """Returns whether it is one of several variables that is linear in one of them: it rises without end in that."""
        inside = [v for v in self.endless if v in e.free]
        return len(inside) > 1 and self.is_exponential(e) and any(self.each[v].degree(cast(Call, e).children[0]) == 1 for v in inside)

    def visit(self, _: Node, node: Node) -> Node:
        """Returns a product with one exponential, or a sum of such products."""
        if not isinstance(node, Mul):
            return node
        terms = self._terms(node)
        mixed = [t for t in terms if any(map(self.rises, t)) and sum(map(self.is_exponential, t)) > 1]
        return add(*map(self._product, terms)) if mixed and len(terms) <= MOST_TERMS else node

    def _terms(self, node: Expr) -> list[tuple[Expr, ...]]:
        """Returns the factors of the terms of which a product is the sum, more than MOST_TERMS if these are too many: sums in it that hold
        rising exponentials are multiplied out."""
        terms: list[tuple[Expr, ...]] = []
        stack: list[tuple[tuple[Expr, ...], tuple[Expr, ...]]] = [((), (node,))]
        while stack and len(terms) <= MOST_TERMS:
            known, (factor, *factors) = stack.pop()
            children = cast("tuple[Expr, ...]", factor.children)
            if isinstance(factor, Mul):
                stack.append((known, (*children, *factors)))
            elif isinstance(factor, Add) and self._holds_one(factor):
                stack.extend((known, (term, *factors)) for term in reversed(children))
            elif factors:
                stack.append(((*known, factor), tuple(factors)))
            else:
                terms.append((*known, factor))
        return terms

    def _holds_one(self, e: Expr) -> bool:
        """Returns whether a rising exponential stands in the sums and products of an expression."""
        return stands_in(e, self.rises, self.holding, lambda n: n.children if isinstance(n, Add | Mul) else ())

    def _product(self, factors: tuple[Expr, ...]) -> Expr:
        """Returns a product in which one exponential has all exponents."""
        known = [f for f in factors if self.is_exponential(f)]
        others = [f for f in factors if f not in known]
        return mul(*others, call("exp", add(*(cast(Expr, f.children[0]) for f in known)))) if known else mul(*others)
