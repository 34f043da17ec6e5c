"""The scenes of the chart of estimators: integrals with jumps whose exact gradients are known without this compiler.

Three regions of the other chart, with their stored references; triangles with linear colours inside of the pixel, whose integral is
area times mean colour; scenes of constant colours, whose integrals are areas of clipped polygons, a mesh in front of another one among
them; and the action of a bouncing ball's path, a polynomial between contacts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from teg.examples.charts.case import UNIT, Case, case
from teg.examples.charts.problem import Problem
from teg.examples.charts.references import Reference, case_reference, read
from teg.examples.charts.regions import REGIONS

PIXEL = (UNIT, UNIT)
Corner = tuple[Any, Any]


def _edge(a: Corner, b: Corner, x: Any, y: Any) -> Any:
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


def _shaded(m: Any, corners: Sequence[Corner], colours: Sequence[float], x: Any, y: Any) -> Any:
    """Returns a triangle with a colour at each corner, linear in between, 0 outside; the corners are in counterclockwise order."""
    a, b, c = corners
    parts = [_edge(b, c, x, y), _edge(c, a, x, y), _edge(a, b, x, y)]
    colour = sum(colour * part for colour, part in zip(colours, parts, strict=True)) / _edge(a, b, *c)
    return m.bracket((parts[0] > 0) & (parts[1] > 0) & (parts[2] > 0)) * colour


def _total(corners: Sequence[Corner], colours: Sequence[float]) -> Any:
    a, b, c = corners
    return _edge(a, b, *c) * sum(colours) / 6


def _corners(values: Sequence[Any]) -> list[Corner]:
    return list(zip(values[::2], values[1::2], strict=True))


TRIANGLE = {"ax": 0.125, "ay": 0.25, "bx": 0.875, "by": 0.1875, "cx": 0.375, "cy": 0.875}
SLIVER = {"ax": 0.125, "ay": 0.25, "bx": 0.875, "by": 0.75, "cx": 0.4992, "cy": 0.5008}
"""A triangle of height 1.1e-3."""
COLOURS, OTHER = (1.0, 0.25, 0.5), (0.125, 1.0, 0.75)
SHARED = {"ax": 0.25, "ay": 0.125, "bx": 0.75, "by": 0.875}
LEFT, RIGHT = (0.125, 0.75), (0.875, 0.25)


def _two(values: Sequence[Any]) -> tuple[list[Corner], list[Corner]]:
    """Returns the triangles on both sides of one edge."""
    a, b = _corners(values)
    return [a, b, LEFT], [b, a, RIGHT]


BEHIND: list[Corner] = [(0.25, 0.125), (0.875, 0.375), (0.5, 0.9375)]
FRONT_COLOUR, BACK_COLOUR = 1.0, 0.375


def clipped(polygon: Sequence[Corner], g: Callable[[Any, Any], Any]) -> list[Corner]:
    """Returns the part of a convex polygon where an affine function is positive."""
    kept: list[Corner] = []
    for p, q in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True):
        at_p, at_q = g(*p), g(*q)
        if at_p > 0:
            kept.append(p)
        if (at_p > 0) != (at_q > 0):
            s = at_p / (at_p - at_q)
            kept.append((p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])))
    return kept


def area(polygon: Sequence[Corner]) -> Any:
    """Returns the area of a counterclockwise polygon; 0 of none."""
    return sum((p[0] * q[1] - p[1] * q[0] for p, q in zip(polygon, [*polygon[1:], *polygon[:1]], strict=True)), start=0) / 2


def _nearer(x: Any, y: Any, d: Any) -> Any:
    """Returns how much nearer the moving triangle is than the other one: their planes cross in a line."""
    return d - x + y / 4


def _inside(m: Any, corners: Sequence[Corner], x: Any, y: Any) -> Any:
    a, b, c = corners
    return (_edge(a, b, x, y) > 0) & (_edge(b, c, x, y) > 0) & (_edge(c, a, x, y) > 0)


def _two_depths(m: Any, x: Any, y: Any, *values: Any) -> Any:
    """Returns the colour of the nearer one of two triangles that pass through each other."""
    front, behind = _inside(m, _corners(values[:6]), x, y), _inside(m, BEHIND, x, y)
    seen = m.where(front & (_nearer(x, y, values[6]) > 0), FRONT_COLOUR, m.where(behind, BACK_COLOUR, m.where(front, FRONT_COLOUR, 0.0)))
    return seen * 1.0


def _common(polygon: Sequence[Corner], convex: Sequence[Corner]) -> list[Corner]:
    """Returns the part of a convex polygon inside of another one."""
    kept = list(polygon)
    for a, b in zip(convex, [*convex[1:], *convex[:1]], strict=True):
        kept = clipped(kept, partial(_edge, a, b))
    return kept


def _two_depths_total(m: Any, *values: Any) -> Any:
    front = _corners(values[:6])
    common = _common(BEHIND, front)
    hidden = area(clipped(common, lambda x, y: -_nearer(x, y, values[6])))
    return FRONT_COLOUR * (area(front) - hidden) + BACK_COLOUR * (area(BEHIND) - area(common) + hidden)


TURNED = {"cx": 0.46875, "cy": 0.53125, "turn": 0.375}
RADIUS, FRONT_COLOURS = 0.3125, (0.9375, 0.625, 0.3125)
QUAD: list[list[Corner]] = [[(0.125, 0.1875), (0.875, 0.125), (0.8125, 0.875)], [(0.125, 0.1875), (0.8125, 0.875), (0.1875, 0.9375)]]
QUAD_COLOURS, GROUND_COLOUR = (0.4375, 0.75), 0.125


def _fan(m: Any, cx: Any, cy: Any, turn: Any) -> list[list[Corner]]:
    """Returns three triangles around a centre, turned."""
    ring = [(cx + RADIUS * m.cos(turn + 2 * math.pi * k / 3), cy + RADIUS * m.sin(turn + 2 * math.pi * k / 3)) for k in range(3)]
    return [[(cx, cy), p, q] for p, q in zip(ring, [*ring[1:], *ring[:1]], strict=True)]


def _mesh(m: Any, x: Any, y: Any, *values: Any) -> Any:
    """Returns the colour of a mesh of three triangles in front of one of two."""
    seen = GROUND_COLOUR
    layers = [*zip(QUAD, QUAD_COLOURS, strict=True), *zip(_fan(m, *values), FRONT_COLOURS, strict=True)]
    for triangle, colour in layers:
        seen = m.where(_inside(m, triangle, x, y), colour, seen)
    return seen * 1.0


def _mesh_total(m: Any, *values: Any) -> Any:
    fan = _fan(m, *values)
    front = sum(c * area(t) for t, c in zip(fan, FRONT_COLOURS, strict=True))
    seen = [area(q) - sum(area(_common(q, t)) for t in fan) for q in QUAD]
    back = sum(c * a for a, c in zip(seen, QUAD_COLOURS, strict=True))
    return front + back + GROUND_COLOUR * (1 - sum(area(t) for t in fan) - sum(seen))


BALL = {"t1": 0.3125, "t2": 0.6875, "h0": 0.25, "h1": 0.5625, "h2": 0.375}
GRAVITY, ENDS = 9.75, (0.5, 0.625)


def _arcs(*values: Any) -> list[tuple[Any, Any, Any, Any, Any]]:
    """Returns begin, length, first height, slope and bend of each parabola of a ball between floor 0 and ceiling 1, over a second."""
    times, heights = (0.0, *values[:2], 1.0), (ENDS[0], 0.0, 1.0, ENDS[1])
    arcs = []
    for k, middle in enumerate(values[2:]):
        first, last = heights[k], heights[k + 1]
        slope, bend = 4 * middle - 3 * first - last, 2 * first - 4 * middle + 2 * last
        arcs.append((times[k], times[k + 1] - times[k], first, slope, bend))
    return arcs


def _ball(m: Any, t: Any, *values: Any) -> Any:
    """Returns the Lagrangian of the arc at time t, with mass 1."""
    found = []
    for begin, length, first, slope, bend in _arcs(*values):
        u = (t - begin) / length
        found.append(((slope + 2 * u * bend) / length) ** 2 / 2 - GRAVITY * (first + u * (slope + u * bend)))
    return m.where(t < values[0], found[0], m.where(t < values[1], found[1], found[2]))


def _action(m: Any, *values: Any) -> Any:
    total = 0
    for _, length, first, slope, bend in _arcs(*values):
        total += (slope**2 + 2 * slope * bend + bend**2 * 4 / 3) / (2 * length) - GRAVITY * length * (first + slope / 2 + bend / 3)
    return total


def _lit(x: Any, y: Any, h: Any, b: Any) -> Any:
    """Returns a function that is positive where the ray from x on the ground to y on a lamp passes the blocker, at height h, at b."""
    return b - x - h * (y - x)


TRIANGLES: tuple[Case, ...] = (
    case(
        "triangle, linear colours",
        lambda m, x, y, *values: _shaded(m, _corners(values), COLOURS, x, y),
        PIXEL,
        TRIANGLE,
        lambda m, *values: _total(_corners(values), COLOURS),
    ),
    case(
        "sliver of height 10⁻³",
        lambda m, x, y, *values: _shaded(m, _corners(values), COLOURS, x, y),
        PIXEL,
        SLIVER,
        lambda m, *values: _total(_corners(values), COLOURS),
    ),
    case(
        "coincident edges",
        lambda m, x, y, *values: sum(_shaded(m, t, c, x, y) for t, c in zip(_two(values), (COLOURS, OTHER), strict=True)),
        PIXEL,
        SHARED,
        lambda m, *values: sum(_total(t, c) for t, c in zip(_two(values), (COLOURS, OTHER), strict=True)),
    ),
    case("two triangles with depth", _two_depths, PIXEL, TRIANGLE | {"d": 0.4375}, _two_depths_total),
    case(
        "soft shadow",
        lambda m, x, y, h, b: m.bracket(_lit(x, y, h, b) > 0),
        PIXEL,
        {"h": 0.375, "b": 0.4375},
        lambda m, h, b: area(clipped([(0, 0), (1, 0), (1, 1), (0, 1)], lambda x, y: _lit(x, y, h, b))),
    ),
    case("mesh before a mesh", _mesh, PIXEL, TURNED, _mesh_total),
    case("bouncing ball", _ball, (UNIT,), BALL, _action),
)
SCENES: dict[str, Problem] = {
    **{name: REGIONS[name] for name in ("half-plane", "disk")},
    TRIANGLES[0].name: TRIANGLES[0].problem,
    "Perlin pixel": REGIONS["Perlin pixel"],
    **{c.name: c.problem for c in TRIANGLES[1:]},
}


def gradient_of(name: str) -> dict[str, float]:
    """Returns the exact gradient of a scene."""
    for c in TRIANGLES:
        if c.name == name:
            value, slopes = case_reference(c)
            return Reference(str(value), {k: str(d) for k, d in slopes.items()}).gradient
    return read("regions")[name].gradient
