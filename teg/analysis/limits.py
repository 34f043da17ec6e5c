"""Limits of products at a surface on which a denominator is 0, too: u/|u|, sin(u)/|u|.

    lim Π Nᵢ / Π Dⱼ  =  L ⁿ(Π Nᵢ) / L ⁿ(Π Dⱼ)   on u = 0,     L = ∇u·∇,    n the order of the zero of Π Dⱼ

By de l'Hospital's rule along the gradient of u, which crosses the surface wherever that is smooth. Factors that are not 0 on the surface
stay. A product without a known limit stays as it is: it is infinite or NaN at run time.
"""

from __future__ import annotations

from functools import cached_property
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.coincidence import ZeroSet
from teg.errors import NotDifferentiableError
from teg.ir.expr import Add, Call, Expr, Mul, Pow, Var
from teg.ir.node import Node
from teg.ir.simplify import add, integer_power, mul

MAX_ORDER = 4
"""The highest order of a zero whose limits are taken."""

ODD = frozenset(("sin", "tan", "asin", "atan", "sinh", "tanh", "erf", "expm1", "log1p", "magnitude"))
"""Functions that are 0 where their argument is 0."""


class Poles:
    """The poles of products on one surface."""

    def __init__(self, surface: Expr) -> None:
        self.surface = surface
        self._null: dict[Expr, bool] = {}
        self._infinite: dict[Expr, bool] = {}

    @cached_property
    def _zeros(self) -> ZeroSet:
        return ZeroSet(self.surface)

    def has(self, e: Node) -> bool:
        """Returns whether an expression outside of functions has a denominator that is 0 on the surface."""
        if not isinstance(e, Add | Mul | Pow):
            return False
        if e not in self._infinite:
            pole = isinstance(e, Pow) and e.exponent < 0 and self._vanishes(e.base)
            self._infinite[e] = pole or any([self.has(c) for c in e.children])
        return self._infinite[e]

    def limit(self, node: Node) -> Node:
        """Returns the limit of a product on the surface, if it has a pole there and its limit is known; else the node."""
        if not self.has(node):
            return node
        if isinstance(node, Add):
            return add(*(cast(Expr, self.limit(c)) for c in node.children))
        if not isinstance(node, Mul):
            return node
        sums = [f for f in node.children if isinstance(f, Add) and self.has(f)]
        if sums:
            others = [f for f in node.children if f is not sums[0]]
            return add(*(cast(Expr, self.limit(mul(*others, term))) for term in sums[0].children))
        below = [f for f in node.children if isinstance(f, Pow) and f.exponent < 0 and self._vanishes(f.base)]
        above = [f for f in node.children if f not in below and self._vanishes(f)]
        others = [f for f in node.children if f not in below and f not in above]
        try:
            n, denominator = self._leading(mul(*(integer_power(f.base, -f.exponent) for f in below)))
            numerator = mul(*above)
            for _ in range(n):
                if not self._vanishes(numerator):
                    return node
                numerator = self._along(numerator)
        except NotDifferentiableError:
            return node
        return mul(*others, numerator, integer_power(denominator, -1)) if n else node

    def _leading(self, e: Expr) -> tuple[int, Expr]:
        """Returns the order of the zero of an expression, and its derivative of this order; the order is 0 if it is not known."""
        for n in range(1, MAX_ORDER + 1):
            e = self._along(e)
            if not self._vanishes(e):
                return n, e
        return 0, e

    def _along(self, e: Expr) -> Expr:
        """Returns the derivative along the gradient of the surface."""
        variables: list[Var] = sorted(self.surface.free, key=lambda v: v.name)
        return add(*(mul(slope(self.surface, v), slope(e, v)) for v in variables))

    def _vanishes(self, e: Expr) -> bool:
        if not e.free & self.surface.free:
            return False
        if e not in self._null:
            if isinstance(e, Mul):
                null = any([self._vanishes(f) for f in e.children]) and not self.has(e)
            elif isinstance(e, Call) and e.name in ODD:
                null = self._vanishes(e.children[0])
            elif isinstance(e, Pow):
                null = e.exponent > 0 and self._vanishes(e.base)
            else:
                null = False
            self._null[e] = null or e is self.surface or (not self.has(e) and self._zeros.annuls(e))
        return self._null[e]
