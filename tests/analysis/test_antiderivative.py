"""Integrals in closed form, and conditions on such integrals."""

from __future__ import annotations

import warnings

import pytest

import teg
from teg import Expr
from teg.analysis.antiderivative import integrated
from teg.analysis.evaluate import values_of
from teg.ir.integral import Integral

w, x = teg.vars("w x")
t = teg.param("t")
bracket, integral = teg.bracket, teg.integral


def value(body: Expr, lo: float = 0.0, hi: float = 2.0, **at: float) -> float:
    node = integral(body, (w, lo, hi))
    assert isinstance(node, Integral)
    closed = integrated(node)
    assert closed is not None
    return float(values_of([closed], {x: at.get("x", 0.7), t: at.get("t", 0.3)})[0])


@pytest.mark.parametrize("r", [-1.0, 0.0, 0.7, 2.0, 5.0])
def test_a_condition_divides_the_polynomial(r: float) -> None:
    m = min(max(r, 0.0), 2.0)
    assert value(bracket(w < x) * w * w, x=r) == pytest.approx(m**3 / 3, abs=1e-15)
    assert value(bracket(w > x) * (w + t), x=r) == pytest.approx((4 - m * m) / 2 + 0.3 * (2 - m), abs=1e-15)
    assert value(teg.where(3 - 2 * w > x, w, 1), x=r) == pytest.approx(
        (lambda k: k * k / 2 + 2 - k)(min(max((3 - r) / 2, 0.0), 2.0)), abs=1e-15
    )


def test_several_conditions() -> None:
    inside = bracket((w > t) & (w < x))
    assert value(inside, t=0.5, x=1.25) == pytest.approx(0.75)
    assert value(inside, t=1.5, x=1.25) == 0.0
    assert value(teg.where(w > t, teg.where(w < x, w, -1), 3), t=0.5, x=1.5) == pytest.approx(1.5 + 1.0 - 0.5)


@pytest.mark.parametrize(
    "body",
    [bracket(w * w < x), bracket(w * x < t), bracket(teg.sin(w) < x), teg.exp(w) * bracket(w < x)],
    ids=["square", "slope without a sign", "sine", "no polynomial"],
)
def test_other_integrals_are_left(body: Expr) -> None:
    node = integral(body, (w, 0, 2))
    assert isinstance(node, Integral)
    assert integrated(node) is None


def test_bounds_of_unknown_order_are_left() -> None:
    node = integral(bracket(w < x), (w, t, 1))
    assert isinstance(node, Integral)
    assert integrated(node) is None


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("at", [0.2, 0.7])
def test_a_condition_on_an_integral_moves(backend: str, at: float) -> None:
    """∫ over w of [w < tx] is tx below 1; ∫ w·[w < x] is x²/2."""
    first = integral(bracket(integral(bracket(w < t * x), (w, 0, 1)) > 0.125), (x, 0, 1))
    second = integral(x * bracket(integral(w * bracket(w < x), (w, 0, 1)) > t / 2), (x, 0, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        f = teg.compile(first, [t], backend=backend)
        g = teg.compile(second, [t], backend=backend)
        assert f(t=at) == pytest.approx(1 - 0.125 / at, rel=1e-12)
        assert f.grad(t=at)["t"] == pytest.approx(0.125 / at**2, rel=1e-12)
        assert g(t=at) == pytest.approx(2 - at / 2, rel=1e-12)
        assert g.grad(t=at)["t"] == pytest.approx(-0.5, rel=1e-12)
