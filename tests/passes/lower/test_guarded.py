"""Narrow smooth features, which lie between all nodes of a first look: found by the guard, in values and gradients, in every backend."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import teg
from teg import Expr, abs, bracket, cos, cosh, exp, integral, log, sin, tanh
from teg.backends.c.kernel import compile_c
from teg.backends.numpy.kernel import compile_numpy
from teg.program import Adaptive, Assign, Guard, Integrate, Program, statements
from teg.program.interpreter import interpret

x, y = teg.vars("x y")
k, p, a, b = teg.params("k p a b")
BACKENDS = ("numpy", "c")
WIDTHS = (300, 1000, 3000, 10_000, 40_000)
ROOT_PI = math.sqrt(math.pi)


def bump(u: Expr) -> Expr:
    """sech²u, of integral 2."""
    return 1 / cosh(u) ** 2


def over_square(f: Expr) -> Expr:
    return integral(f, (y, 0, 1), (x, 0, 1))


def logistic_slope(u: Expr) -> Expr:
    return 1 / (exp(u / 2) + exp(-u / 2)) ** 2


def beta(n: int) -> float:
    """∫₀¹ (4x(1 - x))ⁿ dx."""
    return math.exp(n * math.log(4) + 2 * math.lgamma(n + 1) - math.lgamma(2 * n + 2))


NARROW: dict[str, tuple[Callable[[int], Expr], Callable[[int], float]]] = {
    "exp(-kx)": (lambda n: exp(-n * x), lambda n: 1 / n),
    "k exp(-k(1-x))": (lambda n: n * exp(-n * (1 - x)), lambda n: 1.0),
    "(k+1)x^k": (lambda n: (n + 1) * x**n, lambda n: 1.0),
    "(1+x)^-k": (lambda n: (1 + x) ** -n, lambda n: 1 / (n - 1)),
    "sech²": (lambda n: bump(n * (x - 0.3)), lambda n: 2 / n),
    "1 - tanh²": (lambda n: 1 - tanh(n * (x - 0.3)) ** 2, lambda n: 2 / n),
    "exp(-k|x-p|)": (lambda n: exp(-n * abs(x - 0.3)), lambda n: 2 / n),
    "1 + exp(-k|x-p|)": (lambda n: 1 + exp(-n * abs(x - 0.3)), lambda n: 1 + 2 / n),
    "Gaussian of x²": (lambda n: 2 * n * x * exp(-((n * (x * x - 0.41)) ** 2)), lambda n: ROOT_PI),
    "Lorentz": (lambda n: 1 / (1 + (n * (x - 0.3)) ** 2), lambda n: (math.atan(0.7 * n) + math.atan(0.3 * n)) / n),
    "cos + Lorentz": (
        lambda n: cos(x) + 1 / (1 + (n * (x - 0.3)) ** 2),
        lambda n: math.sin(1) + (math.atan(0.7 * n) + math.atan(0.3 * n)) / n,
    ),
    "exp(-u⁴)": (lambda n: exp(-((n * (x - 0.3)) ** 4)), lambda n: 2 * math.gamma(1.25) / n),
    "exp(-k(x+x³))": (lambda n: exp(-n * (x + x**3)) * (1 + 3 * x * x), lambda n: 1 / n),
    "2 - tanh²": (lambda n: 2 - tanh(n * (x - 0.3)) ** 2, lambda n: 1 + 2 / n),
    "logistic slope": (lambda n: logistic_slope(n * (x - 0.3)), lambda n: 1 / n),
    "(4x(1-x))^k": (lambda n: (4 * x * (1 - x)) ** n, beta),
}


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", NARROW)
def test_narrow_features_of_one_variable(name: str, width: int) -> None:
    make, exact = NARROW[name]
    f = teg.compile(integral(make(width), (x, 0, 1)))
    value, error = f.value_and_error()
    assert value == pytest.approx(exact(width), rel=1e-8)
    assert np.abs(value - exact(width)) <= max(10 * error, 1e-10 * exact(width))
    assert f.evaluations() <= 2600


@pytest.mark.parametrize("name", NARROW)
def test_the_same_in_c(name: str) -> None:
    make, exact = NARROW[name]
    f, g = (teg.compile(integral(make(3000), (x, 0, 1)), backend=backend) for backend in BACKENDS)
    assert g() == pytest.approx(exact(3000), rel=1e-10)
    assert g.evaluations() == f.evaluations()


VERY_NARROW: dict[str, tuple[Expr, float]] = {
    "both sides of a kink": (integral(1e6 * exp(-1e6 * abs(x - 0.3)), (x, 0, 1)), 2.0),
    "a bound that overflows": (integral(1e10 * exp(1e10 * (x**3 - x)), (x, 0, 0.5)), 1.0),
    "a ridge into corners": (over_square(3000 * exp(-((3000 * (x - y)) ** 2))), ROOT_PI - 1 / 3000),
    "a ridge through a slit": (over_square(bracket(x > 0.3) * bracket(x < 0.301) * 1e5 * exp(-((1e5 * (x - y)) ** 2))), 1e-3 * ROOT_PI),
    "another one": (over_square(bracket(x > 0.3 + y / 2) * bracket(x < 0.301 + y / 2) * 1e5 * bump(1e5 * (x + y - 1))), 2e-3 / 1.5),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", VERY_NARROW)
def test_features_beside_ends_and_breaks(name: str, backend: str) -> None:
    """A condition has one truth on a piece; a ridge in two variables has a layer where it meets a break of the inner integral."""
    program, exact = VERY_NARROW[name]
    assert teg.compile(program, backend=backend)() == pytest.approx(exact, rel=1e-10)


FAR_AWAY: dict[str, tuple[Expr, float]] = {
    "sech": (1 / cosh(x - k), math.pi),
    "logistic density": (exp(x - k) / (1 + exp(x - k)) ** 2, 1.0),
    "1 - tanh²": (1 - tanh(x - k) ** 2, 2.0),
    "exp(-√(1+u²))": (exp(-teg.sqrt(1 + (x - k) ** 2)), 1.2038144603944705),
    "exp(-u⁴)": (exp(-((x - k) ** 4)), 2 * math.gamma(1.25)),
}


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FAR_AWAY)
def test_features_beyond_the_last_node_of_an_infinite_range(name: str, backend: str, x64: None) -> None:
    """Far away the digits of x = s/(1 - s) are lost, of which the call warns."""
    body, exact = FAR_AWAY[name]
    for lo, hi in ((-math.inf, math.inf), (0, math.inf), (math.inf, -math.inf)):
        f = teg.compile(integral(body, (x, lo, hi)), backend=backend, inaccurate="ignore")
        for place, digits in ((1e3, 1e-10), (2e4, 1e-8)):
            assert f(k=place) == pytest.approx(exact if lo < hi else -exact, rel=digits)
    f = teg.compile(integral(body, (x, -math.inf, 0)), backend=backend)
    value, slopes = f.value_and_grad(k=-1e3)
    assert value == pytest.approx(exact, rel=1e-10)
    assert slopes["k"] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sech²", "(4x(1-x))^k", "1 + exp(-k|x-p|)"])
def test_the_same_in_jax(name: str, x64: None) -> None:
    make, exact = NARROW[name]
    assert teg.compile(integral(make(3000), (x, 0, 1)), backend="jax")() == pytest.approx(exact(3000), rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("n", [300.0, 600.0, 3000.0])
def test_gradients_by_width_and_bounds(n: float, backend: str) -> None:
    f = teg.compile(integral(bracket(x < p) * exp(-k * (x - a)), (x, a, b)), backend=backend)
    value, gradient = f.value_and_grad(k=n, p=0.5, a=-0.4, b=1.0)
    assert value == pytest.approx(1 / n, rel=1e-10)
    assert gradient["k"] == pytest.approx(-1 / n**2, rel=1e-9)
    assert [gradient[name] for name in "pab"] == pytest.approx([0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_gradients_by_the_place_of_a_peak(backend: str) -> None:
    f = teg.compile(integral(x * bump(k * (x - p)), (x, 0, 1)), backend=backend)
    value, gradient = f.value_and_grad(k=400.0, p=0.3)
    assert value == pytest.approx(0.3 * 2 / 400, rel=1e-10)
    assert gradient["p"] == pytest.approx(2 / 400, rel=1e-9)
    assert gradient["k"] == pytest.approx(-0.3 * 2 / 400**2, rel=1e-9)


RELATIVES: dict[str, tuple[Expr, float]] = {
    "line": (integral(bump(3000 * (x - 3)), (x, -math.inf, math.inf)), 2 / 3000),
    "half-line": (integral(bump(3000 * (x - 30)), (x, 0, math.inf)), 2 / 3000),
    "turned round": (integral(exp(-5000 * x), (x, 1, 0)), -1 / 5000),
    "many bumps": (integral(sum((bump(2000 * (x - 0.02 - 0.0487 * i)) for i in range(20)), teg.ir.expr.ZERO), (x, 0, 1)), 40 / 2000),
    "many Gaussians": (
        integral(sum((exp(-((2000 * (x - 0.05 - 0.0913 * i)) ** 2)) for i in range(10)), teg.ir.expr.ZERO), (x, 0, 1)),
        10 * ROOT_PI / 2000,
    ),
    "many Lorentz": (
        integral(sum((1 / (1 + (3000 * (x - 0.05 - 0.08 * i)) ** 2) for i in range(12)), teg.ir.expr.ZERO), (x, 0, 1)),
        math.fsum((math.atan(3000 * (0.95 - 0.08 * i)) + math.atan(3000 * (0.05 + 0.08 * i))) / 3000 for i in range(12)),
    ),
    "large domain": (integral(bump(3000 * (x / 1e6 - 0.3)), (x, 0, 1e6)), 2e6 / 3000),
    "small domain": (integral(1e6 * bump(3000 * (x * 1e6 - 0.3)), (x, 0, 1e-6)), 2 / 3000),
    "risers against fallers": (integral((1 + tanh(3000 * (x - 0.3))) * (1 - tanh(3000 * (x - 0.3))), (x, 0, 1)), 2 / 3000),
    "two logistic curves": (integral(1 / (1 + exp(3000 * (x - 0.3))) / (1 + exp(-3000 * (x - 0.3))), (x, 0, 1)), 1 / 3000),
    "a power of a wave": (
        integral(sin(math.pi * x) ** 4000, (x, 0, 1)),
        math.exp(math.lgamma(2000.5) - math.lgamma(2001)) / ROOT_PI,
    ),
    "of a logarithm": (integral(exp(-((3000 * (log(x) + 1)) ** 2)) / x, (x, 0.01, 1)), ROOT_PI / 3000),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", RELATIVES)
def test_relatives(name: str, backend: str) -> None:
    program, exact = RELATIVES[name]
    assert teg.compile(program, backend=backend)() == pytest.approx(exact, rel=1e-8)


NESTS: dict[str, tuple[Expr, float]] = {
    "bump": (over_square(9e4 * exp(-((300 * (x - 0.3)) ** 4) - (300 * (y - 0.4)) ** 4)), 4 * math.gamma(1.25) ** 2),
    "outer": (over_square(bump(3000 * (x - 0.3)) * exp(x * y)), 0.0),
    "inner": (over_square(bump(3000 * (y - 0.3)) * exp(x)), 2 / 3000 * (math.e - 1)),
    "ridge into corners": (over_square(bump(300 * (x - y))), 2 * (300 - math.log(2)) / 300**2),
    "under a curve": (over_square(bracket(y < exp(-2000 * x))), 1 / 2000),
    "under a bump": (over_square(bracket(y < bump(300 * (x - 0.3))) * (1 + y)), 2 / 300 + 2 / 3 / 300),
}


def outer_bump() -> float:
    """∫∫ sech²(3000(x - 0.3))·exp(xy): the inner integral is smooth, (exp x - 1)/x, of curvature c; the bump's variance is π²/12/3000²."""
    h = 1e-3
    values = [math.expm1(u) / u for u in (0.3 - h, 0.3, 0.3 + h)]
    curvature = (values[0] - 2 * values[1] + values[2]) / h**2
    return 2 / 3000 * (values[1] + 0.5 * curvature * math.pi**2 / 12 / 3000**2)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", NESTS)
