"""Limits at a surface on which a denominator vanishes: jumps of u/|u| and its kin."""

from __future__ import annotations

import math

import pytest

import teg
from teg.analysis.limits import Poles

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y = teg.vars("x y")
a, b = teg.params("a b")
u = x - a
v = x + b * y - a
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
A = 0.4
QUOTIENTS = {
    "a sign": (u / teg.abs(u), -2.0),
    "a sign by a maximum": (u / teg.maximum(u, -u), -2.0),
    "a cube": (u**3 / teg.abs(u) ** 3, -2.0),
    "in an exponential": (teg.exp(u / teg.abs(u)), 1 / math.e - math.e),
    "in a logarithm": (teg.log(2 + u / teg.abs(u)), -math.log(3.0)),
    "in a denominator": (1 / (3 + u / teg.abs(u)), 0.25),
    "in a sum": (u * (1 / teg.abs(u) + 1), -3.0),
    "a sine": (teg.sin(u) / teg.abs(u), -math.sin(A) / A - math.sin(1 - A) / (1 - A)),
    "two sines": (teg.sin(u) / teg.abs(teg.sin(u)), -2.0),
    "of second order": ((1 - teg.cos(u)) / (u * teg.abs(u)), -(1 - math.cos(A)) / A**2 - (1 - math.cos(1 - A)) / (1 - A) ** 2),
    "another multiple": (u / teg.abs(2 * x - 2 * a), -1.0),
    "a factor": ((x * x - a * a) / teg.abs(u), 1 - 6 * A),  # ∫ₐ¹(x + a) - ∫₀ᵃ(x + a) = ½ + a - 3a²
    "a root": (teg.sqrt(u * u) / u, -2.0),
    "beside a condition": (teg.bracket(x < 0.7) * u / teg.abs(u), -2.0),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", QUOTIENTS)
def test_quotients_jump(name: str, backend: str) -> None:
    """The derivative of ∫₀¹ is that of the closed form. It lacked the jump, without a warning."""
    e, slope = QUOTIENTS[name]
    f = teg.compile(teg.integral(e, (x, 0, 1)), backend=backend)
    assert f.grad(a=A)["a"] == pytest.approx(slope, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("weight", [teg.bracket(x < 2), teg.where(x < y, 1, x)], ids=["plain", "a weight that jumps"])
def test_quotients_jump_along_a_line(weight: teg.Expr, backend: str) -> None:
    """sin v/|v| is sinc times a sign: the same program in these words."""
    e = teg.integral(weight * teg.sin(v) / teg.abs(v) * x, (x, 0, 1), (y, 0, 1))
    sign = teg.where(v > 0, 1, -1)
    plain = teg.integral(
        weight * sign * (1 - v**2 / 6 + v**4 / 120 - v**6 / 5040 + v**8 / 362880 - v**10 / 39916800) * x, (x, 0, 1), (y, 0, 1)
    )
    at = {"a": 0.4, "b": 0.3}
    f, g = (teg.compile(p, backend=backend) for p in (e, plain))
    assert f.grad(**at) == pytest.approx(g.grad(**at), rel=1e-9)


def test_second_derivatives_of_signs() -> None:
    """∫₀¹ x·sign(x - a) = ½ - a²."""
    f = teg.compile(teg.integral(x * u / teg.abs(u), (x, 0, 1)))
    assert f.hessian(a=A)["a", "a"] == pytest.approx(-2.0, rel=1e-12)


def test_limits() -> None:
    poles = Poles(u)
    assert poles.limit(x / u) is x / u  # infinite
    assert poles.limit(x * y) is x * y
    assert poles.has(1 + x / u)
    assert not poles.has(x / (u + 1))
    limit = poles.limit(teg.sin(u) * y / u)
    assert isinstance(limit, teg.Expr)
    assert teg.evaluate(teg.substitute(limit, {x: a, y: b}), a=0.3, b=2.0) == pytest.approx(2.0, rel=1e-14)
