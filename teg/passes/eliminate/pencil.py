"""Conics whose coefficients are data, by the lines through one of their points: ellipses, parabolas, hyperbolas and pairs of lines.

    g = G·v + a·u² + 2b·u·v + c·v²      about a point P of the curve: u along it, v across it, G the length of the gradient
    u = w·ν/D,  v = -h·w²/D,  D = ν² - 2β·w·ν + hγ·w²,   h, β, γ = a/G, b/G, c/G        the line of slope -h·w/ν meets it again there

    ∫∫ f δ(g)  =  ∫ f(P + (u, v))·|ν dw - w dν|/(G·|D|)

Near P, w is the length along the curve. Far from it the slope ω = h·w/ν tells places: of two lines (h = 0) the second one. So there are six
arcs: |w/ν| < r, then r < ±w/ν up to the slope Ω = √(|h|r·K), then Ω < ±ω < K, and |ν/ω| < 1/K. A hyperbola has two branches, on which D > 0
and D < 0. On an arc of a branch σ, conditions p of degree n are polynomials p·(σD)ⁿ of degree 2n in s. The box, which lies between lines,
excludes D = 0, and σD < 0 if it is known which bound is the lower one.

P is where the curve meets a side of the box, or else a line through the middle of an ellipse: where it crosses best. Coordinates are those
in which the box is the square from -1 to 1. Cost: one integral, over a range of twelve arcs. Source: rational parametrisation of conics by
the pencil of lines through a point (Semple and Kneebone, Algebraic Projective Geometry, 1952).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.critical import sign_at
from teg.analysis.half_angle import MAX_DEGREE
from teg.analysis.nest import Binder, Chain, divided, nest
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import ordered, restrict, signed_inside
from teg.errors import NotDifferentiableError
from teg.ir.cells import replaced
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Compare, Cond, Expr, Mul, Var, const
from teg.ir.function import Slot
from teg.ir.integral import integral_over
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, substitute
from teg.ir.uncovered import ARC, marks_of
from teg.passes.eliminate.marks import with_conditions_at

REACH = 2.0 * math.sqrt(2.0)
"""How far w goes where the curve is larger than the box: two points of it are at most that apart."""
DEFINITE = 1e-12
"""The least hγ - β², relative to the squares of all three, of a curve that has one branch only."""
OUTSIDE = 1.0 / 64.0
"""How far outside of a side of the box P may be, so that none is missed in a corner."""
NOISE = 2.0**-49
"""How far from 0 a number is that would be 0 without rounding, relative to what it is computed from."""
CROSSING = 2.0**-46
"""Where an arc begins that may end at the crossing of two lines: at 0 a factor that would be 0 is a rounding, and the integral infinite."""
LARGE = 1e200
"""Its square is infinite."""
ROUNDING = 2.0**-47
"""The least discriminant along a line, relative to what it is computed from: in one that is less the curve is a double line or a point."""
FAVOURS = 1.0, 0.93, 0.87, 0.81, 0.76
"""Factors of the discriminants along lines that are compared: in symmetric scenes rounding would choose."""
ONE_HALF, TWO = const(0.5), const(2.0)
Vector = tuple[Expr, Expr]


@dataclass(frozen=True)
class Pencil:
    """g is of degree 2 in `variables` (outermost first), with coefficients that depend on parameters only."""

    variables: tuple[Var, Var]

    moves = True
    name = "a conic, by the lines through one of its points"


def match_pencil(g: Expr, variables: Sequence[Var]) -> Pencil | None:
    """Returns both variables if g depends on two and is of degree 2 in them, else None.

    Not for two lines that are written as a product: where another pair shares one of them, the side on which that lies changes in between.
    """
    mine = [v for v in variables if v in g.free]
    if isinstance(g, Mul) and sum(bool(factor.free) for factor in g.children) > 1:
        return None
    if len(mine) != 2 or Shadow(tuple(mine)).degree(g) != 2:
        return None
    try:
        entries = [slope(slope(g, v), w) for v in mine for w in mine]
    except NotDifferentiableError:
        return None
    return None if any(e.free for e in entries) else Pencil((mine[1], mine[0]))


def rewrite_pencil(g: Expr, coefficient: Expr, chain: Chain, data: Pencil) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) as one integral for all arcs of the curve, which `ARC` tells apart."""
    parts = divided(chain, data.variables)
    if parts is None:
        return None
    mine, others, (first, second) = parts
    beyond = max((cast(Slot, mark.callee).data[4][0].beyond for mark in marks_of(coefficient)), default=0.0)
    last = second if beyond == 0.0 else Binder(second.var, second.lo, add(second.hi, mul(const(beyond), sub(second.hi, second.lo))))
    form = _Form.of(g, (first, last))
    near = _Point.on(form)
    frame = _Frame.at(form, near)
    curve = _Curve(g, (mine[0], mine[1]), form, near, frame)
    there = conjunction(near.exists, frame.has_arc)
    crossing = where(near.exists, curve.at_crossing(coefficient), ZERO)
    return nest(add(where(there, curve.along(coefficient), ZERO), crossing), others)


