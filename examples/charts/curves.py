"""Cases in which curves touch, are born at a point, or cross themselves."""

from __future__ import annotations

import math
from typing import Any

from teg.examples.charts.case import SYMMETRIC, UNIT, Case, case

SQUARE = (SYMMETRIC, SYMMETRIC)


def _disk(x: Any, y: Any, c: Any, r: Any) -> Any:
    return (x - c) ** 2 + y**2 < r**2


def _segment(m: Any, r: Any, h: Any) -> Any:
    """Returns the area of the part of a disk of radius r beyond a chord at distance h from the centre; 0 if h > r."""
    return r**2 * m.acos(h / r) - h * m.sqrt(r**2 - h**2) if h < r else 0 * r


def _common(m: Any, d: Any, r: Any, s: Any) -> Any:
    """Returns the area common to two disks of radii r and s, at distance d."""
    if d >= r + s:
        return 0 * r
    if d <= abs(r - s):
        return m.pi * min(r, s) ** 2
    return _segment(m, r, (d**2 + r**2 - s**2) / (2 * d)) + _segment(m, s, (d**2 + s**2 - r**2) / (2 * d))


def _bilinear(m: Any, x: Any, y: Any, *parameters: Any) -> Any:
    a, b, c, d, t = parameters
    return m.bracket(a * (1 - x) * (1 - y) + b * x * (1 - y) + c * (1 - x) * y + d * x * y > t)


def _bilinear_area(m: Any, a: Any, b: Any, c: Any, d: Any, t: Any) -> Any:
    """Returns the area above t of a saddle with a, d > t > b, c: a hyperbola's branches cut off two corners of the square, or leave them.

    The surface is y = (a - b)/slope + (t - saddle)/(slope·(x - pole)), slope = a - b - c + d.
    """
    slope = a - b - c + d
    pole = (a - c) / slope
    saddle = (a * d - b * c) / slope

    def cut(u: Any, v: Any) -> Any:  # ∫ of the surface's y
        return (v - u) * (a - b) / slope + (t - saddle) / slope * m.log(abs((v - pole) / (u - pole)))

    at_bottom, at_top = (a - t) / (a - b), (t - c) / (d - c)
    if t < saddle:  # the region is connected, without the corners b and c
        missing_c = at_top - cut(0, at_top)
        missing_b = cut(at_bottom, 1)
        return 1 - missing_b - missing_c
    return cut(0, at_bottom) + (1 - at_top) - cut(at_top, 1)


def _above_parabola(m: Any, t: Any) -> Any:
    """Returns ∫ over (-1, 1) of t + x², clamped to between 0 and 1."""
    if t < 0:
        return 2 * (t + m.mpf(1) / 3 + 2 * m.sqrt(-t) ** 3 / 3)
    s = m.sqrt(1 - t)
    return 2 * (t * s + s**3 / 3 + 1 - s)


CORNERS = {"a": 0.75, "b": 0.0, "c": -0.25, "d": 0.5}

