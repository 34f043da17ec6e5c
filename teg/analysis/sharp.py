"""Sharp values: subexpressions that can be large between all nodes of a rule, and small at each of them; bounds of them over a box.

A narrow smooth feature of an integrand comes from few kinds of nodes. The size of the node, or its slope, tells where the feature is:

    exp u                   itself                       uᵏ, pow(u, k), k < 0 or large      itself
    cosh u, sinh u          cosh u                       sin u, cos u, u no polynomial      how far u goes in a gap
    tanh u                  1 - tanh²u                   atan u                             1/(1 + u²)
    erf u, erfc u           exp(-u²)                     expm1 u                            exp u
    f(u, …) of the user     |f|

For tanh, atan and erf the slope counts, because the steps themselves are seen. A sharp value is *tame* if it cannot change much between
neighbouring nodes: its bounds over the whole domain are near each other, or the bounds of its logarithm's slope are small. This is
decided at compile time if the domain is known in numbers. Bounds over a box are those of `teg.analysis.intervals`. The size of an inner
integral is bounded by the largest size of its integrand times the largest extent of its range. That bound stays wide on a narrow box, so a
function of an integral, as exp(-10⁴·(∫ … dy - c)²), is bounded by a model of the integral on the box: a parabola in each variable, through
three values. Linear in the size of the integrands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from teg.analysis.calculus import Slopes, slope
from teg.analysis.evaluate import folded, values_of
from teg.analysis.intervals import Enclosure, Interval
from teg.analysis.polynomial import Degrees
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Call, Compare, Cond, Const, Expr, Param, Pow, Var, Where, const
from teg.ir.function import Apply
from teg.ir.integral import ClosedForm, Integral, PointMasses
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, rewrite_below, substitute
from teg.program import UNSEEN

LARGE_POWER = 16
"""The largest positive power that is not sharp by itself: it is narrow only where its base is.

A negative power of a linear or quadratic function has its own treatment as a pole.
"""
LOST = 2.0**-80
"""The square of the largest distance of complex roots, in parts of their real part, that rounding hides from the treatment of poles."""
SATURATED = 1e-13
"""Added to the slopes of tanh and erf. Where the slope is lost in the rounding of 1 the step is not narrow."""
FAR_ARGUMENT = 3.0
"""The largest change of a wave's argument between two nodes."""
MAX_NODES = 4000
"""The largest number of nodes of a guard's bounds. Beyond it every box matters."""
BESIDE_ENDS = 1 / 16
"""How far from the ends of a box, as a fraction of it, an integral is evaluated: pieces end at breaks, where ties are met."""
LARGEST = 1e300
"""A bound beyond this is infinite, unless it is known to overflow only."""
_INFINITY = const(math.inf)
_NO_NUMBER = const(math.nan)


@dataclass(frozen=True)
class Sharp:
    """A sharp value, the node it comes from, and that node's argument u.

    The slope of the value's logarithm is at most `factor` times the slope of u (None: not known); for a `power`, `factor` times the
    slope of u's logarithm. For a `wave`, u itself counts.
    """

    node: Expr
    value: Expr
    argument: Expr
    factor: Expr | None
    power: bool = False
    wave: bool = False


def sharp_values(bodies: Sequence[Expr], x: Var, inner: frozenset[Var], degrees: Degrees, poles: int) -> list[Sharp]:
    """Returns the sharp values of integrands over x that do not depend on variables of inner integrals.

    `poles` is the number of known poles near pieces: a single one has its own treatment.
    """
    values: dict[tuple[Expr, Expr], Sharp] = {}
    for node in _in_values(bodies, x, inner):
        sharp = sharp_value(node, x, degrees, poles) if not node.free & inner else None
        if sharp is not None:
            values.setdefault((sharp.argument, ONE) if sharp.wave else (sharp.value, sharp.node), sharp)
    return list(values.values())


def _in_values(bodies: Sequence[Expr], x: Var, inner: frozenset[Var]) -> list[Expr]:
    """Returns the numbers in integrands that depend on x. Conditions of the integrand are left out: they have breaks."""
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
    """Returns the sharp value that a node contributes, as seen from x; None for most nodes."""
    match node:
        case Pow():
            u, k = node.base, node.exponent
            if (
                k == -1 and isinstance(u, Call) and u.name in ("sqrt", "root")
            ):  # as singular as the nodes can resolve, and treated as a singularity
                return None
            degree = degrees.of(u, x) if -LARGE_POWER <= k < 0 and poles <= 1 else None
            if 0 < k <= LARGE_POWER or degree == 1:
                return None
            size: Expr = node if k % 2 == 0 else call("magnitude", node)
            if degree == 2:
                size = where(_is_lost(u, x), size, ONE)
            return Sharp(node, size, u, const(k), power=True) if x in size.free else None
        case Apply():
            return None if node.degree is not None else Sharp(node, call("magnitude", node), node, None)
        case Call():
            return _sharp_call(node, x, degrees)
        case _:
            return None


