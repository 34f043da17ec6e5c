"""The steps of a staircase: the integers that u passes while its variables run over their ranges.

    k₀ = floor(least u),  kᵢ = k₀ + i,  as many as the range of u is wide

The range of an affine u is exact: its value where all variables start, and the change along each of them. The range of any other u is
its interval enclosure. Parameters may move the steps, but not change their number, as in floor(3x + t): k₀ is then an expression of
parameters, and the steps at both ends of the range are counted too, because they are the ones that enter and leave. Where parameters
change the number as well, as in floor(t·x), MAX_PERIODIC steps are counted, and a condition tells whether these are all. Angles, and other
functions with a least and a greatest value for all parameters, have their steps at known places.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.expanded import expanded
from teg.analysis.intervals import enclose
from teg.analysis.polynomial import Shadow
from teg.analysis.preimages import MAX_PERIODIC
from teg.analysis.roots import tidy
from teg.errors import NotDifferentiableError
from teg.ir.expr import (
    FALSE,
    MINUS_ONE,
    ONE,
    TRUE,
    ZERO,
    Add,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    Mul,
    Param,
    Pow,
    UncountedFloor,
    Var,
    Where,
    called,
    calls_of,
    const,
)
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, mul, positive, sub, where
from teg.ir.traverse import parameters, rewrite, substitute

MAX_STEPS = 256
"""The largest number of steps of one floor that are counted."""
_SLACK = 1e-9
"""A range this near to an integer number of steps may contain one more, by rounding."""
_TURN = 1e-12
"""The part of the largest size of a function in which no step is counted: π/q may be rounded up to an integer."""
_LEAST_RATE = 1e-300
_HALF = const(0.5)


@dataclass(frozen=True)
class Range:
    """The values of a variable: from `start` to `end`, expressions of parameters, in either order."""

    start: Expr
    end: Expr

    @property
    def interval(self) -> tuple[Expr, Expr]:
        """Returns the smaller end and the larger end."""
        return call("min", self.start, self.end), call("max", self.start, self.end)


Extent = tuple[Expr, Expr, Expr]
"""The least and the largest value, and their difference."""


@dataclass(frozen=True)
class Box:
    """The ranges of variables, and the cells of other floors that they are in: (v, k) means that v lies between k and k + 1."""

    ranges: Mapping[Var, Range]
    cells: tuple[tuple[Expr, Expr], ...] = ()

    def cell(self, u: Expr, level: Expr) -> Box:
        """Returns the part of the box where u lies between a level and the next. If all are numbers, the variable gets a shorter range."""
        return Box(_narrowed(u, number(level), self.ranges), (*self.cells, (u, level)))


@dataclass(frozen=True)
class Steps:
    """u passes base, base + 1, …: the condition `over[i]` means that u is beyond base + i. If `guard` holds there are no more of them."""

    base: Expr
    over: tuple[Cond, ...]
    guard: Cond = TRUE

    def level(self, i: int) -> Expr:
        """Returns floor(u) between step i - 1 and step i."""
        return add(self.base, const(i - 1.0))


# -- floors --------------------------------------------------------------------------------------------------------------

_STEPS = called("round", "ceil", "mod")


def is_step(node: Node) -> bool:
    """Returns whether a node is a floor with variables in it whose steps may be counted."""
    return isinstance(node, Call) and node.name == "floor" and bool(node.free) and not isinstance(node, UncountedFloor)


def with_floors(root: Expr) -> Expr:
    """Returns the expression with round and ceil, and mod of variables, written by floor.

    At the halves round goes to the even side where parameters decide, up elsewhere.
    """
    if not any(n.name != "mod" or n.free for n in calls_of(_STEPS, root)):
        return root
    return cast(Expr, rewrite([root], lambda _, new: _by_floor(new) if isinstance(new, Call) else new)[root])


def _by_floor(e: Call) -> Expr:
    u = e.children[0]
    match e.name:
        case "mod" if e.free:
            return sub(u, mul(e.children[1], call("floor", div(u, e.children[1]))))
        case "ceil":
            return mul(MINUS_ONE, call("floor", mul(MINUS_ONE, u)))
        case "round" if e.free:
            return call("floor", add(u, _HALF))
        case "round":
            whole = call("floor", u)
            over = sub(sub(u, whole), _HALF)
            odd = positive(call("mod", whole, const(2.0)))
            return where(disjunction(positive(over), conjunction(positive(over, strict=False), odd)), add(whole, ONE), whole)
        case _:
            return e


def between_integers(c: Compare) -> Cond:
    """Returns a condition on an integer that parameters decide, compared half-way between two integers: the integer itself is then no
    border.

    In x - mod(x, 1) > 0, which is x - (x - k) > 0 in a cell, the variable cancels: this is such a condition too.
    """
    if c.resolution is not None:
        return c
    g = expanded(c.g) if c.g.free else c.g
    if g is None or g.free:
        return c
    if not _is_whole(g):
        return positive(g, c.strict)
    return positive(sub(g, _HALF) if c.strict else add(g, _HALF))


def _is_whole(e: Expr) -> bool:
    """Returns whether the value is certainly an integer."""
    stack: list[Expr] = [e]
    while stack:
        node = stack.pop()
        match node:
            case Call() if node.name == "floor":
                continue
            case Const() if float(node.data).is_integer():
                continue
            case Add() | Mul():
                stack.extend(node.children)
            case Pow() if node.exponent > 0:
                stack.append(node.base)
            case Where():
                stack += [node.then, node.otherwise]
            case Call() if node.name in ("mod", "min", "max", "magnitude"):
                stack.extend(node.children)
            case _:
                return False
    return True


# -- how many steps ------------------------------------------------------------------------------------------------------


def count_steps(u: Expr, box: Box) -> Steps | None:
    """Returns the integers that u passes in a box; None if they are not known, or too many."""
    if not u.free <= box.ranges.keys():
        return None
    affine = _affine_extent(u, box.ranges)
    best = _steps(u, affine or _least_known(_extent(u, box.ranges), u), affine is None)
    for v, level in box.cells:
        inside = _steps(u, _related_extent(u, v, level, box.ranges), False)
        if inside is not None and (best is None or best.guard is not TRUE or len(inside.over) < len(best.over)):
            best = inside
    return best


def _steps(u: Expr, extent: Extent | None, is_curved: bool) -> Steps | None:
    if extent is None:
        return None
    least, most, width = extent
    lowest, highest, span = number(least), number(most), number(width)
    if lowest is not None and highest is not None:
        if not (math.isfinite(lowest) and math.isfinite(highest)):
            return None
        first = math.floor(lowest) + 1
        last = math.ceil(highest) - 1 if _is_analytic(u) else math.floor(highest + _SLACK)  # a flat piece may lie at the end
        if last - first >= MAX_STEPS:
            return None
        return Steps(const(float(first)), tuple(_beyond(u, const(float(k))) for k in range(first, last + 1)))
    if any(n is not None and not math.isfinite(n) for n in (lowest, highest, span)):
        return None  # infinitely many
    base = call("floor", least) if lowest is None else const(float(math.floor(lowest)))
    if span is None and (bound := greatest_size(width)) <= MAX_STEPS:
        span = bound
    guard: Cond = TRUE
    if span is None:
        count = MAX_PERIODIC + 1
        guard = positive(sub(add(base, const(float(count))), most))
    elif math.isfinite(span) and span <= MAX_STEPS:
        count = math.ceil(span * (1.0 + _SLACK) + _SLACK) + 1
    else:
        return None
    levels = [add(base, const(float(i))) for i in range(count)]
    if is_curved:
        levels = _moved_out(levels, least, most if _is_analytic(u) else None)
    return Steps(base, tuple(_beyond(u, level) for level in levels), guard)


def _beyond(u: Expr, level: Expr) -> Cond:
    return positive(sub(u, level), strict=False)


def _moved_out(levels: list[Expr], least: Expr, most: Expr | None) -> list[Expr]:
    """Returns the levels, with those at a fixed end of the range moved out of it.

    An end is fixed if parameters do not move it, like that of t·x² at 0: no step enters there, and the slope may be 0. All values are
    beyond a level at the least one, moved or not; one at the largest value (None: stays) is moved if no flat piece may lie on it.
    """
    first, *others = levels
    below, above = _touching(least), None if most is None else _touching(most)
    if below is not None:
        first = where(_is_near(first, least, below), sub(first, ONE), first)
    if above is not None and most is not None:
        others = [where(_is_near(level, most, above), add(level, ONE), level) for level in others]
    return [first, *others]


def _is_near(level: Expr, end: Expr, distance: Expr) -> Cond:
    return positive(sub(distance, call("magnitude", sub(level, end))))


def _touching(end: Expr) -> Expr | None:
    """Returns the distance within which a level counts as being at an end of the range.

    A little if the end does not move, negative if it moves; None if it certainly moves.
    """
    moves: Cond = FALSE
    for p in parameters(end):
        rate = slope(end, p)
        if isinstance(rate, Const) and rate.data != 0.0:
            return None
        moves = disjunction(moves, positive(sub(call("magnitude", rate), const(_LEAST_RATE))))
    return where(moves, MINUS_ONE, const(_SLACK))


def _affine_extent(u: Expr, ranges: Mapping[Var, Range]) -> Extent | None:
    """Returns the least and largest value and their difference, for a u that is affine in all its variables.

    They are computed from the value of u, as it is written, where all variables start.
    """
    variables = [v for v in ranges if v in u.free]
    if not _is_analytic(u) or (Shadow(tuple(variables)).degree(u) or 2) > 1:
        return None
    start = {v: ranges[v].start for v in variables}
    at_start = cast(Expr, substitute(u, start))
    down, up = [at_start], [at_start]
    sizes: list[Expr] = []
    for v in variables:
        rate = tidy(cast(Expr, substitute(slope(u, v), start)))
        change = tidy(mul(rate, tidy(sub(ranges[v].end, ranges[v].start))))
        known = number(change)
        if known is not None:
            change = const(known)
        down.append(call("min", ZERO, change))
        up.append(call("max", ZERO, change))
        sizes.append(call("max", change, mul(MINUS_ONE, change)))
    return add(*down), add(*up), add(*sizes)


def _related_extent(u: Expr, v: Expr, level: Expr, ranges: Mapping[Var, Range]) -> Extent | None:
    """Returns the extent of u = r·v + d while v runs from one level to the next; r a number, d free of variables."""
    if u.free != v.free or not (_is_analytic(u) and _is_analytic(v)):
        return None
    shadow = Shadow(tuple(u.free))
    if shadow.degree(u) != 1 or shadow.degree(v) != 1:
        return None
    start = {x: ranges[x].start for x in u.free}
    first = min(u.free, key=lambda x: str(x.name))
    rate = number(tidy(cast(Expr, substitute(div(slope(u, first), slope(v, first)), start))))
    if rate is None or not math.isfinite(rate) or shadow.degree(difference := sub(u, mul(const(rate), v))) != 0:
        return None
    least = add(mul(const(rate), level), cast(Expr, substitute(difference, start)))
    return add(least, const(min(rate, 0.0))), add(least, const(max(rate, 0.0))), const(abs(rate))


def _extent(u: Expr, ranges: Mapping[Var, Range]) -> Extent | None:
    """Returns the same by interval arithmetic. Terms without variables are kept apart, so that they do not widen the range."""
    varying, fixed = _split(u)
    try:
        least, most = enclose(varying, {v: ranges[v].interval for v in ranges if v in u.free})
    except NotDifferentiableError:
        return None
    if least.free or most.free:
        return None
    return add(fixed, least), add(fixed, most), tidy(sub(most, least))


def _least_known(extent: Extent | None, u: Expr) -> Extent | None:
    """Returns an extent, or that of u for all parameters if the number of steps is counted for all of them anyway: an angle goes from
    -π to π, and its steps are at known places then."""
    if extent is None or number(extent[2]) is not None:
        return extent
    varying, fixed = _split(u)
    most = greatest_size(varying) * (1.0 - _TURN)
    if math.isinf(most) or 2.0 * most > greatest_size(extent[2]):
        return extent
    return add(fixed, const(-most)), add(fixed, const(most)), const(2.0 * most)


def _split(u: Expr) -> tuple[Expr, Expr]:
    """Returns the sum of the terms with variables and of those without, of a sum that may have factors without variables."""
    varying: list[Expr] = []
    fixed: list[Expr] = []
    stack = [u]
    while stack:
        e = stack.pop()
        factors = [f for f in e.children if not f.free] if isinstance(e, Mul) else []
        total = next((f for f in e.children if isinstance(f, Add)), None) if isinstance(e, Mul) else None
        if isinstance(e, Add):
            stack.extend(reversed(e.children))
        elif total is not None and total.free and len(factors) + 1 == len(e.children):
            stack.extend(mul(*factors, term) for term in reversed(total.children))
        else:
            (varying if e.free else fixed).append(e)
    return add(*varying), add(*fixed)


def _is_analytic(u: Expr) -> bool:
    """Returns whether u has no branch, kink or step with variables. It is then constant on no piece."""
    kinked = ("magnitude", "min", "max", "floor", "mod")
    return not any(n.free and (isinstance(n, Where) or (isinstance(n, Call) and n.name in kinked)) for n in postorder([u]))


def _narrowed(u: Expr, level: float | None, ranges: Mapping[Var, Range]) -> Mapping[Var, Range]:
    if level is None or len(u.free) != 1 or not _is_analytic(u):
        return ranges
    (v,) = u.free
    if Shadow((v,)).degree(u) != 1:
        return ranges
    ends = [number(e) for e in ranges[v].interval]
    at_zero, rate = number(cast(Expr, substitute(u, {v: ZERO}))), number(slope(u, v))
    if at_zero is None or not rate or ends[0] is None or ends[1] is None:
        return ranges
    cuts = sorted((k - at_zero) / rate for k in (level, level + 1.0))
    lo, hi = max(ends[0], cuts[0]), min(ends[1], cuts[1])
    return {**ranges, v: Range(const(lo), const(hi))} if lo < hi else ranges


def number(e: Expr) -> float | None:
    """Returns the value of an expression without parameters and variables; None for anything else."""
    if isinstance(e, Const):
        return cast(float, e.data)
    order = postorder([e])
    if any(isinstance(n, Param | Var | Integral) for n in order):
        return None
    value = rewrite([e], lambda _, new: _power_of_number(new))[e]
    return cast(float, value.data) if isinstance(value, Const) else None


def greatest_size(e: Expr) -> float:
    """Returns an upper bound of |e| for all parameters: 3 for 2·sin(t) - cos(t); infinite if there is no such number."""
    sizes: dict[Node, float] = {}
    for node in postorder([e]):
        parts = [sizes[c] for c in node.children if isinstance(c, Expr)]
        match node:
            case Const():
                size = abs(cast(float, node.data))
            case Add():
                size = math.fsum(parts)
            case Mul():
                size = math.prod(parts)
            case Pow() if node.exponent > 0 or isinstance(node.base, Const):
                size = abs(number(node) or 0.0) if isinstance(node.base, Const) else parts[0] ** node.exponent
            case Where():
                size = max(parts)
            case Call() if node.name in ("min", "max"):
                size = max(parts)
            case Call() if node.name in _BOUNDED:
                size = _BOUNDED[node.name]
            case Call() if node.name == "magnitude":
                size = parts[0]
            case Expr():
                size = math.inf
            case _:
                continue
        sizes[node] = size if size == size else math.inf
    return sizes[e]


_BOUNDED = {
    "sin": 1.0,
    "cos": 1.0,
    "tanh": 1.0,
    "erf": 1.0,
    "erfc": 2.0,
    "asin": math.pi / 2,
    "acos": math.pi,
    "atan": math.pi / 2,
    "atan2": math.pi,
}


def _power_of_number(node: Node) -> Node:
    """Returns the nearest float to a quotient like 1/3 that simplification kept as it was written."""
    if isinstance(node, Pow) and isinstance(node.base, Const) and node.base.data != 0.0:
        try:
            return const(node.base.data**node.exponent)
        except OverflowError:
            return node
    return node
