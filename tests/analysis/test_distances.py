"""Where a line meets the border between two distances and a number, against bisection."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import teg
from teg.analysis.distances import equal_distances

x = teg.var("x")
a, h, b, i, c = teg.params("a h b i c")
G = teg.sqrt((x - a) ** 2 + h**2) - teg.sqrt((x - b) ** 2 + i**2) + c


def _length_above(values: dict[str, float], factor: float) -> float:
    """How much of (-3, 3) has a positive function, by bisection of its changes of sign among many places."""

    def g(at: np.ndarray) -> np.ndarray:
        return factor * (np.hypot(at - values["a"], values["h"]) - np.hypot(at - values["b"], values["i"]) + values["c"])

    at = np.linspace(-3, 3, 20_001)
    signs = g(at) > 0
    cuts = [-3.0]
    for n in np.flatnonzero(signs[1:] != signs[:-1]):
        low, high = at[n], at[n + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if (g(middle) > 0) == signs[n] else (low, middle)
        cuts.append(low)
    cuts.append(3.0)
    return sum(q - p for p, q in itertools.pairwise(cuts) if g(np.array(0.5 * (p + q))) > 0)


@pytest.mark.parametrize("factor", [1.0, -2.0])
@pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
def test_lengths_beside_bisection(backend: str, factor: float, x64_for_jax: None) -> None:
    f = teg.compile(teg.integral(teg.bracket(factor * G > 0), (x, -3, 3)), backend=backend)
    rng = np.random.default_rng(0)
    rows = [dict(zip("ahbic", rng.uniform(-1, 1, 5), strict=True)) for _ in range(40)]
    rows += [{**row, "c": float(shift)} for row in rows[:8] for shift in (0.0, 1e-15, -1e-9, 3.0, -3.0)]
    rows += [{**row, "h": 0.0} for row in rows[:5]] + [{**row, "h": 0.0, "i": 0.0} for row in rows[:5]]  # kinks in the range
    rows += [{**row, "b": row["a"]} for row in rows[:5]]
    for row in rows:
        assert f(**row) == pytest.approx(_length_above(row, factor), abs=1e-10), row


def test_as_exact_where_the_number_vanishes() -> None:
    """The derivative of the place by the number, where the number is 0: the squares have a double root there."""
    f = teg.compile(teg.integral(teg.bracket(G < 0), (x, -3, 3)), [a, c])
    value, gradient = f.value_and_grad(a=0.3, h=0.5, b=-0.7, i=0.5, c=0.0)
    assert value == pytest.approx(3.0 + 0.2, abs=1e-15) or value == pytest.approx(3.0 - (-0.2), abs=1e-15)
    rate = 0.5 / np.hypot(0.5, 0.5)
    assert gradient["c"] == pytest.approx(1 / (-2 * rate), rel=1e-13)


@pytest.mark.parametrize(
    "g",
    [
        teg.sqrt((x - a) ** 2 + h**2) + teg.sqrt((x - b) ** 2 + i**2) - c,  # a sum
        teg.sqrt((x - a) ** 2 + h**2) - teg.sqrt(2 * (x - b) ** 2 + i**2) + c,  # four roots
        teg.sqrt((x - a) ** 2 + h**2) - teg.sqrt((x - b) ** 2 + i**2) + c * x,
        teg.sqrt(a * x**2 + h**2) - teg.sqrt(a * x**2 + x + i**2) + c,  # it may be no distance
        teg.sqrt((x - a) ** 2 + h**2) - c,
    ],
    ids=str,
)
def test_other_functions(g: teg.Expr) -> None:
    assert equal_distances(g, x) is None
