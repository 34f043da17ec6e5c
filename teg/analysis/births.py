"""Births of level sets at critical points with a formula: what ∫∫ w·δ(g) is where the level of g is a critical value.

For g that is no quadric, at a point p of the box with g = 0 and ∇g = 0 and the Hessian H:

    two variables     det H > 0    the set is born as an ellipse: w(p)·π/√det H, the mean of 0 and 2π·w(p)/√det H
                      else         ±∞: areas grow as a power of the level that is less than 1, or by its logarithm
    three variables   rank H >= 2  0: volumes grow faster than the level
                      else         not a number: the power is not known

Critical points on the border of the box give no number, and lines of them neither. Those that have no formula are not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.critical import ROUNDING, finite_box
from teg.analysis.evaluate import values_of
from teg.analysis.nest import Binder, Chain
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import Root, solve, tidy
from teg.analysis.surfaces import atoms_of, binders_inside
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError, OperandError
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Cond, Const, Expr, Mul, Pow, Var, const
from teg.ir.node import Node
from teg.ir.show import show
from teg.ir.simplify import add, call, conjunction, disjunction, integer_power, mul, negation, nonzero_part, positive, sub, where
from teg.ir.traverse import parameters, substitute

MAX_POINTS = 16
"""The largest number of critical points whose terms are written out."""
FLAT = 1e-10
"""A determinant, or a sum of minors, that is larger than this part of the squared sizes of the entries is not 0."""
SMALL = 1e-9
"""A part of the size of a function elsewhere: a value that is not larger is 0 but for rounding."""
HUGE = 1e300
"""Larger derivatives and coordinates are infinite."""
LEVEL = 1e-24
"""A determinant that is not larger than this part of the squared sizes of the entries is 0."""

Point = tuple[dict[Var, Expr], Cond]
"""A critical point, or a line of them, on which one variable is free, and the condition under which it exists."""


def at_births(g: Expr, coefficient: Expr, chain: Chain) -> Expr:
    """Returns what ∫∫ coefficient·δ(g) over a chain has at critical points of g at which g is 0."""
    variables = [b.var for b in chain]
    if not 2 <= len(chain) <= 3 or coefficient.has_delta or not g.free <= set(variables):
        return ZERO
    try:
        gradient = [slope(g, v) for v in variables]
        hessian = [[slope(s, v) for v in variables] for s in gradient]
        points = critical_points(gradient, chain)
    except NotDifferentiableError:
        return ZERO
    if any(_is_multiple(coefficient, s) for s in gradient):
        return ZERO
    terms = []
    for point, exists in points or ():
        if any(_is_nowhere(e) for e in point.values()):  # as that of a parabola
            continue
        level = _at(g, point)
        if level.free or _is_always_0(level, g):  # no line of critical points; or a point that stays singular, as the cusp of a cardioid
            continue
        here = [[_at(h, point) for h in row] for row in hessian]
        value = _on_line(point, here, chain) if len(point) < len(chain) else _at_point(point, coefficient, here, chain)
        near = [positive(sub(const(HUGE), call("magnitude", e))) for e in point.values() if not (e.free or isinstance(e, Const))]
        terms.append(where(conjunction(exists, *near, _is_tie(g, level)), value, ZERO))
    return add(*terms)


def _is_multiple(coefficient: Expr, rate: Expr) -> bool:
    """Returns whether a coefficient is F·∂g/∂x: as ∫ F·∂g/∂x·δ(g) dx = -∫ ∂F/∂x·[g > 0] dx, a birth adds nothing."""
    have = _powers(nonzero_part(coefficient)[1])
    return all(have.get(b, 0) >= n > 0 for b, n in _powers(rate).items() if not isinstance(b, Const))


def _at_point(point: Mapping[Var, Expr], coefficient: Expr, hessian: Sequence[Sequence[Expr]], chain: Chain) -> Expr:
    """Returns what a critical point adds; NaN where it is on the border of the box or of a condition in the coefficient."""
    around = [finite_box(Binder(b.var, _at(b.lo, point), _at(b.hi, point))) for b in chain]
    extents = [sub(b.hi, b.lo) for b in around]
    scaled = [[mul(h, a, b) for h, b in zip(row, extents, strict=True)] for row, a in zip(hessian, extents, strict=True)]
    value = _flux(_at(coefficient, point), scaled, extents)
    inner = binders_inside(coefficient)
    borders = (_is_tie(c.g, _at(c.g, point)) for c in atoms_of(coefficient) if not c.g.free & inner)
    value = where(disjunction(*borders), const(math.nan), value)
    for b in chain:
        value = _within(point, b, value)
    return value


def _on_line(point: Mapping[Var, Expr], hessian: Sequence[Sequence[Expr]], chain: Chain) -> Expr:
    """Returns NaN for a line of critical points, where the power of the distance from it decides; 0 where a straight line is outside of
    the box, or its Hessian is infinite."""
    if len(chain) != 2 or len(point) != 1:
        return const(math.nan)
    ((v, place),) = point.items()
    (mine,), (other,) = ([b for b in chain if (b.var is v) == wanted] for wanted in (True, False))
    if is_unbounded(other) or is_unbounded(mine) or Shadow((other.var,)).degree(place) not in (0, 1) or v in other.lo.free | other.hi.free:
        return const(math.nan)
    ends = [{other.var: e} for e in (other.lo, other.hi)]
    extents = [_at(sub(mine.hi, mine.lo), end) for end in ends]
    before = [positive(mul(_at(sub(mine.lo, place), end), extent)) for end, extent in zip(ends, extents, strict=True)]
    behind = [positive(mul(_at(sub(place, mine.hi), end), extent)) for end, extent in zip(ends, extents, strict=True)]
    outside = disjunction(conjunction(*before), conjunction(*behind))
    at_end = _at(add(*(call("magnitude", h) for row in hessian for h in row)), ends[0])
    finite = positive(sub(const(HUGE), at_end))
    return where(conjunction(negation(outside), finite), const(math.nan), ZERO)


def _is_tie(g: Expr, value: Expr) -> Cond:
    """Returns whether the value of g at a critical point is 0 to rounding: then one of two opposite resolutions holds, in each order."""
    rivals = (show(g, 300) + " = 0", "its own critical point, where a region is born or branches meet")
    one, other = (positive(value, True, resolution, rivals) for resolution in (TRUE, FALSE))
    return disjunction(conjunction(one, negation(other)), conjunction(other, negation(one)))


def _flux(there: Expr, hessian: Sequence[Sequence[Expr]], extents: Sequence[Expr]) -> Expr:
    """Returns what a critical point adds where the coefficient has the value `there`. The Hessian is that by parts of the extents."""
    nan, endless = const(math.nan), const(math.inf)
    pairs = combinations(range(len(hessian)), 2)
    minors = [sub(mul(hessian[i][i], hessian[k][k]), integer_power(hessian[i][k], 2)) for i, k in pairs]
    scale = integer_power(add(*(call("magnitude", h) for row in hessian for h in row)), 2)
    if len(hessian) == 3:
        total = add(*(call("magnitude", m) for m in minors))
        return where(positive(sub(total, mul(const(FLAT), scale))), ZERO, nan)
    (det,) = minors
    mean = mul(const(math.pi), *(call("magnitude", e) for e in extents), there, integer_power(call("root", det), -1))
    signed = where(positive(there), endless, where(positive(mul(MINUS_ONE, there)), mul(MINUS_ONE, endless), nan))
    flat = where(positive(sub(mul(const(LEVEL), scale), det), strict=False), signed, nan)
    return where(positive(sub(det, mul(const(FLAT), scale))), mean, flat)


def _within(point: Mapping[Var, Expr], b: Binder, value: Expr) -> Expr:
    """Returns a value strictly between bounds, NaN on one of them, 0 outside."""
    lo, hi = (_at(e, point) for e in (b.lo, b.hi))
    for bound, other in ((lo, hi), (hi, lo)):
        if isinstance(bound, Const) and math.isinf(bound.data):
            continue
        toward = positive(sub(other, bound))
        away = where(toward, sub(point[b.var], bound), sub(bound, point[b.var]))
        far = ONE if isinstance(other, Const) and math.isinf(other.data) else call("magnitude", sub(other, bound))
        room = mul(const(ROUNDING), add(far, call("magnitude", bound)))
        inside = positive(sub(away, room))
        value = where(inside, value, where(positive(add(away, room), strict=False), const(math.nan), ZERO))
    return value


def critical_points(gradient: Sequence[Expr], chain: Chain) -> list[Point] | None:
    """Returns the common zeros of the derivatives of a surface if they have formulas, at most MAX_POINTS; else None."""
    waiting: list[tuple[dict[Var, Expr], Cond, tuple[Expr, ...]]] = [({}, TRUE, tuple(gradient))]
    points: dict[tuple[Expr, ...], Point] = {}
    while waiting:
        at, exists, equations = waiting.pop()
        unknown = [b for b in chain if b.var not in at]
        if not unknown or not equations:
            points.setdefault(tuple(at.get(b.var, b.var) for b in chain), (at, exists))
        elif len(waiting) + len(points) >= MAX_POINTS:
            return None
        else:
            zeros = next((z for e in equations for form in (e, tidy(e)) if (z := _zeros(form, unknown))), None)
            if zeros is None:
                return None
            for v, root in zeros:
                new = {v: root.point}
                known = {k: _at(e, new) for k, e in at.items()} | new
                holds = conjunction(cast(Cond, substitute(exists, new)), root.exists)
                left = [_at(e, new) for e in equations]
                if holds is not FALSE and not any(map(_is_never_met, left, equations)):
                    waiting.append((known, holds, tuple(e for e in left if e.free)))
    return list(points.values())


def _is_never_met(equation: Expr, before: Expr) -> bool:
    """Returns whether an equation is left without variables and does not hold, but for some values of its parameters; `before` is what it
    was."""
    return not equation.free and math.isfinite(_somewhere(equation)) and not _is_always_0(equation, before)


def _is_always_0(value: Expr, function: Expr) -> bool:
    """Returns whether a value of a function is 0 whatever its parameters are, but for rounding."""
    size = _somewhere(function)
    return _somewhere(value) <= SMALL * (size if 0.0 < size < math.inf else 1.0)


def _is_nowhere(coordinate: Expr) -> bool:
    """Returns whether a coordinate is no number, but for some values of its parameters: 0/0 where two equations are one."""
    value = _value_somewhere(coordinate)
    return value is not None and not math.isfinite(value)


def _somewhere(e: Expr) -> float:
    """Returns the size of an expression at one place of its variables and parameters; infinity where it has none."""
    value = _value_somewhere(e)
    return math.inf if value is None or math.isnan(value) else abs(value)


def _value_somewhere(e: Expr) -> float | None:
    """Returns an expression at one place of its variables and parameters; None if it is none of these alone."""
    names: list[Node] = [*sorted(e.free, key=str), *parameters(e)]
    try:
        return float(values_of([e], {name: 0.37 + 0.11 / (k + 1.0) for k, name in enumerate(names)})[0])
    except OperandError:
        return None


def _zeros(e: Expr, unknown: Sequence[Binder]) -> list[tuple[Var, Root]]:
    """Returns where an expression is 0, solved for one of its unknowns, factor by factor; an empty list if it is not known."""
    found: list[tuple[Var, Root]] = []
    stack: list[tuple[Expr, Cond]] = [(e, TRUE)]
    while stack:
        factor, exists = stack.pop()
        mine = [b for b in unknown if b.var in factor.free]
        if not mine or _is_never_0(factor):
            continue
        parts = _factors(factor)
        if parts is not None:
            holds = positive(factor.children[1]) if isinstance(factor, Call) else TRUE
            stack.extend((cast(Expr, part), conjunction(exists, holds)) for part in parts)
            continue
        roots = next(((b.var, r) for b in mine if (r := _solved(factor, b)) is not None), None)
        if roots is None:
            return []
        found.extend((roots[0], Root(r.point, conjunction(exists, r.exists))) for r in roots[1])
    return found


def _is_never_0(e: Expr) -> bool:
    return (isinstance(e, Pow) and e.exponent < 0) or (isinstance(e, Call) and e.name in ("exp", "cosh"))


def _factors(e: Expr) -> Sequence[Node] | None:
    """Returns expressions whose zeros together are those of a product, of a power, or of a sum with a common factor; else None."""
    if isinstance(e, Mul):
        return e.children
    if isinstance(e, Pow) or (isinstance(e, Call) and e.name == "pow"):
        return e.children[:1]
    if not isinstance(e, Add):
        return None
    terms = [_powers(t) for t in e.children]
    common = {b: n for b in terms[0] if b.free and (n := min(t.get(b, 0) for t in terms)) > 0}
    if not common:
        return None
    return [*common, add(*(mul(*(integer_power(b, n - common.get(b, 0)) for b, n in t.items())) for t in terms))]


def _powers(term: Node) -> dict[Expr, int]:
    """Returns the factors of a product and their powers."""
    powers: dict[Expr, int] = {}
    for f in cast("tuple[Expr, ...]", term.children if isinstance(term, Mul) else (term,)):
        base, n = (f.base, f.exponent) if isinstance(f, Pow) else (f, 1)
        powers[base] = powers.get(base, 0) + n
    return powers


def _solved(e: Expr, b: Binder) -> tuple[Root, ...] | None:
    """Returns the roots in a variable if they have formulas; else None."""
    bounds = (b.lo, b.hi) if not (b.lo.free or b.hi.free) else (const(-math.inf), const(math.inf))
    roots = solve(e, b.var, *bounds)
    if roots is None or not roots.certain:
        return None
    return tuple(r for r in roots.found if not _is_outside(r.point, *bounds))


def _is_outside(point: Expr, lo: Expr, hi: Expr) -> bool:
    """Returns whether a point is known not to be between bounds."""
    if not (isinstance(point, Const) and isinstance(lo, Const) and isinstance(hi, Const)):
        return False
    least, most = sorted((lo.data, hi.data))
    return bool(point.data < least or point.data > most)


def _at(e: Expr, point: Mapping[Var, Expr]) -> Expr:
    return cast(Expr, substitute(e, point))
