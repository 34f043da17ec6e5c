"""Integrals in functions of integrals: what moves with each of them, and the digits of small ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

import teg
from tests.end_to_end.test_past_digits import gradient_of

pytestmark = pytest.mark.usefixtures("x64_for_jax")

B, INT = teg.bracket, teg.integral
x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_integral_beside_a_surface_over_a_variable_of_the_same_name(backend: str) -> None:
    """Two inner integrals over y: the points of one moved with the surface of the other. A second derivative was 0.29 in place of 1.29."""
    inner = INT(B((y + 0.1) * (1 + x * x) < x + t), (y, 0, 1))  # (x + t)/(1 + x²) - 0.1
    squared = teg.compile(INT(inner**2, (x, 0, 1)), [t], backend=backend)  # type: ignore[arg-type]
    assert squared.hessian(t=0.3)["t", "t"] == pytest.approx(0.5 + math.pi / 4, rel=1e-9)

    weight = mpmath.mpf("0.7")
    density = teg.exp(INT(teg.exp(0.7 * x * y), (y, 0, 1)))
    product = teg.compile(INT(density * inner**2, (x, 0, 1)), [t], backend=backend)  # type: ignore[arg-type]
    exact = mpmath.quad(lambda v: mpmath.exp(mpmath.expm1(weight * v) / (weight * v)) * 2 / (1 + v * v) ** 2, [0, 1])
    assert product.hessian(t=0.3)["t", "t"] == pytest.approx(float(exact), rel=1e-9)


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
def test_an_integral_beside_a_singularity_over_a_variable_of_the_same_name(backend: str) -> None:
    """Two inner integrals over y: the points of one moved with the singularity of the other, and the gradient was wrong by a half."""
    density = teg.exp(INT(teg.exp(0.7 * x * y), (y, 0, 1)))
    e = INT(density * INT(teg.sqrt(abs(y - t * x)), (y, 0, 1)), (x, 0, 1))

    def slope(v: mpmath.mpf) -> mpmath.mpf:
        return mpmath.exp(mpmath.expm1(0.7 * v) / (0.7 * v)) * v * (mpmath.sqrt(0.3 * v) - mpmath.sqrt(1 - 0.3 * v))

    assert gradient_of(e, {"t": 0.3}, backend)["t"] == pytest.approx(float(mpmath.quad(slope, [0, 1])), rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_second_derivatives_where_two_conditions_are_solved_for_variables_of_their_own(backend: str) -> None:
    """They were refused where the other variable had no formula: y < (x + t)/eˣ, whose inner integral stands in a function."""
    inner = INT(B(y < (x + t) * teg.exp(-x)), (y, 0, 1))  # it reaches 1 nowhere, and 0 at x = -t
    f = teg.compile(INT(teg.exp(inner), (x, -1, 1)), [t], backend=backend)  # type: ignore[arg-type]
    exact = mpmath.quad(lambda v: mpmath.exp((v + 0.3) * mpmath.exp(-v) - 2 * v), [-0.3, 1]) + mpmath.exp(0.3)
    assert f.hessian(t=0.3)["t", "t"] == pytest.approx(float(exact), rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_moment_of_half_an_ellipse(backend: str) -> None:
    """∫∫ x² over 0 < x < b·√(1 - y²/a²) is π·a·b³/8. The root at the bound y = a is 0 identically, but was not written so: NaN."""
    moment = INT(x * x, (x, 0, b * teg.sqrt(1 - y * y / a**2)), (y, -a, a))
    f = teg.compile(moment, [a, b], backend=backend)  # type: ignore[arg-type]
    second = f.hessian(a=0.4, b=2.0)
    assert second["a", "a"] == pytest.approx(0.0, abs=1e-9)
    assert second["a", "b"] == pytest.approx(math.pi * 12 / 8, rel=1e-9)
    assert second["b", "b"] == pytest.approx(math.pi * 0.4 * 12 / 8, rel=1e-9)


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
def test_the_root_of_a_chord(backend: str) -> None:
    """∫√(2√(t - y²)) dy is √2·B(½, 5/4)·t^¾. Where the chord ends its derivative goes with φ^-½ in the angle φ around the disk, and a break
    1e-31 beside 0 made the gradient wrong by 2 %, with a warning."""
    chord = INT(B(x * x + y * y < t), (x, -2, 2))
    size = float(math.sqrt(2) * mpmath.beta(0.5, 1.25))
    slope = gradient_of(INT(teg.sqrt(chord), (y, -2, 2)), {"t": 0.7}, backend)["t"]
    assert slope == pytest.approx(0.75 * size * 0.7**-0.25, rel=1e-11)


def mean_and_slope(likelihood: Callable[[mpmath.mpf], mpmath.mpf], score: Callable[[mpmath.mpf], mpmath.mpf]) -> tuple[float, float]:
    """E[v] under a density on (0, 2) without its norm, and its slope, the covariance of v and the score."""
    places = [mpmath.mpf(k) / 20 for k in range(41)]

    def expected(f: Callable[[mpmath.mpf], mpmath.mpf]) -> mpmath.mpf:
        return mpmath.quad(lambda v: f(v) * likelihood(v), places) / mpmath.quad(likelihood, places)

    mean = expected(lambda v: v)
    return float(mean), float(expected(lambda v: v * score(v)) - mean * expected(score))


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
@pytest.mark.parametrize("evidence", [30.0, 300.0])
def test_a_posterior_mean_with_a_small_likelihood(evidence: float, backend: str) -> None:
    """Integrals of e⁻³⁰ were below the absolute floor of the tolerance: the slope of their quotient was off by 4 %, without a warning."""
    density = teg.exp(-50 * (teg.sin(3 * x) - t) ** 2 - evidence)
    e = INT(x * density, (x, 0, 2)) / INT(density, (x, 0, 2))
    mean, slope = mean_and_slope(
        lambda v: mpmath.exp(-50 * (mpmath.sin(3 * v) - mpmath.mpf("0.4")) ** 2), lambda v: 100 * (mpmath.sin(3 * v) - mpmath.mpf("0.4"))
    )
    if backend != "interpreter":
        assert teg.compile(e, backend=backend)(t=0.4) == pytest.approx(mean, rel=1e-9)  # type: ignore[arg-type]
    assert gradient_of(e, {"t": 0.4}, backend)["t"] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("backend", ["interpreter", *BACKENDS])
def test_the_logarithm_of_a_small_integral(backend: str) -> None:
    """log ∫∫ [x > t]·exp(-20x²)·sin²(x)·exp(sin y): the value was off by 1, its slope by a factor of 3."""
    body = B(x > t) * teg.exp(-20 * x * x) * teg.sin(x) ** 2 * teg.exp(teg.sin(y))
    e = teg.log(INT(body, (x, 0, 4), (y, 0, 1)))
    places = [2 + mpmath.mpf(k) / 40 for k in range(21)] + [3, 4]
    tail = mpmath.quad(lambda v: mpmath.exp(-20 * v * v) * mpmath.sin(v) ** 2, places)
    if backend != "interpreter":
        whole = tail * mpmath.quad(lambda v: mpmath.exp(mpmath.sin(v)), [0, 1])
        assert teg.compile(e, backend=backend)(t=2.0) == pytest.approx(float(mpmath.log(whole)), rel=1e-10)  # type: ignore[arg-type]
    slope = -mpmath.exp(-80) * mpmath.sin(2) ** 2 / tail
    assert gradient_of(e, {"t": 2.0}, backend)["t"] == pytest.approx(float(slope), rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_logarithm_of_a_sum_of_small_integrals(backend: str) -> None:
    """log Σₖ ∫ exp(-50·(sin 3x - t - Sₖ)² - 30) dx over (0, 2), as of a mixture: the value was off by 3e-9, and its calls did not agree."""
    k, shifts = teg.index("k"), teg.array("S")
    terms = INT(teg.exp(-50 * (teg.sin(3 * x) - t - shifts[k]) ** 2 - 30), (x, 0, 2))
    f = teg.compile(teg.log(teg.sum(terms, (k, 0, teg.length(shifts)))), [t], backend=backend)  # type: ignore[arg-type]
    places = [mpmath.mpf(j) / 20 for j in range(41)]
    where = [mpmath.mpf(s) for s in ("0.5", "0.2", "0.45")]  # t + Sₖ
    sums = [mpmath.quad(lambda v, s=s: mpmath.exp(-50 * (mpmath.sin(3 * v) - s) ** 2), places) for s in where]
    at = {"t": 0.4, "S": np.array([0.1, -0.2, 0.05])}
    assert f(at) == pytest.approx(float(mpmath.log(sum(sums))) - 30, abs=1e-9)
    assert f.value_and_grad(at)[0] == pytest.approx(f(at), abs=1e-10)
