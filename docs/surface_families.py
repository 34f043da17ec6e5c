"""The surfaces of docs/surfaces.md, one region each, with its area and the derivative of that by t to 30 digits.

The exact numbers come from formulas of the regions themselves, in mpmath; nothing of the compiler takes part in them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from mpmath import mp, mpf

import teg
from teg.ir.expr import Expr

DIGITS = 30
x, y, z = teg.vars("x y z")
Surfaces = Callable[..., Sequence[Any]]
Pair = tuple[Any, Any]
UNIT = ((0.0, 1.0), (0.0, 1.0))
SQUARE = ((-1.0, 1.0), (-1.0, 1.0))
CENTRES = ((-0.5, -0.2), (0.3, -0.4), (0.2, 0.5))
CORNERS = ((-0.8, -0.7), (0.75, -0.45))


class Numbers:
    """The functions of the language for arrays."""

    abs, sin, cos, exp, mod = np.abs, np.sin, np.cos, np.exp, np.mod


@dataclass(frozen=True)
class Family:
    """A region {all surfaces > 0} in a box; `surfaces(m, x, y, …)` computes with the functions of m, those of teg or of numbers.

    `exact(t, …)` are its area and its derivative by t. A Family in one variable has a box whose second side does not count.
    """

    name: str
    surfaces: Surfaces
    exact: Callable[..., Pair]
    values: dict[str, float]
    box: tuple[tuple[float, float], tuple[float, float]] = SQUARE
    slices: dict[str, float] = field(default_factory=dict)  # a third variable, integrated over (-1, 1): the slice that is drawn
    dimensions: int = 2

    def integral(self, integrand: Any = 1) -> tuple[Expr, list[Expr]]:
        """The integral over the region, and the parameters."""
        parameters = [teg.param(k) for k in self.values]
        others = {k: {"z": z}[k] for k in self.slices}
        for g in self.surfaces(teg, x, y, *parameters, **others):
            integrand = teg.bracket(g > 0) * integrand
        ranges = [(v, *b) for v, b in zip((x, y)[: self.dimensions], self.box, strict=False)]
        return teg.integral(integrand, *ranges, *((v, -1, 1) for v in others.values())), parameters

    def exact_pair(self) -> Pair:
        """The area and its derivative by t, to 30 digits, at the same float64 parameters."""
        with mp.workdps(DIGITS + 10):
            value, slope = self.exact(*map(mpf, self.values.values()))
            return mp.chop(value, tol=mpf(10) ** -DIGITS), mp.chop(slope, tol=mpf(10) ** -DIGITS)


# -- surfaces ------------------------------------------------------------------------------------------------------------


def _triangle(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    corners = [*CORNERS, (t, 0.8)]
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for (ax, ay), (bx, by) in edges]


def _bilinear(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    return [(0.9 * (1 - x) + -0.7 * x) * (1 - y) + (-0.8 * (1 - x) + 0.6 * x) * y - t]


def _polygon(m: Any, x: Any, y: Any, t: Any) -> list[Any]:
    return [t - sum(m.abs(x - a) + m.abs(y - b) for a, b in CENTRES)]


# -- exact numbers -------------------------------------------------------------------------------------------------------


def _triangle_exact(t: Any) -> Pair:
    (ax, ay), (bx, by) = ((mpf(u), mpf(v)) for u, v in CORNERS)
    return ((bx - ax) * (mpf(0.8) - ay) - (by - ay) * (t - ax)) / 2, -(by - ay) / 2


def _parabola_exact(t: Any) -> Pair:
    """x from (2y² - t)/1.2 to 1, while that is less than 1."""
    c = mpf(1.2)
    half = mp.sqrt((c + t) / 2)
    return 2 * half * (1 + t / c) - 4 * half**3 / (3 * c), 2 * half / c


def _bilinear_exact(t: Any) -> Pair:
    """Between α + βx = t in (0, 1) and the sides, α = g(0, y) and β = g(1, y) - α."""
    a0, a1, b0, b1 = (mpf(c) for c in (0.9, -0.8, -0.7, 0.6))

    def ends(v: Any) -> tuple[Any, Any]:
        return a0 + (a1 - a0) * v - t, b0 + (b1 - b0) * v - t

    breaks = sorted({mpf(0), mpf(1), (a0 - t) / (a0 - a1), (t - b0) / (b1 - b0)})
    value, slope = mpf(0), mpf(0)
    for p, q in pairwise(u for u in breaks if 0 <= u <= 1):
        left, right = ends((p + q) / 2)
        if left > 0 and right > 0:
            value += q - p
        elif (left > 0) != (right > 0):
            value += mp.quad(lambda v: max(ends(v)) / abs(ends(v)[1] - ends(v)[0]), [p, q])
            slope -= mp.quad(lambda v: 1 / abs(ends(v)[1] - ends(v)[0]), [p, q])
    return value, slope


def _hyperbola_exact(t: Any) -> Pair:
    """x between the roots -cy ± √((1 + c²)y² + t), c = 0.3, and the sides."""
    c = mpf(0.6) / 2

    def root(v: Any, s: int) -> Any:
        return -c * v + s * mp.sqrt((1 + c * c) * v * v + t)

    crossings = [r for s in (-1, 1) for r in mp.polyroots([1, -2 * c * s, t - 1])]
    breaks = sorted([mpf(-1), mpf(1), *(r for r in crossings if -1 < r < 1)])
    value = mp.quad(lambda v: min(root(v, 1), 1) - max(root(v, -1), -1), breaks)
    slope = mpf(0)
    for p, q in pairwise(breaks):
        inside = sum(-1 < root((p + q) / 2, s) < 1 for s in (-1, 1))
        slope += inside * mp.quad(lambda v: 1 / (root(v, 1) - root(v, -1)), [p, q])
    return value, slope


def _stripes_exact(t: Any) -> Pair:
    """Sums of the area under 3x + y = c, (c₊² - (c - 1)₊² - (c - 3)₊² + (c - 4)₊²)/6, over the borders of the stripes."""

    def under(c: Any, power: int) -> Any:
        parts = [max(c - d, 0) ** power for d in (0, 1, 3, 4)]
        return (parts[0] - parts[1] - parts[2] + parts[3]) / (3 * power)

    borders = [(mpf(k) / 2 - t, 1 if k % 2 else -1) for k in range(12)]
    return sum(s * under(c, 2) for c, s in borders), -sum(s * under(c, 1) for c, s in borders)


def _heart_exact(t: Any) -> Pair:
    """t² times the heart of size 1, in polar coordinates: ½∫r², r² - 1 = r^(5/3)·|cos φ|^(2/3)·sin φ."""

    def square(angle: Any) -> Any:
        k = mp.cbrt(mp.cos(angle) ** 2) * mp.sin(angle)  # with r = u³: u⁶ - k·u⁵ - 1 = 0, which has one positive root
        u = mpf(np.roots([1.0, -float(k), 0.0, 0.0, 0.0, 0.0, -1.0]).real.max())
        for _ in range(5):
            u -= (u**6 - k * u**5 - 1) / (6 * u**5 - 5 * k * u**4)
        return u**6

    whole = mp.quad(square, [-mp.pi / 2, 0, mp.pi / 2])
    return t * t * whole, 2 * t * whole


def _polygon_exact(t: Any) -> Pair:
    """Its corners lie on the kinks; ∮ds/|∇g| is the sum of the edges' lengths over their slopes."""
    kinks = [[mpf(c[i]) for c in CENTRES] for i in (0, 1)]

    def distance(i: int, v: Any) -> Any:
        return sum(abs(v - k) for k in kinks[i])

    def reached(i: int, level: Any) -> list[Any]:
        """Where the i-th sum of distances is `level`."""
        ends = sorted([mpf(-4), *kinks[i], mpf(4)])
        found = []
        for p, q in pairwise(ends):
            below, above = distance(i, p) - level, distance(i, q) - level
            if below * above < 0:
                found.append((p * above - q * below) / (above - below))
        return found

    corners = [(k, v) for k in kinks[0] for v in reached(1, t - distance(0, k))]
    corners += [(u, k) for k in kinks[1] for u in reached(0, t - distance(1, k))]
    corners.sort(key=lambda c: mp.atan2(c[1] - sum(kinks[1]) / 3, c[0] - sum(kinks[0]) / 3))
    value, slope = mpf(0), mpf(0)
    for (ax, ay), (bx, by) in pairwise([*corners, corners[0]]):
        value += (ax * by - ay * bx) / 2
        steepness = [sum(mp.sign((a + b) / 2 - k) for k in kinks[i]) for i, (a, b) in enumerate(((ax, bx), (ay, by)))]
        slope += mp.hypot(bx - ax, by - ay) / mp.hypot(*steepness)
    return value, slope


