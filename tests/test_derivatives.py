"""Derivatives by variables inside of an integrand, and parts of a program whose jumps do not move."""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
import pytest

import teg
from teg import errors

x, y, s = teg.vars("x y s")
t, a = teg.params("t a")
V, k = teg.array("V"), teg.index("k")
BACKENDS = ["numpy", "c", "jax"]


@pytest.fixture(autouse=True)
def enabled() -> Any:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


# -- by a variable --------------------------------------------------------------------------------------------------------


def test_the_derivative_by_a_variable() -> None:
    assert teg.diff(x**2 * t, x) is 2 * x * t
    assert str(teg.diff(teg.bracket(x < t), x)) == "-δ(t - x)"
    assert str(teg.diff(teg.integral(teg.bracket(s < x) * s, (s, 0, 1)), x)) == "∫[s: 0..1] s·δ(x - s)"
    assert teg.diff(x + teg.integral(x, (x, 0, x)), x) is x + 1  # the bound moves, the integral's own variable does not
    assert teg.grad(x * y * t, [x, t]) is teg.tuple(y * t, x * y)
    assert teg.grad(teg.tuple(x, x * y), [x, y]) is teg.tuple((1, 0), (y, x))
    assert teg.jvp(x * y, {x: 2, y: t}) is 2 * y + t * x
    assert teg.diff(x, y) is teg.diff(x, t) is teg.substitute(x, {x: 0})


@pytest.mark.parametrize(
    "mistake",
    [lambda: teg.diff(t**3, t, 2), lambda: teg.diff(t * a, t, a), lambda: teg.grad(t * a, t, a), lambda: teg.hessian(t * a, t, a)],
)  # fmt: skip
def test_an_order_or_a_second_parameter_is_no_list_of_maps(mistake: Any) -> None:
    with pytest.raises(errors.OptionError) as caught:
        mistake()
    assert "teg.diff(teg.diff(e, t), t)" in caught.value.hint
    assert "teg.grad(e, [t, a])" in caught.value.hint