def _is_lost(u: Expr, x: Var) -> Cond:
    """Returns whether the complex roots of a quadratic function are so near to each other that few numbers lie beside them: then the
    treatment of poles does not resolve the peak between them."""
    rate = slope(u, x)
    curvature = slope(rate, x)
    middle = div(mul(MINUS_ONE, cast(Expr, substitute(rate, {x: ZERO}))), curvature)
    apart = div(mul(const(2.0), cast(Expr, substitute(u, {x: middle}))), curvature)
    return positive(sub(mul(const(LOST), integer_power(middle, 2)), apart))


def _sharp_call(node: Call, x: Var, degrees: Degrees) -> Sharp | None:
    u = node.children[0]
    match node.name:
        case "exp":
            return Sharp(node, node, u, ONE)
        case "cosh" | "sinh":
            return Sharp(node, call("cosh", u), u, ONE)
        case "expm1":
            return Sharp(node, call("exp", u), u, ONE)
        case "erf" | "erfc":
            bell = call("exp", mul(MINUS_ONE, integer_power(u, 2)))
            return Sharp(node, add(bell, const(SATURATED)), u, mul(const(2.0), call("magnitude", u)))
        case "tanh":
            return Sharp(node, add(sub(ONE, integer_power(node, 2)), const(SATURATED)), u, const(2.0))
        case "atan":
            return Sharp(node, integer_power(add(ONE, integer_power(u, 2)), -1), u, ONE)
        case "pow":
            k = node.children[1]
            if x in k.free:
                return Sharp(node, node, u, None, power=True)
            tame = conjunction(positive(add(ONE, k)), negation(positive(sub(k, const(LARGE_POWER)))))
            size = call("pow", call("magnitude", u), k)  # beside a break u may be on the side where the power is no part of the integrand
            return None if tame is TRUE else Sharp(node, where(tame, ONE, size), u, k, power=True)
        case "sin" | "cos":
            return None if degrees.of(u, x) is not None else Sharp(node, ONE, u, None, wave=True)
        case _:
            return None


# -- bounds --------------------------------------------------------------------------------------------------------------


def bounds(sharp: Sharp, boxed: Enclosure) -> tuple[Expr, Expr] | None:
    """Returns the upper and the lower bound of a sharp value over a box; None if none are known.

    What only overflows, because its argument is finite, is no singularity: its bound is finite. A function whose body is hidden is bounded
    by its values at both ends and in the middle, and integrals and such functions inside of a sharp value by models.
    """
    try:
        return _enclosed(sharp, boxed)
    except NotDifferentiableError:
        if isinstance(sharp.node, Apply):
            return _at_points(sharp.value, boxed.box)
    try:
        (value, argument), larger = _without_integrals([sharp.value, sharp.argument], boxed.box, _model_of)
        return _enclosed(replace(sharp, value=value, argument=argument), Enclosure(larger))
    except NotDifferentiableError:
        return None


def _enclosed(sharp: Sharp, boxed: Enclosure) -> tuple[Expr, Expr]:
    """Returns the bounds that an enclosure gives."""
    if not sharp.wave:
        hi = boxed.of(sharp.value)[1]
        return _unless_singular(hi, sharp, boxed), boxed.of(_where_not_null(sharp))[0]
    first, last = boxed.of(sharp.argument)
    return call("max", ONE, mul(const(UNSEEN / FAR_ARGUMENT), sub(last, first))), ONE


def _where_not_null(sharp: Sharp) -> Expr:
    """Returns the sharp value of a `where` that is 0 on one side of its condition, as on the other side everywhere: a condition that is not
    decided over a box would make the lower bound 0."""
    u = sharp.argument
    if not isinstance(u, Where) or ZERO not in (u.then, u.otherwise):
        return sharp.value
    other = add(u.then, u.otherwise)
    return cast(Expr, rewrite_below([sharp.value], lambda n: other if n is u else None)[sharp.value])


