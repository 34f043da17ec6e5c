"""Integrals of integrands with a singularity between the bounds, in the distance from the singularity.

    ∫ₗʰ F(x, g) dx  =  Σᵢ ∫ F(cᵢ + w, A·Π_k (w + (cᵢ - r_k))) dw         w from aᵢ - cᵢ to aᵢ₊₁ - cᵢ

over the roots cᵢ of the singular arguments g, several of degree 1 or one of degree 2, in ascending order, with r_k the roots of g, A its
leading coefficient, and aᵢ half-way between neighbouring roots. Computed from x, a distance x - c is known to the rounding of x; (x -
c)^-0.9 then has no correct digit where a tenth of the integral comes from, and a g that is rounded to 0, or below, makes an infinity or
NaN. Near cᵢ the distance w is the variable itself: cᵢ - r_k is exactly 0 there. A root outside of the bounds is moved to the nearest
bound. One copy of the integrand a root.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.extents import extent
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import Root, solve
from teg.analysis.singularities import SMOOTH, Keys, order_at, sharp_nodes, singular_arguments
from teg.analysis.surfaces import binders_inside
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Compare, Cond, Const, Expr, Mul, Pow, Var, Where, const, is_infinite
from teg.ir.integral import Integral, integral_over, masses_of
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, integer_power, mul, positive, sub, where
from teg.ir.traverse import fresh, rewrite, rewritten, substitute

MAX_CENTRES = 3
"""An integrand with more singular points is left as it is."""


def centred(root: Expr) -> Expr:
    """Returns the program with integrals over the distance from their singularities; the same node if there are none."""
    sharp = sharp_nodes([root])
    if not sharp:
        return root
    keys = Keys()

    def visit(old: Node, new: Node) -> Node:
        return _centred(new, keys) if old in sharp and isinstance(new, Integral) else new

    return rewritten(root, Integral.bit, visit)


@dataclass(frozen=True)
class _Argument:
    """A singular argument g: its roots in ascending order, and the condition that they exist."""

    g: Expr
    roots: tuple[Expr, ...]
    exists: Cond


def _centred(node: Integral, keys: Keys) -> Expr:
    x = node.var
    if masses_of(node.body, x) is not None:
        return node  # a sum over roots, wherever these are: no interval to split
    arguments = _arguments(node, keys)
    alone = bool(node.free) or any(len(a.roots) == 2 for a in arguments)  # roots that cross each other would make kinks outside
    if not arguments or len(arguments) > (1 if alone else MAX_CENTRES):
        return node
    low, high, sign = _ascending(node.lo, node.hi)
    centres = [between(r, low, high) for a in arguments for r in a.roots]
    centres = centres if len(arguments) == 1 else in_order(centres)
    splits = [mul(const(0.5), add(c, d)) for c, d in pairwise(centres)]
    by_key = {keys.of(a.g): a for a in arguments}
    body = _with_powers(node.body, by_key, keys)
    names: dict[Node, Var] = {}
    taken = {x, *body.free, *binders_inside(body)}

    def named(old: Node, new: Node) -> Node:
        """Returns a name for every node that is proportional to an argument."""
        if isinstance(new, Expr) and x in new.free and _is_surface(new) and keys.of(new) in by_key:
            return names.setdefault(new, fresh("g", {*taken, *names.values()}))
        return new

    skeleton = cast(Expr, rewrite([body], named)[body])
    pieces = []
    skeleton, centre, distance = _around_centre(skeleton, x)
    for i, c in enumerate(centres):
        at: dict[Var, Expr] = {x: add(c, x), centre: c, distance: x}
        near = skeleton
        for g, name in names.items():
            argument = by_key[keys.of(cast(Expr, g))]
            distances = [add(x, sub(c, r)) for r in argument.roots]
            if len(distances) == 2:
                near, other, at[name] = _factored(near, name, i, slope(slope(cast(Expr, g), x), x), distances)
                at.update(other)
            else:
                at[name] = mul(slope(cast(Expr, g), x), distances[0])
        a, b = [low, *splits][i], [*splits, high][i]
        pieces.append(integral_over(cast(Expr, substitute(near, at)), x, _minus(a, c), _minus(b, c)))
    return where(conjunction(*(a.exists for a in arguments)), mul(sign, add(*pieces)), node)


def _around_centre(e: Expr, x: Var) -> tuple[Expr, Var, Var]:
    """Returns an integrand with sums x + a + … as w + (c + a + …), and the names of c and w, where x will be c + w. From a side a near c
    the distance is then known to the rounding of w, not to that of x."""
    taken = {x, *e.free, *binders_inside(e)}
    centre = fresh("c", taken)
    distance = fresh("w", taken)

    def visit(_: Node, new: Node) -> Node:
        if not isinstance(new, Add) or x not in new.children:
            return new
        outside = [term for term in new.children if x not in term.free]
        return add(add(centre, *outside), distance, *(term for term in new.children if x in term.free and term is not x))

    return cast(Expr, rewrite([e], visit)[e]), centre, distance


def _factored(e: Expr, name: Var, i: int, curvature: Expr, distances: list[Expr]) -> tuple[Expr, dict[Var, Expr], Expr]:
    """Returns an integrand near root number i of a quadratic g, its new names, and g.

    g = P·L with P > 0, and L linear with that root. Powers and logarithms of g are those of P and L; the sign of g is that of L.
    """
    sign = MINUS_ONE if i == 0 else ONE
    apart, linear = mul(sign, distances[1 - i]), mul(sign, const(0.5), curvature, distances[i])
    taken = {name, *e.free, *binders_inside(e)}
    of_p = fresh("P", taken)
    of_l = fresh("L", taken)

    def visit(old: Node, new: Node) -> Node:
        if isinstance(new, Compare) and new.g is name:
            return positive(of_l, new.strict, new.resolution, new.rivals)
        if isinstance(new, Call) and new.name in ("pow", "log") and new.children[0] is name:
            parts = [call(new.name, part, *new.children[1:]) for part in (of_p, of_l)]
            return mul(*parts) if new.name == "pow" else add(*parts)
        return new

    return cast(Expr, rewrite([e], visit)[e]), {of_p: apart, of_l: linear}, mul(apart, linear)


def _arguments(node: Integral, keys: Keys) -> list[_Argument]:
    """Returns the arguments whose distances from their roots must be exact: those of powers, and of roots and logarithms that become
    infinite."""
    x, body = node.var, node.body
    box = {x: (min(extent(node.lo, {})[0], extent(node.hi, {})[0]), max(extent(node.lo, {})[1], extent(node.hi, {})[1]))}
    powers = [n for n in postorder([body]) if isinstance(n, Call) and n.name == "pow"]
    in_powers = {keys.of(g) for n in powers for g in singular_arguments(n)}
    arguments: dict[object, _Argument] = {}
    for g in singular_arguments(body):
        key = keys.of(g)
        if x not in g.free or key in arguments or g.has_integral or any(isinstance(n, Where) for n in postorder([g])):
            continue
        degree = Shadow((x,)).degree(g)
        least, most = extent(g, box)
        if degree not in (1, 2) or least > 0.0 or most < 0.0:
            continue
        roughness = order_at(body, lambda e, key=key: _is(e, key, keys))[1]  # type: ignore[misc]
        if roughness == SMOOTH or roughness <= -1.0 or (roughness > 0.0 and key not in in_powers):
            continue
        roots = solve(_as_in_conditions(g, node, keys), x, node.lo, node.hi)
        pair = None if roots is None or not roots.certain else _pair(g, x, roots.found)
        if pair is None:
            continue
        points, exists = pair
        ends = [b for b in (node.lo, node.hi) if not is_infinite(b) and keys.vanishes(cast(Expr, substitute(g, {x: b})))]
        if len(points) != degree or points == [ZERO]:
            continue
        known = next((p for p in _edges(node) if keys.vanishes(cast(Expr, substitute(g, {x: p})))), None)
        if known is not None:
            points = [known, sub(_sum_of_roots(g, x), known)][:degree]
        if len(ends) == degree:
            low, high, _ = _ascending(node.lo, node.hi)
            arguments[key] = _Argument(g, (low, high) if degree == 2 else tuple(ends), TRUE)
        else:
            arguments[key] = _Argument(g, tuple(points if degree == 1 else _sorted(*points)), exists)
    return list(arguments.values())


def _edges(node: Integral) -> Iterator[Expr]:
    """Yields the places where an integrand begins or ends, as they are written. A root at one of them must be that place to the last digit:
    between p and √(4/p²)·p²/2 lies 1e-8 of ∫ (1 - x²/p²)^-½ dx."""
    yield from (b for b in (node.lo, node.hi) if not is_infinite(b))
    for h in _conditions(node, 1):
        roots = solve(h, node.var, node.lo, node.hi)
        yield from (r.point for r in roots.found) if roots is not None else ()


def _as_in_conditions(g: Expr, node: Integral, keys: Keys) -> Expr:
    """Returns the quadratic function of a condition that is a multiple of g, by whatever has no x in it, or else g: their roots must be
    equal to the last digit, as those of x² + y² < p² and of 1 - (x² + y²)/p²."""
    x = node.var
    curvature = slope(slope(g, x), x)
    for h in _conditions(node, 2):
        if keys.vanishes(sub(mul(g, slope(slope(h, x), x)), mul(h, curvature))):
            return h
    return g


def _conditions(node: Integral, degree: int) -> Iterator[Expr]:
    """Yields the functions of a degree in the variable, without variables of inner integrals, that an integrand compares with 0."""
    compared = [n for n in postorder([node.body]) if isinstance(n, Compare)]
    for n in compared:
        known = node.var in n.free <= node.body.free and not n.g.has_integral
        if known and Shadow((node.var,)).degree(n.g) == degree:
            yield n.g


def _sum_of_roots(g: Expr, x: Var) -> Expr:
    """Returns the sum of the roots of a quadratic function."""
    rate = slope(g, x)
    return mul(const(-2.0), cast(Expr, substitute(rate, {x: ZERO})), integer_power(slope(rate, x), -1))


def _sorted(first: Expr, second: Expr) -> tuple[Expr, Expr]:
    """Returns two roots in ascending order. Those of m ± s are as they are written: s is a root by a positive number."""
    apart = sub(second, first)
    factors = apart.children if isinstance(apart, Mul) else (apart,)
    if all(f.data > 0.0 if isinstance(f, Const) else isinstance(f, Call) and f.name in ("sqrt", "root") for f in factors):
        return first, second
    return call("min", first, second), call("max", first, second)


def _pair(g: Expr, x: Var, found: Sequence[Root]) -> tuple[list[Expr], Cond] | None:
    """Returns the roots and the condition that all of them exist; None if it is not one condition.

    Of a quadratic whose coefficient of x² is not 0, one root is missing only where its formula is 0/0: where it is the other one.
    """
    points = [r.point for r in found]
    if all(r.exists is found[0].exists for r in found):
        return points, found[0].exists
    if len(found) != 2 or not _is_never_zero(slope(slope(g, x), x)):
        return None
    first, second = found
    return [where(first.exists, *points), where(second.exists, *reversed(points))], disjunction(first.exists, second.exists)


def _is_never_zero(e: Expr) -> bool:
    """Returns whether an expression is a product of numbers and of powers with negative exponents, as 2/p²."""
    factors = e.children if isinstance(e, Mul) else (e,)
    return all(f.data != 0.0 if isinstance(f, Const) else isinstance(f, Pow) and f.exponent < 0 for f in factors)


def _is_surface(e: Expr) -> bool:
    return bool(e.free) and isinstance(e, Add | Var | Mul | Call) and not e.has_delta


def _is(e: Expr, key: object, keys: Keys) -> bool:
    return _is_surface(e) and keys.of(e) == key


def _with_powers(body: Expr, chosen: Container[object], keys: Keys) -> Expr:
    """Returns √g and its powers as real powers of g: the nodes of a power approach its zero by exact distances."""

    def visit(old: Node, new: Node) -> Node:
        base, k = (new.base, new.exponent) if isinstance(new, Pow) else (new, 1)
        if isinstance(base, Call) and base.name == "sqrt" and keys.of(base.children[0]) in chosen:
            return call("pow", base.children[0], const(0.5 * k))
        if isinstance(new, Pow) and isinstance(base, Call) and base.name == "pow" and base.children[1] is const(0.5):
            return call("pow", base.children[0], const(0.5 * k))
        return new

    return cast(Expr, rewrite([body], visit)[body])


def _ascending(lo: Expr, hi: Expr) -> tuple[Expr, Expr, Expr]:
    """Returns the bounds in ascending order, and the sign of the integral."""
    if isinstance(lo, Const) and isinstance(hi, Const):
        return (lo, hi, ONE) if lo.data <= hi.data else (hi, lo, MINUS_ONE)
    if is_infinite(lo) or is_infinite(hi):
        falls = any(isinstance(b, Const) and b.data == end for b, end in ((lo, math.inf), (hi, -math.inf)))
        return (hi, lo, MINUS_ONE) if falls else (lo, hi, ONE)
    rises = positive(sub(hi, lo), strict=False)
    return where(rises, lo, hi), where(rises, hi, lo), where(rises, ONE, MINUS_ONE)


def between(point: Expr, low: Expr, high: Expr) -> Expr:
    """Returns a point, or the nearer end of the domain."""
    if point is low or point is high:
        return point
    if not is_infinite(high):
        point = call("min", high, point)
    return point if is_infinite(low) else call("max", low, point)


def in_order(points: Sequence[Expr]) -> list[Expr]:
    """Returns points in ascending order."""
    points = list(points)
    for last in range(len(points) - 1, 0, -1):
        for i in range(last):
            a, b = points[i], points[i + 1]
            points[i], points[i + 1] = call("min", a, b), call("max", a, b)
    return points


def _minus(bound: Expr, centre: Expr) -> Expr:
    return bound if is_infinite(bound) else sub(bound, centre)
