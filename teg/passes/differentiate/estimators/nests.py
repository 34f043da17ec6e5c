"""Programs as functions of nests of integrals, and nests as integrals over the unit cube.

    e(θ) = h(I₁(θ), …, I_m(θ), θ)            ∂e = ∂h/∂θ + Σ_k ∂h/∂I_k · ∂I_k
    I(θ) = ∫…∫ F(x; θ) dx = ∫₀¹…∫₀¹ G(u; θ) du,  x = l + (h - l)·u from the outermost variable inwards,  G = F·Π(h - l)

so an estimator needs to differentiate integrals over the unit cube only. Moving bounds become moving surfaces and a smooth factor there,
and the sides of the cube stay where they are. Infinite bounds are brought to finite ones first (`teg.analysis.tails`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.jumps import surface_terms
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import finite_place, infinite_ends, is_unbounded
from teg.errors import EstimatorError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Expr, Mul, Param, Var, Where
from teg.ir.integral import Integral, integral_over, masses_of
from teg.ir.node import Node
from teg.ir.simplify import add, mul, sub, where
from teg.ir.traverse import parameters, replace_node, substitute
from teg.passes.differentiate.reverse import gradient_of


@dataclass(frozen=True)
class Cube:
    """∫₀¹…∫₀¹ body over `variables`, the outermost first. `extent`: that of the outermost variable, before it was brought to (0, 1)."""

    variables: tuple[Var, ...]
    body: Expr
    extent: Expr = ONE

    @property
    def surfaces(self) -> list[Expr]:
        """Returns the surfaces across which the body jumps."""
        open_ones = dict.fromkeys(a.g for a in atoms_of(self.body) if a.g.free)
        return [g for g, _ in surface_terms(self.body, list(open_ones))]

    def integral(self, integrand: Expr, more: Sequence[Var] = ()) -> Expr:
        """Returns the integral of another integrand over this cube, and over (0, 1) in `more` variables."""
        return nest(integrand, [Binder(v, ZERO, ONE) for v in (*self.variables, *more)])

    def slope(self, p: Param) -> Expr:
        """Returns the derivative of the body by a parameter between the discontinuities."""
        return slope(self.body, p)


def slopes_through_nests(e: Expr, wrt: Sequence[Param], of_cube: Callable[[Cube, Sequence[Param]], Sequence[Expr]]) -> list[Expr]:
    """Returns the derivatives of a number by each parameter, from those of its integrals over unit cubes."""

    def of_nest(node: Integral, moving: Sequence[Param]) -> list[Expr]:
        totals: dict[Param, Expr] = dict.fromkeys(moving, ZERO)
        for cube in cubes_of(node):
            known = set(parameters(cube.body))
            mine = [p for p in moving if p in known]
            for p, change in zip(mine, of_cube(cube, mine), strict=True):
                totals[p] = add(totals[p], change)
        return list(totals.values())

    return slopes_of_nests(e, wrt, of_nest)


def slopes_of_nests(e: Expr, wrt: Sequence[Param], of_nest: Callable[[Integral, Sequence[Param]], Sequence[Expr]]) -> list[Expr]:
    """Returns the derivatives of a number by each parameter, from those of its outermost integrals by the parameters in them."""
    nests = outermost_integrals(e)
    names = [Param.make(f"the value of nest {k}", ()) for k in range(len(nests))]
    outside: Node = e
    for node, name in zip(nests, names, strict=True):
        outside = replace_node(outside, node, name)
    partials = gradient_of(cast(Expr, outside), [*wrt, *names]).children
    slopes = list(partials[: len(wrt)])
    for node, weight in zip(nests, partials[len(wrt) :], strict=True):
        known = set(parameters(node))
        moving = [p for p in wrt if p in known and weight is not ZERO]
        for p, change in zip(moving, of_nest(node, moving) if moving else (), strict=True):
            i = wrt.index(p)
            slopes[i] = add(slopes[i], mul(weight, change))
    for node, name in zip(nests, names, strict=True):
        slopes = [cast(Expr, replace_node(s, name, node)) for s in slopes]
    return slopes


def outermost_integrals(e: Expr) -> list[Integral]:
    """Returns the integrals of a closed program that stand in no other integral."""
    seen: dict[Node, None] = {}
    stack: list[Node] = [e]
    while stack:
        node = stack.pop()
        if node not in seen:
            seen[node] = None
            if not isinstance(node, Integral):
                stack.extend(reversed(node.children))
    return [n for n in seen if isinstance(n, Integral)]


def cubes_of(node: Integral) -> list[Cube]:
    """Returns integrals over unit cubes whose sum is the integral. Raises EstimatorError if an inner integral stands in a position that
    is not linear."""
    return [unit_cube(chain, body) for chain, body in chains_of(node).items() if body is not ZERO]


def chains_of(e: Expr) -> dict[Chain, Expr]:
    """Returns the integrand for each chain of integrals that stands in e. A sum over roots is no integral, but part of an integrand."""
    if not e.has_integral:
        return {(): e}
    found: dict[Chain, Expr] = {}
    match e:
        case Integral() if masses_of(e.body, e.var) is not None:
            return {(): e}
        case Integral() if not e.lo.has_integral and not e.hi.has_integral:
            return {(Binder(e.var, e.lo, e.hi), *chain): body for chain, body in chains_of(e.body).items()}
        case Add():
            for term in e.children:
                _collect(found, chains_of(term))
            return found
        case Mul() if sum(c.has_integral for c in e.children) == 1:
            holder = next(c for c in e.children if c.has_integral)
            others = [c for c in e.children if c is not holder]
            return {chain: mul(body, *others) for chain, body in chains_of(holder).items()}
        case Where() if not e.condition.has_integral:
            _collect(found, {chain: where(e.condition, body, ZERO) for chain, body in chains_of(e.then).items()})
            _collect(found, {chain: where(e.condition, ZERO, body) for chain, body in chains_of(e.otherwise).items()})
            return found
        case _:
            hint = 'discontinuities="exact", "differences" and "smooth" take any program'
            raise EstimatorError("an integral inside a function, a condition or a bound of another one is no integral over a box", e, hint)


def _collect(found: dict[Chain, Expr], parts: dict[Chain, Expr]) -> None:
    for chain, body in parts.items():
        found[chain] = add(found[chain], body) if chain in found else body


def unit_cube(chain: Chain, body: Expr) -> Cube:
    """Returns the integral of the body over a chain as one over the unit cube."""
    at: dict[Var, Expr] = {}
    weight: Expr = ONE
    units = tuple(Var.make(f"u{i}", ()) for i in range(len(chain)))
    for b, u in zip(chain, units, strict=True):
        lo, hi = (cast(Expr, substitute(bound, at)) for bound in (b.lo, b.hi))
        at[b.var], rate = _place(lo, hi, u)
        weight = mul(weight, rate)
    return Cube(units, mul(weight, cast(Expr, substitute(body, at))), sub(chain[0].hi, chain[0].lo) if chain else ONE)


def _place(lo: Expr, hi: Expr, u: Var) -> tuple[Expr, Expr]:
    """Returns the point of (l, h) at u in (0, 1), and its rate."""
    span = cast(Integral, integral_over(ONE, u, lo, hi))
    if isinstance(span, Integral) and is_unbounded(span):
        ends = infinite_ends(span)
        if ends[0] > 0 or ends[1] < 0:
            place, rate = _place(hi, lo, u)
            return place, mul(MINUS_ONE, rate)
        s, (first, last), place, rate = finite_place(span, [u])
        inner, extent = _place(first, last, u)
        return cast(Expr, substitute(place, {s: inner})), mul(extent, cast(Expr, substitute(rate, {s: inner})))
    extent = sub(hi, lo)
    return add(lo, mul(extent, u)), extent


MOST_VARIABLES = 3
"""The largest number of variables of a nest for estimators that need a field in them."""


def check_dimensions(cube: Cube, name: str) -> None:
    """Raises EstimatorError for a nest of more variables than an estimator takes."""
    if len(cube.variables) > MOST_VARIABLES:
        hint = 'discontinuities="differences" and "smooth" take any number'
        raise EstimatorError(f"{name!r} takes nests of up to {MOST_VARIABLES} integrals, here are {len(cube.variables)}", cube.body, hint)


def squared_slopes(g: Expr, variables: Sequence[Var]) -> tuple[list[Expr], Expr]:
    """Returns ∇g and |∇g|²."""
    slopes = [slope(g, v) for v in variables]
    return slopes, add(*(mul(s, s) for s in slopes))


def divergence(field: Sequence[Expr], variables: Sequence[Var]) -> Expr:
    """Returns ∇·V."""
    return add(*(slope(v, x) for v, x in zip(field, variables, strict=True)))


def along(e: Expr, field: Sequence[Expr], variables: Sequence[Var]) -> Expr:
    """Returns V·∇e between the discontinuities."""
    return add(*(mul(v, slope(e, x)) for v, x in zip(field, variables, strict=True)))
