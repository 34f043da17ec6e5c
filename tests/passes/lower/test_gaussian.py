"""Narrow densities beside surfaces that move: values and derivatives against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import special

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


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_line_that_is_level_has_its_bell_nowhere(backend: str, x64_for_jax: None) -> None:
    """P(X + aY < k) = Φ((k - m)/√(s² + a²)) for two normal numbers; at a = 0 no y has the middle of X on the line."""
    normal = teg.exp(-((x - m) ** 2) / (2 * s * s) - y * y / 2) / (2 * s * math.pi)
    f = teg.compile(teg.integral(teg.bracket(x + a * y < k) * normal, (x, -math.inf, math.inf), (y, -math.inf, math.inf)), backend=backend)
    for width, tilted in ((1.0, 0.0), (1e-3, 0.0), (1e-3, -1e-9), (1e-6, 0.0), (1e-6, 0.7), (1e-3, 1e-300)):
        value, gradient = f.value_and_grad(m=0.3, s=width, k=0.5, a=tilted)
        deviation = math.hypot(width, tilted)
        at = 0.2 / deviation
        density = math.exp(-at * at / 2) / math.sqrt(2 * math.pi) / deviation
        assert value == pytest.approx(math.erfc(-at / math.sqrt(2)) / 2, rel=1e-12)
        assert gradient["m"] == pytest.approx(-density, rel=1e-9, abs=1e-15 / width)
        assert gradient["k"] == pytest.approx(density, rel=1e-9)
        assert gradient["s"] == pytest.approx(-density * at * width / deviation, rel=1e-4, abs=1e-15 / width)


def test_derivatives_by_the_width_do_not_cancel() -> None:
    """All that a density gains by its width it loses: the outer integral sees a layer, and not the rounding of 1/s² beside it."""
    f = teg.compile(teg.integral(teg.bracket(x + a * y < k) * DENSITY, (x, -math.inf, math.inf), (y, 0, 1)), [s], backend="numpy")
    gradient, errors = f.grad_and_error(m=0.1, s=1e-6, k=0.5, a=-0.7)
    assert gradient["s"] == 0.0
    assert errors["s"] == 0.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_exponential_that_a_line_divides(backend: str, x64_for_jax: None) -> None:
    """From m on; P(X + aY < k) over y is k' - s/a·(1 - e^(-(k - m)/s)) with k' = (k - m)/a. Nodes miss the layer of width s/a below k'. The
    root of the exponent is m - 100s, no end of the range."""
    exponential = teg.bracket(x > m) * math.exp(100) * teg.exp((m - 100 * s - x) / s) / s
    f = teg.compile(teg.integral(teg.bracket(x + a * y < k) * exponential, (x, 0, 1), (y, 0, 1)), [m, k], backend=backend)
    for width in (0.1, 1e-3, 1e-6):
        value, gradient = f.value_and_grad(m=0.3, s=width, k=0.5, a=0.7)
        left = math.exp(-0.2 / width)
        assert value == pytest.approx((0.2 - width * (1 - left)) / 0.7, rel=1e-12 + 1e-16 / width)
        assert gradient["m"] == pytest.approx(-(1 - left) / 0.7, rel=1e-8)
        assert gradient["k"] == pytest.approx((1 - left) / 0.7, rel=1e-8)


def test_a_sum_of_two_waiting_times() -> None:
    """P(X + Y > t) for exponential X, Y of the rates 1 and 1/s is (e⁻ᵗ - s·e^(-t/s))/(1 - s). On infinite ranges the layer of width s below
    x = t was missed: the value lacked its part s."""
    waiting = teg.integral(teg.exp(-y / s) / s * teg.bracket(x + y > k), (y, 0, math.inf))
    f = teg.compile(teg.integral(teg.exp(-x) * waiting, (x, 0, math.inf)), [k], backend="numpy")
    for width in (1e-3, 1e-4, 1e-6):
        assert f(s=width, k=9.0) == pytest.approx(math.exp(-9) / (1 - width), rel=1e-10)
        assert f.grad(s=width, k=9.0)["k"] == pytest.approx(-math.exp(-9) / (1 - width), rel=1e-8)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_an_exponential_from_a_surface_inwards(backend: str) -> None:
    """The same the other way round: it decays from the line, and the layer is where the line meets x = m."""
    inwards = teg.bracket((x + a * y < k) & (x > m)) * teg.exp((x + a * y - k) / s) / s
    f = teg.compile(teg.integral(inwards, (x, 0, 1), (y, 0, 1)), [k], backend=backend)
    value, gradient = f.value_and_grad(m=0.3, s=1e-4, k=0.5, a=0.7)
    assert value == pytest.approx((0.2 - 1e-4) / 0.7, rel=1e-12)
    assert gradient["k"] == pytest.approx(1 / 0.7, rel=1e-10)


@pytest.mark.parametrize("width", [0.1, 1e-2, 1e-3, 1e-5])
def test_a_step_that_a_line_divides(width: float) -> None:
    """∫ 1/(1 + e^(-(x - m)/s)) dx up to the line has a bend where the line meets the middle of the step; its k-derivative is a step."""
    step = 1 / (1 + teg.exp(-(x - m) / s))
    f = teg.compile(teg.integral(teg.bracket(x + y < k) * step, (x, 0, 1), (y, 0, 1)), [k])
    _, gradient = f.value_and_grad(m=0.3, s=width, k=0.5)
    expected = width * (math.log1p(math.exp(0.2 / width)) if width > 1e-2 else 0.2 / width) - width * math.log1p(math.exp(-0.3 / width))
    assert gradient["k"] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("width", [1e-3, 1e-4])
def test_a_density_with_two_tails_over_the_line(width: float) -> None:
    """Laplace's density: the value at s = 1e-4 was off by 7e-5, and the gradient took minutes."""
    density = teg.exp(-abs(x - m) / s) / (2 * s)
    f = teg.compile(teg.integral(teg.bracket(x + 0.7 * y < k) * density, (x, -math.inf, math.inf), (y, 0, 1)), [k])
    value, gradient = f.value_and_grad(m=0.3, s=width, k=0.5)
    assert value == pytest.approx(0.2 / 0.7, rel=1e-11)
    assert gradient["k"] == pytest.approx(1 / 0.7, rel=1e-9)


