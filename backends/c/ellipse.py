"""Moments of ellipses in C: `Ellipse` of `teg.program`; what they have in common is in runtime/ellipse.h."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from math import comb

from teg.backends.c.frame import Frame
from teg.backends.c.text import indent, literal, packed, wrapped
from teg.numerics.arcs import FEW, MANY, longest_arc
from teg.numerics.quadrature import gauss_legendre
from teg.program import Ellipse, Moments

Powers = tuple[int, int]
LARGEST = sys.float_info.max
Along = tuple[int, int, int, int]
"""The powers of u and v, and of both numbers of w."""
Wanted = tuple[tuple[Powers, ...], tuple[Along, ...]]
"""The moments of the inside, and those along the arcs."""


def wanted(stmt: Ellipse) -> Wanted:
    """Returns the moments of which the results are made, and of the inside those of lower powers."""
    inside = {(a, b) for m in stmt.moments if m.kind != "border" for j, k, _ in m.terms for a in range(j + 1) for b in range(k + 1)}
    border = {(j, k, *m.axes) for m in stmt.moments if m.kind == "border" for j, k, _ in m.terms}
    return tuple(sorted(inside)), tuple(sorted(border))


def function_name(moments: Wanted) -> str:
    """Returns the name of the C function of some moments."""
    inside, border = (("".join(f"_{_label(powers)}" for powers in part)) for part in moments)
    return f"teg_in{inside}_on{border}"


def _label(powers: Sequence[int]) -> str:
    """Returns powers as a part of a name."""
    j, k, *axes = powers
    return f"{j}{k}w{''.join(map(str, axes))}" if any(axes) else f"{j}{k}"


def ellipse(stmt: Ellipse, frame: Frame) -> list[str]:
    """Returns the inside of an ellipse's routine."""
    return _Routine(stmt, frame).lines()


