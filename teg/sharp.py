"""Sharp values: subexpressions that can be large between all nodes of a rule, and small at each of them; bounds of them over a box.

A narrow smooth feature of an integrand comes from few kinds of nodes, whose own size, or slope, tells where it is:

    exp u                   itself                       uᵏ, pow(u, k), k < 0 or large      itself
    cosh u, sinh u          cosh u                       sin u, cos u, u no polynomial      how far u goes in a gap
    tanh u                  1 - tanh²u                   atan u                             1/(1 + u²)

The last ones are the slopes: the steps themselves are seen. A sharp value is *tame* if it cannot change much between neighbouring nodes:
if its bounds over the whole domain are near each other, or those of its logarithm's slope are small. This is decided when the program is
made, where the domain is known in numbers. Bounds over a box are those of `teg.intervals`; an integral inside is bounded by the largest
size of its integrand times the largest extent of its range. Linear in the size of the integrands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from teg.calculus import slope
from teg.errors import NotDifferentiableError
from teg.expr import MINUS_ONE, ONE, Call, Compare, Const, Expr, Mul, Pow, Var, add, call, const, integer_power, mul, sub
from teg.function import Apply
from teg.integral import Integral, PointMasses
from teg.intervals import Enclosure, Interval
from teg.node import Node, postorder
from teg.numerics import folded
from teg.polynomial import Degrees
from teg.program import HIDDEN, UNSEEN
from teg.traverse import fresh, rebuild

LARGE_POWER = 16
"""A positive power up to that is narrow only where its base is; a negative one of a linear or quadratic function has places of its own."""
SATURATED = 1e-13
"""Added to the slope of tanh: where that is lost in the rounding of 1, nothing is narrow."""
FAR_ARGUMENT = 3.0
"""How far the argument of a wave may go between two nodes."""
MAX_SHARP = 64
MAX_NODES = 4000
"""Nodes of a guard's bounds: beyond that every box matters."""
_INFINITY = const(math.inf)


@dataclass(frozen=True)
class Sharp:
    """A sharp value and the node it comes from, its logarithm's slope in the variable (None: not known), and the argument of a wave."""

    node: Expr
    value: Expr
    rate: Expr | None
    wave: Expr | None = None


def sharp_values(bodies: Sequence[Expr], x: Var, inner: frozenset[Var], degrees: Degrees, poles: int) -> list[Sharp]:
    """The sharp values of integrands over x that do not depend on variables of the integrals inside; `poles` is how many poles near to
    pieces are known: a single one has places of its own."""
    found: dict[Expr, Sharp] = {}
    for node in _in_values(bodies, x, inner):
        sharp = sharp_value(node, x, degrees, poles) if not node.free & inner else None
        if sharp is not None:
            found.setdefault(sharp.value if sharp.wave is None else sharp.wave, sharp)
    return list(found.values())[:MAX_SHARP]


def _in_values(bodies: Sequence[Expr], x: Var, inner: frozenset[Var]) -> list[Expr]:
    """The numbers in integrands that depend on x, conditions of the integrand's own left out: these have breaks."""
    seen: set[Node] = set()
    order: list[Expr] = []
    stack: list[Node] = list(reversed(bodies))
    while stack:
        node = stack.pop()
        if node in seen or x not in node.free:
            continue
        seen.add(node)
        if isinstance(node, Compare):
            if node.g.free & inner:
                stack.append(node.g)
            continue
        if isinstance(node, Expr):
            order.append(node)
        stack.extend(reversed(node.children))
    return order


def sharp_value(node: Expr, x: Var, degrees: Degrees, poles: int) -> Sharp | None:
    """The sharp value that a node contributes, as seen from x; None for most."""
    match node:
        case Pow():
            u, k = node.base, node.exponent
            if k == -1 and isinstance(u, Call) and u.name in ("sqrt", "root"):  # as singular as nodes can see, and has places of its own
                return None
            if 0 < k <= LARGE_POWER or (-LARGE_POWER <= k < 0 and poles <= 1 and degrees.of(u, x) in (1, 2)):
                return None
            return Sharp(node, node if k % 2 == 0 else call("magnitude", node), _divided(mul(const(k), _slope(u, x)), u))
        case Apply():
            return None
        case Call():
            return _sharp_call(node, x, degrees)
        case _:
            return None


def _sharp_call(node: Call, x: Var, degrees: Degrees) -> Sharp | None:
    u = cast(Expr, node.children[0])
    match node.name:
        case "exp":
            return Sharp(node, node, _slope(u, x))
        case "cosh" | "sinh":
            return Sharp(node, call("cosh", u), _slope(u, x))
        case "tanh":
            rate = _slope(u, x)
            slope_of_tanh = add(sub(ONE, integer_power(node, 2)), const(SATURATED))
            return Sharp(node, slope_of_tanh, None if rate is None else mul(const(2.0), rate))
        case "atan":
            return Sharp(node, integer_power(add(ONE, integer_power(u, 2)), -1), _slope(u, x))
        case "pow":
            k = cast(Expr, node.children[1])
            if isinstance(k, Const) and -1.0 < k.data <= 2.0:
                return None
            return Sharp(node, node, None if x in k.free else _divided(mul(k, _slope(u, x)), u))
        case "sin" | "cos":
            return None if degrees.of(u, x) is not None else Sharp(node, ONE, None, u)
        case _:
            return None


