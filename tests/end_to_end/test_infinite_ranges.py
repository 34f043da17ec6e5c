"""Integrals over infinite ranges whose features are far away, against closed forms."""

from __future__ import annotations

import math
import warnings

import pytest

import teg
from teg.analysis import endless
from teg.analysis.calculus import slope
from teg.ir.expr import const

x, y = teg.vars("x y")
t, k = teg.params("t k")
LINE = (-math.inf, math.inf)
LOGISTIC = teg.exp(-(x - t)) / (1 + teg.exp(-(x - t))) ** 2
BACKENDS = ["c", "numpy", pytest.param("jax", marks=pytest.mark.slow)]


@pytest.fixture(autouse=True)
def double_precision(request: pytest.FixtureRequest) -> None:
    """JAX in 64-bit mode where it computes."""
    if request.node.callspec.params.get("backend") == "jax":
        request.getfixturevalue("x64")


FAR = [0.0, 10.0, -1e3, 1e5, -1e6]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("integrand", "exact"), [(LOGISTIC, 1.0), (1 / teg.cosh(x - t), math.pi)], ids=["logistic", "sech"])
def test_a_peak_is_found_however_far_it_is(integrand: teg.Expr, exact: float, backend: str) -> None:
    """At a millionfold distance the places themselves have errors of 1e-10 of the peak's width."""
    f = teg.compile(teg.integral(integrand, (x, *LINE)), [t], backend=backend)
    for place in FAR:
        value, slopes = f.value_and_grad(t=place)
        assert value == pytest.approx(exact, rel=1e-10)
        assert slopes["t"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_part_of_a_peak_far_away(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x > t) / teg.cosh(x - t), (x, *LINE)), [t], backend=backend)
    for place in FAR:
        assert f(t=place) == pytest.approx(0.5 * math.pi, rel=1e-10)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_what_is_lost_is_said(backend: str) -> None:
    """At 1e13 neighbouring numbers are 1/512 apart: a value may be wrong, but not without a warning."""
    f = teg.compile(teg.integral(LOGISTIC, (x, *LINE)), [t], backend=backend)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        value = f(t=1e13)
    assert value == pytest.approx(1.0, rel=1e-9) or said


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("place", [0.0, 10.0, 1000.0])
def test_a_peak_of_a_convolution_is_found(place: float, backend: str) -> None:
    """∫∫ sech(x - t)·sech(y - x) dx dy = π²: the inner integral is a peak in y around t, which no node of the outer one sees by chance."""
    e = teg.integral(1 / teg.cosh(x - t) / teg.cosh(y - x), (x, *LINE), (y, *LINE))
    assert teg.compile(e, [t], backend=backend)(t=place) == pytest.approx(math.pi**2, rel=1e-9)


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("steepness", [1e18, 1e20])
def test_a_pole_that_the_nodes_cannot_resolve_is_said(steepness: float, backend: str) -> None:
    f = teg.compile(teg.integral(k / (1 + (k * (x - t)) ** 2), (x, -1, 1)), [t], backend=backend)
    with pytest.warns(teg.AccuracyWarning):
        f(t=0.3, k=steepness)


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize(
    ("integrand", "exact"), [(x**2.5 * teg.exp(-x), math.gamma(3.5)), (x**-0.5 * teg.exp(-x), math.gamma(0.5))], ids=str
)
@pytest.mark.filterwarnings("error")
def test_ordinary_densities_are_exact_without_a_warning(integrand: teg.Expr, exact: float, backend: str) -> None:
    f = teg.compile(teg.integral(integrand * teg.bracket(x < t), (x, 0, math.inf)), [t], backend=backend)
    assert f(t=60.0) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("length", [2, 4, 6])
def test_the_bound_of_a_long_value_is_soon_given_up(length: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slopes of slopes of slopes hold thousands of sums, each of which had its slope enclosed: it took minutes for a program."""
    taken = []

    def counted(e: teg.Expr, v: teg.Var) -> teg.Expr:
        taken.append(e)
        return slope(e, v)

    monkeypatch.setattr(endless, "slope", counted)
    value = 1 + x * x
    for n in range(2, 2 + length):
        value = teg.sqrt(value * (x * x + n) + teg.abs(value) / (n + x))
    endless.bound_to_infinity(1 / value, const(0.0), x, {x: teg.vars("left right")})
    assert 0 < len(taken) <= endless.MOST_SLOPES


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("slope", [0.5, 1.0, 2.0])
def test_an_edge_that_leaves_the_range(slope: float, backend: str) -> None:
    """Beyond the inner range exp(-x - y) is exp((k - 1)·y - t) on the line x = t - k·y: it grows without bounds, and does not count."""
    density = teg.exp(-x - y) * teg.bracket(x + k * y < t)
    f = teg.compile(teg.integral(density, (x, 0, math.inf), (y, 0, math.inf)), [t, k], backend=backend)
    end = 2.0 / slope
    along = end if slope == 1.0 else math.expm1((slope - 1.0) * end) / (slope - 1.0)
    inside = -math.expm1(-end) - math.exp(-2.0) * along
    value, error = f.value_and_error(t=2.0, k=slope)
    assert value == pytest.approx(inside, abs=1e-11)
    assert error < 1e-10


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_break_far_outside_of_the_inner_range(backend: str) -> None:
    """The integrand at such a break says nothing about the inner integral: the estimate is not one of what is there."""
    holds = (x - teg.sin(2 * y) - k < 0) & (t < x * y)
    f = teg.compile(teg.integral(teg.exp(-teg.bracket(holds) * teg.exp(2 * x * y * k)), (x, -1, 1), (y, -1, 1)), [t, k], backend=backend)
    value, error = f.value_and_error(t=0.234, k=1.108)
    assert value == pytest.approx(3.2177805472534347342, rel=1e-11)  # mpmath, in 20 digits, between all breaks in x and in y
    assert error < 1e-10
