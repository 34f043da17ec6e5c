"""Cases with thin regions, coefficients that vanish, and very large and small numbers."""

from __future__ import annotations

from typing import Any

from teg.examples.charts.case import SYMMETRIC, UNIT, Case, case
from teg.examples.charts.curves import SQUARE, _common


def _edges(x: Any, y: Any, corners: Any) -> Any:
    inside = None
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0
        inside = edge if inside is None else inside & edge
    return inside


def _graph_area(m: Any, t: Any, f: Any) -> Any:
    """Returns ∫₀¹ of f, clamped to between 0 and 1, where f falls from above 0 to 0 at t (or does not reach 0)."""
    return m.quad(f, [0, min(t, 1)])


SLIVERS: tuple[Case, ...] = (
    case(
        "between two lines 10⁻¹⁰ apart",
        lambda m, x, y, t, s, c: m.bracket(x + y < t) * m.bracket(x + c * y > s) * m.exp(x),
        (UNIT, UNIT),
        {"t": 0.7000000001, "s": 0.7, "c": 1.0000000002},
        lambda m, t, s, c: m.exp(t) - 1 - (m.exp(s) - 1) / c - (t - s / c),
    ),
    case(
        "a triangle of height 10⁻⁹",
        lambda m, x, y, u, h: m.bracket(_edges(x, y, ((0.0, 0.0), (1.0, 0.0), (u, h)))),
        (SYMMETRIC, SYMMETRIC),
        {"u": 0.5, "h": 1e-9},
        lambda m, u, h: h / 2,
    ),
    case(
        "a triangle of area 10⁻³ at (512, 512)",
        lambda m, x, y, u, v: m.bracket(_edges(x, y, ((512.0, 512.0), (513.0, 512.5), (u, v)))),
        ((511.0, 514.0), (511.0, 514.0)),
        {"u": 512.5, "v": 512.252},
        lambda m, u, v: ((v - 512) - (u - 512) / 2) / 2,
    ),
    case(
        "a strip of width 10⁻¹²",
        lambda m, x, h: m.bracket(x > 0) * m.bracket(x < h),
        (SYMMETRIC,),
        {"h": 1e-12},
        lambda m, h: h,
    ),
    case(
        "a ring of width 10⁻⁶",
        lambda m, x, y, r, s: m.bracket(x * x + y * y < r * r) * m.bracket(x * x + y * y > s * s),
        SQUARE,
        {"r": 0.5 + 2.0**-20, "s": 0.5},
        lambda m, r, s: m.pi * (r**2 - s**2),
    ),
    case(
        "an ellipse of half-width 10⁻⁶",
        lambda m, x, y, b: m.bracket(x * x + (y / b) ** 2 < 0.25),
        SQUARE,
        {"b": 2e-6},
        lambda m, b: m.pi * b / 4,
    ),
    case(
        "a lens of thickness 10⁻⁴",
        lambda m, x, y, c: m.bracket((x - c) ** 2 + y * y < 1) * m.bracket((x + 1) ** 2 + y * y < 1),
        SQUARE,
        {"c": 1 - 1e-4},
        lambda m, c: _common(m, c + 1, m.mpf(1), m.mpf(1)),
    ),
    case(
        "seven stripes of a sine",
        lambda m, x, t: m.bracket(m.sin(40 * x) > t),
        (UNIT,),
        {"t": 0.3},
        lambda m, t: (6 * (m.pi - 2 * m.asin(t)) + max(min(40 - 12 * m.pi, m.pi - m.asin(t)) - m.asin(t), 0)) / 40,
    ),
    case(
        "a Gaussian of width 10⁻³, cut",
        lambda m, x, t: m.bracket(x < t) * m.exp(-((1000 * (x - 0.3)) ** 2)),
        (UNIT,),
        {"t": 0.3005},
        lambda m, t: m.sqrt(m.pi) / 2000 * (m.erf(1000 * (t - m.mpf(0.3))) + m.erf(1000 * m.mpf(0.3))),
    ),
)