def _line_exact(g: Callable[[Any], Any], slope: Callable[[Any], Any], roots: Sequence[Any]) -> Pair:
    """{g > 0} in (-1, 1), where g = t - …, from all roots of g."""
    inside = sorted(r for r in roots if -1 < r < 1)
    lengths = [q - p for p, q in pairwise([mpf(-1), *inside, mpf(1)]) if g((p + q) / 2) > 0]
    return sum(lengths), sum(1 / abs(slope(r)) for r in inside)


def _cubic_exact(t: Any) -> Pair:
    c = mpf(0.6)
    roots = [mp.re(r) for r in mp.polyroots([1, 0, -c, -t], maxsteps=200, extraprec=100) if abs(mp.im(r)) < 1e-20]
    return _line_exact(lambda u: t - u**3 + c * u, lambda u: 3 * u**2 - c, roots)


def _wave_exact(t: Any) -> Pair:
    angles = [a + 2 * mp.pi * k for k in range(-2, 3) for a in (mp.asin(t), mp.pi - mp.asin(t))]
    return _line_exact(lambda u: t - mp.sin(7 * u), lambda u: 7 * mp.cos(7 * u), [a / 7 for a in angles])


# -- all of them ---------------------------------------------------------------------------------------------------------

FAMILIES = (
    Family("half-plane", lambda m, x, y, t, a: [t - (x + a * y)], lambda t, a: (t - a / 2, mpf(1)), {"t": 0.9, "a": 0.6}, UNIT),
    Family("triangle", _triangle, _triangle_exact, {"t": -0.2}),
    Family("graph", lambda m, x, y, t: [y - (0.6 * m.sin(3 * x) + t)], lambda t: (2 * (1 - t), mpf(-2)), {"t": 0.1}),
    Family("parabola", lambda m, x, y, t: [t + 1.2 * x - 2 * y * y], _parabola_exact, {"t": 0.3}),
    Family("bilinear", _bilinear, _bilinear_exact, {"t": 0.02}, UNIT),
    Family("disk", lambda m, x, y, t: [t - ((x - 0.1) ** 2 + (y + 0.05) ** 2)], lambda t: (mp.pi * t, +mp.pi), {"t": 0.6}),
    Family(
        "ellipse",
        lambda m, x, y, t: [t - (x * x + 1.2 * x * y + 1.4 * y * y)],
        lambda t: (mp.pi * t / mp.sqrt(mpf(1.4) - mpf(1.2) ** 2 / 4), mp.pi / mp.sqrt(mpf(1.4) - mpf(1.2) ** 2 / 4)),
        {"t": 0.45},
    ),
    Family("hyperbola", lambda m, x, y, t: [t - (x * x + 0.6 * x * y - y * y)], _hyperbola_exact, {"t": 0.15}),
    Family("lines", lambda m, x, y, t: [(x - t) ** 2 - 0.5 * y * y], lambda t: (4 - mp.sqrt(2), mpf(0)), {"t": 0.15}),
    Family("stripes", lambda m, x, y, t: [0.5 - m.mod(3 * x + y + t, 1)], _stripes_exact, {"t": 0.2}, UNIT),
    Family(
        "superellipse",
        lambda m, x, y, t: [t - (x**4 + y**4)],
        lambda t: (4 * mp.sqrt(t) * mp.gamma(1.25) ** 2 / mp.gamma(1.5), 2 / mp.sqrt(t) * mp.gamma(1.25) ** 2 / mp.gamma(1.5)),
        {"t": 0.5},
    ),
    Family(
        "heart",
        lambda m, x, y, t: [t * x * x * y**3 - (x * x + y * y - t * t) ** 3],
        _heart_exact,
        {"t": 1.0},
        ((-1.4, 1.4), (-1.25, 1.55)),
    ),
    Family("polygon", _polygon, _polygon_exact, {"t": 3.0}),
    Family(
        "sphere",
        lambda m, x, y, t, z: [t - (x * x + y * y + z * z)],
        lambda t: (4 * mp.pi / 3 * t * mp.sqrt(t), 2 * mp.pi * mp.sqrt(t)),
        {"t": 0.8},
        slices={"z": 0.45},
    ),
)
LINES = (
    Family("cubic", lambda m, x, y, t: [t - (x**3 - 0.6 * x)], _cubic_exact, {"t": 0.06}, dimensions=1),
    Family("wave", lambda m, x, y, t: [t - m.sin(7 * x)], _wave_exact, {"t": 0.45}, dimensions=1),
)
