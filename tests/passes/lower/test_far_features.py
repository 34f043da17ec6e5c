"""Densities and narrow features that are far away on infinite ranges: found where they are, at a cost that does not grow with it."""

from __future__ import annotations

import math

import pytest

import teg
from teg import Expr, cosh, exp, integral, log

x, y = teg.vars("x y")
k, p, a, b = teg.params("k p a b")
BACKENDS = ("numpy", "c")
ROOT_PI = math.sqrt(math.pi)


u = x - p
LINE = (-math.inf, math.inf)
DENSITIES: dict[str, tuple[Expr, float]] = {
    "sech": (1 / cosh(u), math.pi),
    "logistic, rising": (exp(u) / (1 + exp(u)) ** 2, 1.0),
    "logistic, falling": (exp(-u) / (1 + exp(-u)) ** 2, 1.0),
    "Cauchy": (1 / (1 + u**2), math.pi),
    "Student": ((1 + u**2 / 3) ** -2, math.sqrt(3) * math.pi / 2),
    "quartic": (1 / (1 + u**4), math.pi / math.sqrt(2)),
    "exp(-u⁴)": (exp(-(u**4)), 2 * math.gamma(1.25)),
    "Gumbel": (exp(-u - exp(-u)), 1.0),
    "hyperbolic": (exp(-teg.sqrt(1 + u**2)), 1.2038144603944705),
}


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", DENSITIES)
def test_a_density_costs_the_same_at_any_place(name: str, backend: str, x64: None) -> None:
    body, exact = DENSITIES[name]
    f = teg.compile(integral(body, (x, *LINE)), backend=backend, inaccurate="raise")
    for place in (0.0, -40.0, 1e3, -1e6, 1e6):
        assert f(p=place) == pytest.approx(exact, rel=1e-10)
        assert f.evaluations(p=place) <= f.evaluations(p=0.0)


def sech(v: Expr) -> Expr:
    return 1 / cosh(v)


PLANES: dict[str, tuple[Expr, float]] = {
    "x inside": (integral(sech(u) * sech(y - x), (x, *LINE), (y, *LINE)), math.pi**2),
    "y inside": (integral(sech(u) * sech(y - x), (y, *LINE), (x, *LINE)), math.pi**2),
    "Gauss and sech": (integral(exp(-(u**2)) * sech(y - x), (x, *LINE), (y, *LINE)), math.pi**1.5),
    "Cauchy and sech": (integral(sech(y - x) / (1 + u**2), (x, *LINE), (y, *LINE)), math.pi**2),
    "scaled": (integral(sech(u / 5) * sech(3 * (y - 2 * x)), (x, *LINE), (y, *LINE)), math.pi**2 * 5 / 3),
    "a finite range": (integral(sech(u) * sech(y - x), (x, *LINE), (y, -1e7, 1e7)), math.pi**2),
}


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PLANES)
def test_convolutions_far_away(name: str, backend: str, x64: None) -> None:
    """Where centres of the inner integral meet, the outer one has its own."""
    program, exact = PLANES[name]
    near, far = (teg.compile(program, backend=backend, inaccurate=how) for how in ("warn", "ignore"))
    for place, f in ((0.0, near), (-1e6, far)):  # 1e-10 is less than what places around 1e6 are rounded by
        value, error = f.value_and_error(p=place)
        assert math.fabs(value - exact) <= error <= 1e-7
        value, slopes = f.value_and_grad(p=place)
        assert value == pytest.approx(exact, rel=1e-9)
        assert slopes["p"] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_half_lines_whose_outer_range_has_two_centres(backend: str) -> None:
    f = teg.compile(integral(sech(u) * sech(y - x), (x, 0, math.inf), (y, 0, math.inf)), backend=backend)
    assert f(p=1e6) == pytest.approx(math.pi**2, rel=1e-9)
    assert f(p=-1e6) == 0.0


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
def test_a_pole_narrower_than_rounding_warns(backend: str, x64: None) -> None:
    f = teg.compile(integral(k / (1 + (k * u) ** 2), (x, 0, 1)), backend=backend)
    for width in (1e18, 1e20, 1e100):
        with pytest.warns(teg.AccuracyWarning):
            value = f(k=width, p=0.3)
        assert value != pytest.approx(0.0, abs=1e-3) or f.value_and_error(k=width, p=0.3)[1] > 1.0


ORDINARY_ON_INFINITE_RANGES: dict[str, tuple[Expr, float]] = {
    "gamma": (integral(x**2.5 * exp(-x), (x, 0, math.inf)), math.gamma(3.5)),
    "gamma by its logarithm": (integral(exp(2.5 * log(x) - x), (x, 0, math.inf)), math.gamma(3.5)),
    "of a cubic": (integral(exp(-((x**3 - x) ** 2)), (x, *LINE)), 2.42542145814361),
    "a large power": (integral(x**20 * exp(-x) / 1e18, (x, 0, math.inf)), math.gamma(21.0) / 1e18),
    "logistic density of a logarithm": (integral(exp(log(1 + x)) / (1 + exp(log(1 + x))) ** 2 / (1 + x), (x, 0, math.inf)), 0.5),
    "a double root": (integral(1 / (x + 2) ** 2, (x, 0, math.inf)), 0.5),
    "a double root written out": (integral(1 / (x * x + 4 * x + 4), (x, 0, math.inf)), 0.5),
    "a root of a square": (integral(exp(-teg.sqrt(x * x)), (x, *LINE)), 2.0),
    "Planck": (integral(x**3 / (exp(x) - 1), (x, 0, math.inf)), math.pi**4 / 15),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", ORDINARY_ON_INFINITE_RANGES)
def test_ordinary_densities_do_not_warn(name: str, backend: str) -> None:
    program, exact = ORDINARY_ON_INFINITE_RANGES[name]
    f = teg.compile(program, backend=backend, inaccurate="raise")
    assert f() == pytest.approx(exact, rel=1e-9)
    if name in ("gamma", "gamma by its logarithm", "a double root"):
        assert f.evaluations() <= 256