def test_the_place_of_a_density_that_a_line_divides() -> None:
    f = teg.compile(teg.integral(teg.bracket(x + 0.7 * y < 0.5) * DENSITY, (x, -1, 2), (y, 0, 1)), [m], backend="numpy")
    value, gradient = f.value_and_grad(m=0.1, s=1e-5)
    assert value == pytest.approx(0.4 / 0.7, abs=1e-12)
    assert gradient["m"] == pytest.approx(-1 / 0.7, abs=1e-11)


@pytest.mark.parametrize("width", [1e-2, 1e-4])
def test_a_density_that_many_lines_divide(width: float) -> None:
    """Each of twelve lines has a layer of its own in y. Their distances stay as m moves: the first piece loses what the last one gains."""
    factors = [1 - 0.05 * (i + 1) for i in range(12)]
    steps = math.prod((teg.where(x + y < 0.1 + 0.07 * i, 1.0, c) for i, c in enumerate(factors)), start=DENSITY)
    f = teg.compile(teg.integral(steps, (x, -1, 1), (y, 0, 1)), [m], backend="numpy")
    assert f.grad(m=0.02, s=width)["m"] == pytest.approx(math.prod(factors) - 1, rel=1e-10)


@pytest.mark.parametrize("width", [1e-4, 1e-6])
def test_derivatives_of_an_expectation_by_place_and_width(width: float) -> None:
    """All of a density lies inside: the mean of x is m, and the terms of size 1/s cancel."""
    f = teg.compile(teg.integral(DENSITY * x, (x, -1, 2)), [m, s])
    gradient = f.grad(m=0.7, s=width)
    assert gradient["m"] == pytest.approx(1.0, rel=1e-14)
    assert gradient["s"] == pytest.approx(0.0, abs=1e-15 / width)


# -- tails -----------------------------------------------------------------------------------------------------------------


