"""Dead code in every statement: results that nobody uses go, with what only they need."""

from __future__ import annotations

from dataclasses import replace

from teg.program import (
    Arg,
    Assign,
    Gauss,
    Guard,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Moments,
    Program,
    Stmt,
    When,
)
from teg.program.dce import without_dead_code


def let(name: str, op: str, *args: Arg) -> Assign:
    return Assign(name, op, args)


def cleaned(stmt: Stmt, *outputs: Arg, before: tuple[Stmt, ...] = ()) -> tuple[Stmt, ...]:
    return without_dead_code(Program(("a",), (*before, stmt), outputs)).body


INTEGRAL = Integrate(
    "x0",
    0.0,
    "p0",
    (),
    (let("v1", "floor", "x0"), let("v2", "floor", "p0")),
    None,
    (let("v3", "sin", "x0"), let("v4", "mul", "x0", "v1"), let("v5", "add", "x0", "v2")),
    ("v3", "v4", "v5"),
    ("v6", "v7", "v8"),
    Gauss(3),
    estimates=("v9", "v10"),
)


def test_values_of_an_integral_go_one_by_one() -> None:
    (kept,) = cleaned(INTEGRAL, "v7")
    expected = replace(INTEGRAL, flags=INTEGRAL.flags[:1], body=INTEGRAL.body[1:2], values=("v4",), results=("v7",), estimates=())
    assert kept == expected


def test_a_value_stays_whose_estimate_is_used() -> None:
    (kept,) = cleaned(INTEGRAL, "v8", "v10")
    assert isinstance(kept, Integrate)
    assert (kept.values, kept.results, kept.estimates) == (("v4", "v5"), ("v7", "v8"), ("v10",))


def test_a_guard_keeps_the_sizes_of_what_is_kept() -> None:
    block = (let("v11", "abs", "x1"), let("v12", "abs", "x2"), let("v13", "exp", "x1"), let("v14", "neg", "x1"))
    guard = Guard("x1", "x2", (*block, let("v15", "neg", "v13")), ("v11", "v12"), ("v13",), (0.0,), ("v13",), ("v3",))
    (kept,) = cleaned(replace(INTEGRAL, guard=guard), "v7", "v10")
    assert isinstance(kept, Integrate)
    assert kept.guard == replace(guard, block=(block[1], block[2]), sizes=("v12",))
    assert kept.body == INTEGRAL.body[:2]  # the sharp value is read at the nodes


def test_the_number_of_roots_is_part_of_the_meaning() -> None:
    point = (let("v1", "sin", "x0"), let("v2", "cos", "x0"), let("v3", "exp", "x0"))
    stmt = Isolate("x0", 0.0, 1.0, "x1", "x2", (), (-1.0, 1.0, -1.0, 1.0), point, "v1", "v2", ("v4", "v5"), errors=("v6", "v7"))
    assert cleaned(stmt, "v5") == (replace(stmt, point=point[:2], errors=()),)
    assert cleaned(stmt, "v7") == (replace(stmt, point=point[:2]),)
    assert cleaned(stmt, "p0") == ()


def test_what_is_lost_stays_with_the_places() -> None:
    stmt = Locate(0.0, 1.0, 0.0, 1.0, "x0", "x1", "x2", "x3", (), ("x0", "x1", "x2", "x3"), ("v1", "v2"), lost="v3")
    assert cleaned(stmt, "v1") == (stmt,)
    assert cleaned(stmt, "v3") == (stmt,)


def test_a_hyperbola_without_a_border_has_no_ties() -> None:
    moments = (Moments("above", ((0, 0, 1.0),)), Moments("border", ((0, 0, "p0"),)))
    stmt = Hyperbola(("p0", 1.0, 2.0, 3.0), (let("v1", "abs", "p0"),), ("v1",) * 4, (0, 0, 0, 0), moments, ("v2", "v3"))
    assert cleaned(stmt, "v3") == (replace(stmt, moments=moments[1:], results=("v3",)),)
    assert cleaned(stmt, "v2") == (replace(stmt, scales=(), scale=(), ties=(), moments=moments[:1], results=("v2",)),)


def test_a_branch_keeps_what_gives_the_results_that_are_used() -> None:
    body = (let("v1", "sin", "p0"), let("v2", "neg", "v1"), let("v3", "exp", "p0"))
    before = (let("b0", "gt0", "p0"), let("v0", "cos", "p0"))
    assert cleaned(When("b0", body, ("v2", "v3")), "v2", before=before) == (before[0], When("b0", body[:2], ("v2",)))
