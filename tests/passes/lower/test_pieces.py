"""Pieces: features that are narrower than the rounding of places are integrated in closed form, or told of."""

from __future__ import annotations

import math
import warnings

import mpmath
import pytest

import teg
from teg.ir.expr import Expr

x, y = teg.vars("x y")
t, k = teg.params("t k")
LINE = (x, -math.inf, math.inf)
UNIT = (x, 0.0, 1.0)
CAUCHY = k / (1 + (k * (x - t)) ** 2)
GAUSS = k * teg.exp(-((k * (x - t)) ** 2))
SECH = k / teg.cosh(k * (x - t))
ROOT_PI = math.sqrt(math.pi)
BACKENDS = ("c", "numpy")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("width", [1e-150, 1e-25, 1e-17, 1e-3, 1.0, 1e130])
def test_gaussians_are_right_however_narrow(width: float, backend: str) -> None:
    for ranges, expected in ((LINE, ROOT_PI), ((x, t, math.inf), ROOT_PI / 2)):
        f = teg.compile(teg.integral(GAUSS, ranges), [], backend=backend)
        value, error = f.value_and_error(t=0.3, k=1 / width)
        assert f(t=0.3, k=1 / width) == pytest.approx(expected, rel=1e-13)
        assert abs(value - expected) <= error <= 1e-11


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("program", "steepness"),
    [
        (teg.integral(e, r), steep)
        for e in (CAUCHY, CAUCHY**2, SECH, k / (1 + (k * (x - t)) ** 2) ** 1.5)
        for r in (LINE, UNIT)
        for steep in (1e20, 1e160, 1e300)
    ]
    + [(teg.integral(teg.cos(x) * GAUSS, r), steep) for r in (LINE, UNIT) for steep in (1e18, 1e25, 1e140)]
    + [(teg.integral(GAUSS, LINE), 1e-150), (teg.integral(t / (t * t / k + k * (x - 1) ** 2), LINE), 1e160)],
)
def test_features_that_places_cannot_tell_apart_warn(program: Expr, steepness: float, backend: str) -> None:
    f = teg.compile(program, [], backend=backend)
    with pytest.warns(teg.AccuracyWarning):
        f(t=0.3, k=steepness)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("steepness", [1e6, 1e8, 1e10])
@pytest.mark.parametrize(("e", "over_line"), [(CAUCHY, mpmath.pi), (SECH, mpmath.pi)])
def test_estimates_hold_the_rounding_of_places(e: Expr, over_line: object, steepness: float, backend: str) -> None:
    for place in (0.3, 1.1, 777.7):
        f = teg.compile(teg.integral(e, LINE), [], backend=backend)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", teg.AccuracyWarning)
            value, error = f.value_and_error(t=place, k=steepness)
        assert abs(value - float(over_line)) <= error  # type: ignore[arg-type]


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_width_of_a_double_root_is_not_its_rounding(backend: str) -> None:
    """Tails are as long as the scale k of (1 + x/k)^-t, whatever rounding makes of the square that is 0 at x = -k: its derivative by k."""
    power = teg.compile(teg.integral((1 + x / k) ** (-t), (x, 0, math.inf)), [t, k], backend=backend)
    lomax = teg.compile(teg.integral(x * (1 + x / k) ** (-t - 1) * teg.bracket(x > 1.5), (x, 0, math.inf)), [t, k], backend=backend)
    for scale in (0.1, 0.15, 0.2, 0.21, 0.22, 0.4, 0.45, 1.0, 3.0, 1000.0):
        assert power.grad(t=3.0, k=scale)["k"] == pytest.approx(0.5, rel=1e-8)  # of k/(t - 1)
        u = 1 + 1.5 / scale  # k²·(u^(1 - t)/(t - 1) - u^-t/t) = k²·(½u⁻² - ⅓u⁻³)
        by_scale = 2 * scale * (u**-2 / 2 - u**-3 / 3) + 1.5 * (u**-3 - u**-4)
        assert lomax.grad(t=3.0, k=scale)["k"] == pytest.approx(by_scale, rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_conditions_that_are_no_numbers_where_a_gaussian_is_0(backend: str) -> None:
    """exp(a·x) > c·exp(x/5) holds from x = log(c)/(a - 1/5) on; far away both sides are infinite, or 0."""
    a, c = teg.params("a c")
    density = teg.exp(-x * x / 2) / math.sqrt(2 * math.pi)
    above = teg.exp(a * x) > c * teg.exp(x / 5)
    f = teg.compile(teg.integral(teg.bracket(above) * density, LINE), [a, c], backend=backend)
    g = teg.compile(teg.integral(teg.bracket(above) * density, (x, -1.5, math.inf)), backend=backend)
    for rising, factor in ((0.3, 0.9), (0.7, 2.0), (-0.3, 0.9)):
        apart = rising - 0.2
        at = math.log(factor) / apart
        upper = [float(mpmath.ncdf(-v)) for v in (at, max(at, -1.5))]
        assert f(a=rising, c=factor) == pytest.approx(upper[0] if apart > 0 else 1 - upper[0], abs=1e-14)
        if apart > 0:
            assert g(a=rising, c=factor) == pytest.approx(upper[1], abs=1e-14)


@pytest.mark.parametrize("backend", BACKENDS)
def test_which_of_two_gaussians_is_higher(backend: str) -> None:
    """Far away both are 0 to the last bit, and so is their difference; between are the two roots of a quadratic."""
    a, m, s = teg.params("a m s")
    normal = teg.exp(-x * x / 2) / math.sqrt(2 * math.pi)
    other = teg.exp(-(((x - m) / s) ** 2) / 2) / (s * math.sqrt(2 * math.pi))
    f = teg.compile(teg.integral(teg.bracket(a * normal > (1 - a) * other) * normal, LINE), [a, m], backend=backend)

    def outside(a: mpmath.mpf, m: mpmath.mpf) -> mpmath.mpf:
        ratio = 2 * mpmath.log((1 - a) / (a * mpmath.mpf("0.75")))
        low, high = mpmath.polyroots(
            [1 / mpmath.mpf("0.75") ** 2 - 1, -2 * m / mpmath.mpf("0.75") ** 2, (m / mpmath.mpf("0.75")) ** 2 - ratio]
        )
        return 1 - mpmath.ncdf(high) + mpmath.ncdf(low)

    value, gradient = f.value_and_grad(a=0.625, m=1.5, s=0.75)
    assert value == pytest.approx(float(outside(mpmath.mpf(0.625), mpmath.mpf(1.5))), rel=1e-12)
    assert gradient["a"] == pytest.approx(float(mpmath.diff(outside, (0.625, 1.5), (1, 0))), rel=1e-7)
    assert gradient["m"] == pytest.approx(float(mpmath.diff(outside, (0.625, 1.5), (0, 1))), rel=1e-7)
