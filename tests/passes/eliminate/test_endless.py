"""Surfaces whose variables run to infinity: planes, ellipses and surfaces with formulas stay in their coordinates, without a warning."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath as mp
import pytest

import teg
from teg.analysis.tails import is_unbounded
from teg.ir.integral import Delta, Integral
from teg.ir.node import postorder
from teg.passes.eliminate.families import is_endless
from teg.passes.normalise.finite_bounds import with_finite_bounds

x, y, z = teg.vars("x y z")
t, a, b = teg.params("t a b")
OO = math.inf
PLANE = (x, -OO, OO), (y, -OO, OO)
BACKENDS = ("numpy", "c")
AT = {"t": 0.9, "a": 1.3, "b": 0.7}


def normal(v: teg.Expr) -> teg.Expr:
    return teg.exp(-v * v / 2) / math.sqrt(2 * math.pi)


def secant(v: teg.Expr) -> teg.Expr:
    return 1 / teg.cosh(v)


def chance(condition: teg.Cond) -> teg.Expr:
    """The probability of a condition on two normal numbers."""
    return teg.integral(normal(x) * normal(y) * teg.bracket(condition), *PLANE)


def below(at: tuple[float, ...]) -> mp.mpf:
    """P(aX + bY < t) = Φ(t/√(a² + b²))."""
    s, p, q = at
    return mp.ncdf(s / mp.sqrt(p * p + q * q))


@pytest.mark.parametrize("backend", BACKENDS)
def test_half_planes_of_normal_numbers(backend: str) -> None:
    f = teg.compile(chance(a * x + b * y < t), [t, a, b], backend=backend)
    for at in ((0.4, 1.3, 0.7), (0.4, -1.3, 0.7), (-2.0, 0.0, 0.7), (0.4, 0.5, 0.0), (0.4, 1.0, 1.0), (0.3, 1e-6, 2.0), (0.3, 1e3, 2.0)):
        value, gradient = f.value_and_grad(*at)
        assert value == pytest.approx(float(below(at)), rel=1e-11)
        for k, name in enumerate("tab"):
            slope = mp.diff(lambda *p: below(p), at, tuple(int(i == k) for i in range(3)))
            assert gradient[name] == pytest.approx(float(slope), rel=1e-11, abs=1e-15), (at, name)
    hessian = f.hessian(0.4, 1.3, 0.7)
    for i, p in enumerate("tab"):
        for j, q in enumerate("tab"):
            orders = tuple(int(i == k) + int(j == k) for k in range(3))
            assert hessian[p, q] == pytest.approx(float(mp.diff(lambda *v: below(v), (0.4, 1.3, 0.7), orders)), rel=1e-9, abs=1e-12)


def test_a_half_plane_of_normal_numbers_has_a_closed_form() -> None:
    """The gradient took 8016 evaluations in finite coordinates, and its estimate was infinite."""
    assert teg.compile(teg.diff(chance(x + a * y < t), t)).evaluations(t=0.4, a=1.3) == 0


CASES: dict[str, tuple[teg.Expr, Callable[[], Any]]] = {
    "a strip": (
        teg.integral(normal(y) * teg.cos(x) * teg.bracket(a * x + b * y < t), (x, 0, 1), (y, -OO, OO)),
        lambda: mp.quad(lambda u: mp.npdf((AT["t"] - AT["a"] * u) / AT["b"]) * mp.cos(u) / AT["b"], [0, 1]),
    ),
    "a quarter": (
        teg.integral(teg.exp(-x - 2 * y) * teg.bracket(a * x + b * y < t), (x, 0, OO), (y, 0, OO)),
        lambda: mp.quad(lambda u: mp.exp(-u - 2 * (AT["t"] - AT["a"] * u) / AT["b"]) / AT["b"], [0, AT["t"] / AT["a"]]),
    ),
    "from infinity": (
        teg.integral(teg.exp(-x - 2 * y) * teg.bracket(a * x + b * y < t), (x, OO, 0), (y, 0, OO)),
        lambda: -mp.quad(lambda u: mp.exp(-u - 2 * (AT["t"] - AT["a"] * u) / AT["b"]) / AT["b"], [0, AT["t"] / AT["a"]]),
    ),
    "bounds that slant": (
        teg.integral(normal(x) * normal(y) * teg.bracket(x + b * y < t), (x, -OO, y), (y, -OO, OO)),
        lambda: mp.quad(lambda u: mp.npdf(u) * mp.npdf(AT["t"] - AT["b"] * u), [AT["t"] / (1 + AT["b"]), 1, 3, 12]),
    ),
    "no normal numbers": (
        teg.integral(secant(x) * normal(y) * teg.bracket(a * x + b * y < t), *PLANE),
        lambda: mp.quad(lambda u: mp.npdf(u) * mp.sech((AT["t"] - AT["b"] * u) / AT["a"]) / AT["a"], [-12, -2, 0, 2, 12]),
    ),
    "three variables": (
        teg.integral(normal(x) * normal(y) * normal(z) * teg.bracket(a * x + b * y + z < t), *PLANE, (z, -OO, OO)),
        lambda: mp.npdf(AT["t"] / mp.sqrt(AT["a"] ** 2 + AT["b"] ** 2 + 1)) / mp.sqrt(AT["a"] ** 2 + AT["b"] ** 2 + 1),
    ),
    "a disk": (chance(x * x + y * y < t), lambda: mp.exp(-AT["t"] / 2) / 2),
    "an ellipse": (
        chance(a * x * x + x * y + b * y * y < t),
        lambda: mp.quad(lambda v: mp.exp(-AT["t"] / (2 * form(v))) / (4 * mp.pi * form(v)), mp.linspace(0, 2 * mp.pi, 9)),
    ),
    "a parabola": (chance(x * x < t + y), lambda: mp.quad(lambda u: mp.npdf(u) * mp.npdf(u * u - AT["t"]), [-4, -1, 0, 1, 4])),
    "a cubic": (chance(x**3 + y < t), lambda: mp.quad(lambda u: mp.npdf(u) * mp.npdf(AT["t"] - u**3), [-3, -1, 0, 1, 2, 3])),
    "exponentials": (
        chance(teg.exp(x) + teg.exp(y) < 3 * t),
        lambda: mp.quad(lambda u: 3 * mp.npdf(u) * mp.npdf(mp.log(rest(u))) / rest(u), [-12, -3, 0, 0.5, mp.log(3 * AT["t"])]),
    ),
}
"""A program with a surface that runs to infinity, and its derivative by t."""


def form(angle: Any) -> Any:
    return AT["a"] * mp.cos(angle) ** 2 + mp.cos(angle) * mp.sin(angle) + AT["b"] * mp.sin(angle) ** 2


def rest(u: Any) -> Any:
    return 3 * AT["t"] - mp.exp(u)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", CASES)
def test_derivatives(name: str, backend: str) -> None:
    e, expected = CASES[name]
    f = teg.compile(e, [t, a, b], backend=backend)
    gradient, errors = f.grad_and_error(AT)
    assert gradient["t"] == pytest.approx(float(expected()), rel=1e-9)
    assert errors["t"] < 1e-9


@pytest.mark.parametrize("name", ["a quarter", "a disk", "a parabola"])
@pytest.mark.usefixtures("x64")
def test_derivatives_in_jax(name: str) -> None:
    e, expected = CASES[name]
    assert teg.compile(e, [t, a, b], backend="jax").grad(AT)["t"] == pytest.approx(float(expected()), rel=1e-9)


PAIRS = {
    "a disk": x * x + y * y < t,
    "a parabola and a line": (x * x < t + y) & (x + y < b),
    "a disk and a line": (x * x + y * y < t) & (a * x + b * y < 0.8),
    "two lines": (a * x + b * y < t) & (x - y < 0.8),
}


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("link", [lambda u: u, lambda u: 1 / (1 + teg.exp(-u)), teg.erf], ids=["identity", "logit", "probit"])
def test_a_regression_whose_slope_is_0(link: Callable[[teg.Expr], teg.Expr], backend: Any, x64_for_jax: None) -> None:
    """[link(a + b·x) > t] at b = 0, where the surface is at infinity: the gradient is 0 under a normal density, and was NaN."""
    f = teg.compile(teg.integral(normal(x) * teg.bracket(link(a + b * x) > t), (x, -OO, OO)), [t, a, b], backend=backend)
    value, gradient = f.value_and_grad(t=0.1, a=3.0, b=0.0)
    assert value == pytest.approx(1.0, rel=1e-12)
    assert set(gradient.values()) == {0.0}
    assert not f.diagnose(t=0.1, a=3.0, b=0.0)


def test_a_regression_whose_slope_is_0_under_a_heavy_tail() -> None:
    """Under a Cauchy density the derivative by b jumps at b = 0: a surface that comes from infinity has π·∂ = ∓1/(a - t)."""
    f = teg.compile(teg.integral(teg.bracket(a + b * x > t) / (1 + x * x), (x, -OO, OO)), [t, a, b], backend="numpy")
    assert f.grad(t=0.1, a=0.3, b=1e-9)["b"] == pytest.approx(-5.0, rel=1e-9)
    (found,) = f.diagnose(t=0.1, a=0.3, b=0.0)
    assert found.kind == "one-sided"


def test_no_derivative_where_a_surface_is_everywhere() -> None:
    """P(a + b·X > t) jumps where a = t and b = 0."""
    f = teg.compile(teg.integral(normal(x) * teg.bracket(a + b * x > t), (x, -OO, OO)), [t, a, b], backend="numpy")
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f.grad(t=0.3, a=0.3, b=0.0)["a"])


@pytest.mark.parametrize("name", PAIRS)
def test_second_derivatives(name: str) -> None:
    """Against differences of the gradient. Contributions of bounds at infinity were 0·∞."""
    f, h = teg.compile(chance(PAIRS[name]), [t, a, b], backend="c"), 1e-3
    hessian = f.hessian(AT)
    for p in "tab":
        at = {k: f.grad({**AT, p: AT[p] + k * h}) for k in (-3, -2, -1, 1, 2, 3)}
        for q in "tab":
            quotient = (45 * (at[1][q] - at[-1][q]) - 9 * (at[2][q] - at[-2][q]) + (at[3][q] - at[-3][q])) / (60 * h)
            assert hessian[p, q] == pytest.approx(quotient, rel=1e-7, abs=1e-8), (p, q)


def test_a_plane_shares_the_finite_coordinates_of_another_surface() -> None:
    """Else the plane would be a curve in one finite variable and an infinite one."""
    plane, quartic = teg.delta(a * x + b * y - t), teg.delta(x**4 + z**4 + x * z - t)
    e = teg.integral((plane + quartic) * teg.exp(-x * x - y * y - z * z), *PLANE, (z, -OO, OO))
    assert not any(is_unbounded(n) for n in postorder([with_finite_bounds(e, is_endless)]) if isinstance(n, Integral))


@pytest.mark.parametrize(
    ("surface", "stays"),
    [(a * x + b * y - t, True), (x * x + y * y - t, True), (x * x - y - t, True), (x * y - t, True), (x**4 + x * y + y**4 - t, False)],
    ids=["plane", "disk", "parabola", "hyperbola", "quartic"],
)
def test_which_surfaces_stay(surface: teg.Expr, stays: bool) -> None:
    e = teg.integral(teg.delta(surface) * teg.exp(-x * x - y * y), *PLANE)
    mapped = with_finite_bounds(e, is_endless)
    assert any(isinstance(n, Delta) for n in postorder([mapped]))
    assert (mapped is e) == stays
    assert any(is_unbounded(n) for n in postorder([mapped]) if isinstance(n, Integral)) == stays
