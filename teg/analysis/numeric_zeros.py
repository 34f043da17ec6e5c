"""Whether an expression is 0 on a surface, by numbers: where an identity of functions is at work, as in log x + log y and log(x·y).

Values in a finite field decide polynomials and quotients (`teg.analysis.coincidence`), but know nothing of functions. Here random points of
the surface are found by bisection, in all symbols, parameters too; the expression must be 0 at every one of them to TOLERANCE of its
terms. A coincidence at some values of the parameters only is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from teg.analysis.evaluate import values_of
from teg.errors import OperandError
from teg.ir.expr import Add, Call, Compare, Expr, Mul, Param, Var, Where
from teg.ir.integral import Integral
from teg.ir.node import Node, postorder

TRIALS = 32
"""The number of random choices of all symbols but one; half of them have positive values only, for roots and logarithms."""
STEPS = 96
"""The number of steps in which a sign change of the remaining symbol is looked for, from -REACH to REACH."""
REACH = 4.0
HALVINGS = 60
FEWEST = 3
"""The fewest points that prove anything."""
TOLERANCE = 2.0**-45
"""The largest value at a point, relative to the sum of the sizes of the terms: less than 3e-14 is what rounding leaves."""
LEAST = 1e-200
"""Smaller terms may have lost their digits, or underflown."""
MOST_NODES = 300
"""Larger expressions are not looked at."""

Points = Mapping[Expr, Any]


def is_zero_on(e: Expr, g: Expr) -> bool:
    """Returns whether e is 0 on the surface g = 0, if one of them has a function in it; False if that is not known."""
    if not ((_has_function(e) or _has_function(g)) and _can_be_tried(e) and _can_be_tried(g)):
        return False
    points = _zeros(g)
    if points is None:
        return False
    import numpy as np

    n = len(next(iter(points.values())))
    more = np.random.default_rng(2)
    others = {s: more.uniform(0.05, 0.95, n) for s in _symbols(e) if s not in points}
    try:
        small, is_finite = _vanishes(e, {**others, **points})
    except OperandError:
        return False
    return bool(is_finite.sum() >= FEWEST and small[is_finite].all())


def _can_be_tried(e: Expr) -> bool:
    """Returns whether an expression is small, and smooth: at a tie rounding would decide a condition."""
    return not e.kinds & (Where.bit | Compare.bit | Integral.bit) and _is_small(e)


def _is_small(e: Node) -> bool:
    """Returns whether an expression has at most MOST_NODES nodes, of which no more are visited."""
    seen: set[Node] = set()
    stack = [e]
    while stack and len(seen) <= MOST_NODES:
        node = stack.pop()
        if node not in seen:
            seen.add(node)
            stack.extend(node.children)
    return len(seen) <= MOST_NODES


def _has_function(e: Expr) -> bool:
    return e.kinds & Call.bit != 0


def _symbols(e: Expr) -> list[Expr]:
    """Returns the variables and then the parameters of an expression, by name."""
    symbols = [n for n in postorder([e]) if isinstance(n, Var | Param)]
    return [*sorted(symbols, key=lambda s: (isinstance(s, Param), s.name))]


def _vanishes(e: Expr, at: Points) -> tuple[Any, Any]:
    """Returns where e is 0 but for rounding, and where it is finite. Terms cancel there; a number that underflows is not 0."""
    import numpy as np

    terms = e.children if isinstance(e, Add) else (e,)
    (value, *sizes) = values_of([e, *terms], at)
    shape = np.broadcast_shapes(*(np.shape(v) for v in at.values()))
    if isinstance(e, Mul):
        small = np.any([np.zeros(shape, dtype=bool), *(_vanishes(f, at)[0] for f in e.children if isinstance(f, Add))], axis=0)
    else:
        scale = sum(np.abs(s) for s in sizes)
        small = (np.abs(value) <= TOLERANCE * scale) & (scale > LEAST)
    return np.broadcast_to(small, shape), np.broadcast_to(np.isfinite(value), shape)


@lru_cache(maxsize=64)
def _zeros(g: Expr) -> Points | None:
    """Returns at least FEWEST random points of g = 0, an array for each symbol; None if none are found."""
    symbols = _symbols(g)
    for pivot in symbols:
        try:
            points = _zeros_along(g, symbols, pivot)
        except OperandError:
            return None
        if points is not None:
            return points
    return None


def _zeros_along(g: Expr, symbols: list[Expr], pivot: Expr) -> Points | None:
    import numpy as np

    random = np.random.default_rng(1)
    half = TRIALS // 2
    at = {s: np.concatenate([random.uniform(0.05, 0.95, half), random.uniform(-2.0, 2.0, TRIALS - half)])[:, None] for s in symbols}
    steps = np.linspace(-REACH, REACH, STEPS)[None, :] * np.sqrt(0.9) + 0.01
    with np.errstate(all="ignore"):
        signs = np.sign(np.broadcast_to(values_of([g], {**at, pivot: steps})[0], (TRIALS, STEPS)))
    changes = signs[:, :-1] * signs[:, 1:] < 0
    rows = np.flatnonzero(changes.any(axis=1))
    if rows.size < FEWEST:
        return None
    first, last = changes[rows].argmax(axis=1), STEPS - 2 - changes[rows, ::-1].argmax(axis=1)
    left = np.where(rows % 2, first, last)
    low, high = steps[0, left], steps[0, left + 1]
    at = {s: v[rows, 0] for s, v in at.items()}
    below = signs[rows, left]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        is_left = np.sign(values_of([g], {**at, pivot: middle})[0]) == below
        low, high = np.where(is_left, middle, low), np.where(is_left, high, middle)
    at[pivot] = 0.5 * (low + high)
    small, _ = _vanishes(g, at)
    return {s: v[small] for s, v in at.items()} if small.sum() >= FEWEST else None
