"""Second derivatives by differences of the gradient."""

from __future__ import annotations

import teg


def second_differences(f: teg.Evaluator, at: dict[str, float], h: float = 1e-4) -> dict[tuple[str, str], float]:
    """Central differences of order 4 of the gradient."""
    found = {}
    for i in at:
        shifted = {s: f.grad({**at, i: at[i] + s * h}) for s in (-2, -1, 1, 2)}
        for j in at:
            found[i, j] = (8 * (shifted[1][j] - shifted[-1][j]) - (shifted[2][j] - shifted[-2][j])) / (12 * h)
    return found
