"""Forward mode: the derivative along given changes of the parameters, deltas visible.

    d ∫ₗʰ F dx = ∫ₗʰ (dF)ₐₑ dx + F|ₓ₌ₕ dh - F|ₓ₌ₗ dl + Σ_g ∫ₗʰ jump_g(F)·dg·δ(g) dx        over the surfaces g that this integral owns

(dF)ₐₑ takes conditions as constant; a surface whose jump vanishes on it (a kink) has no δ; a surface of parameters only belongs to no
integral and contributes nothing. Cost: one visit a node, and one jump a surface.

A δ(g) that is still in the program is carried along with its surface. Points that move with V = -dg·∇g/|∇g|² stay on g = 0, so in the
coordinates they move in δ(g) is constant, and (Reynolds' transport theorem)

    d ∫…∫ w δ(g)  =  ∫…∫ (D w + w div V) δ(g)  +  the terms of bounds and surfaces as above,  each moving with D instead of d,   D = d + V·∇

where a bound of x moves, relative to its points, with D(bound) - Vₓ. So no chart of the surface is ever differentiated.
Source: Bangaru et al. 2021, section 4; Leibniz' rule for the bounds; Flanders 1973 for moving domains.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from teg import expr as ex
from teg.calculus import factor_cofactors, partials, slope
from teg.coincidence import ZeroSet, peeled
from teg.errors import DeltaError
from teg.expr import (
    MINUS_ONE,
    ZERO,
    Add,
    Call,
    Const,
    Expr,
    Mul,
    Param,
    Pow,
    Tuple,
    Var,
    Where,
    add,
    const,
    integer_power,
    mul,
    sub,
    where,
)
from teg.integral import Delta, Integral, delta, integral_over
from teg.nest import Binder, Chain, nest
from teg.node import Node
from teg.passes.jumps import surface_terms
from teg.passes.sift import deltas_of, linear_part, without
from teg.surfaces import bound_surface, open_surfaces, owned_surfaces, restrict
from teg.traverse import substitute

Direction = Mapping[Any, Expr]
"""How parameters, and variables that are carried along, change."""


def tangent_of(e: Expr, direction: Direction) -> Expr:
    """The directional derivative: Σ ∂e/∂p · direction[p]."""
    tangent = _tangents(e, direction)
    if isinstance(e, Tuple):
        return ex.tuple_of(*(_with_open_surfaces(entry, tangent) for entry in e.children))
    return _with_open_surfaces(e, tangent)


def _tangents(e: Expr, direction: Direction) -> dict[Expr, Expr]:
    """The tangents of e and of what it is made of; an integral with a δ in it is carried along as a whole."""
    tangent: dict[Expr, Expr] = {}
    opened: set[Node] = set()
    stack: list[Node] = [e]
    while stack:
        node = stack.pop()
        if node in tangent:
            continue
        whole = isinstance(node, Integral) and node.has_delta
        if node not in opened and not whole:
            opened.add(node)
            stack.append(node)
            stack.extend(c for c in reversed(node.children) if c not in opened)
        elif isinstance(node, Expr):
            tangent[node] = carried(cast(Integral, node), direction) if whole else _tangent(node, direction, tangent)
    return tangent


def _with_open_surfaces(e: Expr, tangent: dict[Expr, Expr]) -> Expr:
    """Surfaces whose variables are free in e belong to an integral that is still to come: their terms stand before it."""
    moving = [g for g in open_surfaces(e) if tangent[g] is not ZERO]
    terms = [mul(jump, tangent[g], delta(g)) for g, jump in surface_terms(e, moving)]
    return add(tangent[e], *terms)


def _tangent(node: Expr, direction: Direction, tangent: dict[Expr, Expr]) -> Expr:
    match node:
        case Param() | Var():
            return direction.get(node, ZERO)
        case Const():
            return ZERO
        case Add():
            return add(*(tangent[c] for c in node.children))
        case Mul():
            moving = [c for c in node.children if tangent[c] is not ZERO]
            if not moving:
                return ZERO
            return add(*(mul(tangent[c], rest) for c, rest in zip(node.children, factor_cofactors(node), strict=True)))
        case Pow():
            t = tangent[node.base]
            return ZERO if t is ZERO else mul(const(node.exponent), t, integer_power(node.base, node.exponent - 1))
        case Call():
            if all(tangent[c] is ZERO for c in node.children):
                return ZERO
            return add(*(mul(tangent[c], p) for c, p in zip(node.children, partials(node), strict=True) if tangent[c] is not ZERO))
        case Where():
            return where(node.condition, tangent[node.then], tangent[node.otherwise])
        case Tuple():
            return ex.tuple_of(*(tangent[c] for c in node.children))
        case Integral():
            return _integral(node, tangent)
        case Delta():
            raise DeltaError(
                "a delta outside of the integrals over its variables cannot be differentiated", node, "use teg.eliminate first"
            )
        case _:
            raise AssertionError(f"unknown node {type(node).__name__}")


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


def carried(node: Integral, direction: Direction) -> Expr:
    """The derivative of an integral with deltas in it, outermost."""
    deltas = deltas_of(node.body)
    if node.lo.has_delta or node.hi.has_delta:
        raise DeltaError("a delta in a bound has no meaning", node)
    rest = integral_over(without(node.body, set(deltas)), node.var, node.lo, node.hi)
    terms = [_tangents(rest, direction)[rest]]
    for d in deltas:
        for chain, weight in linear_part(node.body, d).items():
            terms.append(_transported((Binder(node.var, node.lo, node.hi), *chain), weight, d, direction))
    return add(*terms)


def _transported(chain: Chain, weight: Expr, d: Delta, direction: Direction) -> Expr:
    """d ∫…∫ weight·δ(g), the points moving with the surface."""
    if weight.has_delta:
        raise DeltaError("a product of deltas must be eliminated before it can be differentiated again", mul(weight, d))
    g = d.g
    moving = tangent_of(g, direction)
    along = dict(direction)
    expansion: Expr = ZERO
    if moving is not ZERO:
        slopes = {b.var: slope(g, b.var) for b in chain if b.var in g.free}
        speed = mul(MINUS_ONE, moving, integer_power(add(*(integer_power(s, 2) for s in slopes.values())), -1))
        velocity = {v: mul(speed, s) for v, s in slopes.items()}
        along.update(velocity)
        expansion = add(*(_divergence(u, v) for v, u in velocity.items()))
    change = add(tangent_of(weight, along), mul(weight, expansion))
    apart = {h for h in deltas_of(change) if len(h.g.free | g.free) == 1}  # two points of one line meet for single parameter values only
    zeros = ZeroSet(g)
    together = {h for h in deltas_of(change) if zeros.annuls(peeled(h.g, partial=True))}  # a surface in another form moves with this one
    terms = [nest(mul(d, without(change, apart | together)), chain)]
    for i, b in enumerate(chain):
        for bound, sign in ((b.hi, ex.ONE), (b.lo, MINUS_ONE)):
            rate = sub(tangent_of(bound, along), along.get(b.var, ZERO))
            if rate is ZERO or not substitute(g, {b.var: bound}).free:
                continue
            inner = nest(mul(sign, rate, weight, d), chain[i + 1 :])
            terms.append(nest(restrict(inner, {b.var: bound}, bound_surface(b.var, bound), (b.var,)), chain[:i]))
    return add(*terms)


def _divergence(u: Expr, v: Var) -> Expr:
    """∂u/∂v with the jumps of u: a surface with kinks has a velocity that jumps there."""
    jumps = (mul(jump, slope(h, v), delta(h)) for h, jump in surface_terms(u, [h for h in open_surfaces(u) if v in h.free]))
    return add(slope(u, v), *jumps)
