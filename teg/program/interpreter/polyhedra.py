"""The meaning of `Polyhedron`: a box that half-spaces cut, and a rule on what is left.

Faces 0 to 5 are the sides of the box, the others the half-spaces.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from teg.numerics.polyhedra import CORNERS, SIDES, Edge, box_edges
from teg.numerics.quadrature import tetrahedron_rule
from teg.program.limits import CLIP_EPS
from teg.program.statements import Polyhedron

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

Point = tuple[float, ...]
Values = tuple[float, float, float, float]
"""The slopes of a half-space, and its offset."""


class Solid(NamedTuple):
    """A convex polyhedron. Corners that no edge has are not of it."""

    corners: list[Point]
    edges: list[Edge]


def polyhedron(machine: Machine, stmt: Polyhedron) -> list[float]:
    """Returns the results."""
    nothing = [0.0] * len(stmt.results)
    extents = machine.numbers(stmt.extents)
    halves: list[Values] = []
    for g in stmt.half_spaces:
        a, b, c, d = machine.numbers((*g.slopes, g.offset))
        halves.append((a, b, c, d))
    ranges = [range_on_box(half, extents) for half in halves]
    if any(most <= 0.0 and not (g.closed and least >= 0.0) for (least, most), g in zip(ranges, stmt.half_spaces, strict=True)):
        return nothing
    if not all(map(math.isfinite, (*extents, *(most - least for least, most in ranges)))):
        return [math.nan] * len(nothing)
    machine.run(stmt.setup)
    solid = box(extents)
    for k, (half, (least, _)) in enumerate(zip(halves, ranges, strict=True)):
        solid = solid if least >= 0.0 else clipped(solid, SIDES + k, half, CLIP_EPS * scale_of(half, extents))
    sums = nothing
    for node, weight in nodes_of(solid, stmt.degree):
        machine.evaluations += 1
        values = machine.at(stmt.body, stmt.values, **dict(zip(stmt.variables, node, strict=True)))
        sums = [total + weight * value for total, value in zip(sums, values, strict=True)]
    return [factor * total for factor, total in zip(machine.numbers(stmt.factors), sums, strict=True)]


def range_on_box(half: Values, extents: Sequence[float]) -> tuple[float, float]:
    """Returns the least and the largest value on the box; NaN stays one."""
    *slopes, offset = half
    ends = [a * e for a, e in zip(slopes, extents, strict=True)]
    least = most = offset
    for end in ends:
        least, most = least + (0.0 if end >= 0.0 else end), most + (0.0 if end <= 0.0 else end)
    return least, most


def scale_of(half: Values, extents: Sequence[float]) -> float:
    """Returns the size of a half-space's terms on the box."""
    *slopes, offset = half
    return abs(offset) + sum(abs(a * e) for a, e in zip(slopes, extents, strict=True))


def box(extents: Sequence[float]) -> Solid:
    """Returns a box."""
    return Solid([tuple(e if far else 0.0 for e, far in zip(extents, at, strict=True)) for at in CORNERS], list(box_edges()))


def clipped(solid: Solid, number: int, half: Values, tolerance: float) -> Solid:
    """Returns the part of a polyhedron inside a half-space; `number` is that of the new face."""
    a, b, c, d = half
    corners = list(solid.corners)
    heights = [((d + a * x) + b * y) + c * z for x, y, z in corners]
    edges: list[Edge] = []
    leaves: dict[int, int] = {}
    enters: dict[int, int] = {}
    for face, other, start, stop in solid.edges:
        first, last = heights[start], heights[stop]
        goes_out, comes_in = last < -tolerance, first < -tolerance
        if goes_out and comes_in:
            continue
        if goes_out or comes_in:
            inner, outer = (start, stop) if goes_out else (stop, start)
            high = max(heights[inner], 0.0)
            t = high / (high - heights[outer])
            corners.append(tuple(p + t * (q - p) for p, q in zip(corners[inner], corners[outer], strict=True)))
            new = len(corners) - 1
            start, stop = (start, new) if goes_out else (new, stop)
            (leaves if goes_out else enters)[face] = new
            (enters if goes_out else leaves)[other] = new
        edges.append(Edge(face, other, start, stop))
    edges += [Edge(face, number, new, enters[face]) for face, new in leaves.items()]
    return Solid(corners, edges)


def nodes_of(solid: Solid, degree: int) -> Iterator[tuple[Point, float]]:
    """Yields nodes and weights of a rule that is exact to a degree."""
    ends = [(face, start, stop) for edge in solid.edges for face, start, stop in (edge[:1] + edge[2:], (edge[1], edge[3], edge[2]))]
    if not ends:
        return
    middle = _mean([solid.corners[start] for _, start, _ in ends])
    around: dict[int, list[Point]] = {}
    for face, start, _ in ends:
        around.setdefault(face, []).append(solid.corners[start])
    of_face = {face: _mean(points) for face, points in around.items()}
    volume = 0.0
    moments: Point = (0.0, 0.0, 0.0)
    for face, start, stop in ends:
        u, v, w = (
            tuple(p - q for p, q in zip(point, middle, strict=True)) for point in (of_face[face], solid.corners[start], solid.corners[stop])
        )
        part = (u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) + u[2] * (v[0] * w[1] - v[1] * w[0])) / 6.0
        if degree > 1:
            for r, s, t, weight in tetrahedron_rule(degree):
                yield tuple(o + r * x + s * y + t * z for o, x, y, z in zip(middle, u, v, w, strict=True)), weight * part
        volume += part
        moments = tuple(m + 0.25 * part * (x + y + z) for m, x, y, z in zip(moments, u, v, w, strict=True))
    if degree <= 1 and volume != 0.0:
        yield tuple(o + m / volume for o, m in zip(middle, moments, strict=True)), volume


def _mean(points: Sequence[Point]) -> Point:
    return tuple(sum(column) / len(points) for column in zip(*points, strict=True))
