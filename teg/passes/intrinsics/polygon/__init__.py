"""Clipped polyhedra, polygons and segments: `match` recognises integrals, `lowering` makes the statements, `errors` their estimates;
`adjoints` has their moments in loops.

operands    the box or the unit interval; half-spaces, half-planes or half-lines; a polynomial body
results     factors · ∫∫∫, ∫∫ or ∫ of each value over the domain that these leave
off         integrals by pieces, with a break wherever three planes or two lines meet, or one crosses a side
"""

from __future__ import annotations

from teg.ir.integral import Integral, masses_of
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule, triangle_rule
from teg.passes.intrinsics.polygon.adjoints import with_adjoints
from teg.passes.intrinsics.polygon.errors import numbers_of, with_errors
from teg.passes.intrinsics.polygon.lowering import PolygonLowering
from teg.passes.intrinsics.polygon.match import match_clipped
from teg.passes.lower.intrinsic import Description, Intrinsic, Statement
from teg.program import Polygon, Polyhedron, Segment


def describe(node: Integral) -> Description | None:
    """Returns the description of a clipped polyhedron, polygon or interval."""
    clipped = match_clipped(node) if masses_of(node.body, node.var) is None else None
    if clipped is None:
        return None
    if len(clipped.boxes) == 1:
        return Description("clipped interval", clipped.degree // 2 + 1, clipped.degree, 1, clipped.inside)
    if len(clipped.boxes) == 3:
        nodes, pieces = nodes_of_solid(clipped.degree, len(clipped.halves))
        return Description("clipped polyhedron", nodes, clipped.degree, pieces, clipped.inside)
    nodes, pieces = nodes_of(clipped.degree, len(clipped.halves))
    return Description("clipped polygon", nodes, clipped.degree, pieces, clipped.inside)


def nodes_of(degree: int, half_planes: int) -> tuple[int, int]:
    """Returns the nodes of a triangle, and the largest number of triangles: those of a box from which each half-plane cuts a corner."""
    return len(triangle_rule(degree)), half_planes + 2 if degree else 1


def nodes_of_solid(degree: int, half_spaces: int) -> tuple[int, int]:
    """Returns the nodes of a tetrahedron, and the largest number of tetrahedra: one for each of two sides of 3f - 6 edges of f faces."""
    return len(tetrahedron_rule(degree)), 6 * (SIDES + half_spaces) - 12 if degree > 1 else 1


def of_polyhedron(stmt: Polyhedron) -> int:
    """Returns the number of evaluations of the integrand."""
    nodes, pieces = nodes_of_solid(stmt.degree, len(stmt.half_spaces))
    return nodes * pieces


def of_tetrahedron(stmt: Polyhedron) -> int:
    """Returns the number of evaluations of the integrand where a tetrahedron is left."""
    nodes, pieces = nodes_of_solid(stmt.degree, 4 - SIDES)
    return nodes * pieces


def of_polygon(stmt: Polygon) -> int:
    """Returns the number of evaluations of the integrand."""
    nodes, triangles = nodes_of(stmt.degree, len(stmt.half_planes))
    return nodes * triangles


def of_triangle(stmt: Polygon) -> int:
    """Returns the number of evaluations of the integrand where one triangle is left."""
    return nodes_of(stmt.degree, len(stmt.half_planes))[0]


def of_segment(stmt: Segment) -> int:
    """Returns the number of evaluations of the integrand."""
    return stmt.nodes


POLYGON = Intrinsic(
    "polygon",
    PolygonLowering,
    describe=describe,
    loops=with_adjoints,
    statements={
        Polyhedron: Statement(with_errors, numbers_of, of_polyhedron, of_tetrahedron),
        Polygon: Statement(with_errors, numbers_of, of_polygon, of_triangle),
        Segment: Statement(with_errors, numbers_of, of_segment, of_segment),
    },
)
