"""Integrals in closed form between breaks: values and gradients against mpmath, over rates and widths of all sizes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import mpmath
import pytest

import teg
from teg.passes.lower.means import mean_of

x, y = teg.vars("x y")
t, a, b, S, K, s = teg.params("t a b S K s")


def rules(f: Any) -> list[Any]:
    return [i["rule"] for i in f.explain().data["integrals"]]


def quad(f: Callable[[Any], Any], *points: float) -> float:
    """The integral to 25 digits, in pieces short enough for a narrow integrand."""
    with mpmath.workdps(30):
        lo, hi = mpmath.mpf(points[0]), mpmath.mpf(points[-1])
        ends = sorted({*map(mpmath.mpf, points), *(lo + (hi - lo) * k / 40 for k in range(41))})
        return float(mpmath.quad(f, ends))


def size_of(f: Callable[[Any], Any], v: Any) -> Any:
    return abs(f(v))


INTEGRANDS: dict[str, tuple[teg.Expr, Callable[[Any, Any, Any], Any]]] = {
    "exp": (teg.exp(a * x), lambda v, k, c: mpmath.exp(k * v)),
    "x exp": (x * teg.exp(a * x + b), lambda v, k, c: v * mpmath.exp(k * v + c)),
    "a product of exponentials": (teg.exp(a * x) * (teg.exp(-x) + b) ** 2, lambda v, k, c: mpmath.exp(k * v) * (mpmath.exp(-v) + c) ** 2),
    "x³ exp": ((x - b) ** 3 * teg.exp(a * x), lambda v, k, c: (v - c) ** 3 * mpmath.exp(k * v)),
    "sin": (teg.sin(a * x + b), lambda v, k, c: mpmath.sin(k * v + c)),
    "x² cos": (x * x * teg.cos(a * x + b), lambda v, k, c: v * v * mpmath.cos(k * v + c)),
    "Gaussian": (teg.exp(-a * a * x * x + b * x), lambda v, k, c: mpmath.exp(-k * k * v * v + c * v)),
    "x Gaussian": ((x - b) * teg.exp(-((a * (x - b)) ** 2)), lambda v, k, c: (v - c) * mpmath.exp(-((k * (v - c)) ** 2))),
    "x³ Gaussian": (x**3 * teg.exp(-a * a * x * x + 2 * x), lambda v, k, c: v**3 * mpmath.exp(-k * k * v * v + 2 * v)),
    "with a polynomial": (teg.exp(a * x) + x * x, lambda v, k, c: mpmath.exp(k * v) + v * v),
}
RATES = (0.0, 1e-9, -0.3, 0.07, 0.9, 2.0, -6.0, 45.0)


@pytest.mark.parametrize("name", INTEGRANDS)
def test_values(name: str) -> None:
    body, exact = INTEGRANDS[name]
    f = teg.compile(teg.integral(teg.bracket(x < t) * body, (x, -1, 2)), [t, a])
    assert rules(f) == ["closed form"]
    for rate, end, c in itertools.product(RATES, (-0.999, 0.3, 1.9), (0.7,)):
        values = {k: v for k, v in {"t": end, "a": rate, "b": c}.items() if k in f.parameters}
        value, error = f.value_and_error(**values)
        at = partial(exact, k=mpmath.mpf(rate), c=mpmath.mpf(c))
        wanted, size = quad(at, -1.0, end), quad(partial(size_of, at), -1.0, end)
        assert abs(value - wanted) <= 5e-13 * size + 1e-100, (rate, end)
        assert error < 1e-11 * max(size, 1.0)


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.thorough)])
@pytest.mark.parametrize("name", INTEGRANDS)
def test_gradients_and_backends(name: str, backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "jax":
        request.getfixturevalue("x64")
    e = teg.integral(teg.bracket(x < t) * INTEGRANDS[name][0], (x, -1, 2))
    f = teg.compile(e, [t, a], backend=backend)
    g = teg.compile(e, [t, a], intrinsics=False, tol=1e-13)
    for rate, end in itertools.product((0.0, 1e-7, -0.6, 3.0, 45.0), (-0.9, 1.3)):
        values = {k: v for k, v in {"t": end, "a": rate, "b": 0.7}.items() if k in f.parameters}
        (value, gradient), (same, slopes) = f.value_and_grad(**values), g.value_and_grad(**values)
        assert value == pytest.approx(same, rel=1e-12, abs=1e-13)
        for p in ("t", "a"):
            assert gradient[p] == pytest.approx(slopes[p], rel=1e-10, abs=1e-11 * (1 + abs(same)))


def damped_wave(degree: int, rate: Any, lo: float, hi: float) -> Any:
    """Returns ∫ xⁿ·exp(λ·x) dx for a complex λ, to 25 digits or more."""

    def antiderivative(v: Any) -> Any:
        if rate == 0:
            return v ** (degree + 1) / (degree + 1)
        falling = (mpmath.ff(degree, k) * v ** (degree - k) / rate ** (k + 1) * (-1) ** k for k in range(degree + 1))
        return mpmath.exp(rate * v) * mpmath.fsum(falling)

    return antiderivative(mpmath.mpf(hi)) - antiderivative(mpmath.mpf(lo))


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("degree", [0, 1])
def test_an_exponential_times_a_wave(degree: int, backend: str) -> None:
    body = x**degree * teg.exp(a * x) * teg.sin(s * x + b)
    f = teg.compile(teg.integral(teg.bracket(x < t) * body, (x, -1, 2)), [t, a, s, b], backend=backend)
    assert rules(f) == ["closed form"]
    for growth, turn, end in itertools.product(RATES, RATES, (-0.999, 0.3, 1.9)):
        value, gradient = f.value_and_grad(t=end, a=growth, s=turn, b=0.7)
        with mpmath.workdps(90):
            rate, phase = mpmath.mpc(growth, turn), mpmath.expj(mpmath.mpf(0.7))
            integral, slope = (damped_wave(degree + k, rate, -1.0, end) * phase for k in (0, 1))
            size = float(damped_wave(0, mpmath.mpf(growth), -1.0, end))
            wanted = float(integral.imag), float(slope.imag), float(slope.real), float(integral.real)
        assert abs(value - wanted[0]) <= 2e-14 * size * max(1.0, abs(turn)), (growth, turn, end)
        for p, number in zip("asb", wanted[1:], strict=True):
            assert abs(gradient[p] - number) <= 5e-14 * size * max(1.0, abs(turn)), (growth, turn, end, p)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_estimates_hold_where_the_ends_cancel(degree: int) -> None:
    """The integral over some periods is much smaller than both values of the antiderivative, whose roundings remain."""
    f = teg.compile(teg.integral(teg.bracket(x < t) * x**degree * teg.exp(a * x) * teg.sin(s * x + b), (x, -1, 2)))
    g = teg.compile(teg.integral(teg.bracket(x < t) * x**degree * teg.sin(s * x + b), (x, -1, 2)))
    for growth, turn, end in itertools.product((0.0, 1e-9, 0.5, 1.2, 2.0, -6.0), (0.9, 1.1, 2.0, -6.0, 13.0, 45.0), (0.3, 1.2, 1.9)):
        with mpmath.workdps(90):
            exact = (damped_wave(degree, mpmath.mpc(growth, turn), -1.0, end) * mpmath.expj(mpmath.mpf(0.7))).imag
            size = float(damped_wave(0, mpmath.mpf(growth), -1.0, end))
            for value, error in [f.value_and_error(t=end, a=growth, s=turn, b=0.7)] + [g.value_and_error(t=end, s=turn, b=0.7)] * (
                not growth
            ):
                assert abs(exact - value) <= error < 1e-12 * size * max(1.0, abs(turn)), (growth, turn, end)


def test_a_payoff_against_a_gaussian_on_the_line() -> None:
    density = teg.exp(-x * x / 2) / math.sqrt(2 * math.pi)
    f = teg.compile(teg.integral(teg.maximum(S * teg.exp(s * x) - K, 0) * density, (x, -math.inf, math.inf)), [S, K, s])
    assert rules(f) == ["closed form"]

    def black(spot: float, strike: float, deviation: float) -> tuple[float, float, float, float]:
        with mpmath.workdps(30):
            r = mpmath.log(mpmath.mpf(strike) / spot) / deviation
            above, below = mpmath.ncdf(deviation - r), mpmath.ncdf(-r)
            grown = spot * mpmath.exp(mpmath.mpf(deviation) ** 2 / 2)
            slope = grown * (deviation * above + mpmath.npdf(deviation - r))
            return float(grown * above - strike * below), float(grown / spot * above), float(-below), float(slope)

    for spot, strike, deviation in itertools.product((0.5, 1.0, 1.1), (0.8, 1.0, 3.0), (0.01, 0.2, 2.0, 6.0)):
        value, gradient = f.value_and_grad(S=spot, K=strike, s=deviation)
        wanted = black(spot, strike, deviation)
        assert value == pytest.approx(wanted[0], rel=1e-11, abs=1e-15)
        for p, slope in zip(("S", "K", "s"), wanted[1:], strict=True):
            assert gradient[p] == pytest.approx(slope, rel=1e-11, abs=1e-14)


def tail(v: Any, k: float, power: int) -> Any:
    return (v - k) ** power * mpmath.exp((k * k - v * v) / 2)


def test_a_gaussian_far_from_its_peak_keeps_its_digits() -> None:
    for k, power in ((10.0, 0), (25.0, 0), (10.0, 1), (20.0, 2), (20.0, 3)):
        f = teg.compile(teg.integral((x - t) ** power * teg.exp(-x * x / 2), (x, t, math.inf)), [t])
        with mpmath.workdps(40):
            wanted = mpmath.quad(partial(tail, k=k, power=power), [k, k + 1, k + 5]) * mpmath.exp(-k * k / 2)
        assert f(t=k) == pytest.approx(float(wanted), rel=3e-12), (k, power)


def test_products_over_a_box_are_products_of_closed_forms() -> None:
    f = teg.compile(teg.integral(teg.exp(a * x) * teg.sin(t * y), (x, 0, 1), (y, 0, 2)), [t, a], backend="c")
    assert f(t=1.0, a=2.0) == pytest.approx((math.exp(2.0) - 1) / 2 * (1 - math.cos(2)), rel=1e-14)
    assert set(rules(f)) == {"closed form"}


def test_a_bracket_inside_a_box_is_in_closed_form_in_its_variable() -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x) * teg.sin(y), (x, 0, 1), (y, 0, 2)), [t, a], backend="c")
    assert f(t=0.4, a=2.0) == pytest.approx((math.exp(2 * 0.4) - 1) / 2 * (1 - math.cos(2)), rel=1e-13)
    assert "closed form" in rules(f)
    assert f.grad(t=0.4, a=2.0)["t"] == pytest.approx(math.exp(0.8) * (1 - math.cos(2)), rel=1e-13)


def test_many_brackets_share_one_exponential_a_piece() -> None:
    levels = teg.params(" ".join(f"t{i}" for i in range(20)))
    f = teg.compile(teg.integral(sum((teg.bracket(x < p) for p in levels), start=teg.bracket(x < 0)) * teg.exp(x), (x, 0, 1)), backend="c")
    places = {f"t{i}": (i + 0.5) / 19 for i in range(20)}
    value, gradient = f.value_and_grad(**places)
    assert value == pytest.approx(sum(math.expm1(min(v, 1.0)) for v in places.values()), rel=1e-14)
    assert [gradient[p] for p in places] == pytest.approx([math.exp(v) if v < 1 else 0.0 for v in places.values()], rel=1e-14)
    assert f.source.count("exp(") < 60


OPTIONS: list[dict[str, Any]] = [{"rule": "gauss"}, {"rule": "adaptive"}, {"rule": "midpoint"}, {"order": 9}, {"intrinsics": False}]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_a_rule_that_is_asked_for_is_honoured(options: dict[str, Any]) -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, a], **options)
    assert rules(f)
    assert "closed form" not in rules(f)


@pytest.mark.parametrize(
    "body",
    [
        teg.exp(x * x),  # no erf
        teg.exp(a * x * x),  # its sign is not known
        teg.exp(x**3),
        teg.sin(x) * teg.cos(a * x),
        teg.sin(x) * teg.exp(-x * x),
        x**4 * teg.exp(x),
        teg.exp(x) / (1 + x),
        x * x + 1,  # Gauss is exact
        teg.sqrt(1 + teg.exp(x)),
        teg.integral(teg.exp(x * y), (y, 0, 1)) * teg.exp(x),
    ],
    ids=str,
)
def test_no_closed_form(body: teg.Expr) -> None:
    assert mean_of(body, x) is None


def test_infinite_ranges_of_other_integrands_are_tails() -> None:
    for body in (teg.exp(-x), teg.exp(-x * x) + teg.exp(-x), teg.exp(-(x**2)) * teg.sin(x)):
        f = teg.compile(teg.integral(body, (x, 0, math.inf)))
        assert "closed form" not in rules(f)


def test_a_condition_without_known_breaks_keeps_its_tolerance() -> None:
    e = teg.integral(teg.bracket(teg.sin(40 * x * x) + x < t) * teg.exp(x), (x, 0, 1))
    f, g = teg.compile(e, [t]), teg.compile(e, [t], intrinsics=False)
    assert f(t=0.3) == pytest.approx(g(t=0.3), rel=1e-10)


def test_a_pixel_of_an_exponential_and_a_wave_takes_nodes_in_one_variable() -> None:
    for body in (teg.exp(x) * teg.cos(x), teg.exp(x * y) * teg.cos(x + y)):
        e = teg.integral(teg.bracket(x + a * y < t) * body, (x, 0, 1), (y, 0, 1))
        f, g = teg.compile(e, [t, a]), teg.compile(e, [t, a], intrinsics=False, tol=1e-13)
        assert [f.evaluations(t=p, a=0.3) for p in (9.0, -9.0)] == [10, 0]
        for p in (9.0, 0.8, 0.4):
            value, gradient = f.value_and_grad(t=p, a=0.3)
            same, slopes = g.value_and_grad(t=p, a=0.3)
            assert value == pytest.approx(same, rel=1e-12)
            assert gradient == pytest.approx(slopes, rel=1e-11, abs=1e-13)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_not_a_number_and_what_overflows(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [t, a], backend=backend)
    assert math.isnan(f(t=math.nan, a=1.0))
    assert math.isnan(f(t=0.5, a=math.nan))
    assert f(t=0.5, a=1000.0) == pytest.approx(math.exp(500) / 1000, rel=1e-13)
    assert f(t=0.5, a=-1e12) == pytest.approx(1e-12, rel=1e-13)