COEFFICIENTS: tuple[Case, ...] = (
    case(
        "ax + by < c with a = 0",
        lambda m, x, y, a, b, c: m.bracket(a * x + b * y < c),
        (UNIT, UNIT),
        {"a": 0.0, "b": 1.0, "c": 0.5},
        lambda m, a, b, c: c / b - a / (2 * b),
    ),
    case(
        "ax + by < c with a = 10⁻¹²",
        lambda m, x, y, a, b, c: m.bracket(a * x + b * y < c) * m.exp(x),
        (UNIT, UNIT),
        {"a": 1e-12, "b": 1.0, "c": 0.5},
        lambda m, a, b, c: (c * (m.exp(1) - 1) - a) / b,
    ),
    case(
        "ax + by < c with a = b = 0",
        lambda m, x, y, a, b, c: m.bracket(a * x + b * y < c),
        (UNIT, UNIT),
        {"a": 0.0, "b": 0.0, "c": 0.5},
        lambda m, a, b, c: m.mpf(1),
    ),
    case(
        "ax² + x < t with a = 0",
        lambda m, x, a, t: m.bracket(a * x * x + x < t),
        (UNIT,),
        {"a": 0.0, "t": 0.5},
        lambda m, a, t: 2 * t / (1 + m.sqrt(1 + 4 * a * t)),
    ),
    case(
        "ax² + x < t with a = 10⁻¹⁴",
        lambda m, x, a, t: m.bracket(a * x * x + x < t) * m.exp(x),
        (UNIT,),
        {"a": 1e-14, "t": 0.5},
        lambda m, a, t: m.exp(2 * t / (1 + m.sqrt(1 + 4 * a * t))) - 1,
    ),
    case(
        "ax³ + x < t with a = 10⁻¹⁵",
        lambda m, x, a, t: m.bracket(a * x**3 + x < t),
        (UNIT,),
        {"a": 1e-15, "t": 0.5},
        lambda m, a, t: m.findroot(lambda x: a * x**3 + x - t, t),
    ),
    case(
        "ax² < t with a = 0",
        lambda m, x, a, t: m.bracket(a * x * x < t),
        (SYMMETRIC,),
        {"a": 0.0, "t": 0.5},
        lambda m, a, t: m.mpf(2),
    ),
    case(
        "ax² + y² < t with a = 0",
        lambda m, x, y, a, t: m.bracket(a * x * x + y * y < t),
        SQUARE,
        {"a": 0.0, "t": 0.25},
        lambda m, a, t: 4 * m.quad(lambda x: m.sqrt(t - a * x * x), [0, 1]),
    ),
    case(
        "axy + bx + cy < t with a = 0",
        lambda m, x, y, a, b, c, t: m.bracket(a * x * y + b * x + c * y < t),
        (UNIT, UNIT),
        {"a": 0.0, "b": 1.0, "c": 1.0, "t": 0.75},
        lambda m, a, b, c, t: _graph_area(m, t / c, lambda y: (t - c * y) / (a * y + b)),
    ),
    case(
        "axy + bx + cy < t with a = 10⁻¹³",
        lambda m, x, y, a, b, c, t: m.bracket(a * x * y + b * x + c * y < t),
        (UNIT, UNIT),
        {"a": 1e-13, "b": 1.0, "c": 1.0, "t": 0.75},
        lambda m, a, b, c, t: _graph_area(m, t / c, lambda y: (t - c * y) / (a * y + b)),
    ),
    case(
        "axy + bx + cy < t with a = 10⁻¹⁵",
        lambda m, x, y, a, b, c, t: m.bracket(a * x * y + b * x + c * y < t),
        (UNIT, UNIT),
        {"a": 1e-15, "b": 1.0, "c": 1.0, "t": 0.75},
        lambda m, a, b, c, t: _graph_area(m, t / c, lambda y: (t - c * y) / (a * y + b)),
    ),
)