class _Routine:
    """The inside of an ellipse's routine."""

    def __init__(self, stmt: Ellipse, frame: Frame) -> None:
        self.stmt, self.scope = stmt, frame.scope()
        self.matrix, self.place = [self.scope(arg) for arg in stmt.matrix], [self.scope(arg) for arg in stmt.place]
        self.planes = packed(
            (f"{{{', '.join(map(self.scope, (g.a, g.b, g.c)))}, {int(g.closed)}}}" for g in stmt.half_planes), "", ", ", ","
        )
        self.inside, self.border = wanted(stmt)

    def lines(self) -> list[str]:
        """Returns the lines: what the ellipse does not cross first."""
        (a, b, c, d), (u, v, radius, width, height, least) = self.matrix, self.place
        finite, known = (" + ".join(f"({x} - {x})" for x in dict.fromkeys(some)) for some in ((u, v, width, height), (radius, least)))
        return [
            f"const double det = {a} * {d} - {b} * {c}, turn = det < 0.0 ? -1.0 : 1.0, whole = turn * det;",
            f"const double matrix[4] = {{{a}, {b}, turn * {c}, turn * {d}}};",
            "if (!(whole > 0.0)) {",
            *indent(*self._leave_with("NAN")),
            "}",
            *(self._clipping() if self.planes else []),
            f"const double inverse[4] = {{{d} / det, -{b} / whole, -{c} / det, {a} / whole}};",
            f"const double reach[2] = {{hypot({d}, {b}) / whole, hypot({a}, {c}) / whole}};",
            f"const double largest = {radius} > {least} ? {radius} : {least};",
            f"if (teg_box_beside(reach, {u}, {v}, largest * (1.0 + TEG_TANGENT), {width}, {height})) {{",
            *indent(*self._whole("below"), *self._leave({"below": "whole"})),
            "}",
            f"if (!({finite} + {known} == 0.0)) {{",
            f"    const double size = {' + '.join(f'{x} * {x}' for x in (u, v, width, height))};",
            f"    if (size <= {literal(LARGEST)} && {radius} > {literal(LARGEST)}) {{",
            *indent(*indent(*self._whole("above"), *self._leave({"above": "whole"}))),
            *indent("}", *self._leave_with("NAN")),
            "}",
            *self._crossed(),
        ]

    def _clipping(self) -> list[str]:
        n, (width, height) = len(self.stmt.half_planes), self.place[3:5]
        room = 2 * (4 + n) + 1
        return [
            f"const teg_half_plane planes[{n}] = {{",
            *indent(*self.planes),
            "};",
            f"double px[{room}], py[{room}];",
            f"const int corners = teg_polygon({n}, planes, {width}, {height}, px, py);",
            "if (corners >= 0 && corners < 3) {",
            *indent(*self._leave_with("0.0")),
            "}",
            "if (corners < 0) {",
            *indent(*self._leave_with("NAN")),
            "}",
            f"teg_counterclockwise(corners, px, py, {width}, {height});",
        ]

    def _crossed(self) -> list[str]:
        """Returns the lines for an ellipse that may cross the box."""
        radius, least = self.place[2], self.place[5]
        function = function_name((self.inside, self.border))
        smaller = [
            f"if ({radius} < {least}) {{",
            *indent(self._trace(least), f"double unused[{self._room()}];", f"{function}(&curve, inverse, unused, on);"),
            "}",
        ]
        asked = {(j, k) for m in self.stmt.moments if m.kind != "border" for j, k, _ in m.terms}
        return [
            "teg_ellipse curve;",
            self._trace(radius),
            f"double in[{self._room()}], on[{max(len(self.border), 1)}];",
            f"{function}(&curve, inverse, in, on);",
            *(smaller if self.border else []),
            *self._whole("below"),
            *packed(f"const double in_{j}{k} = in[{i}];" for i, (j, k) in enumerate(self.inside) if (j, k) in asked),
            *packed(f"const double on_{_label(p)} = 0.5 / {'det' if p[3] % 2 else 'whole'} * on[{i}];" for i, p in enumerate(self.border)),
            *self._leave({"above": "in", "below": "rest", "border": "on"}),
        ]

    def _room(self) -> int:
        return max(len(self.inside), 1)

    def _trace(self, radius: str) -> str:
        u, v, _, width, height, _ = self.place
        place = f"&curve, matrix, inverse, reach, {u}, {v}, {radius}, {width}, {height}"
        return (
            f"teg_trace_polygon({place}, corners, px, py, {len(self.stmt.half_planes)}, planes);"
            if self.planes
            else f"teg_trace_box({place});"
        )

    def _whole(self, kind: str) -> list[str]:
        """Returns the lines for the moments of a polygon that results of a kind need; those of a box are products."""
        powers = sorted({(j, k) for m in self.stmt.moments if m.kind == kind for j, k, _ in m.terms}) if self.planes else []
        known = (f"const double whole_{j}{k} = all[{self.inside.index((j, k))}];" for j, k in powers)
        lines = [
            "teg_ellipse sides;",
            f"teg_trace_sides(&sides, corners, px, py, {self.place[3]}, {self.place[4]});",
            f"double all[{self._room()}], none[{max(len(self.border), 1)}];",
            f"{function_name((self.inside, self.border))}(&sides, inverse, all, none);",
        ]
        return [*lines, *packed(known)] if powers else []

    def _leave(self, places: dict[str, str]) -> list[str]:
        """Returns with the results, from what stands for the moments of each kind."""
        return self._leave_all([self._polynomial(m, places.get(m.kind, "")) for m in self.stmt.moments])

    def _leave_with(self, value: str) -> list[str]:
        return self._leave_all([value] * len(self.stmt.results))

    def _leave_all(self, values: Sequence[str]) -> list[str]:
        if len(values) == 1:
            return [f"return {values[0]};"]
        return [*packed(f"sum[{i}] = {value};" for i, value in enumerate(values)), "return;"]

    def _polynomial(self, moments: Moments, place: str) -> str:
        """Returns Σ c·moment, as an operand; the moments are variables, those of the whole, or what an ellipse leaves of that."""
        terms = []
        for j, k, c in moments.terms:
            whole = f"whole_{j}{k}"
            if not self.planes:
                whole = " * ".join([*[self.place[3]] * (j + 1), *[self.place[4]] * (k + 1), repr(1.0 / ((j + 1) * (k + 1)))])
            moment = {"": "0.0", "whole": whole, "rest": f"({whole} - in_{j}{k})"}.get(place, f"{place}_{_label((j, k, *moments.axes))}")
            terms.append(moment if c == 1.0 else f"{self.scope(c)} * {moment}")
        return f"({' + '.join(terms)})" if place else "0.0"


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(map(repr, numbers))


def moments_function(moments: Wanted) -> str:
    """Returns the C function of some moments of the part of an ellipse in a box: ∫∫ uʲvᵏ inside, ∮ uʲvᵏpᵐqⁿ dφ along the arcs."""
    inside, border = moments
    degree = max([2 + max(j + k for j, k in inside)] if inside else [0])
    degree = max([degree, *map(sum, border)])
    on = [p for p in border if any(p)]
    lines = [
        f"static void {function_name(moments)}(const teg_ellipse *e, const double *inverse, double *in, double *on)",
        "{",
        *indent(
            *([_rule(n) for n in (FEW, MANY)] if inside or on else ["(void)inverse;"]),
            *([] if inside else ["(void)in;"]),
            *([] if border else ["(void)on;"]),
            *packed(f"double in_{j}{k} = 0.0;" for j, k in inside),
            *packed(f"double on_{_label(p)} = 0.0;" for p in border),
            "for (int i = 0; i < e->arcs; i++) {",
            *indent(
                "teg_arc arc = e->arc[i];",
                *(["on_00 += arc.angle;"] if (0, 0, 0, 0) in border else []),
                *(_along(inside, on, degree) if inside or on else []),
            ),
            "}",
            *(_chords(inside) if inside else []),
            *packed(f"on[{i}] = e->sign * on_{_label(p)};" for i, p in enumerate(border)),
        ),
        "}",
    ]
    return wrapped(lines)