def _cleaned(e: Expr, size: Expr) -> Expr:
    """Returns a number that is exactly 0 where it is its rounding error, beside the size of what it is computed from."""
    e = call("exact", e)  # one term of the difference below, which is 0 then
    is_noise = positive(sub(mul(const(NOISE), size), call("magnitude", e)), strict=False)
    return sub(e, call("chosen", where(is_noise, e, ZERO)))


class _Form(NamedTuple):
    """level + slopes·z + zᵀMz in the coordinates z = (place - middle)/half of both variables; M by (00, 01, 11). `sizes` are those of the
    terms of level and slopes."""

    middle: Vector
    half: Vector
    level: Expr
    slopes: Vector
    entries: tuple[Expr, Expr, Expr]
    sizes: tuple[Expr, Expr, Expr]

    @classmethod
    def of(cls, g: Expr, boxes: Sequence[Binder]) -> _Form:
        """Returns that of g on a box."""
        (u, v) = (b.var for b in boxes)
        m, n = (mul(ONE_HALF, add(b.lo, b.hi)) for b in boxes)
        p, q = (mul(ONE_HALF, sub(b.hi, b.lo)) for b in boxes)
        at = {u: m, v: n}
        level, by_u, by_v = (cast(Expr, substitute(e, at)) for e in (g, slope(g, u), slope(g, v)))
        entries = (
            mul(ONE_HALF, p, p, slope(slope(g, u), u)),
            mul(ONE_HALF, p, q, slope(slope(g, u), v)),
            mul(ONE_HALF, q, q, slope(slope(g, v), v)),
        )
        sizes = _size(level), mul(call("magnitude", p), _size(by_u)), mul(call("magnitude", q), _size(by_v))
        return cls((m, n), (p, q), level, (mul(p, by_u), mul(q, by_v)), entries, sizes)

    def slopes_at(self, place: Vector) -> Vector:
        """Returns the gradient at a place."""
        (a, b, c), (p, q), (s, r) = self.entries, place, self.slopes
        return add(s, mul(TWO, add(mul(a, p), mul(b, q)))), add(r, mul(TWO, add(mul(b, p), mul(c, q))))

    def exact_slopes_at(self, place: Vector) -> Vector:
        """Returns the same, with 0 for what is a rounding error: then the curve runs along a side of the box."""
        (a, b, c), (_, s, r) = self.entries, self.sizes
        p, q = map(_size, place)
        sizes = (add(s, mul(TWO, _size(e), p), mul(TWO, _size(b), q)) for e, p, q, s in ((a, p, q, s), (c, q, p, r)))
        m, n = (_cleaned(e, size) for e, size in zip(self.slopes_at(place), sizes, strict=True))
        return m, n

    def moved(self, place: Vector) -> Vector:
        """Returns a place on the curve as a function of the coefficients, by a step of Newton's method: a root itself is long to
        differentiate."""
        (a, b, c), (p, q), (s, r) = self.entries, place, self.slopes
        height = add(self.level, mul(s, p), mul(r, q), mul(a, p, p), mul(TWO, b, p, q), mul(c, q, q))
        m, n = self.slopes_at(place)
        square = add(mul(m, m), mul(n, n))
        step = mul(height, call("chosen", div(ONE, where(positive(square), square, ONE))))
        return sub(p, mul(step, call("chosen", m))), sub(q, mul(step, call("chosen", n)))

    def line(self, across: bool, place: Expr) -> tuple[Expr, Expr, Expr]:
        """Returns the coefficients, the highest power first, along a line on which the first (`across`) or second coordinate is fixed."""
        a, b, c = self.entries
        (s, r), (a, c) = (self.slopes, (a, c)) if across else (self.slopes[::-1], (c, a))
        return c, add(r, mul(TWO, b, place)), add(self.level, mul(s, place), mul(a, place, place))

    def least_square(self, across: bool) -> Expr:
        """Returns a bound of the error of the discriminant along such a line through the box."""
        a, b, c = (call("magnitude", e) for e in self.entries)
        level, s, r = self.sizes
        (s, r), (a, c) = ((s, r), (a, c)) if across else ((r, s), (c, a))
        return mul(const(ROUNDING), add(integer_power(add(r, mul(TWO, b)), 2), mul(const(4.0), c, add(level, s, a))))


