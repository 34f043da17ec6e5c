"""Powers, ties, pieces of an integral and estimates of its error, for NumPy and JAX; the rules are those of `teg.program`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from teg.backends.shared.arrays import Arrays
from teg.numerics.quadrature import decay_power, end_rule
from teg.program import (
    AT_END,
    CANCELLED,
    CANCELS,
    EDGE,
    END_DECAY,
    END_INSIDE,
    FAINT,
    HIDDEN,
    NEIGHBOUR,
    NOISE,
    PIECE_EPS,
    PLACED,
    ROUNDING,
    SPENT,
    TIE_EPS,
    UNSEEN,
)


def powi(xp: Any, x: Any, n: int) -> Any:
    """Returns x to an integer power, by squaring; 1/powi(x, -n) where n is negative."""
    if n < 0:
        return 1.0 / powi(xp, x, -n)
    power = xp.float64(1.0)
    while n:
        if n & 1:
            power = power * x
        n >>= 1
        if n:
            x = x * x
    return power


def ties(xp: Any, g: Any, scale: Any) -> Any:
    """Returns for each element whether g vanishes to rounding."""
    return (xp.abs(g) <= TIE_EPS * scale) & xp.isfinite(g)


def resolved(xp: Any, near: Any, g: Any, resolution: Any, order: Any) -> Any:
    """Returns whether g > 0; where g is near 0, the order decides."""
    return xp.where(near, xp.where(order > 0, resolution, xp.logical_not(resolution)), g > 0.0)


def ends_of_pieces(xp: Any, lo: Any, hi: Any, breaks: Sequence[Any]) -> list[Any]:
    """Returns the lower bound, the breaks inside of the bounds, those that are NaN at the lower one, and the upper bound; not sorted."""
    low, high = xp.minimum(lo, hi), xp.maximum(lo, hi)
    return [low, *(xp.minimum(xp.fmax(b, low), high) for b in breaks), high]


def is_wide(xp: Any, p: Any, q: Any) -> Any:
    """Returns whether a piece is longer than rounding."""
    length = q - p
    return (length > PIECE_EPS * xp.maximum(xp.abs(p), xp.abs(q))) | xp.isposinf(length)


def neighbours(arrays: Arrays, points: Any, breaks: Any) -> tuple[Any, Any]:
    """Returns whether the pieces between `points`, which are sorted along the first axis, have a neighbour at their first end, and at their
    last one; `breaks`, along the first axis, may lie outside of the bounds."""
    xp, p, q = arrays.xp, points[:-1], points[1:]
    length = q - p
    least, most = (
        xp.maximum(AT_END * length, PIECE_EPS * xp.maximum(xp.abs(p), xp.abs(q))),
        xp.where(xp.isfinite(length), NEIGHBOUR * length, 0.0),
    )

    def near(distance: Any) -> Any:
        return (least < distance) & (distance < most)

    return arrays.any_of(lambda x: near(p - x), breaks), arrays.any_of(lambda x: near(x - q), breaks)


def rounding(xp: Any, p: Any, q: Any) -> Any:
    """Returns the effect of rounding on the integral over (p, q), relative to the integral of |values|: that of the values, and that of the
    ends."""
    length = q - p
    return 0.5 * ROUNDING + xp.where(xp.isfinite(length), EDGE * xp.maximum(xp.abs(p), xp.abs(q)) / length, 0.0)


def placed(xp: Any, left: Any, middle: Any, right: Any) -> Any:
    """Returns the effect of the rounding of places on the integral over an interval, relative to the integral of |values|, from the places
    of its ends and of its middle, by which an end that is infinite is replaced."""
    p, q = xp.where(xp.isfinite(left), left, middle), xp.where(xp.isfinite(right), right, middle)
    apart = PLACED * xp.maximum(xp.abs(p), xp.abs(q)) / xp.where(q > p, q - p, 1.0)
    return xp.where(q > p, xp.minimum(apart, 1.0), 1.0)


def null_rule_error(xp: Any, nodes: int, sums: Any, size: Any, smooth: Any, closed: bool = False) -> Any:
    """The error of a Gauss rule by the `sums` of its null rules, (6, …), and the integral of |values|; where these are not known to be
    `smooth` no decay is counted on."""
    tail, ratio = null_rule_decay(xp, sums, smooth)
    return null_rule_bound(xp, tail, powi(xp, ratio, decay_power(nodes, closed)), size)


def null_rule_decay(xp: Any, sums: Any, smooth: Any) -> tuple[Any, Any]:
    """The largest coefficients that null rules give, and their decay from one pair to the next; 1 where none is counted on."""
    sums = xp.abs(sums)
    a, b, c = (xp.maximum(sums[i], sums[i + 1]) for i in (0, 2, 4))
    tail = xp.where(b > c, xp.maximum(a, b), a)
    last, before = a / b, b / c
    ratio = xp.maximum(last, before) * xp.maximum(1.0, last / before) ** 3
    ratio = xp.maximum(ratio, (15.0 * ratio - 2.0) / 7.0)
    return tail, xp.where((ratio < 1.0) & smooth, ratio, 1.0)


def unseen_at_ends(xp: Any, nodes: int, ends: Any, values: Any, sums: Any, size: Any) -> Any:
    """The error that values at the two `ends` of an interval, (2, …), show and those at the nodes, (nodes, …), do not; `sums` and `size` as
    for `null_rule_error`."""
    gap, rows = end_rule(nodes, END_INSIDE)
    tail, ratio = null_rule_decay(xp, sums, True)
    apart = xp.abs(ends - xp.tensordot(xp.asarray(rows), values, 1))
    found = gap * xp.sum(xp.where(xp.isfinite(apart) & (apart > END_DECAY * tail * ratio), apart, 0.0), axis=0)
    return xp.where(found > NOISE * size, 4.0 * found, 0.0)


def null_rule_bound(xp: Any, tail: Any, decay: Any, size: Any) -> Any:
    """The error by the largest coefficients and their decay, to the power that the nodes allow."""
    return xp.where(tail <= NOISE * size, 0.0, 4.0 * tail * decay)


def tolerated(xp: Any, tolerance: tuple[float, float], whole: Any, size: Any) -> Any:
    """Returns the error that an interval may have, from its integral of |values| and the integral of |values| over the interval that it is
    a part of; the tolerance is a factor, and a floor of the integral."""
    tol, floor = tolerance
    return xp.maximum(tol * (whole + floor), ROUNDING * size)


def overspent(xp: Any, tolerance: tuple[float, float], spent: Any, whole: Any, total: Any) -> Any:
    """Returns whether the errors that were `spent` on a piece are too large together, for its integral of |values|, or for its integral,
    where values cancel."""
    cancelled = xp.maximum(CANCELLED * tolerance[0] * (xp.abs(total) + CANCELS), SPENT * ROUNDING * whole)
    return xp.any(spent > xp.minimum(SPENT * tolerated(xp, tolerance, whole, whole), cancelled))


def is_unseen(xp: Any, upper: Any, lower: Any, seen: Any, endless: Any) -> Any:
    """Returns whether a sharp value between these bounds may be much larger than the nodes have `seen`; in an `endless` gap the lower bound
    does not count."""
    higher = upper > UNSEEN * xp.fmax(seen, FAINT)
    return higher | ((upper > HIDDEN * xp.fmax(lower, FAINT)) & ~endless)
