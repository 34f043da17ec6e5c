"""erf, erfc, log1p and expm1 in programs: values, derivatives and conditions, in every backend."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import pytest

import teg
from teg import Expr

x, y = teg.vars("x y")
t, a = teg.params("t a")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
COMPILED = ["numpy", "c", pytest.param("jax", marks=pytest.mark.thorough)]
NAMES = ["erf", "erfc", "log1p", "expm1"]


@pytest.fixture(autouse=True)
def _doubles_in_jax(request: pytest.FixtureRequest) -> None:
    if "jax" in request.node.name:
        request.getfixturevalue("x64")


def exact(name: str, u: float) -> float:
    with mpmath.workdps(40):
        return float(getattr(mpmath, name)(mpmath.mpf(u)))


@pytest.mark.parametrize("backend", BACKENDS)
def test_values_and_derivatives(backend: str) -> None:
    f = teg.compile(teg.tuple(*(getattr(teg, name)(t) for name in NAMES)), [t], backend=backend)
    for at in (-0.9, 1e-12, 0.3, 2.5):
        assert f(t=at) == pytest.approx([exact(name, at) for name in NAMES], rel=6e-16)
        bell = 2 / math.sqrt(math.pi) * math.exp(-at * at)
        assert f.grad(t=at)["t"] == pytest.approx((bell, -bell, 1 / (1 + at), math.exp(at)), rel=1e-15)
        second = (-2 * at * bell, 2 * at * bell, -1 / (1 + at) ** 2, math.exp(at))
        assert f.hessian(t=at)["t", "t"] == pytest.approx(second, rel=1e-15)


@pytest.mark.parametrize("backend", COMPILED)
@pytest.mark.parametrize("name", NAMES)
def test_integrands(name: str, backend: str) -> None:
    e = teg.integral(getattr(teg, name)(a * x) * teg.bracket(x < t), (x, 0, 1))
    f = teg.compile(e, [t, a], backend=backend)
    with mpmath.workdps(30):
        wanted = float(mpmath.quad(lambda s: getattr(mpmath, name)(2 * s), [0, mpmath.mpf(0.3)]))
    value, error = f.value_and_error(t=0.3, a=2.0)
    assert value == pytest.approx(wanted, rel=1e-14)
    assert abs(value - wanted) <= error < 1e-11
    assert teg.check_gradient(f, t=0.3, a=2.0)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NAMES)
def test_conditions_on_both_sides_are_the_arguments(name: str, backend: str) -> None:
    f_of: Callable[[object], Expr] = getattr(teg, name)
    side = f_of(x) < f_of(t) if name != "erfc" else f_of(x) > f_of(t)
    f = teg.compile(teg.integral(teg.bracket(side) * teg.bracket(x < t), (x, 0, 1)), [t], backend=backend)
    assert f(t=0.3) == pytest.approx(0.3, rel=2e-15)
    assert f.grad(t=0.3)["t"] == pytest.approx(1.0, rel=1e-14)
    disjoint = teg.compile(teg.integral(teg.bracket(side) * teg.bracket(t < x), (x, 0, 1)), [t], backend=backend)
    assert disjoint(t=0.3) == pytest.approx(0.0, abs=1e-15)
    assert disjoint.grad(t=0.3)["t"] == pytest.approx(0.0, abs=1e-14)


LEVELS = [1e-300, 1e-20, 1e-5, 0.3, 0.4999, 0.5, 0.501, 0.9, 1 - 1e-6, 1 - 1e-12, 1 - 2**-53]


@pytest.mark.parametrize("backend", COMPILED)
def test_a_level_of_erf(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.erf(x) < t), (x, -10, 10)), [t], backend=backend)
    for level in [s * c for c in LEVELS for s in (1, -1)]:
        with mpmath.workdps(40):
            root = mpmath.erfinv(mpmath.mpf(level))
            slope = mpmath.sqrt(mpmath.pi) / 2 * mpmath.exp(root * root)
            wanted = float(root), float(slope), float(2 * root * slope**2)
        assert f(t=level) - 10 == pytest.approx(wanted[0], abs=4e-15)
        assert f.grad(t=level)["t"] == pytest.approx(wanted[1], rel=2e-14)
        assert f.hessian(t=level)["t", "t"] == pytest.approx(wanted[2], rel=4e-14)
    for level, value in ((1.0, 20.0), (2.0, 20.0), (-1.0, 0.0), (-3.0, 0.0)):
        assert f(t=level) == value
        assert f.grad(t=level)["t"] == 0.0


def test_a_level_of_erfc_far_out() -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.erfc(x) < t), (x, 0, 30)), [t])
    for level in (1e-300, 1e-100, 1e-10, 0.3, 0.7, 1 - 1e-10):
        root = 30 - f(t=level)
        with mpmath.workdps(40):
            correction = mpmath.log(mpmath.erfc(root) / level) * mpmath.erfc(root) * mpmath.exp(root**2)
        assert abs(float(correction)) < 1e-14


@pytest.mark.parametrize("name", ["log1p", "expm1"])
def test_small_levels_keep_their_digits(name: str) -> None:
    inverse = math.expm1 if name == "log1p" else math.log1p
    f = teg.compile(teg.integral(teg.bracket(getattr(teg, name)(x) < t), (x, 0, 1)), [t])
    assert f(t=1e-10) == pytest.approx(inverse(1e-10), rel=1e-15)


def test_log1p_near_its_singularity_is_a_logarithm() -> None:
    assert teg.evaluate(teg.integral(teg.log1p(x - 1), (x, 0, 1)), {}) == pytest.approx(-1.0, rel=1e-14)
    f = teg.compile(teg.integral(teg.log1p(-a * x), (x, 0, 1)), [a])
    assert f(a=1.0) == pytest.approx(-1.0, rel=1e-13)
    assert teg.check_gradient(f, a=0.5)


def test_a_step_of_erf_between_the_nodes_is_seen() -> None:
    f = teg.compile(teg.integral(1 - teg.erf(5000 * (x - 0.3)) ** 2, (x, 0, 1)))
    assert f() == pytest.approx(2 * math.sqrt(2 / math.pi) / 5000, rel=1e-9)


def test_functions_with_erf_are_compiled_once() -> None:
    u = teg.var("u")
    normal = teg.function("normal", [u], 0.5 * teg.erfc(-u / math.sqrt(2)) + teg.expm1(u) * 0)
    e = teg.integral(normal(x - t), (x, -1, 1))
    f = teg.compile(e, [t])
    assert f(t=0.0) == pytest.approx(1.0, rel=1e-14)
    assert teg.check_gradient(f, t=0.3)


def test_text() -> None:
    assert str(teg.erf(t) + teg.log1p(t)) == "erf(t) + log1p(t)"
    assert teg.latex(teg.erfc(t)) == r"\operatorname{erfc}\left(t\right)"
