"""Jumps without a condition: the cut of atan2, and functions of a pole that have limits on both sides of it.

    atan2(v, u)    →   where(v >= 0, ½π - atan2(u, v), atan2(u, -v) - ½π)
    atan(p/q)      →   where(q > 0, atan2(p, q), atan2(-p, -q))
    f(p/q)         →   where(q > 0, f(p/|q|), f(-p/|q|))                  for exp, expm1, tanh, erf, erfc

atan2 jumps by 2π where v = 0 and u < 0, atan(1/x) by π at x = 0, and such a jump moves with the parameters of v or q. On the right no
function jumps where it is used: the second argument of each atan2 is not negative (`HalfAngle`, which stays as it is). Without parameters
a jump stays where it is, and has no derivative. In conditions the jumps of functions of one variable, and of functions of a pole, count
wherever they are, and an angle that is compared with an affine expression is two half-planes:

    atan2(v, u) < t    ⇔   v < 0 or u·sin t - v·cos t > 0, for 0 < t <= π;  both, for -π < t <= 0

and so is a field of view, |atan2(v, u) - t| < c. Where an angle is compared with what it is the angle of, atan2(sin u, cos u) < u, it is
written as u + 2π·⌊(π - u)/(2π)⌋.

Linear.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.coincidence import ZeroSet
from teg.analysis.expanded import expanded, perfect_power
from teg.analysis.kinks import Kinks, kinks_of
from teg.analysis.polynomial import Shadow
from teg.ir.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
    Add,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    HalfAngle,
    Mul,
    Param,
    Pow,
    Var,
    called,
    calls_of,
    const,
    has_cut,
)
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, half_angle, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import formed_of, parameters, rebuild, rewrite, rewritten, stands_in, substitute
from teg.passes.normalise.denominators import cleared, has_variable_denominator, tangents_as_quotients
from teg.passes.normalise.piecewise import written_out
from teg.passes.normalise.quotients import with_whole_branches

MAX_DEGREE = 8
"""The largest degree of polynomials that are divided."""
LIMITED = ("atan", "exp", "expm1", "tanh", "erf", "erfc")
"""Functions with limits at both infinities, of which one is finite at least."""
_JUMPING, _ANGLE = called("atan2", *LIMITED), called("atan2")


def with_cuts(root: Expr) -> Expr:
    """Returns the program with jumps of functions as conditions. Its value is the same."""
    if not any(n.free for n in calls_of(_JUMPING, root)):
        return root
    root = rewritten(root, Compare.bit, lambda _, node: _with_turns(node))
    order = postorder([root])
    inside, outside, cuts = dict[Node, Node](), dict[Node, Node](), _Cuts()
    in_conditions = set(postorder([n for n in order if isinstance(n, Compare)]))
    for node in order:
        if node in in_conditions:
            inside[node] = cuts.rebuilt(node, tuple(inside[c] for c in node.children), True)
        if isinstance(node, Compare):
            lines = _half_planes(node)
            lines = _written_in_half_planes(node) if lines is None else lines
            inside[node] = outside[node] = inside[node] if lines is None else lines
        else:
            outside[node] = cuts.rebuilt(node, tuple(outside[c] for c in node.children), False)
    return cast(Expr, outside[root])


class _Cuts:
    """The cuts of the functions of one program; what is found out about a node is kept."""

    def __init__(self) -> None:
        self._moving: dict[Node, bool] = {}
        self._poles: tuple[dict[Node, bool], dict[Node, bool]] = {}, {}

    def rebuilt(self, node: Node, children: tuple[Node, ...], in_condition: bool) -> Node:
        """Returns a node of new children, with the jumps of a function as conditions."""
        result = rebuild(node, children)
        if isinstance(result, Mul):
            return with_whole_branches(result)
        if not isinstance(result, Call) or not result.free or isinstance(result, HalfAngle):
            return result
        if result.name == "atan2":
            return _angle(result, in_condition)
        if result.name not in LIMITED or not self._may_jump(result.children[0], in_condition):
            return result
        return _limited(result, in_condition)

    def _may_jump(self, argument: Node, in_condition: bool) -> bool:
        """Returns whether a denominator in an argument depends on variables, and moves or stands in a condition."""

        def counts(n: Node) -> bool:
            if isinstance(n, Call):
                return n.name == "tan" and bool(n.free)
            return isinstance(n, Pow) and n.exponent < 0 and bool(n.free) and (in_condition or self._moves(n))

        return stands_in(argument, counts, self._poles[in_condition], formed_of)

    def _moves(self, e: Node) -> bool:
        return stands_in(e, lambda n: isinstance(n, Param), self._moving, lambda n: n.children)


def _with_turns(node: Node) -> Node:
    """Returns a condition between angles u and atan2(sin u, cos u) in which u cancels, with u + 2π·⌊(π - u)/(2π)⌋ for the latter; any other
    node as it is. Both sides are equal on all of an interval, where rounding would decide."""
    if not isinstance(node, Compare):
        return node
    angles = {n: _argument(n) for n in postorder([node.g]) if isinstance(n, Call) and _argument(n) is not None}
    if not angles:
        return node
    steps = {n: call("floor", mul(const(0.5 / math.pi), sub(const(math.pi), cast(Expr, u)))) for n, u in angles.items()}

    def written(turns: Mapping[Call, Expr]) -> Node:
        new = {n: add(cast(Expr, u), mul(const(2.0 * math.pi), turns[n])) for n, u in angles.items()}
        return rewrite([node.g], lambda old, n: new.get(cast(Call, old), n))[node.g]

    flat = expanded(cast(Expr, written({n: Param.make(f"turns {i}", ()) for i, n in enumerate(steps)})))
    return node if flat is None or flat.free else rebuild(node, (written(steps), *node.children[1:]))


def _argument(e: Call) -> Expr | None:
    """Returns u of atan2(sin u, cos u); None for any other function."""
    v, u = e.children if e.name == "atan2" and not isinstance(e, HalfAngle) else (e, e)
    waves = isinstance(v, Call) and isinstance(u, Call) and (v.name, u.name) == ("sin", "cos") and v.children == u.children
    return cast(Expr, u.children[0]) if waves and u.free else None


def _angle(e: Call, in_condition: bool) -> Expr:
    """Returns an angle with its cut as a condition, if the cut counts and can be met."""
    v, u = cast("tuple[Expr, Expr]", e.children)
    if _is_zero(v):
        return where(positive(mul(MINUS_ONE, u)), const(math.pi), ZERO)
    if _is_zero(u):
        return where(positive(v), const(0.5 * math.pi), where(positive(mul(MINUS_ONE, v)), const(-0.5 * math.pi), ZERO))
    counts = not u.free if in_condition else bool(parameters(v))
    if not (v.free and counts) or (isinstance(u, Const) and u.data > 0.0):
        return e
    quarter = const(0.5 * math.pi)
    above = sub(quarter, half_angle(u, v))
    return where(positive(v, strict=False), above, sub(half_angle(u, mul(MINUS_ONE, v)), quarter))


def _is_zero(e: Expr) -> bool:
    """Returns whether an expression is 0 everywhere, as y - y is: of the angles to a point of an axis there are two."""
    return e is ZERO or expanded(e) is ZERO


def _half_planes(condition: Compare) -> Cond | None:
    """Returns the condition that an angle is below or above t, by the line of that direction: u·sin t - v·cos t > 0 is the half-plane of
    the angles between t - π and t. None for other conditions."""
    factor, angle, rest = linear_in_angle(condition.g)
    if angle is None or not _is_affine(rest):
        return None
    v, u = cast("tuple[Expr, Expr]", angle.children)
    if _is_zero(v) or _is_zero(u):
        return None
    t = mul(MINUS_ONE, div(rest, factor))
    rising = positive(factor)
    above = negation(_less(v, u, t, not condition.strict))
    return disjunction(conjunction(rising, above), conjunction(negation(rising), _less(v, u, t, condition.strict)))


def _less(v: Expr, u: Expr, t: Expr, strict: bool) -> Cond:
    """Returns the condition that an angle is less than t, or not more than t: of atan2(sin x, cos x) and x these differ."""
    below, ahead = positive(mul(MINUS_ONE, v)), positive(sub(mul(u, call("sin", t)), mul(v, call("cos", t))), strict)
    upper, turn = positive(t), const(math.pi)
    return disjunction(
        conjunction(upper, disjunction(positive(sub(t, turn)), below, ahead)),
        conjunction(negation(upper), positive(add(t, turn)), below, ahead),
    )


def _written_in_half_planes(condition: Compare) -> Cond | None:
    """Returns a condition on a function with kinks, |atan2(v, u) - t| < c, by the half-planes of its branches; None for other
    conditions."""
    if not cut_angles(condition.g) or not kinks_of(condition.g):
        return None
    written = written_out(condition, Kinks())
    lines: dict[Node, Cond] = {}
    for atom in postorder([written]):
        if isinstance(atom, Compare) and cut_angles(atom.g):
            half_planes = _half_planes(atom)
            if half_planes is None:
                return None
            lines[atom] = half_planes
    return cast(Cond, rewrite([written], lambda old, new: lines.get(old, new))[written])


def linear_in_angle(e: Expr) -> tuple[Expr, Call | None, Expr]:
    """Returns k, u and c with e = k·u + c, where u is the only angle in e with a cut, and k is constant. u is None if there is none."""
    factor: Expr = ONE
    rest: Expr = ZERO
    while isinstance(e, Add | Mul):
        turning = [c for c in e.children if cut_angles(c)]
        others = [c for c in e.children if c not in turning]
        if len(turning) != 1 or (isinstance(e, Mul) and any(c.free for c in others)):
            return factor, None, rest
        if isinstance(e, Add):
            rest = add(rest, mul(factor, add(*others)))
        else:
            factor = mul(factor, *others)
        e = turning[0]
    return factor, e if isinstance(e, Call) and cut_angles(e) == [e] else None, rest


def _is_affine(e: Expr) -> bool:
    """Returns whether an expression is affine between its kinks: its line of directions stays short."""
    return not e.free or Shadow(tuple(e.free), kinks=True).degree(e) in (0, 1)


def cut_angles(e: Node) -> list[Call]:
    """Returns the angles in an expression whose cut may be met, which is no condition."""
    return [n for n in calls_of(_ANGLE, e) if has_cut(n)]


def _limited(e: Call, in_condition: bool) -> Expr:
    """Returns a function with its jump at a pole as a condition, if its argument has one that counts."""
    argument = tangents_as_quotients(e.children[0])
    if not has_variable_denominator(argument):
        return e
    p, q = _reduced(*cleared(argument))
    if not q.free or not (in_condition or parameters(q)) or _is_even(q):
        return e
    above = positive(q)
    if e.name == "atan":
        return where(above, half_angle(p, q), half_angle(mul(MINUS_ONE, p), mul(MINUS_ONE, q)))
    size = call("magnitude", q)
    return where(above, call(e.name, div(p, size)), call(e.name, div(mul(MINUS_ONE, p), size)))


def _reduced(p: Expr, q: Expr) -> tuple[Expr, Expr]:
    """Returns a quotient without the factors that are linear in a variable and divide both: u/u² jumps where u is 0, although u² has one
    sign."""
    below: list[Expr] = []
    for factor in q.children if isinstance(q, Mul) else (q,):
        power = perfect_power(factor) if isinstance(factor, Add) else None
        if power is not None:
            factor = mul(const(float(power[0])), integer_power(power[1], power[2]))
        for f in factor.children if isinstance(factor, Mul) else (factor,):
            base, k = (f.base, f.exponent) if isinstance(f, Pow) else (f, 1)
            while k > 0 and (quotient := _divided(p, base)) is not None:
                p, k = quotient, k - 1
            below.append(integer_power(base, k))
    return p, mul(*below)


def _divided(e: Expr, by: Expr) -> Expr | None:
    """Returns e/u of a product with a polynomial that is 0 where u is, for a u that is linear in a variable; None for others."""
    variables = [v for v in sorted(by.free, key=lambda v: v.name) if Shadow((v,)).degree(by) == 1]
    if not variables:
        return None
    factors: Sequence[Expr] = [e.base] * e.exponent if isinstance(e, Pow) and e.exponent > 0 else e.children if isinstance(e, Mul) else [e]
    for i, f in enumerate(factors):
        if f is not e and isinstance(f, Pow | Mul) and (inner := _divided(f, by)) is not None:
            return mul(*factors[:i], inner, *factors[i + 1 :])
        degree = Shadow((variables[0],)).degree(f)
        if degree and degree <= MAX_DEGREE and ZeroSet(by).annuls(f):
            return mul(*factors[:i], _quotient(f, by, variables[0], degree), *factors[i + 1 :])
    return None


def _quotient(e: Expr, by: Expr, v: Var, degree: int) -> Expr:
    """Returns the polynomial e/u of degree - 1 in v, by Horner's rule at the root of u."""
    rate = slope(by, v)
    root = mul(MINUS_ONE, div(cast(Expr, substitute(by, {v: ZERO})), rate))
    coefficients: list[Expr] = []
    for i in range(degree + 1):
        coefficients.append(mul(const(1.0 / math.factorial(i)), cast(Expr, substitute(e, {v: ZERO}))))
        e = slope(e, v)
    value: Expr = ZERO
    quotient: Expr = ZERO
    for i in range(degree, 0, -1):
        value = add(coefficients[i], mul(root, value))
        quotient = add(quotient, mul(value, integer_power(v, i - 1)))
    return div(quotient, rate)


def _is_even(q: Expr) -> bool:
    """Returns whether an expression is written as a product of even powers and sizes: it has one sign."""
    factors = q.children if isinstance(q, Mul) else (q,)
    return all(
        not f.free or (isinstance(f, Pow) and f.exponent % 2 == 0) or (isinstance(f, Call) and f.name == "magnitude") for f in factors
    )
