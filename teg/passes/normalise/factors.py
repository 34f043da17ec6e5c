"""Factors of a surface: the sign of a product, and factors whose signs are not known."""

from __future__ import annotations

import math
from itertools import product
from typing import cast

from teg.analysis.calculus import SMOOTH
from teg.analysis.coincidence import short_form
from teg.analysis.extents import extent
from teg.analysis.limits import is_square
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Where, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, conjunction, disjunction, mul, positive
from teg.ir.traverse import rewrite

MOST_FACTORS = 4
"""The largest number of factors with variables of which a product is taken apart: four have eight cases."""


def with_single_factors(condition: Cond) -> Cond:
    """Returns an equivalent condition in which the signs of factors stand for that of a product: (x - a)·(y - b) > 0 holds where x > a and
    y > b, or x < a and y < b."""

    def visit(_: Node, new: Node) -> Node:
        if not isinstance(new, Compare) or not new.free or new.resolution is not None:
            return new
        sign, known = signed_factors(new.g)
        factors = [f for f in known if f.free]
        if not 2 <= len(factors) <= MOST_FACTORS or len(set(factors)) < len(factors) or any(isinstance(f, Where) for f in factors):
            return new
        fixed = mul(const(sign), *(f for f in known if not f.free))
        cases: list[Cond] = []
        for signs in product((1.0, -1.0), repeat=len(factors)):
            if math.prod(signs) > 0.0:
                first, *rest = (mul(const(sign), f) for sign, f in zip(signs, factors, strict=True))
                cases.append(conjunction(*(positive(f, new.strict) for f in (mul(fixed, first), *rest))))
        return disjunction(*cases)

    return cast(Cond, rewrite([condition], visit)[condition])


def signed_factors(g: Expr) -> tuple[float, list[Expr]]:
    """Returns the sign of g as a number and factors of unknown sign. A common factor of all terms of a sum is taken out."""
    sign = 1.0
    factors: list[Expr] = []
    stack = [g]
    while stack:
        e = stack.pop()
        if isinstance(e, Const):
            sign *= (e.data > 0) - (e.data < 0) if e.data == e.data else e.data
            if sign != sign:
                return 1.0, [e]
        elif isinstance(e, Mul):
            stack.extend(reversed(e.children))
        elif isinstance(e, Pow) and e.exponent < 0 and not e.free and (e.exponent % 2 == 0 or extent(e.base, {})[0] >= 0.0):
            continue  # no sign where it is finite
        elif isinstance(e, Pow) and e.exponent % 2:
            stack.append(e.base)
        elif isinstance(e, Add) and _is_sum_of_squares(e):
            continue
        elif isinstance(e, Add):
            common, cofactor = common_factors(e)
            short = e if common else short_form(e)
            if common:
                stack.extend(common)
                stack.append(cofactor)
            elif short is not e:
                stack.append(short)
            else:
                factors.append(e)
        elif isinstance(e, Call) and e.name == "magnitude" and e.free:
            continue  # positive as well
        elif isinstance(e, Call) and e.name in ("atan", "tanh", "sinh", "erf", "expm1") and e.free:
            stack.append(e.children[0])  # has its sign
        elif isinstance(e, Call) and e.name in ("sqrt", "root", "pow") and e.free:
            under = e.children[0]
            stack.append(under)  # the same zeros, with a slope
            if e.name == "pow" or not (isinstance(under, Add) and _is_sum_of_squares(under)):
                factors.append(add(ex.ONE, e))  # no zeros, but NaN where it is undefined
        elif isinstance(e, Pow) and e.free:
            continue  # an even power is positive except where it is 0, a set of measure 0
        elif not _is_positive(e):
            factors.append(e)
    return sign, factors


def without_squares(surfaces: list[tuple[Expr, bool]], sign: float, parameters_too: bool = False) -> tuple[list[tuple[Expr, bool]], float]:
    """Returns the surfaces of a product without those that stand twice, whose signs cancel, and the sign that is left.

    A factor without variables may be 0 everywhere, and stays, but for denominators.
    """
    kept: list[tuple[Expr, bool]] = []
    for surface, same in surfaces:
        twin = next((s for s in kept if s[0] is surface), None) if surface.free or parameters_too else None
        if twin is None:
            kept.append((surface, same))
        else:
            kept.remove(twin)
            sign = sign if twin[1] == same else -sign
    return kept, sign


def _is_sum_of_squares(e: Add) -> bool:
    """Returns whether a sum is written as one that is positive everywhere: squares and a positive number."""

    def is_positive(term: Expr) -> bool:
        factors = term.children if isinstance(term, Mul) else (term,)
        return all((isinstance(f, Const) and f.data > 0.0) or is_square(f) or _is_positive(f) for f in factors)

    positive_terms = any(isinstance(t, Const) or _is_positive(t) for t in e.children) and all(map(is_positive, e.children))
    return positive_terms and not any(isinstance(n, Call) and n.name not in SMOOTH for n in postorder([e]))  # these may be NaN


def _is_positive(e: Expr) -> bool:
    return isinstance(e, Call) and e.name in ("exp", "cosh", "erfc")


def common_factors(e: Add) -> tuple[list[Expr], Expr]:
    """Returns the common factors of all terms, and the sum without them: a·t - a·x = a·(t - x)."""
    terms = [_over_factors(t) for t in e.children]
    powers = [_factor_powers(t) for t in terms]
    shared = {f: min(p.get(f, 0) for p in powers) for f in powers[0]}
    shared = {
        f: k for f, k in shared.items() if k > 0 and not isinstance(f, Where)
    }  # 1/where is distributed over the branches, so it is no factor
    if not shared:
        return [], e
    divisor = mul(*(simplify.integer_power(f, -k) for f, k in shared.items()))
    return [simplify.integer_power(f, k) for f, k in shared.items()], add(*(mul(t, divisor) for t in terms))


def _factor_powers(term: Expr) -> dict[Expr, int]:
    parts = term.children if isinstance(term, Mul) else (term,)
    return {(p.base if isinstance(p, Pow) else p): (p.exponent if isinstance(p, Pow) else 1) for p in parts if not isinstance(p, Const)}


def _over_factors(term: Expr) -> Expr:
    """Returns a term with powers of products written as products of powers."""
    parts = term.children if isinstance(term, Mul) else (term,)
    if not any(isinstance(p, Pow) and isinstance(p.base, Mul) for p in parts):
        return term
    split = (
        [simplify.integer_power(c, p.exponent) for c in p.base.children] if isinstance(p, Pow) and isinstance(p.base, Mul) else [p]
        for p in parts
    )
    return mul(*(f for factors in split for f in factors))