def _size(e: Expr) -> Expr:
    """Returns the sum of the magnitudes of the terms of a sum."""
    return add(*(call("magnitude", term) for term in (e.children if isinstance(e, Add) else (e,))))


class _Point(NamedTuple):
    """A point of a curve in the box, and whether there is one."""

    place: Vector
    exists: Cond

    @classmethod
    def on(cls, form: _Form) -> _Point:
        """Returns the one where a line crosses the curve best, of the sides of the box and one line through the middle of an ellipse."""
        a, b, c = form.entries
        whole = sub(mul(a, c), mul(b, b))
        s, r = form.slopes
        centre = div(sub(mul(b, s), mul(a, r)), where(positive(whole), mul(TWO, whole), ONE))
        across_centre = call("max", MINUS_ONE, call("min", centre, ONE))
        lines = (True, MINUS_ONE), (True, ONE), (False, MINUS_ONE), (False, ONE), (False, across_centre)
        best: Expr = const(-1.0)
        is_upright: Expr = ZERO
        fixed: Expr = ZERO
        least = {across: form.least_square(across) for across in (True, False)}
        for favour, (across, place) in zip(FAVOURS, lines, strict=True):
            roots = _Roots.of(form.line(across, place))
            crosses = conjunction(disjunction(*map(_is_inside, roots.places)), positive(sub(roots.square, least[across])))
            quality = where(crosses, mul(const(favour), roots.square), const(-1.0))
            better = positive(sub(quality, best))
            best, fixed = call("max", quality, best), where(better, place, fixed)
            is_upright = where(better, ONE if across else ZERO, is_upright)
        upright = positive(sub(is_upright, ONE_HALF))
        columns = zip(form.line(True, fixed), form.line(False, fixed), strict=True)
        places = _Roots.of([where(upright, p, q) for p, q in columns]).places
        low, high = call("min", *places), call("max", *places)
        root = where(_is_inside(low), low, high)
        first, second = (call("chosen", e) for e in (where(upright, fixed, root), where(upright, root, fixed)))
        return cls(form.moved((first, second)), positive(best))


class _Roots(NamedTuple):
    """Both roots of a polynomial of degree 2, if its discriminant `square` is not below 0."""

    square: Expr
    places: Vector

    @classmethod
    def of(cls, coefficients: Sequence[Expr]) -> _Roots:
        """Returns those of the coefficients by powers, the highest first: the larger root by a sum, the other one by their product."""
        a, b, c = coefficients
        square = sub(mul(b, b), mul(const(4.0), a, c))
        root = call("sqrt", call("max", square, ZERO))
        larger = mul(const(-0.5), add(b, where(positive(b), root, mul(MINUS_ONE, root))))
        return cls(square, (_quotient(larger, a), _quotient(c, larger)))


def _quotient(p: Expr, q: Expr) -> Expr:
    """Returns p/q, and a number that is outside of the box for q = 0."""
    exists = positive(call("magnitude", q))
    return where(exists, div(p, where(exists, q, ONE)), TWO)


def _is_inside(place: Expr) -> Cond:
    return positive(sub(const(1.0 + OUTSIDE), call("magnitude", place)))


