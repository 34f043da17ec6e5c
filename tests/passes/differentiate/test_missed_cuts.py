"""Conditions on angles whose cut is no surface: derivatives are NaN where it may be met and moves, and right elsewhere."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg

pytestmark = pytest.mark.usefixtures("x64_for_jax")

x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]


def program(u: teg.Expr) -> teg.Expr:
    return teg.integral(teg.bracket(2 * teg.atan2(y - a, u) - y * x > t), (x, -1, 1), (y, -1, 1))


def differences(f: teg.Evaluator, at: dict[str, float], step: float = 1e-3) -> dict[str, float]:
    """Returns slopes of values, which have no part in cuts."""

    def change(name: str, h: float) -> float:
        return (f(**{**at, name: at[name] + h}) - f(**{**at, name: at[name] - h})) / (2 * h)

    return {name: (4 * change(name, step / 2) - change(name, step)) / 3 for name in at}


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_cut_that_is_no_surface_is_reported(backend: str) -> None:
    """The derivatives by t and a were -0.84 and 0.52 for -0.31 and -2.24, without a warning."""
    f = teg.compile(program(x - b), backend=backend)
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        gradient = f.grad(a=0.1, b=0.2, t=0.6)
    assert all(math.isnan(g) for g in gradient.values())
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f.hvp({"a": 0.1, "b": 0.2, "t": 0.6}, {"t": 1.0})["t"])


def test_in_all_forms_of_derivatives() -> None:
    e = program(x - b)
    for d in (teg.diff(e, t), teg.grad(e, [t])[0], teg.jvp(e, {a: 1}), teg.hessian(e, [t])[0][0]):
        assert math.isnan(teg.evaluate(d, a=0.1, b=0.2, t=0.6, inaccurate="ignore"))
    assert not math.isnan(teg.evaluate(e, a=0.1, b=0.2, t=0.6))


RADIUS = teg.sqrt(x**2 + y**2)
ANGLE = teg.atan2(y, x)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("condition", "turned"),
    [
        (t + a * ANGLE > RADIUS**2, False),
        (t + a * ANGLE > RADIUS**2, True),
        (teg.sin(0.5 * ANGLE + a) > t, False),
        (ANGLE * (1 + x * y) + a * y > t, False),
    ],
    ids=["a spiral", "a spiral, turned", "half an angle", "a slanted end"],
)
def test_a_cut_that_stays_has_no_mass(condition: teg.Cond, turned: bool, backend: str) -> None:
    """A condition that jumps on the cut, where its region ends whatever the parameters are."""
    box = ((x, -1.3, 1.2), (y, -1.2, 1.1))
    e = teg.integral(teg.exp(x) * teg.bracket(condition), *(box[::-1] if turned else box))
    at = {"a": 0.12, "t": 0.4}
    values = teg.compile(e, [a, t], backend="c")
    assert teg.compile(e, [a, t], backend=backend).grad(**at) == pytest.approx(differences(values, at), rel=1e-6)


def test_second_derivatives_where_a_surface_may_end_on_a_cut() -> None:
    at = {"a": 0.12, "t": 0.4}
    e = teg.integral(teg.bracket(t + a * ANGLE > RADIUS**2), (x, -1, 1), (y, -1, 1))
    f = teg.compile(e, [a, t], backend="numpy")
    for second in (lambda: f.hvp(at, {"a": 1.0})["t"], lambda: f.hessian(at)["a", "a"]):
        with pytest.warns(teg.AccuracyWarning, match="not a number"):
            assert math.isnan(second())
    for d in (teg.hessian(e, [a])[0][0], teg.jvp(teg.diff(e, t), {a: 1})):
        assert math.isnan(teg.evaluate(d, **at, inaccurate="ignore"))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("u", [x + 2, x - b], ids=["a number", "a parameter"])
def test_where_no_cut_can_be_met_derivatives_are_as_before(u: teg.Expr, backend: str) -> None:
    """References are differences of values, which have no part in this."""
    f = teg.compile(program(u), backend=backend)
    at = {"a": 0.1, "t": 0.6, **({"b": -2.0} if "b" in f.parameters else {})}
    for name, slope in f.grad(**at).items():
        change = (f(**{**at, name: at[name] + 1e-4}) - f(**{**at, name: at[name] - 1e-4})) / 2e-4
        assert slope == pytest.approx(change, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize(
    ("condition", "at"),
    [(teg.atan2(y - 0.1, x - b) < t, {"b": 0.2, "t": 0.6}), (teg.atan2(y - a, x - b) ** 2 < 2 * t, {"a": 0.1, "b": 0.2, "t": 0.6})],
    ids=["a cut that stays", "a square"],
)
def test_conditions_that_lack_no_cut(condition: teg.Expr, at: dict[str, float]) -> None:
    """On a cut that stays the condition has no root by formula; θ² has no cut."""
    f = teg.compile(teg.integral(teg.bracket(condition), (x, -1, 1), (y, -1, 1)))
    gradient = f.grad(**at)
    for name in at:
        change = (f(**{**at, name: at[name] + 1e-4}) - f(**{**at, name: at[name] - 1e-4})) / 2e-4
        assert gradient[name] == pytest.approx(change, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_flower_has_no_cut(backend: str) -> None:
    """cos 5θ is the same on both sides of the cut: the area is πt²(1 + a²/2)."""
    radius = t * (1 + a * teg.cos(5 * teg.atan2(y, x)))
    f = teg.compile(teg.integral(teg.bracket(teg.sqrt(x**2 + y**2) < radius), (x, -1, 1), (y, -1, 1)), [t, a], backend=backend)
    gradient = f.grad(t=0.5, a=0.3)
    assert gradient["t"] == pytest.approx(math.pi * 1.045, rel=1e-9)
    assert gradient["a"] == pytest.approx(math.pi * 0.25 * 0.3, rel=1e-9)


@pytest.mark.parametrize("place", [0.0, a])
def test_a_cut_in_one_branch_only(place: teg.Expr | float) -> None:
    """θ counts where x < -0.2, beside the cut; elsewhere θ² does, which has none."""
    angle = teg.atan2(y - place, x)
    g = teg.where(x < -0.2, angle * (1 + x * y), angle**2)
    f = teg.compile(teg.integral(teg.bracket(g > t), (x, -1, 1), (y, -1, 1)), [t])
    at = {"t": 0.5, **({} if place == 0.0 else {"a": 0.1})}
    if place == 0.0:
        assert f.grad(**at) == pytest.approx(differences(f, at), rel=1e-6)
        return
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f.grad(**at)["t"])


def test_a_cut_in_a_range_that_is_not_known_may_be_met() -> None:
    """The range of x ends at an integral over z that depends on y, of which no bounds are known."""
    z = teg.var("z")
    end = teg.integral(teg.exp(z * y), (z, 0, 1))
    f = teg.compile(teg.integral(teg.bracket(2 * teg.atan2(y - a, x - 0.2) - y * x > t), (x, -1, end), (y, -1, 1)), [t, a])
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert math.isnan(f.grad(t=0.6, a=0.1)["t"])


def test_an_angle_inside_of_an_integral_that_decides() -> None:
    """The angle's variable is bound in the condition: bounds of it were looked for outside, where it has none."""
    inner = teg.integral(teg.bracket(x > t) * teg.atan2(x - 0.3, x - 0.5), (x, 0, 1))
    f = teg.compile(teg.where(inner < a, inner * a, a), [t, a])
    value, gradient = f.value_and_grad(t=0.6, a=2.0)
    expected = mpmath.quad(lambda u: mpmath.atan2(u - 0.3, u - 0.5), [0.6, 1])
    assert value == pytest.approx(float(2 * expected), rel=1e-10)
    assert gradient == pytest.approx({"t": -2 * math.atan2(0.3, 0.1), "a": float(expected)}, rel=1e-10)
