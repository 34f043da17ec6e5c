"""What vanishes where some numbers are 0: by the rules, by running the programs, and in steps around them."""

from __future__ import annotations

import math

import pytest

import teg
from teg.program.arrays import AddTo, Loop, Run, Scatter, SeenLoop, Take, steps
from teg.program.interpreter.arrays import interpret_arrays
from teg.program.statements import Assign, Program, When
from teg.program.vanishing import vanishing, with_zeros
from tests.backends.c.test_kept_cells import given, scene


def program(*body: Assign | When, outputs: tuple[str | float, ...]) -> Program:
    return Program(("a", "b", "c"), body, outputs)


@pytest.mark.parametrize(
    ("assigned", "zeros", "is_zero"),
    [
        (Assign("v1", "mul", ("p0", "p1", "p2")), {1}, True),
        (Assign("v1", "mul", ("p0", "p1", "p2")), set(), False),
        (Assign("v1", "add", ("p0", "p1", 0.0)), {0, 1}, True),
        (Assign("v1", "add", ("p0", "p1")), {0}, False),
        (Assign("v1", "sub", ("p0", "p1")), {0, 1}, True),
        (Assign("v1", "div", ("p0", "p1")), {0}, True),
        (Assign("v1", "div", ("p0", "p1")), {1}, False),
        (Assign("v1", "abs", ("p2",)), {2}, True),
        (Assign("v1", "cos", ("p2",)), {2}, False),
        (Assign("v1", "select", ("b9", "p0", math.nan)), {0}, True),
        (Assign("v1", "select", ("b9", "p0", 1.0)), {0}, False),
        (Assign("v1", "select", ("b9", "p0", "p1")), {0}, False),
        (Assign("v1", "const", (math.nan,)), {0, 1, 2}, False),
    ],
)
def test_rules(assigned: Assign, zeros: set[int], is_zero: bool) -> None:
    whole = program(Assign("b9", "gt0", ("p2",)), assigned, Assign("v2", "neg", ("v1",)), outputs=("v2", "p0", 0.0, 2.0))
    assert vanishing(whole, zeros) == {*([0] if is_zero else []), *([1] if 0 in zeros else []), 2}


def test_branches_are_looked_into() -> None:
    inside = Assign("v1", "mul", ("p0", "p1")), Assign("v2", "add", ("p1", "p2"))
    whole = program(Assign("b9", "gt0", ("p2",)), When("b9", inside, ("v1", "v2")), outputs=("v1", "v2"))
    assert vanishing(whole, {0}) == {0}


def loops() -> tuple[SeenLoop, list[Take]]:
    """Returns the loop over candidates of a scene, and what it takes of the derivatives by forms."""
    losses, wrt = scene()
    whole = teg.compile(losses.children[0], wrt, backend="c").program(1)
    (loop,) = (s for s in steps(whole.body) if isinstance(s, SeenLoop))
    taken = [s for s in loop.body if isinstance(s, Take) and s.table == loop.table and s.column < 12]
    return loop, taken


def test_steps_of_candidates_without_edges() -> None:
    """Nothing is added to the places of vertices; colours get what they got, by the same flat programs."""
    loop, taken = loops()
    assert len(taken) > 8
    body = with_zeros(loop.body, {s.name for s in taken})
    assert not {s.name for s in taken} & {s.name for s in body if isinstance(s, Take)}
    assert [s.program for s in body if isinstance(s, Run)] == [s.program for s in loop.body if isinstance(s, Run)]
    before, after = ([s for s in b if isinstance(s, AddTo | Scatter)] for b in (loop.body, body))
    assert 0 < len(after) < len(before)
    assert set(after) < set(before)
    assert with_zeros(loop.body, set()) == loop.body


def test_what_is_left_out_is_zero() -> None:
    """The interpreter gives all derivatives of squares with one owner, with and without the steps that are left out."""
    losses, wrt = scene()
    whole = teg.compile(losses.children[0], wrt, backend="c").program(1)
    arguments = given(3)
    arguments["V"][:, :, :2] = [[-9.0, -9.0], [40.0, -9.0], [-9.0, 40.0]]  # triangles that cover all squares
    arguments["V"][:, :, 2] = [[0.0, 0.0, float(k)] for k in range(6)]
    data = [arguments[a.name] for a in whole.arrays]
    _, taken = loops()

    def changed(block: tuple[object, ...]) -> tuple[object, ...]:
        done: list[object] = []
        for s in block:
            if isinstance(s, SeenLoop):
                s = _with(s, with_zeros(s.body, {t.name for t in taken}))
            elif isinstance(s, Loop):
                s = _with(s, changed(s.body))
            done.append(s)
        return tuple(done)

    lean = _with(whole, changed(whole.body))
    one, two = (interpret_arrays(p, [], data).outputs for p in (whole, lean))
    assert one[0] == two[0]
    for full, left in zip(one[1:], two[1:], strict=True):
        assert {k: v for k, v in full.items() if v} == {k: v for k, v in left.items() if v}
    assert any(v for left in two[1:] for v in left.values())


def _with(node: object, body: object) -> object:
    from dataclasses import replace

    return replace(node, body=body)  # type: ignore[type-var]
