"""The steps of floor, mod, round and ceil, written out: values, derivatives, ties, and what is refused."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
import pytest

import teg
from teg.analysis.places import linear_places
from teg.analysis.staircase import Box, Range, count_steps, is_step
from teg.errors import NotDifferentiableError
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.expr import UncountedFloor
from teg.ir.node import postorder
from teg.ir.simplify import call
from teg.passes.normalise.steps import enumerate_steps
from teg.pipeline import normal_form
from tests.passes.normalise.step_problems import INT, PROBLEMS, SQUARE, B, a, board, m, t, x, y, z

HEAVY = ("stripes-at-an-angle", "checkerboard-by-an-angle", "checkerboard-rotated-shaded", "two-floors-of-one-variable")
"""Second derivatives of many cells."""
IN_C = (
    "floor-of-a-product", "remainder-by-a-negative-parameter", "stripes-weighted", "floor-of-a-wave", "floor-as-a-bound",
    "stripes-of-varying-width", "checkerboard-rotated-shaded", "floor-of-a-square",
)  # fmt: skip
IN_JAX = ("floor-of-a-product", "stripes-weighted", "floor-of-a-sum-over-a-square")


def check(name: str, backend: str, orders: int) -> None:
    problem = PROBLEMS[name]
    f = teg.compile(problem.build(), [teg.param(k) for k in problem.params], backend=backend)
    assert f(problem.params) == pytest.approx(float(problem.value), rel=1e-12, abs=1e-14)
    gradient = f.grad(problem.params)
    for k, exact in problem.grad.items():
        assert gradient[k] == pytest.approx(float(exact), rel=1e-12, abs=1e-13), k
    if orders == 2:
        hessian = f.hessian(problem.params)
        for (p, q), exact in problem.hess.items():
            assert hessian[p, q] == pytest.approx(float(exact), rel=1e-11, abs=1e-12), (p, q)
            assert hessian[q, p] == pytest.approx(float(exact), rel=1e-11, abs=1e-12), (q, p)


@pytest.mark.parametrize("name", [k for k in PROBLEMS if k not in HEAVY])
def test_numpy(name: str) -> None:
    check(name, "numpy", 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", HEAVY)
def test_numpy_where_cells_are_many(name: str) -> None:
    check(name, "numpy", 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", HEAVY)
def test_second_derivatives_where_cells_are_many(name: str) -> None:
    check(name, "numpy", 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_C)
def test_c(name: str) -> None:
    check(name, "c", 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", [k for k in PROBLEMS if k not in HEAVY])
def test_c_to_second_order(name: str) -> None:
    check(name, "c", 2)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("name", IN_JAX)
def test_jax(name: str) -> None:
    check(name, "jax", 1)


def test_rings() -> None:
    """[mod(r + t, ½) < ⅕] over a square, r the distance from its centre: areas of discs cut by a square."""

    def disc(r: float) -> float:
        if r <= 1:
            return math.pi * max(r, 0.0) ** 2
        if r * r >= 2:
            return 4.0
        corner = math.sqrt(r * r - 1)
        return 4 * (corner + 0.5 * r * r * (math.asin(1 / r) - math.asin(corner / r)))

    f = teg.compile(INT(B(teg.mod(teg.sqrt(x * x + y * y) + t, 0.5) < 0.2), (x, -1, 1), (y, -1, 1)))
    assert f(t=0.1) == pytest.approx(sum(disc(0.5 * k + 0.1) - disc(0.5 * k - 0.1) for k in range(4)), rel=1e-11)


# -- the form ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("e", "written_out"),
    [
        (INT(x * teg.floor(x), (x, 0, 3)), INT(x * B(x >= 1) + x * B(x >= 2), (x, 0, 3))),
        (INT(x * teg.floor(x), (x, -1, 2)), INT(-x * B(~(x >= 0)) + x * B(x >= 1), (x, -1, 2))),
        (INT(B(teg.floor(x) < 2), (x, 0, 4)), INT(1 - B(x >= 2), (x, 0, 4))),
        (INT(x * B(teg.floor(x) < 2), (x, 0, 4)), INT(x * B(~(x >= 2)), (x, 0, 4))),
        (INT(teg.floor(x), (x, 0.25, 0.75)), teg.ir.expr.ZERO),
        (INT(teg.ceil(x), (x, 0, 1)), INT(1, (x, 0, 1))),
        (INT(x % 2, (x, 0, 2)), INT(x, (x, 0, 2))),
    ],
    ids=lambda e: str(e),
)
def test_normal_form(e: teg.Expr, written_out: teg.Expr) -> None:
    assert str(normal_form(e)) == str(normal_form(written_out))


@pytest.mark.parametrize("name", PROBLEMS)
def test_twice_is_once(name: str) -> None:
    e = PROBLEMS[name].build()
    once = enumerate_steps(e)
    assert not any(is_step(n) for n in postorder([once]))
    assert enumerate_steps(once) is once
    normal = normal_form(e)
    assert enumerate_steps(normal) is normal


def test_what_has_no_steps_is_left_alone() -> None:
    e = INT(teg.floor(t) * x + teg.mod(t, a), (x, 0, 1))
    assert enumerate_steps(e) is e


def test_one_body_under_two_ranges() -> None:
    """The same floor has two steps in one integral, a thousand in another."""
    e = INT(teg.floor(x), (x, 0, 1000)) + t * INT(teg.floor(x), (x, 0, 2))
    value, gradient = teg.compile(e).value_and_grad(t=2.0)
    assert value == pytest.approx(499502, rel=1e-12)
    assert gradient["t"] == pytest.approx(1.0, rel=1e-14)


def test_the_sign_of_a_condition_on_integers_is_no_border() -> None:
    f = teg.compile(INT(x * board(4 * x + t, 4 * y, a, 0), *SQUARE))
    assert f.diagnose(t=0.3, a=1.0) == []


@pytest.mark.parametrize(
    ("u", "count"),
    [
        (3 * x + t, 5),  # three inside, and one at each end
        (3 * x - 2 * y + t, 7),
        (x * x + t, 3),
        (2 * teg.cos(t) * x - teg.sin(t) * y, 5),  # at most |2·cos t| + |sin t| ≤ 3
        (t * x, 17),
        (t * x + a * y, 17),
        (x / 0.1, 9),
        (2.5 * x, 2),
        (teg.where(y < 0.5, 3 * x, 2), 3),  # 2 and 3 are not passed, but 2 is stayed at
        (teg.where(y < 0.5, 0.5 * x, 2), 2),
    ],
    ids=lambda v: str(v),
)
def test_how_many_steps(u: teg.Expr, count: int) -> None:
    unit = Range(teg.ir.expr.ZERO, teg.ir.expr.ONE)
    steps = count_steps(u, Box({x: unit, y: unit}))
    assert steps is not None
    assert len(steps.over) == count
    assert (steps.guard is teg.ir.expr.TRUE) == (count < 17)


@pytest.mark.parametrize("u", [300 * x, 300 * x + t, 1 / (x - 0.5), x + z], ids=lambda v: str(v))
def test_steps_that_are_not_counted(u: teg.Expr) -> None:
    assert count_steps(u, Box({x: Range(teg.ir.expr.ZERO, teg.ir.expr.ONE)})) is None


def test_fewer_steps_inside_the_cell_of_another_floor() -> None:
    whole = Box({x: Range(teg.ir.expr.ZERO, teg.ir.expr.const(8))})
    for u, v, count in ((2 * x, x, 1), (2 * x + t, x + t, 4), (a * x, a * x + t, 3), (x - t, x + t, 3)):
        steps = count_steps(u, whole.cell(v, teg.ir.expr.const(3)))
        assert steps is not None
        assert (len(steps.over), steps.guard) == (count, teg.ir.expr.TRUE)


# -- rounding ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [-2.5, -1.5, -0.5, -0.2, 0.0, 0.2, 0.49999999999999994, 0.5, 1.5, 2.5, 3.7, -3.0, 2.0**52 + 1, -1e300])
def test_rounding_parameters_is_pythons(value: float) -> None:
    f = teg.compile(teg.tuple(teg.round(t), teg.floor(t), teg.ceil(t), teg.mod(t, 3)))
    assert f(t=value) == (round(value), math.floor(value), math.ceil(value), value % 3)
    assert [g["t"] for g in (f.grad(t=value),)] == [(0.0, 0.0, 0.0, 1.0)]


def test_rounding_numbers() -> None:
    assert teg.evaluate(teg.round(2.5) + teg.ceil(-0.5)) == 2.0


# -- ties ----------------------------------------------------------------------------------------------------------------

TIES = {  # a step on a bound, a stripe's border on another or on a bound
    "a step on both bounds": (INT(teg.exp(x) * teg.floor(3 * x + t), (x, 0, 1)), {"t": 2.0}),
    "a step on one bound": (INT(teg.exp(x) * teg.floor(2.5 * x + t), (x, 0, 1)), {"t": 2.0}),
    "a period that is not binary": (INT(x * teg.mod(x + t, 0.1), (x, 0, 1)), {"t": 0.3}),
    "stripes that leave": (INT(x * B(teg.mod(x + t, 0.1) < a), (x, 0, 1)), {"t": 0.3, "a": 0.05}),
    "stripes without width": (INT(x * B(teg.mod(x + t, 0.25) < a), (x, 0, 1)), {"t": 0.3, "a": 0.0}),
    "stripes that touch": (INT(x * B(teg.mod(x + t, 0.25) < a), (x, 0, 1)), {"t": 0.3, "a": 0.25}),
    "a scaled step on a bound": (INT(x * teg.floor(x * t), (x, 1, 3)), {"t": -2.0}),
    "a period that fits": (INT(x * teg.mod(x, m), (x, 0, 1)), {"m": 0.25}),
    "a bound on a step": (INT(x * teg.floor(x), (x, 0, t)), {"t": 3.0}),
    "a bracket on a step": (INT(B(x < t) * x * teg.floor(2 * x), (x, 0, 3)), {"t": 1.5}),
    "a curved step": (INT(teg.floor(teg.exp(x) + t), (x, 0, 1)), {"t": 1.0}),
    "a corner": (INT(x * x * teg.floor(x + y + t), *SQUARE), {"t": 1.0}),
}


@pytest.mark.parametrize("name", TIES)
def test_ties_give_the_mean_of_both_sides(name: str) -> None:
    e, at = TIES[name]
    f = teg.compile(e)
    gradient = f.grad(at)
    for k in at:
        h = 1e-4
        v = [f({**at, k: at[k] + i * h}) for i in range(-3, 4)]
        right = (-11 * v[3] + 18 * v[4] - 9 * v[5] + 2 * v[6]) / (6 * h)
        left = (11 * v[3] - 18 * v[2] + 9 * v[1] - 2 * v[0]) / (6 * h)
        assert gradient[k] == pytest.approx(0.5 * (left + right), rel=1e-7, abs=1e-9), k


def test_a_floor_is_closed_on_the_left() -> None:
    for at in (1.0, 2.0):
        assert teg.evaluate(INT(teg.delta(x - t) * B(teg.floor(t) <= teg.floor(x)), (x, 0, 3)), {t: at + 0.25}) == 1.0
    e = INT(B((x >= 1) & (teg.floor(x) < 1)), (x, 0, 3))
    assert teg.evaluate(e) == 0.0


# -- steps that are too many ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [0.3, 5.1, -3.3, 16.9, 17.5, 23.7, -20.2])
def test_a_number_of_steps_that_parameters_decide(at: float) -> None:
    """∫₀¹ floor(x·t) dx; beyond MAX_PERIODIC steps there is a value but no derivative."""
    f = teg.compile(INT(teg.floor(x * t), (x, 0, 1)))
    steps = math.floor(abs(at))
    exact = steps - steps * (steps + 1) / (2 * abs(at))
    assert f(t=at) == pytest.approx(exact if at > 0 else -1 - exact, rel=1e-9)
    if abs(at) < 17:
        gradient = f.grad(t=at)
        assert gradient["t"] == pytest.approx(steps * (steps + 1) / (2 * at * at), rel=1e-12)
    else:
        with pytest.warns(AccuracyWarning, match="the gradient is not a number"):
            assert math.isnan(f.grad(t=at)["t"])
        with pytest.warns(AccuracyWarning, match="not a number"):
            assert math.isnan(f.hessian(t=at)["t", "t"])


@pytest.mark.parametrize(
    ("at", "value", "slope", "bend"),
    [
        (0.5, 0.5, 1.0, 0.0),  # t
        (1.5, 0.875, -0.5, -1.0),  # t - (t² - 1)/2
        (3.7, 3.7 - 13 / 72 * 3.7**2 - 0.5, 1 - 13 / 36 * 3.7, -13 / 36),  # t - 13t²/72 - 1/2
        (-0.5, 1.0, 1.0, 0.0),  # t + 3/2
        (-2.5, 0.78125, 0.375, 0.25),  # t + t²/8 + 5/2
    ],
)
def test_steps_that_may_lie_at_infinity(at: float, value: float, slope: float, bend: float) -> None:
    """t/x steps at x = t/k: where k is 0 there is no step, and nothing of it may come into a derivative."""
    f = teg.compile(INT(teg.mod(t, x), (x, 1, 2)), [t])
    assert f(t=at) == pytest.approx(value, rel=1e-14)
    assert f.grad(t=at)["t"] == pytest.approx(slope, rel=1e-14)
    assert f.hessian(t=at)["t", "t"] == pytest.approx(bend, rel=1e-14, abs=1e-14)


def test_a_derivative_that_steps_have_no_part_in_has_no_end() -> None:
    """Only the bound moves: the derivative of ∫₀ᵗ floor(x) dx is floor(t), however many steps there are."""
    f = teg.compile(INT(teg.floor(x), (x, 0, t)))
    value, gradient = f.value_and_grad(t=30.5)
    assert value == pytest.approx(450, rel=1e-9)
    assert gradient["t"] == 30.0


def test_a_branch_that_is_not_taken_needs_no_steps() -> None:
    inside = INT(teg.where(t > 0, x * teg.floor(x * t), 7), (x, 0, 1))
    outside = teg.where(t > 0, INT(x * teg.floor(x * t), (x, 0, 1)), 7)
    for e in (inside, outside):
        f = teg.compile(e)
        assert f.value_and_grad(t=-30.0) == (7.0, {"t": 0.0})
        with pytest.warns(AccuracyWarning, match="not a number"):
            assert math.isnan(f.grad(t=30.0)["t"])


def test_what_stays_a_floor_is_left_alone() -> None:
    once = normal_form(INT(teg.floor(x * t), (x, 0, 1)))
    assert sum(isinstance(n, UncountedFloor) for n in postorder([once])) == 1
    assert normal_form(once) is once


def test_a_floor_of_a_maximum_is_one_like_any_other() -> None:
    u = 3 * x + t
    f, same = (teg.compile(INT(teg.floor(v) * x, (x, 0, 1)), [t]) for v in (u, call("max", u, u)))
    assert same(t=0.3) == pytest.approx(f(t=0.3), rel=1e-13)
    assert same.grad(t=0.3)["t"] == pytest.approx(f.grad(t=0.3)["t"], rel=1e-13)


@pytest.mark.parametrize(
    "e",
    [
        INT(teg.floor(300 * x + t), (x, 0, 1)),
        INT(B(teg.mod(300 * x, 1) < t), (x, 0, 1)),
        INT(board(40 * x + t, 40 * y, 1, 0), *SQUARE),
        INT(teg.floor(1 / (x - 0.3) + t), (x, 0, 1)),
    ],
    ids=lambda e: str(e),
)
def test_steps_that_cannot_be_written_out_are_refused(e: teg.Expr) -> None:
    with pytest.raises(NotDifferentiableError) as caught:
        teg.compile(e).grad(t=0.3)
    assert caught.value.where is not None
    assert "bounds" in caught.value.hint


def test_an_open_expression_is_refused() -> None:
    with pytest.raises(NotDifferentiableError):
        teg.diff(teg.floor(x * t), t)


def test_floors_that_do_not_move_may_be_many() -> None:
    f = teg.compile(INT(t * teg.floor(300 * x) + B(y < t), *SQUARE))
    assert f.grad(t=0.3)["t"] == pytest.approx(149.5 + 1, rel=1e-6)


def test_a_product_of_many_floors() -> None:
    """Their grid would have too many cells: the sums of brackets are multiplied as they stand."""
    shifts = [0.15 + 0.1 * i for i in range(8)]
    at = dict(zip("abcdefgh", shifts, strict=True))
    factors = [teg.floor((1 + 0.1 * i) * x + teg.param(k)) + 1 for i, k in enumerate(at)]
    value, gradient = teg.compile(INT(reduce(lambda p, q: p * q, factors), (x, 0, 1))).value_and_grad(at)

    def exact(at: dict[str, float]) -> float:
        crossings = [(n - v) / (1 + 0.1 * i) for i, v in enumerate(at.values()) for n in (1, 2)]
        ends = np.unique(np.clip([0.0, 1.0, *crossings], 0, 1))
        middle = 0.5 * (ends[1:] + ends[:-1])
        levels = [np.floor((1 + 0.1 * i) * middle + v) + 1 for i, v in enumerate(at.values())]
        return float(np.sum(np.prod(levels, axis=0) * np.diff(ends)))

    assert value == pytest.approx(exact(at), rel=1e-13)
    h = 1e-3
    for k in at:
        difference = (exact({**at, k: at[k] + h}) - exact({**at, k: at[k] - h})) / (2 * h)  # linear in each shift, nearby
        assert gradient[k] == pytest.approx(difference, rel=1e-9)


@pytest.mark.slow
def test_many_floors_of_one_variable_in_one_summand() -> None:
    """Twenty floors in a square and in a condition: as many cells as there are crossings, not as there are combinations."""
    shifts = [i / 20 + 0.01 for i in range(20)]
    total = reduce(lambda p, q: p + q, [teg.floor(x + s) for s in shifts])
    e = INT(total * total * t + B(total < 7), (x, 0, 2))
    ends = np.unique([0.0, 2.0, *(n - s for s in shifts for n in (1, 2))])
    levels = sum(np.floor(0.5 * (ends[1:] + ends[:-1]) + s) for s in shifts)
    squares = float(np.sum(levels**2 * np.diff(ends)))
    value, gradient = teg.compile(e).value_and_grad(t=1.0)
    assert value == pytest.approx(squares + float(np.sum((levels < 7) * np.diff(ends))), rel=1e-13)
    assert gradient["t"] == pytest.approx(squares, rel=1e-13)
    assert teg.size(enumerate_steps(e)) < 1000


@pytest.mark.parametrize(
    ("e", "linear"),
    [
        (teg.floor(x) * y + 1, [True]),
        (teg.floor(x) * teg.floor(y), [True, True]),
        (teg.floor(x) * (1 + teg.floor(x)), [False]),
        (teg.where(x < t, teg.floor(x), 0), [True]),
        (teg.where(teg.floor(x) < t, 1, y), [False]),
        (teg.sin(teg.floor(x)), [False]),
        (teg.floor(teg.floor(x) + y), [False, True]),
        (INT(z * teg.floor(x), (z, 0, 1)), [True]),
        (INT(z, (z, 0, teg.floor(x))), [False]),
    ],
    ids=lambda v: str(v),
)
def test_linear_places(e: teg.Expr, linear: list[bool]) -> None:
    assert list(linear_places(e, is_step).values()) == linear


@pytest.mark.slow
@pytest.mark.parametrize("at", [1.3, -2.2, 9.7])
def test_a_product_of_floors_whose_steps_parameters_decide(at: float) -> None:
    f = teg.compile(INT(teg.floor(x * t) * teg.floor(2 * x * t) * teg.floor(x * t + 0.5), (x, 0, 1)))

    def exact(t: float) -> float:
        ends = np.unique(np.clip([0.0, 1.0, *(n / (2 * t) for n in range(-40, 41))], 0, 1))
        middle = 0.5 * t * (ends[1:] + ends[:-1])
        return float(np.sum(np.floor(middle) * np.floor(2 * middle) * np.floor(middle + 0.5) * np.diff(ends)))

    assert f(t=at) == pytest.approx(exact(at), rel=1e-9)
    if abs(at) < 8:
        gradient = f.grad(t=at)
        h = 1e-3
        difference = (exact(at - 2 * h) - 8 * exact(at - h) + 8 * exact(at + h) - exact(at + 2 * h)) / (12 * h)
        assert gradient["t"] == pytest.approx(difference, rel=1e-8)
    else:
        with pytest.warns(AccuracyWarning, match="not a number"):
            assert math.isnan(f.grad(t=at)["t"])


PLATEAUS: dict[str, tuple[teg.Expr, float, float]] = {
    "floor of a bracket": (teg.integral(teg.floor(teg.bracket(x < t)), (x, 0, 1)), 0.7, 1.0),
    "floor of what is 1 outside": (teg.integral(teg.floor(1 - teg.bracket(x < t)), (x, 0, 1)), 0.3, -1.0),
    "ceil of a bracket": (teg.integral(teg.ceil(teg.bracket(x < t)), (x, 0, 1)), 0.7, 1.0),
    "remainder of a bracket": (teg.integral(teg.mod(teg.bracket(x < t), 1), (x, 0, 1)), 0.0, 0.0),
    "one region or the other": (
        teg.integral(teg.mod(teg.bracket(x < t) + teg.bracket(y < a), 2), (x, 0, 1), (y, 0, 1)),
        0.7 * 0.7 + 0.3 * 0.3,
        0.7 - 0.3,
    ),
    "both regions": (
        teg.integral(teg.bracket(teg.floor((teg.bracket(x < t) + teg.bracket(y < a)) / 2) > 0.5), (x, 0, 1), (y, 0, 1)),
        0.7 * 0.3,
        0.3,
    ),
    "a choice of whole numbers": (teg.integral(teg.floor(teg.where(x < t, 2, 5)), (x, 0, 1)), 2 * 0.7 + 5 * 0.3, -3.0),
    "a sign": (teg.integral(teg.floor(teg.sign(t - x)), (x, 0, 1)), 0.7 - 0.3, 2.0),
    "the end of a minimum": (teg.integral(teg.floor(teg.minimum(x / t, 2)), (x, 0, 3)), 0.7 + 2 * (3 - 1.4), 1 - 4.0),
    "zero on one side": (teg.integral(teg.floor(x - t - abs(x - t)), (x, -1, 1)), -(0.5 + 2 * 0.5 + 3 * 0.5 + 4 * 0.2), -4.0),
    "a curve up to a plateau": (
        teg.integral(teg.floor(teg.minimum(x * x / t, 1)), (x, 0, 1)),
        1 - math.sqrt(0.7),
        -0.5 / math.sqrt(0.7),
    ),
}
"""Floors of functions with a piece on which they are the largest or the least integer of their range; values and slopes by t at
t = 0.7, a = 0.3."""


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", PLATEAUS)
def test_plateaus_at_the_ends_of_a_staircase(name: str, backend: str) -> None:
    e, value, rate = PLATEAUS[name]
    f = teg.compile(e, [t, a], backend=backend)
    found, slopes = f.value_and_grad(t=0.7, a=0.3)
    assert found == pytest.approx(value, abs=1e-12)
    assert slopes["t"] == pytest.approx(rate, abs=1e-12)


OF_WHOLE_NUMBERS = {
    "a remainder, up to the variable": (teg.mod(x, 1) <= x, 1.0),
    "a remainder by a half": (teg.mod(x, 0.5) <= x, 1.0),
}
"""Conditions in which the variable cancels, and where they hold beside x = 0.4: what remains is the sign of a whole number, here 0."""


@pytest.mark.parametrize("name", OF_WHOLE_NUMBERS)
def test_a_condition_on_a_whole_number_at_a_bound_that_moves(name: str) -> None:
    """The whole number is the border of the condition, and does not move: the bound does not meet a surface."""
    condition, holds = OF_WHOLE_NUMBERS[name]
    f = teg.compile(INT(B(condition) * (1 + x), (x, t, 1)), [t, a])
    value, slopes = f.value_and_grad(t=0.4, a=0.3)
    assert value == pytest.approx(holds * (0.6 + 0.42), rel=1e-14)
    assert slopes["t"] == pytest.approx(-1.4 * holds, rel=1e-14)
    assert not f.diagnose(t=0.4, a=0.3)
