"""Conditions on an increasing function of variables and a number, by the function's inverse.

    √u < c     ⇔  c > 0 and u < c²          for u >= 0
    uᵏ < c     ⇔  c > 0 and u < c^(1/k)     for u >= 0, k > 0
    exp u < c  ⇔  c > 0 and u < log c
    log u < c  ⇔  u < exp c                 for u >= 0
    a·exp u > b·exp v  ⇔  u - v > log(b/a)  for a, b > 0

A distance below a radius is a disk then, and the level of a Gaussian is an ellipse: surfaces with formulas, where √u - c has none.
`c` has parameters only, so that its own sign is no surface; u has no functions of variables but sizes.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

from teg.analysis.extents import extent
from teg.analysis.roots import tidy
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, Add, Call, Cond, Const, Expr, Mul, Pow, const
from teg.ir.node import postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where

_LEAST, _MOST = const(1e-307), const(700.0)
"""A level of an exponential or a power, and of a logarithm, beyond which levels do not move: their slopes are finite numbers."""
MOST_TERMS = 16
"""The largest number of terms of a sum of two exponentials."""


class Threshold(NamedTuple):
    """f(u) > c is u > `level` where `counts` holds, and always elsewhere; f(u) < c is u < `level` where it holds, and never elsewhere.
    `rising` says whether f(u) - c has the sign of the surface."""

    u: Expr
    level: Expr
    counts: Cond
    rising: bool


def without_threshold(g: Expr) -> tuple[Cond, Expr, Cond] | None:
    """Returns (b, u, c) with g > 0 ⇔ b or (c and u > 0), where u is a surface without the function of a threshold; None for others."""
    t = threshold(g)
    if t is None:
        return None
    beyond = add(t.u, mul(MINUS_ONE, t.level))
    if t.rising:
        return negation(t.counts), beyond, TRUE
    return FALSE, mul(MINUS_ONE, beyond), t.counts


def threshold(g: Expr) -> Threshold | None:
    """Returns the threshold of a surface, if it is one."""
    fixed: list[Expr] = []
    factor, term = 1.0, g
    while isinstance(term, Add | Mul):
        varying = [c for c in term.children if c.free]
        others = [c for c in term.children if not c.free]
        if len(varying) != 1 or (isinstance(term, Mul) and not all(isinstance(c, Const) for c in others)):
            return None
        if isinstance(term, Mul):
            factor *= math.prod(cast(float, c.data) for c in others)
        else:
            fixed += [mul(const(factor), c) for c in others]
        term = varying[0]
    if not fixed or not isinstance(term, Call) or factor == 0.0:
        return None
    f = term
    if len(f.free) < 2 or any(isinstance(n, Call) and n.free and n.name != "magnitude" for n in postorder(f.children)):
        return None  # in one variable there is a formula as it is; else the inverse is no polynomial either
    c = div(mul(MINUS_ONE, add(*fixed)), const(factor))
    found = _inverse(f, c)
    return None if found is None else Threshold(f.children[0], *found, factor > 0.0)


def between_exponentials(g: Expr, strict: bool) -> Cond | None:
    """Returns the condition a·exp(u) + b·exp(v) > 0, or >= 0 if it is not `strict`, by the difference u - v, as which of two densities is
    larger; None for others.

    a and b have parameters only; where they have one sign, the condition is that of their signs.
    """
    if not isinstance(g, Add) or len(g.children) > MOST_TERMS:
        return None
    coefficients: dict[Expr, list[Expr]] = {}
    for term in g.children:
        parts = _exponential(term)
        if parts is None:
            return None
        coefficients.setdefault(parts[1], []).append(parts[0])
    exponents = list(coefficients)
    if len(exponents) != 2 or not all(u.free for u in exponents):
        return None
    (u, v), (a, b) = exponents, (add(*coefficients[exponent]) for exponent in exponents)
    up, down = conjunction(positive(a), positive(mul(MINUS_ONE, b))), conjunction(positive(mul(MINUS_ONE, a)), positive(b))
    always = conjunction(positive(a, strict=False), positive(b, strict=False), disjunction(positive(a), positive(b)) if strict else TRUE)
    level = call("log", where(disjunction(up, down), mul(MINUS_ONE, div(b, a)), ONE))
    beyond = add(tidy(sub(u, v)), mul(MINUS_ONE, level))
    return disjunction(always, conjunction(up, positive(beyond, strict)), conjunction(down, positive(mul(MINUS_ONE, beyond), strict)))


def _exponential(term: Expr) -> tuple[Expr, Expr] | None:
    """Returns c and u of a term c·exp(u), where c has parameters only; None for others."""
    factors: list[Expr] = []
    exponents: list[Expr] = []
    for f in term.children if isinstance(term, Mul) else (term,):
        base, k = (f.base, f.exponent) if isinstance(f, Pow) else (f, 1)
        if not f.free:
            factors.append(f)
        elif isinstance(base, Call) and base.name == "exp":
            exponents.append(mul(const(k), base.children[0]))
        else:
            return None
    return mul(*factors), add(*exponents)


def _inverse(f: Call, c: Expr) -> tuple[Expr, Cond] | None:
    """Returns the u with f(u) = c, and the condition under which there is one; elsewhere u is some number."""
    counts, above = positive(c), call("max", c, _LEAST)
    if f.name == "exp":
        return call("log", above), counts
    power = f.children[1] if f.name == "pow" else const(0.5)
    usual = f.name in ("sqrt", "log") or (f.name == "pow" and isinstance(power, Const) and power.data > 0.0)
    if not usual or extent(f.children[0], {})[0] < 0.0:
        return None
    if f.name == "log":
        return call("exp", call("min", c, _MOST)), TRUE
    if f.name == "sqrt":
        return integer_power(c, 2), counts
    return call("pow", above, const(1.0 / cast(Const, power).data)), counts
