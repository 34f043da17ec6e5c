"""Walks over flat programs: names that are given, read and captured; branches written out."""

from __future__ import annotations

import pytest

from teg.program import Assign, Gauss, Integrate, Program, When
from teg.program.interpreter import interpret
from teg.program.verify import verify_program
from teg.program.walk import assigned, blocks, captured, compound, free_in, free_names, has_ties, size, statements, without_branches

INNER = Assign("v2", "mul", ("x1", "v1"))
INTEGRAL = Integrate("x1", 0.0, "p0", ("v0",), (), None, (INNER,), ("v2",), ("v3",), Gauss(2))
WHOLE = (Assign("v0", "mul", ("p0", 0.5)), Assign("v1", "add", ("p1", 1.0)), INTEGRAL)
BRANCH = When("b1", (Assign("v5", "mul", ("p0", 2.0)), Assign("v6", "add", ("v5", "p1"))), ("v6",))
PROGRAM = Program(("t", "a"), (Assign("b1", "gt0", ("p0",)), BRANCH, Assign("v7", "add", ("v6", 1.0))), ("v7",))


def test_names_that_are_given_and_read() -> None:
    assert assigned(INTEGRAL) == ("v3",)
    assert set(free_names(INTEGRAL)) == {"p0", "v0", "v1"}
    assert set(free_in(WHOLE)) == {"p0", "p1"}


def test_statements_outermost_first() -> None:
    assert [assigned(s) for s in statements(WHOLE)] == [("v0",), ("v1",), ("v3",), ("v2",)]
    assert list(compound(WHOLE)) == [INTEGRAL]
    assert blocks(INTEGRAL)[-1] == (INNER,)
    assert size(Program(("t", "a"), WHOLE, ("v3",))) == 4


def test_names_that_blocks_capture() -> None:
    outside, inside = captured(INTEGRAL, "body")
    assert (set(outside), set(inside)) == ({"v1"}, set())


def test_ties() -> None:
    assert not has_ties(WHOLE)
    assert has_ties((Assign("b0", "tie", ("p0", 1.0, True, 0)),))


@pytest.mark.parametrize("t", [2.0, -2.0])
def test_branches_written_out_have_the_same_results(t: float) -> None:
    flat = without_branches(PROGRAM)
    verify_program(flat)
    assert not any(isinstance(s, When) for s in statements(flat.body))
    assert interpret(flat, [t, 3.0]).outputs == interpret(PROGRAM, [t, 3.0]).outputs
    assert without_branches(flat) is flat
