"""`teg.substitute` and `teg.let`: values, capture, integers, and what is refused."""

from __future__ import annotations

import math

import pytest

import teg
from teg import errors

x, y, u, v = teg.vars("x y u v")
t, a, n = teg.params("t a n")
V, k = teg.array("V"), teg.index("k")


def test_everything_is_replaced_at_once() -> None:
    assert teg.substitute(x**2 + t, {x: t + 1}) is (t + 1) ** 2 + t
    assert teg.substitute(teg.tuple(x, (t, 1)), {x: t, t: x}) is teg.tuple(t, (x, 1))
    assert teg.substitute((x < t) & (t < a), {t: 3}) is ((x < 3) & (a > 3))
    assert teg.substitute(x + t, {}) is x + t
    assert teg.substitute(x, {y: t}) is x


def test_the_variables_of_integrals_are_their_own() -> None:
    e = teg.integral(x * y, (x, 0, x))
    assert teg.substitute(e, {x: t}) is teg.integral(x * y, (x, 0, t))  # the bound is outside of the integral
    f = teg.compile(teg.integral(teg.substitute(teg.integral(x * t, (x, 0, 1)), {t: x}), (x, 0, 3)))
    assert f() == pytest.approx(0.5 * 4.5, rel=1e-14)  # x is not captured by the inner integral


def test_the_indices_of_sums_are_their_own() -> None:
    e = teg.sum(V[k] * x, (k, 0, teg.length(V)))
    f = teg.compile(teg.sum(teg.substitute(e, {x: V[k]}), (k, 0, teg.length(V))))
    assert f(V=[1.0, 2.0]) == 9.0
    assert "V[k′]·V[k]" in str(teg.substitute(e, {x: V[k]}))


def test_a_parameter_that_is_an_integer_becomes_one() -> None:
    e = teg.sum(V[k] * n, (k, 0, n))
    assert teg.evaluate(teg.substitute(e, {n: 2}), V=[1.0, 2.0, 3.0]) == 6.0
    assert teg.evaluate(teg.substitute(e, {n: t}), V=[1.0, 2.0, 3.0], t=3) == 18.0
    with pytest.raises(errors.ArrayIndexError):
        teg.substitute(e, {n: 0.5})


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_parametrised_surface(backend: str) -> None:
    e = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
    f = teg.compile(teg.substitute(e, {t: teg.sin(a) * 2}), backend=backend)  # type: ignore[arg-type]
    value, gradient = f.value_and_grad(a=0.3)
    s = 2 * math.sin(0.3)
    assert value == pytest.approx(s * s / 2, rel=1e-14)
    assert gradient["a"] == pytest.approx(s * 2 * math.cos(0.3), rel=1e-14)


def test_names_for_parts() -> None:
    e = teg.let({u: x - t, "v": u**2}, teg.exp(-v) * u)
    assert e is teg.exp(-((x - t) ** 2)) * (x - t)
    assert teg.size(teg.let({u: teg.sin(x)}, u * u + u)) == teg.size(teg.sin(x) * teg.sin(x) + teg.sin(x))
    assert teg.let({u: t, v: u + 1}, x < v) is (x < t + 1)


@pytest.mark.parametrize(
    ("mistake", "kind"),
    [
        (lambda: teg.substitute(x, {"x": 1}), errors.ParameterError),  # type: ignore[dict-item]
        (lambda: teg.substitute(x, [(x, 1)]), errors.ParameterError),  # type: ignore[arg-type]
        (lambda: teg.substitute(x, {x + 1: 1}), errors.ParameterError),  # type: ignore[dict-item]
        (lambda: teg.substitute(x, {x: "one"}), errors.OperandError),  # type: ignore[dict-item]
        (lambda: teg.substitute("x", {x: 1}), errors.OperandError),  # type: ignore[type-var]
        (lambda: teg.let({u: u + 1}, u), errors.ScopeError),
        (lambda: teg.let({u: v, v: 1}, u), errors.ScopeError),
        (lambda: teg.let({"t": x}, x + t), errors.ScopeError),
        (lambda: teg.let({"t": x, u: t + 1}, x < u), errors.ScopeError),
        (lambda: teg.let({u: 1, "u": 2}, u), errors.OperandError),
        (lambda: teg.let([u], u), errors.ParameterError),  # type: ignore[arg-type]
    ],
)
def test_mistakes(mistake: object, kind: type[errors.TegError]) -> None:
    with pytest.raises(kind):
        mistake()  # type: ignore[operator]
