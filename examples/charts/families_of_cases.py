"""Families of difficult cases for the stability report: one shape each, over a range of scales, with gradients in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Any

from teg.examples.charts.case import UNIT, Case, case

WORDS: dict[str, Callable[[Any, Any], Any]] = {
    "x": lambda m, u: u,
    "x²": lambda m, u: u * u,
    "x³": lambda m, u: u**3,
    "√x": lambda m, u: m.sqrt(u),
    "exp(x)": lambda m, u: m.exp(u),
    "log(x)": lambda m, u: m.log(u),
    "1/(2-x)": lambda m, u: 1 / (2 - u),
    "sin(x)": lambda m, u: m.sin(u),
    "atan(x)": lambda m, u: m.atan(u),
    "x + x²": lambda m, u: u + u * u,
    "-1/x": lambda m, u: -1 / u,
}
"""Increasing functions on (0, 1), in a notation: any two conditions f(x) > f(r) are one surface."""


def coincident() -> Iterator[Case]:
    """One surface in two expressions: every pair of WORDS."""
    for (name, f), (other, g) in combinations(WORDS.items(), 2):
        yield case(
            f"{name} > … and {other} > …",
            lambda m, x, r, f=f, g=g: m.bracket(f(m, x) > f(m, r)) * m.bracket(g(m, x) > g(m, r)) * (1 + x),
            (UNIT,),
            {"r": 0.375},
            lambda m, r: 1 - r + (1 - r * r) / 2,
        )


def strips() -> Iterator[Case]:
    """Strips between two parallel lines a small distance w apart: (y + w > x > y) inside of the square."""
    for k in range(1, 13):
        yield case(
            f"a strip of width 10^-{k}",
            lambda m, x, y, c, w: m.bracket((x - y > c) & (x - y < c + w)) * 1.0,
            (UNIT, UNIT),
            {"c": 0.25, "w": 10.0**-k},
            lambda m, c, w: ((1 - c) ** 2 - (1 - c - w) ** 2) / 2,
        )


def tiny_coefficients() -> Iterator[Case]:
    """Lines that nearly follow an axis: a·x + y < t, with a from 1e-2 to 1e-16 and 0."""
    for a in [0.0, *(10.0**-k for k in range(2, 17, 2))]:
        yield case(
            f"ax + y < t with a = {a:.0e}",
            lambda m, x, y, a, t: m.bracket(a * x + y < t),
            (UNIT, UNIT),
            {"a": a, "t": 0.5},
            lambda m, a, t: t - a / 2,
        )


def far_coordinates() -> Iterator[Case]:
    """A half-plane in a unit box whose corner is at ±2^k."""
    for k in range(4, 49, 4):
        for sign in (1.0, -1.0):
            corner = sign * 2.0**k
            yield case(
                f"a box at {'-' if sign < 0 else ''}2^{k}",
                lambda m, x, y, t, c=corner: m.bracket((x - c) + (y - c) < t),
                ((corner, corner + 1), (corner, corner + 1)),
                {"t": 0.75},
                lambda m, t: t * t / 2,
            )


def stripes() -> Iterator[Case]:
    """High frequencies: sin(2πkx) < t over whole periods."""
    for k in (1, 2, 4, 8, 16, 32, 64, 128):
        yield case(
            f"{k} periods of a sine",
            lambda m, x, t, k=k: m.bracket(m.sin(2 * math.pi * k * x) < t),
            (UNIT,),
            {"t": 0.25},
            lambda m, t: m.mpf(1) / 2 + m.asin(t) / m.pi,
        )


def scaled_disks() -> Iterator[Case]:
    """Disks from 1e-4 to 1e-1 in a box of size 2, and from 1e3 to 1e8 in a box of their own scale."""
    for k in range(-4, 0):
        yield case(
            f"a disk of radius 10^{k} in a box of 2",
            lambda m, x, y, r: m.bracket(x * x + y * y < r * r),
            ((-1.0, 1.0), (-1.0, 1.0)),
            {"r": 10.0**k},
            lambda m, r: m.pi * r * r,
        )
    for k in (-8, -3, 3, 8, 50, 100):
        s = 10.0**k
        yield case(
            f"a disk of radius 10^{k} in its own box",
            lambda m, x, y, r: m.bracket(x * x + y * y < r * r),
            ((-2 * s, 2 * s), (-2 * s, 2 * s)),
            {"r": s},
            lambda m, r: m.pi * r * r,
        )


def components() -> Iterator[Case]:
    """Many components: n intervals that open from their left ends, by one parameter."""
    for n in (2, 4, 8, 16, 32):
        yield case(
            f"{n} intervals",
            lambda m, x, t, n=n: sum(m.bracket((x > i / n) & (x < i / n + t)) for i in range(n)),
            (UNIT,),
            {"t": 1 / (3 * n)},
            lambda m, t, n=n: n * t,
        )


def nonlinear_uses() -> Iterator[Case]:
    """Brackets inside functions, products, quotients and other brackets: f([x < t]) jumps from f(0) to f(1)."""
    uses: Mapping[str, tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any], Callable[[Any, Any], Any]]] = {
        "exp([x < t])": (lambda m, b: m.exp(b), lambda m, _: m.e, lambda m, _: 1),
        "sin(2[x < t])": (lambda m, b: m.sin(2 * b), lambda m, _: m.sin(2), lambda m, _: 0),
        "[x < t]³": (lambda m, b: b**3, lambda m, _: 1, lambda m, _: 0),
        "1/(1 + [x < t])": (lambda m, b: 1 / (1 + b), lambda m, _: m.mpf(1) / 2, lambda m, _: 1),
        "√(1 + 3[x < t])": (lambda m, b: m.sqrt(1 + 3 * b), lambda m, _: 2, lambda m, _: 1),
        "[x < t]·[x < t]": (lambda m, b: b * b, lambda m, _: 1, lambda m, _: 0),
        "[[x < t] > 1/2]": (lambda m, b: m.bracket(b > 0.5), lambda m, _: 1, lambda m, _: 0),
        "2[x < t] - [x < t]²": (lambda m, b: 2 * b - b * b, lambda m, _: 1, lambda m, _: 0),
    }
    for name, (use, inside, outside) in uses.items():
        yield case(
            name,
            lambda m, x, t, use=use: use(m, m.bracket(x < t)),
            (UNIT,),
            {"t": 0.375},
            lambda m, t, a=inside, b=outside: t * a(m, t) + (1 - t) * b(m, t),
        )


def bounds() -> Iterator[Case]:
    """Reversed and infinite bounds, and surfaces on bounds."""
    for k in range(1, 6):
        yield case(
            f"a tail of exp(-{k}x)",
            lambda m, x, t, k=k: m.bracket(x > t) * m.exp(-k * x),
            ((0.0, math.inf),),
            {"t": 0.5},
            lambda m, t, k=k: m.exp(-k * t) / k,
        )
        yield case(
            f"reversed bounds, power {k}",
            lambda m, x, t, k=k: m.bracket(x < t) * x**k,
            ((1.0, 0.0),),
            {"t": 0.5},
            lambda m, t, k=k: -(t ** (k + 1)) / (k + 1),
        )
        yield case(
            f"from -∞, width {k}",
            lambda m, x, t, k=k: m.bracket(x < t) * m.exp(k * x),
            ((-math.inf, 0.0),),
            {"t": -0.5},
            lambda m, t, k=k: m.exp(k * t) / k,
        )


def moving_singularities() -> Iterator[Case]:
    """|x - t|^-s with s up to 0.8, and the same cut at its singularity."""
    for s in (0.2, 0.4, 0.5, 0.6, 0.8):
        yield case(
            f"|x - t|^-{s}",
            lambda m, x, t, s=s: m.abs(x - t) ** -s,
            (UNIT,),
            {"t": 0.375},
            lambda m, t, s=s: (t ** (1 - m.mpf(s)) + (1 - t) ** (1 - m.mpf(s))) / (1 - m.mpf(s)),
        )
        yield case(
            f"[x > t]·(x - t)^{s}",
            lambda m, x, t, s=s: m.where(x > t, (x - t) ** s, 0),
            (UNIT,),
            {"t": 0.375},
            lambda m, t, s=s: (1 - t) ** (1 + m.mpf(s)) / (1 + m.mpf(s)),
        )


def narrow_features() -> Iterator[Case]:
    """A smooth peak of width 10^-k, cut at its middle by a parameter."""
    for k in range(1, 6):
        w = 10.0**-k
        yield case(
            f"a cut exponential of width 10^-{k}",
            lambda m, x, t, w=w: m.bracket(x > t) * m.exp(-x / w) / w,
            (UNIT,),
            {"t": w / 2},
            lambda m, t, w=w: m.exp(-t / m.mpf(w)) - m.exp(-1 / m.mpf(w)),
        )


FAMILIES: dict[str, tuple[Case, ...]] = {
    "pairs of words for one surface": tuple(coincident()),
    "strips, 10⁻¹ to 10⁻¹²": tuple(strips()),
    "tiny coefficients": tuple(tiny_coefficients()),
    "far coordinates": tuple(far_coordinates()),
    "high frequency": tuple(stripes()),
    "disks at all scales": tuple(scaled_disks()),
    "many components": tuple(components()),
    "non-linear uses": tuple(nonlinear_uses()),
    "infinite and reversed bounds": tuple(bounds()),
    "moving singularities, all powers": tuple(moving_singularities()),
    "cut peaks": tuple(narrow_features()),
}
"""More classes of the stability report, beside those of `teg.examples.charts.stability`."""
