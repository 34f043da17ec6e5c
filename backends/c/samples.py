"""The loop over samples in C, and the table of Sobol' direction numbers."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.text import each, identifiers, indent, packed
from teg.numerics.sobol import BITS, replicated, reversed_directions
from teg.program import Sample


def used_points(block: Sequence[str], names: Sequence[str]) -> list[int]:
    """Returns the coordinates that the lines of a body use; `names` are their names there."""
    used = identifiers("\n".join(block))
    return [d for d, name in enumerate(names) if name in used]


def sample_loop(stmt: Sample, block: Sequence[str], names: Sequence[str], counted: bool, stop: str) -> list[str]:
    """Write the means of the values to `mean`, and their standard errors behind them; `block` writes the values at a point to `f`.

    `part` holds the sums of a replicate; of what has an error, `all` the mean of every replicate, the first value, and the sum of squares
    relative to it. `stop`, run once for every block of points, leaves the routine if the call was stopped.
    """
    replicates, points = replicated(stmt.kind, stmt.count)
    values, tested, scrambled = len(stmt.values), len(stmt.estimates), stmt.kind == "qmc"
    used = used_points(block, names)
    one = values + tested == 1
    keys = [f"const uint64_t key{d} = teg_key(UINT64_C({stmt.seed % 2**64}), {'r' if scrambled else '0'}, {d});" for d in used]
    inside = [*block, each(values, "part[j] += f[j];")]
    if tested:
        inside.append(f"teg_squares({tested}, {'i + k' if scrambled else 'i'} == 0, f, all{f' + {3 * tested} * r' if scrambled else ''});")
    n = f"{float(points)!r}"
    counts = [f"ctx->evaluations += {replicates * points};"] if counted else []
    if not scrambled:
        return [
            *counts,
            *keys,
            f"teg_fill(part, {values}, 0.0);",
            f"for (uint64_t i = 0; i < {points}; i++) {{",
            *indent(f"if (i % TEG_BLOCK == 0) {stop}", *(f"const double {names[d]} = teg_random(key{d}, i);" for d in used), *inside),
            "}",
            f"return part[0] / {n};" if one else each(values, f"mean[j] = part[j] / {n};"),
            *([each(tested, "all[j] = mean[j];"), f"teg_standard_errors({tested}, 1, {n}, all, mean, mean + {values});"] if tested else []),
        ]
    return [
        *counts,
        *(f"uint32_t first{d}[TEG_BLOCK];" for d in used),
        *(f"double at{d}[TEG_BLOCK];" for d in used),
        *(f"teg_first_block(first{d}, teg_sobol + {d * BITS});" for d in used),
        "double mean[1] = {0.0};" if one else f"teg_fill(mean, {values}, 0.0);",
        f"for (int r = 0; r < {replicates}; r++) {{",
        *indent(
            *keys,
            *(f"uint32_t block{d} = 0;" for d in used),
            f"teg_fill(part, {values}, 0.0);",
            f"for (uint64_t i = 0; i < {points}; i += TEG_BLOCK) {{",
            *indent(
                stop,
                f"const int size = {points} - i < TEG_BLOCK ? (int)({points} - i) : TEG_BLOCK;",
                *(f"teg_coordinates(at{d}, size, key{d}, block{d}, first{d});" for d in used),
                "for (int k = 0; k < size; k++) {",
                *indent(*(f"const double {names[d]} = at{d}[k];" for d in used), *inside),
                "}",
                *(f"block{d} = teg_next_block(block{d}, i, teg_sobol + {d * BITS});" for d in used),
            ),
            "}",
            each(values, f"mean[j] += part[j] / {n};"),
            *([f"for (int j = 0; j < {tested}; j++) all[{3 * tested} * r + j] = part[j] / {n};"] if tested else []),
        ),
        "}",
        f"return mean[0] / {replicates}.0;" if one else each(values, f"mean[j] /= {replicates}.0;"),
        *([f"teg_standard_errors({tested}, {replicates}, {n}, all, mean, mean + {values});"] if tested else []),
    ]


def sobol_table(dimensions: int) -> str:
    """Returns the direction numbers of so many dimensions, bits in reverse, one dimension after the other, as an array of C. A 0 at the end
    is what leads beyond the last point that has a number."""
    numbers = [f"0x{v:08X}u," for d in range(dimensions) for v in reversed_directions(d)]
    return "\n".join([f"static const uint32_t teg_sobol[{dimensions * BITS + 1}] = {{", *packed([*numbers, "0u,"], "    "), "};"])
