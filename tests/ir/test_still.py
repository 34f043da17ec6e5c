"""Parameters that do not move: the value of the parameter, the derivative 0."""

from __future__ import annotations

import pytest

import teg
from teg.ir.still import has_still, released, with_still_conditions, with_still_parameters

x = teg.var("x")
a, t = teg.params("a t")
E = teg.integral(teg.bracket(x < t) * a * x, (x, 0, 1))


def test_releasing_is_the_inverse() -> None:
    still = with_still_parameters(E)
    assert still is not E
    assert has_still(still)
    assert not has_still(E)
    assert released(still) is E
    assert released(E) is E


def test_the_value_is_that_of_the_parameters() -> None:
    assert teg.evaluate(released(with_still_parameters(E)), t=0.5, a=2.0) == teg.evaluate(E, t=0.5, a=2.0)


def test_conditions_stay_and_other_places_move() -> None:
    still = with_still_conditions(E)
    assert has_still(still)
    f = teg.compile(still, [t, a])
    value, gradient = f.value_and_grad(t=0.5, a=2.0)
    assert (value, gradient) == (pytest.approx(0.25), {"t": 0.0, "a": pytest.approx(0.125)})
