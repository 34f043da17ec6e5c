"""Clipped polyhedra in C: the box is clipped first (teg_polyhedron), then `body` is run at the nodes of some tetrahedra after others."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.frame import Frame
from teg.backends.c.polygon import LANES, at_nodes, leave, totals, zero_sums
from teg.backends.c.runtime import room_of_solid
from teg.backends.c.text import indent, literal, packed
from teg.numerics.polyhedra import SIDES
from teg.numerics.quadrature import tetrahedron_rule
from teg.program import Arg, Polyhedron

TOGETHER = 32
"""Nodes that are computed before the next tetrahedra, about."""


def polyhedron_lanes(degree: int) -> int:
    """Returns the number of nodes of a polyhedron that are computed side by side."""
    return LANES if degree > 1 else 1


def polyhedron(stmt: Polyhedron, frame: Frame, distinct: Sequence[Arg], lanes: int, counted: bool) -> list[str]:
    """Returns the inside of a polyhedron's routine."""
    scope = frame.scope()
    n, count = len(stmt.half_spaces), len(stmt.results)
    room = room_of_solid(n)
    spaces = packed((f"{{{', '.join(map(scope, (*g.slopes, g.offset)))}, {int(g.closed)}}}" for g in stmt.half_spaces), "", ", ", ",")
    before, loop = _nodes(stmt.degree, SIDES + n)
    return [
        f"const teg_half_space spaces[{n}] = {{",
        *indent(*spaces),
        "};",
        f"const double extents[3] = {{{', '.join(map(scope, stmt.extents))}}};",
        f"double px[{room}], py[{room}], pz[{room}];",
        f"teg_solid_edge edges[{room}];",
        "teg_solid solid = {0, 0, px, py, pz, edges};",
        f"const int left = teg_polyhedron(&solid, {n}, spaces, extents);",
        "if (left <= 0) {",
        *indent(*leave(count, "left ? NAN : 0.0")),
        "}",
        *frame.block(0),
        *before,
        zero_sums(len(distinct), lanes),
        *loop,
        *indent(*(["ctx->evaluations += nodes;"] if counted else []), *at_nodes("xyz", frame.block(1), lanes)),
        "}",
        *totals(stmt, distinct, scope, lanes),
    ]


def _nodes(degree: int, faces: int) -> tuple[list[str], list[str]]:
    """Returns lines before the loop over some nodes after others, and its first lines."""
    if degree <= 1:
        place = "teg_centroid" if degree else "teg_volume"
        one = "const double at_x[1] = {at[0]}, at_y[1] = {at[1]}, at_z[1] = {at[2]}, weights[1] = {volume};"
        return ["double at[3];", f"const double volume = {place}(&solid, {faces}, at);", one, "const int nodes = 1;"], ["{"]
    count = len(tetrahedron_rule(degree))
    most = max(1, TOGETHER // count)
    room = -(-most * count // LANES) * LANES
    before = [
        "double middle[3], of_face[TEG_SOLID_FACES][3];",
        f"teg_middles(&solid, {faces}, middle, of_face);",
        f"double {', '.join(f'{name}[{room}]' for name in ('at_x', 'at_y', 'at_z', 'weights'))};",
    ]
    given = f"&solid, first, {most}, middle, (const double (*)[3])of_face, {count}, teg_tetrahedra_{degree}, at_x, at_y, at_z, weights"
    return before, [
        f"for (int first = 0; first < 2 * left; first += {most}) {{",
        *indent(f"const int nodes = teg_tetrahedra({given});"),
    ]


def tetrahedron_table(degree: int) -> str:
    """Returns the rule on a tetrahedron as a constant."""
    rule = tetrahedron_rule(degree)
    rows = [f"{{{', '.join(map(literal, node))}}}," for node in rule]
    return "\n".join([f"static const double teg_tetrahedra_{degree}[{len(rule)}][4] = {{", *indent(*rows), "};"])