def test_narrow_features_of_two_variables(name: str, backend: str) -> None:
    program, exact = NESTS[name]
    assert teg.compile(program, backend=backend)() == pytest.approx(exact or outer_bump(), rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["inner", "under a bump"])
def test_the_same_nests_in_jax(name: str, x64: None) -> None:
    program, exact = NESTS[name]
    assert teg.compile(program, backend="jax")() == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_gradients_of_what_is_under_a_curve(backend: str) -> None:
    f = teg.compile(over_square(bracket(y < exp(-k * x))), backend=backend)
    assert f.grad(k=500.0)["k"] == pytest.approx(-1 / 500**2, rel=1e-8)
    g = teg.compile(over_square(exp(-k * x * y)), backend=backend)
    exact = (math.log(3000) + 0.5772156649015329) / 3000
    value, gradient = g.value_and_grad(k=3000.0)
    assert value == pytest.approx(exact, rel=1e-9)
    assert gradient["k"] == pytest.approx((1 / 3000 - exact) / 3000, rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_features_of_functions(backend: str) -> None:
    """A body that is narrow on its range is written out; of one with parameters the values at ends and in the middle of gaps are taken."""
    u = teg.param("u")
    cases: list[tuple[Expr, float]] = [
        (exp(-2000 * u), 1 / 2000),
        (1 + bump(3000 * (u - 0.3)), 1 + 2 / 3000),
        (exp(-k * u), 1 / 2000),
        (1 - tanh(k * u), math.log(2) / 2000),
    ]
    for body, exact in cases:
        f = teg.function("f", [u], body)
        assert teg.compile(integral(f(x), (x, 0, 1)), [k], backend=backend)(k=2000.0) == pytest.approx(exact, rel=1e-9)


def sine(u: Expr) -> Expr:
    """sin u, as an integral."""
    return integral(u * cos(u * y), (y, 0, 1))


def of_bump(u: Expr) -> Expr:
    return exp(-((k * u) ** 2))


z = teg.var("z")
SPAN = math.atan(3e4 * (math.sin(1) - 0.3)) + math.atan(3e4 * 0.3)
OF_INTEGRALS: dict[str, tuple[Expr, float]] = {
    "Gaussian": (integral(of_bump(sine(x) - 0.3) * cos(x), (x, 0, 1)), ROOT_PI / 3e4),
    "Lorentz": (integral(cos(x) / (1 + (k * (sine(x) - 0.3)) ** 2), (x, 0, 1)), SPAN / 3e4),
    "of an adaptive one": (integral(of_bump(integral(exp(sin(y)), (y, 0, x)) - 0.3) * exp(sin(x)), (x, 0, 1)), ROOT_PI / 3e4),
    "of an area": (integral(of_bump(integral(bracket(y < x * x), (y, 0, 1)) - 0.3) * 2 * x, (x, 0, 1)), ROOT_PI / 3e4),
    "at the least value": (integral(exp(k**2 * (0.5 - integral(2 * y * (x - 0.4321) ** 2 + y, (y, 0, 1)))), (x, 0, 1)), ROOT_PI / 3e4),
    "wave": (integral(cos(k * sine(x) / 100) * cos(x), (x, 0, 1)), math.sin(300 * math.sin(1)) / 300),
    "ridge": (integral(of_bump(sine(x + z / 3) - 0.5) * cos(x + z / 3), (x, 0, 1), (z, 0, 0.5)), 0.5 * ROOT_PI / 3e4),
    "ridge, in the other order": (integral(of_bump(sine(x + z / 3) - 0.5) * cos(x + z / 3), (z, 0, 0.5), (x, 0, 1)), 0.5 * ROOT_PI / 3e4),
}


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", OF_INTEGRALS)
def test_features_of_a_function_of_an_integral(name: str, backend: str, x64: None) -> None:
    program, exact = OF_INTEGRALS[name]
    f = teg.compile(program, backend=backend, inaccurate="ignore")
    value, slopes = f.value_and_grad(k=3e4)
    assert value == pytest.approx(exact, rel=1e-8)
    if name != "wave":
        assert slopes["k"] == pytest.approx(-exact / 3e4, rel=2e-4 if name == "Lorentz" else 1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_features_of_a_function_of_a_function(backend: str) -> None:
    u = teg.param("u")
    hidden = teg.function("hidden", [u], teg.sinh(u) * a)
    f = teg.compile(integral(of_bump(hidden(x) - 0.3) * cosh(x), (x, 0, 1)), backend=backend)
    assert f(k=3e4, a=1.0) == pytest.approx(ROOT_PI / 3e4, rel=1e-8)


def test_tame_functions_stay_functions() -> None:
    u = teg.param("u")
    f = teg.function("f", [u], exp(-3 * u) * (1 + tanh(2 * u)))
    assert teg.compile(integral(f(x), (x, 0, 1))).program(0).functions
    g = teg.compile(integral(f(x), (x, 0, 1)))
    assert g.evaluations() == teg.compile(integral(exp(-3 * x) * (1 + tanh(2 * x)), (x, 0, 1))).evaluations()


# -- what is not narrow ------------------------------------------------------------------------------------------------

TAME = {
    "a polynomial": integral(x**4 * bracket(x < k), (x, 0, 1)),
    "exp x": integral(exp(x), (x, 0, 1)),
    "exp(k - x)": integral(exp(k - x), (x, 0, 1)),
    "exp -30x": integral(exp(-30 * x), (x, 0, 1)),
    "tanh 3x": integral(tanh(3 * x), (x, -1, 1)),
    "1/(1 + x)³": integral((1 + x) ** -3, (x, 0, 1)),
    "sin kx": integral(sin(k * x), (x, 0, 1)),
    "exp cos 8x": integral(exp(cos(8 * x)), (x, 0, 1)),
    "1/√(x + k)": integral(1 / teg.sqrt(x + k), (x, 0, 1)),
    "a Gaussian": integral(exp(-((60 * (x - k)) ** 2)), (x, 0, 1)),
    "exp x cos y": over_square(exp(x) * cos(y)),
    "exp -xy": over_square(exp(-x * y)),
    "tanh 4(x - y)": over_square(1 + tanh(4 * (x - y)) * exp(x)),
    "a half-plane": over_square(bracket(x + 2 * y < p) * exp(x - y)),
}


def guards(f: teg.Evaluator, derivatives: int = 1) -> list[Guard]:
    return [s.guard for s in statements(f.program(derivatives).body) if isinstance(s, Integrate) and s.guard is not None]


@pytest.mark.parametrize("name", TAME)
def test_what_is_known_to_be_tame_has_no_guard(name: str) -> None:
    f = teg.compile(TAME[name])
    assert not guards(f, 0)
    assert name == "1/√(x + k)" or not guards(f, 1)  # its singularity moves: the field that carries it is a quotient of degree 4


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("program", "at", "evaluations"),
    [
        (integral(exp(k * x), (x, 0, 1)), 1.5, 8 + 16),
        (integral(exp(k * x), (x, 0, 1)), 0.1, 8),
        (integral(1 / (2 + exp(k * x)), (x, 0, 1)), 0.1, 8),
        (over_square(exp(k * x * y)), 0.1, 12 * 10),
    ],
)
def test_ordinary_integrands_are_evaluated_as_before(program: Expr, at: float, evaluations: int, backend: str) -> None:
    f = teg.compile(program, backend=backend, intrinsics=False)
    assert guards(f, 0)
    assert f.evaluations(k=at) == evaluations


# -- where nothing can be decided --------------------------------------------------------------------------------------


def undecided(change: float) -> Program:
    """∫₀¹ x² dx with a sharp value that may be 1 in every gap around 1/3, however short, is 0 at all nodes, and is such a part of the
    integrand, which may be 10³⁰ there."""
    f = teg.compile(integral(x * x, (x, 0, 1)), rule="adaptive")
    program = f.program(0)
    (loop,) = (s for s in program.body if isinstance(s, Integrate))
    third = (
        Assign("v93", "sub", (1 / 3, "x91")),
        Assign("v94", "sub", ("x92", 1 / 3)),
        Assign("v95", "min", ("v93", "v94")),
        Assign("b96", "gt0", ("v95",)),
        Assign("v97", "select", ("b96", 1.0, 0.0)),
    )
    guard = Guard("x91", "x92", third, (1e30,), ("v97",), ("v97",), (1e30 * change,), (0.0,))
    assert isinstance(loop.rule, Adaptive)
    return replace(program, body=tuple(replace(loop, guard=guard) if s is loop else s for s in program.body))


@pytest.mark.parametrize("compiled", [compile_numpy, compile_c])
@pytest.mark.parametrize(("change", "missed"), [(math.inf, True), (math.nan, True), (1e-3, True), (1e-41, False), (0.0, False)])
def test_a_feature_that_is_never_seen_is_a_missed_tolerance(compiled: Callable[[Program], object], change: float, missed: bool) -> None:
    """Unless it cannot change the integral: 10⁻¹⁰ may be missed."""
    program = undecided(change)
    outcome = compiled(program).outcome([], 1)  # type: ignore[attr-defined]
    told = interpret(program, [])
    assert (outcome.missed, told.missed) == (missed, missed)
    assert outcome.values[0, 0] == pytest.approx(1 / 3, rel=1e-10)


@pytest.mark.parametrize("backend", [*BACKENDS, pytest.param("jax", marks=pytest.mark.slow)])
def test_the_estimate_holds_what_is_hidden(backend: str, x64: None) -> None:
    """A peak between neighbouring numbers has no node, and bisection ends: the bound of the integrand counts as an error."""
    narrow = [k * exp(-k * abs(x - 0.3)), k / cosh(k * (x - 0.3)), k * exp(-k * (x - 0.3)) / (1 + exp(-k * (x - 0.3))) ** 2]
    for body, exact in zip(narrow, (2.0, math.pi, 1.0), strict=True):
        f = teg.compile(integral(body, (x, 0, 1)), backend=backend)
        value, error = f.value_and_error(k=1e20)
        assert np.abs(value - exact) <= error
        with pytest.warns(teg.AccuracyWarning):
            f(k=1e20)


# -- beside the ends of pieces -------------------------------------------------------------------------------------------


def bessel_k0(u: float) -> float:
    """∫ exp(-u·cosh s) ds over (0, ∞), by the trapezium rule, which converges exponentially."""
    return 0.01 * (0.5 * math.exp(-u) + sum(math.exp(-u * math.cosh(0.01 * n)) for n in range(1, 1000)))


FALLING: dict[str, tuple[Expr, float]] = {
    "exp(-(p/x)² - x²)/x": (integral(exp(-((p / x) ** 2) - x**2) / x, (x, 0, math.inf)), bessel_k0(0.6)),
    "exp(-(p/x)² - x²)/|x|": (integral(exp(-((p / x) ** 2) - x**2) / abs(x), (x, -math.inf, math.inf)), 2 * bessel_k0(0.6)),
    "sech(log x - p)/x": (integral(1 / cosh(log(x) - p) / x, (x, 0, math.inf)), math.pi),
    "a slanting bound": (integral(exp(-(x**2) - y**2), (y, -math.inf, p * x), (x, -math.inf, math.inf)), math.pi / 2),
    "sech(x - ∫)": (integral(1 / cosh(x - integral(bracket(y < p) * y**2, (y, 0, 1))), (x, -math.inf, math.inf)), math.pi),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", FALLING)
def test_values_that_fall_to_0_at_an_end_hide_nothing(name: str, backend: str) -> None:
    program, expected = FALLING[name]
    value, error = teg.compile(program, [], backend=backend, inaccurate="raise").value_and_error(p=0.3)
    assert value == pytest.approx(expected, rel=1e-11)
    assert error <= 1e-9


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_hyperbola_over_the_plane_converges(backend: str) -> None:
    plane = integral(bracket(x * y < p) * exp(-(x**2) - y**2), (x, -math.inf, math.inf), (y, -math.inf, math.inf))
    f = teg.compile(plane, [p], backend=backend, inaccurate="raise")
    assert f.value_and_grad(p=0.3)[1]["p"] == pytest.approx(2 * bessel_k0(0.6), rel=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scale", [1e-3, 1e-6])
def test_a_peak_beside_an_end_is_found(scale: float, backend: str) -> None:
    f = teg.compile(integral(exp(-k / x) * k**2 / x**3, (x, 0, 1)), [], backend=backend, inaccurate="raise")
    assert f(k=scale) == pytest.approx((1 + scale) * math.exp(-scale), rel=1e-9)  # with u = k/x: ∫ u·exp(-u) du from k


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_power_that_is_a_parameter_is_not_narrow(backend: str) -> None:
    """∫∫ max(1 - x² - y² - a, 0)ᵖ = π(1 - a)^(p+1)/(p+1). It took a minute, and its estimate was 56: only powers beyond 16, or of
    poles, can hide between nodes."""
    f = teg.compile(integral(teg.maximum(1 - x**2 - y**2 - a, 0) ** p, (x, -1, 1), (y, -1, 1)), [a, p], backend=backend)
    for power in (0.5, 1.5, 2.5):
        value, error = f.value_and_error(a=0.3, p=power)
        assert value == pytest.approx(math.pi * 0.7 ** (power + 1) / (power + 1), rel=1e-10)
        assert error < 1e-9


def test_a_large_power_that_is_a_parameter_is_narrow() -> None:
    f = teg.compile(integral((4 * x * (1 - x)) ** p, (x, 0, 1)), [p], backend="numpy")
    for n in (10, 300, 40_000):
        assert f(p=float(n)) == pytest.approx(beta(n), rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pole_on_the_border_of_a_bump_hides_nothing(backend: str) -> None:
    """exp(-1/(1 - x² - y²)) has a pole at both breaks of each line. The guard took it for a ridge, and bisected as deep as it could."""
    e = integral(teg.where(x**2 + y**2 < a, exp(-1 / (a - x**2 - y**2)), 0), (x, -2, 2), (y, -2, 2))
    f = teg.compile(e, [a], backend=backend)
    assert f(a=1.0) == pytest.approx(0.4665123931783310, rel=1e-10)
    assert f.evaluations(a=1.0) < 100_000  # it took tens of millions
