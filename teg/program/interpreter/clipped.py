"""The meaning of `Polygon` and `Segment`: a domain that half-planes or half-lines cut, and a rule on what is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program.limits import NEARLY, THIN, TIE_EPS
from teg.program.operations import divide
from teg.program.statements import HalfLine, HalfPlane, Polygon, Segment

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

Vertex = tuple[float, ...]
"""u and v, and what else it carries."""
Line = tuple[float, float, float]
"""a, b and c of (c + a·u) + b·v."""


def polygon(machine: Machine, stmt: Polygon) -> list[float]:
    """Returns the results."""
    nothing = [0.0] * len(stmt.results)
    width, height, across = machine.numbers((stmt.width, stmt.height, stmt.across))
    planes = lines_of(machine, stmt.half_planes)
    ranges = [range_on_box(line, width, height) for line in planes]
    if any_fails(stmt.half_planes, ranges):
        return nothing
    if not all(map(math.isfinite, (width, height, across, *(most - least for least, most in ranges)))):
        return [math.nan] * len(nothing)
    if stmt.corners and across <= 0.0:
        return nothing
    machine.run(stmt.setup)
    if stmt.corners and across < THIN * max(most - least for least, most in ranges[:3]):
        vertices = _thin(machine, stmt, width, height, planes)
    else:
        vertices = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
        for line, (least, _) in zip(planes, ranges, strict=True):
            vertices = vertices if least >= 0.0 else clipped(vertices, line)
        if stmt.corners:
            vertices = [(u, v, *(_at(planes[k], (u, v)) * (1.0 / across) for k in (1, 2))) for u, v in vertices]
    return _over_a_fan(machine, stmt, vertices)


def _over_a_fan(machine: Machine, stmt: Polygon, vertices: list[Vertex]) -> list[float]:
    """Returns the rule on the triangles that vertex 0 spans with the sides; with degree 0 vertex 0 counts for all of them."""
    sums, first = [0.0] * len(stmt.results), vertices[0] if vertices else ()
    rule = triangle_rule(stmt.degree) if stmt.degree else ((0.0, 0.0, 1.0),)
    nodes: list[tuple[Vertex, float]] = []
    for second, third in pairwise(vertices[1:]):
        sides = [(p - o, q - o) for o, p, q in zip(first, second, third, strict=True)]
        area = 0.5 * (sides[0][0] * sides[1][1] - sides[0][1] * sides[1][0])
        for r, s, w in rule:
            nodes.append((tuple(o + r * p + s * q for o, (p, q) in zip(first, sides, strict=True)), w * area))
    for node, weight in nodes if stmt.degree else [(first, sum(w for _, w in nodes))] if nodes else []:
        machine.evaluations += 1
        values = machine.at(stmt.body, stmt.values, **dict(zip(stmt.variables, node, strict=True)))
        sums = [total + weight * value for total, value in zip(sums, values, strict=True)]
    return [factor * total for factor, total in zip(machine.numbers(stmt.factors), sums, strict=True)]


def _at(line: Line, vertex: Vertex) -> float:
    a, b, c = line
    return (c + a * vertex[0]) + b * vertex[1]


def lines_of(machine: Machine, half_planes: Sequence[HalfPlane]) -> list[Line]:
    """Returns the numbers of half-planes."""
    return [(machine.number(g.a), machine.number(g.b), machine.number(g.c)) for g in half_planes]


def any_fails(half_planes: Sequence[HalfPlane], ranges: Sequence[tuple[float, float]]) -> bool:
    """Returns whether a half-plane fails on the box on which they have these ranges."""
    return any(most <= 0.0 and not (g.closed and least >= 0.0) for (least, most), g in zip(ranges, half_planes, strict=True))


def range_on_box(line: Line, width: float, height: float) -> tuple[float, float]:
    """Returns the least and the largest value on the box; NaN stays one."""
    a, b, c = line
    u, v = a * width, b * height
    least = c + (0.0 if u >= 0.0 else u) + (0.0 if v >= 0.0 else v)
    return least, c + (0.0 if u <= 0.0 else u) + (0.0 if v <= 0.0 else v)


def clipped(vertices: list[Vertex], line: Line, exact: tuple[int, float] | None = None) -> list[Vertex]:
    """Returns the part of a polygon where a function is >= 0 (Sutherland and Hodgman); `exact` says which coordinate of a new vertex is
    known, and is that."""
    result: list[Vertex] = []
    for before, here in zip(vertices[-1:] + vertices[:-1], vertices, strict=True):
        g, h = _at(line, before), _at(line, here)
        if (g > 0.0 > h) or (g < 0.0 < h):
            (inner, gi), (outer, go) = ((before, g), (here, h)) if g > 0.0 else ((here, h), (before, g))
            t = gi / (gi - go)
            new = [i + t * (o - i) for i, o in zip(inner, outer, strict=True)]
            if exact is not None:
                new[exact[0]] = exact[1]
            result.append(tuple(new))
        if h >= 0.0:
            result.append(here)
    return result


def _thin(machine: Machine, stmt: Polygon, width: float, height: float, planes: list[Line]) -> list[Vertex]:
    """Returns a thin triangle cut by the box, and by the half-planes from number 3 on, with its barycentric coordinates."""
    at = [machine.numbers(corner) for corner in stmt.corners]
    carried = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    su, sv = math.copysign(1.0, width) if width else 1.0, math.copysign(1.0, height) if height else 1.0
    turn = (at[1][0] - at[0][0]) * (at[2][1] - at[0][1]) - (at[2][0] - at[0][0]) * (at[1][1] - at[0][1])
    order = (0, 2, 1) if turn * su * sv < 0.0 else (0, 1, 2)
    vertices: list[Vertex] = [(*at[k], *carried[k]) for k in order]
    sides = (((su, 0.0, 0.0), (0, 0.0)), ((-su, 0.0, su * width), (0, width)))
    ends = (((0.0, sv, 0.0), (1, 0.0)), ((0.0, -sv, sv * height), (1, height)))
    for line, exact in (*sides, *ends):
        vertices = clipped(vertices, line, exact)
    for line in planes[3:]:
        vertices = clipped(vertices, line)
    return vertices


def segment(machine: Machine, stmt: Segment) -> list[float]:
    """Returns the results."""
    nothing = [0.0] * len(stmt.results)
    machine.run(stmt.setup)
    start, stop, outside, undefined = 0.0, 1.0, False, False
    near = [_is_near(machine, g) for g in stmt.half_lines]
    if any(near):
        machine.run(stmt.scales)
    for g, is_near in zip(stmt.half_lines, near, strict=True):
        first, last = machine.numbers((g.first, g.last))
        if is_near and max(abs(first), abs(last)) <= TIE_EPS * machine.number(g.scale):
            assert g.k is not None
            machine.met.add(g.k)
            outside |= machine.holds(g.resolution) != (machine.order > 0)
            continue
        outside |= first <= 0.0 and last <= 0.0 and not (g.closed and first == 0.0 and last == 0.0)
        undefined |= not math.isfinite(first - last)
        if first < 0.0 < last:
            start = max(start, divide(first, first - last))
        if first > 0.0 > last:
            stop = min(stop, divide(first, first - last))
    if outside or not (start < stop or undefined):
        return nothing
    if undefined:
        return [math.nan] * len(nothing)
    sums = nothing
    for node, weight in zip(*gauss_legendre(stmt.nodes), strict=True):
        machine.evaluations += 1
        t = start + (stop - start) * (0.5 + 0.5 * node)
        values = machine.at(stmt.body, stmt.values, **{stmt.var: t})
        sums = [total + 0.5 * weight * value for total, value in zip(sums, values, strict=True)]
    return [factor * (total * (stop - start)) for factor, total in zip(machine.numbers(stmt.factors), sums, strict=True)]


def _is_near(machine: Machine, g: HalfLine) -> bool:
    """Returns whether a half-line may tie: then its scale is needed."""
    if g.k is None:
        return False
    first, last, size = machine.numbers((g.first, g.last, g.size))
    return abs(first) <= NEARLY * size and abs(last) <= NEARLY * size and math.isfinite(first - last)
