"""Ellipses in two variables, by angle: one chart around the curve, whatever the surface is in other variables.

    g = ±(κ - (x - c)ᵀQ(x - c)),  Q positive definite,       x = c + √κ·L·w,  LᵀQL = 1,  w = (cos φ, sin φ)

    ∫∫ f δ(g) dx dy  =  [κ > 0]·½·det L·∮ f dφ               over four quarters

The centre c and κ, the value of g there, are expressions of parameters and outer variables. The integrand is as smooth as f, without a
square root or a pole. The sides of the box, other lines and conics are made polynomials of t = tan(φ/2): a condition p(cos φ, sin φ) > 0
of degree n is multiplied by (1 + t²)ⁿ. So their roots have formulas, or are isolated as those of polynomials; on a quarter t is
monotone. Around a sphere the measure is that of its slices, dφ dz, which has no pole.

Where g is written with two squares, κ - u² - v², L is the inverse of the matrix of u and v, and nothing cancels however long the ellipse
is: u and v are √κ·w, not differences of coordinates. Rows with parameters may be parallel; the curve is followed in the charts by variable
where it is much larger than the box (`match_squares`). Else the coefficients of Q are numbers, and its condition is at most
`MAX_CONDITION`. A further derivative carries the δ itself along, as that of `teg.passes.eliminate.implicit`.
Source: Archimedes' theorem for the sphere; rational parametrisation of conics (Farin 2002, chapter 12).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.critical import Critical, critical_point, is_above_birth, least_height
from teg.analysis.half_angle import MAX_DEGREE, in_half_angle
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.roots import tidy
from teg.analysis.squares import squares_in
from teg.analysis.surfaces import free_of, restrict, signed_inside
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Var, const
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node
from teg.ir.simplify import add, call, conjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, rebuild, rewrite, rewrite_below, substitute
from teg.ir.uncovered import TURN, marks_of
from teg.passes.eliminate.implicit import Implicit, rewrite_implicit

MAX_CONDITION = 1e6
"""The largest ratio of the eigenvalues of Q. The ends of a longer ellipse would lose more digits than those of the charts by variable."""
LEAST_SINE = 1e-3
"""The least sine of the angle between the gradients of two squares."""
MAX_ASPECT = 1e10
"""The largest ratio of these gradients."""
LARGEST = 1e6
"""The largest size of an ellipse relative to its box: its points lose as many digits."""
EIGHTH = math.pi / 4
QUARTERS = (ONE, ZERO), (ZERO, ONE), (MINUS_ONE, ZERO), (ZERO, MINUS_ONE)
"""The cosine and the sine of the angles around which the quarters of an ellipse lie."""


Matrix = tuple[tuple[Expr, Expr], tuple[Expr, Expr]]


@dataclass(frozen=True)
class Squares:
    """sign·g is top - p² - q²; `bases` are p and q, affine in the variables, `rows` their derivatives."""

    top: Expr
    bases: tuple[Expr, Expr]
    rows: Matrix
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
    inverse: Matrix
    squares: Squares | None = None

    moves = True

    @property
    def name(self) -> str:
        return "an ellipse, by angle" if self.is_certain else "an ellipse, by angle where it is not much larger than the box"

    @property
    def is_certain(self) -> bool:
        """Whether L consists of numbers. Else parameters may make g a strip."""
        return all(isinstance(e, Const) for row in self.inverse for e in row)


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
        return Conic((x, y), sign, _matrix(s / whole, -q / whole, -r / whole, p / whole), squares)
    a, b, c = (-0.5 * sign * n for n in numbers)
    middle, radius = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    if not a > 0.0 or not middle + radius <= MAX_CONDITION * (middle - radius):
        return None
    scale, across = math.sqrt(a), math.sqrt(max(a * c - b * b, 0.0) / a)  # R⁻¹ with RᵀR = Q, R upper triangular
    if not a * across > 0.0:
        return None  # products underflow
    return Conic((x, y), sign, _matrix(1.0 / scale, -b / (a * across), 0.0, 1.0 / across))


def _matrix(a: float, b: float, c: float, d: float) -> Matrix:
    return (const(a), const(b)), (const(c), const(d))


def match_squares(g: Expr, variables: Sequence[Var]) -> Conic | None:
    """Returns both variables if g depends on two, and is written with two squares whose gradients are not known as numbers; else None."""
    mine = [v for v in variables if v in g.free]
    squares = squares_of(g, (mine[1], mine[0])) if len(mine) == 2 else None
    if (
        squares is None
        or any(e.free for row in squares.rows for e in row)
        or all(isinstance(e, Const) for row in squares.rows for e in row)
    ):
        return None
    (p, q), (r, s) = squares.rows
    whole = tidy(sub(mul(p, s), mul(q, r)))
    if is_null(whole):  # a strip, however it is written
        return None
    down = (mul(MINUS_ONE, e) for e in (q, r))
    inverse = (div(s, whole), div(next(down), whole)), (div(next(down), whole), div(p, whole))
    return Conic((mine[1], mine[0]), squares.sign, inverse, squares)


def squares_of(g: Expr, variables: tuple[Var, Var]) -> Squares | None:
    """Returns the two squares of affine functions of which g consists in the variables; None if it does not."""
    split = squares_in(g, variables)
    if split is None or len(split[0]) != 2:
        return None
    roots = [root for factor, _ in split[0] if (root := _root_of_factor(factor)) is not None]
    if len(roots) != 2 or not roots[0][0] * roots[1][0] > 0.0:
        return None
    sign = -1.0 if roots[0][0] > 0.0 else 1.0
    bases = [mul(const(math.sqrt(-sign * number)), root, base) for (number, root), (_, base) in zip(roots, split[0], strict=True)]
    rows = [[slope(base, v) for v in variables] for base in bases]
    if not all(free_of(e, variables) for row in rows for e in row):
        return None
    return Squares(mul(const(sign), add(*split[1])), (bases[0], bases[1]), ((rows[0][0], rows[0][1]), (rows[1][0], rows[1][1])), sign)


def _root_of_factor(factor: Expr) -> tuple[float, Expr] | None:
    """Returns a number and a root of what it is multiplied with; None if that is not written as a square."""
    number, roots = 1.0, []
    for part in cast("Sequence[Expr]", factor.children if isinstance(factor, Mul) else (factor,)):
        if isinstance(part, Const):
            number *= float(part.data)
        elif (root := _root(part)) is not None:
            roots.append(root)
        else:
            return None
    return number, mul(*roots)


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
    _, _, boxes = parts
    place = place_of(g, boxes, data)
    if place is None:
        return rewrite_implicit(g, coefficient, chain, Implicit(data.variables))
    quarters = quarters_of(g, coefficient, chain, data, place)
    if data.is_certain or quarters is None:
        return quarters
    charts = rewrite_implicit(g, coefficient, chain, Implicit(data.variables))
    fits = conjunction(_is_no_strip(cast(Squares, data.squares)), is_near(place, boxes, data))
    return None if charts is None else where(fits, quarters, charts)


def quarters_of(g: Expr, coefficient: Expr, chain: Chain, data: Conic, place: Place) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as integrals over four quarters of an ellipse that is at a place."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, _ = parts
    curve = _Ellipse(g, coefficient, (mine[0], mine[1]), data, place.centre, place.radius)
    turns = [TURN] if marks_of(coefficient) else QUARTERS
    return nest(where(place.exists, add(*(_quarter(curve, turn) for turn in turns)), ZERO), others)


def is_near(place: Place, boxes: Sequence[Binder], data: Conic) -> Cond:
    """Returns whether an ellipse is not much larger than its box: its points are c + √κ·Lw, and may cancel otherwise."""
    fits: list[Cond] = []
    for b, row in zip(boxes, data.inverse, strict=True):
        middle, extent = mul(const(0.5), add(b.lo, b.hi)), call("magnitude", sub(b.hi, b.lo))
        reach = [mul(place.radius, e) for e in row]
        for e in (*reach, *([] if place.centre[b.var].free else [sub(place.centre[b.var], middle)])):
            fits.append(positive(sub(mul(const(LARGEST), extent), call("magnitude", e))))
    return conjunction(*fits)


def _is_no_strip(squares: Squares) -> Cond:
    (p, q), (r, s) = squares.rows
    lengths = mul(*(add(integer_power(a, 2), integer_power(b, 2)) for a, b in ((p, q), (r, s))))
    whole = sub(mul(p, s), mul(q, r))
    return positive(sub(integer_power(whole, 2), mul(const(LEAST_SINE**2), lengths)))


@dataclass(frozen=True)
class Place:
    """Where an ellipse is: its centre, κ, the least κ at which its curve is taken, and whether there is a curve, with a tie at κ = 0."""

    centre: Mapping[Var, Expr]
    square: Expr
    least: Expr
    exists: Cond

    @property
    def radius(self) -> Expr:
        """√κ."""
        return call("sqrt", call("max", self.square, self.least))


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
        v: tidy(mul(MINUS_ONE, add(*(mul(entry, offset) for entry, offset in zip(row, offsets, strict=True)))))
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
    def measure(self) -> Expr:
        """½·det L."""
        (a, b), (c, d) = self.data.inverse
        return mul(const(0.5), call("magnitude", sub(mul(a, d), mul(b, c))))

    def at(self, first: Expr, second: Expr) -> dict[Var, Expr]:
        """Returns the point of the ellipse for a point w of the unit circle: c + √κ·Lw."""
        return {v: add(self.centre[v], step) for v, step in self.offset(first, second).items()}

    def offset(self, first: Expr, second: Expr) -> dict[Var, Expr]:
        """Returns the offset of this point from the centre: √κ·Lw."""
        steps = [add(mul(a, first), mul(b, second)) for a, b in self.data.inverse]
        return {v: mul(self.radius, step) for v, step in zip(self.data.variables, steps, strict=True)}


def _quarter(curve: _Ellipse, turn: tuple[Expr, Expr]) -> Expr:
    """Returns the integral over the quarter around the angle whose cosine and sine are given."""
    g, coefficient, binders = curve.g, curve.coefficient, curve.binders
    taken = coefficient.free | g.free | {b.var for b in binders}
    angle, c, s = (fresh(name, taken) for name in ("φ", "cos φ", "sin φ"))
    point = turned((c, s), turn)
    at = curve.at(*point)
    coefficient, bases = _along_bases(curve, coefficient, point)
    value = restrict(coefficient, {**at, **bases}, g, (binders[1].var, binders[0].var))
    offset = curve.offset(*point)
    for b in binders:  # relative to the centre: of a circle around a corner the half, however small it is
        lo, hi = (sub(cast(Expr, substitute(e, at)), curve.centre[b.var]) for e in (b.lo, b.hi))
        value = signed_inside(offset[b.var], lo, hi, g, b, value)
    value = _without_constants(value, c, s)
    half = call("tan", mul(const(0.5), angle))

    def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
        polynomial = in_half_angle(old.g, c, s, half)
        return positive(new if polynomial is None else polynomial, old.strict, resolution, old.rivals)

    at_angle: dict[Var, Expr] = {c: call("cos", angle), s: call("sin", angle)}
    body = cast(Expr, substitute(mul(curve.measure, value), at_angle, algebraic))
    return integral_over(body, angle, const(-EIGHTH), const(EIGHTH))


def turned(e: tuple[Expr, Expr], turn: tuple[Expr, Expr]) -> tuple[Expr, Expr]:
    """Returns a direction turned by an angle whose cosine and sine are given."""
    return sub(mul(turn[0], e[0]), mul(turn[1], e[1])), add(mul(turn[1], e[0]), mul(turn[0], e[1]))


def _along_bases(curve: _Ellipse, coefficient: Expr, point: tuple[Expr, Expr]) -> tuple[Expr, dict[Var, Expr]]:
    """Returns a coefficient in which variables stand for the affine functions whose squares g has, and their values √κ·w: where the
    coordinates are large beside a short axis, these would cancel. Conditions are left as they are."""
    symbols: dict[Node, Var] = {}
    values: dict[Var, Expr] = {}
    for base, w in zip(curve.data.squares.bases if curve.data.squares is not None else (), point, strict=False):
        factors = cast("Sequence[Expr]", base.children) if isinstance(base, Mul) else (base,)
        moving = [f for f in factors if not free_of(f, curve.data.variables)]
        if len(moving) == 1 and not isinstance(moving[0], Var):
            symbols[moving[0]] = fresh("p", coefficient.free | values.keys())
            values[symbols[moving[0]]] = div(mul(curve.radius, w), mul(*(f for f in factors if f is not moving[0])))

    def replacement(node: Node) -> Node | None:
        apart = isinstance(node, Cond) or (isinstance(node, Integral) and node.var in curve.data.variables)
        return node if apart else symbols.get(node)

    return cast(Expr, rewrite_below([coefficient], replacement)[coefficient]), values


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
