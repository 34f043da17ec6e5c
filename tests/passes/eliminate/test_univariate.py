"""Surfaces solved for one variable, and their roots as breaks."""

from __future__ import annotations

import math
from typing import Any

import pytest

import teg
from teg.analysis.roots import solve
from teg.passes.eliminate.univariate import Solvable, match_solvable

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
ONE = teg.exp(0 * t)


def area(condition: teg.Cond, lo: float = 0.0, hi: float = 1.0, weight: object = 1.0) -> teg.Expr:
    return teg.integral(teg.bracket(condition) * weight, (x, lo, hi))


@pytest.mark.parametrize(
    ("g", "degree"), [(x**2 - t, 2), (a * x**2 + b * x + t, 2), (teg.atan(3 * x) - t, None), (teg.exp(x**2) - t, None)]
)
def test_matches(g: teg.Expr, degree: int | None) -> None:
    assert match_solvable(g, [x]) == Solvable(x, degree)


@pytest.mark.parametrize("g", [x * teg.exp(-x) - t, x + y**2 - t, teg.sin(x) + teg.cos(2 * x) - t, x**5 + x - t], ids=str)
def test_refuses(g: teg.Expr) -> None:
    assert match_solvable(g, [x, y]) is None


INVERTIBLE = [
    (area(teg.exp(x) < t), 1.7, math.log(1.7), 1 / 1.7, -1 / 1.7**2),
    (area(teg.log(x + 1) < t), 0.3, math.expm1(0.3), math.exp(0.3), math.exp(0.3)),
    (area(teg.sqrt(x) < t), 0.6, 0.36, 1.2, 2.0),
    (area(teg.atan(x) < t), 0.5, math.tan(0.5), 1 / math.cos(0.5) ** 2, 2 * math.tan(0.5) / math.cos(0.5) ** 2),
    (area(teg.asin(x) < t), 0.5, math.sin(0.5), math.cos(0.5), -math.sin(0.5)),
    (area(teg.acos(x) < t), 1.2, 1 - math.cos(1.2), math.sin(1.2), math.cos(1.2)),
    (area(teg.sinh(x) < t), 0.5, math.asinh(0.5), 1 / math.sqrt(1.25), -0.5 / 1.25**1.5),
    (area(teg.cosh(x) < t, -1, 1), 1.2, 2 * math.acosh(1.2), 2 / math.sqrt(0.44), -2.4 / 0.44**1.5),
    (area(teg.tanh(x) < t), 0.5, math.atanh(0.5), 1 / 0.75, 1.0 / 0.75**2),
    (area(x**4 < t, -1, 1), 0.3, 2 * 0.3**0.25, 0.5 * 0.3**-0.75, -0.375 * 0.3**-1.75),
    (area(x**5 < t, -1, 1), -0.3, 1 - 0.3**0.2, 0.2 * 0.3**-0.8, 0.16 * 0.3**-1.8),
    (area(1 / x > t, 0.5, 4), 0.5, 1.5, -4.0, 16.0),
    (area(x**3 < t, -1, 1), 0.5, 1 + 0.5 ** (1 / 3), 0.5 ** (-2 / 3) / 3, -2 / 9 * 0.5 ** (-5 / 3)),
    (area(teg.exp(teg.sin(x)) < t, -1, 1), 1.5, 1 + math.asin(math.log(1.5)), None, None),
]


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(("e", "at", "value", "first", "second"), INVERTIBLE, ids=lambda v: str(v)[:40])
def test_inverse_functions(e: teg.Expr, at: float, value: float, first: float | None, second: float | None, backend: str) -> None:
    f = teg.compile(e, backend=backend)
    found, gradient = f.value_and_grad(t=at)
    assert found == pytest.approx(value, rel=1e-13)
    if first is None:
        assert teg.check_gradient(f, t=at, tol=1e-9)
        return
    assert gradient["t"] == pytest.approx(first, rel=1e-12)
    assert f.hessian(t=at)["t", "t"] == pytest.approx(second, rel=1e-11)


def test_every_branch_of_a_periodic_function() -> None:
    f = teg.compile(area(teg.sin(a * x) > t, 0, 6, teg.exp(-x)))
    assert teg.check_gradient(f, a=3.0, t=0.4, tol=1e-9)
    with_tan = teg.compile(area(teg.tan(a * x) > t, 0, 7))
    poles = [math.pi / 2, 3 * math.pi / 2, 7.0]
    roots = [math.pi / 4 + k * math.pi for k in range(3)]
    value, gradient = with_tan.value_and_grad(a=1.0, t=1.0)
    kept = [(r, p) for r, p in zip(roots, poles, strict=True) if r < 7]
    assert value == pytest.approx(sum(p - r for r, p in kept) - (0 if math.tan(7) > 1 else 7 - roots[2] if roots[2] < 7 else 0), rel=1e-12)
    assert gradient["t"] == pytest.approx(-0.5 * sum(r < 7 for r in roots), rel=1e-12)
    assert teg.check_gradient(with_tan, a=1.0, t=1.0, tol=1e-9)  # the poles move with a


