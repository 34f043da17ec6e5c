"""Integrals around poles that move, in the distance from them, before they are differentiated.

    ∫ₗʰ dy ∫ dx F/((x - a)² + (y - b)²)   →   ∫_{l - b}^{h - b} dv ∫ dx F/((x - a)² + v²)         with y = b + v in F

The derivative of such an integrand by b is not integrable at the pole: what is integrated over x jumps there, or grows like 1/(y - b), and
the derivative of the jump, a multiple of δ(y - b), is missing if the derivative is taken under the outer integral. In the distance v the
pole is at rest, and its motion is that of the bounds. A pole is a place where a quadratic polynomial in a denominator has its least value,
and is 0. Of several in one product each rests in its part of the range of the outermost of their variables, as far as half-way to the next.
Where this one is fixed beside the pole, inner integrals meet none. What an infinite integral grows like is a pole as well:
∫₀^∞ exp(-x·|y - b|) dx. Linear, but for a visit of the integrand for each denominator.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence, Set
from itertools import pairwise
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.extents import extent
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.roots import tidy
from teg.analysis.singularities import Keys
from teg.analysis.surfaces import binders_inside, ordered
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ZERO, Add, Call, Expr, Mul, Param, Pow, Var, Where, const, is_infinite
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, div, mul, sub
from teg.ir.traverse import parameters, rewrite, size, substitute
from teg.passes.normalise.centre import between, in_order

Pole = dict[Var, Expr]
"""The place of a pole in each of its variables."""
MAX_POLES = 3
"""The largest number of poles of one product that are brought to rest."""
SHORT = 16
"""Sums of at most so many nodes are written shorter: (a + x) - a is x."""


def around_poles(root: Expr, wrt: Collection[Param | Var]) -> Expr:
    """Returns the program with integrals in the distance from poles that some parameters move. Its value is the same."""
    if not any(
        _argument(n) is not None or (isinstance(n, Integral) and (is_infinite(n.lo) or is_infinite(n.hi))) for n in postorder([root])
    ):
        return root
    poles = _Poles(wrt)

    def visit(old: Node, new: Node) -> Node:
        return poles.at_rest(new) if isinstance(new, Integral) and not new.has_delta else new

    return cast(Expr, rewrite([root], visit)[root])


class _Poles:
    """The poles of one program that some parameters move; what is found out about its expressions is kept."""

    def __init__(self, wrt: Collection[Param | Var]) -> None:
        self.wrt = wrt
        self._keys = Keys()
        self._shadows: dict[tuple[Var, ...], Shadow] = {}

    def at_rest(self, node: Integral) -> Expr:
        """Returns an integral in the distance from its pole; one for each if they are those of different summands, or of one product."""
        if not self._of(node, node.body):
            return node
        summands = node.body.children if isinstance(node.body, Add) else (node.body,)
        groups: dict[frozenset[object], tuple[list[Pole], list[Expr]]] = {}
        for e in cast("Sequence[Expr]", summands):
            poles = self._of(node, e)
            groups.setdefault(frozenset(poles), (list(poles.values()), []))[1].append(e)
        return add(*(_around(node, add(*parts), poles) for poles, parts in groups.values()))

    def _of(self, node: Integral, body: Expr) -> dict[object, Pole]:
        """Returns the moving poles of a part of an integrand, by their places in the variable of the integral."""
        x, inner = node.var, binders_inside(body)
        arguments = dict.fromkeys(g for n in postorder([body]) if (g := _argument(n)) is not None and x in g.free and g.free & inner)
        poles = [self._lowest(g, (*sorted(g.free & inner, key=lambda v: v.name), x)) for g in arguments]
        poles += ({x: place} for place in _endless(body, x))
        moving = [pole for pole in poles if pole and any(not _symbols(place).isdisjoint(self.wrt) for place in pole.values())]
        return {self._keys.of(sub(x, pole[x])): pole for pole in reversed(moving)}

    def _lowest(self, g: Expr, variables: tuple[Var, ...]) -> Pole | None:
        """Returns where a quadratic polynomial in some variables has its least value, if it is 0 there; None for others."""
        if self._shadows.setdefault(variables, Shadow(variables)).degree(g) != 2:
            return None
        stationary: list[tuple[Var, Expr]] = []  # of each variable, in terms of the next ones
        try:
            for v in variables:
                rate = slope(g, v)
                curvature = slope(rate, v)
                if curvature is ZERO or extent(curvature, {})[0] < 0.0:
                    return None
                place = mul(MINUS_ONE, div(cast(Expr, substitute(rate, {v: ZERO})), curvature))
                g = cast(Expr, substitute(g, {v: place}))
                stationary.append((v, place))
        except NotDifferentiableError:
            return None
        pole: Pole = {}
        for v, place in reversed(stationary):
            pole[v] = cast(Expr, substitute(place, pole))
        return pole if is_null(g) else None


def _around(node: Integral, body: Expr, poles: Sequence[Pole]) -> Expr:
    """Returns the integral of a part of the integrand around its poles: of several, each as far as half-way to the next one."""
    if len(poles) == 1:
        return _shifted(node, body, poles[0], node.lo, node.hi)
    if len(poles) > MAX_POLES or ordered(node.lo, node.hi) <= 0:
        return integral_over(body, node.var, node.lo, node.hi)
    places = in_order([pole[node.var] for pole in poles])
    ends = [node.lo, *(between(mul(const(0.5), add(p, q)), node.lo, node.hi) for p, q in pairwise(places)), node.hi]
    return add(*(_shifted(node, body, {node.var: place}, lo, hi) for place, (lo, hi) in zip(places, pairwise(ends), strict=True)))


def _shifted(node: Integral, body: Expr, pole: Pole, lo: Expr, hi: Expr) -> Expr:
    """Returns the integral of a part of the integrand from `lo` to `hi` in the distance from a pole, as those over its other variables."""

    def visit(old: Node, new: Node) -> Node:
        return _from(new, pole[new.var]) if isinstance(new, Integral) and new.var in pole else new

    return _from(integral_over(cast(Expr, rewrite([body], visit)[body]), node.var, lo, hi), pole[node.var])


def _from(node: Expr, place: Expr) -> Expr:
    """Returns an integral in the distance from a place."""
    if not isinstance(node, Integral) or place.free & binders_inside(node):
        return node
    lo, hi = (b if is_infinite(b) else tidy(sub(b, place)) for b in (node.lo, node.hi))
    body = substitute(node.body, {node.var: add(place, node.var)})
    distances: dict[Node, Expr] = {n: tidy(n) for n in postorder([body]) if isinstance(n, Add) and node.var in n.free and size(n) <= SHORT}
    return integral_over(cast(Expr, rewrite([body], lambda old, new: distances.get(new, new))[body]), node.var, lo, hi)


def _endless(body: Expr, var: Var) -> Iterator[Expr]:
    """Yields the places where exponentials in infinite integrals inside cease to decay, exp(-x·|y - b|) at y = b: such an integral grows
    like a pole there."""
    for node in postorder([body]):
        if not isinstance(node, Integral) or not (is_infinite(node.lo) or is_infinite(node.hi)):
            continue
        for exponent in _exponents(node.body, {var, node.var}):
            rate = slope(exponent, node.var)
            for g in _linear_factors(rate, var):
                place = mul(MINUS_ONE, div(cast(Expr, substitute(g, {var: ZERO})), slope(g, var)))
                if is_null(cast(Expr, substitute(rate, {var: place}))):
                    yield place


def _exponents(body: Expr, variables: Set[Var]) -> list[Expr]:
    """Returns the outermost exponents in which some variables occur together."""
    found: list[Expr] = []
    seen: set[Node] = set()
    stack: list[Node] = [body]
    while stack:
        node = stack.pop()
        if node in seen or not variables <= node.free:
            continue
        seen.add(node)
        if isinstance(node, Call) and node.name == "exp":
            found.append(node.children[0])
        else:
            stack.extend(node.children)
    return found


def _linear_factors(e: Expr, var: Var) -> list[Expr]:
    """Returns the factors of an expression, or of a branch of it, that are linear in a variable and in no other."""
    found: list[Expr] = []
    stack = [e]
    while stack:
        node = stack.pop()
        if isinstance(node, Mul):
            stack.extend(node.children)
        elif isinstance(node, Where):
            stack.append(node.then)
        elif isinstance(node, Pow) or (isinstance(node, Call) and node.name == "magnitude"):
            stack.append(cast(Expr, node.children[0]))
        elif isinstance(node, Add) and node.free == {var} and Shadow((var,)).degree(node) == 1:
            found.append(node)
    return found


def _symbols(e: Expr) -> set[Param | Var]:
    """Returns the symbols that an expression may be differentiated by."""
    return {*parameters(e), *e.free}


def _argument(node: Node) -> Expr | None:
    """Returns the expression whose zeros are poles of a node: of 1/g, of 1/√g, and of a real power of g."""
    if not (isinstance(node, Pow) and node.exponent < 0) and not (isinstance(node, Call) and node.name == "pow"):
        return None
    g = node.children[0]
    while isinstance(g, Pow) or (isinstance(g, Call) and g.name in ("sqrt", "root", "magnitude")):
        g = g.children[0]
    return g if isinstance(g, Add) and len(g.free) > 1 else None
