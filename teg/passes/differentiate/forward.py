"""Forward mode: the derivative along given changes of the parameters, deltas visible.

    d ∫ₗʰ F dx = ∫ₗʰ (dF)ₐₑ dx + F|ₓ₌ₕ dh - F|ₓ₌ₗ dl + Σ_g ∫ₗʰ jump_g(F)·dg·δ(g) dx        over the surfaces g that this integral owns

(dF)ₐₑ takes conditions as constant. A surface whose jump vanishes on it (a kink) has no δ. A surface of parameters only belongs to no
integral and contributes nothing. Cost: one visit a node, and one jump a surface.

A δ(g) that is still in the program is carried along with its surface. Points that move with V = -dg·∇g/|∇g|² stay on g = 0, so δ(g) is
constant in coordinates that move with them, and (Reynolds' transport theorem)

    d ∫…∫ w δ(g)  =  ∫…∫ (D w + w div V) δ(g)  +  the terms of bounds and surfaces as above,  each moving with D instead of d,   D = d + V·∇

where a bound of x moves, relative to its points, with D(bound) - Vₓ. So no chart of the surface is ever differentiated.

An integrand that is singular on surfaces that move (|x - p|^-½) is carried along in the same way, without a δ:

    d ∫…∫ w  =  ∫…∫ (D w + w div V)  +  the terms of bounds and other surfaces, each moving with D

with the V of `teg.analysis.singularities`, for which D w is as integrable as w is.
Source: Bangaru et al. 2021, section 4; Leibniz' rule for the bounds; Flanders 1973 for moving domains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping
from typing import Any, cast

from teg.analysis.calculus import by_chain_rule, slope
from teg.analysis.coincidence import ZeroSet, peeled
from teg.analysis.jumps import surface_terms
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.powers import merged_powers, raised_powers
from teg.analysis.sift import deltas_of, linear_part, without
from teg.analysis.singularities import Field, Keys, Surface, field_of, find_surfaces, on_sides, sharp_nodes
from teg.analysis.surfaces import bound_surface, open_surfaces, owned_surfaces, renamed_apart, restrict
from teg.errors import DeltaError
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import MINUS_ONE, ZERO, Add, Call, Cond, Const, Expr, Mul, Param, Pow, Tuple, Var, Where, const, is_infinite
from teg.ir.integral import Delta, Integral, delta, integral_over
from teg.ir.node import Node
from teg.ir.simplify import add, call, conjunction, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import substitute

Direction = Mapping[Any, Expr]
"""The rates of change of parameters, and of variables that are carried along."""


def tangent_of(e: Expr, direction: Direction) -> Expr:
    """Returns the directional derivative: Σ ∂e/∂p · direction[p]."""
    tangent = _tangents(e, direction)
    if isinstance(e, Tuple):
        return simplify.tuple_of(*(_with_open_surfaces(entry, tangent) for entry in e.children))
    return _with_open_surfaces(e, tangent)


def _tangents(e: Expr, direction: Direction, field: Field | None = None) -> dict[Expr, Expr]:
    """Returns the tangents of e and of its subexpressions.

    An integral with a δ in it, or with singularities that move, is carried along as a whole. The surfaces of `field` change at its
    rates.
    """
    tangent: dict[Expr, Expr] = {}
    rates: dict[Expr, Expr] = {}
    singular = Transport(e, direction)
    opened: set[Node] = set()
    stack: list[Node] = [e]
    while stack:
        node = stack.pop()
        if node in tangent:
            continue
        whole = isinstance(node, Integral) and node.has_delta
        if node not in opened and not whole:
            if isinstance(node, Integral) and (moved := singular.of(node)) is not None:
                tangent[node] = moved
                continue
            opened.add(node)
            stack.append(node)
            stack.extend(c for c in reversed(node.children) if c not in opened)
        elif isinstance(node, Expr):
            if whole:
                tangent[node] = carried(cast(Integral, node), direction)
            elif field is not None and (change := _carried_along(node, field, tangent, rates)) is not None:
                tangent[node] = change
            else:
                tangent[node] = _tangent(node, direction, tangent)
    return tangent


def _carried_along(node: Expr, field: Field, tangent: Mapping[Expr, Expr], rates: dict[Expr, Expr]) -> Expr | None:
    """Returns the tangent of a node that vanishes, or is infinite, where a surface of the field does; None for other nodes.

    Its relative rate of change is finite there, and is stored in `rates`.
    """
    rate = field.rate(node)
    if rate is None:
        base = _carrier(node, rates)
        if base is None:
            return None
        rate = _relative_rate(node, base, tangent, rates)
        if rate is None:
            return rates[base]  # a logarithm
    rates[node] = rate
    return None if isinstance(node, Mul | Where) and field.rate(node) is None else mul(node, rate)


def _carrier(node: Expr, rates: Mapping[Expr, Expr]) -> Expr | None:
    """Returns the part of a node whose zeros are zeros or poles of the node, if its relative rate is known."""
    match node:
        case Mul():
            return next((c for c in node.children if c in rates), None)
        case Where():
            return next((c for c in (node.then, node.otherwise) if c in rates), None)
        case Pow() | Call() if isinstance(node, Pow) or node.name in ("sqrt", "root", "pow", "magnitude", "log"):
            return node.children[0] if node.children[0] in rates else None  # type: ignore[return-value]
        case _:
            return None


def _relative_rate(node: Expr, base: Expr, tangent: Mapping[Expr, Expr], rates: Mapping[Expr, Expr]) -> Expr | None:
    """Returns D(node)/node; None for a logarithm, whose tangent is the rate of its argument."""

    def rate_of(e: Expr) -> Expr:
        return rates[e] if e in rates else ZERO if tangent[e] is ZERO else mul(tangent[e], integer_power(e, -1))

    match node:
        case Mul():
            return add(*(rate_of(c) for c in node.children))
        case Where():
            return where(node.condition, rate_of(node.then), rate_of(node.otherwise))
        case Pow():
            return mul(const(node.exponent), rates[base])
        case Call(name="log"):
            return None
        case Call(name="magnitude"):
            return rates[base]
        case Call(name="pow"):
            k = node.children[1]
            return add(mul(k, rates[base]), ZERO if tangent[k] is ZERO else mul(call("log", base), tangent[k]))
        case _:
            return mul(const(0.5), rates[base])


def _with_open_surfaces(e: Expr, tangent: dict[Expr, Expr]) -> Expr:
    """Returns the tangent of e with the terms of its open surfaces.

    The variables of these surfaces are free in e and belong to an outer integral, so the terms stand before that integral.
    """
    moving = [g for g in open_surfaces(e) if tangent[g] is not ZERO]
    terms = [mul(jump, tangent[g], delta(g)) for g, jump in surface_terms(e, moving)]
    return add(tangent[e], *terms)


def _tangent(node: Expr, direction: Direction, tangent: dict[Expr, Expr]) -> Expr:
    match node:
        case Param() | Var():
            return direction.get(node, ZERO)
        case Const():
            return ZERO
        case Tuple():
            return simplify.tuple_of(*(tangent[c] for c in node.children))
        case Integral():
            return _integral(node, tangent)
        case Delta():
            raise DeltaError(
                "a delta outside of the integrals over its variables cannot be differentiated", node, "use teg.eliminate first"
            )
    chained = by_chain_rule(node, tangent)
    assert chained is not None, f"unknown node {type(node).__name__}"
    return chained


def _integral(node: Integral, tangent: dict[Expr, Expr]) -> Expr:
    x, lo, hi, body = node.var, node.lo, node.hi, node.body
    terms = [integral_over(tangent[body], x, lo, hi)]
    for bound, sign in ((hi, ex.ONE), (lo, MINUS_ONE)):
        if tangent[bound] is not ZERO:
            value = restrict(body, {x: bound}, bound_surface(x, bound), (x,))
            terms.append(mul(sign, value, tangent[bound]))
    moving = [g for g in owned_surfaces(body, x) if tangent[g] is not ZERO]
    for g, jump in surface_terms(body, moving):
        terms.append(integral_over(mul(jump, tangent[g], delta(g)), x, lo, hi))
    return add(*terms)


class Transport:
    """Derivatives, along one direction, of integrals whose integrands have singularities that move.

    `by_exponent`: powers with parameters for exponents have two derivatives, of which one is not carried along (`teg.analysis.powers`).
    """

    def __init__(self, root: Expr, direction: Direction, sharp: Container[Node] | None = None, by_exponent: bool = True) -> None:
        self.direction = direction
        self._by_exponent = by_exponent
        self._root = root
        self._sharp = sharp
        self._keys = Keys()
        self._rates: dict[Expr, Expr] = {}

    def of(self, node: Integral) -> Expr | None:
        """Returns the derivative of an integral; None if there is no singularity that must be carried along."""
        if self._sharp is None:
            self._sharp = sharp_nodes([self._root])
        if node not in self._sharp:
            return None
        parts: list[tuple[Chain, Expr, list[Surface]]] = []
        for chain, weight in _integrands(node, self._sharp):
            parts += ((chain, *part) for part in self._parts(weight, chain))
        if not any(surfaces for _, _, surfaces in parts):
            return None
        terms = []
        for chain, weight, surfaces in parts:
            if surfaces:
                terms.append(_moved(chain, weight, field_of(surfaces, chain, self._keys), self.direction))
            else:
                whole = nest(weight, chain)
                terms.append(_tangents(whole, self.direction)[whole])
        raised, smooth = raised_powers(node) if self._by_exponent else (node, ex.TRUE)
        if raised is node:
            return add(*terms)
        moved = Transport(raised, self.direction, by_exponent=False).of(cast(Integral, raised))
        plain = _tangents(raised, self.direction)[raised] if moved is None else moved
        return where(smooth, merged_powers(plain), add(*terms))

    def _rate(self, g: Expr) -> Expr:
        if g not in self._rates:
            self._rates[g] = _tangents(g, self.direction)[g]
        return self._rates[g]

    def _surfaces(self, e: Expr, chain: Chain) -> list[Surface] | None:
        return find_surfaces(e, chain, self._rate, self._keys)

    def _parts(self, weight: Expr, chain: Chain) -> list[tuple[Expr, list[Surface]]]:
        """Returns summands of an integrand, and branches of it, with the surfaces of each.

        Summands with the same surfaces stay together, and so does an integrand of which a part may diverge alone.
        """
        parts: list[tuple[Expr, list[Surface]]] = []
        stack: list[tuple[Cond, Expr]] = [(ex.TRUE, weight)]
        while stack:
            condition, e = stack.pop()
            whole, surfaces = where(condition, e, ZERO), self._surfaces(e, chain)
            pieces = e.children if isinstance(e, Add) else (e.then, e.otherwise) if isinstance(e, Where) else ()
            surfaces_of = [self._surfaces(c, chain) for c in pieces] if surfaces else []
            if not surfaces or None in surfaces_of:
                parts.append((whole, surfaces or []))
                continue
            groups: dict[frozenset[object], list[Expr]] = {}
            for c, inside in zip(pieces, surfaces_of, strict=True):
                groups.setdefault(frozenset(self._keys.of(s.g) for s in inside or ()), []).append(c)
            if len(groups) < 2:
                parts.append((whole, surfaces))
            elif isinstance(e, Where):
                stack.append((conjunction(condition, negation(e.condition)), e.otherwise))
                stack.append((conjunction(condition, e.condition), e.then))
            else:
                stack.extend((condition, add(*members)) for members in groups.values())
        return [(e, surfaces) for e, surfaces in parts if e is not ZERO]


def _integrands(node: Integral, sharp: Container[Node]) -> list[tuple[Chain, Expr]]:
    """Returns a nest as a sum of nests. No integrand holds an integral with singular functions in a linear position."""
    nests: list[tuple[Chain, Expr]] = []
    stack: list[tuple[Expr, Chain, Expr]] = [(node, (), ex.ONE)]
    while stack:
        e, chain, factor = stack.pop()
        inner = [c for c in e.children if c in sharp and c.has_integral and isinstance(c, Expr)]
        if isinstance(e, Integral):
            stack.append((e.body, (*chain, Binder(e.var, e.lo, e.hi)), factor))
        elif isinstance(e, Add) and inner:
            stack.extend((c, chain, factor) for c in inner)
            stack.append((add(*(c for c in e.children if c not in inner)), chain, factor))
        elif isinstance(e, Mul) and len(inner) == 1:
            stack.append((inner[0], chain, mul(factor, *(c for c in e.children if c is not inner[0]))))
        elif isinstance(e, Where) and inner:
            stack.append((e.then, chain, mul(factor, where(e.condition, ex.ONE, ZERO))))
            stack.append((e.otherwise, chain, mul(factor, where(e.condition, ZERO, ex.ONE))))
        else:
            nests.append((chain, mul(factor, e)))
    return [(chain, weight) for chain, (weight,) in (renamed_apart(*n) for n in nests) if weight is not ZERO]


def _moved(chain: Chain, weight: Expr, field: Field, direction: Direction) -> Expr:
    """Returns d ∫…∫ weight for points that move with the singularities of the weight."""
    along = {**direction, **field.velocity}
    change = _tangents(weight, along, field)[weight]
    mine = {b.var for b in chain}
    steps = _steps(weight, field.velocity, along, lambda h: not h.free & mine or field.carries(h))
    expansion = add(*(slope(u, v) for v, u in field.velocity.items()))
    terms = [nest(add(change, *steps, mul(weight, expansion)), chain)]
    for i, b in enumerate(chain):
        for bound, sign in ((b.hi, ex.ONE), (b.lo, MINUS_ONE)):
            rate = ZERO if (b.var, bound) in field.kept else tangent_of(bound, along)
            if rate is not ZERO:
                inner = nest(mul(sign, rate, weight), chain[i + 1 :])
                terms.append(nest(restrict(inner, {b.var: bound}, bound_surface(b.var, bound), (b.var,)), chain[:i]))
    terms += (where(positive(call("magnitude", v)), ZERO, const(math.nan)) for v in on_sides(field.surfaces, chain))
    return add(*terms)


def carried(node: Integral, direction: Direction) -> Expr:
    """Returns the derivative of an outermost integral with deltas in it."""
    deltas = deltas_of(node.body)
    if node.lo.has_delta or node.hi.has_delta:
        raise DeltaError("a delta in a bound has no meaning", node)
    smooth = integral_over(without(node.body, set(deltas)), node.var, node.lo, node.hi)
    terms = [_tangents(smooth, direction)[smooth]]
    for d in deltas:
        for chain, weight in linear_part(node.body, d).items():
            whole, (coefficient, moving) = renamed_apart((Binder(node.var, node.lo, node.hi), *chain), weight, d)
            terms.append(_transported(whole, coefficient, cast(Delta, moving), direction))
    return add(*terms)


def _transported(chain: Chain, weight: Expr, d: Delta, direction: Direction) -> Expr:
    """Returns d ∫…∫ weight·δ(g) for points that move with the surface."""
    if weight.has_delta:
        raise DeltaError("a product of deltas must be eliminated before it can be differentiated again", mul(weight, d))
    g = d.g
    moving = tangent_of(g, direction)
    velocity: dict[Var, Expr] = {}
    if moving is not ZERO:
        slopes = {b.var: slope(g, b.var) for b in chain if b.var in g.free}
        speed = mul(MINUS_ONE, moving, integer_power(add(*(integer_power(s, 2) for s in slopes.values())), -1))
        velocity = {v: mul(speed, s) for v, s in slopes.items()}
    along = {**direction, **velocity}
    expansion = add(*(slope(u, v) for v, u in velocity.items()))
    change = add(_tangents(weight, along)[weight], mul(weight, expansion), *_steps(weight, velocity, along))
    apart = {h for h in deltas_of(change) if len(h.g.free | g.free) == 1}  # two points on one line meet for single parameter values only
    zeros = ZeroSet(g)
    together = {h for h in deltas_of(change) if zeros.annuls(peeled(h.g, partial=True))}  # a surface in another form moves with this one
    terms = [nest(mul(d, without(change, apart | together)), chain)]
    for i, b in enumerate(chain):
        for bound, sign in ((b.hi, ex.ONE), (b.lo, MINUS_ONE)):
            rate = sub(tangent_of(bound, along), along.get(b.var, ZERO))
            if rate is ZERO or is_infinite(bound) or not substitute(g, {b.var: bound}).free:
                continue  # nothing comes in from infinity
            inner = nest(mul(sign, rate, weight, d), chain[i + 1 :])
            terms.append(nest(restrict(inner, {b.var: bound}, bound_surface(b.var, bound), (b.var,)), chain[:i]))
    return add(*terms)


def _steps(weight: Expr, velocity: Mapping[Var, Expr], along: Direction, still: Callable[[Expr], bool] = lambda h: False) -> list[Expr]:
    """Returns the terms jump_h(w·Dh)·δ(h) of the surfaces h where the weight w jumps, or the velocity does: the velocity of a surface with
    kinks. Both may jump on one h, so the jump is that of the product. Surfaces that are `still` among the moving points have no term."""
    surfaces = dict.fromkeys(h for e in (weight, *velocity.values()) for h in open_surfaces(e) if not still(h))
    rates = {h: _tangents(h, along)[h] for h in surfaces}
    return [mul(jump, delta(h)) for h, rate in rates.items() for _, jump in surface_terms(mul(weight, rate), [h])]
