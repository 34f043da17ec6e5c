"""Names of flat programs: what their letters say, and that the operations agree."""

from __future__ import annotations

import pytest

from teg.program import Assign, Program
from teg.program.names import is_condition, is_number, is_parameter, parameter_number, unused_numbers
from teg.program.operations import OPERATIONS, letter_of
from teg.program.verify import MalformedProgram, verify_program


def test_each_letter_is_one_kind() -> None:
    for test, name in ((is_number, "v3"), (is_condition, "b4"), (is_parameter, "p0")):
        assert [test(n) for n in ("v3", "b4", "p0", "x1", 1.0, True)] == [n == name for n in ("v3", "b4", "p0", "x1", 1.0, True)]
    assert parameter_number("p12") == 12


def test_unused_numbers_follow_the_largest() -> None:
    assert next(unused_numbers(["v3", "b12", "x7", "teg"])) == 13
    assert next(unused_numbers([])) == 1


def test_letters_follow_from_operations() -> None:
    assert {op for op in OPERATIONS if letter_of(op) == "b"} == {"gt0", "ge0", "lt0", "le0", "ok", "and", "or", "not", "tie"}


@pytest.mark.parametrize(("name", "op"), [("v0", "ge0"), ("b0", "abs")])
def test_a_name_with_the_letter_of_another_kind_is_malformed(name: str, op: str) -> None:
    with pytest.raises(MalformedProgram, match="is no name of"):
        verify_program(Program(("t",), (Assign(name, op, ("p0",)),), ()))
