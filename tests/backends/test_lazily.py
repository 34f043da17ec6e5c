"""Branches for what one side of a choice, or a statement with a condition, needs: the same numbers, computed in fewer places."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import teg
from teg.backends.branches import with_branches
from teg.backends.lazily import LEAST, with_lazy_choices
from teg.program import Assign, Gauss, Integrate, Isolate, Polygon, Program, SumOver, When, statements
from teg.program.interpreter import interpret
from tests.bench.scenes import tetrahedron

STEPS = LEAST + 4
"""Assignments that are worth a branch."""


def long_way() -> list[Assign]:
    """Assignments that take long: the last one is p0 + STEPS/8."""
    names = [f"v{500 + i}" for i in range(STEPS)]
    return [Assign(n, "add", (before, 0.125)) for before, n in zip(("p0", *names), names, strict=False)]


def same_numbers(program: Program, inputs: np.ndarray) -> bool:
    """Whether the program with branches has the same outputs and ties."""
    lazy = with_lazy_choices(program)
    runs = [(interpret(program, row), interpret(lazy, row)) for row in inputs.tolist()]
    return all(np.array_equal(a.outputs, b.outputs, equal_nan=True) and a.ties == b.ties for a, b in runs)


def integral(bound: str) -> Integrate:
    return Integrate("x9", 0.0, bound, (), (), None, (), ("x9",), ("v900",), Gauss(2), "b1")


def test_a_statement_with_a_condition_stands_in_its_branch() -> None:
    way = long_way()
    body = [Assign("b1", "gt0", ("p1",)), *way, integral(way[-1].name)]
    program = Program(("s", "t"), tuple(body), ("v900",))
    _, branch = with_lazy_choices(program).body
    assert isinstance(branch, When)
    assert isinstance(branch.body[-1], Integrate)
    assert branch.body[-1].when is None
    assert same_numbers(program, np.array([[0.5, 1.0], [0.5, -1.0], [math.nan, -1.0], [math.nan, 1.0]]))


def test_a_search_stays_for_its_roots_that_are_not_there_are_infinite() -> None:
    """A branch that is not taken gives 0, a search +inf, where a sum has no term."""
    way = long_way()
    last = way[-1].name
    search = replace(isolation(), lo=0.0, hi=last, when="b1")
    total = SumOver("x8", search.results, (), (1.0,), ("v800",))
    program = Program(("s", "t"), (Assign("b1", "gt0", ("p1",)), *way, search, total), ("v800",))
    assert any(isinstance(s, Isolate) for s in with_lazy_choices(program).body)
    assert same_numbers(program, np.array([[0.5, 1.0], [0.5, -1.0]]))
    assert [interpret(program, [0.5, t]).outputs for t in (1.0, -1.0)] == [(1.0,), (0.0,)]


def isolation() -> Isolate:
    """The search for the root of sin x + 2x = p0."""
    x, t = teg.var("x"), teg.param("t")
    program = teg.compile(teg.integral(teg.bracket(teg.sin(x) + 2 * x < t), (x, 0, 1)), backend="numpy").program(0)
    assert isinstance(program, Program)
    return next(s for s in statements(program.body) if isinstance(s, Isolate))


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_a_tie_is_moved_only_where_it_can_be_none(scale: float) -> None:
    way = long_way()
    last = way[-1].name
    body = [
        Assign("b1", "gt0", ("p1",)),
        *way,
        Assign("v700", "select", ("b1", last, 1e-300)),
        Assign("v701", "select", ("b1", 1.0, scale)),
        Assign("b700", "tie", ("v700", "v701", True, 0)),
        Assign("v702", "select", ("b700", 2.0, 3.0)),
        integral("v702"),
    ]
    program = replace(program_with_tie(), parameters=("s", "t"), body=tuple(body), outputs=("v900",))
    assert same_numbers(program, np.array([[-0.125 * STEPS, 1.0], [0.5, 1.0], [0.5, -1.0]]))
    moved = not any(isinstance(s, Assign) and s.op == "tie" for s in with_lazy_choices(program).body)
    assert moved == (scale == 0.0)


def program_with_tie() -> Program:
    """A program with one tie."""
    x, y, t = teg.var("x"), teg.var("y"), teg.param("t")
    program = teg.compile(teg.integral(teg.bracket(x + y * y * y < t), (x, 0, 1), (y, 0, 1)), [t], backend="numpy").program(1)
    assert isinstance(program, Program)
    assert program.ties
    return program


def test_what_a_face_needs_is_computed_only_where_its_plane_meets_the_box() -> None:
    """The half-planes of a tetrahedron's faces, and whether they tie, stand in branches in C."""
    program = teg.compile(*tetrahedron(), backend="numpy").program(1)
    assert isinstance(program, Program)
    lazy = with_lazy_choices(with_branches(program))
    whole, outside = (sum(isinstance(s, Assign) for s in block) for block in (statements(program.body), lazy.body))
    assert outside < 0.2 * whole
    assert not any(isinstance(s, Polygon) for s in lazy.body)
    faces = [s for s in statements(lazy.body) if isinstance(s, Polygon)]
    assert len(faces) == 4
    assert all(s.when is None for s in faces)