def tail(width: float, weight: Callable[[float], float] = lambda y: 1.0) -> float:
    """∫ of weight·exp((¼ - y²)/s)/s from y = ½ on, to 1 or to infinity: with d = y - ½ in units of s the exponent is -d - s·d²."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    d = 25.0 * (nodes + 1.0)
    inside = np.exp(-d - width * d * d) * np.array([weight(0.5 + width * v) for v in d])
    return float(25.0 * np.sum(weights * inside))


def bell_beyond(edge: teg.Expr, top: float, weight: teg.Expr | float = 1.0) -> teg.Expr:
    return teg.integral(weight * teg.exp(-(y * y - m) / s) / s, (y, edge, top))


TAILS = {
    "a bound": lambda: bell_beyond(k, 1),
    "to infinity": lambda: bell_beyond(k, math.inf),
    "a condition": lambda: teg.integral(teg.where(y > k, teg.exp(-(y * y - m) / s) / s, 0), (y, 0, 1)),
    "a curve without a formula": lambda: teg.integral(
        teg.where(y + teg.exp(y) > k + teg.exp(k), teg.exp(-(y * y - m) / s) / s, 0), (y, 0, 1)
    ),
    "from the other side": lambda: teg.integral(teg.exp(-((1 - y) ** 2 - m) / s) / s, (y, 0, 1 - k)),
    "beside a constant": lambda: bell_beyond(k, 1) + teg.integral(teg.cos(y), (y, 0, 1)) - math.sin(1),
}


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("name", TAILS)
def test_the_tail_of_a_bell_whose_middle_is_beyond_the_edge(name: str, backend: str) -> None:
    """It may be large: exp((¼ - y²)/s)/s is 1/s at y = ½, and falls off within s. Its middle is no place in the range."""
    f = teg.compile(TAILS[name](), [m, k], backend=backend)
    for width in (1e-3, 1e-4, 1e-6):
        value, error = f.value_and_error(m=0.25, s=width, k=0.5)
        expected = tail(width)
        assert value == pytest.approx(expected, rel=1e-10)
        assert error < 1e-9
        assert f.grad(m=0.25, s=width, k=0.5) == pytest.approx({"m": expected / width, "k": -1 / width}, rel=1e-9)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_the_tail_of_a_bell_that_a_surface_divides(backend: str) -> None:
    """∫∫ [x < y] over 0 < x < 1: the weight y. From x = k on the inner range begins at x, and the outer integrand is a layer."""
    body = teg.bracket(x < y) * teg.exp(-(y * y - m) / s) / s
    f = teg.compile(teg.integral(body, (y, k, 1), (x, 0, 1)), [m, k], backend=backend)
    for width in (1e-3, 1e-4, 1e-6):
        expected = tail(width, lambda v: v)
        assert f(m=0.25, s=width, k=0.5) == pytest.approx(expected, rel=1e-10)


def test_a_bell_that_is_at_most_1_has_no_tails() -> None:
    """Beyond the edge it is 0 to rounding: its program has no breaks for tails."""
    low, high = (
        teg.compile(teg.integral(teg.exp(-((y - m) ** 2 - level) / s) * teg.cos(y), (y, k, 1))).explain().data["integrals"][0]["breaks"]
        for level in (0, 1)
    )
    assert high == low + 2


# -- moments ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("power", [4, 6])
def test_high_moments_of_a_narrow_density(backend: str, power: int) -> None:
    """E xᵖ = Σⱼ (p over 2j)·(2j - 1)!!·m^(p - 2j)·s²ʲ, with derivatives, where nearly all of the density lies above k."""
    f = teg.compile(teg.integral(x**power * DENSITY * teg.bracket(x > k), (x, -1, 2)), [m, s], backend=backend)
    odd = [math.prod(range(1, 2 * j, 2)) * math.comb(power, 2 * j) for j in range(power // 2 + 1)]
    for width in (1e-2, 1e-4, 1e-6):
        gradient = f.grad(m=0.5, s=width, k=0.3)
        by_width = sum(c * 0.5 ** (power - 2 * j) * 2 * j * width ** (2 * j - 1) for j, c in enumerate(odd) if j)
        by_place = sum(c * (power - 2 * j) * 0.5 ** (power - 2 * j - 1) * width ** (2 * j) for j, c in enumerate(odd) if 2 * j < power)
        assert gradient["m"] == pytest.approx(by_place, rel=1e-13 + 1e-17 / width)
        assert gradient["s"] == pytest.approx(by_width, abs=1e-15 / width)


@pytest.mark.parametrize("power", [4, 5, 8, 12, 16])
def test_high_moments_from_an_edge(power: int) -> None:
    """From the edge k = m + αs on: 2^(p/2)·Γ((p + 1)/2, α²/2)/(2√π)."""
    f = teg.compile(teg.integral(((x - m) / s) ** power * DENSITY * teg.bracket(x > k), (x, m, math.inf)), backend="numpy")
    at = np.array([0.01, 0.7, 1.9, 2.6, 3.5, 9.0, 30.0])
    scale = 2 ** (power / 2) * special.gamma((power + 1) / 2) / (2 * math.sqrt(math.pi))
    expected = scale * special.gammaincc((power + 1) / 2, at * at / 2)
    np.testing.assert_allclose(f(m=0.25, s=2.0**-9, k=0.25 + at * 2.0**-9), expected, rtol=1e-11)


@pytest.mark.parametrize("power", [5, 8, 12])
def test_high_powers_of_the_distance_from_an_edge(power: int) -> None:
    """Moments about the peak cancel: short pieces and tails have nodes of their own."""
    piece = teg.bracket((x > k) & (x < k + a))
    f = teg.compile(teg.integral(((x - k) / s) ** power * DENSITY * piece, (x, -1, 2)), backend="numpy")
    nodes, weights = np.polynomial.legendre.leggauss(40)
    at, wide = (v.ravel() for v in np.meshgrid([0.01, 0.7, 1.9, 2.6, 3.5, 9.0, 30.0], [0.2, 1.0, 2.0]))
    u = 0.5 * wide[:, None] * (nodes + 1)
    expected = 0.5 * wide * np.sum(weights * u**power * np.exp(-0.5 * (at[:, None] + u) ** 2), axis=1) / math.sqrt(2 * math.pi)
    np.testing.assert_allclose(f(m=0.25, s=2.0**-9, k=0.25 + at * 2.0**-9, a=wide * 2.0**-9), expected, rtol=2e-9)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_second_derivatives_of_a_narrow_density(backend: str) -> None:
    """All of the density lies above k, so the value is 1; terms of 1/s² cancel, those with √(2π)² in them, too."""
    f = teg.compile(teg.integral(DENSITY * teg.bracket(x > k), (x, 0, 1)), [m, s, k], backend=backend)
    for width in (1e-3, 1e-5, 1e-7):
        product = f.hvp({"m": 0.5, "s": width, "k": 0.3}, {"m": 0.3, "s": 0.8, "k": -0.4})
        assert set(product.values()) == {0.0}


WIDTHS: dict[str, tuple[teg.Expr, Callable[[float], float], Callable[[float], float]]] = {
    "width": (DENSITY, lambda width: width, lambda width: 1.0),
    "root of a square": (teg.exp(-((x - m) ** 2) / (2 * s * s)) / teg.sqrt(2 * math.pi * s * s), lambda width: width, lambda width: 1.0),
    "variance": (teg.exp(-((x - m) ** 2) / (2 * s)) / teg.sqrt(2 * math.pi * s), lambda width: width**2, lambda width: 0.5 / width),
    "precision": (teg.exp(-s * (x - m) ** 2 / 2) * teg.sqrt(s / (2 * math.pi)), lambda width: width**-2, lambda width: -0.5 * width**3),
    "power of the variance": (
        teg.exp(-((x - m) ** 2) / (2 * s)) * s**-0.5 / math.sqrt(2 * math.pi),
        lambda width: width**2,
        lambda width: 0.5 / width,
    ),
    "logarithm": (
        teg.exp(-((x - m) ** 2) / (2 * teg.exp(2 * s))) * teg.exp(-s) / math.sqrt(2 * math.pi),
        lambda width: math.log(width),
        lambda width: width,
    ),
}
"""The density with its width in other words: the parameter s of a width, and the width's slope by s."""


