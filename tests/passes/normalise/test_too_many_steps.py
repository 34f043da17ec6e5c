"""Steps that are too many to be written out: NaN where they move, an error where no variable can be sifted."""

from __future__ import annotations

import pytest

import teg
from teg.errors import NotDifferentiableError
from teg.ir.simplify import uncounted_floor
from teg.passes.normalise.too_many_steps import check_steps, without_uncounted

x = teg.var("x")
a, t = teg.params("a t")
STEPS = uncounted_floor(t * x)


def choice(e: teg.Expr, other: teg.Expr = a) -> teg.Expr:
    return teg.where(t < 10, teg.integral(other * x, (x, 0, 1)), teg.integral(e, (x, 0, 1)))


def test_the_alternative_with_moving_steps_is_no_number() -> None:
    e = without_uncounted(choice(STEPS), [t])
    assert e is not choice(STEPS)
    f = teg.compile(e, [t, a])
    assert f(t=5.0, a=4.0) == 2.0
    with pytest.warns(teg.AccuracyWarning):
        assert f(t=20.0, a=4.0) != f(t=20.0, a=4.0)  # NaN


def test_steps_that_do_not_move_stay() -> None:
    assert without_uncounted(choice(STEPS), [a]) is choice(STEPS)
    assert without_uncounted(choice(teg.exp(x)), [t]) is choice(teg.exp(x))


def test_a_second_time_nothing_changes() -> None:
    once = without_uncounted(choice(STEPS), [t])
    assert without_uncounted(once, [t]) is once


def test_a_moving_condition_on_steps_alone_is_an_error() -> None:
    e = teg.integral(teg.bracket(teg.floor(x) < t), (x, 0, 1))
    with pytest.raises(NotDifferentiableError):
        check_steps(e, [t])
    check_steps(e, [a])
    check_steps(teg.integral(teg.bracket(x < t), (x, 0, 1)), [t])
