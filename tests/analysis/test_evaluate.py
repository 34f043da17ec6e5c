"""Values of trees at points."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.analysis.evaluate import folded, values_of
from teg.errors import OperandError
from teg.ir import simplify
from teg.ir.expr import const

x, t = teg.var("x"), teg.param("t")
CONDITIONS = {
    "not": (~(x > 0), lambda x, t: not x > 0),
    "not not": (~~(x < t), lambda x, t: x < t),
    "and": ((x < t) & ~(x > 0), lambda x, t: x < t and x <= 0),
    "or": (~(x > 0) | (x > t), lambda x, t: x <= 0 or x > t),
    "not one of two": (~((x > 0) | (t > 0)), lambda x, t: not (x > 0 or t > 0)),
}


@pytest.mark.parametrize("name", CONDITIONS)
@pytest.mark.parametrize("number", [float, np.float64, np.asarray], ids=["float", "float64", "array"])
def test_conditions_at_numbers_of_any_kind(name: str, number: type) -> None:
    condition, holds = CONDITIONS[name]
    for at in (-0.5, 0.5, 0.9):
        for limit in (0.7, -0.7):
            value = values_of([teg.where(condition, 1.0, 2.0)], {x: number(at), t: number(limit)})[0]
            assert value == (1.0 if holds(at, limit) else 2.0)


def test_arrays_broadcast() -> None:
    found = values_of([teg.where(~(x < t), x, 2 * t)], {x: np.array([[0.1], [0.9]]), t: np.array([0.2, 0.5])})[0]
    np.testing.assert_array_equal(found, [[0.4, 1.0], [0.9, 0.9]])


def test_expressions_without_parameters_are_numbers() -> None:
    assert folded(simplify.call("exp", const(1.0))) == const(np.e)
    assert folded(x + 1) == x + 1


def test_what_has_no_value_at_a_point() -> None:
    with pytest.raises(OperandError, match="no value at a point"):
        values_of([teg.integral(teg.bracket(x < t), (x, 0, 1))], {t: 0.5})