@pytest.mark.parametrize("name", WIDTHS)
def test_a_width_in_other_words(name: str) -> None:
    """E x² = m² + σ²; a root in front of the density tells that its variance is positive, so it has a closed form."""
    density, of_width, rate_of = WIDTHS[name]
    f = teg.compile(teg.integral(density * x * x * teg.bracket(x > k), (x, 0, 1)), [m, s], backend="numpy")
    for width in (1e-3, 1e-7):
        at = {"m": 0.5, "s": of_width(width), "k": 0.3}
        assert f.grad(at)["m"] == pytest.approx(1.0, rel=1e-14)
        assert f.grad(at)["s"] == pytest.approx(2 * width * rate_of(width), rel=1e-10)
        second = f.hessian(at)
        assert second["m", "m"] == pytest.approx(2.0, rel=1e-13)
        assert second["m", "s"] == pytest.approx(0.0, abs=1e-30)


@pytest.mark.parametrize(("slope", "at"), [(2.0, 0.5), (3.3, 0.3)])
def test_second_derivatives_of_powers_of_a_line(slope: float, at: float) -> None:
    """Products of constants, 3.3·√(2π), are rounded; and of (2x - 1)⁴ the powers of m alone would cancel near m = ½."""
    f = teg.compile(teg.integral(DENSITY * (slope * (x - at)) ** 4, (x, 0, 1)), [m, s], backend="numpy")
    for width in (1e-3, 1e-6):
        u = 0.1 * width
        second = f.hessian(m=at + u, s=width)
        away = slope**4 * (at + u - at) ** 2
        assert second["m", "m"] == pytest.approx(12 * (away + slope**4 * width**2), rel=1e-9)
        assert second["s", "s"] == pytest.approx(12 * (away + 3 * slope**4 * width**2), rel=1e-9)


