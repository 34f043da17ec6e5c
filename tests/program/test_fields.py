"""What follows from the declarations of statements, shown on a statement that exists in this test only."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Annotated, Any

import pytest

from teg.passes.program.sink import sink
from teg.program import (
    Arg,
    Assign,
    Bend,
    Guard,
    HalfLine,
    HalfPlane,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Moments,
    Polygon,
    Program,
    Sample,
    Segment,
    SumOver,
    When,
    assigned,
    blocks,
    captured,
    free_in,
    free_names,
    statements,
)
from teg.program.arrays import AddTo, Blank, Combined, Integers, Load, Loop, Number, Rows, Run, Scatter
from teg.program.dce import without_dead_code
from teg.program.fields import (
    CONDITION,
    NUMBER,
    Block,
    Operand,
    Part,
    Result,
    Variable,
    absent,
    declared,
    operands,
    renamed,
    result_names,
    variables,
)
from teg.program.verify import MalformedProgram, verify_program


@dataclass(frozen=True, slots=True)
class Weight:
    """A part of the statement below."""

    factor: Annotated[Arg, Operand(at="setup")]
    label: str = "a setting"


@dataclass(frozen=True, slots=True)
class Smallest:
    """A statement that the compiler does not have: the least values over some points."""

    var: Annotated[str, Variable(("body",))]
    points: Annotated[tuple[Arg, ...], NUMBER]
    setup: Annotated[tuple[Any, ...], Block(receives=True)]
    body: Annotated[tuple[Any, ...], Block(sees=("setup",))]
    values: Annotated[tuple[Arg, ...], Operand(at="body", each=True)]
    weights: Annotated[tuple[Weight, ...], Part(each=True)]
    results: Annotated[tuple[str, ...], Result()]
    places: Annotated[tuple[str, ...], Result(each=True)] = ()
    when: Annotated[str | None, CONDITION] = None


def let(name: str, op: str, *args: Arg) -> Assign:
    return Assign(name, op, args)


INNER = Smallest(
    "x1",
    ("p0", 0.5),
    (let("v1", "neg", "v0"),),
    (let("v2", "mul", "x1", "v1", "v9"), let("v3", "sin", "x1")),
    ("v2", "v3"),
    (Weight("v8"), Weight("v1")),
    ("v4", "v5"),
    ("v6", "v7"),
    "b0",
)
AROUND = (
    let("v0", "exp", "p0"),
    let("v9", "cos", "p0"),
    let("v8", "tan", "p0"),
    let("b0", "gt0", "p0"),
)


def program(*outputs: Arg) -> Program:
    return Program(("a",), (*AROUND, INNER), outputs)  # type: ignore[arg-type]


def test_roles_are_read_off_the_annotations() -> None:
    assert [f.name for f in declared(Smallest)] == [f.name for f in fields(Smallest)]
    assert [f.name for f in declared(Weight)] == ["factor"]
    assert result_names(INNER) == ("v4", "v5", "v6", "v7")
    assert variables(INNER) == ["x1"]
    assert variables(INNER, "setup") == []
    assert operands(INNER) == ["p0", 0.5, "v2", "v3", "v8", "v1", "b0"]
    assert operands(INNER, at="") == ["p0", 0.5, "b0"]
    assert operands(INNER, at="setup") == ["v8", "v1"]


def test_walks_follow() -> None:
    stmt: Any = INNER
    assert assigned(stmt) == ("v4", "v5", "v6", "v7")
    assert blocks(stmt) == (INNER.setup, INNER.body)
    assert list(statements((stmt,))) == [INNER, *INNER.setup, *INNER.body]
    assert list(free_names(stmt)) == ["p0", "v8", "b0", "v0", "v9"]
    assert captured(stmt, "setup") == (["v0", "v8"], [])
    assert captured(stmt, "body") == (["v9"], ["v1"])
    assert captured(stmt, "setup", "body") == (["v0", "v8", "v9"], [])
    assert list(free_in((*AROUND, stmt))) == ["p0"]


def test_renaming_follows() -> None:
    new = renamed(INNER, {"v0": "w0", "v4": "w4", "x1": "y1", "b0": "c0", "a setting": "changed"})
    assert new.setup == (let("v1", "neg", "w0"),)
    assert new.body[0] == let("v2", "mul", "y1", "v1", "v9")
    assert (new.var, new.results, new.when) == ("y1", ("w4", "v5"), "c0")
    assert new.weights == INNER.weights


def test_dead_code_elimination_follows() -> None:
    kept: Any = without_dead_code(program("v5")).body[-1]
    assert (kept.results, kept.places, kept.values, kept.weights) == (("v5",), (), ("v3",), (Weight("v1"),))
    assert kept.body == (let("v3", "sin", "x1"),)
    assert kept.setup == INNER.setup  # the weight reads it
    assert [s.name for s in without_dead_code(program("v5")).body[:-1] if isinstance(s, Assign)] == ["v0", "b0"]
    places: Any = without_dead_code(program("v6")).body[-1]
    assert (places.results, places.places) == (("v4",), ("v6",))
    assert without_dead_code(program("v0")).body == AROUND[:1]


def test_sinking_follows() -> None:
    done: Any = sink(program("v4", "v5"))
    assert [s.name for s in done.body[:-1]] == ["b0"]
    assert [s.name for s in done.body[-1].setup] == ["v0", "v9", "v8", "v1"]


def test_verification_follows() -> None:
    verify_program(program("v4", "v7"))
    unknown = Program(("a",), (*AROUND[1:], INNER), ("v4",))  # type: ignore[arg-type]
    with pytest.raises(MalformedProgram, match="v0 is not known"):
        verify_program(unknown)


@pytest.mark.parametrize("cls", [Integrate, Isolate, Locate, SumOver, Sample, Polygon, Segment, Hyperbola, When, Assign])
def test_every_field_that_may_hold_a_name_has_a_role(cls: type) -> None:
    plain = {f.name for f in fields(cls)} - {f.name for f in declared(cls)}
    settings = {"op", "rule", "infinite", "tol", "width", "count", "kind", "seed", "degree", "nodes", "ties", "soft"}
    assert plain <= settings


@pytest.mark.parametrize(
    "cls", [Bend, Guard, HalfPlane, HalfLine, Moments, Integers, Load, Number, Run, Loop, Rows, Blank, AddTo, Combined, Scatter]
)
def test_so_has_every_field_of_parts_and_steps(cls: type) -> None:
    plain = {f.name for f in fields(cls)} - {f.name for f in declared(cls)}
    settings = {"kind", "axes", "closed", "k", "op", "title", "shape"}
    assert plain <= settings | {"array", "program", "output", "listed", "arrays", "columns", "column"}


def test_results_are_absent_where_the_condition_fails() -> None:
    assert absent(INNER) == dict.fromkeys(("v4", "v5", "v6", "v7"), 0.0)
    roots = Isolate("x0", 0.0, 1.0, "x1", "x2", (), (1.0,) * 4, (), 1.0, 1.0, ("v1", "v2"), errors=("v3", "v4"))
    assert absent(roots) == dict.fromkeys(("v1", "v2", "v3", "v4"), math.inf)
    assert absent(Locate(0.0, 1.0, 0.0, 1.0, "a", "b", "c", "d", (), (1.0,) * 4, ("v1",), lost="v2")) == {"v1": math.inf, "v2": 0.0}
