"""Borders between keys that are distances and a number, |z - p| + v: branches of hyperbolas, and lines where two numbers are equal.

    g = K·(|z - p| - |z - q| + c),       z = p + r·e,  e = (cos θ, sin θ),  D = q - p
    r = N/(2M),  N = |D|² - c²,  M = c + e·D > 0                                            all of the branch, if N > 0; else there is none

    ∫∫ f δ(g)  =  ∫ f(p + r·e)·r·(r + c)/(|K|·M) dθ

The border with another q' about the same focus p crosses it where N·(c' + e·D') = N'·M: these conditions are linear in e, whatever the
numbers are. Polynomials of z become polynomials of e, times a power of M. In another metric, z = p + r·L⁻¹e, and the measure is that over
det L. Source: the equation of a conic about a focus (Semple and
Kneebone, Algebraic Projective Geometry, 1952).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.foci import Border, Vector, borders_of
from teg.analysis.half_angle import MAX_DEGREE, cleared, in_half_angle
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.surfaces import ordered, restrict, signed_inside
from teg.ir.cells import replaced
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Compare, Cond, Expr, Var, const
from teg.ir.integral import integral_over
from teg.ir.simplify import add, call, disjunction, div, mul, positive, sub, where
from teg.ir.traverse import fresh, substitute
from teg.ir.uncovered import SHIFT, TURN, marks_of
from teg.passes.eliminate.conic import EIGHTH, QUARTERS, turned
from teg.passes.eliminate.marks import with_conditions_at

TWO = const(2.0)
ASKEW = const(math.cos(0.31)), const(math.sin(0.31))
"""How quarters of directions are turned: in their middles and at their ends a distance may have a kink along an axis."""


@dataclass(frozen=True)
class Focal:
    """g is K·(|z - p| - |z - q| + c) in `variables` (outermost first)."""

    variables: tuple[Var, Var]

    moves = True
    name = "a branch of a hyperbola, by angle about a focus"


def match_focal(g: Expr, variables: Sequence[Var]) -> Focal | None:
    """Returns both variables of a border between two distances and a number; else None."""
    mine = [v for v in variables if v in g.free]
    return Focal((mine[1], mine[0])) if len(mine) == 2 and borders_of(g, (mine[1], mine[0])) else None


def rewrite_focal(g: Expr, coefficient: Expr, chain: Chain, data: Focal) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as integrals over four quarters of all directions, of which `TURN` is one."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, _ = parts
    (unmoved,) = replaced([g], {SHIFT: ZERO})  # as the borders around it
    border = _about_common_focus(cast("tuple[Border, Border]", borders_of(unmoved, data.variables)), coefficient)
    curve = _Curve(g, coefficient, (mine[0], mine[1]), border)
    turns = [TURN] if marks_of(coefficient) else QUARTERS
    return nest(where(positive(border.opened), add(*map(curve.quarter, turns)), ZERO), others)


def _about_common_focus(borders: tuple[Border, Border], coefficient: Expr) -> Border:
    """Returns the border about that focus which all borders have by which others may cover it."""
    for mark in marks_of(coefficient):
        common = mark.children[2:]
        for border in borders:
            if common and all(is_null(sub(mine, focus)) for mine, focus in zip(border.focus, common, strict=True)):
                return border
    return borders[0]


@dataclass(frozen=True)
class _Curve:
    """A branch g = 0 with the coefficient of its δ, in the integrals `binders`."""

    g: Expr
    coefficient: Expr
    binders: tuple[Binder, Binder]
    border: Border

    def quarter(self, turn: Vector) -> Expr:
        """Returns the integral over the quarter of directions around the angle whose cosine and sine are given."""
        u, v = (b.var for b in self.binders)
        taken = self.coefficient.free | self.g.free | {u, v}
        angle, c, s, r = (fresh(name, taken) for name in ("θ", "cos θ", "sin θ", "r"))
        e = turned(turned((c, s), turn), ASKEW)
        opened, ahead = self.border.opened, self.border.ahead(e)
        way = self.border.back(e)
        steps = mul(r, way[0]), mul(r, way[1])
        at = {x: add(p, step) for x, p, step in zip((u, v), self.border.focus, steps, strict=True)}
        value = restrict(self.coefficient, at, self.g, (v, u))
        value = with_conditions_at(value, (at[u], at[v]), _on_border, (*self.border.focus, *e, *way, opened, ahead))
        for b, p, step in zip(self.binders, self.border.focus, steps, strict=True):
            lo, hi = (sub(cast(Expr, substitute(bound, at)), p) for bound in (b.lo, b.hi))
            value = signed_inside(step, lo, hi, self.g, b, value)
        if not all(ordered(b.lo, b.hi) for b in self.binders):  # else the other branch, where r < 0, is between no bounds
            value = where(positive(ahead), value, ZERO)
        half = call("tan", mul(const(0.5), angle))

        def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
            product = _cleared(old.g, r, opened, mul(TWO, ahead))
            polynomial = None if product is None else in_half_angle(product, c, s, half)
            return positive(new if polynomial is None else polynomial, old.strict, resolution, old.rivals)

        circle: dict[Var, Expr] = {c: call("cos", angle), s: call("sin", angle)}
        there = cast(Expr, substitute(ahead, circle))
        radius = div(opened, mul(TWO, there))
        scale = mul(call("magnitude", self.border.scale), self.border.stretch)
        weight = div(mul(radius, add(radius, self.border.shift)), mul(scale, there))
        body = mul(weight, cast(Expr, substitute(value, {**circle, r: radius}, algebraic)))
        return integral_over(body, angle, const(-EIGHTH), const(EIGHTH))


def _on_border(g: Expr, variables: Sequence[Var], at: Sequence[Var]) -> Expr:
    """Returns a function on a border, as one of the direction from its focus: times a power of M if it is a polynomial, and linear if it is
    a border about the same focus. `variables` are those of the place, then those of a focus that all share; `at` has p, e, L⁻¹e, N and
    M."""
    (u, v, *common), (focus, e, way, (opened, ahead)) = variables, (at[:2], at[2:4], at[4:6], at[6:])
    for other in borders_of(g, (u, v)) or ():
        if common and all(is_null(sub(mine, one)) for mine, one in zip(other.focus, common, strict=True)):
            crossing = sub(mul(opened, other.ahead((e[0], e[1]))), mul(other.opened, ahead))
            meets = disjunction(positive(other.opened), positive(other.shift))  # else |z - q'| - c' is the larger one everywhere
            return mul(other.scale, add(mul(where(meets, ONE, ZERO), crossing), where(meets, ZERO, MINUS_ONE)))
    r = fresh("r", [*variables, *at])
    moved = cast(Expr, substitute(g, {x: add(p, mul(r, step)) for x, p, step in zip((u, v), focus, way, strict=True)}))
    product = _cleared(moved, r, opened, mul(TWO, ahead))
    return cast(Expr, substitute(moved, {r: div(opened, mul(TWO, ahead))})) if product is None else product


def _cleared(g: Expr, r: Var, opened: Expr, whole: Expr) -> Expr | None:
    """Returns g(opened/whole)·wholeⁿ for a polynomial of r of degree n; None for other functions."""
    degree = Shadow((r,)).degree(g)
    if degree is None or degree > MAX_DEGREE:
        return None
    z = fresh("z", g.free | {r})
    return cleared(cast(Expr, substitute(g, {r: mul(opened, z)})), z, whole, degree)
