"""Centres: the places around which integrands on infinite ranges have their features."""

from __future__ import annotations

import math
from typing import cast

import mpmath
import pytest

import teg
from teg.analysis.centres import Centres
from teg.analysis.polynomial import Degrees
from teg.ir.expr import Expr
from teg.ir.integral import Integral

x, y = teg.vars("x y")
t, a, b, k = teg.params("t a b k")
LINE = (-math.inf, math.inf)
AT = {"t": 0.7, "a": 2.0, "b": 1.5, "k": 3.0}


def centres(e: Expr) -> list[tuple[float, float]]:
    """The places and widths of the centres of an integral at AT."""

    def number(part: Expr) -> float:
        f = teg.compile(part, [], backend="numpy")
        return float(f(**{name: AT[name] for name in f.parameters}))

    return [(number(c.place), number(c.width)) for c in Centres(Degrees(), lambda e: e).of(cast(Integral, e))]


@pytest.mark.parametrize(
    ("integrand", "expected"),
    [
        (1 / teg.cosh(a * x - t), [(0.35, 0.5)]),
        (teg.exp(-a * (x - t) ** 2), [(0.7, 0.5)]),
        (1 / (1 + (k * (x - t)) ** 2), [(0.7, 1 / 3)]),
        (1 / teg.cosh(x - t) / teg.cosh(x - b), [(0.7, 1.0), (1.5, 1.0)]),
        (x**2 * teg.sin(x - t), []),
        (teg.bracket(x < t) + 0 * x, []),
    ],
    ids=str,
)
def test_centres_are_where_functions_turn(integrand: Expr, expected: list[tuple[float, float]]) -> None:
    found = centres(teg.integral(integrand, (x, *LINE)))
    assert sorted(found) == [pytest.approx(e) for e in sorted(expected)]


def test_centres_of_an_inner_integral_meet_outside() -> None:
    inner = teg.integral(1 / teg.cosh(x - t) / teg.cosh(a * y - x), (x, *LINE))
    assert centres(teg.integral(inner, (y, *LINE))) == [pytest.approx((0.35, 1.0))]


def test_a_centre_meets_a_finite_bound() -> None:
    inner = teg.integral(1 / teg.cosh(y - x), (x, t, math.inf))
    assert centres(teg.integral(inner * teg.exp(-((y - b) ** 2)), (y, *LINE)))[-1] == pytest.approx((0.7, 1.0))


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(("far", "at"), [(1e4, 3700.0), (1e6, 3.0), (1e6, 9e5)])
def test_centres_meet_on_long_finite_ranges(far: float, at: float, backend: str) -> None:
    """∫∫ sech(x - t)·sech(y - x) is π² but for e^-(far - |t|): it was 0, without a warning."""
    e = teg.integral(1 / teg.cosh(x - t) / teg.cosh(y - x), (x, -far, far), (y, -far, far))
    value, gradient = teg.compile(e, backend=backend).value_and_grad(t=at)
    assert value == pytest.approx(math.pi**2, rel=1e-10)
    assert gradient["t"] == pytest.approx(0.0, abs=1e-9)


def test_narrow_centres_meet_in_a_box() -> None:
    """sech(k(x - s))·sech(k(y - x)) over a unit square: π²/k²; at k = 3 nodes see it anyway, and nothing changes."""
    e = teg.integral(1 / teg.cosh(k * (x - t)) / teg.cosh(k * (y - x)), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e)
    assert f(t=0.3, k=1e5) == pytest.approx(math.pi**2 * 1e-10, rel=1e-9)
    assert f(t=0.3, k=3.0) == pytest.approx(float(_sech_square(0.3, 3.0)), rel=1e-10)
    assert f.evaluations(t=0.3, k=3.0) < 5000


def _sech_square(at: float, rate: float) -> mpmath.mpf:
    def inner(s: mpmath.mpf) -> mpmath.mpf:  # ∫₀¹ sech(k(y - s)) dy
        return (mpmath.atan(mpmath.sinh(rate * (1 - s))) + mpmath.atan(mpmath.sinh(rate * s))) / rate

    return mpmath.quad(lambda s: mpmath.sech(rate * (s - at)) * inner(s), [0, at, 1])
