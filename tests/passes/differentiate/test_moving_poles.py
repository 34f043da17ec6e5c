"""Derivatives of integrals around poles that move: closed forms, by hand."""

from __future__ import annotations

import math
from itertools import permutations

import pytest

import teg
from teg.ir.integral import Integral
from teg.ir.traverse import parameters
from teg.passes.differentiate.moving_poles import around_poles
from teg.passes.normalise.canonicalise import Canonical

x, y, z = teg.vars("x y z")
a, b, s = teg.params("a b s")
square = (x - a) ** 2 + (y - b) ** 2
AT = {"a": 0.37, "b": 0.6}
BACKENDS = ["numpy", "c"]
ORDERS = [((x, 0, 1), (y, 0, 1)), ((y, 0, 1), (x, 0, 1))]
P, Q = (1 - AT["a"], AT["a"]), (1 - AT["b"], AT["b"])
"""The distances of the pole from the sides of the unit square."""


def logarithms(p: tuple[float, float], q: tuple[float, float]) -> float:
    """∫ over one variable of the jump of ½·log r² between the sides of the other one."""
    return 0.5 * sum(i * j * math.log(u * u + v * v) for i, u in zip((1, -1), p, strict=True) for j, v in zip((1, -1), q, strict=True))


def angles(p: tuple[float, float], q: tuple[float, float]) -> float:
    """The angle under which the sides across the second variable are seen from the pole."""
    return sum(math.atan(u / v) for u in p for v in q)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ranges", ORDERS, ids=["x inside", "y inside"])
def test_the_field_of_a_plate(ranges: tuple[tuple[teg.Var, int, int], ...], backend: str) -> None:
    """∫∫ (y - b)/r²: the derivative by b was off by 2π, since the integral over x jumps there."""
    f = teg.compile(teg.integral((y - b) / square, *ranges), [a, b], backend=backend)
    assert f.grad(AT) == pytest.approx({"a": -logarithms(P, Q), "b": -angles(P, Q)}, rel=1e-12)


