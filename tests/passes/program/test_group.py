"""Moments along a branch of a hyperbola: the combinations of G, and how G is computed, against integrals to 18 digits."""

from __future__ import annotations

import math

import mpmath
import pytest

from teg.numerics.moments import LEAST_BORDER, highest, moment, series


def g(q: int, z: mpmath.mpf) -> mpmath.mpf:
    """∫₀¹ t^(2q)/(1 - z²t²) dt."""
    return mpmath.hyp2f1(1, q + mpmath.mpf(1) / 2, q + mpmath.mpf(3) / 2, z * z) / (2 * q + 1)


@pytest.mark.parametrize("z", [0.0, -0.3, 0.7])
def test_moments_are_sums_of_few_numbers(z: float) -> None:
    with mpmath.workdps(18):
        at = mpmath.mpf(z)
        for j in range(4):
            for k in range(4):
                exact = mpmath.quad(lambda t, j=j, k=k: t**j * ((t + at) / (1 + at * t)) ** k / (1 + at * t), [-1, 0, 1])
                found = at ** ((j + k) % 2) * sum(a * g(q, at) for q, a in enumerate(moment(j, k)))
                assert abs(found - exact) < 1e-15 * max(1, abs(exact)), (j, k)


def test_moments_are_symmetric() -> None:
    for j in range(6):
        for k in range(6):
            assert moment(k, j) == tuple((-1) ** (j + k) * a for a in moment(j, k))


def test_the_moments_of_a_gradient_of_a_constant_take_two_numbers() -> None:
    assert highest(frozenset({(0, 0), (1, 0), (0, 1), (1, 1)})) == 1
    assert [highest(frozenset({(n, n)})) for n in range(4)] == [0, 1, 2, 3]
    assert highest(frozenset({(3, 0)})) == 2


@pytest.mark.parametrize("top", range(5))
def test_the_series_and_the_way_up_meet(top: int) -> None:
    border, coefficients = series(top)
    assert LEAST_BORDER <= border < 0.5
    for square in (0.0, 0.5 * border, border):
        exact = float(g(top, mpmath.sqrt(square)))
        assert math.fsum(a * square**n for n, a in enumerate(coefficients)) == pytest.approx(exact, rel=4e-16)
    up = math.atanh(math.sqrt(border)) / math.sqrt(border)
    for q in range(top):
        up = (up - 1 / (2 * q + 1)) / border
    assert up == pytest.approx(float(g(top, mpmath.sqrt(border))), rel=2e-14)
