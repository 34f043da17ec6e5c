"""Integrals of closed form on one interval, against 40 digits and against pieces; powers by roots; the exponential of the C runtime."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import teg
from teg.program import Integrate, statements

x = teg.var("x")
s, t, a, m, k, lo, hi = teg.params("s t a m k lo hi")
BELL = teg.exp(-(x**2) / 2) / math.sqrt(2 * math.pi)
BACKENDS = ("numpy", "c")


def pieces(f: teg.Evaluator) -> int:
    return sum(isinstance(stmt, Integrate) for stmt in statements(f.program(1).body))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "at",
    [(0.2, 0.7, 0.0, 1.0), (0.7, 0.2, 0.0, 1.0), (0.2, 0.7, 1.0, 0.0), (-1.0, 2.0, 0.5, 0.75), (0.3, 0.3, 0.0, 1.0), (0.2, 5.0, -2.0, 2.0)],
)
@pytest.mark.parametrize("rate", [-2.0, 0.0, 1e-8, 3.0])
def test_two_conditions_and_bounds(backend: str, at: tuple[float, ...], rate: float) -> None:
    e = teg.integral(teg.bracket(x > s) * teg.bracket(2 * x < 2 * t) * x * teg.exp(a * x), (x, lo, hi))
    f = teg.compile(e, [s, t, a, lo, hi], backend=backend)
    assert pieces(f) == 0
    left, right, first, last = at
    value, slopes = f.value_and_grad(s=left, t=right, a=rate, lo=first, hi=last)
    p, q, sign = max(left, min(first, last)), min(right, max(first, last)), math.copysign(1.0, last - first)
    with mpmath.workdps(40):
        inside = mpmath.quad(lambda v: v * mpmath.exp(rate * v), [p, q]) if p < q else mpmath.mpf(0)
        moved = mpmath.quad(lambda v: v * v * mpmath.exp(rate * v), [p, q]) if p < q else mpmath.mpf(0)
    assert abs(value - sign * inside) < 1e-15 * (1 + abs(inside))
    assert abs(slopes["a"] - sign * moved) < 2e-15 * (1 + abs(moved))
    if p < q:
        assert abs(slopes["t"] - (sign * right * math.exp(rate * right) if q == right else 0.0)) < 2e-15 * (1 + abs(inside))
        assert abs(slopes["s"] + (sign * left * math.exp(rate * left) if p == left else 0.0)) < 2e-15 * (1 + abs(inside))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("at", [(0.3, 0.1, 1.1), (-0.3, 0.1, 1.1), (0.3, 0.1, -1.0), (0.0, 0.1, 0.5), (1e-9, 0.0, 0.5), (2.0, -1.0, 90.0)])
def test_a_payoff_against_a_gaussian(backend: str, at: tuple[float, ...]) -> None:
    f = teg.compile(teg.integral(teg.maximum(teg.exp(s * x + m) - k, 0) * BELL, (x, -math.inf, math.inf)), [s, m, k], backend=backend)
    assert pieces(f) == 0
    width, drift, strike = at
    value, slopes = f.value_and_grad(s=width, m=drift, k=strike)
    with mpmath.workdps(30):
        normal = mpmath.ncdf
        if strike > 0 and width:
            d = (drift - mpmath.log(strike)) / abs(width)
            growth = mpmath.exp(drift + mpmath.mpf(width) ** 2 / 2)
            upper, lower = normal(d + abs(width)), normal(d)
            density = mpmath.npdf(d + abs(width)) * growth
        else:
            growth = mpmath.exp(drift + mpmath.mpf(width) ** 2 / 2)
            upper, lower, density = mpmath.mpf(1), mpmath.mpf(1), mpmath.mpf(0)
        size = growth + abs(strike)
        assert abs(value - (growth * upper - strike * lower)) < 4e-15 * size
        assert abs(slopes["m"] - growth * upper) < 4e-15 * size
        assert abs(slopes["k"] + lower) < 4e-15 * size
        assert abs(slopes["s"] - (width * growth * upper + (math.copysign(1.0, width) * density if width else 0))) < 2e-14 * size


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_condition_whose_slope_is_known_at_run_time(backend: str) -> None:
    e = teg.integral(teg.bracket(s * x < t) * teg.exp(a * x), (x, -1, 1))
    f, plain = (teg.compile(e, [s, t, a], backend=backend, intrinsics=on) for on in (True, False))
    assert pieces(f) == 0
    for values in ((2.0, 0.5, 1.0), (-2.0, 0.5, 1.0), (0.0, 0.5, 1.0), (0.0, -0.5, 1.0), (1.0, 1.0, -1.0), (1e-12, 0.0, 0.3)):
        at = dict(zip("sta", values, strict=True))
        assert abs(f(at) - plain(at)) < 1e-13
        assert all(abs(v - plain.grad(at)[name]) < 1e-12 * (1 + abs(v)) for name, v in f.grad(at).items())
    assert math.isnan(f(s=math.nan, t=0.5, a=1.0))


def between_roots(body: str, at: dict[str, float]) -> mpmath.mpf:
    """∫ over (lo, hi) of exp(ax), or cos(ax), where (x - m)² < t, and x > s where that is asked for."""
    low, high = sorted((at["lo"], at["hi"]))
    if at["t"] <= 0:
        return mpmath.mpf(0)
    width = mpmath.sqrt(at["t"])
    low, high = max(mpmath.mpf(low), at["m"] - width), min(mpmath.mpf(high), at["m"] + width)
    if "half" in body:
        low = max(low, mpmath.mpf(at["s"]))
    wave = mpmath.cos if "cos" in body else mpmath.exp
    return mpmath.mpf(0) if low >= high else math.copysign(1, at["hi"] - at["lo"]) * mpmath.quad(lambda v: wave(at["a"] * v), [low, high])


BETWEEN = {
    "exp": teg.bracket((x - m) ** 2 < t) * teg.exp(a * x),
    "cos": teg.bracket((x - m) ** 2 < t) * teg.cos(a * x),
    "exp, not outside": teg.where((x - m) ** 2 > t, 0, teg.exp(a * x)),
    "exp on a half": teg.bracket((x - m) ** 2 < t) * teg.bracket(x > s) * teg.exp(a * x),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("body", BETWEEN)
def test_a_condition_that_holds_between_two_roots(backend: str, body: str) -> None:
    f = teg.compile(teg.integral(BETWEEN[body], (x, lo, hi)), backend=backend, inaccurate="ignore")
    assert pieces(f) == 0
    given = {"a": 0.7, "m": 0.2, "s": 0.1, "lo": -0.5, "hi": 1.5}
    for more in ({"t": 0.3}, {"t": 5.0}, {"t": 1e-300}, {"t": 0.0}, {"t": -0.5}, {"t": 0.3, "lo": 2.0, "hi": -1.0}, {"t": 0.01, "lo": 0.5}):
        at = {name: v for name, v in {**given, **more}.items() if name in f.parameters}
        value, slopes = f.value_and_grad(at)
        assert abs(value - between_roots(body, {**given, **more})) < 1e-15
        for name in ("a", "m", "lo", "hi") if more["t"] > 0.001 else ():
            with mpmath.workdps(30):
                ends = ({**given, **more, name: mpmath.mpf({**given, **more}[name]) + h} for h in (-1e-10, 1e-10))
                low, high = (between_roots(body, end) for end in ends)
                assert abs(slopes[name] - (high - low) / 2e-10) < 1e-14, name
    assert math.isnan(f({**at, "t": math.nan}))
    assert math.isnan(f({**at, "m": math.nan}))


@pytest.mark.parametrize(
    "body", [teg.bracket(x * x > t) * teg.exp(a * x), teg.bracket(s * x * x < t) * teg.exp(a * x)], ids=["outside", "s < 0"]
)
def test_conditions_that_may_hold_on_two_sides_have_pieces(body: teg.Expr) -> None:
    assert pieces(teg.compile(teg.integral(body, (x, -1, 1)))) > 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_polynomials_inside_of_other_integrals(backend: str) -> None:
    y = teg.var("y")
    area = teg.integral(teg.bracket(x**4 + y**4 < t) * (1 + a * x), (x, -1, 1), (y, -1, 1))
    f, plain = (teg.compile(area, [t, a], backend=backend, intrinsics=flag) for flag in (True, False))
    assert pieces(f) < pieces(plain)
    for at in ({"t": 0.3, "a": 0.5}, {"t": 1.7, "a": -1.0}, {"t": 3.0, "a": 1.0}, {"t": -1.0, "a": 1.0}):
        value, slopes = f.value_and_grad(at)
        other, others = plain.value_and_grad(at)
        assert value == pytest.approx(other, abs=1e-12)
        assert slopes == pytest.approx(others, abs=1e-10)
    size = math.gamma(0.25) ** 2 / math.gamma(0.5) / 2  # of x⁴ + y⁴ < 1, times t**0.5
    assert f(t=0.3, a=0.5) == pytest.approx(size * math.sqrt(0.3), abs=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_roots_that_meet_far_from_the_bounds(backend: str) -> None:
    """Slices of a turned ellipse that end beside the box: no break is there."""
    y = teg.var("y")
    e = teg.integral(teg.bracket(x**2 + a * x * y + y**2 < t) * teg.cos(3 * x) * teg.exp(y), (x, a, 1), (y, 1, -1))
    f, plain = (teg.compile(e, [t, a], backend=backend, intrinsics=flag) for flag in (True, False))
    given = {"t": np.array([0.4, 0.4, 0.7, 1.3]), "a": np.array([0.8943115784884768, 0.7, -0.9, 0.2])}
    (value, slopes), (other, others) = f.value_and_grad(given), plain.value_and_grad(given)
    assert value[0] == 0.0
    np.testing.assert_allclose(value, other, atol=1e-13)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], atol=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("exponent", [k / 4 for k in range(-8, 9)])
def test_powers_by_square_roots(backend: str, exponent: float) -> None:
    f = teg.compile(t**exponent, [t], backend=backend, inaccurate="ignore")
    places = np.array([1e-300, 1e-30, 0.3, 1.0, 7.7, 1e30, 1e150, math.inf])
    with np.errstate(over="ignore"):
        np.testing.assert_allclose(f(t=places), places**exponent, rtol=1e-15)
    if exponent % 1:
        assert math.isnan(f(t=-0.5))
        assert f(t=0.0) == (0.0 if exponent > 0 else math.inf)


def test_the_exponential_of_the_runtime() -> None:
    places = np.concatenate(
        [np.linspace(-745.5, 710.0, 20_001), np.linspace(-1, 1, 2001), [0.0, -0.0, 1e-300, math.inf, -math.inf, -1e308, 1e308]]
    )
    f = teg.compile(teg.tuple(teg.exp(a), teg.exp(a) - 1), [a], backend="c")
    found, less_one = f(places)
    with np.errstate(over="ignore"):
        expected, other = np.exp(places), np.expm1(places)
    normal = expected > 1e-307
    finite = normal & np.isfinite(expected)
    assert np.max(np.abs(found[finite] / expected[finite] - 1)) < 4e-16
    assert np.all(found[~finite & normal] == math.inf)
    assert np.max(np.abs(found[~normal] - expected[~normal])) <= 1e-323
    nonzero = np.isfinite(other) & (other != 0)
    assert np.max(np.abs(less_one[nonzero] / other[nonzero] - 1)) < 7e-16


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("body", [teg.bracket(s * x + s < s), teg.bracket(s * x + t < s * m + t) * x], ids=["at 0", "at m"])
def test_a_condition_that_is_nowhere_met_where_its_slope_vanishes(backend: str, body: teg.Expr) -> None:
    """The root of such a condition is a number, though its function is 0 everywhere."""
    f = teg.compile(teg.integral(body * teg.exp(a * x), (x, -1, 1)), backend=backend)
    given = {name: v for name, v in {"s": 0.0, "t": 0.25, "a": 0.5, "m": 0.5}.items() if name in f.parameters}
    assert pieces(f) == 0
    assert f(given) == f.value_and_grad(given)[0] == f.value_and_error(given)[0] == 0.0


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("width", [1e-20, 1e-6, 1e-4, 0.01])
def test_a_gaussian_whose_peak_is_too_large_and_left_out(backend: str, width: float) -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(a * x - (s * x) ** 2), (x, -math.inf, math.inf)), [s, t, a], backend=backend)
    assert pieces(f) == 0
    value, slopes = f.value_and_grad(s=width, t=1.0, a=3.0)
    with mpmath.workdps(30):
        places = [-1000, -100, -10, 0, 1]
        expected = mpmath.quad(lambda v: mpmath.exp(3 * v - (width * v) ** 2), places)
        moved = mpmath.quad(lambda v: v * mpmath.exp(3 * v - (width * v) ** 2), places)
    assert abs(value - expected) < 1e-14 * expected
    assert abs(slopes["a"] - moved) < 1e-11 * abs(moved)
    assert abs(slopes["t"] - math.exp(3 - width**2)) < 1e-14 * expected
