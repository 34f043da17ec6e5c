"""Simplifications that decide values: what cancels in a product of powers, whose factors are 0·∞ at a place."""

from __future__ import annotations

import pytest

import teg
from teg.ir.expr import ONE, ZERO
from teg.ir.integral import scaled_integral
from teg.ir.simplify import collected

x, y = teg.vars("x y")
t = teg.param("t")
BACKENDS = ("c", "numpy")
TRIANGLE = (x, 0, 1), (y, 0, 1)


def test_powers_of_quotients_cancel() -> None:
    assert (t / x) ** 2 * x**2 is t**2
    assert (t / (x * y)) ** 3 * (x * y) ** 3 is t**3
    assert str((2 * t / x) ** 2 * x) == "4·t²/x"
    assert (x * y) ** 2 / x is x * y**2
    assert str((t / x) ** 2 * y) == "(t/x)²·y", "what does not cancel may overflow"
    assert (x / t) ** 2 * x is not x**3 / t**2, "a quotient by a parameter stays, so that it does not overflow"


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("e", "value", "slope"),
    [
        ((t / x) ** 2 * x**2, 0.125, 0.5),
        ((t / (x * y)) ** 2 * (x * y) ** 2, 0.125, 0.5),
        ((1 + t / x) ** 2 * x**2, 0.25 + 1 / 3 + 0.125, 2 / 3 + 0.5),
        (((x + t) / (x - y)) ** 2 * (y - x) ** 2, 0.25 + 1 / 3 + 0.125, 2 / 3 + 0.5),
        ((x**3 + t * x) / x, 0.25 + 0.25, 0.5),
        ((x * x - t * t) / (x - t), 1 / 3 + 0.25, 0.5),
    ],
)
def test_moments_of_quotients_that_are_polynomials(e: object, value: float, slope: float, backend: str) -> None:
    """Over y < x."""
    f = teg.compile(teg.integral(e * teg.bracket(x > y), *TRIANGLE), [t], backend=backend)  # type: ignore[operator]
    assert f(t=0.5) == pytest.approx(value, rel=1e-12)
    assert f.grad(t=0.5)["t"] == pytest.approx(slope, rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_bids_in_a_first_price_auction(backend: str) -> None:
    """A value x bids x - ∫ₜˣ (s/x)⁴ ds; the largest of five values has the density 5x⁴."""
    s = teg.var("s")
    shade = teg.integral(teg.bracket((s > t) & (s < x)) * (s / x) ** 4, (s, 0, 1))
    f = teg.compile(teg.integral(teg.bracket(x > t) * (x - shade) * 5 * x**4, (x, 0, 1)), [t], backend=backend)
    for reserve in (0.2, 0.5):
        expected = 5 * (1 - reserve**6) / 6 - (1 - reserve**6) / 6 + reserve**5 * (1 - reserve)
        assert f(t=reserve) == pytest.approx(expected, rel=1e-12)
        slope = -4 * reserve**5 + 5 * reserve**4 * (1 - reserve) - reserve**5
        assert f.grad(t=reserve)["t"] == pytest.approx(slope, abs=1e-12)
        curvature = 20 * reserve**3 - 50 * reserve**4
        assert f.hessian(t=reserve)["t", "t"] == pytest.approx(curvature, abs=1e-10)


def test_a_branch_that_is_0_where_a_condition_holds() -> None:
    """It guards as one that is 0 where a condition does not hold."""
    c, d, v = x > 0, y > t, x * teg.sqrt(y)
    assert teg.where(c, teg.where(d, 0, v), 0) is teg.where(c & ~d, v, 0)
    assert teg.where(c, 0, teg.where(d, v, 0)) is teg.where(~c & d, v, 0)
    assert teg.where(c, 0, teg.where(d, 0, v)) is teg.where(~c & ~d, v, 0)
    assert scaled_integral(teg.where(d, 0, v), x, ZERO, ONE) is teg.where(d, 0, teg.sqrt(y) * teg.integral(x, (x, 0, 1)))


def test_alternatives_that_differ_in_one_condition_and_its_negation() -> None:
    c, d, v = x > 0, y > t, x < t
    assert (c & d & v) | (~c & d & v) is d & v
    assert (c & d) | (d & ~c) is d
    assert (c & d) | (~c & v) is not d
    assert (c & d) | (~c & d & v) is not d


def test_sums_in_sums_are_collected() -> None:
    first, second = t + 2 * x + y * (x - 0.5) ** 3, t + x
    assert collected(first - second - x) is y * (x - 0.5) ** 3
    assert collected(-(first - t)) is -2 * x - y * (x - 0.5) ** 3
