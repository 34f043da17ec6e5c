"""Narrow densities beside surfaces that move: values and derivatives against closed forms."""

from __future__ import annotations

import math

import pytest

import teg

x, y = teg.vars("x y")
m, s, k, a = teg.params("m s k a")
BACKENDS = ["numpy", "c", "jax"]
DENSITY = teg.exp(-((x - m) ** 2) / (2 * s * s)) / (s * math.sqrt(2 * math.pi))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ends", [(-1.0, 2.0), (-math.inf, math.inf)], ids=str)
def test_a_density_that_a_line_divides(backend: str, ends: tuple[float, float], x64_for_jax: None) -> None:
    """The probability of x + a·y < k is 1 below y = (k - m)/a and 0 above, but for a layer that no node of the whole range sees."""
    f = teg.compile(teg.integral(teg.bracket(x + a * y < k) * DENSITY, (x, *ends), (y, 0, 1)), [m, s, k, a], backend=backend)
    for width in (1e-2, 1e-3, 1e-5, 3.2e-6, 1e-6):
        value, gradient = f.value_and_grad(m=0.1, s=width, k=0.5, a=0.7)
        lost = 1e-12 + 1e-17 / width
        assert value == pytest.approx(0.4 / 0.7, abs=lost)
        assert gradient["m"] == pytest.approx(-1 / 0.7, rel=10 * lost)
        assert gradient["k"] == pytest.approx(1 / 0.7, rel=10 * lost)
        assert gradient["a"] == pytest.approx(-0.4 / 0.49, rel=10 * lost)
        assert abs(gradient["s"]) < 1e-12 + 1e-14 / width


def test_the_place_of_a_density_that_a_line_divides() -> None:
    f = teg.compile(teg.integral(teg.bracket(x + 0.7 * y < 0.5) * DENSITY, (x, -1, 2), (y, 0, 1)), [m], backend="numpy")
    value, gradient = f.value_and_grad(m=0.1, s=1e-5)
    assert value == pytest.approx(0.4 / 0.7, abs=1e-12)
    assert gradient["m"] == pytest.approx(-1 / 0.7, abs=1e-11)


@pytest.mark.parametrize("width", [1e-4, 1e-6])
def test_derivatives_of_an_expectation_by_place_and_width(width: float) -> None:
    """All of a density lies inside: the mean of x is m, and the terms of size 1/s cancel."""
    f = teg.compile(teg.integral(DENSITY * x, (x, -1, 2)), [m, s])
    gradient = f.grad(m=0.7, s=width)
    assert gradient["m"] == pytest.approx(1.0, rel=1e-14)
    assert gradient["s"] == pytest.approx(0.0, abs=1e-15 / width)