FUNCTIONS = ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "sqrt", "erf", "erfc"]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_derivative_of_each_function(name: str) -> None:
    f = teg.compile(getattr(teg, name)(t) + a * getattr(teg, name)(t * a), [t, a])
    place, rate = mpmath.mpf(0.3), mpmath.mpf(1.7)
    true = getattr(mpmath, name)
    _, slopes = f.value_and_grad(t=0.3, a=1.7)
    assert slopes["t"] == pytest.approx(float(mpmath.diff(lambda v: true(v) + rate * true(v * rate), place)), rel=1e-12)
    assert slopes["a"] == pytest.approx(float(mpmath.diff(lambda v: v * true(place * v), rate)), rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_integral_of_a_derivative_is_the_change(backend: Any) -> None:
    """∫₀¹ ∂e/∂x dx = e(1) - e(0), jumps included, and its derivatives."""
    e = teg.bracket(x < t) * teg.exp(a * x) + teg.sin(x) * a
    f = teg.compile(
        teg.tuple(teg.integral(teg.diff(e, x), (x, 0, 1)), teg.integral(x * teg.diff(teg.bracket(x < t), x), (x, 0, 1))),
        [t, a],
        backend=backend,
    )
    value, gradient = f.value_and_grad(0.3, 2.0)
    assert value == pytest.approx((2 * math.sin(1) - 1, -0.3), rel=1e-13)
    assert gradient["t"] == pytest.approx((0.0, -1.0), abs=1e-13)
    assert gradient["a"] == pytest.approx((math.sin(1), 0.0), abs=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_divergence_theorem_on_a_disk(backend: Any) -> None:
    """∫∫ ∂[disk]/∂x·x dx dy = -π·t: the flow through the circle."""
    disk = teg.bracket(x * x + y * y < t)
    f = teg.compile(teg.integral(x * teg.diff(disk, x), (x, -2, 2), (y, -2, 2)), backend=backend)
    assert f(t=0.8) == pytest.approx(-math.pi * 0.8, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_derivative_by_a_variable_through_a_sum(backend: Any) -> None:
    steps = teg.sum(teg.bracket(x < V[k]) * V[k], (k, 0, 3))
    f = teg.compile(teg.integral(x * teg.diff(steps, x), (x, 0, 1)), backend=backend)
    value, gradient = f.value_and_grad(V=[0.2, 0.5, 0.7])
    assert value == pytest.approx(-0.78, rel=1e-13)
    np.testing.assert_allclose(gradient["V"], [-0.4, -1.0, -1.4], rtol=1e-13)


def test_what_is_no_derivative_by_a_variable() -> None:
    e = teg.integral(x * t, (x, 0, 1))
    with pytest.raises(errors.ScopeError, match="integrated over"):
        teg.diff(e, x)
    for wrong in ([x], "x", x + 1, x < 1, None):
        with pytest.raises(errors.ParameterError):
            teg.diff(e, wrong)  # type: ignore[call-overload]


# -- jumps that do not move -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_jumps_of_a_part_do_not_move(backend: Any) -> None:
    """F(t, a; t̄, ā) with the conditions at t̄, ā: the derivatives by t and a, at t̄ = t and ā = a."""
    moving, fixed = teg.bracket(x + y < t), teg.stop_delta(teg.bracket(x < a) * a)
    f = teg.compile(teg.integral(moving * fixed, (x, 0, 1), (y, 0, 1)), [t, a], backend=backend)
    value, gradient = f.value_and_grad(0.9, 0.4)
    area = 0.4 * 0.9 - 0.4**2 / 2
    assert value == pytest.approx(0.4 * area, rel=1e-14)
    assert gradient == pytest.approx({"t": 0.4 * 0.4, "a": area}, rel=1e-13)
    assert f.hessian(0.9, 0.4) == pytest.approx({("t", "t"): 0.0, ("t", "a"): 0.4, ("a", "t"): 0.4, ("a", "a"): 0.0}, abs=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_jumps_of_a_part_of_a_sum_do_not_move(backend: Any) -> None:
    each = teg.integral(teg.stop_delta(teg.bracket(x < V[k]) * V[k]) + teg.bracket(x < V[k] ** 2), (x, 0, 1))
    f = teg.compile(teg.sum(each, (k, 0, teg.length(V))), backend=backend)
    at = np.array([0.2, 0.5, 0.7])
    value, gradient = f.value_and_grad(V=at)
    assert value == pytest.approx(2 * (at**2).sum(), rel=1e-14)
    np.testing.assert_allclose(gradient["V"], 3 * at, rtol=1e-13)
    np.testing.assert_allclose(f.hvp({"V": at}, {"V": np.ones(3)})["V"], 2.0, rtol=1e-13)


@pytest.mark.parametrize(
    "e",
    [
        teg.bracket((x < t) & (a * x < 0.5)) * t,
        teg.where(x < t, t * x, a),
        teg.abs(x - t) + teg.maximum(x, t, a),
        teg.floor(3 * t * x) * x + teg.mod(t + x, a),
        teg.bracket(teg.integral(teg.bracket(s < t), (s, 0, x)) < a) * (x + t),
        teg.function("edge", [s], teg.bracket(s < t) * s)(x * a) * t,
        teg.tuple(teg.bracket(x < t), teg.sign(x - t) * t),
    ],
    ids=["bracket", "where", "kinks", "steps", "nested", "function", "tuple"],
)
def test_the_value_stays_and_the_derivative_is_that_between_jumps(e: teg.Expr) -> None:
    whole, part = (
        teg.compile(teg.integral(u, (x, 0, 1)), [t, a], discontinuities=d) for u, d in ((e, "ignore"), (teg.stop_delta(e), "exact"))
    )
    at = {"t": 0.37, "a": 0.81}
    np.testing.assert_allclose(part(at), whole(at), rtol=1e-12)
    for name, slope in whole.grad(at).items():
        np.testing.assert_allclose(part.grad(at)[name], slope, rtol=1e-9, atol=1e-12)


def test_a_choice_whose_cells_do_not_move() -> None:
    key = (x - V[k]) ** 2
    cells = teg.nearest(V[k], key, (k, 0, teg.length(V)))
    f = teg.compile(teg.integral(teg.stop_delta(cells), (x, 0, 1)))
    value, gradient = f.value_and_grad(V=[0.2, 0.6])
    assert value == pytest.approx(0.4 * 0.2 + 0.6 * 0.6, rel=1e-13)
    np.testing.assert_allclose(gradient["V"], [0.4, 0.6], rtol=1e-12)
    least = teg.minimum_of(key, (k, 0, teg.length(V)))  # is continuous: its cells need not move
    stopped, moved = (teg.compile(teg.integral(e, (x, 0, 1))).grad(V=[0.2, 0.7])["V"] for e in (teg.stop_delta(least), least))
    np.testing.assert_allclose(stopped, moved, rtol=1e-12, atol=1e-14)


def test_it_prints_and_explains_what_does_not_move() -> None:
    e = teg.stop_delta(teg.bracket(x < t))
    assert str(e) == "[x < stop(t)]"
    assert teg.latex(e) == r"\left[\,x < \overline{t}\,\right]"
    assert teg.latex(teg.stop_delta(teg.bracket(x < V[k]))) == r"\left[\,x < \overline{V_{k}}\,\right]"
    assert teg.stop_delta(x < t) is teg.stop_delta(teg.where(x < t, 1, 2)).children[0]
    assert teg.diff(teg.integral(e, (x, 0, 1)), t) is teg.diff(x, t)
    assert teg.stop_delta(e) is e
    assert str(teg.substitute(e, {t: a + 1})) == "[x < stop(a) + 1]"
    report = teg.explain(teg.integral(e * t, (x, 0, 1)))
    assert {surface["status"] for surface in report.data["surfaces"]}.isdisjoint({"eliminated", "stuck"})
    with pytest.raises(errors.OperandError, match="stop_delta"):
        teg.function("f", [t], teg.stop_delta(teg.bracket(t > 0)))
