"""Integrals of rational functions with one pole, in C: `Rational` of `teg.program`."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.quadrature import Sums
from teg.backends.c.text import indent, wrapped
from teg.numerics.quadrature import gauss_legendre, null_rules, pole_table
from teg.program import Rational

CHAINS = 4
"""Into how many sums a series is split, which are computed side by side."""


def rational_piece(block: Sequence[str], rule: Rational, bend: tuple[str, Sequence[str]], base: str, sums: Sums) -> list[str]:
    """Add a rule over (p, q) to `sum`, and behind it the estimates of the tested values; `block` writes the values at x to `f`. The bend is
    given by how its `when` and its coefficients are spelled. Where the pole is on the piece, `sizes` holds for each value the sum, the
    first null rule, and the sum of sizes."""
    n, count, (when, (constant, rate, _)) = rule.nodes, sums.count, bend
    estimated = sums.tested if sums.estimated else 0
    loss = [f"const double rounding = teg_rounding(p, q) + teg_pole_loss({rule.power}, &pole);"] if estimated else []
    return [
        "const double middle = 0.5 * (p + q), half = 0.5 * (q - p);",
        f"const teg_pole pole = teg_pole_at({when}, p, q, {base}, {constant}, {rate});",
        f"double weights[{n}];",
        f"if (pole.kind == TEG_CLEAR) teg_weights_{n}_{rule.power}(pole.low, pole.high, weights);",
        f"else for (int k = 0; k < {n}; k++) weights[k] = teg_plain_{n}[k].weight;",
        f"if (pole.kind == TEG_MET) teg_fill(sizes, {3 * count}, 0.0);",
        *loss,
        *([f"ctx->evaluations += {n};"] if sums.counted else []),
        f"for (int k = 0; k < {n}; k++) {{",
        *indent(
            "const double weight = half * weights[k];",
            f"x = middle + half * teg_plain_{n}[k].node;",
            *block,
            f"for (int j = 0; j < {count}; j++) sum[j] += weight * f[j];",
            *([f"for (int j = 0; j < {estimated}; j++) sum[{count} + j] += rounding * fabs(weight * f[j]);"] if estimated else []),
            f"if (pole.kind == TEG_MET) teg_meet({count}, f, weight, half * teg_plain_{n}[k].null, sizes);",
        ),
        "}",
        f"if (pole.kind == TEG_MET && teg_is_endless({count}, sizes, sum)) ctx->missed = 1;",
    ]


def plain_table(nodes: int) -> str:
    """Returns nodes and weights of n-point Gauss-Legendre and the weights of the first null rule, as an array of C."""
    at, weights = gauss_legendre(nodes)
    rows = [f"    {{{x!r}, {w!r}, {e!r}}}," for x, w, e in zip(at, weights, null_rules(nodes)[0], strict=True)]
    return "\n".join([f"static const struct {{\n    double node, weight, null;\n}} teg_plain_{nodes}[{nodes}] = {{", *rows, "};"])


def weights_function(nodes: int, power: int) -> str:
    """Returns the function of the weights of n Gauss nodes for polynomials over the power of a function that goes from low to high."""
    table, at = pole_table(nodes, power), gauss_legendre(nodes)[0]
    top = nodes - 1
    levels = range(1, power + 1) if top else (power,)  # a single moment does not need those of lower powers

    def moment(level: int, j: int) -> str:
        return f"m{level}[{j}]" if level else repr(2.0 / (j + 1) if j % 2 == 0 else 0.0)

    near, far = [], ["const double r = 1.0 / z;"]
    rows = len(table.series[0]) // CHAINS
    for level in levels:
        near += [
            f"double s{level}[{CHAINS}];",
            f"for (int i = 0; i < {CHAINS}; i++) s{level}[i] = teg_series_{nodes}_{power}[{level - 1}][{rows - 1}][i];",
            f"for (int k = {rows - 2}; k >= 0; k--)",
            f"    for (int i = 0; i < {CHAINS}; i++)",
            f"        s{level}[i] = s{level}[i] * eighth + teg_series_{nodes}_{power}[{level - 1}][k][i];",
            f"m{level}[{top}] = {'-z * ' if top % 2 else ''}((s{level}[0] + s{level}[1] * square)",
            f"    + fourth * (s{level}[2] + s{level}[3] * square));",
        ]
        near += [f"m{level}[{j}] = {moment(level - 1, j)} - z * m{level}[{j + 1}];" for j in range(top - 1, -1, -1)]
        k = level - 1
        if k == 0:
            far.append(f"m{level}[0] = log(high / low) * r;")
        else:
            below, above = (" * ".join([f"(middle / {end})"] * k) for end in ("low", "high"))
            far.append(f"m{level}[0] = ({below} - {above}) * r{f' / {float(k)!r}' if k > 1 else ''};")
        far += [f"m{level}[{j + 1}] = ({moment(level - 1, j)} - m{level}[{j}]) * r;" for j in range(top)]
    weights = []
    for k, (row, u) in enumerate(zip(table.lagrange, at, strict=True)):
        terms = " + ".join(f"{c!r} * m{power}[{j}]" for j, c in enumerate(row) if c)
        factor = " * ".join([f"(1.0 + z * {u!r})"] * power) if u else "1.0"
        weights.append(f"weights[{k}] = ({terms}) * ({factor});")
    series = []
    for one in table.series:
        parts = [", ".join(map(repr, one[CHAINS * k : CHAINS * (k + 1)])) for k in range(rows)]
        series += ["{", *indent(*(f"{{{part}}}," for part in parts)), "},"]
    lines = [
        f"static const double teg_series_{nodes}_{power}[{power}][{rows}][{CHAINS}] = {{",
        *indent(*series),
        "};",
        "",
        f"static inline void teg_weights_{nodes}_{power}(double low, double high, double *weights)",
        "{",
        *indent(
            "const double middle = 0.5 * (high + low), z = 0.5 * (high - low) / middle;",
            "const double square = z * z, fourth = square * square, eighth = fourth * fourth;",
            "double " + ", ".join(f"m{level}[{nodes}]" for level in levels) + ";",
            f"if (fabs(z) < {table.border!r}) {{",
            *indent(*near),
            "} else {",
            *indent(*far),
            "}",
            *weights,
        ),
        "}",
    ]
    return wrapped(lines)
