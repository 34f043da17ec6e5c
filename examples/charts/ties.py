"""Cases in which surfaces coincide with one another or with bounds, and in which bounds are unusual."""

from __future__ import annotations

from typing import Any

from teg.examples.charts.case import SYMMETRIC, UNIT, Case, case


def _corner(m: Any, t: Any) -> Any:
    """Returns the area of x + y < t in the unit square."""
    return t**2 / 2 if t <= 1 else 1 - (2 - t) ** 2 / 2


def _mean_of_steps(m: Any, x: Any, t: Any, a: Any) -> Any:
    return m.bracket(x < t) - m.bracket(x < a)


TIES: tuple[Case, ...] = (
    case("the same bracket twice", lambda m, x, t: m.bracket(x < t) * m.bracket(x < t), (UNIT,), {"t": 0.5}, lambda m, t: t),
    case("a condition and itself", lambda m, x, t: m.bracket((x < t) & (x < t)), (UNIT,), {"t": 0.5}, lambda m, t: t),
    case(
        "a condition in a condition",
        lambda m, x, t: m.bracket(m.where(x < t, -1.0, 1.0) > 0),
        (UNIT,),
        {"t": 0.5},
        lambda m, t: 1 - t,
    ),
    case("a bracket inside a sine", lambda m, x, t: m.sin(2 * m.bracket(x < t)), (UNIT,), {"t": 0.3}, lambda m, t: t * m.sin(2)),
    case(
        "a bracket times its complement",
        lambda m, x, t: m.bracket(x < t) * m.bracket(x >= t) * m.exp(x),
        (UNIT,),
        {"t": 0.5},
        lambda m, t: 0 * t,
    ),
    case(
        "a cube of a difference, both at one place",
        lambda m, x, t, a: _mean_of_steps(m, x, t, a) ** 3,
        (UNIT,),
        {"t": 0.5, "a": 0.5},
        lambda m, t, a: t - a,
    ),
    case(
        "a square of a difference, both at one place",
        lambda m, x, t, a: _mean_of_steps(m, x, t, a) ** 2,
        (UNIT,),
        {"t": 0.5, "a": 0.5},
        lambda m, t, a: abs(t - a),
        kinked=True,
    ),
    case(
        "two brackets at one place",
        lambda m, x, t, a: m.bracket(x < t) * m.bracket(x < a),
        (UNIT,),
        {"t": 0.5, "a": 0.5},
        lambda m, t, a: min(t, a),
        kinked=True,
    ),
    case(
        "two half-planes, one line",
        lambda m, x, y, t, s: m.bracket(x + y < t) * m.bracket(2 * x + 2 * y < s),
        (UNIT, UNIT),
        {"t": 0.75, "s": 1.5},
        lambda m, t, s: min(t, s / 2) ** 2 / 2,
        kinked=True,
    ),
    case("a line through two corners", lambda m, x, y, t: m.bracket(x + y < t), (UNIT, UNIT), {"t": 1.0}, _corner),
    case(
        "a line through a corner of two others",
        lambda m, x, y, a, b, s: m.bracket(x < a) * m.bracket(y < b) * m.bracket(x + y < s),
        (UNIT, UNIT),
        {"a": 0.25, "b": 0.5, "s": 0.75},
        lambda m, a, b, s: a * b - max(a + b - s, 0) ** 2 / 2,
    ),
    case(
        "a line on a side of the domain",
        lambda m, x, y, t: m.bracket(x < t) * m.exp(y),
        (UNIT, UNIT),
        {"t": 1.0},
        lambda m, t: min(t, 1) * (m.exp(1) - 1),
        kinked=True,
    ),
    case(
        "a square whose sides are those of the domain",
        lambda m, x, y, s: m.bracket(m.maximum(m.abs(x), m.abs(y)) < s),
        (SYMMETRIC, SYMMETRIC),
        {"s": 1.0},
        lambda m, s: min(2 * s, 2) ** 2,
        kinked=True,
    ),
    case("a jump at the upper bound", lambda m, x, t: m.bracket(x < t), (UNIT,), {"t": 1.0}, lambda m, t: min(t, 1), kinked=True),
    case(
        "a jump at the lower bound",
        lambda m, x, t: m.bracket(x < t) * m.exp(x),
        (UNIT,),
        {"t": 0.0},
        lambda m, t: m.exp(max(t, 0)) - 1,
        kinked=True,
    ),
    case(
        "a jump 2⁻⁴⁷ below the upper bound",
        lambda m, x, t: m.bracket(x < t) * m.exp(x),
        (UNIT,),
        {"t": 1 - 2.0**-47},
        lambda m, t: m.exp(t) - 1,
    ),
)

