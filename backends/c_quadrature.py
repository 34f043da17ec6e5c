"""The rules in C: a piece by Gauss-Legendre or by adaptive Gauss-Kronrod, and the tables of Gauss-Legendre."""

from __future__ import annotations

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


def gauss_table(nodes: int) -> str:
    """Nodes and weights of n-point Gauss-Legendre, as an array of C."""
    rows = [f"    {{{node!r}, {weight!r}}}," for node, weight in zip(*gauss_legendre(nodes), strict=True)]
    kind = "static const struct {\n    double node, weight;\n}"
    return "\n".join([f"{kind} teg_gauss_{nodes}[{nodes}] = {{", *rows, "};"])
