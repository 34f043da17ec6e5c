"""Every kind of malformed program is found, and named."""

from __future__ import annotations

from dataclasses import replace

import pytest

from teg.program import (
    Adaptive,
    Arg,
    Assign,
    Bend,
    Called,
    Gauss,
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
    Rational,
    Sample,
    Segment,
    Stmt,
    SumOver,
    Tie,
    When,
)
from teg.program.arrays import ArrayProgram, ArraySpec, Integers, Like, Load, Loop, Number, Run, Scatter, Step
from teg.program.verify import MalformedProgram, verified, verified_arrays, verify_array_program, verify_program


def let(name: str, op: str, *args: Arg) -> Assign:
    return Assign(name, op, args)


def program(*body: Stmt, outputs: tuple[Arg, ...] = (), ties: int = 1) -> Program:
    identity = Program(("x",), (let("v1", "neg", "p0"),), ("v1",))
    called = Called(None, (0,), identity), Called(None, (0,))
    return Program(("a", "b"), body, outputs, tuple(Tie(("f", "g")) for _ in range(ties)), called)


POSITIVE = let("b0", "gt0", "p0")
INTEGRAL = Integrate("x0", 0.0, "p0", (), (), None, (let("v1", "sin", "x0"),), ("v1",), ("v2",), Adaptive(1e-9))
ROOTS = Isolate("x0", 0.0, 1.0, "x1", "x2", (), ("x1", "x2", 1.0, 1.0), (), "x0", 1.0, ("v1", "v2"))
PLACES = Locate(0.0, 1.0, 0.0, 1.0, "x0", "x1", "x2", "x3", (), ("x0", "x1", "x2", "x3"), ("v1",))
SUM = SumOver("x0", ("p0", 1.0), (), ("x0",), ("v1",))
SAMPLE = Sample(("x0", "x1"), 8, "qmc", 0, (), ("x0",), ("v1",), ("v2",))
PLANES = (HalfPlane("p0", 1.0, 0.0), HalfPlane(1.0, 0.0, 0.0), HalfPlane(0.0, 1.0, 0.0))
POLYGON = Polygon(("x0", "x1"), 1.0, 1.0, PLANES, (), (), ("x0",), ("p0",), ("v1",), 1)
SEGMENT = Segment("x0", (HalfLine("p0", 1.0, False, 0, "b0", 1.0, 1.0),), (), (), (), ("x0",), (1.0,), ("v1",), 2)
MOMENTS = Hyperbola((1.0, "p0", 1.0, 2.0), (), (1.0,) * 4, (0,) * 4, (Moments("border", ((0, 1, "p0"),)),), ("v1",))
BRANCH = When("b0", (let("v1", "exp", "p0"), let("b1", "lt0", "v1")), ("v1",))
GUARD = Guard("x4", "x5", (let("v3", "abs", "x4"),), ("v3",), ("x5",), ("x4",), ("v3",), ("v1",))

WELL_FORMED = (
    program(let("v0", "add", "p0", 1.0, "p1"), outputs=("v0", 2.0)),
    program(let("v0", "call", 0, "p0"), let("v1", "call", 1, "p0", "p1"), let("v2", "powi", "p0", -3)),
    program(POSITIVE, let("b1", "tie", "p0", 1.0, "b0", 0), let("v0", "select", "b1", "p0", 0.0), outputs=("v0",)),
    program(POSITIVE, INTEGRAL, replace(INTEGRAL, body=(), values=("x0",), results=("v3",), when="b0"), outputs=("v2", "v3")),
    program(replace(INTEGRAL, guard=GUARD, estimates=("v4",), bends=(Bend("root", (0.0, 1.0, "p0")),))),
    *(program(POSITIVE, s) for s in (ROOTS, PLACES, SUM, SAMPLE, POLYGON, SEGMENT, MOMENTS, BRANCH)),
)

