"""Limits of products at a surface on which a denominator is 0, too: u/|u|, sin(u)/|u|.

    lim Π Nᵢ / Π Dⱼ  =  L ⁿ(Π Nᵢ) / L ⁿ(Π Dⱼ)   on u = 0,     L = ∇u·∇,    n the order of the zero of Π Dⱼ

By de l'Hospital's rule along the gradient of u, which crosses the surface wherever that is smooth. Factors that are not 0 on the surface
stay. A product without a known limit stays as it is: it is infinite or NaN at run time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.coincidence import ZeroSet
from teg.errors import NotDifferentiableError
from teg.ir.expr import ZERO, Add, And, Call, Cond, Const, Expr, Mul, Pow, Var, Where, called
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, holds_with, integer_power, mul, negation, where
from teg.ir.traverse import Steps, replace_node, unrolled

MAX_ORDER = 4
"""The highest order of a zero whose limits are taken."""

ODD = frozenset(("sin", "tan", "asin", "atan", "sinh", "tanh", "erf", "expm1", "log1p", "magnitude"))
"""Functions that are 0 where their argument is 0."""


_EXPONENTIAL = called("exp")
MOST_NODES = 4000
"""Terms that decay are looked for in jumps of up to so many nodes."""
TAME = frozenset(("sqrt", "root", "log", "log1p", "magnitude", "sin", "cos", "atan", "tanh", "erf", "erfc", "min", "max"))
"""Functions that grow no faster than a power of their argument."""


def is_square(e: Expr) -> bool:
    """Returns whether an expression is written as one that is not negative: an even power, a power of a magnitude, a root."""
    base = e.base if isinstance(e, Pow) else e
    return (isinstance(e, Pow) and e.exponent % 2 == 0) or (isinstance(base, Call) and base.name in ("magnitude", "sqrt", "root", "exp"))


def falls(e: Expr, is_pole: Callable[[Expr], bool], has_pole: Callable[[Expr], bool]) -> bool:
    """Returns whether an expression certainly tends to -∞ at its poles, from all sides: `is_pole` is asked of factors, `has_pole` of
    terms."""
    terms = e.children if isinstance(e, Add) else (e,)
    infinite = [t for t in terms if has_pole(t)]
    return bool(infinite) and all(_sign_at_pole(t, is_pole) < 0.0 for t in infinite)


def _sign_at_pole(term: Expr, is_pole: Callable[[Expr], bool]) -> float:
    """Returns a number with the sign of a product beside its pole; 0 if it is not known, or is not the same on both sides."""
    factors = term.children if isinstance(term, Mul) else ()
    pole = next((f for f in factors if is_pole(f) and is_square(f)), None)
    if pole is None:
        return 0.0
    base = cast(Pow, pole).base
    null = base.children[0] if isinstance(base, Call) and base.name == "magnitude" else base
    sign = 1.0
    for f in factors:
        at_pole = f if is_square(f) else replace_node(f, null, ZERO)
        if not is_square(f):
            sign *= math.copysign(float(at_pole.data != 0.0), at_pole.data) if isinstance(at_pole, Const) else 0.0
    return sign


class Poles:
    """The poles of products on one surface."""

    def __init__(self, surface: Expr) -> None:
        self.surface = surface
        self._null: dict[Expr, bool] = {}
        self._infinite: dict[Expr, bool] = {}
        self._wild: dict[Expr, bool] = {}
        self._decaying: dict[tuple[Expr, frozenset[Cond]], bool] = {}

    @cached_property
    def _zeros(self) -> ZeroSet:
        return ZeroSet(self.surface)

    def has(self, e: Node) -> bool:
        """Returns whether an expression outside of functions has a denominator that is 0 on the surface."""
        return unrolled(self._has(e))

    def _has(self, e: Node) -> Steps[bool]:
        if not isinstance(e, Add | Mul | Pow):
            return False
        if e not in self._infinite:
            found = isinstance(e, Pow) and e.exponent < 0 and (yield self._vanishes(e.base))
            for c in e.children:
                found = found or (yield self._has(c))
            self._infinite[e] = found
        return self._infinite[e]

    def limit(self, node: Node) -> Node:
        """Returns the limit of a product on the surface, if it has a pole there and its limit is known; else the node."""
        return unrolled(self._limit(node))

    def _limit(self, node: Node) -> Steps[Node]:
        if not self.has(node):
            return node
        if isinstance(node, Add):
            terms = list(node.children)
        elif isinstance(node, Mul):
            sums = [f for f in node.children if isinstance(f, Add) and self.has(f)]
            if not sums:
                return self._limit_of_product(node)
            others = [f for f in node.children if f is not sums[0]]
            terms = [mul(*others, term) for term in sums[0].children]
        else:
            return node
        limits = []
        for term in terms:
            limits.append(cast(Expr, (yield self._limit(term))))
        return add(*limits)

    def _limit_of_product(self, node: Mul) -> Node:
        below = [f for f in node.children if isinstance(f, Pow) and f.exponent < 0 and self.vanishes(f.base)]
        above = [f for f in node.children if f not in below and self.vanishes(f)]
        others = [f for f in node.children if f not in below and f not in above]
        try:
            n, denominator = self._leading(mul(*(integer_power(f.base, -f.exponent) for f in below)))
            numerator = mul(*above)
            for _ in range(n):
                if not self.vanishes(numerator):
                    return node
                numerator = self._along(numerator)
        except NotDifferentiableError:
            return node
        return mul(*others, numerator, integer_power(denominator, -1)) if n else node

    def without_decaying(self, e: Expr) -> Expr:
        """Returns an expression without the terms that tend to 0 on the surface faster than every power: 1 + exp(-1/u²) is 1."""
        if not e.kinds & _EXPONENTIAL or len(order := postorder([e])) > MOST_NODES or not any(map(self._is_fast, order)):
            return e
        return unrolled(self._settled(e, frozenset()))

    def _settled(self, e: Expr, known: frozenset[Cond]) -> Steps[Expr]:
        if (yield self._decays(e, known)):
            return ZERO
        match e:
            case Add() | Mul():
                parts: list[Expr] = []
                for c in e.children:
                    parts.append((yield self._settled(c, known)))
                if isinstance(e, Add):
                    return add(*parts)
                return e if any(map(self._has_wild_function, parts)) else mul(*parts)
            case Where():
                holds, fails = (known.union(_parts(c)) for c in (e.condition, negation(e.condition)))
                then = yield self._settled(e.then, holds)
                otherwise = yield self._settled(e.otherwise, fails)
                return where(e.condition, then, otherwise)
            case _:
                return e

    def _is_fast(self, node: Node) -> bool:
        """Returns whether a node is an exponential that tends to 0 on the surface faster than every power."""
        return isinstance(node, Call) and node.name == "exp" and falls(node.children[0], self._is_pole, self.has)

    def decays(self, e: Expr) -> bool:
        """Returns whether an expression tends to 0 on the surface faster than every power, like exp(-1/u²)/u³."""
        return unrolled(self._decays(e, frozenset()))

    def _decays(self, e: Expr, known: frozenset[Cond]) -> Steps[bool]:
        """Returns whether it does where the `known` conditions hold."""
        if (e, known) not in self._decaying:
            self._decaying[e, known] = yield self._decays_by_form(e, known)
        return self._decaying[e, known]

    def _decays_by_form(self, e: Expr, known: frozenset[Cond]) -> Steps[bool]:
        match e:
            case Add():
                for c in e.children:
                    if not (yield self._decays(c, known)):
                        return False
                return True
            case Where():
                holds, fails = e.condition, negation(e.condition)
                then = _is_implied(fails, known) or (yield self._decays(e.then, known.union(_parts(holds))))
                return then and (_is_implied(holds, known) or (yield self._decays(e.otherwise, known.union(_parts(fails)))))
            case Mul():
                fast = set()
                for f in e.children:
                    if (yield self._decays(f, known)):
                        fast.add(f)
                return bool(fast) and not any(self._has_wild_function(f) for f in e.children if f not in fast)
            case Pow():
                return e.exponent > 0 and (yield self._decays(e.base, known))
            case Call(name="exp"):
                return self._is_fast(e)
            case _:
                return e is ZERO

    def _is_pole(self, e: Expr) -> bool:
        return isinstance(e, Pow) and e.exponent < 0 and self.vanishes(e.base)

    def _has_wild_function(self, e: Expr) -> bool:
        """Returns whether a function of a pole stands in an expression: it may grow faster than every power."""
        if e not in self._wild:
            wild = (n for n in postorder([e]) if isinstance(n, Call) and n.name not in TAME)
            self._wild[e] = any(any(map(self.has, n.children)) for n in wild)
        return self._wild[e]

    def _leading(self, e: Expr) -> tuple[int, Expr]:
        """Returns the order of the zero of an expression, and its derivative of this order; the order is 0 if it is not known."""
        for n in range(1, MAX_ORDER + 1):
            e = self._along(e)
            if not self.vanishes(e):
                return n, e
        return 0, e

    def _along(self, e: Expr) -> Expr:
        """Returns the derivative along the gradient of the surface."""
        variables: list[Var] = sorted(self.surface.free, key=lambda v: v.name)
        return add(*(mul(slope(self.surface, v), slope(e, v)) for v in variables))

    def vanishes(self, e: Expr) -> bool:
        """Returns whether an expression is 0 on the surface."""
        return unrolled(self._vanishes(e))

    def _vanishes(self, e: Expr) -> Steps[bool]:
        if not e.free & self.surface.free:
            return False
        if e not in self._null:
            null = False
            if isinstance(e, Mul):
                for f in e.children:
                    null = null or (yield self._vanishes(f))
                null = null and not (yield self._has(e))
            elif isinstance(e, Call) and e.name in ODD:
                null = yield self._vanishes(e.children[0])
            elif isinstance(e, Pow):
                null = e.exponent > 0 and (yield self._vanishes(e.base))
            if not null and e is not self.surface:
                null = not (yield self._has(e)) and self._zeros.annuls(e)
            self._null[e] = null or e is self.surface
        return self._null[e]


def _parts(condition: Cond) -> tuple[Cond, ...]:
    """Returns the conditions that all hold where a condition does."""
    return condition.children if isinstance(condition, And) else (condition,)


def _is_implied(condition: Cond, known: frozenset[Cond]) -> bool:
    """Returns whether a condition holds where the known ones do, by their form."""
    return any(holds_with(condition, c) for c in known)
