"""Flat programs with those of the loops around them: fewer inputs, the same results."""

from __future__ import annotations

from teg.program import Assign, Program
from teg.program.arrays import Load, Number, Run
from teg.program.interpreter import interpret
from teg.program.joined import input_residues, joined

MAKER = Run(
    Program(
        ("row", "y0"),
        (Assign("v0", "sub", ("p0", "p1")), Assign("v1", "abs", ("v0",)), Assign("v2", "mul", ("v0", 2.0))),
        ("v0", "v1", "v2", "p1", 3.0),
    ),
    ("v10", "v11"),
    ("v20", "v21", "v22", "v23", "v24"),
)
USER = Run(
    Program(
        ("a", "b", "c", "d", "e", "col"),
        (Assign("v0", "add", ("p0", "p1", "p2")), Assign("v1", "mul", ("v0", "p3", "p4")), Assign("v2", "sub", ("v1", "p5"))),
        ("v2", "p0"),
    ),
    ("v20", "v21", "v22", "v23", "v24", "v30"),
    ("v40", "v41"),
)


def outputs(program: Program, values: list[float]) -> list[float]:
    return list(interpret(program, values).outputs)


def test_the_inputs_of_the_makers_take_the_place_of_their_results() -> None:
    both = joined(USER, [MAKER])
    assert set(both.inputs) == {"v10", "v11", "v30"}
    assert both.results == USER.results
    row, y0, column = 5.0, 2.0, 7.0
    given = {"v10": row, "v11": y0, "v30": column}
    made = outputs(MAKER.program, [row, y0])
    assert outputs(both.program, [given[str(a)] for a in both.inputs]) == outputs(USER.program, [*made, column])


def test_nothing_is_joined_that_saves_little_or_has_functions() -> None:
    assert joined(USER, []) is USER
    few = Run(USER.program, ("v20", "v50", "v51", "v52", "v53", "v30"), USER.results)
    assert joined(few, [MAKER]) is few
    body = (*MAKER.program.body[:2], Assign("v2", "exp", ("v0",)))
    assert joined(USER, [Run(Program(MAKER.program.parameters, body, MAKER.program.outputs), MAKER.inputs, MAKER.results)]) is USER


def test_residues_of_inputs_are_connected_by_what_is_computed() -> None:
    load = Load("v11", 0, ("i1",))
    found = input_residues((Number("v10", "i0"), load, Number("v30", "i0"), MAKER, USER), [USER], 0)[id(USER)]
    assert found["p2"] == 2 * (found["p0"] or 0) % (2**63 - 25)
    assert found["p1"] is None
    assert found["p4"] == 3
    assert found["p5"] == ((found["p0"] or 0) + (found["p3"] or 0)) % (2**63 - 25)