MALFORMED: tuple[tuple[Program, str], ...] = (
    # names
    (program(outputs=("v0",)), "v0 is not known"),
    (program(let("v0", "neg", "p2")), "p2 is not known"),
    (program(let("v0", "neg", "v1"), let("v1", "neg", "p0")), "v1 is not known"),
    (program(let("v0", "neg", "p0"), let("v0", "sin", "p0")), "v0 is given twice"),
    (program(let("p1", "neg", "p0")), "p1 is given twice"),
    (program(replace(INTEGRAL, results=("v1",))), "v1 is given twice"),
    (program(replace(SAMPLE, estimates=("v1",))), "v1 is given twice"),
    (program(let("x0", "neg", "p0"), INTEGRAL), "the variable x0 has another meaning"),
    (program(replace(INTEGRAL, body=(replace(INTEGRAL, results=("v1",), body=(), values=("x0",)),))), "the variable x0 has another"),
    # scopes
    (program(INTEGRAL, let("v3", "neg", "v1")), "v1 is not known"),
    (program(INTEGRAL, let("v3", "neg", "x0")), "x0 is not known"),
    (program(replace(INTEGRAL, lo="v1")), "v1 is not known"),
    (program(replace(INTEGRAL, flags=(let("v3", "neg", "v1"),))), "v1 is not known"),
    (program(replace(INTEGRAL, ends=("x1", "x2"), values=("x1",))), "x1 is not known"),
    (program(replace(ROOTS, value="x1")), "x1 is not known"),
    (program(replace(ROOTS, noise="x0")), "x0 is not known"),
    (program(replace(SUM, points=("x0",))), "x0 is not known"),
    (program(replace(POLYGON, factors=("x0",))), "x0 is not known"),
    (program(POSITIVE, replace(SEGMENT, scales=(let("v2", "neg", "p0"),), factors=("v2",))), "v2 is not known"),
    (program(replace(INTEGRAL, guard=replace(GUARD, seen=("x4",)))), "x4 is not known"),
    (program(POSITIVE, replace(BRANCH, results=("v2",))), "v2 is no number that its block gives"),
    (program(POSITIVE, BRANCH, let("b2", "not", "b1")), "b1 is not known"),
    # kinds
    (program(POSITIVE, outputs=("b0",)), "b0 is a condition, and is read as a number"),
    (program(POSITIVE, let("v0", "add", "p0", "b0")), "b0 is a condition"),
    (program(let("b0", "not", "p0")), "p0 is a number, and is read as a condition"),
    (program(replace(SUM, when="p0")), "p0 is a number, and is read as a condition"),
    (program(POSITIVE, replace(SUM, points=("b0",))), "b0 is a condition"),
    (program(POSITIVE, replace(INTEGRAL, watch=("b0",))), "b0 is a condition"),
    (program(POSITIVE, replace(BRANCH, results=("b1",))), "b1 is no number"),
    (program(let("v0", "neg", True)), "the literal True is no number"),
    (program(let("b0", "not", 1.0)), "the literal 1.0 is no condition"),
    (program(let("v0", "powi", "p0", 2.0)), "the literal 2.0 is no integer"),
    (program(outputs=(True,)), "the literal True is no number"),
    # operations
    (program(let("v0", "ceil", "p0")), "there is no operation 'ceil'"),
    (program(let("v0", "sub", "p0")), "sub of 1 operands"),
    (program(let("v0", "sin", "p0", "p1")), "sin of 2 operands"),
    (program(let("v0", "add")), "add of 0 operands"),
    (program(let("v0", "call", 2, "p0")), "there is no function 2"),
    (program(let("v0", "call", 0, "p0", "p1")), "function 0 of 2 inputs"),
    (program(POSITIVE, let("b1", "tie", "p0", 1.0, "b0", 1)), "there is no tie 1"),
    (program(POSITIVE, SEGMENT, ties=0), "there is no tie 0"),
    (program(MOMENTS, ties=0), "there is no tie 0"),
    (replace(program(), functions=(Called(None, (), Program((), (), ())),)), "function 0 has 0 outputs"),
    (replace(program(), functions=(Called(None, (), Program((), (), ("v0",))),)), "function 0: v0 is not known"),
    # statements
    (program(replace(INTEGRAL, values=("v1", "v1"))), "values: 2 for 1 results"),
    (program(replace(INTEGRAL, estimates=("v3", "v4"))), "estimates: 2 for 1 results"),
    (program(replace(POLYGON, factors=())), "factors: 0 for 1 results"),
    (program(replace(MOMENTS, moments=())), "moments: 0 for 1 results"),
    (program(replace(INTEGRAL, guard=replace(GUARD, sizes=("v3", "v3")))), "sizes: 2 for 1 results"),
    (program(replace(INTEGRAL, guard=replace(GUARD, sizes=()))), "0 sizes of 1 tested"),
    (program(replace(INTEGRAL, guard=replace(GUARD, lower=()))), "sharp values without"),
    (program(replace(INTEGRAL, rule=Gauss(2), guard=GUARD)), "a guard needs an adaptive rule"),
    (program(replace(INTEGRAL, rule=Gauss(2), infinite=True)), "infinite bounds need"),
    (program(replace(INTEGRAL, rule=Rational(3, 1))), "a rational rule needs one pole"),
    (program(replace(INTEGRAL, bends=(Bend("kink", (0.0, 1.0, 0.0)),))), "a bend of an unknown kind"),
    (program(replace(INTEGRAL, ends=("x1",))), "a piece has two ends, not 1"),
    (program(replace(ROOTS, errors=("v3",))), "errors of some roots only"),
    (program(replace(PLACES, bounds=("x0", "x1"))), "2 bounds of two functions"),
    (program(replace(SAMPLE, kind="latin")), "no samples of the kind 'latin'"),
    (program(replace(SAMPLE, count=0)), "0 points"),
    (program(replace(POLYGON, variables=("x0", "x1", "x2"))), "3 variables, not 2"),
    (program(replace(POLYGON, variables=("x0", "x1", "x2", "x3"), corners=((0.0, 0.0),))), "1 corners of a triangle"),
    (
        program(replace(POLYGON, variables=("x0", "x1", "x2", "x3"), corners=((0.0, 0.0),) * 3, half_planes=())),
        "a triangle of fewer than three half-planes",
    ),
    (program(replace(MOMENTS, corners=(1.0,))), "1 corners of a square"),
    (program(replace(MOMENTS, ties=(0,))), "1 ties of four sides"),
    (program(replace(MOMENTS, scale=())), "ties without a scale"),
    (program(replace(MOMENTS, moments=(Moments("beside", ()),))), "moments of the kinds"),
    (program(POSITIVE, replace(INTEGRAL, body=(BRANCH,))), "a branch in a loop"),
)

