"""Ellipses in two variables whose matrix depends on parameters, by angle where it is definite.

    A·u² + B·u·v + C·v²  =  (|A|·(u + B/(2A)·v)² + D·v²)·sign A,     D = (4AC - B²)/(4|A|)               (Lagrange's reduction)

u and v are affine. That gives the two squares of `teg.passes.eliminate.conic`, if 4AC > B². Else, as for a hyperbola, the curve is followed
in the charts by variable. u and v are those in whose products g is written, (x - a)·(y - b) for example; for others the coordinates about
the centre, which cancels far from the origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.critical import critical_point
from teg.analysis.nest import Binder, Chain, divided
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.surfaces import free_of
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Const, Expr, Mul, Pow, Var, const
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import substitute
from teg.passes.eliminate.conic import Conic, Matrix, Place, born, is_near, quarters_of
from teg.passes.eliminate.implicit import Implicit, rewrite_implicit

LEAST_DETERMINANT = 1e-6
"""The least 4AC - B², relative to 4AC, of a matrix that is taken for a definite one: its digits are lost by that factor."""


@dataclass(frozen=True)
class Form:
    """g is A·u² + B·u·v + C·v² + level, u and v affine in the variables: where they are 0, and their derivatives by these. `is_written`
    says that g has no other terms whatever its coefficients are: without entries it is constant, and not a line."""

    centre: Mapping[Var, Expr]
    rows: Matrix
    entries: tuple[Expr, Expr, Expr]
    level: Expr
    is_written: bool


@dataclass(frozen=True)
class ByMatrix:
    """g is quadratic in `variables` (outermost first), with coefficients that depend on parameters."""

    variables: tuple[Var, Var]

    moves = True
    name = "an ellipse, by angle where its matrix is definite"


def match_matrix(g: Expr, variables: Sequence[Var]) -> ByMatrix | None:
    """Returns both variables if g depends on two, and is quadratic in each with coefficients that depend on parameters, which may have
    the same sign; else None."""
    mine = [v for v in variables if v in g.free]
    if len(mine) != 2 or Shadow(tuple(mine)).degree(g) != 2:
        return None
    x, y = mine
    try:
        entries = slope(slope(g, x), x), slope(slope(g, x), y), slope(slope(g, y), y)
    except NotDifferentiableError:
        return None
    if any(e.free for e in entries) or all(isinstance(e, Const) for e in entries):
        return None
    signs = _sign(entries[0]) * _sign(entries[2])
    return ByMatrix((y, x)) if signs > 0.0 else None


def _sign(e: Expr) -> float:
    """Returns the sign that all terms of an expression are written with; 0 if there is none, as in a difference."""
    signs: set[bool] = set()
    for term in e.children if isinstance(e, Add) else (e,):
        numbers = [float(factor.data) for factor in (term.children if isinstance(term, Mul) else (term,)) if isinstance(factor, Const)]
        signs.add(math.prod(numbers) > 0.0)
    return 0.0 if len(signs) > 1 or e is ZERO else 1.0 if signs == {True} else -1.0


def rewrite_matrix(g: Expr, coefficient: Expr, chain: Chain, data: ByMatrix) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as integrals over four quarters of the ellipse where there is one, and by charts else."""
    charts = rewrite_implicit(g, coefficient, chain, Implicit(data.variables))
    parts = divided(chain, data.variables)
    form = None if parts is None or charts is None else form_of(g, parts[2])
    if parts is None or charts is None or form is None:
        return charts
    a, b, c = form.entries
    products = mul(const(4.0), a, c)
    determinant = sub(products, integer_power(b, 2))
    definite = positive(sub(determinant, mul(const(LEAST_DETERMINANT), products)))
    conic = Conic(data.variables, 1.0, _inverse(form, determinant))
    above = born(g, mul(MINUS_ONE, a, form.level), 1.0)
    curved = positive(add(*(call("magnitude", e) for e in form.entries))) if form.is_written else TRUE  # a row of zeros has no curve
    place = Place(form.centre, call("magnitude", form.level), above.least, conjunction(curved, above.exists))
    quarters = quarters_of(g, coefficient, chain, conic, place)
    is_one = disjunction(negation(curved), conjunction(definite, is_near(place, parts[2], conic)))
    return charts if quarters is None else where(is_one, quarters, charts)