BOUNDS: tuple[Case, ...] = (
    case("a bound that is the jump", lambda m, x, t: m.bracket(x < t), ((0.0, lambda m, t: t),), {"t": 0.5}, lambda m, t: t),
    case(
        "bounds the wrong way round",
        lambda m, x, t: m.bracket(x < t) * m.exp(x),
        ((1.0, 0.0),),
        {"t": 0.3},
        lambda m, t: 1 - m.exp(t),
    ),
    case(
        "bounds that cross inside the outer domain",
        lambda m, x, y, t: m.bracket(x < t),
        ((lambda m, y, t: y, lambda m, y, t: 1 - y), UNIT),
        {"t": 0.3},
        lambda m, t: 0 * t,
    ),
    case(
        "bounds that cross, and a weight",
        lambda m, x, y, t: m.bracket(x < t) * y,
        ((lambda m, y, t: y, lambda m, y, t: 1 - y), UNIT),
        {"t": 0.3},
        lambda m, t: t**3 / 3 - t**2 / 2,
    ),
    case(
        "an empty interval",
        lambda m, x, t: m.bracket(x < 2 * t) * m.exp(x),
        ((lambda m, t: t, lambda m, t: t),),
        {"t": 0.4},
        lambda m, t: 0 * t,
    ),
    case(
        "an interval that opens",
        lambda m, x, t, s: m.bracket(x < 1) * m.exp(x),
        ((lambda m, t, s: t, lambda m, t, s: s),),
        {"t": 0.4, "s": 0.4},
        lambda m, t, s: m.exp(s) - m.exp(t),
    ),
    case(
        "a triangle by its bounds, cut by a line",
        lambda m, x, y, t: m.bracket(x + y < t),
        ((0.0, lambda m, y, t: y), UNIT),
        {"t": 1.0},
        lambda m, t: t**2 / 4 - max(t - 1, 0) ** 2 / 2,
    ),
    case(
        "a disk by its bounds, cut by a line",
        lambda m, x, y, t: m.bracket(x < t),
        ((lambda m, y, t: -m.sqrt(1 - y * y), lambda m, y, t: m.sqrt(1 - y * y)), SYMMETRIC),
        {"t": 0.3},
        lambda m, t: m.pi - m.acos(t) + t * m.sqrt(1 - t * t),
    ),
    case(
        "a bound at which the integrand is infinite",
        lambda m, x, t: m.bracket(x < t) / m.sqrt(x),
        (UNIT,),
        {"t": 0.5},
        lambda m, t: 2 * m.sqrt(t),
    ),
    case(
        "a bound at which the logarithm is infinite",
        lambda m, x, t: m.bracket(x < t) * m.log(x),
        (UNIT,),
        {"t": 0.5},
        lambda m, t: t * m.log(t) - t,
    ),
    case(
        "an untaken branch that is not a number",
        lambda m, x, t: m.where(x < t, m.sqrt(t - x), 0.0),
        (UNIT,),
        {"t": 0.5},
        lambda m, t: 2 * t * m.sqrt(t) / 3,
    ),
    case("a kink", lambda m, x, t: m.abs(x - t), (UNIT,), {"t": 0.3}, lambda m, t: (t**2 + (1 - t) ** 2) / 2),
    case(
        "steps of a floor",
        lambda m, x, t: m.floor(4 * x + t) * x,
        (UNIT,),
        {"t": 0.3},
        lambda m, t: sum((1 - ((k - t) / 4) ** 2) / 2 for k in (1, 2, 3, 4)),
    ),
)
