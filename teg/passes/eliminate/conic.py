"""Ellipses in two variables, by angle: one chart around the curve, whatever the surface is in other variables.

    g = ±(κ - (x - c)ᵀQ(x - c)),  Q positive definite,       x = c + √κ·L·w,  LᵀQL = 1,  w = (cos φ, sin φ)

    ∫∫ f δ(g) dx dy  =  [κ > 0]·½·det L·∮ f dφ               over four quarters

The centre c and κ, the value of g there, are expressions of parameters and outer variables. The integrand is as smooth as f, without a
square root or a pole. The sides of the box, other lines and conics are made polynomials of t = tan(φ/2): a condition p(cos φ, sin φ) > 0
of degree n is multiplied by (1 + t²)ⁿ. So their roots have formulas, or are isolated as those of polynomials; on a quarter t is
monotone. Around a sphere the measure is that of its slices, dφ dz, which has no pole.

The coefficients of Q are numbers. Where g is written with two squares, κ - u² - v², L is the inverse of the matrix of u and v, and
nothing cancels however long the ellipse is; else L comes from the coefficients, and the condition of Q is at most `MAX_CONDITION`. A
further derivative carries the δ itself along, as that of `teg.passes.eliminate.implicit`.
Source: Archimedes' theorem for the sphere; rational parametrisation of conics (Farin 2002, chapter 12).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.critical import Critical, critical_point, is_above_birth, least_height
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import tidy
from teg.analysis.surfaces import free_of, restrict, signed_inside
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Var, const
from teg.ir.integral import integral_over
from teg.ir.node import Node
from teg.ir.simplify import add, call, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, rebuild, rewrite, substitute
from teg.passes.eliminate.implicit import Implicit, rewrite_implicit

MAX_CONDITION = 1e6
"""The largest ratio of the eigenvalues of Q. The ends of a longer ellipse would lose more digits than those of the charts by variable."""
LEAST_SINE = 1e-3
"""The least sine of the angle between the gradients of two squares."""
MAX_ASPECT = 1e10
"""The largest ratio of these gradients."""
MAX_DEGREE = 8
"""The largest degree of a condition that is made a polynomial of t."""
EIGHTH = math.pi / 4


@dataclass(frozen=True)
class Squares:
    """sign·g is top - p² - q²; `bases` are p and q, affine in the variables, `rows` their derivatives."""

    top: Expr
    bases: tuple[Expr, Expr]
    rows: tuple[tuple[Expr, Expr], tuple[Expr, Expr]]
    sign: float

    @property
    def numbers(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """The rows, if they consist of numbers and are neither nearly parallel nor of very different lengths; else None."""
        entries = [float(e.data) for row in self.rows for e in row if isinstance(e, Const)]
        if len(entries) != 4:
            return None
        a, b, c, d = entries
        long, short = sorted((math.hypot(a, b), math.hypot(c, d)), reverse=True)
        if not (abs(a * d - b * c) >= LEAST_SINE * long * short > 0.0 and long <= MAX_ASPECT * short):
            return None
        return (a, b), (c, d)


@dataclass(frozen=True)
class Conic:
    """g is an ellipse in `variables` (outermost first): sign·g has the quadratic part -xᵀQx. `inverse` is L, Q⁻¹ = LLᵀ."""

    variables: tuple[Var, Var]
    sign: float
    inverse: tuple[tuple[float, float], tuple[float, float]]
    squares: Squares | None = None

    name = "an ellipse, by angle"
    moves = True


def match_conic(g: Expr, variables: Sequence[Var]) -> Conic | None:
    """Returns the two innermost variables if the quadratic part of g in them is definite and consists of numbers; else None."""
    mine = [v for v in variables if v in g.free][:2]
    if len(mine) != 2 or Shadow(tuple(mine)).degree(g) != 2:
        return None
    y, x = mine
    try:
        entries = slope(slope(g, x), x), slope(slope(g, x), y), slope(slope(g, y), y)
    except NotDifferentiableError:
        return None
    numbers = [float(e.data) for e in entries if isinstance(e, Const)]
    if len(numbers) != 3:
        return None
    sign = -1.0 if numbers[0] > 0.0 else 1.0
    squares = squares_of(g, (x, y))
    if squares is not None and squares.numbers is not None:
        (p, q), (r, s) = squares.numbers
        whole = p * s - q * r
        return Conic((x, y), sign, ((s / whole, -q / whole), (-r / whole, p / whole)), squares)
    a, b, c = (-0.5 * sign * n for n in numbers)
    middle, radius = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    if not a > 0.0 or not middle + radius <= MAX_CONDITION * (middle - radius):
        return None
    scale, across = math.sqrt(a), math.sqrt(max(a * c - b * b, 0.0) / a)  # R⁻¹ with RᵀR = Q, R upper triangular
    if not a * across > 0.0:
        return None  # products underflow
    return Conic((x, y), sign, ((1.0 / scale, -b / (a * across)), (0.0, 1.0 / across)))


def squares_of(g: Expr, variables: tuple[Var, Var]) -> Squares | None:
    """Returns the two squares of affine functions of which g consists in the variables; None if it does not."""
    top: list[tuple[float, Expr]] = []
    found: list[tuple[float, Expr]] = []
    terms: list[tuple[float, Expr, Expr]] = [(1.0, ONE, g)]  # a number, a root of the other factors, what they are multiplied with
    while terms:
        factor, root, term = terms.pop()
        if free_of(term, variables):
            top.append((factor, mul(integer_power(root, 2), term)))
        elif isinstance(term, Add):
            terms += [(factor, root, c) for c in reversed(cast("Sequence[Expr]", term.children))]
        elif isinstance(term, Mul):
            split = _with_a_root(term, variables)
            if split is None:
                return None
            number, more, rest = split
            terms.append((factor * number, mul(root, more), rest))
        elif isinstance(term, Pow) and term.exponent == 2 and len(found) < 2:
            found.append((factor, mul(root, term.base)))
        else:
            return None
    if len(found) != 2 or not found[0][0] * found[1][0] > 0.0:
        return None
    sign = -1.0 if found[0][0] > 0.0 else 1.0
    bases = [mul(const(math.sqrt(-sign * factor)), base) for factor, base in found]
    if any(Shadow(variables).degree(base) != 1 for base in bases):
        return None
    rows = [[slope(base, v) for v in variables] for base in bases]
    if not all(free_of(e, variables) for row in rows for e in row):
        return None
    whole = add(*(mul(const(sign * factor), e) for factor, e in top))
    return Squares(whole, (bases[0], bases[1]), ((rows[0][0], rows[0][1]), (rows[1][0], rows[1][1])), sign)


def _with_a_root(term: Mul, variables: tuple[Var, Var]) -> tuple[float, Expr, Expr] | None:
    """Returns a number and a root of the factors without the variables, and the one factor with them; None if there are others."""
    number, roots, rest = 1.0, [], []
    for factor in cast("Sequence[Expr]", term.children):
        if isinstance(factor, Const):
            number *= float(factor.data)
        elif not free_of(factor, variables):
            rest.append(factor)
        elif (root := _root(factor)) is not None:
            roots.append(root)
        else:
            return None
    return (number, mul(*roots), rest[0]) if len(rest) == 1 else None


def _root(e: Expr) -> Expr | None:
    """Returns a root of an expression that is written as a square; None for others."""
    powers = 1
    while isinstance(e, Pow) and e.exponent % 2:
        powers, e = powers * e.exponent, e.base
    if isinstance(e, Pow):
        return integer_power(e.base, powers * e.exponent // 2)
    return call("exp", mul(const(0.5 * powers), e.children[0])) if isinstance(e, Call) and e.name == "exp" else None


def rewrite_conic(g: Expr, coefficient: Expr, chain: Chain, data: Conic) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as integrals over four quarters of the ellipse, or by the charts of a surface without a formula."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, boxes = parts
    place = place_of(g, boxes, data)
    if place is None:
        return rewrite_implicit(g, coefficient, chain, Implicit(data.variables))
    radius = call("sqrt", call("max", place.square, place.least))
    curve = _Ellipse(g, coefficient, (mine[0], mine[1]), data, place.centre, radius)
    quarters = add(*(_quarter(curve, k) for k in range(4)))
    return nest(where(place.exists, quarters, ZERO), others)


@dataclass(frozen=True)
class Place:
    """Where an ellipse is: its centre, κ, the least κ at which its curve is taken, and whether there is a curve, with a tie at κ = 0."""

    centre: Mapping[Var, Expr]
    square: Expr
    least: Expr
    exists: Cond


def place_of(g: Expr, boxes: Sequence[Binder], data: Conic) -> Place | None:
    """Returns where an ellipse is on a box; None if it has no centre."""
    if data.squares is not None:
        return replace(born(g, data.squares.top, data.sign), centre=_centre(data, data.squares))
    critical = critical_point(g, boxes)
    if critical is None:
        return None
    above = is_above_birth(g, critical)
    centre = {v: tidy(e) for v, e in critical.point.items()}
    square = mul(const(data.sign), tidy(critical.value))
    return Place(centre, square, least_height(critical), above if data.sign > 0.0 else negation(above))


def born(g: Expr, top: Expr, sign: float) -> Place:
    """Returns the place of an ellipse sign·g = top - p² - q², without its centre."""
    terms = add(*(call("magnitude", term) for term in (top.children if isinstance(top, Add) else (top,))))
    critical = Critical({}, mul(const(sign), top), ONE, TRUE, terms, ZERO)
    above = is_above_birth(g, critical)
    return Place({}, tidy(top), least_height(critical), above if sign > 0.0 else negation(above))


def _centre(data: Conic, squares: Squares) -> dict[Var, Expr]:
    """Returns the point at which both squares are 0."""
    offsets = [cast(Expr, substitute(base, dict.fromkeys(data.variables, ZERO))) for base in squares.bases]
    return {
        v: tidy(add(*(mul(const(-entry), offset) for entry, offset in zip(row, offsets, strict=True))))
        for v, row in zip(data.variables, data.inverse, strict=True)
    }


@dataclass(frozen=True)
class _Ellipse:
    """An ellipse g = 0 with the coefficient of its δ, in the integrals `binders`; `radius` is √κ."""

    g: Expr
    coefficient: Expr
    binders: tuple[Binder, Binder]
    data: Conic
    centre: Mapping[Var, Expr]
    radius: Expr

    @property
    def measure(self) -> float:
        """½·det L."""
        (a, b), (c, d) = self.data.inverse
        return 0.5 * abs(a * d - b * c)

    def at(self, first: Expr, second: Expr) -> dict[Var, Expr]:
        """Returns the point of the ellipse for a point w of the unit circle: c + √κ·Lw."""
        return {v: add(self.centre[v], step) for v, step in self.offset(first, second).items()}

    def offset(self, first: Expr, second: Expr) -> dict[Var, Expr]:
        """Returns the offset of this point from the centre: √κ·Lw."""
        steps = [add(mul(const(a), first), mul(const(b), second)) for a, b in self.data.inverse]
        return {v: mul(self.radius, step) for v, step in zip(self.data.variables, steps, strict=True)}


def _quarter(curve: _Ellipse, number: int) -> Expr:
    """Returns the integral over the quarter around the angle number·π/2."""
    g, coefficient, binders = curve.g, curve.coefficient, curve.binders
    taken = coefficient.free | g.free | {b.var for b in binders}
    angle, c, s = (fresh(name, taken) for name in ("φ", "cos φ", "sin φ"))
    turned = (c, s), (mul(MINUS_ONE, s), c), (mul(MINUS_ONE, c), mul(MINUS_ONE, s)), (s, mul(MINUS_ONE, c))
    at = curve.at(*turned[number])
    value = restrict(coefficient, at, g, (binders[1].var, binders[0].var))
    offset = curve.offset(*turned[number])
    for b in binders:  # relative to the centre: of a circle around a corner the half, however small it is
        lo, hi = (sub(cast(Expr, substitute(e, at)), curve.centre[b.var]) for e in (b.lo, b.hi))
        value = signed_inside(offset[b.var], lo, hi, g, b, value)
    value = _without_constants(value, c, s)
    half = call("tan", mul(const(0.5), angle))

    def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
        polynomial = _in_half_angle(old.g, c, s, half)
        return positive(new if polynomial is None else polynomial, old.strict, resolution, old.rivals)

    at_angle: dict[Var, Expr] = {c: call("cos", angle), s: call("sin", angle)}
    body = cast(Expr, substitute(mul(const(curve.measure), value), at_angle, algebraic))
    return integral_over(body, angle, const(-EIGHTH), const(EIGHTH))


def _without_constants(value: Expr, c: Var, s: Var) -> Expr:
    """Returns the value with arguments of functions taken at angle 0 where they are constant on the circle, as that of sin(x² + y²)."""
    shadow = Shadow((c, s))

    def visit(old: Node, new: Node) -> Node:
        if not isinstance(new, Call) or new.free.isdisjoint((c, s)):
            return new
        return rebuild(new, tuple([substitute(e, start) if is_constant(e) else e for e in new.children]))

    def is_constant(e: Expr) -> bool:
        degree = shadow.degree(e)
        if degree is None or not 2 <= degree <= MAX_DEGREE:
            return False
        along = sub(mul(c, slope(e, s)), mul(s, slope(e, c)))
        return not shadow.polynomial(along)

    start: dict[Var, Expr] = {c: ONE, s: ZERO}
    return cast(Expr, rewrite([value], visit)[value])


def _in_half_angle(p: Expr, c: Var, s: Var, half: Expr) -> Expr | None:
    """Returns p(c, s)·(1 + t²)ⁿ for a polynomial p of degree n in cosine and sine, with t the tangent of half the angle; None for others.

    As c² + s² = 1, another circle is a polynomial of degree 1.
    """
    degree = Shadow((c, s)).degree(p)
    if degree is None or degree > MAX_DEGREE:
        return None
    if degree == 2:
        square = mul(const(0.5), slope(slope(p, c), c))
        on_circle = sub(p, mul(square, sub(add(integer_power(c, 2), integer_power(s, 2)), ONE)))
        if Shadow((c, s)).degree(on_circle) == 1:
            p, degree = on_circle, 1
    t, z = fresh("t", p.free), fresh("z", p.free)  # z = 1/(1 + t²)
    rate = cast(Expr, substitute(p, {c: sub(mul(const(2.0), z), ONE), s: mul(const(2.0), t, z)}))
    terms, factor = [], 1.0
    for k in range(degree + 1):
        power = integer_power(add(ONE, integer_power(t, 2)), degree - k)
        terms.append(mul(const(1.0 / factor), cast(Expr, substitute(rate, {z: ZERO})), power))
        rate, factor = slope(rate, z), factor * (k + 1)
    return cast(Expr, substitute(add(*terms), {t: half}))
