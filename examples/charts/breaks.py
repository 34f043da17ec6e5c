"""Where the integrands of the regions jump, found by hand: what a rival is told who splits the integrals there.

`inner` are the places in x on the line at y, `outer` those in y at which the pieces of lines begin, end, or meet. Who uses them leaves out
places outside of the unit square.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from teg.examples.charts.regions import LATTICE

SCAN = 64
"""So many lines are looked at for the outer breaks of the noise, for which there is no formula."""


@dataclass(frozen=True)
class Breaks:
    """The places of jumps of one region, as functions of y and of the parameters."""

    inner: Callable[..., Sequence[float]]
    outer: Callable[..., Sequence[float]]


def quadratic(a: float, b: float, c: float) -> list[float]:
    """Returns the real roots of ax² + bx + c."""
    under = b * b - 4 * a * c
    return [] if under < 0 else [(-b - sqrt(under)) / (2 * a), (-b + sqrt(under)) / (2 * a)]


def circle(cx: float, cy: float, r: float, y: float) -> list[float]:
    """Returns where a circle crosses the line at y."""
    return quadratic(1.0, -2 * cx, cx * cx + (y - cy) ** 2 - r * r)


def _triangle(y: float, u: float, v: float) -> list[float]:
    corners = [(0.1, 0.15), (0.85, v), (u, 0.9)]
    pairs = zip(corners, corners[1:] + corners[:1], strict=True)
    return [x0 + (x1 - x0) * (y - y0) / (y1 - y0) for (x0, y0), (x1, y1) in pairs if y0 != y1]


def _line_and_circle(r: float, c: float) -> list[float]:
    """Returns the heights at which x = c - y/2 meets the circle of radius r around (1/2, 1/2)."""
    return quadratic(1.25, -(c - 0.5) - 1.0, (c - 0.5) ** 2 + 0.25 - r * r)


def _ellipse(y: float, a: float, c: float) -> list[float]:
    return [*quadratic(3.0, a * y - 3.0, 2 * y * y - 2 * y + 0.9), c + 0.3 * y]


def _ellipse_ends(a: float, c: float) -> list[float]:
    turning = quadratic(a * a - 24, 24 - 6 * a, 9 - 10.8)
    met = quadratic(0.27 + 0.3 * a + 2, 1.8 * c + a * c - 0.9 - 2, 3 * c * c - 3 * c + 0.9)
    return [*turning, *met]


def _superellipse(y: float, a: float, b: float) -> list[float]:
    left = 1 - ((y - 0.45) / b) ** 4
    return [0.5 - a * left**0.25, 0.5 + a * left**0.25] if left > 0 else []


def _noise(y: float, g: float, t: float) -> list[float]:
    """Returns the roots of a polynomial of degree four in u = 1/4 + x/2."""
    v = 0.2 + 0.5 * y
    along = v * v * (3 - 2 * v)
    (_, a1), (b0, b1), (c0, c1), (d0, d1) = LATTICE
    first = np.array([g * (1 - along) + c0 * along, a1 * v * (1 - along) + c1 * (v - 1) * along])
    second = np.array([b0 * (1 - along) + d0 * along, (b1 * v - b0) * (1 - along) + (d1 * (v - 1) - d0) * along])
    across = np.array([-2.0, 3.0, 0.0, 0.0])
    total = np.polyadd(np.polymul(across, np.polysub(second, first)), first)
    roots = np.roots(np.polysub(total, [t]))
    return [2 * (float(z.real) - 0.25) for z in roots if abs(z.imag) < 1e-9 and 0.25 < z.real < 0.75]


def _noise_ends(g: float, t: float) -> list[float]:
    """Returns the heights at which the number of places changes, by bisection between lines."""
    ends = []
    for k in range(SCAN):
        lo, hi = k / SCAN, (k + 1) / SCAN
        at_lo = len(_noise(lo, g, t))
        if at_lo == len(_noise(hi, g, t)):
            continue
        while hi - lo > 2e-16 * max(1.0, hi) and lo < (lo + hi) / 2 < hi:
            middle = (lo + hi) / 2
            lo, hi = (middle, hi) if len(_noise(middle, g, t)) == at_lo else (lo, middle)
        ends.append(hi)
    return ends


BREAKS: dict[str, Breaks] = {
    "half-plane": Breaks(lambda y, a, c: [c - a * y], lambda a, c: [(c - 1) / a, c / a]),
    "triangle": Breaks(_triangle, lambda u, v: [0.15, v, 0.9]),
    "disk": Breaks(lambda y, c, r: circle(c, 0.45, r, y), lambda c, r: [0.45 - r, 0.45 + r]),
    "clipped disk": Breaks(lambda y, c, r: circle(0.5, c, r, y), lambda c, r: [c - r, c + r]),
    "annulus ∩ half-plane": Breaks(
        lambda y, r, s, c: [*circle(0.5, 0.5, r, y), *circle(0.5, 0.5, s, y), c - 0.5 * y],
        lambda r, s, c: [0.5 - r, 0.5 + r, 0.5 - s, 0.5 + s, 2 * c, 2 * c - 2, *_line_and_circle(r, c), *_line_and_circle(s, c)],
    ),
    "hyperbola": Breaks(lambda y, a, t: [t / (a * y)] if y > 0 else [], lambda a, t: [t / a]),
    "lens": Breaks(
        lambda y, c, r: [*circle(c, 0.5, r, y), *circle(0.65, 0.5, r, y)],
        lambda c, r: [0.5 - r, 0.5 + r, *quadratic(1.0, -1.0, 0.25 + ((0.65 - c) / 2) ** 2 - r * r)],
    ),
    "ellipse ∩ line": Breaks(_ellipse, _ellipse_ends),
    "superellipse": Breaks(_superellipse, lambda a, b: [0.45 - b, 0.45 + b]),
    "Perlin pixel": Breaks(_noise, _noise_ends),
}
