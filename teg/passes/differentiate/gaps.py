"""Sums over the gaps that candidates leave on a line: where an edge runs, with what covers its places.

    ∫ A(s)·m(s) ds      =  Σ over the gaps between covered intervals of ∫ A ds                                         `Gaps`
    ∂/∂t of it          =  Σ over the gaps of ∂/∂t of ∫ₗʳ A ds, in which ends move:  ∂l/∂t = -∂g/∂t / ∂g/∂s,  g(l) = 0

Places on an arc are told by the tangent of half the angle, in which conditions are polynomials. Cost: a visit a node.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.half_angle import in_half_angle, without_denominator
from teg.analysis.isolation import isolate
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import solve
from teg.analysis.surfaces import atoms_of, ordered
from teg.analysis.tails import is_unbounded
from teg.ir.cells import Symbols, replaced
from teg.ir.choices import NOTHING
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, And, Compare, Cond, Const, Expr, Mul, Param, Var, Where, const
from teg.ir.index import APART, Index, IndexVar
from teg.ir.integral import Integral, integral_over
from teg.ir.node import Node, postorder
from teg.ir.operands import less
from teg.ir.show import show
from teg.ir.simplify import add, bracket, call, conjunction, integer_power, mul, nonzero_part, positive, sub, where
from teg.ir.traverse import fresh, rewrite, substitute
from teg.ir.uncovered import VELOCITIES, Gaps
from teg.passes.normalise.partitions import Refused

SHOWN = 60
MOST_PLACES = 8
"""The largest number of places where the border of one candidate may cross an edge of another one."""
QUICK = 2
"""The largest degree of polynomials of which it is looked at whether an edge is seen at all."""
Rate = Callable[[Expr, Mapping[Param | Var, Expr]], Expr]
"""The derivative of a cell along a direction, in which more parameters change."""
LEFT, RIGHT = Param.make(f"{APART}left", ()), Param.make(f"{APART}right", ())


class Around(NamedTuple):
    """What covers places: an index and its range, the condition, and the same where it ties, as a number; `within` is a condition outside
    of which all places are covered. Charts look for a curve as far as `beyond` the upper bound of the inner variable, as a part of its
    range, so that all that is done along it has one chart."""

    over: tuple[IndexVar, Index, Index]
    condition: Cond
    tie: Expr
    within: Cond = TRUE
    beyond: float = 0.0


def placed(condition: Cond, at: Mapping[Var, Expr]) -> Cond:
    """Returns a condition at places, where each of its surfaces may tie."""

    def tying(old: Compare, g: Expr, _: Cond | None) -> Cond:
        return positive(g, old.strict, TRUE, old.rivals or (show(old.g, SHOWN), "the edge of another candidate"))

    return cast(Cond, substitute(condition, at, tying))


def over_gaps(node: Integral, around: Around, weight: Expr) -> Expr:
    """Returns the integral of a weight over what is not covered of the range of an integral."""
    s, lo, hi = node.var, node.lo, node.hi
    if weight is ZERO:
        return ZERO
    if is_unbounded(node):
        raise Refused("a bound is infinite")
    matters = _nonzero(weight)
    signs, weight = _without_signs(weight, s)
    symbols = Symbols()
    (cell, tie, *several) = symbols.into([cast(Expr, c) for c in (around.condition, around.tie, around.within, *matters)])
    on_line = _OnLine(cast(Cond, cell), tie, weight, cast("tuple[Cond, ...]", tuple(several)))
    by_half_angle = _by_half_angle(on_line, s) if _turns_less_than_once(lo, hi) else None
    condition, tie, weight, some = by_half_angle or _without_denominators(on_line, s)
    _check_roots([atom.g for atom in atoms_of(condition, s)], s)
    order = ordered(lo, hi)
    first, last = (lo, hi) if order > 0 else (hi, lo) if order < 0 else (call("min", lo, hi), call("max", lo, hi))
    sign = const(float(order)) if order else where(less(hi, lo, True), MINUS_ONE, ONE)
    if by_half_angle is not None:
        first, last = (call("tan", mul(const(0.5), end)) for end in (first, last))
    known = conjunction(*(placed(c, {s: s}) for c in some if _has_roots(c, s)))
    covered, tie, where_it_matters = symbols.out_of([bracket(condition), tie, bracket(known)])
    over = *around.over, s, LEFT, RIGHT
    term = integral_over(weight, s, LEFT, RIGHT)
    return mul(sign, *signs, cast(Expr, Gaps.make(over, (first, last, covered, tie, where_it_matters, term))))


def moved_gaps(node: Gaps, rate: Rate) -> Expr:
    """Returns the derivative of a sum over gaps along a direction. Raises Refused for a sum that is such a derivative itself."""
    if node.is_moving:
        raise Refused("it is differentiated more than twice")
    term = rate(node.term, dict(zip(node.ends, VELOCITIES, strict=True)))
    borders = {atom.g: atom for atom in atoms_of(node.covered, node.variable)}
    slopes = {g: slope(g, node.variable) for g in borders}  # 0 for what is one of several constants: it jumps at borders inside of it
    velocities = {g: mul(MINUS_ONE, rate(g, {}), integer_power(u, -1)) for g, u in slopes.items() if u is not ZERO}
    outer = [rate(end, {}) for end in cast("tuple[Expr, ...]", node.children[:2])]
    if all(v is ZERO for v in (*outer, *velocities.values())):
        (term,), outer, velocities = replaced([term], dict.fromkeys(VELOCITIES, ZERO)), [], {}
    if term is ZERO:
        return ZERO
    by_border = (where(borders[g], v, NOTHING) for g, v in velocities.items())
    return cast(Expr, Gaps.make(node.data, (*node.children[:5], term, *outer, *by_border)))


def _check_roots(functions: Sequence[Expr], s: Var) -> None:
    """Raises Refused if the roots of functions cannot be found along a line, or may be many."""
    count = 0
    for g in functions:
        isolation = None if any(isinstance(n, Integral) for n in postorder([g])) else isolate(g, s)
        if isolation is None:
            raise Refused("a condition has no roots that can be found along an edge")
        known = solve(g, s, LEFT, RIGHT)
        count += len(known.found) if known is not None and known.certain else isolation.count
    if count > MOST_PLACES:
        raise Refused(f"its border may cross an edge in more than {MOST_PLACES} places")


def _without_signs(weight: Expr, s: Var) -> tuple[list[Expr], Expr]:
    """Returns the factors of a weight that are one of two numbers on the whole line, and the others.

    Such a sign belongs to a condition around the line. Where both tie, both sides of the tie are averaged over their product, not over
    each of them.
    """
    condition, rest = nonzero_part(weight)
    if condition is not TRUE:
        signs, rest = _without_signs(rest, s)
        return signs, where(condition, rest, ZERO)
    signs, others = [], cast("list[Expr]", [])
    for factor in weight.children if isinstance(weight, Mul) else (weight,):
        if isinstance(factor, Where) and s not in factor.free and isinstance(factor.then, Const) and isinstance(factor.otherwise, Const):
            signs.append(factor)
        elif isinstance(factor, Where):
            more, factor = _without_signs(factor, s) if nonzero_part(factor)[0] is not TRUE else ([], factor)
            signs, others = [*signs, *more], [*others, factor]
        else:
            others.append(factor)
    return signs, mul(*others)


def _nonzero(weight: Expr) -> list[Cond]:
    """Returns conditions outside of which a weight is 0."""
    found: list[Cond] = []
    factors = [weight]
    while factors:
        factor = factors.pop()
        condition, rest = nonzero_part(factor)
        if condition is not TRUE:
            found += cast("Sequence[Cond]", condition.children) if isinstance(condition, And) else [condition]
            factors.append(rest)
        elif isinstance(factor, Mul):
            factors += factor.children
    return found


def _has_roots(condition: Cond, s: Var) -> bool:
    """Returns whether a condition changes where polynomials do that are solved quickly."""
    degrees = [Shadow((s,)).degree(atom.g) for atom in atoms_of(condition, s)]
    return all(degree is not None and degree <= QUICK for degree in degrees)


def _turns_less_than_once(lo: Expr, hi: Expr) -> bool:
    return all(isinstance(end, Const) and abs(end.data) < 0.99 * math.pi for end in (lo, hi))


class _OnLine(NamedTuple):
    """What covers places of a line, the same where it ties, the weight of places, and conditions outside of which places do not matter."""

    condition: Cond
    tie: Expr
    weight: Expr
    matters: tuple[Cond, ...]


def _without_denominators(on_line: _OnLine, s: Var) -> _OnLine:
    """Returns the same with polynomials in conditions where these have powers of one positive denominator."""

    def visit(_: Node, new: Node) -> Node:
        polynomial = without_denominator(new.g, s) if isinstance(new, Compare) and s in new.free else None
        return (
            new
            if polynomial is None
            else positive(polynomial, cast(Compare, new).strict, cast(Compare, new).resolution, cast(Compare, new).rivals)
        )

    conditions = (on_line.condition, *on_line.matters)
    found = rewrite(conditions, visit)
    condition, *matters = (cast(Cond, found[c]) for c in conditions)
    return on_line._replace(condition=condition, matters=tuple(matters))


def _by_half_angle(on_arc: _OnLine, angle: Var) -> _OnLine | None:
    """Returns the same by the tangent of half the angle, in which conditions are polynomials; None if the angle occurs elsewhere than in
    its cosine and sine, or in other functions of these than polynomials in a condition."""
    c, s = (fresh(name, on_arc.condition.free | on_arc.tie.free | on_arc.weight.free) for name in ("cos", "sin"))
    circular: dict[Node, Node] = {call("cos", angle): c, call("sin", angle): s}
    roots = (on_arc.condition, on_arc.tie, on_arc.weight, *on_arc.matters)
    on_circle = rewrite(roots, lambda _, new: circular.get(new, new))
    condition = cast(Cond, on_circle[on_arc.condition])
    tie, weight = (cast(Expr, on_circle[e]) for e in roots[1:3])
    half, mark = mul(const(0.5), angle), fresh("half", [c, s, angle])
    short = call("sqrt", integer_power(add(ONE, integer_power(mark, 2)), -1))
    halves: dict[Node, Node] = {call("tan", half): mark, call("sin", half): mul(mark, short), call("cos", half): short}
    weight = cast(Expr, rewrite([weight], lambda _, new: halves.get(new, new))[weight])
    if condition.free.isdisjoint((c, s)) or any(angle in e.free for e in (condition, tie, weight)):
        return None
    unknown: list[Node] = []

    def visit(_: Node, new: Node) -> Node:
        if not isinstance(new, Compare) or new.free.isdisjoint((c, s)):
            return new
        polynomial = in_half_angle(new.g, c, s, angle)
        if polynomial is None:
            unknown.append(new)
            return new
        return positive(polynomial, new.strict, new.resolution, new.rivals)

    condition = cast(Cond, rewrite([condition], visit)[condition])
    if unknown:
        return None
    conditions = [on_circle[m] for m in on_arc.matters]
    matters = tuple(cast(Cond, new) for new in map(rewrite(conditions, visit).__getitem__, conditions) if new.free.isdisjoint((c, s, mark)))
    z = integer_power(add(ONE, integer_power(angle, 2)), -1)
    at: dict[Var, Expr] = {c: sub(mul(const(2.0), z), ONE), s: mul(const(2.0), angle, z), mark: angle}
    tie, weight = (cast(Expr, substitute(e, at)) for e in (tie, weight))
    return _OnLine(condition, tie, mul(const(2.0), z, weight), matters)
