"""Surfaces that are affine in one or several variables together: planes, lines, points.

    g = g₀ + Σ aᵢ·(vᵢ - lᵢ)      with g₀ the value at the corner of the box, as the user wrote it, and aᵢ = ∂g/∂vᵢ

The origin of a variable whose bounds are far apart is 0, or a bound near 0, not lᵢ: a line near 0 would be known to the rounding of lᵢ.

Change of variables with u = g. At run time the variable v_k with the largest |aᵢ|·extent(vᵢ) is eliminated and the others run over their
own ranges, vᵢ = lᵢ + sᵢ·(hᵢ - lᵢ) with sᵢ in (0, 1):

    ∫…∫ w δ(g) dv = ∫₀¹…∫₀¹ w·Π_{i≠k}(hᵢ - lᵢ)/|a_k| · ([v_k < h_k] - [v_k < l_k]) ds

All pivots share this one integral: the selection is made among the numbers of the map, not among integrals. Exact also if a coefficient
is 0 or 1e-12 and if the box is 1 × 1e-8. The selection depends on parameters only, so it has no flux.

A side of a polygon whose vertices are known has a chart of its own, from vertex to vertex (`teg.passes.eliminate.vertices`): there is no
pivot to select, and other sides through its ends clip nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import distance
from teg.analysis.guards import middle_and_reach, support
from teg.analysis.nest import Binder, Chain, nest, ranges_of
from teg.analysis.polynomial import Point
from teg.analysis.roots import NEAR, is_met, local_origin
from teg.analysis.surfaces import below, free_of, is_affine, ordered, restrict, signed_between, signed_inside
from teg.analysis.tails import is_unbounded
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, And, Call, Compare, Cond, Const, Expr, Not, Param, Var, const
from teg.ir.node import Node
from teg.ir.simplify import add, call, conjunction, disjunction, div, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, rewrite, substitute
from teg.numerics.field import residue
from teg.passes.eliminate.barycentric import Along
from teg.passes.eliminate.univariate import sum_over_roots
from teg.passes.eliminate.vertices import Side, match_side


@dataclass(frozen=True)
class Affine:
    """g is jointly affine in `variables` (outermost first), with coefficients free of them."""

    variables: tuple[Var, ...]

    name = "affine"
    moves = False


def match_affine(g: Expr, variables: Sequence[Var]) -> Affine | None:
    """Returns the match of `match_partly_affine` if it cannot fail at run time: g is affine in all its variables, or a
    slope is a number."""
    data = match_partly_affine(g, variables)
    if data is None:
        return None
    whole = len(data.variables) == sum(v in g.free for v in variables)
    return data if whole or any(isinstance(slope(g, v), Const) for v in data.variables) else None


def match_partly_affine(g: Expr, variables: Sequence[Var]) -> Affine | None:
    """Returns the largest set of variables, given innermost first, in which g is jointly affine; inner variables are preferred."""
    best: list[Var] = []
    for first in variables:
        if first not in g.free:
            continue
        chosen = [first]
        if not is_affine(g, chosen):
            continue
        for other in variables:
            if other is not first and other in g.free and is_affine(g, [*chosen, other]):
                chosen.append(other)
        if len(chosen) > len(best):
            best = chosen
    order = {v: i for i, v in enumerate(variables)}
    return Affine(tuple(sorted(best, key=lambda v: -order[v]))) if best else None


def match_turning(g: Expr, variables: Sequence[Var]) -> Affine | None:
    """Returns a match for a surface that turns as further variables change, with a gradient of constant length: a rotating line.

    It cannot degenerate there, and one of its variables is eliminated in closed form at each position; the pivot changes with the
    position. The variables are the innermost ones, two at least.
    """
    data = match_partly_affine(g, variables)
    mine = [v for v in variables if v in g.free]
    if data is None or len(data.variables) < 2 or set(mine[: len(data.variables)]) != set(data.variables):
        return None
    return data if _is_the_same_everywhere(add(*(simplify.integer_power(slope(g, v), 2) for v in data.variables))) else None


def _is_the_same_everywhere(e: Expr) -> bool:
    """Returns whether e is constant in its variables, decided in the field.

    Sine and cosine of one angle are rational functions of the tangent of its half, so that sin² + cos² is 1.
    """
    halves: dict[Expr, Param] = {}

    def visit(old: Node, new: Node) -> Node:
        if not isinstance(new, Call) or new.name not in ("sin", "cos") or not old.free:
            return new
        h = halves.setdefault(new.children[0], Param.make(f"half of angle {len(halves)}", ()))
        square = simplify.integer_power(h, 2)
        return div(mul(const(2.0), h) if new.name == "sin" else sub(ONE, square), add(ONE, square))

    rational = cast(Expr, rewrite([e], visit)[e])
    moving: list[Expr] = [*halves.values(), *(v for v in rational.free if isinstance(v, Var))]
    values = [Point(leaves={m: residue(trial, str(m)) for m in moving}).value(rational) for trial in range(2)]
    return values[0] is not None and values[0] == values[1]


def rewrite_affine(g: Expr, coefficient: Expr, chain: Chain, data: Affine) -> Expr | None:
    """Returns ∫ over the chain (outermost first) of coefficient·δ(g), without δ; None if the ranges of the variables are not known."""
    chosen = [b for b in chain if b.var in data.variables]
    others = tuple(b for b in chain if b.var not in data.variables)
    ranges = ranges_of(chosen)
    if ranges is not None and any(isinstance(e, Const) and math.isinf(e.data) for ends in ranges for e in ends):
        return _solved(g, coefficient, chain, chosen)
    if ranges is None or not all(free_of(e, [r.var for r in others]) for b in chosen for e in (b.lo, b.hi)):
        return None
    corner = {b.var: lo for b, (lo, _) in zip(chosen, ranges, strict=True)}
    origins = [local_origin(lo, hi) if len(chosen) == 1 or _may_be_long(lo, hi) else lo for lo, hi in ranges]
    extents = [distance(lo, hi) for lo, hi in ranges]
    if len(chosen) == 2 and not others:
        side = match_side(g, support(coefficient), (chosen[1].var, chosen[0].var))
        if side is not None:
            met = conjunction(*_meeting(g, coefficient, corner, extents))
            return _between_vertices(g, coefficient, chosen, ranges, side, met)
    g0 = cast(Expr, substitute(g, {b.var: o for b, o in zip(chosen, origins, strict=True)}))
    slopes = [cast(Expr, substitute(slope(g, b.var), corner)) for b in chosen]
    pivots = _pivot_conditions(slopes, extents)
    taken = set(coefficient.free) | set(g.free) | {v for b in chain for v in (b.var, *b.lo.free, *b.hi.free)}
    unit = [_next_unit(taken) for _ in chosen[1:]]
    point, weight, guard = _chart(origins, extents, slopes, g0, pivots, unit)
    at = {b.var: p for b, p in zip(chosen, point, strict=True)}
    directions = tuple(reversed([b.var for b in chosen]))
    value = mul(weight, restrict(coefficient, at, g, directions))
    for b in others:
        if not free_of(b.lo, at) or not free_of(b.hi, at):
            if any(r.var in g.free for r in others):
                return None
            others = tuple(Binder(r.var, cast(Expr, substitute(r.lo, at)), cast(Expr, substitute(r.hi, at))) for r in others)
            break
    value = _inside_bounds(value, g, chosen, ranges, point, pivots)
    if len(chosen) > 1 and not others:
        guard = conjunction(guard, *_meeting(g, coefficient, corner, extents))
    value = where(guard, value, ZERO)
    along = _unit_binders(unit, pivots, origins, ranges)
    turning = not all(free_of(end, [b.var for b in others]) for u in along for end in (u.lo, u.hi))  # the pivot changes with them
    return nest(value, (*others, *along) if turning else (*along, *others))


def _may_be_long(lo: Expr, hi: Expr) -> bool:
    """Returns whether a bound may be far away where the variable is near 0."""
    numbers = [abs(e.data) for e in (lo, hi) if isinstance(e, Const)]
    return max(numbers) > NEAR if len(numbers) == 2 else not isinstance(lo, Const) and bool(numbers) and numbers[0] <= NEAR


def _unit_binders(unit: Sequence[Var], pivots: list[Cond], origins: Sequence[Expr], ranges: Sequence[tuple[Expr, Expr]]) -> list[Binder]:
    """Returns the unit variables with their bounds, (0, 1) where the origin is the lower bound of what they stand for."""
    ends: list[tuple[Expr, Expr]] = []
    for o, (lo, hi) in zip(origins, ranges, strict=True):
        if o is lo or o is hi:
            ends.append((ZERO, ONE) if o is lo else (MINUS_ONE, ZERO))
        else:
            ends.append((div(sub(lo, o), distance(lo, hi)), div(sub(hi, o), distance(lo, hi))))
    others = [[e for i, e in enumerate(ends) if i != k] for k in range(len(ends))]  # for each pivot
    return [Binder(s, *(_select(pivots, [others[k][j][end] for k in range(len(ends))]) for end in (0, 1))) for j, s in enumerate(unit)]


def _solved(g: Expr, coefficient: Expr, chain: Chain, chosen: Sequence[Binder]) -> Expr | None:
    """Returns the integral with one variable solved for the others, where extents are infinite: the one with the largest slope, chosen at
    run time if no slope is a number. Other bounds must not depend on that variable; None if it cannot be known to be there.

    Among the variables whose slopes are numbers one of infinite extent is taken, if there is one: the others have closed ends.
    """
    inner = [b for b in chosen if all(free_of(e, (b.var,)) for c in chain for e in (c.lo, c.hi))]
    known = [b for b in inner if isinstance(slope(g, b.var), Const)]
    endless = [b for b in known if is_unbounded(b)]
    candidates = (endless or known)[-1:] or inner
    if not known and len(inner) < len(chosen):
        return None
    terms: list[Expr] = []
    for b in candidates:
        total = sum_over_roots(g, coefficient, b, (b.var,))
        if total is None:
            return None
        terms.append(nest(total, tuple(c for c in chain if c is not b)))
    at = dict.fromkeys((b.var for b in chosen), ZERO)
    slopes = [cast(Expr, substitute(slope(g, b.var), at)) for b in candidates]
    if any(isinstance(a, Const) for a in slopes):
        return terms[0]
    return where(is_met(slopes, cast(Expr, substitute(g, at))), _select(_pivot_conditions(slopes, [ONE] * len(slopes)), terms), ZERO)


def _between_vertices(
    g: Expr, coefficient: Expr, chosen: Sequence[Binder], ranges: Sequence[tuple[Expr, Expr]], side: Side, met: Cond
) -> Expr:
    """Returns the integral over a side of a polygon from vertex to vertex, clipped by all bounds."""
    s = fresh("s", {*coefficient.free, *g.free, *(v for b in chosen for v in (b.var, *b.lo.free, *b.hi.free))})
    inner_first = (chosen[1], chosen[0])
    at = dict(zip((b.var for b in inner_first), side.at(s), strict=True))
    value = mul(side.weight, restrict(coefficient, at, g, tuple(at)))
    for b in inner_first:
        lo, hi = (cast(Expr, substitute(e, at)) for e in (b.lo, b.hi))
        value = signed_inside(at[b.var], lo, hi, g, b, value)
    first, last, two = side.reach(ranges[::-1])
    return nest(where(conjunction(two, met), Along(side, s).simplified(value), ZERO), (Binder(s, first, last),))


def _meeting(g: Expr, coefficient: Expr, corner: dict[Var, Expr], extents: list[Expr]) -> list[Cond]:
    """Returns conditions without which no part of the surface is inside the box, or of the box inside the support:
    known before any chart."""
    wanted = support(coefficient)
    met: list[Cond] = []
    for part in (positive(g), *(wanted.children if isinstance(wanted, And) else (wanted,))):
        atom = part.operand if isinstance(part, Not) else part
        if (
            not isinstance(atom, Compare)
            or not set(atom.g.free) <= set(corner)
            or not is_affine(atom.g, [v for v in corner if v in atom.g.free])
        ):
            continue
        middle, reach = middle_and_reach(atom.g, corner, extents)
        if atom.g is g or not isinstance(part, Not):
            met.append(positive(add(middle, reach), strict=False))
        if atom.g is g or isinstance(part, Not):
            met.append(positive(add(mul(MINUS_ONE, middle), reach), strict=False))
    return met


def _next_unit(taken: set[Var]) -> Var:
    s = fresh("s", taken)
    taken.add(s)
    return s


def _pivot_conditions(slopes: list[Expr], extents: list[Expr]) -> list[Cond]:
    """Returns, for each k, the condition that number k has the largest |aᵢ|·extentᵢ, the innermost one if several do. Exactly one holds."""
    sizes = [_magnitude(mul(a, d)) for a, d in zip(slopes, extents, strict=True)]
    conditions: list[Cond] = []
    left: Cond = TRUE
    for k in range(len(sizes) - 1, -1, -1):
        wins = conjunction(*(positive(sub(sizes[k], s), strict=False) for s in sizes[:k]))
        conditions.append(conjunction(left, wins))
        left = conjunction(left, negation(wins))
    return conditions[::-1]


def _magnitude(e: Expr) -> Expr:
    return ex.const(abs(e.data)) if isinstance(e, Const) else call("magnitude", e)


def _select(pivots: list[Cond], values: list[Expr]) -> Expr:
    """Returns values[k] where pivot k is chosen."""
    result = values[0]
    for condition, value in zip(pivots[1:], values[1:], strict=True):
        result = where(condition, value, result)
    return result


def _chart(
    origins: Sequence[Expr],
    extents: list[Expr],
    slopes: list[Expr],
    g0: Expr,
    pivots: list[Cond],
    unit: list[Var],
) -> tuple[list[Expr], Expr, Cond]:
    """Returns each variable as a function of the unit variables, the weight, and the condition that there is a surface at all."""
    n = len(origins)
    others = [[i for i in range(n) if i != k] for k in range(n)]  # for each pivot
    pivot = _select(pivots, slopes)
    inverse = simplify.integer_power(pivot, -1)
    offset = mul(MINUS_ONE, g0, inverse)
    steps = [  # of the pivot's variable, for each unit variable
        mul(MINUS_ONE, _select(pivots, [mul(slopes[others[k][j]], extents[others[k][j]]) for k in range(n)]), inverse)
        for j in range(len(unit))
    ]
    point = []
    for i in range(n):
        rates = [
            _select(pivots, [step if k == i else extents[i] if others[k][j] == i else ZERO for k in range(n)])
            for j, step in enumerate(steps)
        ]
        away = _select(pivots, [offset if k == i else ZERO for k in range(n)])
        point.append(add(origins[i], away, *(mul(rate, s) for rate, s in zip(rates, unit, strict=True))))
    weight = div(_select(pivots, [mul(*(extents[i] for i in others[k])) for k in range(n)]), _magnitude(pivot))
    return point, weight, positive(_magnitude(pivot))


def _inside_bounds(
    value: Expr,
    g: Expr,
    chosen: Sequence[Binder],
    ranges: Sequence[tuple[Expr, Expr]],
    point: list[Expr],
    pivots: list[Cond],
) -> Expr:
    """Returns the brackets of the eliminated variable, and of every variable whose bounds were widened to a range."""
    at = {b.var: p for b, p in zip(chosen, point, strict=True)}
    widened = [i for i, (b, r) in enumerate(zip(chosen, ranges, strict=True)) if r != (b.lo, b.hi)]
    for i in widened:
        b = chosen[i]
        lo, hi = cast(Expr, substitute(b.lo, at)), cast(Expr, substitute(b.hi, at))
        value = signed_inside(point[i], lo, hi, g, b, value)
    plain = [i for i in range(len(chosen)) if i not in widened]
    if not plain:
        return value
    if len(plain) == 1 and len(chosen) == 1:
        (b,) = chosen
        return signed_inside(point[0], b.lo, b.hi, g, b, value)
    sides: list[tuple[Cond, Cond]] = []
    for i in range(len(chosen)):
        b = chosen[i]
        if i in widened:
            sides.append((TRUE, ex.FALSE))
        else:
            sides.append((below(point[i], b.hi, g, b.var, b.hi), below(point[i], b.lo, g, b.var, b.lo)))
    under_hi, under_lo = _select_bound(pivots, sides, 0), _select_bound(pivots, sides, 1)
    orders = {ordered(*ranges[i]) for i in plain} | ({1} if widened else set())
    return signed_between(under_hi, under_lo, orders.pop() if len(orders) == 1 else 0, value)


def _select_bound(pivots: list[Cond], sides: list[tuple[Cond, Cond]], which: int) -> Cond:
    """Returns [v < bound] of the eliminated variable as one atom whose two sides are selected, so that the integrator has one surface."""
    conditions = [side[which] for side in sides]
    if all(isinstance(c, Compare) for c in conditions):
        atoms = [cast(Compare, c) for c in conditions]
        g = _select(pivots, [a.g for a in atoms])
        resolution: Cond = disjunction(*(conjunction(p, r) for p, r in zip(pivots, [cast(Cond, a.resolution) for a in atoms], strict=True)))
        rivals = [cast("tuple[str, str]", a.rivals) for a in atoms]
        return positive(g, True, resolution, (rivals[0][0], " or ".join(dict.fromkeys(other for _, other in rivals))))
    return disjunction(*(conjunction(p, c) for p, c in zip(pivots, conditions, strict=True)))
