"""Products 0·∞ whose limit is 0: exp(-1/u²)/u⁴ where u is 0 or nearly so, u·log u, and exp(-x²/2)·√(1 + exp x) far away.

The exponential is 0 long before the other factor is infinite, so a product is its vanishing factor wherever that is 0. Derivatives of
smooth bumps, exp(-1/(1 - x²)) on |x| < 1, are such products beside the bump's border; payoffs of prices exp(s·x) under a normal density are
such products in its tails. A node beside the border of u·log u may be on it to rounding.
Linear for bumps, linear in the nodes of a product for Gaussians.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.analysis.calculus import slope
from teg.analysis.extents import Extent, Extents
from teg.analysis.limits import falls
from teg.analysis.polynomial import Degrees
from teg.ir.expr import ZERO, Add, Call, Const, Expr, Mul, Pow, Var, Where, called
from teg.ir.function import Apply
from teg.ir.integral import ClosedForm, Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.simplify import mul
from teg.ir.traverse import formed_of, stands_in

LARGE = 200.0
"""Exponentials within exp(±LARGE) are no danger."""
GENTLE = frozenset(("log", "sqrt", "root", "magnitude", "min", "max", "sin", "cos", "atan"))
"""Functions that grow no faster than a power of their argument, and fall no faster."""
MAX_DEPTH, MAX_TERMS = 6, 8
"""Where common factors are looked for: so many sums, products and integrals in each other, and sums of so many terms."""
BOUNDED = frozenset(("tanh", "erf", "erfc"))
"""Functions that grow no faster than a power, but whose distance from a constant may fall like a Gaussian."""


_EXPONENTIAL, _DECIDING = called("exp"), called("exp", "log")


class Underflow:
    """Finds Gaussians over infinite ranges that underflow where other factors overflow: exp(-x²/2)·max(exp(s·x) - K, 0)^c far away.

    Such a product is 0 there if all exponentials in the others are affine in x, with slopes that are numbers or parameters: these grow
    less than the Gaussian falls. `extents` has the bounds of variables that are known in numbers.
    """

    def __init__(self, extents: Extents) -> None:
        self.extents = extents
        self._degrees = Degrees()

    def of(self, e: Mul) -> Expr | None:
        """Returns the product of the Gaussians of e that vanish faster than others grow; None if there are none."""
        if not e.kinds & _EXPONENTIAL:
            return None
        small = {g: variables for f in e.children for g in _exponentials(f) if (variables := self._falling(g))}
        nodes = postorder(e.children) if small else []
        if not any(isinstance(n, Call) and n.name == "exp" and self._extent(n)[1] > LARGE for n in nodes):
            return None
        below = {n for f in nodes if _may_divide(f) for n in postorder([f])}
        fast = [g for g, variables in small.items() if any(self._grows_less(v, nodes, below) for v in variables)]
        return mul(*fast) if fast else None

    def _extent(self, e: Call) -> Extent:
        return self.extents.of(e.children[0])

    def _falling(self, e: Call) -> list[Var]:
        """Returns the variables of infinite range in which an exponential falls like a Gaussian."""
        low, high = self._extent(e)
        if low > -LARGE or high > LARGE:
            return []
        return [v for v in e.free if isinstance(v, Var) and self._degrees.of(e.children[0], v) == 2]

    def _grows_less(self, v: Var, nodes: Sequence[Node], below: set[Node]) -> bool:
        """Returns whether these nodes grow no faster than exponentials of multiples of v."""
        for n in nodes:
            if v not in n.free:
                continue
            if isinstance(n, Integral) and (v in n.lo.free or v in n.hi.free):
                return False
            if isinstance(n, Call) and not self._is_gentle(n, v) and (n in below or not self._is_bounded(n)):
                return False
            if isinstance(n, Apply | PointMasses | ClosedForm):
                return False
        return True

    def _is_gentle(self, n: Call, v: Var) -> bool:
        """Returns whether a function is between powers of its argument, or an exponential of a multiple of v."""
        u = n.children[0]
        if n.name == "pow":
            return v not in n.children[1].free
        degree = self._degrees.of(u, v) if n.name == "exp" else None
        affine = degree is not None and degree <= 1 and not any(isinstance(w, Var) for w in slope(u, v).free)
        return affine or n.name in GENTLE

    def _is_bounded(self, n: Call) -> bool:
        return n.name in BOUNDED or (n.name == "exp" and self._extent(n)[1] <= LARGE)


def _may_divide(node: Node) -> bool:
    """Returns whether a node is a power that is large where its base is small."""
    if isinstance(node, Pow):
        return node.exponent < 0
    return isinstance(node, Call) and node.name == "pow" and not (isinstance(node.children[1], Const) and node.children[1].data > 0.0)


def _exponentials(e: Expr, depth: int = 0) -> list[Call]:
    """Returns the exponentials that are factors of an expression, also in front of what an integral integrates, down to MAX_DEPTH."""
    if depth == MAX_DEPTH or not e.kinds & _EXPONENTIAL:
        return []
    match e:
        case Call(name="exp"):
            return [e]
        case Mul():
            return [g for f in e.children for g in _exponentials(f, depth + 1)]
        case Where() if ZERO in (e.then, e.otherwise):
            return _exponentials(e.then if e.otherwise is ZERO else e.otherwise, depth + 1)
        case Add() if len(e.children) <= MAX_TERMS:
            first, *others = [_exponentials(f, depth + 1) for f in e.children]
            return [g for g in first if all(g in terms for terms in others)]
        case Integral():
            return [g for g in _exponentials(e.body, depth + 1) if e.var not in g.free]
        case _:
            return []


class Vanishing:
    """Finds the factors that vanish where others are infinite. Facts of nodes are kept."""

    def __init__(self) -> None:
        self._poles: dict[Node, bool] = {}
        self._fallen: dict[Node, bool] = {}

    def of(self, e: Mul) -> Expr | None:
        """Returns the product of the factors of e that may vanish faster than others grow; None if there are none."""
        if not e.kinds & _DECIDING:
            return None
        small = [f for f in e.children if stands_in(f, self._decays, self._fallen, formed_of)]
        others = [f for f in e.children if f not in small or len(small) > 1]
        if 0 < len(small) < len(e.children) and any(map(self._has_pole, others)):
            return mul(*small)
        sums = {f.children[0] for f in e.children if isinstance(f, Call) and f.name == "log" and isinstance(f.children[0], Add) and f.free}
        return next((f for f in e.children if _base(f) in sums), None)

    def _decays(self, node: Expr) -> bool:
        """Returns whether a node is an exponential of what tends to -∞ at a pole."""
        return isinstance(node, Call) and node.name == "exp" and falls(node.children[0], _is_pole, self._has_pole)

    def _has_pole(self, e: Expr) -> bool:
        return stands_in(e, _is_pole, self._poles, formed_of)


def _is_pole(node: Expr) -> bool:
    """Returns whether a node is a negative power of what depends on variables."""
    return isinstance(node, Pow) and node.exponent < 0 and bool(node.free)


def _base(f: Expr) -> Expr:
    """Returns the u of a factor u, uᵏ or √u, which is 0 where u is; the factor itself for others."""
    match f:
        case Pow() if f.exponent > 0:
            return f.base
        case Call(name="sqrt", children=(Expr() as u,)):
            return u
        case Call(name="pow", children=(Expr() as u, Expr() as k)) if not k.free and not (isinstance(k, Const) and k.data <= 0.0):
            return u  # a power of 0 says by itself whether it is 0
        case _:
            return f
