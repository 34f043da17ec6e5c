"""Circles whose curvature depends on parameters, and lines where it is 0: one chart of half of a circle, and one of the other half.

    g = A·|z|² + b·z + d  about the middle of the box,       G = √(|b|² - 4Ad),  the length of the gradient on the curve
    p = -2d/(|b| + G)·n,  n = b/|b|                          the point that is nearest to the middle of the box
    w(s) = (s·τ - h·s²·n)/(1 + h²s²),  h = A/G,  τ ⊥ n       the rest of the curve from there: |h·s| <= 1 is half of a circle

    ∫∫ f δ(g)  =  ∫ f(p + w)/(G·(1 + h²s²)) ds               over both halves, or what of a larger circle can be in the box

As |w|² = s²/(1 + h²s²), another circle or line is a polynomial of degree 2 in s. Borders between keys a·|z - c|² are such curves, and are
lines where two a are equal. Source: rational parametrisation of conics (Farin 2002, chapter 12), about a point of the curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.foci import Vector, square_of
from teg.analysis.half_angle import without_denominator
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.surfaces import restrict, signed_inside
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Compare, Cond, Const, Expr, Var, const
from teg.ir.integral import integral_over
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import fresh, substitute
from teg.ir.uncovered import HALF
from teg.passes.eliminate.conic import born
from teg.passes.eliminate.marks import with_conditions_at

SMALL = 0.3
"""The least |h|, times half of the diagonal of the box, of a circle of which both halves are followed: both can be in the box from
0.25·√2 on."""
REACH = 2.0 * math.sqrt(2.0)
"""How far s is followed on a larger circle, relative to half of the diagonal: points of the box are at most two of these apart."""


@dataclass(frozen=True)
class Circle:
    """g is A·(x² + y²) and terms of degree 1 in `variables` (outermost first); A may be 0."""

    variables: tuple[Var, Var]

    moves = True
    name = "a circle or a line, by its distance from the middle of the box"


def match_circle(g: Expr, variables: Sequence[Var]) -> Circle | None:
    """Returns both variables of a circle whose curvature depends on parameters; else None."""
    mine = [v for v in variables if v in g.free]
    if len(mine) != 2 or (lead := square_of(g, (mine[0], mine[1]))) is None or isinstance(lead, Const):
        return None
    return Circle((mine[1], mine[0]))


def rewrite_circle(g: Expr, coefficient: Expr, chain: Chain, data: Circle) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as one integral for both halves of the circle, which `HALF` tells apart."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, boxes = parts
    middle = [mul(const(0.5), add(b.lo, b.hi)) for b in boxes]
    half = mul(const(0.5), call("sqrt", add(*(integer_power(sub(b.hi, b.lo), 2) for b in boxes))))
    at = dict(zip(data.variables, middle, strict=True))
    lead = cast(Expr, square_of(g, data.variables))
    level, gradient = cast(Expr, substitute(g, at)), [cast(Expr, substitute(slope(g, v), at)) for v in data.variables]
    steep = add(*(integer_power(e, 2) for e in gradient))
    place = born(g, sub(steep, mul(const(4.0), lead, level)), 1.0)
    length, steepness = place.radius, call("sqrt", steep)
    is_turned = positive(steep)  # else the middle of the box is that of the circle
    across = where(is_turned, div(gradient[0], steepness), ONE), where(is_turned, div(gradient[1], steepness), ZERO)
    away = mul(const(-2.0), div(level, add(steepness, length)))
    bend = div(lead, length)
    is_small = positive(sub(mul(call("magnitude", bend), half), const(SMALL)))
    reach = where(is_small, div(ONE, call("magnitude", bend)), mul(const(REACH), half))
    near = add(middle[0], mul(away, across[0])), add(middle[1], mul(away, across[1]))
    frame = _Frame(g, (mine[0], mine[1]), near, across, length, reach, mul(bend, reach))
    far = where(is_small, div(ONE, where(is_small, bend, ONE)), ZERO)
    there = disjunction(is_small, positive(sub(const(0.5), HALF)))
    return nest(where(conjunction(place.exists, there), frame.half(coefficient, far), ZERO), others)


@dataclass(frozen=True)
class _Frame:
    """A circle g = 0 in the integrals `binders`: a point of it, the direction across it there, the length of the gradient, how far s goes,
    and h times that."""

    g: Expr
    binders: tuple[Binder, Binder]
    near: Vector
    across: Vector
    length: Expr
    reach: Expr
    bend: Expr

    def half(self, coefficient: Expr, far: Expr) -> Expr:
        """Returns the integral over the half that `HALF` says; the other one is `far` away along the direction across."""
        u, v = (b.var for b in self.binders)
        taken = coefficient.free | self.g.free | {u, v}
        a, b, w, t = (fresh(name, taken) for name in ("along", "across", "square", "s"))
        steps = _steps(self.across, a, b)
        at = {x: add(start, step) for x, start, step in zip((u, v), self.near, steps, strict=True)}
        value = restrict(coefficient, at, self.g, (v, u))
        value = with_conditions_at(value, (at[u], at[v]), _on_circle, (*self.near, *self.across, a, b, w))
        for binder, start, step in zip(self.binders, self.near, steps, strict=True):
            lo, hi = (sub(cast(Expr, substitute(e, at)), start) for e in (binder.lo, binder.hi))
            value = signed_inside(step, lo, hi, self.g, binder, value)
        z = integer_power(add(ONE, mul(integer_power(self.bend, 2), integer_power(t, 2))), -1)
        rise, square = mul(self.reach, self.bend, integer_power(t, 2), z), mul(integer_power(mul(self.reach, t), 2), z)
        down = mul(sub(mul(const(2.0), HALF), ONE), rise)
        further = sub(square, mul(HALF, sub(mul(const(2.0), square), integer_power(far, 2))))

        def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
            polynomial = without_denominator(new, t)
            return positive(new if polynomial is None else polynomial, old.strict, resolution, old.rivals)

        on_circle = dict(zip((a, b, w), (mul(self.reach, t, z), sub(down, mul(HALF, far)), further), strict=True))
        body = cast(Expr, substitute(mul(div(self.reach, self.length), value), on_circle, algebraic))
        return integral_over(mul(z, body), t, MINUS_ONE, ONE)


def _on_circle(g: Expr, variables: Sequence[Var], at: Sequence[Var]) -> Expr:
    """Returns a function along a circle, from a point of it, the direction across, the steps along and across, and the square of the
    distance: another circle is linear in these."""
    near, across, (along, over, square) = at[:2], at[2:4], at[4:]
    steps = _steps(across, along, over)
    lead = square_of(g, (variables[0], variables[1]))
    if lead is None:
        return cast(Expr, substitute(g, {x: add(start, step) for x, start, step in zip(variables, near, steps, strict=True)}))
    start = dict(zip(variables, near, strict=True))
    rates = (cast(Expr, substitute(slope(g, x), start)) for x in variables)
    return add(cast(Expr, substitute(g, start)), *map(mul, rates, steps), mul(lead, square))


def _steps(across: Sequence[Expr], along: Expr, over: Expr) -> Vector:
    """Returns the step of both coordinates, from the steps along a curve and across it."""
    m, n = across
    return add(mul(n, along), mul(m, over)), sub(mul(n, over), mul(m, along))
