"""Diagnoses: which one-sided derivative is given, in the user's words; no alarm where the derivative exists."""

from __future__ import annotations

import random

import numpy as np
import pytest

import teg
from teg.ir.show import show
from teg.report import number_watch
from teg.report.diagnose import Second

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
UNIT = (x, 0, 1)


def step(p: teg.Expr) -> teg.Expr:
    return teg.bracket(x < p)


def messages(e: object, **at: float) -> list[str]:
    return [d.message for d in teg.compile(e).diagnose(at)]


# -- which element is given -------------------------------------------------------------------------------------------------


def test_a_tie_tells_both_sides_and_the_mean() -> None:
    (said,) = messages(teg.integral(step(t) * step(a), UNIT), t=0.5, a=0.5)
    assert "d value / d t is 1 below t and 0 above, given as 0.5, their mean" in said


def test_of_three_surfaces_the_one_in_the_middle_is_not_given_the_mean() -> None:
    f = teg.compile(teg.integral(step(t) * step(a) * step(b), UNIT), [t, a, b])
    given = f.grad(t=0.5, a=0.5, b=0.5)
    said = f.diagnose(t=0.5, a=0.5, b=0.5)[0].message
    for name, slope in given.items():
        words = "their mean" if slope == 0.5 else "the one above" if slope == 0.0 else "the one below"
        assert f"d value / d {name} is 1 below {name} and 0 above, given as {slope:g}, {words}" in said


@pytest.mark.parametrize(
    ("e", "given", "words"),
    [
        (teg.minimum(t, a), "0", "the one above"),
        (teg.maximum(t, a), "0", "the one below"),
        (teg.where(t < a, a - t, 2 * (t - a)), "2", "the one above"),
        (teg.where(t <= a, a - t, 2 * (t - a)), "-1", "the one below"),
    ],
)
def test_the_border_of_a_condition_tells_which_side_is_given(e: teg.Expr, given: str, words: str) -> None:
    (said,) = messages(e, t=0.5, a=0.5)
    assert f"given as {float(teg.compile(e, [t]).grad(t=0.5, a=0.5)['t']):g}, {words}" in said
    assert f"given as {given}, {words}" in said


def test_a_value_that_jumps_is_told() -> None:
    (said,) = messages(teg.integral(teg.where(t < a, x, x * x), UNIT), t=0.5, a=0.5)
    assert "value is 0.5 below t and 0.333333 above" in said


def test_infinite_derivatives_beside_the_point_are_told() -> None:
    """[a·x·y < t] at a = t = 0: the derivative by t is ±inf at any other a, and 0 here. NumPy warned of inf - inf."""
    f = teg.compile(teg.integral(teg.bracket(a * x * y < t), (x, 0, 1), (y, 0, 1)), [t, a], backend="numpy")
    (diagnosis,) = f.diagnose(t=0.0, a=0.0)
    assert diagnosis.kind == "parameter surface"
    assert "value is 0 below t and 1 above" in diagnosis.message


def test_each_pair_is_told_once() -> None:
    assert len(messages(teg.integral(step(t) * step(a), UNIT), t=0.5, a=0.5)) == 1


def test_what_is_not_a_number_has_a_name() -> None:
    (said,) = messages(teg.tuple(t, teg.log(t - a)), t=0.5, a=0.75)
    assert said.startswith("value[1] is not a number")


# -- words -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [2.0, 3.0, -2.0])
def test_a_step_of_a_floor_is_a_number(at: float) -> None:
    found = teg.compile(teg.integral(teg.floor(t * x), UNIT)).diagnose(t=at)
    names = {name for d in found for name in d.surfaces}
    assert f"t·x - {at:g} = 0" in names or f"t·x + {-at:g} = 0" in names
    assert not any("floor" in name or "min(" in name for name in names)


def test_a_floor_of_a_parameter_keeps_its_name() -> None:
    (found,) = teg.compile(teg.floor(3 * a) * teg.integral(step(t), UNIT), [a, t]).diagnose(a=1.0, t=0.5)
    assert found.kind == "parameter surface"
    assert found.surfaces == ("a step of floor(3·a)",)


@pytest.mark.parametrize(("e", "at"), [(teg.ceil(2 * a), 1.5), (teg.mod(a, 0.25), 0.75), (teg.round(a), 1.5)])
def test_steps_of_other_kinds_are_seen(e: teg.Expr, at: float) -> None:
    found = teg.compile(e * t, [a, t]).diagnose(a=at, t=0.5)
    assert {d.kind for d in found} == {"parameter surface"}
    assert found[-1].surfaces == (f"a step of {show(e)}",)
    assert teg.compile(e * t, [a, t]).diagnose(a=at + 0.1, t=0.5) == []


# -- no alarm -----------------------------------------------------------------------------------------------------------------