def _unless_singular(upper: Expr, sharp: Sharp, boxed: Enclosure) -> Expr:
    """Returns the upper bound of an exponential or a positive power, finite where the argument is."""
    value = sharp.value
    grows = isinstance(value, Call) and value.name in ("exp", "cosh")
    if not grows and not (isinstance(value, Pow) and value.exponent > 0):
        return upper
    lo, hi = boxed.of(sharp.argument)
    finite = positive(sub(const(LARGEST), call("max", hi, mul(MINUS_ONE, lo))))
    return where(finite, call("min", upper, const(LARGEST)), upper)


def _at_points(value: Expr, box: Mapping[Var, Interval]) -> tuple[Expr, Expr] | None:
    """Returns the largest of the values at both ends and in the middle of an interval, twice: a lower bound is not known.

    None in several variables, and for an integral.
    """
    inside = [v for v in box if v in value.free]
    if len(inside) != 1 or value.has_integral:
        return None
    (x,) = inside
    lo, hi = box[x]
    largest, *others = (cast(Expr, substitute(value, {x: place})) for place in (lo, mul(const(0.5), add(lo, hi)), hi))
    for v in others:
        largest = call("max", largest, v)
    return largest, largest


def sizes(bodies: Sequence[Expr], boxed: Enclosure) -> list[Expr]:
    """Returns bounds of |integrand| over a box, infinite if none are known."""
    largest = [size_of(body, boxed) for body in bodies]
    return largest if len(postorder(largest)) <= MAX_NODES else [_INFINITY] * len(largest)


def size_of(body: Expr, boxed: Enclosure) -> Expr:
    """Returns a bound of |body| over a box."""
    try:
        lo, hi = boxed.of(body)
    except NotDifferentiableError:
        (plain,), box = _without_integrals([body], boxed.box, _extents)
        try:
            lo, hi = Enclosure(box).of(plain)
        except NotDifferentiableError:
            return _INFINITY
    return call("magnitude", lo) if lo is hi else call("max", hi, mul(MINUS_ONE, lo))


_OPAQUE = Integral.bit | Apply.bit | PointMasses.bit | ClosedForm.bit


def _without_integrals(
    bodies: Sequence[Expr], box: Mapping[Var, Interval], bounds_of: Callable[[Expr, Mapping[Var, Interval]], Interval]
) -> tuple[list[Expr], dict[Var, Interval]]:
    """Returns the expressions with variables in the place of integrals and functions that depend on the box, and the box with their bounds.

    The recursion is as deep as integrals are nested.
    """
    larger = dict(box)
    variables = set(box)

    def replacement(node: Node) -> Node | None:
        if not node.kinds & _OPAQUE or node.free.isdisjoint(variables):
            return node
        if not isinstance(node, Integral | Apply | PointMasses | ClosedForm):
            return None
        name = fresh("∫", larger)
        larger[name] = bounds_of(node, box)
        return name

    new = rewrite_below(bodies, replacement)
    return [cast(Expr, new[body]) for body in bodies], larger


def _extents(node: Expr, box: Mapping[Var, Interval]) -> Interval:
    """Returns bounds of an integral by its size; the values of a function are not known."""
    size = extent_of(node, box) if isinstance(node, Integral) else _INFINITY
    return mul(MINUS_ONE, size), size


def _model_of(node: Expr, box: Mapping[Var, Interval]) -> Interval:
    """Returns bounds of a model of an integral or a function on a box: the value in the middle, plus a parabola in each variable.

    With three values, the excess of a parabola over them is at most an eighth of its second difference d; beyond the outer places it
    goes on by at most BESIDE_ENDS/(1 - 2·BESIDE_ENDS) of the step between them, and a tenth of d. Twice as much is allowed for.
    """
    half = const(0.5)
    middle = {v: mul(half, add(lo, hi)) for v, (lo, hi) in box.items() if v in node.free and lo is not hi}
    centre = cast(Expr, substitute(node, middle | {v: lo for v, (lo, hi) in box.items() if lo is hi}))
    low = high = centre
    for v in middle:
        lo, hi = box[v]
        near, far = const(BESIDE_ENDS), const(1.0 - BESIDE_ENDS)
        places = add(mul(far, lo), mul(near, hi)), add(mul(near, lo), mul(far, hi))
        first, last = (sub(cast(Expr, substitute(node, {**middle, v: place})), centre) for place in places)
        step = mul(const(2.0 * BESIDE_ENDS / (1.0 - 2.0 * BESIDE_ENDS)), call("magnitude", sub(last, first)))
        beyond = add(step, mul(const(0.25), call("magnitude", add(first, last))))
        low = add(low, sub(call("min", ZERO, call("min", first, last)), beyond))
        high = add(high, call("max", ZERO, call("max", first, last)), beyond)
    return low, high


