"""Exponentials in one product as one exponential, where a factor rises without end in one of several variables.

    ∫ dx ∫ exp(s·(x + y))·exp(-x²/2)·exp(-y²/2) dy  =  ∫ dx ∫ exp(s·(x + y) - x²/2 - y²/2) dy        x, y to infinity
    (exp(s·(x + y)) - a)·exp(-x²/2)                 =  exp(s·(x + y) - x²/2) - a·exp(-x²/2)
    exp(s·x)·∫ exp(-(x² + y²)/2) dy                 =  ∫ exp(s·x - (x² + y²)/2) dy

The product of all factors falls off, but the first one has no bound over a range of x to infinity that holds for all y. So an
integral over y of the first factor overflows beside a second one that is 0, and nothing is known between the nodes of the outer
integral. Meant are products of exponentials of polynomials, of which one is linear in a variable that reaches to infinity, and one
depends on this variable and another such. Sums of such exponentials are multiplied out. Linear in the size of the program.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from teg.analysis.polynomial import Shadow
from teg.analysis.tails import is_unbounded
from teg.ir.expr import ZERO, Add, Call, Expr, Mul, Var, Where
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, nodes_of
from teg.ir.simplify import add, call, mul, where
from teg.ir.traverse import rewritten, stands_in

MOST_TERMS = 16
"""A sum of more terms is not multiplied out."""


def with_common_exponents(e: Expr) -> Expr:
    """Returns e with one exponential in every product that holds one which rises without end beside, or as, one of several variables."""
    endless = tuple(dict.fromkeys(i.var for i in nodes_of(Integral, e) if is_unbounded(i)))
    if len(endless) < 2:
        return e
    exponents = _Exponents(endless)
    calls = nodes_of(Call, e)
    if not any(exponents.linear(c) for c in calls) or not any(exponents.mixed(c) for c in calls):
        return e
    for _ in endless:  # one integral further inside
        e, before = rewritten(e, Mul.bit, exponents.moved_inside), e
        if e is before:
            break
    return rewritten(e, Mul.bit, exponents.in_common)


class _Exponents:
    """What is known of the exponentials of polynomials in the variables that reach to infinity."""

    def __init__(self, endless: tuple[Var, ...]) -> None:
        self.endless = endless
        self.all = Shadow(endless)
        self.each = {v: Shadow((v,)) for v in endless}
        self._linear: dict[Expr, frozenset[Var]] = {}
        self._rising: dict[Node, bool] = {}
        self._mixed: dict[Node, bool] = {}

    def is_exponential(self, e: Expr) -> bool:
        """Returns whether a node is the exponential of a polynomial, no number, in these variables."""
        return (
            isinstance(e, Call) and e.name == "exp" and not e.free.isdisjoint(self.endless) and self.all.degree(e.children[0]) is not None
        )

    def linear(self, e: Expr) -> frozenset[Var]:
        """Returns the variables in which an exponential has a linear exponent; none for other nodes."""
        if e not in self._linear:
            inside = [v for v in self.endless if v in e.free] if self.is_exponential(e) else []
            self._linear[e] = frozenset(v for v in inside if self.each[v].degree(cast(Call, e).children[0]) == 1)
        return self._linear[e]

    def mixed(self, e: Expr) -> frozenset[Var]:
        """Returns the variables of an exponential of several ones; none for other nodes."""
        inside = frozenset(v for v in self.endless if v in e.free)
        return inside if len(inside) > 1 and self.is_exponential(e) else frozenset()

    def moved_inside(self, _: Node, node: Node) -> Node:
        """Returns a product with its rising exponentials inside of the integral in it, where they meet mixed ones."""
        if not isinstance(node, Mul):
            return node
        integrals = [f for f in node.children if isinstance(f, Integral) and is_unbounded(f) and not f.has_delta]
        if len(integrals) != 1:
            return node
        (inner,) = integrals
        met = frozenset[Var]().union(*(self.mixed(c) for c in nodes_of(Call, inner.body)))
        rising = [f for f in node.children if self.linear(f) & met and inner.var not in f.free]
        if not rising:
            return node
        others = [f for f in node.children if f is not inner and f not in rising]
        return mul(*others, integral_over(_times(rising, inner.body), inner.var, inner.lo, inner.hi))

    def in_common(self, _: Node, node: Node) -> Node:
        """Returns a product with one exponential, or a sum of such products."""
        if not isinstance(node, Mul):
            return node
        terms = self._terms(node)
        return add(*map(self._product, terms)) if len(terms) <= MOST_TERMS and any(map(self._meet, terms)) else node

    def _meet(self, factors: Sequence[Expr]) -> bool:
        """Returns whether there are exponentials of which one rises in a variable of a mixed one."""
        known = [f for f in factors if self.is_exponential(f)]
        none = frozenset[Var]()
        return len(known) > 1 and bool(none.union(*map(self.linear, known)) & none.union(*map(self.mixed, known)))

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
            elif isinstance(factor, Add) and self._rises_inside(factor):
                stack.extend((known, (term, *factors)) for term in reversed(children))
            elif factors:
                stack.append(((*known, factor), tuple(factors)))
            else:
                terms.append((*known, factor))
        return terms

    def _rises_inside(self, e: Expr) -> bool:
        """Returns whether a rising exponential stands in the sums and products of an expression."""
        return stands_in(e, lambda n: bool(self.linear(n)), self._rising, lambda n: n.children if isinstance(n, Add | Mul) else ())

    def _product(self, factors: tuple[Expr, ...]) -> Expr:
        """Returns a product in which one exponential has all exponents."""
        known = [f for f in factors if self.is_exponential(f)]
        others = [f for f in factors if f not in known]
        return mul(*others, call("exp", add(*(cast(Expr, f.children[0]) for f in known)))) if known else mul(*others)


def _times(factors: Sequence[Expr], e: Expr) -> Expr:
    """Returns a product, inside of a `where` that is 0 elsewhere, and of the terms of a sum."""
    if isinstance(e, Where) and e.otherwise is ZERO:
        return where(e.condition, mul(*factors, e.then), ZERO)
    return add(*(mul(*factors, term) for term in e.children)) if isinstance(e, Add) else mul(*factors, e)
