"""The ten regions of the chart: ∫∫ exp(x)·cos(y) over a part of the unit square, which moves with two or three parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from teg.examples.charts.problem import Problem

SIDES = ((0.0, 1.0), (0.0, 1.0))
LATTICE = ((0.8, -0.6), (0.8, 0.6), (-0.6, -0.8), (0.96, -0.28))
"""Unit vectors at the nodes (0, 0), (1, 0), (0, 1), (1, 1) of the noise's cell."""


def half_plane(x: Any, y: Any, a: Any, c: Any) -> Any:
    return x + a * y < c


def triangle(x: Any, y: Any, u: Any, v: Any) -> Any:
    corners = ((0.1, 0.15), (0.85, v), (u, 0.9))
    edges = []
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True):
        edges.append((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0)
    return edges[0] & edges[1] & edges[2]


def disk(x: Any, y: Any, c: Any, r: Any) -> Any:
    return (x - c) ** 2 + (y - 0.45) ** 2 < r**2


def clipped_disk(x: Any, y: Any, c: Any, r: Any) -> Any:
    return (x - 0.5) ** 2 + (y - c) ** 2 < r**2


def half_annulus(x: Any, y: Any, r: Any, s: Any, c: Any) -> Any:
    radius = (x - 0.5) ** 2 + (y - 0.5) ** 2
    return (radius < r**2) & (radius > s**2) & (x + 0.5 * y > c)


def hyperbola(x: Any, y: Any, a: Any, t: Any) -> Any:
    return a * x * y > t


def lens(x: Any, y: Any, c: Any, r: Any) -> Any:
    return ((x - c) ** 2 + (y - 0.5) ** 2 < r**2) & ((x - 0.65) ** 2 + (y - 0.5) ** 2 < r**2)


def cut_ellipse(x: Any, y: Any, a: Any, c: Any) -> Any:
    return (3 * x * x + a * x * y + 2 * y * y - 3 * x - 2 * y + 0.9 < 0) & (x - 0.3 * y > c)


def superellipse(x: Any, y: Any, a: Any, b: Any) -> Any:
    return ((x - 0.5) / a) ** 4 + ((y - 0.45) / b) ** 4 < 1


def perlin(x: Any, y: Any, g: Any, t: Any) -> Any:
    """Returns gradient noise above a threshold, with a pixel of half a lattice cell; g is a component of a gradient."""
    u, v = 0.25 + 0.5 * x, 0.2 + 0.5 * y
    across, along = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    (_, a1), (b0, b1), (c0, c1), (d0, d1) = LATTICE
    lower = (1 - across) * (g * u + a1 * v) + across * (b0 * (u - 1) + b1 * v)
    upper = (1 - across) * (c0 * u + c1 * (v - 1)) + across * (d0 * (u - 1) + d1 * (v - 1))
    return (1 - along) * lower + along * upper > t


def _problem(inside: Callable[..., Any], **parameters: float) -> Problem:
    def body(m: Any, x: Any, y: Any, **values: Any) -> Any:
        return m.bracket(inside(x, y, **values)) * m.exp(x) * m.cos(y)

    return Problem(body, SIDES, parameters)


REGIONS: dict[str, Problem] = {
    "half-plane": _problem(half_plane, a=0.7, c=0.9),
    "triangle": _problem(triangle, u=0.4, v=0.3),
    "disk": _problem(disk, c=0.5, r=0.4),
    "clipped disk": _problem(clipped_disk, c=0.97, r=0.4),
    "annulus ∩ half-plane": _problem(half_annulus, r=0.45, s=0.2, c=0.6),
    "hyperbola": _problem(hyperbola, a=1.0, t=0.2),
    "lens": _problem(lens, c=0.35, r=0.35),
    "ellipse ∩ line": _problem(cut_ellipse, a=1.0, c=0.3),
    "superellipse": _problem(superellipse, a=0.42, b=0.35),
    "Perlin pixel": _problem(perlin, g=0.8, t=-0.03),
}
INSIDE: dict[str, Callable[..., Any]] = dict(
    zip(REGIONS, (half_plane, triangle, disk, clipped_disk, half_annulus, hyperbola, lens, cut_ellipse, superellipse, perlin), strict=True)
)
