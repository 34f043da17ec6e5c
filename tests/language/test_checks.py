"""Checks of whole programs and lists of parameters, each with its error."""

from __future__ import annotations

import pytest

import teg
from teg.errors import NameClashError, ParameterError, ScopeError
from teg.language.checks import check_parameters, check_program

x = teg.var("x")
a, t = teg.params("a t")


def test_a_closed_program_passes() -> None:
    check_program(teg.integral(teg.bracket(x < t), (x, 0, 1)))


def test_a_variable_outside_of_its_integral() -> None:
    with pytest.raises(ScopeError, match="outside its integral: x"):
        check_program(x + t)


def test_one_name_for_two_things() -> None:
    with pytest.raises(NameClashError, match="'x' is a parameter and a variable"):
        check_program(teg.integral(x, (x, 0, 1)) + teg.param("x"))


def test_one_parameter_or_several() -> None:
    assert check_parameters(t) == [t]
    assert check_parameters((a, t)) == [a, t]


@pytest.mark.parametrize("wrong", [t + 1, "t", ["t"], [x], 3, [t, t]])
def test_what_is_no_list_of_parameters(wrong: object) -> None:
    with pytest.raises(ParameterError):
        check_parameters(wrong)
