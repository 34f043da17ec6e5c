"""Forward mode: Leibniz' rule with jumps, deltas visible."""

from __future__ import annotations

import pytest

import teg
from teg import errors
from teg.expr import ONE, ZERO
from teg.passes.differentiate import tangent_of

x, y, z = teg.vars("x y z")
t, a = teg.params("t a")


def d(e: teg.Expr) -> teg.Expr:
    return tangent_of(e, {t: ONE})


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (t, ONE),
        (a, ZERO),
        (t**3, 3 * t**2),
        (teg.sin(t * a), a * teg.cos(t * a)),
        (teg.exp(t), teg.exp(t)),
        (1 / t, -(t**-2)),
        (teg.sqrt(t), 0.5 / teg.sqrt(t)),
        (teg.integral(x * t, (x, 0, 1)), teg.integral(x, (x, 0, 1))),
        (teg.integral(x, (x, 0, t)), t),
        (teg.integral(x, (x, t, 1)), -t),
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), teg.integral(teg.delta(t - x), (x, 0, 1))),
        (teg.integral(teg.bracket(x < t) * teg.bracket(x < t), (x, 0, 1)), teg.integral(teg.delta(t - x), (x, 0, 1))),
        (teg.integral(teg.abs(x - t), (x, 0, 1)), teg.integral(teg.where(x > t, -1, 1), (x, 0, 1))),
        (teg.bracket(t < a) * t, teg.bracket(t < a)),
        (teg.tuple(t, t * a), teg.tuple(1, a)),
        (teg.bracket(z < t), teg.delta(t - z)),
    ],
    ids=lambda e: str(e),
)
def test_normal_form(e: teg.Expr, expected: teg.Expr) -> None:
    assert d(e) is expected


def test_a_direction() -> None:
    assert tangent_of(t * a, {t: ONE, a: teg.expr.const(2)}) is a + 2 * t


def test_directions_may_be_expressions() -> None:
    assert teg.jvp(t * a, {t: a}) is a**2


def test_deltas_of_an_integral_over_one_more_variable() -> None:
    e = teg.integral(teg.diff(teg.bracket(z < t), t), (z, 0, 1))
    assert teg.evaluate(e, {t: 0.4}) == 1.0
    assert teg.evaluate(e, {t: 1.4}) == 0.0


def test_a_delta_is_not_differentiated() -> None:
    with pytest.raises(errors.DeltaError):
        d(teg.integral(teg.delta(t - x) * x, (x, 0, 1)))


def test_derivatives_nest() -> None:
    e = teg.integral(teg.bracket(x < t) * x**3, (x, 0, 1))
    orders = [t**4 / 4, t**3, 3 * t**2, 6 * t, 6.0 + 0 * t]
    for exact in orders:
        assert teg.evaluate(e, {t: 0.5}) == pytest.approx(float(teg.evaluate(exact, {t: 0.5})), rel=1e-14)
        e = teg.diff(e, t)


@pytest.mark.parametrize("name", ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs"])
def test_derivatives_of_functions(name: str) -> None:
    f = teg.compile(getattr(teg, name)(t) + teg.atan2(t, a) + t**a + a**t + teg.mod(t, a) + teg.floor(t), [t, a])
    assert teg.check_gradient(f, t=0.37, a=0.83)
