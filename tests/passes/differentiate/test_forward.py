"""Forward mode: Leibniz' rule with jumps, deltas visible."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg
from teg.ir.expr import ONE, ZERO
from teg.passes.differentiate.forward import tangent_of

x, y, z = teg.vars("x y z")
t, a = teg.params("t a")


def d(e: teg.Expr) -> teg.Expr:
    return tangent_of(e, {t: ONE})


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (t, ONE),
        (a, ZERO),
        (t**3, 3 * t**2),
        (teg.sin(t * a), a * teg.cos(t * a)),
        (teg.exp(t), teg.exp(t)),
        (1 / t, -(t**-2)),
        (teg.sqrt(t), 0.5 / teg.sqrt(t)),
        (teg.integral(x * t, (x, 0, 1)), teg.integral(x, (x, 0, 1))),
        (teg.integral(x, (x, 0, t)), t),
        (teg.integral(x, (x, t, 1)), -t),
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), teg.integral(teg.delta(t - x), (x, 0, 1))),
        (teg.integral(teg.bracket(x < t) * teg.bracket(x < t), (x, 0, 1)), teg.integral(teg.delta(t - x), (x, 0, 1))),
        (teg.integral(teg.abs(x - t), (x, 0, 1)), teg.integral(teg.where(x > t, -1, 1), (x, 0, 1))),
        (teg.bracket(t < a) * t, teg.bracket(t < a)),
        (teg.tuple(t, t * a), teg.tuple(1, a)),
        (teg.bracket(z < t), teg.delta(t - z)),
    ],
    ids=lambda e: str(e),
)
def test_normal_form(e: teg.Expr, expected: teg.Expr) -> None:
    assert d(e) is expected


def test_a_direction() -> None:
    assert tangent_of(t * a, {t: ONE, a: teg.ir.expr.const(2)}) is a + 2 * t


def test_directions_may_be_expressions() -> None:
    assert teg.jvp(t * a, {t: a}) is a**2


def test_deltas_of_an_integral_over_one_more_variable() -> None:
    e = teg.integral(teg.diff(teg.bracket(z < t), t), (z, 0, 1))
    assert teg.evaluate(e, {t: 0.4}) == 1.0
    assert teg.evaluate(e, {t: 1.4}) == 0.0


def test_a_delta_is_carried_along_with_its_surface() -> None:
    """d/dt of w(t)/2√t-like sums over roots, with a moving bracket, a moving bound, and a weight that depends on t."""
    e = teg.integral(teg.delta(t - x * x * a) * teg.exp(t * x) * teg.bracket(x < 2 * t), (x, 0, 1 + t))
    at = {"t": 0.5, "a": 1.2}
    root = (0.5 / 1.2) ** 0.5
    slope_of_root = 0.5 / (0.5 * 1.2) ** 0.5
    weight, rate = math.exp(0.5 * root), 2 * 1.2 * root
    exact = weight * (root + 0.5 * slope_of_root) / rate - weight / rate**2 * 2 * 1.2 * slope_of_root
    assert teg.evaluate(d(e), at) == pytest.approx(exact, rel=1e-13)
    assert teg.evaluate(d(teg.eliminate(e)), at) == pytest.approx(exact, rel=1e-13)


def test_deltas_that_are_carried_move_through_brackets_and_bounds() -> None:
    """∫∫ δ(g)·[h > 0] over a box: forward derivative against differences of the value, in one and two variables."""
    y = teg.var("y")
    e = teg.integral(teg.delta(t - x * x - y**4) * teg.exp(a * x) * teg.bracket(x + y < t * a), (x, -1, 0.1 + t * a), (y, -0.3 * t, 1))
    f = teg.compile(e, [t, a], backend="numpy")
    g = teg.compile(teg.tuple(teg.diff(e, t), teg.diff(e, a)), [t, a], backend="numpy")(t=0.6, a=0.9)
    for k, name in enumerate(("t", "a")):
        at = {"t": 0.6, "a": 0.9}
        h = 1e-4
        values = [f({**at, name: at[name] + s * h}) for s in (-2, -1, 1, 2)]
        quotient = (8 * (values[2] - values[1]) - (values[3] - values[0])) / (12 * h)
        assert g[k] == pytest.approx(quotient, rel=2e-6)


def test_a_surface_with_kinks_is_carried_along() -> None:
    """x + x³ < t - k(y) is ∫X(t - k) dy with x = X(u) the root of x + x³ = u: dX/du = 1/(1 + 3x²), d²X/du² = -6x/(1 + 3x²)³.

    With more than two kinks the surface stays one, its velocity jumps at the kinks, and so does a term of the divergence.
    """
    kinks = {0.3: 0.5, 0.6: 0.3, 0.8: 0.2}
    fold = sum(a * teg.abs(y - p) for p, a in kinks.items())
    f = teg.compile(teg.integral(teg.bracket(x + x**3 + fold < t), (x, 0, 2), (y, 0, 1)), backend="numpy")

    def second(v: mpmath.mpf) -> mpmath.mpf:
        u = 1.1 - sum(a * abs(v - p) for p, a in kinks.items())
        root = mpmath.findroot(lambda s: s + s**3 - u, 0.5)
        return -6 * root / (1 + 3 * root**2) ** 3

    assert f.hessian(t=1.1)["t", "t"] == pytest.approx(float(mpmath.quad(second, [0, *kinks, 1])), rel=1e-9)


@pytest.mark.parametrize("slopes", [{0.3: 0.5}, {0.3: 0.5, 0.6: 0.3, 0.8: 0.2}], ids=["one kink", "three kinks"])
def test_a_delta_is_carried_along_with_a_surface_with_kinks(slopes: dict[float, float]) -> None:
    """∫∫ δ(t - x - k(y))·x² dx dy is ∫ (t - k)² dy, whose derivative is 2·t - 2·∫k. The velocity jumps at each kink, x² at none."""
    fold = sum(s * teg.abs(y - p) for p, s in slopes.items())
    e = teg.integral(teg.delta(t - x - fold) * x**2, (x, -2, 2), (y, 0, 1))
    exact = 2 * 0.9 - sum(s * (p**2 + (1 - p) ** 2) for p, s in slopes.items())
    assert teg.evaluate(d(e), {t: 0.9}) == pytest.approx(exact, rel=1e-13)


FOLDED = {
    # weight, and second derivatives by (t, t), (t, a) and (a, a); with numbers l and r left and right of t the integral is
    # l·t·(a + 0.2) + r·(0.3·a + 0.035)
    "number": (teg.bracket(x < 2), (0.0, 1.0, 0.0)),
    "jump on the kink": (teg.where(x < t, 1, 3), (0.0, 1.0, 0.0)),
    "of the place": (x, (0.4, 0.6, 0.0)),
    "of the place, with the jump": (teg.where(x < t, x, 3), (0.4, 0.3, 0.0)),
    "of the distance": (teg.where(x < t, 0, x - t), (0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("name", FOLDED)
@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.usefixtures("x64_for_jax")
def test_the_velocity_and_the_weight_jump_on_one_kink(name: str, backend: str) -> None:
    """{max(0, x - t) + max(0, y - a) + max(0, y - a - 0.1) < 0.3}: the part right of t moves with t, all of it with a."""
    weight, exactly = FOLDED[name]
    fold = sum((teg.maximum(0, u) for u in (x - t, y - a, y - a - 0.1)), start=teg.maximum(0, 0))
    f = teg.compile(teg.integral(weight * teg.bracket(fold < 0.3), (x, 0, 1), (y, 0, 1)), [t, a], backend=backend)
    second = f.hessian(t=0.3, a=0.2)
    assert [second["t", "t"], second["t", "a"], second["a", "a"]] == pytest.approx(exactly, abs=1e-9)
    assert second["a", "t"] == pytest.approx(second["t", "a"], abs=1e-9)


def test_derivatives_nest() -> None:
    e = teg.integral(teg.bracket(x < t) * x**3, (x, 0, 1))
    orders = [t**4 / 4, t**3, 3 * t**2, 6 * t, 6.0 + 0 * t]
    for exact in orders:
        assert teg.evaluate(e, {t: 0.5}) == pytest.approx(float(teg.evaluate(exact, {t: 0.5})), rel=1e-14)
        e = teg.diff(e, t)


@pytest.mark.parametrize(
    "name",
    ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs", "erf", "erfc", "log1p", "expm1"],
)
def test_derivatives_of_functions(name: str) -> None:
    f = teg.compile(getattr(teg, name)(t) + teg.atan2(t, a) + t**a + a**t + teg.mod(t, a) + teg.floor(t), [t, a])
    assert teg.check_gradient(f, t=0.37, a=0.83)
