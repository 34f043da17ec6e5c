"""Surfaces that approach each other without meeting, or meet at an end of a piece only: a tie there decides nothing elsewhere.

References are closed forms.
"""

from __future__ import annotations

import math

import mpmath
import pytest

import teg

x, y = teg.vars("x y")
t, a = teg.params("t a")


def between(low: teg.Expr, high: teg.Expr, lo: float = 0.0, hi: float = 1.0) -> teg.Expr:
    return teg.integral(teg.bracket(y > low) * teg.bracket(y < high), (x, lo, hi), (y, -2, 2))


def small(k: float) -> teg.Expr:
    return t * teg.exp(-k * x)


CASES = {
    "an exponential": (between(-small(100), small(100)), 2 * -math.expm1(-100) / 100),
    "in one condition": (teg.integral(teg.bracket(teg.abs(y) < small(100)), (x, 0, 1), (y, -2, 2)), 2 * -math.expm1(-100) / 100),
    "about another height": (between(0.3 - small(1000), 0.3 + small(1000)), 2 / 1000),
    "and a bound": (teg.integral(teg.bracket(y < small(100)), (x, 0, 1), (y, 0, 2)), -math.expm1(-100) / 100),
    "a power, from both sides": (between(-t * x**60, t * x**60, -1.0), 4 / 61),
    "a bump": (between(-t * teg.exp(-3000 * (x - 0.3) ** 2), t * teg.exp(-3000 * (x - 0.3) ** 2)), 2 * math.sqrt(math.pi / 3000)),
    "an asymptote": (
        between(teg.atan(x), teg.atan((1 + t) * x), 0.0, 1000.0),
        float(mpmath.quad(lambda s: s / (1 + 4 * s * s), [0, 1, 10, 100, 1000])),
    ),
    "along a curve": (between(teg.sin(x), teg.sin(x) + t * x**6, -1.0), 2 / 7),
    "without a formula": (
        teg.integral(teg.bracket(y + y**5 < small(100)) * teg.bracket(y + y**5 > -small(100)), (x, 0, 1), (y, -2, 2)),
        2 * float(mpmath.quad(lambda s: 1 / (1 + 5 * mpmath.findroot(lambda v: v + v**5 - s, s) ** 4), [0, 0.5, 1])) / 100,
    ),
}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", CASES)
def test_gradients(name: str, backend: str) -> None:
    e, exact = CASES[name]
    f = teg.compile(e, [t], backend=backend)
    assert f.grad(1.0)["t"] == pytest.approx(exact, rel=1e-9)
    if backend == "c":
        assert f.diagnose(1.0) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a bump"])
def test_gradients_in_jax(name: str) -> None:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        e, exact = CASES[name]
        assert teg.compile(e, [t], backend="jax").grad(1.0)["t"] == pytest.approx(exact, rel=1e-9)
    finally:
        jax.config.update("jax_enable_x64", before)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_surfaces_that_coincide_all_along_are_a_tie(backend: str) -> None:
    """The mean of both orders, at every place of the piece."""
    curve = teg.exp(x) - 1
    e = teg.integral(teg.bracket(y < curve * t) * teg.bracket(y < curve * a), (x, 0, 1), (y, -1, 3))
    found = teg.compile(e, [t, a], backend=backend).grad(1.0, 1.0)
    assert found["t"] == pytest.approx(0.5 * (math.e - 2), rel=1e-9)
    assert found["a"] == pytest.approx(0.5 * (math.e - 2), rel=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("k", [4.0, 42.0, 42200.0])
def test_a_narrow_bump_that_moves_keeps_its_area(k: float, backend: str) -> None:
    """The boundary of the bump runs along y = 0 nearly everywhere: what is decided there does not hold where it rises."""
    x, y, p = teg.var("x"), teg.var("y"), teg.param("p")
    bump = teg.exp(-((k * (x - p)) ** 4))
    for surface in (y - 0.7 * bump, y + y**3 - bump):
        e = teg.integral(teg.bracket(surface < 0), (y, 0, 1), (x, -2, 3))
        assert teg.compile(e, tol=1e-7, backend=backend).grad(p=0.3372)["p"] == pytest.approx(0.0, abs=1e-9)