def _slope(u: Expr, x: Var) -> Expr | None:
    try:
        return slope(u, x)
    except NotDifferentiableError:
        return None


def _divided(rate: Expr | None, u: Expr) -> Expr | None:
    return None if rate is None else mul(rate, integer_power(u, -1))


# -- bounds --------------------------------------------------------------------------------------------------------------


def bounds(sharp: Sharp, boxed: Enclosure) -> tuple[Expr, Expr] | None:
    """The upper and the lower bound of a sharp value over a box; None where none are known."""
    try:
        if sharp.wave is None:
            lo, hi = boxed.of(sharp.value)
            return hi, lo
        first, last = boxed.of(sharp.wave)
    except (NotDifferentiableError, AssertionError):
        return None
    return call("max", ONE, mul(const(UNSEEN / FAR_ARGUMENT), sub(last, first))), ONE


def sizes(bodies: Sequence[Expr], boxed: Enclosure) -> list[Expr]:
    """Bounds of the |integrands| over a box, infinite where none are known."""
    found = [size_of(body, boxed) for body in bodies]
    return found if len(postorder(found)) <= MAX_NODES else [_INFINITY] * len(found)


def size_of(body: Expr, boxed: Enclosure) -> Expr:
    """A bound of |body| over a box."""
    plain, box = _without_integrals(body, boxed.box)
    try:
        lo, hi = (boxed if plain is body else Enclosure(box)).of(plain)
    except NotDifferentiableError:
        return _INFINITY
    return call("magnitude", lo) if lo is hi else call("max", hi, mul(MINUS_ONE, lo))


def _without_integrals(body: Expr, box: Mapping[Var, Interval]) -> tuple[Expr, dict[Var, Interval]]:
    """The expression with variables in the place of integrals and functions that depend on the box, and the box with their bounds. The
    recursion is as deep as integrals are nested."""
    new: dict[Node, Node] = {}
    larger = dict(box)
    variables = set(box)
    stack: list[Node] = [body]
    while stack:
        node = stack[-1]
        if node in new or node.free.isdisjoint(variables):
            new.setdefault(node, node)
            stack.pop()
        elif isinstance(node, Integral | Apply | PointMasses):
            name = fresh("∫", larger)
            size = extent_of(node, box) if isinstance(node, Integral) else _INFINITY
            larger[name] = mul(MINUS_ONE, size), size
            new[node] = name
            stack.pop()
        elif missing := [c for c in node.children if c not in new]:
            stack.extend(missing)
        else:
            new[node] = rebuild(node, tuple(new[c] for c in node.children))
            stack.pop()
    return cast(Expr, new[body]), larger


def extent_of(node: Integral, box: Mapping[Var, Interval]) -> Expr:
    """A bound of |∫| over a box: the largest size of the integrand, times the extent of the range."""
    low, high = range_of(node, box)
    if low is None or high is None:
        return _INFINITY
    return mul(sub(high, low), size_of(node.body, Enclosure({**box, node.var: (low, high)})))


def range_of(node: Integral, box: Mapping[Var, Interval]) -> tuple[Expr, Expr] | tuple[None, None]:
    """Bounds of an integral's variable over a box; None where they are infinite or not known."""
    if any(isinstance(b, Const) and math.isinf(b.data) for b in (node.lo, node.hi)):
        return None, None
    try:
        ends = Enclosure(box)
        (a, b), (c, d) = ends.of(node.lo), ends.of(node.hi)
    except NotDifferentiableError:
        return None, None
    low = a if _ordered(a, c) else call("min", a, c)
    return low, d if _ordered(b, d) else call("max", b, d)


def _ordered(a: Expr, b: Expr) -> bool:
    return isinstance(a, Const) and isinstance(b, Const) and a.data <= b.data


# -- tame ones -----------------------------------------------------------------------------------------------------------


def is_tame(sharp: Sharp, ranges: Mapping[Var, Interval], x: Var, gap: float | None) -> bool:
    """Whether a sharp value certainly changes by less than UNSEEN between neighbouring nodes, over a box known in numbers; `gap` is the
    largest part of a piece between two nodes (None: not known)."""
    boxed = Enclosure(ranges)
    found = bounds(sharp, boxed)
    if found is None:
        return False
    upper, lower = (_number(b) for b in found)
    if 0.0 < lower and upper <= UNSEEN * lower < math.inf:
        return True
    if sharp.rate is None or gap is None:
        return False
    try:
        fastest = [abs(_number(b)) for b in boxed.of(sharp.rate)]
    except NotDifferentiableError:
        return False
    lo, hi = map(_number, ranges[x])
    return not any(map(math.isnan, fastest)) and max(fastest) * (hi - lo) * gap <= math.log(UNSEEN)


def _number(e: Expr) -> float:
    """The value of an expression of numbers, NaN for any other."""
    value = folded(e)
    return float(value.data) if isinstance(value, Const) else math.nan


def numeric_range(node: Integral, ranges: Mapping[Var, Interval]) -> dict[Var, Interval]:
    """The ranges with that of an integral's variable, where it is finite and known in numbers; without any range of that variable else."""
    rest = {v: ends for v, ends in ranges.items() if v is not node.var}
    low, high = range_of(node, rest)
    if low is None or high is None:
        return rest
    low, high = folded(low), folded(high)
    if not (isinstance(low, Const) and isinstance(high, Const) and math.isfinite(low.data) and math.isfinite(high.data)):
        return rest
    return {**rest, node.var: (low, high)}
