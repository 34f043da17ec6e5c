"""The functions of numbers: their values, on numbers, tuples and indices."""

from __future__ import annotations

import math

import pytest

import teg
from teg.errors import OperandError

t, a = teg.params("t a")
NAMES = ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p", "erf", "erfc"]
NAMES += ["sqrt", "floor", "ceil"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [0.3, 0.75])
def test_values_are_those_of_math(name: str, value: float) -> None:
    assert teg.evaluate(getattr(teg, name)(t), t=value) == pytest.approx(getattr(math, name)(value), rel=4e-16)


@pytest.mark.parametrize("name", NAMES)
def test_a_number_gives_a_number(name: str) -> None:
    assert float(getattr(teg, name)(0.5)) == getattr(math, name)(0.5)


def test_functions_of_two_numbers() -> None:
    assert teg.evaluate(teg.atan2(t, a), t=1.0, a=-1.0) == math.atan2(1.0, -1.0)
    assert teg.evaluate(teg.mod(t, a), t=-1.25, a=1.0) == 0.75
    assert teg.evaluate(teg.minimum(t, a, 1), t=3.0, a=2.0) == 1.0
    assert teg.evaluate(teg.maximum(t, a, 1), t=3.0, a=2.0) == 3.0


@pytest.mark.parametrize(("value", "rounded", "sign"), [(2.5, 2.0, 1.0), (-1.5, -2.0, -1.0), (0.0, 0.0, 0.0)])
def test_rounding_and_signs(value: float, rounded: float, sign: float) -> None:
    assert teg.evaluate(teg.abs(t), t=value) == abs(value)
    assert teg.evaluate(teg.sign(t), t=value) == sign
    assert float(teg.round(value)) == rounded


def test_tuples_go_entry_by_entry() -> None:
    assert teg.evaluate(teg.sin(teg.tuple(t, a)), t=0.5, a=0.25) == (math.sin(0.5), math.sin(0.25))
    assert teg.evaluate(teg.maximum(teg.tuple(t, a), 0.3), t=0.5, a=0.25) == (0.5, 0.3)


def test_integers_stay_integers() -> None:
    k = teg.index("k")
    assert isinstance(teg.maximum(k, 2), teg.Index)
    assert isinstance(teg.minimum(k, 2), teg.Index)


@pytest.mark.parametrize("extremum", [teg.minimum, teg.maximum])
def test_a_list_of_python_is_no_operand(extremum: object) -> None:
    with pytest.raises(OperandError, match="with a star"):
        extremum([t, a])  # type: ignore[operator]
