"""Integrals to infinity of what falls off like a power that is no integer, against closed forms: values, gradients and Hessians."""

from __future__ import annotations

import math
import warnings

import mpmath
import pytest

import teg
from teg.program.interpreter import interpret

pytestmark = pytest.mark.usefixtures("x64_for_jax")

INF, INT, B = math.inf, teg.integral, teg.bracket
x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
BACKENDS = ["numpy", "c", "interpreter", pytest.param("jax", marks=pytest.mark.slow)]
FAST = ["c", "numpy"]


def outcome(e: teg.Expr, at: dict[str, float], backend: str) -> tuple[float, dict[str, float]]:
    """The value and the gradient, by a backend or the interpreter."""
    if backend != "interpreter":
        value, slopes = teg.compile(e, backend=backend).value_and_grad(at)  # type: ignore[arg-type]
        return float(value), {name: float(slope) for name, slope in slopes.items()}
    program = teg.compile(e).program(1)
    value, *slopes = interpret(program, [at[name] for name in program.parameters]).outputs
    return value, dict(zip(teg.compile(e).parameters, slopes, strict=True))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("power", [1.1, 1.5, 2.5])
def test_a_power(power: float, backend: str) -> None:
    e = INT(x**-a, (x, 1, INF))
    rest = power - 1.0
    value, slopes = outcome(e, {"a": power}, backend)
    assert value == pytest.approx(1 / rest, rel=1e-12)
    assert slopes["a"] == pytest.approx(-1 / rest**2, rel=1e-12)
    if backend != "interpreter":
        f = teg.compile(e, backend=backend)  # type: ignore[arg-type]
        assert f.hessian(a=power)["a", "a"] == pytest.approx(2 / rest**3, rel=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_power_to_the_left(backend: str) -> None:
    e = INT((t - x) ** -1.5, (x, -INF, 0))
    value, slopes = outcome(e, {"t": 4.0}, backend)
    assert value == pytest.approx(1.0, rel=1e-13)
    assert slopes["t"] == pytest.approx(-1 / 8, rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("shape", "place"), [(0.5, 9.0), (0.1, 1e6), (1.5, 2.0)])
def test_a_part_of_a_pareto_density(shape: float, place: float, backend: str) -> None:
    """The survival function t^-a, and the density of its jump."""
    e = INT(a * x ** (-a - 1) * B(x > t), (x, 1, INF))
    above = place**-shape
    value, slopes = outcome(e, {"a": shape, "t": place}, backend)
    assert value == pytest.approx(above, rel=1e-12)
    assert slopes["a"] == pytest.approx(-above * math.log(place), rel=1e-11)
    assert slopes["t"] == pytest.approx(-shape * above / place, rel=1e-12)


def student(nu: float) -> tuple[float, float]:
    """∫ (1 + x²/ν)^(-(ν + 1)/2) dx over the line, and its slope by ν."""

    def whole(v: object) -> object:
        return mpmath.sqrt(mpmath.pi * v) * mpmath.gamma(v / 2) / mpmath.gamma((v + 1) / 2)

    return float(whole(mpmath.mpf(nu))), float(mpmath.diff(whole, nu))


@pytest.mark.parametrize("backend", FAST)
@pytest.mark.parametrize("place", [0.0, 1e3])
@pytest.mark.parametrize("nu", [0.5, 1.0, 5.0])
def test_student_with_few_degrees_of_freedom(nu: float, place: float, backend: str) -> None:
    density = (1 + (x - t) ** 2 / a) ** (-(a + 1) / 2)
    e = INT(density, (x, -INF, INF))
    exact, slope = student(nu)
    value, slopes = outcome(e, {"a": nu, "t": place}, backend)
    assert value == pytest.approx(exact, rel=1e-12)
    assert slopes["a"] == pytest.approx(slope, rel=1e-11)
    assert slopes["t"] == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("backend", FAST)
@pytest.mark.parametrize(("first", "second"), [(0.5, 0.5), (4.0, 0.2), (6.0, 2.0)])
def test_a_singular_end_and_a_slow_tail(first: float, second: float, backend: str) -> None:
    """Euler's B(a, b): the range has a break beside the end at which the integrand is singular."""
    e = INT(x ** (a - 1) * (1 + x) ** (-a - b), (x, 0, INF))
    exact = mpmath.beta(first, second)
    both = mpmath.digamma(first + second)
    value, slopes = outcome(e, {"a": first, "b": second}, backend)
    assert value == pytest.approx(float(exact), rel=1e-12)
    assert slopes["a"] == pytest.approx(float(exact * (mpmath.digamma(first) - both)), rel=1e-11)
    assert slopes["b"] == pytest.approx(float(exact * (mpmath.digamma(second) - both)), rel=1e-11)


@pytest.mark.parametrize("backend", FAST)
def test_a_root_at_the_end_beside_an_exponential(backend: str) -> None:
    e = INT(x ** (a - 1) * teg.exp(-x), (x, 0, INF))
    f = teg.compile(e, backend=backend)  # type: ignore[arg-type]
    for power in (0.3, 0.5, 2.5):
        assert f(a=power) == pytest.approx(math.gamma(power), rel=1e-11)


@pytest.mark.parametrize("backend", FAST)
def test_two_pareto_variables(backend: str) -> None:
    """P(X > t·Y) = t^-a/2 for t >= 1."""
    density = a * x ** (-a - 1) * a * y ** (-a - 1)
    e = INT(density * B(x > t * y), (x, 1, INF), (y, 1, INF))
    exact = 3.0**-0.5 / 2
    value, slopes = outcome(e, {"a": 0.5, "t": 3.0}, backend)
    assert value == pytest.approx(exact, rel=1e-11)
    assert slopes["a"] == pytest.approx(-exact * math.log(3.0), rel=1e-10)
    assert slopes["t"] == pytest.approx(-exact * 0.5 / 3.0, rel=1e-11)


@pytest.mark.parametrize("backend", [*FAST, pytest.param("jax", marks=pytest.mark.slow)])
def test_half_of_the_plane(backend: str) -> None:
    """∫∫ [x < t]·(1 + x² + y²)^-a, whose slope at t = 0 is √π·Γ(a - 1/2)/Γ(a)."""
    density = (1 + x**2 + y**2) ** -a
    e = INT(density * B(x < t), (x, -INF, INF), (y, -INF, INF))
    value, slopes = outcome(e, {"a": 1.3, "t": 0.0}, backend)
    assert value == pytest.approx(math.pi / 0.6, rel=1e-11)
    assert slopes["a"] == pytest.approx(-math.pi / 0.18, rel=1e-10)
    assert slopes["t"] == pytest.approx(math.sqrt(math.pi) * math.gamma(0.8) / math.gamma(1.3), rel=1e-11)


@pytest.mark.parametrize("backend", FAST)
def test_what_is_too_slow_is_said(backend: str) -> None:
    """x^-1.02 has 4 digits, with a warning; x^-1 diverges."""
    e = INT(x**-a, (x, 1, INF))
    f = teg.compile(e, backend=backend)  # type: ignore[arg-type]
    with pytest.warns(teg.AccuracyWarning, match="misses the tolerance"):
        assert f(a=1.02) == pytest.approx(50.0, rel=1e-3)
    with pytest.warns(teg.AccuracyWarning, match="diverge"):
        assert f(a=1.0) == INF


def test_what_falls_off_like_an_exponential_costs_what_it_did() -> None:
    def evaluations(body: teg.Expr, low: float) -> int:
        return teg.compile(INT(body, (x, low, INF))).evaluations()

    assert evaluations(teg.exp(-(x**2)) * teg.sqrt(1 + x**4), -INF) <= 256
    assert evaluations(teg.exp(-x) * teg.sqrt(x + 1), 0.0) <= 152
    assert evaluations(1 / (1 + x**2), -INF) <= 112
    assert evaluations(x**-1.5, 1.0) <= 200  # it was 1528, and NaN


def test_no_part_of_a_product_overflows() -> None:
    """x¹¹ and (1 + x)^-12.5 are evaluated far away, where their product is small."""
    f = teg.compile(INT(x ** (a - 1) * (1 + x) ** (-a - b), (x, 0, INF)), [a, b])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert f(a=12.0, b=0.5) == pytest.approx(float(mpmath.beta(12.0, 0.5)), rel=1e-10)
