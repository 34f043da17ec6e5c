"""Clipped polygons and segments in C: the domain is clipped first, then `body` is run at several nodes side by side.

    polygon        classify, clip (teg_polygon, teg_triangle), setup, nodes of a fan (arrays), for every LANES of them: body, sums; totals
    segment        setup, cut by each half-line (teg_cut), near ties looked at, Gauss-Legendre nodes side by side, totals

Lanes are GCC's and clang's vectors of doubles; elsewhere a lane is a double and the loops take one node at a time. A body with other
operations than sums, products and quotients (an integrand that calls a function of a constant has it outside) runs node by node too.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from teg.backends.c.frame import SUMS, WEIGHT, Frame, Scope, Step
from teg.backends.c.text import indent, literal, packed
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import Arg, Assign, Polygon, Polyhedron, Segment, Stmt

SOME = 8
"""Sums of a step."""
LANES = 8
"""Nodes of a polygon side by side."""
LONGEST = 200
"""Statements of a body that runs side by side: it is one block, as values in lanes cannot cross the border of a part."""
COORDINATES = ("x", "y", "l1", "l2")
"""Of a node: its place, and its barycentric coordinates."""
SIDE_BY_SIDE = {"add", "sub", "mul", "div", "neg", "const"}


def runs_side_by_side(body: Sequence[Stmt]) -> bool:
    """Returns whether a body is arithmetic only, and short enough to be one block."""
    for stmt in body:
        if not isinstance(stmt, Assign) or not (stmt.op in SIDE_BY_SIDE or (stmt.op == "powi" and stmt.args[1] == 2)):
            return False
    return len(body) <= LONGEST


def sums(values: Sequence[Arg]) -> tuple[list[Arg], list[Step]]:
    """Returns the distinct values, and the steps that add each, times its weight, to its sum."""
    distinct = list(dict.fromkeys(values))
    steps = []
    for first in range(0, len(distinct), SOME):
        some = tuple(distinct[first : first + SOME])
        steps.append(Step((), some, lines=partial(_added, first, some), weight=len(some), locals=(SUMS, WEIGHT)))
    return distinct, steps


def _added(first: int, values: Sequence[Arg], scope: Scope) -> list[str]:
    return packed(f"s[{j}] += weight * {_factor(scope, value)};" for j, value in enumerate(values, first))


def _factor(scope: Scope, value: Arg) -> str:
    text = scope.spell(value)
    return text.text if text.level >= 4 else f"({text.text})"


def leave(count: int, value: str) -> list[str]:
    """Return with every result the same."""
    return [f"return {value};"] if count == 1 else [f"teg_fill(sum, {count}, {value});", "return;"]


def totals(stmt: Polyhedron | Polygon | Segment, distinct: Sequence[Arg], scope: Scope, lanes: int) -> list[str]:
    """Returns the results, from the sums."""
    lines = []
    if lanes > 1:
        lines.append(f"double total[{len(distinct)}];")
        lines.append(f"for (int j = 0; j < {len(distinct)}; j++) total[j] = teg_total_{lanes}(s + j);")
    array = "total" if lanes > 1 else "s"
    for i, (value, factor) in enumerate(zip(stmt.values, stmt.factors, strict=True)):
        spelled = "" if factor == 1.0 else f"{_factor(scope, factor)} * "
        place = "return" if len(stmt.results) == 1 else f"sum[{i}] ="
        lines.append(f"{place} {spelled}{array}[{distinct.index(value)}];")
    return packed(lines)


def in_lanes(block: Sequence[str], lanes: int) -> list[str]:
    """Returns the lines of a body with its values in lanes."""
    return [line.replace("const double v", f"const teg_lanes_{lanes} v") for line in block] if lanes > 1 else list(block)


def polygon(stmt: Polygon, frame: Frame, distinct: Sequence[Arg], lanes: int, counted: bool) -> list[str]:
    """Returns the inside of a polygon's routine."""
    scope = frame.scope()
    n, count = len(stmt.half_planes), len(stmt.results)
    planes = packed((f"{{{scope(g.a)}, {scope(g.b)}, {scope(g.c)}, {int(g.closed)}}}" for g in stmt.half_planes), "", ", ", ",")
    rule = triangle_rule(stmt.degree)
    room = 2 * (4 + n)
    nodes = -(-(2 * room if stmt.degree == 2 else room * len(rule)) // LANES) * LANES
    which = {0: "_0", 2: "_2"}.get(stmt.degree, "")
    table = "" if which else f"{len(rule)}, teg_triangle_{stmt.degree}, "
    arguments = f"{n}, planes, {scope(stmt.width)}, {scope(stmt.height)}"
    names = COORDINATES[: len(stmt.variables)]
    coordinates = names[2:]
    carried = [f"teg_carry{which}(corners, p{name}, {table}at_{name});" for name in coordinates]
    straight = [f"teg_affine(nodes, planes + {k}, inverse, at_x, at_y, at_{name});" for k, name in enumerate(coordinates, 1)]
    if stmt.corners:
        carried = [
            "if (thin) {",
            *indent(*carried),
            "} else {",
            *indent(f"const double inverse = 1.0 / {scope(stmt.across)};", *straight),
            "}",
        ]
    clipping = [f"const int corners = teg_polygon({arguments}, px, py);"]
    if stmt.corners:
        places = ", ".join(f"{{{scope(u)}, {scope(v)}}}" for u, v in stmt.corners)
        clipping = [
            f"const double at[3][2] = {{{places}}};",
            f"double *const p[4] = {{{', '.join(f'p{name}' for name in names)}}};",
            "int thin = 0;",
            f"const int corners = teg_triangle({arguments}, at, {scope(stmt.across)}, p, &thin);",
        ]
    return [
        f"const teg_half_plane planes[{n}] = {{",
        *indent(*planes),
        "};",
        f"double {', '.join(f'p{name}[{room}]' for name in names)};",
        *clipping,
        "if (corners <= 0) {",
        *indent(*leave(count, "corners ? NAN : 0.0")),
        "}",
        *frame.block(0),
        f"double {', '.join(f'{name}[{nodes}]' for name in (*(f'at_{name}' for name in names), 'weights'))};",
        f"const int nodes = teg_fan{which}(corners, px, py, {table}at_x, at_y, weights);",
        *carried,
        *([f"if (corners > 2) ctx->evaluations += {len(rule)}{' * (corners - 2)' if stmt.degree else ''};"] if counted else []),
        zero_sums(len(distinct), lanes),
        *at_nodes(names, frame.block(1), lanes),
        *totals(stmt, distinct, scope, lanes),
    ]


def zero_sums(count: int, lanes: int) -> str:
    """Returns the declaration of sums that are 0."""
    return f"teg_lanes_{lanes} s[{count}] = {{{{0.0}}}};" if lanes > 1 else f"double s[{count}] = {{0.0}};"


def at_nodes(names: Sequence[str], block: Sequence[str], lanes: int) -> list[str]:
    """Returns the loop over nodes, so many of them side by side; their coordinates stand in arrays at_… and weights."""
    kind, width = (f"teg_lanes_{lanes}", f"(int)(sizeof(teg_lanes_{lanes}) / sizeof(double))") if lanes > 1 else ("double", "1")
    arrays = [*((name, f"at_{name}") for name in names), ("weight", "weights")]
    return [
        f"for (int k = 0; k < nodes; k += {width}) {{",
        *indent(
            *(f"const {kind} {name} = *(const {kind} *)({array} + k);" for name, array in arrays),
            " ".join(f"(void){name};" for name in names),
            *in_lanes(block, lanes),
        ),
        "}",
    ]


def triangle_table(degree: int) -> str:
    """Returns the rule on a triangle as a constant."""
    rule = triangle_rule(degree)
    rows = [f"{{{literal(r)}, {literal(s)}, {literal(w)}}}," for r, s, w in rule]
    return "\n".join([f"static const double teg_triangle_{degree}[{len(rule)}][3] = {{", *indent(*rows), "};"])


def segment_lanes(nodes: int) -> int:
    """Returns the number of nodes of a segment that are computed side by side."""
    return next(n for n in (1, 2, 4, 8) if n >= nodes or n == 8)


def segment(stmt: Segment, frame: Frame, distinct: Sequence[Arg], lanes: int, counted: bool) -> list[str]:
    """Returns the inside of a segment's routine."""
    scope = frame.scope()
    count, tying = len(stmt.results), [i for i, g in enumerate(stmt.half_lines) if g.k is not None]
    setup = frame.block(0)
    ends = packed(f"const double first_{i} = {scope(g.first)}, last_{i} = {scope(g.last)};" for i, g in enumerate(stmt.half_lines))
    lines = [*setup, *ends, "teg_interval_cut cut = {0.0, 1.0, 0, 0};"]
    if tying:
        kind = "int" if len(tying) < 31 else "unsigned long long"  # a bit a half-line
        cast = "" if kind == "int" else f"({kind})"
        sizes = {i: scope(stmt.half_lines[i].size) for i in tying}
        near = [f"{cast}teg_is_near(first_{i}, last_{i}, {sizes[i]}) << {j}" for j, i in enumerate(tying)]
        lines += [f"{kind} tied = 0;", f"const {kind} near = " + " | ".join(near) + ";", "if (near) {"]
        inside = list(frame.block(1))
        for j, i in enumerate(tying):
            g = stmt.half_lines[i]
            held = f"{scope(g.scale)}, {scope(g.resolution)}"
            inside.append(f"if (near >> {j} & 1) tied |= {cast}teg_ties(ctx, &cut, first_{i}, last_{i}, {held}) << {j};")
        lines += [*indent(*inside), "}"]
    for i, g in enumerate(stmt.half_lines):
        guard = f"if (!(tied >> {tying.index(i)} & 1)) " if i in tying else ""
        lines.append(f"{guard}teg_cut(&cut, first_{i}, last_{i}, {int(g.closed)});")
    wide = f"teg_lanes_{lanes}" if lanes > 1 else "double"
    width = f"(int)(sizeof({wide}) / sizeof(double))" if lanes > 1 else "1"
    padded = -(-stmt.nodes // lanes) * lanes
    return [
        *lines,
        "if (cut.outside || !(cut.from < cut.to)) {",
        *indent(*leave(count, "cut.undefined && !cut.outside ? NAN : 0.0")),
        "}",
        "if (cut.undefined) {",
        *indent(*leave(count, "NAN")),
        "}",
        "const double length = cut.to - cut.from;",
        *([f"ctx->evaluations += {stmt.nodes};"] if counted else []),
        f"{wide} s[{len(distinct)}] = {{{{0.0}}}};" if lanes > 1 else f"double s[{len(distinct)}] = {{0.0}};",
        f"for (int k = 0; k < {padded}; k += {width}) {{",
        *indent(
            f"const {wide} weight = length * *(const {wide} *)(teg_unit_{stmt.nodes}[1] + k);",
            f"const {wide} x = cut.from + length * *(const {wide} *)(teg_unit_{stmt.nodes}[0] + k);",
            "(void)x;",
            *in_lanes(frame.block(2), lanes),
        ),
        "}",
        *totals(stmt, distinct, scope, lanes),
    ]


def unit_table(nodes: int, lanes: int) -> str:
    """Gauss-Legendre on (0, 1): nodes, and weights, padded with nodes of no weight."""
    at, weights = gauss_legendre(nodes)
    padded = -(-nodes // lanes) * lanes
    rows = [[0.5 + 0.5 * x for x in at] + [0.5] * (padded - nodes), [0.5 * w for w in weights] + [0.0] * (padded - nodes)]
    texts = [f"{{{', '.join(map(literal, row))}}}," for row in rows]
    return "\n".join([f"static const double teg_unit_{nodes}[2][{padded}] = {{", *indent(*texts), "};"])