def _rule(n: int) -> str:
    nodes, weights = gauss_legendre(n)
    return f"static const double rule_{n}[{2 * n}] = {{{_listed((*nodes, *weights))}}};"


def _along(inside: Sequence[Powers], on: Sequence[Along], degree: int) -> list[str]:
    """Returns the lines that add what the nodes on an arc give."""
    names = [f"in_{_label(p)}" for p in inside] + [f"on_{_label(p)}" for p in on]
    values = [_monomial("turning", "xy", p) for p in inside] + [_monomial("weight", "uvpq", p) for p in on]
    seen = any(any(p[2:]) for p in on)
    turning = "weight * (x * at[3 * n + k] - y * at[2 * n + k])"
    per_node = [
        "const double weight = at[4 * n + k];",
        *_coordinates(on, "e->from_u + at[k]", "e->from_v + at[n + k]", "at[5 * n + k]", "at[6 * n + k]"),
        *(["const double x = at[k] - e->u, y = at[n + k] - e->v;"] if inside else []),
        *([f"const double turning = {turning};"] if inside else []),
        *(f"term[{m}][k - first] = {value};" for m, value in enumerate(values)),
    ]
    return [
        f"const int n = arc.angle <= {longest_arc(FEW, degree)!r} ? {FEW} : {MANY};",
        f"const int parts = n == {FEW} ? 1 : 1 + (int)(arc.angle * {1.0 / longest_arc(MANY, degree)!r});",
        "for (int part = 0; part < parts; part++) {",
        *indent(
            f"double at[{(7 if seen else 5) * MANY}], term[{len(names)}][8];",
            f"if (n == {FEW}) {{",
            f"    teg_nodes_on_arc({FEW}, rule_{FEW}, inverse, &arc, arc.angle, {int(seen)}, at);",
            "} else {",
            f"    teg_nodes_on_arc({MANY}, rule_{MANY}, inverse, &arc, arc.angle / parts, {int(seen)}, at);",
            "}",
            "for (int first = 0; first < n; first += 8) {",
            *indent("for (int k = first; k < first + 8; k++) {", *indent(*per_node), "}"),
            *indent(*(f"{name} += teg_total(term[{m}]);" for m, name in enumerate(names))),
            "}",
        ),
        "}",
    ]


def _monomial(factor: str, names: str, powers: Sequence[int]) -> str:
    return " * ".join([factor, *(name for name, power in zip(names, powers, strict=True) for _ in range(power))])


def _coordinates(powers: Sequence[Sequence[int]], *places: str) -> list[str]:
    """Returns declarations of the coordinates that are in monomials."""
    return [f"const double {name} = {at};" for i, (name, at) in enumerate(zip("uvpq", places, strict=False)) if any(p[i] for p in powers)]


def _chords(inside: Sequence[Powers]) -> list[str]:
    """Returns the lines that add what the chords give, and move the moments from the point inside to the corner of the box."""
    nodes, weights = gauss_legendre(max(j + k for j, k in inside) // 2 + 1)
    steps = []
    for x, w in zip(nodes, weights, strict=True):
        lines = [
            *_coordinates(inside, *(f"{0.5 * (1.0 - x)!r} * {start} + {0.5 * (1.0 + x)!r} * {end}" for start, end in ("ps", "qt"))),
            *(f"in_{j}{k} += {_monomial(f'{0.5 * w!r} * across', 'uv', (j, k))};" for j, k in inside),
        ]
        steps += ["{", *indent(*lines), "}"] if len(inside) > 1 else ["in_00 += across;"]
    moved = []
    for i, (j, k) in enumerate(inside):
        terms = []
        for a in range(j + 1):
            for b in range(k + 1):
                factor = comb(j, a) * comb(k, b) / (a + b + 2)
                terms.append(" * ".join([repr(factor), *["u"] * (j - a), *["v"] * (k - b), f"in_{a}{b}"]))
        moved.append(f"in[{i}] = e->sign * ({' + '.join(terms)});")
    return [
        "for (int i = 0; i < e->chords; i++) {",
        *indent(
            "const double *c = e->chord[i], p = c[0] - e->u, q = c[1] - e->v, s = c[2] - e->u, t = c[3] - e->v;",
            "const double across = p * t - q * s;",
            *steps,
        ),
        "}",
        *_coordinates(inside, "e->from_u + e->u", "e->from_v + e->v"),
        *moved,
    ]