_IS_OTHER = positive(sub(ARC, const(5.5)))
_SIGN = where(_IS_OTHER, MINUS_ONE, ONE)
_KIND = sub(ARC, where(_IS_OTHER, const(6.0), ZERO))
_IS_NEAREST, _IS_NEAR, _IS_FARTHEST = positive(sub(ONE_HALF, _KIND)), positive(sub(const(2.5), _KIND)), positive(sub(_KIND, const(4.5)))
_IS_LEFT = disjunction(*(positive(sub(const(0.25), integer_power(sub(_KIND, const(kind)), 2))) for kind in (2.0, 4.0)))


class _Frame(NamedTuple):
    """The curve about its point: the direction across it, G and h, β, γ, how far the arcs go, and whether it has the arc of `ARC`.

    `skew` is β on an ellipse that is not much larger than the box, else 0. There the lines are told by ν - β·w, so D is a sum of squares.
    """

    across: Vector
    length: Expr
    h: Expr
    beta: Expr
    gamma: Expr
    skew: Expr
    reach: Expr
    turn: Expr
    has_arc: Cond

    @classmethod
    def at(cls, form: _Form, near: _Point) -> _Frame:
        """Returns that of a form."""
        a, b, c = form.entries
        m, n = form.exact_slopes_at(near.place)
        square = add(mul(m, m), mul(n, n))
        length = call("exact", where(positive(square), call("sqrt", square), ONE))
        m, n = (call("exact", div(e, length)) for e in (m, n))
        terms = mul(a, n, n), mul(const(-2.0), b, m, n), mul(c, m, m)
        bent, size = add(*terms), add(*(call("magnitude", term) for term in terms))
        mixed = add(mul(sub(a, c), m, n), mul(b, sub(mul(n, n), mul(m, m))))
        other = add(mul(a, m, m), mul(TWO, b, m, n), mul(c, n, n))
        h, beta, gamma = (call("exact", div(e, length)) for e in (_cleaned(bent, size), mixed, other))
        inverse = sub(mul(h, gamma), mul(beta, beta))
        is_small = positive(sub(inverse, const(REACH**-2)))
        reach = call("chosen", where(is_small, integer_power(call("sqrt", where(is_small, inverse, ONE)), -1), const(REACH)))
        steep = mul(call("magnitude", h), reach)
        turn = where(disjunction(is_small, positive(sub(steep, ONE))), steep, ONE)
        has_between = conjunction(negation(is_small), positive(sub(turn, steep)))
        is_between = negation(disjunction(_IS_NEAREST, _IS_FARTHEST))
        several = positive(sub(mul(const(DEFINITE), add(mul(h, h), mul(beta, beta), mul(gamma, gamma))), inverse))
        first = where(_IS_NEAR, ONE, h)  # D has its sign on an ellipse
        has_arc = conjunction(disjunction(several, positive(mul(_SIGN, first))), disjunction(negation(is_between), has_between))
        return cls((m, n), length, h, beta, gamma, call("exact", where(is_small, beta, ZERO)), reach, turn, has_arc)


Polynomial = Sequence[Expr]
"""The coefficients of a polynomial of s, by powers."""


class _Steps(NamedTuple):
    """Along the curve, by s from -1 or almost 0 to 1: the polynomials U, V and D of the place P + (U, V)/D, and the constant ν dw - w dν.

    Two lines cross where two arcs meet, and D is 0 there. That is at s = 0, where a polynomial of s is computed without a difference.
    """

    along: Polynomial
    over: Polynomial
    whole: Polynomial
    rate: Expr

    @classmethod
    def of(cls, frame: _Frame) -> _Steps:
        """Returns those of the arc `ARC`."""
        reach, turn, side = frame.reach, frame.turn, where(_IS_LEFT, MINUS_ONE, ONE)
        steep = mul(call("magnitude", frame.h), reach)
        meeting = call("chosen", call("sqrt", mul(steep, turn)))  # the slope at which both arcs between end
        share = div(steep, where(positive(meeting), meeting, ONE))
        nearest = reach, ZERO, reach, ONE, ZERO
        first = mul(reach, sub(ONE, share)), mul(side, reach), ZERO, share, sub(ONE, share)
        length = sub(turn, meeting)
        second = length, mul(side, meeting), mul(side, length), ONE, ZERO
        farthest = turn, turn, ZERO, ZERO, ONE
        of_arcs = zip(nearest, first, second, farthest, strict=True)
        of_arc = (where(_IS_NEAREST, p, where(_IS_NEAR, q, where(_IS_FARTHEST, u, r))) for p, q, r, u in of_arcs)
        rate, *starts = (call("exact", e) for e in of_arc)
        w, n = starts[:2], starts[2:]
        turned = where(_IS_NEAR, ONE, where(positive(frame.h), ONE, MINUS_ONE))  # far away w is h·w: |h|·r on an ellipse
        skew = call("exact", where(_IS_NEAR, frame.skew, div(mul(turned, frame.skew, reach), turn)))
        n = [add(p, mul(skew, q)) for p, q in zip(n, w, strict=True)]
        by_w, by_n = where(_IS_NEAR, frame.h, ONE), where(_IS_NEAR, ONE, frame.h)
        along, square = _product(w, n), _product(w, w)
        whole = _total(_scaled(by_n, _product(n, n)), _scaled(mul(const(-2.0), frame.beta), along), _scaled(mul(by_w, frame.gamma), square))
        along, over, whole = ([call("exact", e) for e in part] for part in (along, _scaled(mul(MINUS_ONE, by_w), square), whole))
        return cls(along, over, whole, rate)