def extent_of(node: Integral, box: Mapping[Var, Interval]) -> Expr:
    """Returns a bound of |∫| over a box: the largest size of the integrand times the extent of the range."""
    low, high = range_of(node, box)
    if low is None or high is None:
        return _INFINITY
    return mul(sub(high, low), size_of(node.body, Enclosure({**box, node.var: (low, high)})))


def range_of(node: Integral, box: Mapping[Var, Interval]) -> tuple[Expr, Expr] | tuple[None, None]:
    """Returns bounds of an integral's variable over a box; (None, None) if they are infinite or not known."""
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


# -- tame values ---------------------------------------------------------------------------------------------------------


def tame_ones(known: Sequence[Sharp], ranges: Mapping[Var, Interval], x: Var, gap: float | None) -> list[bool]:
    """Returns, for each sharp value, whether it certainly changes by less than UNSEEN between neighbouring nodes, over a box of numbers.

    `gap` is the largest fraction of a piece between two nodes (None: not known).
    """
    if x not in ranges:
        return [False] * len(known)
    boxed = Enclosure(ranges)
    nothing = (_NO_NUMBER, _NO_NUMBER)
    ends = _numbers([b for s in known for b in _certain(s, boxed) or nothing])
    tame = [lower > 0.0 and upper <= UNSEEN * lower < math.inf for upper, lower in zip(ends[::2], ends[1::2], strict=True)]
    undecided = [i for i, settled in enumerate(tame) if not settled and known[i].factor is not None]
    if gap is None or not undecided:
        return tame
    slopes = Slopes(x)
    rates = _numbers([b for i in undecided for b in _rate(known[i], slopes, boxed) or nothing])
    lo, hi = _numbers(ranges[x])
    for i, slowest, fastest in zip(undecided, rates[::2], rates[1::2], strict=True):
        change = max(abs(slowest), abs(fastest)) * (hi - lo) * gap
        tame[i] = not math.isnan(slowest + fastest) and change <= math.log(UNSEEN)
    return tame


def _certain(sharp: Sharp, boxed: Enclosure) -> tuple[Expr, Expr] | None:
    """Returns bounds of a sharp value for which no integral and no function is evaluated.

    One enclosure serves all values; only those with integrals or functions inside have one of their own.
    """
    try:
        return _enclosed(sharp, boxed)
    except NotDifferentiableError:
        pass
    try:
        (value, argument), larger = _without_integrals([sharp.value, sharp.argument], boxed.box, _extents)
        return _enclosed(replace(sharp, value=value, argument=argument), Enclosure(larger))
    except NotDifferentiableError:
        return None


def _rate(sharp: Sharp, slopes: Slopes, boxed: Enclosure) -> Interval | None:
    """Returns bounds of the slope of the logarithm of a sharp value."""
    try:
        rate = mul(cast(Expr, sharp.factor), slopes.of(sharp.argument))
        return boxed.of(mul(rate, integer_power(sharp.argument, -1)) if sharp.power else rate)
    except NotDifferentiableError:
        return None


def _numbers(expressions: Sequence[Expr]) -> list[float]:
    """Returns the values of the expressions that consist of numbers alone, NaN for the others."""
    symbolic: set[Node] = set()
    for node in postorder(expressions):
        if isinstance(node, Param | Var | Apply | Integral) or any(c in symbolic for c in node.children):
            symbolic.add(node)
    values = iter(values_of([e for e in expressions if e not in symbolic], {}))
    return [math.nan if e in symbolic else float(next(values)) for e in expressions]


def numeric_range(node: Integral, ranges: Mapping[Var, Interval]) -> dict[Var, Interval]:
    """Returns the ranges with that of an integral's variable added; if it is infinite or not known in numbers, without that variable."""
    others = {v: ends for v, ends in ranges.items() if v is not node.var}
    low, high = range_of(node, others)
    if low is None or high is None:
        return others
    low, high = folded(low), folded(high)
    if not (isinstance(low, Const) and isinstance(high, Const) and math.isfinite(low.data) and math.isfinite(high.data)):
        return others
    return {**others, node.var: (low, high)}
