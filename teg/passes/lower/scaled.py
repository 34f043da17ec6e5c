"""Quotients and logarithms of exponentials that overflow, computed by their exponents.

    exp(u)/(1 + exp(u))²  =  w⁻²·exp(u - 2m)       w = exp(-m) + exp(u - m),   m = max(0, u)
    log(1 + exp(u))       =  m + log(w)

The derivative of a steep logistic is inf/inf² where exp(u) overflows, and 0/0 where all terms of a denominator underflow; the quotient
itself is an ordinary number. So every factor is written as w·exp(m) with a w of ordinary size, and exponents are added before any
exponential is taken. exp, cosh, sinh and large powers have exponents; sums have the largest exponent of their terms, products their sum.
Where bounds at compile time exclude that anything overflows, nothing is changed. Linear in the program.
Source: Higham 2021, accurately computing the log-sum-exp and softmax functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from typing import cast

from teg.analysis.extents import Extents
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Const, Expr, Mul, Pow, called, const
from teg.ir.integral import Integral
from teg.ir.node import Node
from teg.ir.simplify import add, call, integer_power, mul, positive, sub, where
from teg.ir.traverse import stands_in

LARGE = 200.0
"""A factor within exp(±LARGE) is no danger: the usual products of three such factors do not overflow."""
STEEP = 16
"""The least integer power that is written by its exponent."""
_LIMIT = const(1e300)
"""Exponents are kept below it, so that differences of infinite ones are no NaN."""

_POWERS = Pow.bit | called("exp", "cosh", "sinh", "pow")

Scaled = tuple[Expr, Expr]
"""w and m of w·exp(m)."""


class ByExponents:
    """Products and logarithms rewritten; what is found out about a node is kept. `extents` has the bounds of variables that are known in
    numbers."""

    def __init__(self, extents: Extents) -> None:
        self.extents = extents
        self._made: set[Node] = set()
        self._has_exponents: dict[Node, bool] = {}
        self._varying: dict[Node, bool] = {}
        self._over: dict[Hashable, _Facts] = {}

    def product(self, e: Mul, home: Callable[[Expr], object]) -> Expr | None:
        """Returns a product by the exponents of its factors; None if nothing in it can overflow.

        `home` returns where a factor is computed. Without a division, only factors of one home are multiplied by their exponents.
        """
        factors = e.children
        candidates = [] if e in self._made else [f for f in factors if self._holds_exponents(f)]
        growing = [f for f in candidates if self._may_overflow(f)] if len(candidates) > 1 else []
        if len(growing) < 2:
            return None
        if not any(self._is_divided(f) for f in growing):
            inside = max((home(f) for f in growing), key=lambda at: sum(home(f) is at for f in growing))
            growing = [f for f in growing if home(f) is inside]
            if len(growing) < 2:
                return None
        parts = [self._scaled(f) for f in growing]
        others = [f for f in factors if f not in growing]
        return self._product(*others, *(w for w, _ in parts), self._exponential(add(*(m for _, m in parts))))

    def logarithm(self, e: Call) -> Expr | None:
        """Returns the logarithm of a sum by the exponents of its terms; None if nothing in it can overflow."""
        u = e.children[0]
        grows = isinstance(u, Add) or (isinstance(u, Call) and u.name in ("cosh", "sinh"))
        if e in self._made or not grows or not self._holds_exponents(u) or not self._may_overflow(u):
            return None
        if isinstance(u, Add) and ONE in u.children:  # small values of the other terms keep their digits
            parts = [self._scaled(t) for t in u.children if t is not ONE]
            m = _largest([ZERO, *(m for _, m in parts)])
            terms = [self._product(w, self._exponential(sub(own, m))) for w, own in parts]
            w = add(ONE, call("expm1", mul(MINUS_ONE, m)), *terms)
        else:
            w, m = self._scaled(u)
        return where(positive(sub(_LIMIT, m)), add(m, self._log(w)), const(math.inf))

    def _log(self, u: Expr) -> Expr:
        made = call("log", u)
        self._made.add(made)
        return made

    def _product(self, *factors: Expr) -> Expr:
        made = mul(*factors)
        self._made.add(made)
        return made

    @staticmethod
    def _exponential(m: Expr) -> Expr:
        return ONE if m is ZERO else call("exp", m)

    def _facts(self) -> _Facts:
        """Returns what is known over the box as it is now."""
        return self._over.setdefault(tuple(self.extents.box().items()), _Facts())

    def _holds_exponents(self, e: Expr) -> bool:
        """Returns whether an exponential or a large power stands in the sums and products of an expression."""
        return e.kinds & _POWERS != 0 and stands_in(e, lambda n: self._exponent_of(n) is not None, self._has_exponents, _terms_and_factors)

    def _may_overflow(self, e: Expr) -> bool:
        """Returns whether some exponential or power in the sums and products of e may be huge or tiny."""
        return stands_in(e, self._is_wild, self._facts().overflowing, _terms_and_factors)

    def _is_divided(self, e: Expr) -> bool:
        """Returns whether a sum with exponentials is a denominator in e."""

        def divides(n: Expr) -> bool:
            return isinstance(n, Pow) and n.exponent < 0 and self._may_overflow(n.base)

        return stands_in(e, divides, self._facts().divided, _terms_and_factors)

    def _is_wild(self, node: Expr) -> bool:
        """Returns whether a node is an exponential, or a large power, whose exponent may exceed LARGE."""
        wild = self._facts().wild
        if node not in wild:
            m = self._exponent_of(node)
            lo, hi = (0.0, 0.0) if m is None else self.extents.of(m)
            wild[node] = not (lo >= -LARGE and hi <= LARGE)
        return wild[node]

    def _exponent_of(self, node: Expr) -> Expr | None:
        """Returns the logarithm of the size of an exponential or a large power; None for other nodes."""
        if isinstance(node, Pow) and abs(node.exponent) >= STEEP and not self._varies_inside(node.base):
            return mul(const(node.exponent), call("log", call("magnitude", node.base)))
        if not isinstance(node, Call) or self._varies_inside(node):
            return None
        match node.name:
            case "exp":
                return node.children[0]
            case "cosh" | "sinh":
                return call("magnitude", node.children[0])
            case "pow":
                return mul(node.children[1], call("log", node.children[0]))
            case _:
                return None

    def _varies_inside(self, node: Expr) -> bool:
        """Returns whether an integral in an expression depends on variables: it would be computed once more at every node."""
        return node.has_integral and stands_in(
            node, lambda n: isinstance(n, Integral) and bool(n.free), self._varying, lambda n: n.children
        )

    def _scaled(self, root: Expr) -> Scaled:
        """Returns a number as w·exp(m)."""
        known = self._facts().scaled
        stack = [root]
        while stack:
            node = stack[-1]
            inside = () if self._is_wild(node) else _terms_and_factors(node)
            missing = [c for c in inside if c not in known]
            if missing:
                stack.extend(missing)
                continue
            if node not in known:
                known[node] = self._one_scaled(node, [known[c] for c in inside])
            stack.pop()
        return known[root]

    def _one_scaled(self, node: Expr, parts: list[Scaled]) -> Scaled:
        if self._is_wild(node):
            return self._wild(node)
        if not parts or all(m is ZERO for _, m in parts):
            return node, ZERO
        if isinstance(node, Add):
            return self._sum(parts)
        if isinstance(node, Mul):
            return self._product(*(w for w, _ in parts)), add(*(m for _, m in parts))
        (w, m), k = parts[0], cast(Pow, node).exponent
        return integer_power(w, k), mul(const(k), m)

    def _wild(self, node: Expr) -> Scaled:
        m = call("min", cast(Expr, self._exponent_of(node)), _LIMIT)
        if isinstance(node, Pow):
            return (ONE if node.exponent % 2 == 0 else _sign(node.base)), m
        match cast(Call, node).name:
            case "cosh" | "sinh":
                u = cast(Expr, node.children[0])
                fading = call("exp", mul(const(-2.0), call("magnitude", u)))
                even = mul(const(0.5), add(ONE, fading))
                return (even if cast(Call, node).name == "cosh" else mul(call("tanh", u), even)), m
            case _:
                return ONE, m

    def _sum(self, parts: list[Scaled]) -> Scaled:
        """Returns Σ wᵢ·exp(mᵢ) by the largest exponent. Where the numbers wᵢ add up to 0, small differences keep their digits."""
        m = _largest([own for _, own in parts])
        numbers = [w.data for w, _ in parts if isinstance(w, Const)]
        name = "expm1" if len(numbers) == len(parts) and sum(numbers) == 0.0 else "exp"
        return add(*(self._product(w, call(name, sub(own, m))) for w, own in parts)), m


class _Facts:
    """What is known of nodes over one box."""

    def __init__(self) -> None:
        self.wild: dict[Node, bool] = {}
        self.overflowing: dict[Node, bool] = {}
        self.divided: dict[Node, bool] = {}
        self.scaled: dict[Node, Scaled] = {}


def _terms_and_factors(node: Node) -> Sequence[Expr]:
    return cast("tuple[Expr, ...]", node.children) if isinstance(node, Add | Mul | Pow) else ()


def _sign(u: Expr) -> Expr:
    """Returns u/|u|, 0 at 0; for a u whose large powers are not 0."""
    return call("min", ONE, call("max", MINUS_ONE, mul(_LIMIT, u)))


def _largest(exponents: list[Expr]) -> Expr:
    """Returns the largest of some exponents, limited from below."""
    result = exponents[0]
    for m in exponents[1:]:
        result = result if m is result else call("max", result, m)
    return call("max", result, mul(MINUS_ONE, _LIMIT))
