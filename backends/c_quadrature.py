"""The rules in C: a piece by Gauss-Legendre or by adaptive Gauss-Kronrod, roots, places and sums; the tables of Gauss-Legendre."""

from __future__ import annotations

import re
from collections.abc import Sequence

from teg.backends.c_text import each, indent, literal
from teg.program import Adaptive
from teg.quadrature import gauss_legendre


def gauss_piece(block: Sequence[str], nodes: int, count: int) -> list[str]:
    """Add a Gauss-Legendre rule over (p, q) to `sum`; `block` writes the values at x to `f`."""
    return [
        "const double middle = 0.5 * (p + q), half = 0.5 * (q - p);",
        f"for (int k = 0; k < {nodes}; k++) {{",
        *indent(
            f"const double weight = half * teg_gauss_{nodes}[k].weight;",
            f"x = middle + half * teg_gauss_{nodes}[k].node;",
            *block,
            each(count, "sum[j] += weight * f[j];"),
        ),
        "}",
    ]


def adaptive_piece(block: Sequence[str], rule: Adaptive, count: int, watched: int, ties: bool) -> list[str]:
    """Add the adaptive rule over (p, q) to `sum`, from the left; `waiting` is a stack of intervals.

    `block` writes the values at x to `f`, then the watched conditions. Where there are any, k runs over the ends of the
    interval (-2, -1) before the nodes, and stops where a condition changed and the interval will be halved anyway.
    """
    place = "x = p + (q - p) * u;"
    slope = "half * (q - p)"
    if rule.smooth:
        place, slope = "x = p + (q - p) * (u * u * (3.0 - 2.0 * u));", f"{slope} * (6.0 * u * (1.0 - u))"
    good = f"teg_accepts({count}, kronrod, gauss, size, whole, {literal(rule.tol)})"
    good = f"here.depth >= TEG_MAX_DEPTH || used >= TEG_MAX_INTERVALS || {good}"
    node, first = "teg_pair[k].node", "0"
    before: list[str] = []
    after: list[str] = []
    if watched:
        node, first, good = f"(k < 0 ? 2 * k + 3 : {node})", "-2", f"changed ? last : {good}"
        before = [
            "const int last = used >= TEG_MAX_INTERVALS || here.to - here.from <= TEG_WATCH_WIDTH;",
            f"int changed = 0, seen[{watched}] = {{0}};",
        ]
        after = [
            f"for (int j = 0; j < {watched}; j++) changed |= (seen[j] |= f[{count} + j] != 0.0 ? 1 : 2) == 3;",
            *(["if (k < 0) ctx->tied = tied;"] if ties else []),
            "if (changed && !last && used > 1) break;",
            "if (k < 0) continue;",
        ]
    return [
        "teg_interval waiting[TEG_MAX_DEPTH + 2];",
        "waiting[0] = (teg_interval){0.0, 1.0, 0};",
        "for (int n = 1, used = 1; n > 0; used++) {",
        *indent(
            "const teg_interval here = waiting[--n];",
            "const double middle = 0.5 * (here.from + here.to), half = 0.5 * (here.to - here.from);",
            *(f"teg_fill({name}, {count}, 0.0);" for name in ("kronrod", "gauss", "size")),
            *before,
            f"for (int k = {first}; k < 21; k++) {{",
            *indent(
                f"const double u = middle + half * {node};",
                f"const double slope = {slope};",
                place,
                *(["const int tied = ctx->tied;"] if watched and ties else []),
                *block,
                *after,
                f"for (int j = 0; j < {count}; j++) {{",
                *indent(
                    "const double y = slope * f[j];",
                    "kronrod[j] += teg_pair[k].kronrod * y;",
                    "gauss[j] += teg_pair[k].gauss * y;",
                    "size[j] += teg_pair[k].kronrod * fabs(y);",
                ),
                "}",
            ),
            "}",
            f"if (used == 1) {each(count, 'whole[j] = size[j];')}",
            f"if ({good}) {{",
            *indent(each(count, "sum[j] += kronrod[j];")),
            "} else {",
            *indent(
                "waiting[n++] = (teg_interval){middle, here.to, here.depth + 1};",
                "waiting[n++] = (teg_interval){here.from, middle, here.depth + 1};",
            ),
            "}",
        ),
        "}",
    ]


def isolation(enclosure: Sequence[str], point: Sequence[str], lo: str, hi: str, count: int) -> list[str]:
    """Write the roots between lo and hi to `root`: `point` writes g and g' at x to `f`, `enclosure` bounds over (left, right) to `f + 2`.

    A box that its bounds alone clear spares the run of `point`.
    """
    return [
        *(["double root[1];"] if count == 1 else []),
        "teg_isolation search;",
        f"teg_isolate(&search, {lo}, {hi}, root, {count});",
        "while (search.asks != TEG_DONE) {",
        *indent(
            "if (search.asks == TEG_BOX) {",
            *indent(
                *_used(enclosure, left="search.box.from", right="search.box.to"),
                *enclosure,
                "if (teg_is_clear(&search.box, f + 2)) {",
                *indent("teg_next_box(&search);", "continue;"),
                "}",
            ),
            "}",
            *_used(point, x="search.at"),
            *point,
            "teg_answer(&search, f);",
        ),
        "}",
        "teg_roots(&search);",
        *(["return root[0];"] if count == 1 else []),
    ]


def location(enclosure: Sequence[str], v: tuple[str, str], u: tuple[str, str], count: int) -> list[str]:
    """Write the places between the ends of v to `place`: `enclosure` writes bounds of f and g over a rectangle to `f`."""
    sides = {side: f"search.here.{side}" for side in ("left", "right", "bottom", "top")}
    return [
        *(["double place[1];"] if count == 1 else []),
        "teg_location search;",
        f"teg_locate(&search, {', '.join((*v, *u))});",
        "while (teg_next_rectangle(&search)) {",
        *indent(*_used(enclosure, **sides), *enclosure, "teg_judge(&search, f);"),
        "}",
        f"teg_places(&search, place, {count});",
        *(["return place[0];"] if count == 1 else []),
    ]


def _used(lines: Sequence[str], **variables: str) -> list[str]:
    """Declarations of the variables that are in these lines."""
    text = "\n".join(lines)
    return [f"const double {name} = {value};" for name, value in variables.items() if re.search(rf"\b{name}\b", text)]


def sum_over(block: Sequence[str], points: int, count: int) -> list[str]:
    """Add the values at each finite one of `points` to `sum`; `block` writes the values at x to `f`."""
    nan = "return NAN;" if count == 1 else f"{{ teg_fill(sum, {count}, NAN); return; }}"
    return [
        f"for (int i = 0; i < {points}; i++) if (isnan(points[i])) {nan}",
        "double sum[1] = {0.0};" if count == 1 else f"teg_fill(sum, {count}, 0.0);",
        f"for (int i = 0; i < {points}; i++) {{",
        *indent(
            "const double x = points[i];",
            "if (!isfinite(x)) continue;",
            *block,
            each(count, "sum[j] += f[j];"),
        ),
        "}",
        *(["return sum[0];"] if count == 1 else []),
    ]


def gauss_table(nodes: int) -> str:
    """Nodes and weights of n-point Gauss-Legendre, as an array of C."""
    rows = [f"    {{{node!r}, {weight!r}}}," for node, weight in zip(*gauss_legendre(nodes), strict=True)]
    kind = "static const struct {\n    double node, weight;\n}"
    return "\n".join([f"{kind} teg_gauss_{nodes}[{nodes}] = {{", *rows, "};"])