def _inverse(form: Form, determinant: Expr) -> Matrix:
    """Returns L of Q⁻¹ = LLᵀ, by rows: numbers where the determinant is above 0."""
    ((ux, uy), (vx, vy)), (a, b, _) = form.rows, form.entries
    root, size = call("sqrt", call("magnitude", determinant)), call("sqrt", call("magnitude", a))
    long, short, turn = div(ONE, size), div(mul(const(2.0), size), root), mul(MINUS_ONE, div(mul(b, size), mul(a, root)))
    whole = sub(mul(ux, vy), mul(uy, vx))
    return (
        (div(mul(vy, long), whole), div(sub(mul(vy, turn), mul(uy, short)), whole)),
        (mul(MINUS_ONE, div(mul(vx, long), whole)), div(sub(mul(ux, short), mul(vx, turn)), whole)),
    )


def form_of(g: Expr, boxes: Sequence[Binder]) -> Form | None:
    """Returns the form of a quadratic in the two variables of a box; None if it has no centre."""
    x, y = (b.var for b in boxes)
    found = written_form(g, (x, y))
    if found is None:
        critical = critical_point(g, boxes)
        if critical is None:
            return None
        a, b, c = (mul(const(n), slope(slope(g, v), w)) for n, v, w in ((0.5, x, x), (1.0, x, y), (0.5, y, y)))
        return Form(critical.point, ((ONE, ZERO), (ZERO, ONE)), (a, b, c), critical.value, False)
    (u, v), entries, level = found
    (ux, uy), (vx, vy) = rows = (slope(u, x), slope(u, y)), (slope(v, x), slope(v, y))
    whole = sub(mul(ux, vy), mul(uy, vx))
    if is_null(whole):  # parallel lines
        return None
    s, t = (cast(Expr, substitute(e, {x: ZERO, y: ZERO})) for e in (u, v))
    centre = {x: div(sub(mul(uy, t), mul(vy, s)), whole), y: div(sub(mul(vx, s), mul(ux, t)), whole)}
    return Form(centre, rows, entries, level, True)


def written_form(g: Expr, variables: tuple[Var, Var]) -> tuple[tuple[Expr, Expr], tuple[Expr, Expr, Expr], Expr] | None:
    """Returns both affine functions in whose products a quadratic is written, the coefficients of these, and what is without variables."""
    bases: list[Expr] = []
    entries: list[list[Expr]] = [[], [], []]
    level: list[Expr] = []
    waiting: list[tuple[Expr, Expr]] = [(ONE, g)]
    while waiting:
        factor, term = waiting.pop()
        parts = cast("Sequence[Expr]", term.children if isinstance(term, Mul) else (term,))
        moving = [e for e in parts if not free_of(e, variables)]
        factor = mul(factor, *(e for e in parts if e not in moving))
        if not moving:
            level.append(factor)
            continue
        if len(moving) == 1 and isinstance(moving[0], Add):
            waiting += [(factor, e) for e in moving[0].children]
            continue
        pair = [moving[0].base] * 2 if len(moving) == 1 and isinstance(moving[0], Pow) and moving[0].exponent == 2 else moving
        if len(pair) != 2 or any(Shadow(variables).degree(e) != 1 for e in pair):
            return None
        bases += [e for e in dict.fromkeys(pair) if e not in bases]
        if len(bases) > 2:
            return None
        entries[sum(e is bases[1] for e in pair) if len(bases) > 1 else 0].append(factor)
    if len(bases) != 2:
        return None
    a, b, c = (add(*e) for e in entries)
    return (bases[0], bases[1]), (a, b, c), add(*level)
