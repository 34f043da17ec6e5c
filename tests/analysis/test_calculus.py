"""Derivatives of smooth nodes, against differences in 40 digits."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg
from teg.analysis.calculus import factor_cofactors, partials, slope, value_children
from teg.analysis.evaluate import values_of
from teg.errors import NotDifferentiableError
from teg.ir.expr import ONE, ZERO, Call, Mul
from teg.ir.simplify import call

x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
ONE_ARGUMENT = ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "erf", "erfc", "sqrt"]


@pytest.mark.parametrize("name", ONE_ARGUMENT)
@pytest.mark.parametrize("at", [0.3, 0.85])
def test_functions_of_one_number(name: str, at: float) -> None:
    node = getattr(teg, name)(t)
    assert isinstance(node, Call)
    (rate,) = partials(node)
    exact = mpmath.diff(getattr(mpmath, name), at)
    assert float(values_of([rate], {t: at})[0]) == pytest.approx(float(exact), rel=1e-13)


@pytest.mark.parametrize(("e", "f"), [(teg.atan2(a, b), mpmath.atan2), (a**b, mpmath.power)])
def test_functions_of_two_numbers(e: teg.Expr, f: object) -> None:
    assert isinstance(e, Call)
    first, second = (float(v) for v in values_of(partials(e), {a: 0.7, b: 1.9}))
    assert first == pytest.approx(float(mpmath.diff(f, (0.7, 1.9), (1, 0))), rel=1e-13)
    assert second == pytest.approx(float(mpmath.diff(f, (0.7, 1.9), (0, 1))), rel=1e-13)


def test_cofactors_are_the_products_of_the_others() -> None:
    product = a * b * t
    assert isinstance(product, Mul)
    assert factor_cofactors(product) == [b * t, a * t, a * b]


def test_slopes_hold_conditions_constant() -> None:
    e = teg.where(x < t, x * t, x**3)
    assert slope(e, x) is teg.where(x < t, t, 3 * x**2)
    assert slope(e, a) is ZERO


def test_the_slope_of_an_integral_is_refused() -> None:
    with pytest.raises(NotDifferentiableError):
        slope(teg.integral(y * x, (y, 0, 1)), x)


def test_conditions_are_in_no_value_position() -> None:
    assert value_children(teg.where(x < t, a, b)) == (a, b)


@pytest.mark.usefixtures("x64_for_jax")
@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("k", [0.5, 1.0, 1.5, 4.2])
def test_a_positive_part_to_a_power_that_is_a_parameter(k: float, backend: str) -> None:
    """∫₀¹ max(x - t, 0)ᵏ = s^(k+1)/(k+1) with s = 1 - t. On the branch of 0 its derivative by k was 0·∞."""
    f = teg.compile(teg.integral(teg.maximum(x - t, 0) ** b, (x, 0, 1)), [t, b], backend=backend)
    value, gradient = f.value_and_grad(t=0.3, b=k)
    s, n = 0.7, k + 1
    whole, log = s**n / n, math.log(s)
    assert value == pytest.approx(whole, rel=1e-9)
    assert gradient == pytest.approx({"t": -(s**k), "b": whole * (log - 1 / n)}, rel=1e-9)
    hessian = f.hessian(t=0.3, b=k)
    expected = [k * s ** (k - 1), -(s**k) * log, -(s**k) * log, whole * ((log - 1 / n) ** 2 + 1 / n**2)]
    assert list(hessian.values()) == pytest.approx(expected, rel=1e-8)


def test_numbers_of_a_chart() -> None:
    """They are their argument, wherever expressions are read; one that is chosen does not move."""
    for name, rate in (("chosen", ZERO), ("exact", ONE)):
        node = call(name, t)
        assert isinstance(node, Call)
        assert partials(node) == [rate]
        assert values_of([node], {t: 0.75}) == [0.75]
        assert (str(node), teg.latex(node), teg.to_sympy(node)) == (str(t), teg.latex(t), teg.to_sympy(t))
        f = teg.compile(teg.integral(teg.bracket(x < node) * node, (x, 0, 1)), [t])
        assert f(t=0.75) == pytest.approx(0.5625)
        assert f.grad(t=0.75)["t"] == pytest.approx(1.5 if rate is ONE else 0.0)