TANGENCIES: tuple[Case, ...] = (
    case(
        "a disk that touches a side from within",
        lambda m, x, y, c, r: m.bracket(_disk(x, y, c, r)),
        (SYMMETRIC, UNIT),
        {"c": 0.75, "r": 0.25},
        lambda m, c, r: (m.pi * r**2 - _segment(m, r, 1 - c)) / 2,
    ),
    case(
        "a disk that touches a side from outside",
        lambda m, x, y, c, r: m.bracket(_disk(x, y, c, r)),
        SQUARE,
        {"c": 1.25, "r": 0.25},
        lambda m, c, r: _segment(m, r, c - 1),
    ),
    case(
        "a disk that touches four sides",
        lambda m, x, y, r: m.bracket(_disk(x, y, 0, r)),
        SQUARE,
        {"r": 1.0},
        lambda m, r: m.pi * r**2 - 4 * _segment(m, r, 1),
    ),
    case(
        "circles that touch, one inside the other",
        lambda m, x, y, c, r: m.bracket(_disk(x, y, c, r)) * m.bracket(_disk(x, y, 0, 0.5)),
        SQUARE,
        {"c": 0.25, "r": 0.25},
        lambda m, c, r: _common(m, c, r, m.mpf("0.5")),
    ),
    case(
        "circles that touch, outside each other",
        lambda m, x, y, c, r: m.bracket(_disk(x, y, c, r)) * m.bracket(_disk(x, y, -0.25, 0.25)),
        SQUARE,
        {"c": 0.25, "r": 0.25},
        lambda m, c, r: _common(m, c + m.mpf("0.25"), r, m.mpf("0.25")),
    ),
    case(
        "a line that touches a circle",
        lambda m, x, y, r, t: m.bracket(_disk(x, y, 0, r)) * m.bracket(x < t),
        SQUARE,
        {"r": 0.5, "t": 0.5},
        lambda m, r, t: m.pi * r**2 - _segment(m, r, t),
    ),
    case(
        "a parabola that touches a side",
        lambda m, x, y, t: m.bracket(y < t + x * x),
        (SYMMETRIC, UNIT),
        {"t": 0.0},
        _above_parabola,
    ),
    case(
        "circles that nearly touch",
        lambda m, x, y, c, r: m.bracket(_disk(x, y, c, r)) * m.bracket(_disk(x, y, -0.25, 0.25)),
        SQUARE,
        {"c": 0.25 - 2.0**-14, "r": 0.25},
        lambda m, c, r: _common(m, c + m.mpf("0.25"), r, m.mpf("0.25")),
    ),
    case("a square that is never negative", lambda m, x, t: m.bracket((x - t) ** 2 > 0), (UNIT,), {"t": 0.5}, lambda m, t: 1 + 0 * t),
    case(
        "a double root",
        lambda m, x, t: m.bracket((x + 0.5) * (x - 0.25) ** 2 > t),
        (UNIT,),
        {"t": 0.0},
        lambda m, t: 1 + 0 * t,
        infinite={"t": -math.inf},
    ),
)

BIRTHS: tuple[Case, ...] = (
    case(
        "an interval that is born",
        lambda m, x, t: m.bracket(x**2 < t),
        (SYMMETRIC,),
        {"t": 0.0},
        lambda m, t: 2 * m.sqrt(max(t, 0)),
        infinite={"t": math.inf},
    ),
    case(
        "a disk that is born",
        lambda m, x, y, t: m.bracket(x**2 + y**2 < t),
        SQUARE,
        {"t": 0.0},
        lambda m, t: m.pi * max(t, 0),
        kinked=True,
    ),
    case(
        "two lines that cross, xy > 0",
        lambda m, x, y, t: m.bracket(x * y > t),
        SQUARE,
        {"t": 0.0},
        lambda m, t: 2 + 0 * t,
        infinite={"t": -math.inf},
    ),
    case(
        "near a crossing, xy > 10⁻⁶",
        lambda m, x, y, t: m.bracket(x * y > t),
        SQUARE,
        {"t": 1e-6},
        lambda m, t: 2 * (1 - t + t * m.log(t)),
    ),
    case(
        "near a crossing, x² - y² < 10⁻⁸",
        lambda m, x, y, t: m.bracket(x * x - y * y < t),
        SQUARE,
        {"t": 1e-8},
        lambda m, t: 2 * (m.sqrt(1 - t) + t * m.asinh(m.sqrt((1 - t) / t))) + 4 * (1 - m.sqrt(1 - t)),
    ),
    case("2⁻¹⁰ above a saddle", _bilinear, (UNIT, UNIT), CORNERS | {"t": 0.25 + 2.0**-10}, _bilinear_area),
    case("2⁻²⁰ below a saddle", _bilinear, (UNIT, UNIT), CORNERS | {"t": 0.25 - 2.0**-20}, _bilinear_area),
    case(
        "a figure of eight at its crossing",
        lambda m, x, y, t: m.bracket(x**4 - x**2 + y**2 < t),
        ((-1.25, 1.25), SYMMETRIC),
        {"t": 0.0},
        lambda m, t: m.mpf(4) / 3 + 0 * t,
        infinite={"t": math.inf},
    ),
    case(
        "a cusp",
        lambda m, x, y, t: m.bracket(y**2 < x**3 + t),
        SQUARE,
        {"t": 0.0},
        lambda m, t: m.mpf(4) / 5 + t * 0,
        infinite={"t": math.inf},
    ),
)
