"""Upper bounds of sharp values over boxes that reach to infinity, where natural enclosures are infinite.

A function that grows in one part and falls in another has no finite enclosure there: with a density x²·exp(-x) over (0, ∞) neither the
power x² has one, nor the exponential if it is written exp(2·log x - x). But far away

    uᵏ, 0 < k <= GENTLE     changes by a factor over a range that doubles, and hides no narrow peak: its least value is as good as seen;
                            so does exp u or cosh u where x·u′ is a number k, or u = k·log v + c
    a sum                   has its value at the finite end of the box as a bound, where the enclosure of its slope has one sign

An exponential that may rise, cosh u, and steeper powers have no such bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import count
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.intervals import Enclosure, Interval, product_of_endless
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, Add, Call, Cond, Expr, Mul, Pow, Var, const
from teg.ir.node import postorder
from teg.ir.simplify import add, call, conjunction, mul, positive, sub, where
from teg.ir.traverse import substitute

GENTLE = 64.0
"""The largest power that hides no narrow peak far away: exponentials beside it, of known scale, have their nodes there."""
MAX_SLOPES = 3
"""The largest number of times that a slope of a slope is enclosed: enough for polynomials of that degree more than linear."""
MOST_SLOPES = 16
"""The largest number of sums in one value whose slopes are enclosed. Slopes of slopes hold many sums, and bounds with many are too long."""
MAX_NODES = 1000
"""The largest number of nodes of a bound. A longer one is not computed."""
_INFINITY = const(math.inf)
_LARGEST = const(1e300)


def bound_to_infinity(value: Expr, lower: Expr, x: Var, box: Mapping[Var, Interval]) -> Expr | None:
    """Returns an upper bound of a sharp value with this lower bound over a box that reaches to infinity in x.

    It is infinite over other boxes, and NaN where it is not known. None if there is no better bound than the natural one, or if the box
    has other variables of the value.
    """
    if x not in value.free or any(v in value.free for v, (low, high) in box.items() if v is not x and low is not high):
        return None
    left, right = box[x]
    endless_left, endless_right = _is_infinite(mul(MINUS_ONE, left)), _is_infinite(right)
    if (power := _power_of(value, x)) is not None:
        gentle = conjunction(positive(power), positive(sub(const(GENTLE), power), strict=False), positive(lower))
        bound = where(gentle, lower, _INFINITY)
    else:
        enclosure = _FarEnclosure(box, x, endless_right)
        try:
            bound = enclosure.of(value)[1]
        except NotDifferentiableError:
            return None
        if not enclosure.refined or len(postorder([bound])) > MAX_NODES:
            return None
    return where(endless_right, bound, where(endless_left, bound, _INFINITY))


class _FarEnclosure(Enclosure):
    """The enclosure over a box that is infinite at one end, with bounds of sums from their slopes; `number` counts these."""

    def __init__(
        self, box: Mapping[Var, Interval], x: Var, endless_right: Cond, depth: int = 0, number: Iterator[int] | None = None
    ) -> None:
        super().__init__(box)
        self.x, self.endless_right, self.depth, self.refined = x, endless_right, depth, False
        self.number = count() if number is None else number

    def _product(self, a: Interval, b: Interval) -> Interval:
        return product_of_endless(a, b)

    def _interval(self, e: Expr) -> Interval:
        natural = super()._interval(e)
        if self.depth >= MAX_SLOPES or not isinstance(e, Add) or sum(self.x in term.free for term in e.children) < 2:
            return natural
        if next(self.number) >= MOST_SLOPES:
            return natural
        try:
            slowest, fastest = _FarEnclosure(self.box, self.x, self.endless_right, self.depth + 1, self.number).of(slope(e, self.x))
        except NotDifferentiableError:
            return natural
        self.refined = True
        at_left, at_right = (cast(Expr, substitute(e, {self.x: end})) for end in self.box[self.x])
        falls, rises = positive(mul(MINUS_ONE, fastest), strict=False), positive(slowest, strict=False)
        lo = where(self.endless_right, where(rises, at_left, natural[0]), where(falls, at_right, natural[0]))
        hi = where(self.endless_right, where(falls, at_left, natural[1]), where(rises, at_right, natural[1]))
        return lo, hi


def _is_infinite(end: Expr) -> Cond:
    return positive(sub(end, _LARGEST))


def _power_of(value: Expr, x: Var) -> Expr | None:
    """Returns the exponent k of a power, or of its size, or of an exponential that grows as xᵏ or x⁻ᵏ; None for other values."""
    if isinstance(value, Call) and value.name == "magnitude":
        value = value.children[0]
    match value:
        case Pow() if value.exponent > 0:
            return const(value.exponent)
        case Call() if value.name == "pow" and x not in value.children[1].free:
            return value.children[1]
        case Call() if value.name in ("exp", "cosh"):
            if (factor := factor_of_logarithm(value.children[0], x)) is not None:
                return call("magnitude", factor)
            rate = _slope_times(x, value.children[0])
            return None if rate is None or x in rate.free else call("magnitude", rate)
        case _:
            return None


def factor_of_logarithm(u: Expr, x: Var) -> Expr | None:
    """Returns the factor k of u = k·log v + c, where only v depends on x; None for other functions."""
    terms = [e for e in (u.children if isinstance(u, Add) else (u,)) if x in e.free]
    factors = terms[0].children if len(terms) == 1 and isinstance(terms[0], Mul) else tuple(terms)
    moving = [f for f in factors if x in f.free]
    if len(moving) != 1 or not isinstance(moving[0], Call) or moving[0].name not in ("log", "log1p"):
        return None
    return mul(*(f for f in factors if f is not moving[0]))


def _slope_times(x: Var, u: Expr) -> Expr | None:
    """Returns x·u′; None if u has no slope."""
    try:
        rate = slope(u, x)
    except NotDifferentiableError:
        return None
    return add(*(mul(x, term) for term in rate.children)) if isinstance(rate, Add) else mul(x, rate)
