"""Branches that are continuous, as absolute values: a surface with many kinks stays one surface."""

from __future__ import annotations

import pytest

import teg

x, y = teg.vars("x y")
t, p = teg.params("t p")


def test_many_minima_and_maxima_in_one_condition() -> None:
    """Below x = t - Σ min(y, pₖ)/2 + Σ max(y, pₖ)/4 stands the integral of that over y: ∫min = p - p²/2 and ∫max = (1 + p²)/2."""
    places = (p, 0.5, 0.8)
    border = t - sum(teg.minimum(y, q) for q in places) / 2 + sum(teg.maximum(y, q) for q in places) / 4
    f = teg.compile(teg.integral(teg.bracket(x < border), (x, -2, 2), (y, 0, 1)), backend="numpy")
    numbers = (0.3, 0.5, 0.8)
    value, gradient = f.value_and_grad(t=0.4, p=0.3)
    exact = 2.4 - sum(q - q * q / 2 for q in numbers) / 2 + sum((1 + q * q) / 2 for q in numbers) / 4
    assert value == pytest.approx(exact, rel=1e-12)
    assert gradient["t"] == pytest.approx(1.0, rel=1e-12)
    assert gradient["p"] == pytest.approx(-(1 - 0.3) / 2 + 0.3 / 4, rel=1e-12)
