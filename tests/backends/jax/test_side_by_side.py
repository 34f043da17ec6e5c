"""Sums over gaps of the same text become one step of many rows: the form, what is left as it is, and values that stay the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.jax.side_by_side import SideBySide, side_by_side
from teg.program import Assign, Program
from teg.program.arrays import ArrayProgram, ArraySpec, Gaps, Integers, Load, Loop, Run, steps
from teg.program.interpreter.arrays import interpret_arrays
from tests.backends.programs import let

jax = pytest.importorskip("jax")


def flat(parameters: int, *body: Assign, outputs: tuple[Any, ...]) -> Program:
    return Program(tuple(f"parameter {i}" for i in range(parameters)), body, outputs)


def line(k: int, op: str, factor: float, column: int) -> tuple[Run, Gaps]:
    """The part of (0, 1) outside of [c - d, c + d], times a weight; c and d are products of a number of the line and of a candidate."""
    before = flat(1, let("v0", "mul", "p0", factor), let("v1", op, "v0", 2.0), outputs=("v1", "v0"))
    candidate = flat(
        3,
        let("v0", "mul", "p0", "p1"),
        let("v1", "sub", "v0", "p2"),
        let("v2", "add", "v0", "p2"),
        let("v3", "neg", "v2"),
        let("v4", "sub" if op == "add" else "add", "v1", 0.01),
        outputs=("v4" if column else "v1", "v2", 0.0, 1.0, 0.0, 0.0),
    )
    inside = flat(3, let("v0", "sub", "p1", "p0"), let("v1", "mul", "p2", "v0"), outputs=("v1",))
    index, names = f"i{10 + k}", tuple(f"v{100 * k + j}" for j in range(100, 120))
    loads = Load(names[0], 0, (index, column)), Load(names[1], 0, (index, 2))
    outer = Run(before, ("v1",), (names[2], names[3]))
    run = Run(candidate, (names[2], names[0], names[1]), names[4:10])
    gap = Run(inside, (names[10], names[11], names[3]), (names[12],))
    values = (*names[4:6], *names[6:9], 0.0, 0.0, 0.0, 0.0)
    gaps = Gaps(index, 0, "i2", (*loads, run), values, (names[13],), "j", -1, 0.0, 1.0, names[10], names[11], (gap,), (names[12],))
    return outer, gaps


def program(*lines: tuple[Run, Gaps]) -> ArrayProgram:
    """Σ over lines of the sums of their gaps."""
    results = tuple(gaps.results[0] for _, gaps in lines)
    total = flat(len(lines), let("v0", "add", *(f"p{i}" for i in range(len(lines)))), outputs=("v0",))
    body = (Load("v1", 1, ("i0", 0)), *(s for pair in lines for s in pair), Run(total, results, ("v2",)))
    lengths = Integers("i2", "length", (0,), 0), Integers("i3", "length", (0,), 1)
    arrays = ArraySpec("candidates", 2, False), ArraySpec("lines", 2, False)
    return ArrayProgram((), arrays, (*lengths, Loop("i0", 0, "i3", body, ("v2",), ("v3",), "k")), ("v3",))


ALIKE = line(1, "add", 0.3, 0), line(2, "add", -0.5, 0)
UNLIKE_INSIDE = line(1, "add", 0.3, 0), line(2, "sub", 0.5, 1), line(3, "add", 0.2, 1)


def sums(p: ArrayProgram) -> list[Any]:
    return [s for s in steps(side_by_side(p).body) if isinstance(s, Gaps | SideBySide)]


def agree(p: ArrayProgram, candidates: int, lines: int) -> None:
    from teg.backends.jax.kernel import compile_jax
    from teg.backends.jax.loops import ArrayFunction

    rng = np.random.default_rng(candidates)
    arrays = [
        np.c_[rng.uniform(0, 0.5, (candidates, 2)), rng.uniform(0.001, 1.0 / candidates, candidates)],
        rng.uniform(0.2, 1.0, (lines, 1)),
    ]
    (found,), _ = jax.jit(lambda *given: ArrayFunction(p, compile_jax)([], given))(*arrays)
    assert float(found) == pytest.approx(interpret_arrays(p, [], arrays).outputs[0], rel=1e-13)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("lines", [ALIKE, UNLIKE_INSIDE], ids=["alike", "operations and lookups differ"])
def test_lines_are_rows(lines: Any) -> None:
    p = program(*lines)
    joined, gaps = sums(p)
    assert isinstance(joined, SideBySide)
    assert isinstance(gaps, Gaps)
    assert joined.width == len(lines)
    assert joined.results == tuple(g.results[0] for _, g in lines)
    agree(p, 3, 5)


def test_nothing_is_computed_for_lines_that_are_rows() -> None:
    (loop,) = (s for s in side_by_side(program(*ALIKE)).body if isinstance(s, Loop))
    assert [type(s) for s in loop.body] == [Load, SideBySide, Run]


def test_applying_it_twice_changes_nothing() -> None:
    once = side_by_side(program(*ALIKE))
    assert side_by_side(once) == once


def test_a_line_that_needs_another_one_is_left() -> None:
    first, (outer, gaps) = ALIKE
    p = program(first, (replace(outer, inputs=(first[1].results[0],)), gaps))
    assert [type(s) for s in sums(p)] == [Gaps, Gaps]


def test_lines_over_other_candidates_are_left() -> None:
    first, (outer, gaps) = ALIKE
    assert [type(s) for s in sums(program(first, (outer, replace(gaps, lo=1))))] == [Gaps, Gaps]


@pytest.mark.usefixtures("x64")
def test_lines_of_half_disks_are_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    inside = ((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 < D[k, 2] ** 2) & (x < D[k, 0])
    area = teg.integral(teg.bracket(teg.any(inside, (k, 0, teg.length(D, 0)))), (x, 0, 1), (y, 0, 1))

    class SeenError(Exception):
        """The program is there; nothing is compiled."""

    def see(p: ArrayProgram) -> ArrayProgram:
        raise SeenError([s.width for s in steps(side_by_side(p).body) if isinstance(s, SideBySide)])

    monkeypatch.setattr("teg.backends.jax.loops.side_by_side", see)
    with pytest.raises(SeenError) as seen:
        teg.jax_function(area, [D], kernel="xla")(np.zeros((3, 3)))
    assert seen.value.args == ([2, 2],)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("many", [2, 25])
def test_intervals_that_are_there_are_brought_together(many: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With few of them, and with more than there is room for."""
    monkeypatch.setattr("teg.backends.jax.gaps.SHORT", 0)
    monkeypatch.setattr("teg.backends.jax.gaps.MANY", many)
    agree(program(*ALIKE), 60, 2)