def _product(p: Polynomial, q: Polynomial) -> Polynomial:
    return [add(*(mul(p[i], q[k - i]) for i in range(len(p)) if 0 <= k - i < len(q))) for k in range(len(p) + len(q) - 1)]


def _scaled(factor: Expr, p: Polynomial) -> Polynomial:
    return [mul(factor, e) for e in p]


def _total(*parts: Polynomial) -> Polynomial:
    return [add(*(p[k] for p in parts if k < len(p))) for k in range(max(map(len, parts)))]


def _at(p: Polynomial, s: Expr) -> Expr:
    return add(*(mul(e, integer_power(s, k)) for k, e in enumerate(p)))


@dataclass(frozen=True)
class _Curve:
    """A conic g = 0 in the integrals `binders`."""

    g: Expr
    binders: tuple[Binder, Binder]
    form: _Form
    near: _Point
    frame: _Frame

    def along(self, coefficient: Expr) -> Expr:
        """Returns ∫∫ coefficient·δ(g) over the arc `ARC`."""
        variables = u, v = self.binders[0].var, self.binders[1].var
        taken = coefficient.free | self.g.free | {u, v}
        along, over, s = (fresh(name, taken) for name in ("along", "over", "s"))
        (m, n), (p, q) = self.frame.across, self.form.half
        axes = [[call("exact", e) for e in axis] for axis in ((mul(p, n), mul(p, m)), (mul(MINUS_ONE, q, m), mul(q, n)))]
        start = [call("exact", add(c, mul(size, z))) for c, size, z in zip(self.form.middle, self.form.half, self.near.place, strict=True)]
        moves = [add(mul(a, along), mul(b, over)) for a, b in axes]
        at = {x: add(c, move) for x, c, move in zip(variables, start, moves, strict=True)}
        steps = _Steps.of(self.frame)
        value = restrict(coefficient, at, self.g, (v, u))
        terms = *start, *axes[0], *axes[1], *steps.along, *steps.over, *steps.whole, _SIGN, s
        value = with_conditions_at(value, (at[u], at[v]), _on_arc, terms)
        for binder, c, move in zip(self.binders, start, moves, strict=True):
            lo, hi = (sub(cast(Expr, substitute(e, at)), c) for e in (binder.lo, binder.hi))
            value = signed_inside(move, lo, hi, self.g, binder, value)
        if not all(ordered(binder.lo, binder.hi) for binder in self.binders):  # else places with σD < 0 are between no bounds
            value = where(positive(mul(_SIGN, _at(steps.whole, s))), value, ZERO)

        def algebraic(old: Compare, new: Expr, resolution: Cond | None) -> Cond:
            polynomial = _cleared(old.g, (along, over), steps[:3], _SIGN, True)
            return positive(new if polynomial is None else _at(polynomial, s), old.strict, resolution, old.rivals)

        z = integer_power(_at(steps.whole, s), -1)
        weight = div(mul(call("magnitude", mul(p, q)), steps.rate, _SIGN, z), self.frame.length)
        on_curve = {along: mul(_at(steps.along, s), z), over: mul(_at(steps.over, s), z)}
        body = cast(Expr, substitute(mul(weight, value), on_curve, algebraic))
        return integral_over(body, s, where(disjunction(_IS_NEAREST, _IS_FARTHEST), MINUS_ONE, const(CROSSING)), ONE)

    def at_crossing(self, coefficient: Expr) -> Expr:
        """Returns ±inf if the integral diverges where two lines cross in the box and no candidate covers that place, else 0."""
        (m, n), beta = self.frame.across, self.frame.beta
        is_near = positive(sub(call("magnitude", beta), const(0.5 / REACH)))  # the crossing is no farther away than the size of the box
        away = div(const(-0.5), where(is_near, beta, ONE))
        steps = mul(n, away), mul(MINUS_ONE, m, away)
        boxes = zip(self.binders, self.form.middle, self.form.half, self.near.place, steps, strict=True)
        there = {b.var: add(c, mul(half, add(z, step))) for b, c, half, z, step in boxes}
        marks = list(dict.fromkeys(marks_of(coefficient)))
        (plain,) = replaced([coefficient], dict.fromkeys(marks, ONE))
        seen = mul(*(cast(Expr, substitute(mark, there)) for mark in marks))
        are_lines = negation(positive(call("magnitude", self.frame.h)))
        far = mul(const(LARGE), call("exact", mul(const(LARGE), sign_at(plain, there, self.binders), seen)))  # no inf·0, if it is covered
        return where(conjunction(are_lines, is_near), far, ZERO)