KERNEL = Program(("a",), (let("v1", "neg", "p0"),), ("v1",))
LOOP = Loop("i1", 0, "i0", (Load("v1", 0, ("i1",)), Run(KERNEL, ("v1",), ("v2",)), Scatter(1, 0, ("i1",), "v2")), ("v2",), ("v3",))
LENGTH = Integers("i0", "length", (0,), 0)


def with_arrays(*body: Step, outputs: tuple[Arg | Like, ...] = (0.0, Like(0))) -> ArrayProgram:
    return ArrayProgram(("a",), (ArraySpec("V", 1, False), ArraySpec("F", 2, True)), body, outputs)  # type: ignore[arg-type]


MALFORMED_ARRAYS: tuple[tuple[ArrayProgram, str], ...] = (
    (with_arrays(LOOP), "i0 is not known"),
    (with_arrays(LENGTH, LOOP, outputs=("v2", Like(0))), "v2 is not known"),
    (with_arrays(LENGTH, LOOP, Number("v4", "i1")), "i1 is not known"),
    (with_arrays(LENGTH, LENGTH), "i0 is given twice"),
    (with_arrays(LENGTH, Run(KERNEL, ("i0",), ("v1",))), "i0 is an integer, and is read as a number"),
    (with_arrays(Number("v1", "p0")), "p0 is a number, and is read as an integer"),
    (with_arrays(Load("v1", 0, (0.5,))), "the literal 0.5 is no integer"),
    (with_arrays(Load("v1", 0, (0, 1))), "2 subscripts of V, which has 1"),
    (with_arrays(Load("v1", 1, (0, 1))), "F is no array of numbers"),
    (with_arrays(Load("v1", 2, (0,))), "there is no array 2"),
    (with_arrays(Integers("i1", "gather", (0,), 0)), "V is no array of integers"),
    (with_arrays(Integers("i1", "length", (2,), 1)), "there is no axis 2"),
    (with_arrays(Integers("i1", "param", (1,))), "there is no parameter 1"),
    (with_arrays(Integers("i1", "pow", (1, 2))), "there is no operation 'pow' of integers"),
    (with_arrays(Integers("i1", "add", (1,))), "add of 1 operands"),
    (with_arrays(LENGTH, replace(LOOP, values=())), "values: 0 for 1 results"),
    (with_arrays(LENGTH, LOOP, outputs=(0.0, 0.0)), "output 1 is not like array 0"),
    (with_arrays(Run(KERNEL, (), ("v1",))), "0 inputs of a kernel with 1"),
    (with_arrays(Run(KERNEL, ("p0",), ())), "0 results of a kernel with 1"),
    (with_arrays(Run(program(outputs=("v0",)), ("p0", "p0"), ("v1",))), "a kernel: v0 is not known"),
    (with_arrays(outputs=(0.0, Like(1))), "F is no array of numbers"),
)


@pytest.mark.parametrize("whole", WELL_FORMED)
def test_well_formed_programs_pass(whole: Program) -> None:
    verify_program(whole)


@pytest.mark.parametrize(("whole", "what"), MALFORMED, ids=[what for _, what in MALFORMED])
def test_malformed_programs_do_not(whole: Program, what: str) -> None:
    with pytest.raises(MalformedProgram) as caught:
        verify_program(whole, "after a pass")
    assert caught.value.stage.startswith("after a pass")
    assert what in str(caught.value)


def test_a_well_formed_program_with_arrays_passes() -> None:
    verify_array_program(with_arrays(LENGTH, LOOP, outputs=("v3", Like(0))))


@pytest.mark.parametrize(("whole", "what"), MALFORMED_ARRAYS, ids=[what for _, what in MALFORMED_ARRAYS])
def test_malformed_programs_with_arrays_do_not(whole: ArrayProgram, what: str) -> None:
    with pytest.raises(MalformedProgram) as caught:
        verify_array_program(whole, "after a pass")
    assert what in str(caught.value)


def test_passes_are_verified_if_the_environment_asks_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong, wrong_arrays = program(outputs=("v0",)), with_arrays(outputs=("v0",))
    monkeypatch.setenv("TEG_VERIFY", "1")
    with pytest.raises(MalformedProgram, match="after a pass: v0 is not known"):
        verified(wrong, "after a pass")
    with pytest.raises(MalformedProgram, match="after a pass: v0 is not known"):
        verified_arrays(wrong_arrays, "after a pass")
    monkeypatch.delenv("TEG_VERIFY")
    assert verified(wrong, "after a pass") is wrong
    assert verified_arrays(wrong_arrays, "after a pass") is wrong_arrays