EXTREMES: tuple[Case, ...] = (
    case(
        "x² < 10⁻¹⁶",
        lambda m, x, t: m.bracket(x**2 < t) * m.cos(x),
        (SYMMETRIC,),
        {"t": 1e-16},
        lambda m, t: 2 * m.sin(m.sqrt(t)),
    ),
    case(
        "coefficients 10⁸ and 10⁻⁸",
        lambda m, x, y, a, b, c: m.bracket(a * x + b * y < c) * m.exp(x) * m.cos(y),
        (UNIT, UNIT),
        {"a": 1e8, "b": 1e-8, "c": 3e7},
        lambda m, a, b, c: m.quad(lambda y: (m.exp((c - b * y) / a) - 1) * m.cos(y), [0, 1]),
    ),
    case(
        "a domain at 10⁸",
        lambda m, x, t: m.bracket(x < t) / x,
        ((1e8, 1e8 + 1),),
        {"t": 1e8 + 0.25},
        lambda m, t: m.log(t / m.mpf(10) ** 8),
    ),
    case(
        "a feature of size 2 in a domain of 10⁸",
        lambda m, x, t: m.bracket(x < t) * m.exp(-x),
        ((0.0, 1e8),),
        {"t": 2.0},
        lambda m, t: 1 - m.exp(-t),
    ),
    case(
        "a disk of radius 1 in a domain of 10⁶",
        lambda m, x, y, r: m.bracket(x * x + y * y < r * r),
        ((-1e6, 1e6), (-1e6, 1e6)),
        {"r": 1.0},
        lambda m, r: m.pi * r**2,
    ),
    case(
        "a disk of radius 10⁻⁶",
        lambda m, x, y, r: m.bracket((x - 0.3) ** 2 + (y - 0.1) ** 2 < r * r),
        SQUARE,
        {"r": 1e-6},
        lambda m, r: m.pi * r**2,
    ),
    case(
        "a disk with its centre at (10⁶, 10⁶)",
        lambda m, x, y, c, r: m.bracket((x - c) ** 2 + (y - 1e6) ** 2 < r * r) * (x - 1e6),
        ((1e6 - 1, 1e6 + 1), (1e6 - 1, 1e6 + 1)),
        {"c": 1e6 + 0.25, "r": 0.5},
        lambda m, c, r: m.pi * r**2 * (c - 10**6),
    ),
    case(
        "coefficients 10¹⁵⁰",
        lambda m, x, y, a, b: m.bracket(a * x + a * y < b),
        (UNIT, UNIT),
        {"a": 1e150, "b": 5e149},
        lambda m, a, b: (b / a) ** 2 / 2,
    ),
    case(
        "coefficients 10⁻¹⁵⁰",
        lambda m, x, y, a, b: m.bracket(a * x + a * y < b),
        (UNIT, UNIT),
        {"a": 1e-150, "b": 5e-151},
        lambda m, a, b: (b / a) ** 2 / 2,
    ),
    case(
        "a domain of 1 by 10⁻⁸",
        lambda m, x, y, a, c: m.bracket(x + a * y < c),
        (UNIT, (0.0, 1e-8)),
        {"a": 2e7, "c": 0.75},
        lambda m, a, c: c * m.mpf(1e-8) - a * m.mpf(1e-8) ** 2 / 2,
    ),
    case(
        "an integrand of size 10²⁰⁰",
        lambda m, x, t: 1e200 * m.bracket(x < t) * m.exp(x),
        (UNIT,),
        {"t": 0.4},
        lambda m, t: m.mpf(1e200) * (m.exp(t) - 1),
    ),
    case(
        "terms that cancel",
        lambda m, x, t, a: m.bracket(x < t) * m.exp(x) - m.bracket(x < a) * m.exp(x),
        (UNIT,),
        {"t": 0.5 + 2.0**-30, "a": 0.5},
        lambda m, t, a: m.exp(t) - m.exp(a),
    ),
)
