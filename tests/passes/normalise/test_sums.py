"""Sums in integrals move out of them."""

from __future__ import annotations

import numpy as np
import pytest

import teg

x = teg.var("x")
t, a = teg.params("t a")
V = teg.array("V", 1)
k = teg.index("k")
STEPS = teg.sum(teg.bracket(x < V[k]), (k, 0, teg.length(V, 0)))
NUMBERS = np.array([0.25, 0.5, 0.875])


@pytest.mark.parametrize(
    ("integrand", "expected"),
    [
        (STEPS, NUMBERS.sum()),
        (x * (a + t * STEPS), 0.5 * (2.0 + 3.0 * (NUMBERS**2).sum())),
        (t * (x * STEPS + a) * x, 3.0 * ((NUMBERS**3).sum() / 3.0 + 1.0)),
        (teg.where(a < t, x * STEPS, 7.0) * t, 1.5 * (NUMBERS**2).sum()),
        (teg.where(t < a, 7.0, x * STEPS) * t, 1.5 * (NUMBERS**2).sum()),
    ],
    ids=["alone", "factors around", "factors on both sides", "in a branch", "in the other branch"],
)
def test_value(integrand: teg.Expr, expected: float) -> None:
    assert teg.evaluate(teg.integral(integrand, (x, 0, 1)), {t: 3.0, a: 2.0, V: NUMBERS}) == pytest.approx(expected, rel=1e-14)


def test_a_sum_that_is_as_long_as_the_index_of_another_one() -> None:
    j, ends = teg.index("j"), teg.indices("ends", 1)
    triangle = teg.sum(teg.bracket(x > V[j]), (j, 0, k))
    ragged = teg.sum(teg.where(x < V[k], triangle, 1), (k, 0, teg.length(ends, 0))) ** 2
    found = teg.evaluate(teg.integral(ragged, (x, 0, 1)), {V: NUMBERS, ends: np.array([0, 1])})
    assert found == pytest.approx(3.0, rel=1e-14)  # 0 below ¼, 2² above


def test_an_error_shows_indices_as_they_were_written() -> None:
    j = teg.index("j")
    long = teg.sum(teg.where(x < V[k], teg.sum(teg.bracket(x > V[j]), (j, 0, 30_000)), 1), (k, 0, 2)) ** 2
    with pytest.raises(teg.errors.ArrayIndexError) as raised:
        teg.evaluate(teg.integral(long, (x, 0, 1)), {V: NUMBERS})
    assert "Σ[j: 0..30000] [V[j] < x]" in str(raised.value)