@pytest.mark.usefixtures("x64")
def test_the_field_of_a_plate_in_jax() -> None:
    """Some pieces of the outer integral have no length and lie at the pole, where the inner one would be refined for minutes."""
    f = teg.compile(teg.integral((y - b) / square, *ORDERS[0]), [a, b], backend="jax")
    assert f.grad(AT) == pytest.approx({"a": -logarithms(P, Q), "b": -angles(P, Q)}, rel=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("ranges", ORDERS, ids=["x inside", "y inside"])
def test_second_derivatives_of_a_logarithmic_potential(ranges: tuple[tuple[teg.Var, int, int], ...], backend: str) -> None:
    """Their sum is ∫∫ Δ log r² = 4π."""
    found = teg.compile(teg.integral(teg.log(square), *ranges), [a, b], backend=backend).hessian(AT)
    assert found["a", "a"] == pytest.approx(2 * angles(Q, P), rel=1e-12)
    assert found["b", "b"] == pytest.approx(2 * angles(P, Q), rel=1e-12)
    assert found["a", "b"] == pytest.approx(2 * logarithms(P, Q), rel=1e-12)
    assert found["a", "a"] + found["b", "b"] == pytest.approx(4 * math.pi, rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_potential_of_a_plate(backend: str) -> None:
    f = teg.compile(teg.integral(1 / teg.sqrt(square), *ORDERS[0]), [a, b], backend=backend)
    along_a, along_b = (
        sum(-sign * sum(math.asinh(u / v) for u in p) for sign, v in zip((1, -1), q, strict=True)) for p, q in ((Q, P), (P, Q))
    )
    assert f.grad(AT) == pytest.approx({"a": along_a, "b": along_b}, rel=1e-9)


def test_an_ellipse_of_parameters() -> None:
    """By y = s·v the denominator is s²·r² in the range up to 1/s."""
    e = teg.integral((y - b) / (s**2 * (x - a) ** 2 + (y - b) ** 2), *ORDERS[0])
    found = teg.compile(e, [a, b, s], backend="numpy").grad(**AT, s=1.3)
    q = (Q[0] / 1.3, Q[1] / 1.3)
    assert (found["a"], found["b"]) == pytest.approx((-logarithms(P, q), -angles(P, q) / 1.3), rel=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pole_beside_other_factors(backend: str) -> None:
    """∫∫ x·(y - b)/r²: what is integrated over x jumps by 2π·a at the pole."""
    f = teg.compile(teg.integral(x * (y - b) / square, *ORDERS[0]), [a, b], backend=backend)

    def upper(v: float) -> float:
        """∫ x·v/((x - a)² + v²) dx"""
        return AT["a"] * (math.atan(P[0] / v) + math.atan(P[1] / v)) + 0.5 * v * math.log((P[0] ** 2 + v * v) / (P[1] ** 2 + v * v))

    assert f.grad(AT)["b"] == pytest.approx(upper(-Q[1]) - upper(Q[0]), rel=1e-12)


def test_poles_of_several_summands_and_of_one_product() -> None:
    """Beside differences of values, which are integrals without derivatives."""
    other = (x - 0.67) ** 2 + (y - s) ** 2
    at = {**AT, "s": 0.2}
    f = teg.compile(teg.integral((y - b) / square * (x - 0.67) / other, *ORDERS[0]), [a, b, s], backend="c")
    for name, found in f.grad(at).items():
        far, near = (f({**at, name: at[name] + h}) - f({**at, name: at[name] - h}) for h in (2e-3, 1e-3))
        assert found == pytest.approx((8 * near - far) / 12e-3, abs=1e-7)


@pytest.mark.parametrize("backend", BACKENDS)
def test_poles_at_proportional_places(backend: str) -> None:
    """The field of a plate at b, and at 2b or -b, is that of two poles: each has the derivative of one, times its speed."""
    for factor in (2.0, -1.0):
        e = teg.integral((y - b) / square + (y - factor * b) / ((x - a) ** 2 + (y - factor * b) ** 2), *ORDERS[0])
        at = {"a": 0.37, "b": 0.3}
        found = teg.compile(e, [a, b], backend=backend).grad(at)["b"]
        assert found == pytest.approx(-angles(P, (0.7, 0.3)) - factor * angles(P, (1 - 0.3 * factor, 0.3 * factor)), rel=1e-11)


def test_parts_of_a_range_stay_inside_of_it() -> None:
    """Both poles are below the range, in which the logarithm has a value."""
    other = (x - 0.67) ** 2 + (y - s) ** 2
    e = teg.integral((y - b) / square * (x - 0.67) / other * teg.log(y), (x, 0, 1), (y, 0.25, 1))
    at = {"a": 0.37, "b": -0.4, "s": -0.9}
    f = teg.compile(e, [a, b, s], backend="c")
    for name, found in f.grad(at).items():
        far, near = (f({**at, name: at[name] + h}) - f({**at, name: at[name] - h}) for h in (2e-3, 1e-3))
        assert found == pytest.approx((8 * near - far) / 12e-3, abs=1e-9)


def test_poles_at_rest_are_left_alone() -> None:
    fixed = (x - 0.3) ** 2 + (y - 0.2) ** 2
    for g in (fixed, square + 0.1, (x - a) ** 2 - (y - b) ** 2, (x - a) ** 4 + (y - b) ** 4, (x - a) ** 2 + (x - b) ** 2):
        e = teg.integral(1 / g, *ORDERS[0])
        assert around_poles(e, [a, b]) is e
    moving = teg.integral(y / square, *ORDERS[0])
    assert around_poles(moving, [s]) is moving
    once = around_poles(moving, [a, b])
    assert isinstance(once, Integral)
    assert (once.lo, once.hi) == (-b, 1 - b)
    assert around_poles(once, [a, b]) is once


@pytest.mark.parametrize("ranges", [*permutations(((x, 0, 1), (y, 0, 1), (z, 0, 1)))], ids=lambda r: "".join(v.name for v, *_ in r))
def test_a_pole_in_three_variables(ranges: tuple[tuple[teg.Var, int, int], ...]) -> None:
    """Parameters move the bounds, and no integrand."""
    e = around_poles(teg.integral((z - s) / (square + (z - s) ** 2), *ranges), [a, b, s])
    while isinstance(e, Integral):
        assert parameters(e.hi)
        e = e.body
    assert str(Canonical()(e)) == "z/(x² + y² + z²)"


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("weight", "slope"), [(1.0, -2.0), (y, -2 * AT["b"])], ids=["alone", "weighted"])
def test_an_infinite_integral_with_a_pole(weight: teg.Expr | float, slope: float, backend: str) -> None:
    """(y - b)·∫₀^∞ exp(-x·|y - b|) dx is the sign of y - b."""
    e = teg.integral(weight * (y - b) * teg.exp(-x * abs(y - b)), (x, 0, math.inf), (y, 0, 1))
    assert teg.compile(e, [b], backend=backend).grad(b=AT["b"])["b"] == pytest.approx(slope, rel=1e-12)


def test_infinite_integrals_that_decay_everywhere_are_left_alone() -> None:
    for rate in (abs(y - b) + 1, (y - s) ** 2, 1 + y):
        e = teg.integral(teg.exp(-x * rate), (x, 0, math.inf), (y, 0, 1))
        assert around_poles(e, [b]) is e