def test_more_roots_than_were_foreseen() -> None:
    """sin 60x passes 0.4 115 times on (0, 6), with the slope ±60·√(1 - 0.4²)."""
    f = teg.compile(area(teg.sin(a * x) > t, 0, 6))
    value, gradient = f.value_and_grad(a=60.0, t=0.4)
    assert math.isfinite(value)
    assert gradient["t"] == pytest.approx(-115 / (60 * math.sqrt(1 - 0.16)), rel=1e-12)
    assert f.diagnose(a=60.0, t=0.4) == []


@pytest.mark.parametrize("at", [-0.5, -0.3849, -0.2, 0.0, 0.2, 0.3848, 1.0])
def test_three_roots_or_one(at: float) -> None:
    f = teg.compile(area(x**3 - x < t, -2, 2, teg.exp(x)))
    exact = sum(math.exp(r) / abs(3 * r * r - 1) for r in _cubic(at))
    assert f.grad(t=at)["t"] == pytest.approx(exact, rel=1e-16 / abs(abs(at) - 2 / 27**0.5) + 1e-12)  # its conditioning


def _cubic(t0: float) -> list[float]:
    from mpmath import mp, polyroots

    with mp.workdps(40):
        return [float(r.real) for r in polyroots([1, 0, -1, -t0], maxsteps=200, extraprec=200) if abs(r.imag) < 1e-25]


def test_a_region_is_born_at_a_point() -> None:
    f = teg.compile(area(x**2 < t, -1, 1))
    assert f.grad(t=0.0)["t"] == math.inf
    assert f.diagnose(t=0.0)
    assert f.grad(t=-0.1)["t"] == 0.0


def test_roots_tell_when_they_are_not_all() -> None:
    certain = solve(teg.sin(x) - t, x, teg.ir.expr.const(0), teg.ir.expr.const(9))
    unsure = solve(teg.sin(a * x) - t, x, teg.ir.expr.const(0), teg.ir.expr.const(9))
    assert certain is not None
    assert certain.certain
    assert unsure is not None
    assert not unsure.certain


CHORDS = {"circle": (x - a) ** 2 + b * b < t, "ellipse": ((x - a) / 0.7) ** 2 + b * b < t}


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "height"), [(n, h) for n in CHORDS for h in (1e-6, 1e-13)])
def test_chords_that_hardly_are(name: str, height: float, backend: Any, x64_for_jax: None) -> None:
    """A chord of half the length s = √(t - b²) has ∂t = 1/s. At its ends x = a ± s the rate 2(x - a) was that of rounded places."""
    f = teg.compile(area(CHORDS[name]), [t, b], backend=backend)
    gradient = f.grad(t=0.25 + height, a=0.55, b=0.5)
    rate = (0.7 if name == "ellipse" else 1.0) / math.sqrt(0.25 + height - 0.25)
    assert gradient["t"] == pytest.approx(rate, rel=1e-14)
    assert gradient["b"] == pytest.approx(-rate, rel=1e-14)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("scale", [1e-100, 1e100, 1e150])
def test_chords_of_any_scale(scale: float, backend: Any) -> None:
    """The square of 1e150 has a square that is no number: the chord had the length 0, without a warning."""
    f = teg.compile(area(scale * (x - a) ** 2 + scale * t * t < scale, -2.0, 2.0), [t], backend=backend)
    value, gradient = f.value_and_grad(t=0.6, a=0.1)
    assert value == pytest.approx(1.6, rel=1e-13)
    assert gradient["t"] == pytest.approx(-1.5, rel=1e-13)


SQUARE = (x, 0, 1), (y, 0, 1)


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_second_derivatives_where_a_disk_touches_a_side(backend: Any, x64_for_jax: None) -> None:
    """The area outside of a side goes with the power 3/2 of what reaches over it. The second derivative was -3.5e13, without a warning."""
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t), *SQUARE), [t], backend=backend)
    for at in ({"t": 0.25, "a": 0.5, "b": 0.5}, {"t": 0.25, "a": 0.5, "b": 0.6}, {"t": 0.09, "a": 0.3, "b": 0.6}):
        assert f.hessian(at)["t", "t"] == -math.inf
        assert f.diagnose(at)[-1].kind == "second derivative"
    assert f.hessian(t=0.25 - 1e-9, a=0.5, b=0.5)["t", "t"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_second_derivatives_where_an_ellipse_touches_a_side(backend: Any) -> None:
    inside = ((x - 0.5) / b) ** 2 + ((y - 0.5) / t) ** 2 < 1
    f = teg.compile(teg.integral(teg.bracket(inside), *SQUARE), [t, b], backend=backend)
    for width in (0.5, 0.3, 0.37):
        with pytest.warns(teg.AccuracyWarning):
            assert not math.isfinite(f.hessian(t=0.5, b=width)["t", "t"])