def _on_arc(g: Expr, variables: Sequence[Var], at: Sequence[Var]) -> Expr:
    """Returns a function at P + (U, V)/D, times a power of σD if it is a polynomial; `at` has P, the axes, U, V, D, σ and s."""
    places, parts, (sign, s) = at[:6], (at[6:9], at[9:12], at[12:15]), at[15:]
    along, over = (fresh(name, [*variables, *at]) for name in ("along", "over"))
    moves = [add(mul(a, along), mul(b, over)) for a, b in (places[2:4], places[4:6])]
    moved = cast(Expr, substitute(g, {x: add(start, move) for x, start, move in zip(variables, places[:2], moves, strict=True)}))
    polynomial = _cleared(moved, (along, over), parts, sign)
    if polynomial is not None:
        return _at(polynomial, s)
    z = integer_power(_at(parts[2], s), -1)
    return cast(Expr, substitute(moved, {along: mul(_at(parts[0], s), z), over: mul(_at(parts[1], s), z)}))


def _cleared(g: Expr, variables: tuple[Var, Var], parts: Sequence[Polynomial], sign: Expr, cleaned: bool = False) -> Polynomial | None:
    """Returns g(U/D, V/D)·(σD)ⁿ for a polynomial g of degree n, from U, V and D; None for other functions. With `cleaned`, coefficients
    are exactly 0 where they are rounding errors."""
    degree = Shadow(variables).degree(g)
    if degree is None or degree > MAX_DEGREE:
        return None
    terms: list[Polynomial] = []
    sizes: list[Polynomial] = []
    powers = [_powers(part, degree) for part in parts]
    origin = dict.fromkeys(variables, ZERO)
    for i in range(degree + 1):
        derivative = g
        for j in range(degree + 1 - i):
            factor = const(1.0 / (math.factorial(i) * math.factorial(j)))
            coefficient = mul(factor, cast(Expr, substitute(derivative, origin)))
            if coefficient is not ZERO:
                product = _product(_product(powers[0][i], powers[1][j]), powers[2][degree - i - j])
                terms.append(_scaled(coefficient, product))
                sizes.append(_scaled(mul(call("magnitude", factor), _size(coefficient)), [call("magnitude", e) for e in product]))
            derivative = slope(derivative, variables[1])
        g = slope(g, variables[0])
    whole = _total(*terms) if terms else [ZERO]
    if cleaned and terms:
        whole = [_cleaned(e, size) for e, size in zip(whole, _total(*sizes), strict=True)]
    return _scaled(sign if degree % 2 else ONE, whole)


def _powers(p: Polynomial, most: int) -> list[Polynomial]:
    """Returns the powers of a polynomial, from 0."""
    powers: list[Polynomial] = [[ONE]]
    for _ in range(most):
        powers.append(_product(powers[-1], p))
    return powers
