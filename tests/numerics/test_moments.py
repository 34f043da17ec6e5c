"""Moments along a branch of a hyperbola: the integers of I_jk, and the series of G near 0, against their definitions."""

from __future__ import annotations

import mpmath
import pytest

from teg.numerics.moments import highest, moment, series


@pytest.mark.parametrize("top", range(6))
def test_the_series_is_that_of_the_integral(top: int) -> None:
    """G_top(z) = ∫₀¹ u^(2·top)/(1 - z²u²) du = Σ z²ⁿ/(2(top + n) + 1)."""
    known = series(top)
    z2 = 0.9 * known.border
    exact = mpmath.quad(lambda u: u ** (2 * top) / (1 - z2 * u * u), [0, 1])
    assert sum(c * z2**n for n, c in enumerate(known.coefficients)) == pytest.approx(float(exact), rel=1e-15)


@pytest.mark.parametrize(("j", "k"), [(0, 0), (1, 0), (0, 1), (2, 1), (1, 3), (3, 3)])
def test_moments_are_combinations_of_g(j: int, k: int) -> None:
    """I_jk = ∫ ξʲηᵏ dξ/(1 + zξ) over (-1, 1), with η = (ξ + z)/(1 + zξ)."""
    z = mpmath.mpf("0.4")
    exact = mpmath.quad(lambda s: s**j * ((s + z) / (1 + z * s)) ** k / (1 + z * s), [-1, 0, 1])
    g = [mpmath.quad(lambda t, q=q: t ** (2 * q) / (1 - z * z * t * t), [0, 1]) for q in range(len(moment(j, k)))]
    found = z ** ((j + k) % 2) * sum(a * b for a, b in zip(moment(j, k), g, strict=True))
    assert float(found) == pytest.approx(float(exact), rel=1e-13)


def test_the_highest_index_covers_moments_of_lower_powers() -> None:
    assert highest(frozenset({(0, 0)})) <= highest(frozenset({(0, 0), (2, 2)}))