SMOOTH_AT_GENERIC_POINTS = {
    "round": teg.integral(step(t) * teg.round(3 * a), UNIT),
    "a condition on a floor": teg.integral(teg.where(teg.floor(3 * a) > 1, x, step(t)), UNIT),
    "an even floor": teg.where(teg.mod(teg.floor(5 * a), 2) < 0.5, t, a),
    "floor and ceil": teg.floor(7 * t) + teg.ceil(5 * a),
    "bounds by steps": teg.integral(step(t), (x, 0, teg.floor(7 * a) / 9)),
    "stripes": teg.integral(teg.bracket(teg.mod(a * x + t * y, 0.37) < 0.11), UNIT, (y, 0, 1)),
    "kinks": teg.integral(teg.abs(x - t) + teg.minimum(x, a), UNIT),
}


@pytest.mark.parametrize("name", SMOOTH_AT_GENERIC_POINTS)
def test_nothing_is_said_at_generic_points(name: str) -> None:
    f = teg.compile(SMOOTH_AT_GENERIC_POINTS[name], [t, a])
    numbers = random.Random(7)
    points = np.array([[numbers.uniform(0.05, 0.95), numbers.uniform(0.05, 0.95)] for _ in range(40)])
    assert f.diagnose(t=points[:, 0], a=points[:, 1]) == []


def test_a_derivative_that_goes_through_0_is_no_kink() -> None:
    """An empty triangle: its area is (a - 2t)²/2 on one side."""
    f = teg.compile(teg.integral(teg.bracket((x > t) & (y > t) & (x + y < a)), UNIT, (y, 0, 1)), [t, a])
    assert f.diagnose(t=0.25, a=0.5) == []


def test_a_condition_on_steps_of_entries_is_no_border() -> None:
    k, w = teg.index("k"), teg.array("W")
    f = teg.compile(teg.sum(teg.where(teg.floor(3 * w[k]) > 1, w[k], 2.0), (k, 0, 3)), [w])
    assert f.diagnose(W=[0.1, 0.8, 0.9]) == []


def test_the_program_is_compiled_once() -> None:
    f = teg.compile(teg.integral(step(t) * teg.exp(a * x), UNIT), [t, a])
    f.diagnose(t=0.5, a=1.0)
    before = list(f._watches)
    f.diagnose(t=0.25, a=1.0)
    assert len(before) == 1
    assert list(f._watches) == before


def test_surfaces_that_meet_on_a_boundary_are_told_without_the_compilers_formulas() -> None:
    f = teg.compile(teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)), [t, a])
    f.hessian(t=1.0, a=1.0)
    (crease,) = f.diagnose(t=1.0, a=1.0)
    assert (crease.kind, crease.surfaces) == ("second derivative", ())
    assert "second derivatives differ" in crease.message
    assert [d.kind for d in f.diagnose(t=1.0, a=0.0)] == ["tie"]


@pytest.mark.parametrize(
    "e", [teg.bracket(a * x + t > 0), teg.bracket(a * x < t) * x, teg.floor(a * x + t), teg.ceil(a * x + t) * x, teg.mod(a * x + t, 1)]
)
def test_a_surface_that_is_all_of_an_integral_is_told(e: teg.Expr) -> None:
    """Values jump at a = t = 0, and in no neighbourhood is there another tie; it was said of none of them."""
    f = teg.compile(teg.integral(e, UNIT), [t, a])
    found = f.diagnose(t=0.0, a=0.0)
    assert {d.kind for d in found} == {"parameter surface"}
    assert any("value is " in d.message for d in found)
    assert f.diagnose(t=0.3, a=0.0) == []


def test_a_surface_that_is_all_of_an_integral_and_jumps_nowhere_is_not_told() -> None:
    f = teg.compile(teg.integral(teg.maximum(a * x + t, 0.0) ** 2, UNIT), [t, a])
    assert f.diagnose(t=0.0, a=0.0) == []


def test_products_are_looked_at_too() -> None:
    """Nothing was said where only products of the Hessian were asked for."""
    f = teg.compile(teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)), [t, a])
    assert f.diagnose(t=1.0, a=1.0) == []
    f.hvp({"t": 1.0, "a": 1.0}, {"t": 1.0})
    assert [d.kind for d in f.diagnose(t=1.0, a=1.0)] == ["second derivative"]
    assert f.diagnose(t=0.9, a=1.0) == []


def test_what_is_said_of_second_derivatives() -> None:
    def said(finite: bool, jumps: bool, mean: bool) -> str:
        return Second(finite, jumps, mean).message

    assert said(True, False, True) == ""
    assert "their mean is given" in said(True, True, True)
    assert "no mean of them is given" in said(True, True, False)
    assert "other ones" in said(True, False, False)
    assert "more than two sides" in said(False, True, False)
    assert "infinite" in said(False, False, True)


def test_a_gradient_that_takes_too_long_is_not_looked_into(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(number_watch, "MOST_EVALUATIONS", 500)
    e = teg.integral(teg.bracket(teg.sin(x * y) < t), (x, 0, 2), (y, 0, 2))
    (said,) = teg.compile(e).diagnose(t=0.9)
    assert said.kind == "not looked at"
    assert "more than 500 evaluations" in said.message
