"""Cases in which an answer is easily wrong without a sign of it.

One surface in two expressions, features narrower than the distance of nodes, powers and literals of extreme size, singularities that
move, more roots than there is room for, coordinates far from the origin.
"""

from __future__ import annotations

from typing import Any

from teg.examples.charts.case import SYMMETRIC, UNIT, Case, case
from teg.examples.charts.curves import SQUARE

WORDS: tuple[Case, ...] = (
    case(
        "x > r and x² > r²",
        lambda m, x, r: m.bracket(x > r) * m.bracket(x * x > r * r),
        (UNIT,),
        {"r": 0.6},
        lambda m, r: 1 - r,
    ),
    case(
        "x > r or exp(x) > exp(r)",
        lambda m, x, r: m.bracket((x > r) | (m.exp(x) > m.exp(r))) * m.exp(x),
        (UNIT,),
        {"r": 0.6},
        lambda m, r: m.exp(1) - m.exp(r),
    ),
    case(
        "x > r without log(x) > log(r)",
        lambda m, x, r: (m.bracket(x > r) - m.bracket(m.log(x) > m.log(r))) ** 2,
        ((0.125, 1.0),),
        {"r": 0.6},
        lambda m, r: 0 * r,
    ),
    case(
        "a disk and the same by its root",
        lambda m, x, y, r: m.bracket(x * x + y * y < r * r) * m.bracket(m.sqrt(x * x + y * y) < r),
        SQUARE,
        {"r": 0.7},
        lambda m, r: m.pi * r**2,
    ),
    case(
        "a half-plane and its cube",
        lambda m, x, y, a, c: m.bracket(x + a * y < c) * m.bracket((x + a * y) ** 3 < c**3),
        (UNIT, UNIT),
        {"a": 0.5, "c": 0.75},
        lambda m, a, c: c - a / 2,
    ),
)

NARROW: tuple[Case, ...] = (
    case("exp(-2000x)", lambda m, x, k: m.exp(-k * x), (UNIT,), {"k": 2000.0}, lambda m, k: (1 - m.exp(-k)) / k),
    case(
        "a Lorentz peak of width 10⁻³",
        lambda m, x, p: 1 / (1 + (1000 * (x - p)) ** 2),
        (UNIT,),
        {"p": 0.3},
        lambda m, p: (m.atan(1000 * (1 - p)) + m.atan(1000 * p)) / 1000,
    ),
    case(
        "below exp(-2000x)",
        lambda m, y, x, k: m.bracket(y < m.exp(-k * x)),
        (UNIT, UNIT),
        {"k": 2000.0},
        lambda m, k: (1 - m.exp(-k)) / k,
    ),
    case(
        "between ±exp(-100x)",
        lambda m, y, x, k: m.bracket(m.abs(y) < m.exp(-k * x)),
        (SYMMETRIC, UNIT),
        {"k": 100.0},
        lambda m, k: 2 * (1 - m.exp(-k)) / k,
    ),
)

POWERS: tuple[Case, ...] = (
    case(
        "x² + 10⁻¹⁸·y < t, a literal",
        lambda m, x, y, t: m.bracket(x * x + 1e-18 * y < t),
        (UNIT, UNIT),
        {"t": 0.01},
        lambda m, t: m.quad(lambda y: m.sqrt(t - m.mpf(1e-18) * y), [0, 1]),
    ),
    case(
        "x¹² + y¹² < t¹² on ±20",
        lambda m, x, y, t: m.bracket(x**12 + y**12 < t**12),
        ((-20.0, 20.0), (-20.0, 20.0)),
        {"t": 12.5},
        lambda m, t: 4 * t**2 * m.gamma(m.mpf(13) / 12) ** 2 / m.gamma(m.mpf(7) / 6),
    ),
    case(
        "x⁴ + y⁴ < t⁴ on ±2·10⁵",
        lambda m, x, y, t: m.bracket(x**4 + y**4 < t**4),
        ((-2e5, 2e5), (-2e5, 2e5)),
        {"t": 1.25e5},
        lambda m, t: 4 * t**2 * m.gamma(m.mpf(5) / 4) ** 2 / m.gamma(m.mpf(3) / 2),
    ),
    case(
        "a ring, (q + a)² < q",
        lambda m, x, y, a: m.bracket((x * x + y * y + a) ** 2 < x * x + y * y),
        SQUARE,
        {"a": 0.2138},
        lambda m, a: m.pi * m.sqrt(1 - 4 * a),
    ),
    case(
        "a triangle at (65536, 65536), edges as determinants",
        lambda m, x, y, u, v: m.bracket(_determinants(x, y, ((65536.125, 65536.25), (65536.875, 65536.5), (u, v)))),
        ((65536.0, 65537.0), (65536.0, 65537.0)),
        {"u": 65536.5, "v": 65536.875},
        lambda m, u, v: (m.mpf(3) / 4 * (v - m.mpf(65536.25)) - (u - m.mpf(65536.125)) / 4) / 2,
    ),
)

SINGULAR: tuple[Case, ...] = (
    case(
        "1/√|x - t|",
        lambda m, x, t: 1 / m.sqrt(m.abs(x - t)),
        (UNIT,),
        {"t": 0.3},
        lambda m, t: 2 * m.sqrt(t) + 2 * m.sqrt(1 - t),
    ),
    case(
        "log|x - t|",
        lambda m, x, t: m.log(m.abs(x - t)),
        (UNIT,),
        {"t": 0.3},
        lambda m, t: t * m.log(t) + (1 - t) * m.log(1 - t) - 1,
    ),
    case(
        "1/√(x - p) where x > p",
        lambda m, x, p: m.where(x > p, 1 / m.sqrt(x - p), 0.0),
        (UNIT,),
        {"p": 0.3},
        lambda m, p: 2 * m.sqrt(1 - p),
    ),
    case(
        "a hemisphere",
        lambda m, x, y, r: m.where(x * x + y * y < r * r, m.sqrt(r * r - x * x - y * y), 0.0),
        SQUARE,
        {"r": 0.6},
        lambda m, r: 2 * m.pi * r**3 / 3,
    ),
)

ROOTS: tuple[Case, ...] = (
    case(
        "48 stripes of a sine",
        lambda m, x, t: m.bracket(m.sin(300 * x) < t),
        (UNIT,),
        {"t": 0.25},
        lambda m, t: 1 - (47 * (m.pi - 2 * m.asin(t)) + max(min(300 - 94 * m.pi, m.pi - m.asin(t)) - m.asin(t), 0)) / 300,
    ),
    case(
        "a square that is 0 at one point",
        lambda m, x, t: m.bracket((t * x) ** 2 - 2 * t * x + 1 > 0),
        ((0.0, 2.0),),
        {"t": 0.8},
        lambda m, t: m.mpf(2) + 0 * t,
    ),
    case(
        "a cardioid",
        lambda m, x, y, a: m.bracket((x * x + y * y - a * x) ** 2 < a * a * (x * x + y * y)),
        SQUARE,
        {"a": 0.45},
        lambda m, a: 3 * m.pi * a**2 / 2,
    ),
)


def _determinants(x: Any, y: Any, corners: Any) -> Any:
    """Returns the inside of a polygon, each edge written x₀y₁ - x₁y₀ + (y₀ - y₁)x + (x₁ - x₀)y."""
    inside = None
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge = x0 * y1 - x1 * y0 + (y0 - y1) * x + (x1 - x0) * y > 0
        inside = edge if inside is None else inside & edge
    return inside
