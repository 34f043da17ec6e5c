"""Borders between keys that are distances and a number, |z - p| + v: branches of hyperbolas, and lines where two numbers are equal.

    g = K·(|z - p| - |z - q| + c),       z = p + r·e,  e = (cos θ, sin θ),  D = q - p
    r = N/(2M),  N = |D|² - c²,  M = c + e·D > 0                                            all of the branch, if N > 0; else there is none

    ∫∫ f δ(g)  =  ∫ f(p + r·e)·r·(r + c)/(|K|·M) dθ

The border with another q' about the same focus p crosses it where N·(c' + e·D') = N'·M: these conditions are linear in e, whatever the
numbers are. Polynomials of z become polynomials of e, times a power of M. Source: the equation of a conic about a focus (Semple and
Kneebone, Algebraic Projective Geometry, 1952).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.half_angle import MAX_DEGREE, in_half_angle
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.radicals import radical
from teg.analysis.surfaces import atoms_of, ordered, restrict, signed_inside
from teg.ir.cells import replaced
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Compare, Cond, Expr, Var, const
from teg.ir.function import Slot
from teg.ir.integral import integral_over
from teg.ir.simplify import add, call, disjunction, div, integer_power, mul, positive, sub, where
from teg.ir.traverse import fresh, substitute
from teg.ir.uncovered import SHIFT, TURN, marks_of
from teg.passes.eliminate.circle import square_of
from teg.passes.eliminate.conic import EIGHTH, QUARTERS
from teg.passes.eliminate.marks import with_conditions_at

TWO = const(2.0)
Vector = tuple[Expr, Expr]


@dataclass(frozen=True)
class Focal:
    """g is K·(|z - p| - |z - q| + c) in `variables` (outermost first)."""

    variables: tuple[Var, Var]

    moves = True
    name = "a branch of a hyperbola, by angle about a focus"


class _Branch(NamedTuple):
    """K·(|z - p| - |z - q| + c): `scale` is K, `focus` p, `apart` q - p, and `shift` c."""

    scale: Expr
    focus: Vector
    apart: Vector
    shift: Expr

    @property
    def opened(self) -> Expr:
        """Returns N, which is positive if neither distance is everywhere the larger one."""
        return sub(_dot(self.apart, self.apart), integer_power(self.shift, 2))

    def ahead(self, direction: Vector) -> Expr:
        """Returns M, which is positive where a ray from the focus meets the branch."""
        return add(self.shift, _dot(direction, self.apart))


def match_focal(g: Expr, variables: Sequence[Var]) -> Focal | None:
    """Returns both variables of a border between two distances and a number; else None."""
    mine = [v for v in variables if v in g.free]
    return Focal((mine[1], mine[0])) if len(mine) == 2 and _branches_of(g, (mine[1], mine[0])) else None


def _branches_of(g: Expr, variables: tuple[Var, Var]) -> tuple[_Branch, _Branch] | None:
    """Returns a border about either focus; None for other functions."""
    found = radical(g)
    if found is None or len(found.roots) != 2 or found.rest.free:
        return None
    (k, u), (j, w) = found.roots
    lead, other = square_of(u, variables), square_of(w, variables)
    if lead is None or other is None or not (is_null(add(k, j)) and is_null(sub(lead, other))):
        return None
    origin = dict.fromkeys(variables, ZERO)
    foci: list[Vector] = []
    for under in (u, w):
        a, b = (div(cast(Expr, substitute(slope(under, x), origin)), mul(const(-2.0), lead)) for x in variables)
        if not is_null(cast(Expr, substitute(under, dict(zip(variables, (a, b), strict=True))))):
            return None
        foci.append((a, b))
    scale = mul(k, call("sqrt", lead))
    p, q = foci
    apart = sub(q[0], p[0]), sub(q[1], p[1])
    shift = div(found.rest, scale)
    back = cast(Vector, tuple(mul(MINUS_ONE, e) for e in apart))
    return _Branch(scale, p, apart, shift), _Branch(mul(MINUS_ONE, scale), q, back, mul(MINUS_ONE, shift))


def rewrite_focal(g: Expr, coefficient: Expr, chain: Chain, data: Focal) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as integrals over four quarters of all directions, of which `TURN` is one."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, _ = parts
    (unmoved,) = replaced([g], {SHIFT: ZERO})  # as the borders around it
    branch = _about_common_focus(cast("tuple[_Branch, _Branch]", _branches_of(unmoved, data.variables)), coefficient)
    curve = _Curve(g, coefficient, (mine[0], mine[1]), branch)
    turns = [TURN] if marks_of(coefficient) else QUARTERS
    return nest(where(positive(branch.opened), add(*map(curve.quarter, turns)), ZERO), others)


def _about_common_focus(branches: tuple[_Branch, _Branch], coefficient: Expr) -> _Branch:
    """Returns the border about the focus that more of the borders have by which others may cover it."""
    counts = dict.fromkeys(branches, 0)
    for mark in marks_of(coefficient):
        around, names = cast(Slot, mark.callee).data[4]
        for atom in atoms_of(around.condition):
            others = _branches_of(atom.g, names) if len(names) == 2 else None
            foci = [other.focus for other in others or ()]
            for branch in branches:
                counts[branch] += branch.focus in foci
    return max(branches, key=counts.__getitem__)


@dataclass(frozen=True)
class _Curve:
    """A branch g = 0 with the coefficient of its δ, in the integrals `binders`."""

    g: Expr
    coefficient: Expr
    binders: tuple[Binder, Binder]
    branch: _Branch

    def quarter(self, turn: Vector) -> Expr:
        """Returns the integral over the quarter of directions around the angle whose cosine and sine are given."""
        u, v = (b.var for b in self.binders)
        taken = self.coefficient.free | self.g.free | {u, v}
        angle, c, s, r = (fresh(name, taken) for name in ("θ", "cos θ", "sin θ", "r"))
        e = sub(mul(turn[0], c), mul(turn[1], s)), add(mul(turn[1], c), mul(turn[0], s))
        opened, ahead = self.branch.opened, self.branch.ahead(e)
        steps = mul(r, e[0]), mul(r, e[1])
        at = {x: add(p, step) for x, p, step in zip((u, v), self.branch.focus, steps, strict=True)}
        value = restrict(self.coefficient, at, self.g, (v, u))
        value = with_conditions_at(value, (at[u], at[v]), partial(_on_branch, self.branch), e)
        for b, p, step in zip(self.binders, self.branch.focus, steps, strict=True):
            lo, hi = (sub(cast(Expr, substitute(bound, at)), p) for bound in (b.lo, b.hi))
            value = signed_inside(step, lo, hi, self.g, b, value)
        if not all(ordered(b.lo, b.hi) for b in self.binders):  # else the other branch, where r < 0, is between no bounds
            value = where(positive(ahead), value, ZERO)
        half = call("tan", mul(const(0.5), angle))

        def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
            cleared = _cleared(old.g, r, opened, mul(TWO, ahead))
            polynomial = None if cleared is None else in_half_angle(cleared, c, s, half)
            return positive(new if polynomial is None else polynomial, old.strict, resolution, old.rivals)

        circle: dict[Var, Expr] = {c: call("cos", angle), s: call("sin", angle)}
        there = cast(Expr, substitute(ahead, circle))
        radius = div(opened, mul(TWO, there))
        weight = div(mul(radius, add(radius, self.branch.shift)), mul(call("magnitude", self.branch.scale), there))
        body = mul(weight, cast(Expr, substitute(value, {**circle, r: radius}, algebraic)))
        return integral_over(body, angle, const(-EIGHTH), const(EIGHTH))


def _on_branch(branch: _Branch, g: Expr, variables: Sequence[Var], direction: Sequence[Var]) -> Expr:
    """Returns a function on a branch, as one of the direction from its focus: times a power of M if it is a polynomial, and linear if it is
    a border about the same focus."""
    e = direction[0], direction[1]
    opened, ahead = branch.opened, branch.ahead(e)
    for other in _branches_of(g, (variables[0], variables[1])) or ():
        if other.focus == branch.focus:
            crossing = sub(mul(opened, other.ahead(e)), mul(other.opened, ahead))
            meets = disjunction(positive(other.opened), positive(other.shift))  # else |z - q'| - c' is the larger one everywhere
            return mul(other.scale, add(mul(where(meets, ONE, ZERO), crossing), where(meets, ZERO, MINUS_ONE)))
    r = fresh("r", [*variables, *direction])
    moved = cast(Expr, substitute(g, {x: add(p, mul(r, step)) for x, p, step in zip(variables, branch.focus, e, strict=True)}))
    cleared = _cleared(moved, r, opened, mul(TWO, ahead))
    return cast(Expr, substitute(moved, {r: div(opened, mul(TWO, ahead))})) if cleared is None else cleared


def _cleared(g: Expr, r: Var, opened: Expr, whole: Expr) -> Expr | None:
    """Returns g(opened/whole)·wholeⁿ for a polynomial of r of degree n; None for other functions."""
    degree = Shadow((r,)).degree(g)
    if degree is None or degree > MAX_DEGREE:
        return None
    terms: list[Expr] = []
    for k in range(degree + 1):
        coefficient = mul(const(1.0 / math.factorial(k)), cast(Expr, substitute(g, {r: ZERO})))
        terms.append(mul(coefficient, integer_power(opened, k), integer_power(whole, degree - k)))
        g = slope(g, r)
    return add(*terms)


def _dot(a: Vector, b: Vector) -> Expr:
    return add(mul(a[0], b[0]), mul(a[1], b[1]))