@pytest.mark.parametrize("power", [10, 12])
def test_second_derivatives_of_high_moments(power: int) -> None:
    """E xᵖ = Σⱼ (p over 2j)·(2j - 1)!!·m^(p - 2j)·s²ʲ, whose first terms are left at a width of 1e-7."""
    f = teg.compile(teg.integral(DENSITY * x**power * teg.bracket(x > k), (x, 0, 1)), [m, s], backend="numpy")
    second = f.hessian(m=0.5, s=1e-7, k=0.3)
    by_place = math.comb(power, 2) * 2 * 0.5 ** (power - 2)
    assert second["m", "m"] == pytest.approx(by_place, rel=1e-10)
    assert second["s", "s"] == pytest.approx(by_place, rel=1e-10)
    assert second["m", "s"] == pytest.approx(math.comb(power, 2) * 2 * (power - 2) * 0.5 ** (power - 3) * 1e-7, rel=1e-10)


# -- curved surfaces -------------------------------------------------------------------------------------------------------


def root_of_cube(c: float) -> float:
    return c ** (1 / 3)


CURVES: dict[str, tuple[teg.Expr, Callable[[float], float], Callable[[float], float], float]] = {
    "parabola": (x * x + a * y, lambda c: c, lambda v: 1.0, 0.25),
    "circle": (x * x + a * y * y, math.sqrt, lambda v: 2 * v, 0.25),
    "cubes": (x**3 + a * y**3, root_of_cube, lambda v: 3 * v * v, 0.125),
    "exponential": (x * teg.exp(x) / math.exp(0.5) + a * y**3, root_of_cube, lambda v: 3 * v * v, 0.5),
}
"""Curves h(x) + a·q(y) = k: where y is for q(y) = c, the slope of q there, and h(½)."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CURVES)
def test_a_density_that_a_curve_divides(name: str, backend: str) -> None:
    """Charts over y see a layer where the curve meets x = m: gradients lacked a part of the density, 65 % of it on steep curves."""
    curve, height, rise, level = CURVES[name]
    f = teg.compile(teg.integral(DENSITY * teg.bracket(curve < k), (x, 0, 1), (y, 0, 1)), [k, a], backend=backend)
    for width in (1e-4, 1e-6):
        at = height(0.95 - level)
        value, gradient = f.value_and_grad(m=0.5, s=width, k=0.95, a=1.0)
        assert value == pytest.approx(at, abs=20 * width**2 + 1e-11)
        assert gradient["k"] == pytest.approx(1 / rise(at), abs=100 * width**2 + 1e-10)
        assert gradient["a"] == pytest.approx(-(0.95 - level) / rise(at), abs=100 * width**2 + 1e-10)


def test_a_density_beside_a_curve_without_a_formula() -> None:
    """The value of the same in the other order: from y = (k - m)^⅓ on the inner integral, in closed form, is 0."""
    f = teg.compile(teg.integral(DENSITY * teg.bracket(x + y**3 < k), (x, 0, 1), (y, 0, 1)), [k], backend="numpy")
    for width in (1e-4, 1e-6):
        assert f(m=0.83, s=width, k=0.95) == pytest.approx(root_of_cube(0.95 - 0.83), abs=20 * width**2 + 1e-11)
