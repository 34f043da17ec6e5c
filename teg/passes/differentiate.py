"""Forward mode: the derivative along given changes of the parameters, deltas visible.

    d ∫ₗʰ F dx = ∫ₗʰ (dF)ₐₑ dx + F|ₓ₌ₕ dh - F|ₓ₌ₗ dl + Σ_g ∫ₗʰ jump_g(F)·dg·δ(g) dx        over the surfaces g that this integral owns

(dF)ₐₑ takes conditions as constant; a surface whose jump vanishes on it (a kink) has no δ; a surface of parameters only belongs to no
integral and contributes nothing. Cost: one visit a node, and one jump a surface.
Source: Bangaru et al. 2021, section 4; Leibniz' rule for the bounds.
"""

from __future__ import annotations

from collections.abc import Mapping

from teg import expr as ex
from teg.calculus import factor_cofactors, partials
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
    where,
)
from teg.integral import Delta, Integral, delta, integral_over
from teg.node import postorder
from teg.passes.jumps import surface_terms
from teg.surfaces import bound_surface, open_surfaces, owned_surfaces, restrict


def tangent_of(e: Expr, direction: Mapping[Param, Expr]) -> Expr:
    """The directional derivative: Σ ∂e/∂p · direction[p]."""
    tangent: dict[Expr, Expr] = {}
    for node in postorder([e]):
        if isinstance(node, Expr):
            tangent[node] = _tangent(node, direction, tangent)
    if isinstance(e, Tuple):
        return ex.tuple_of(*(_with_open_surfaces(entry, tangent) for entry in e.children))
    return _with_open_surfaces(e, tangent)


def _with_open_surfaces(e: Expr, tangent: dict[Expr, Expr]) -> Expr:
    """Surfaces whose variables are free in e belong to an integral that is still to come: their terms stand before it."""
    moving = [g for g in open_surfaces(e) if tangent[g] is not ZERO]
    terms = [mul(jump, tangent[g], delta(g)) for g, jump in surface_terms(e, moving)]
    return add(tangent[e], *terms)


def _tangent(node: Expr, direction: Mapping[Param, Expr], tangent: dict[Expr, Expr]) -> Expr:
    match node:
        case Param():
            return direction.get(node, ZERO)
        case Const() | Var():
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
                "a delta must be eliminated before it can be differentiated again",
                node,
                "use teg.eliminate first",
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
