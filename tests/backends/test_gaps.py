"""Sums over the gaps that candidates leave, by hand-written programs in every backend, against the interpreter and against intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from teg.backends.c.loops import compile_c_arrays
from teg.backends.numpy.kernel import compile_numpy
from teg.backends.numpy.loops import LaneKernel
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.program import Assign, Program
from teg.program.arrays import ArrayProgram, ArraySpec, Gaps, Integers, Load, Loop, Run
from teg.program.interpreter.arrays import interpret_arrays

LENGTH = Program(("left", "right"), (Assign("v0", "sub", ("p1", "p0")),), ("v0",))
SQUARE = Program(
    ("left", "right"),
    (Assign("v0", "mul", ("p0", "p0")), Assign("v1", "mul", ("p1", "p1")), Assign("v2", "sub", ("v1", "v0"))),
    ("v2",),
)


def program(places: int) -> ArrayProgram:
    """Σ over lines of what is left of each, and its first moment, twice; a line has its ends and a range of candidates in arrays."""
    wide = 3 * places + 3
    numbers = tuple(f"v{10 + j}" for j in range(wide))
    loads = tuple(Load(name, 0, ("i1", j)) for j, name in enumerate(numbers))
    inside = (Run(LENGTH, ("v4", "v5"), ("v6",)), Run(SQUARE, ("v4", "v5"), ("v7",)))
    gaps = Gaps("i1", "i2", "i3", loads, numbers, ("v1", "v2"), "j", -1, "v8", "v9", "v4", "v5", inside, ("v6", "v7"))
    ends = Load("v8", 1, ("i0", 0)), Load("v9", 1, ("i0", 1))
    lists = Integers("i2", "gather", ("i0",), 2), Integers("i4", "add", ("i0", 1)), Integers("i3", "gather", ("i4",), 2)
    lines = Integers("i5", "length", (0,), 1)
    loop = Loop("i0", 0, "i5", (*ends, *lists, gaps), ("v1", "v2"), ("v90", "v91"), "k")
    arrays = ArraySpec("candidates", 2, False), ArraySpec("lines", 2, False), ArraySpec("first", 1, True)
    return ArrayProgram((), arrays, (lines, loop), ("v90", "v91"))


def moving_program(places: int) -> ArrayProgram:
    """The same, and how fast what is left becomes longer; behind the numbers of a candidate are the velocities of its places, and behind
    the ends of a line those of these."""
    plain = program(places)
    lines, loop = plain.body
    assert isinstance(loop, Loop)
    *before, gaps = loop.body
    assert isinstance(gaps, Gaps)
    wide = 3 * places + 3
    velocities = tuple(f"v{10 + wide + j}" for j in range(places))
    loads = tuple(Load(name, 0, ("i1", wide + j)) for j, name in enumerate(velocities))
    inside = *gaps.inside, Run(LENGTH, ("v60", "v61"), ("v62",))
    moved = replace(gaps, body=(*gaps.body, *loads), inside=inside, results=("v1", "v2", "v3"), terms=(*gaps.terms, "v62"))
    whole = replace(moved, velocities=velocities, outer=("v63", "v64"), moving=("v60", "v61"))
    outer = Load("v63", 1, ("i0", 2)), Load("v64", 1, ("i0", 3))
    around = replace(loop, body=(*before, *outer, whole), values=("v1", "v2", "v3"), results=("v90", "v91", "v92"))
    return replace(plain, body=(lines, around), outputs=("v90", "v91", "v92"))


@cache
def compiled_in_jax(p: ArrayProgram, first: tuple[int, ...]) -> Callable[..., Any]:
    """The program of two arrays. The entries of `first` are known while it is traced."""
    import jax

    from teg.backends.jax.kernel import compile_jax
    from teg.backends.jax.loops import ArrayFunction

    known = np.array(first)
    return jax.jit(lambda *given: ArrayFunction(p, compile_jax)([], [*given, jax.numpy.asarray(known)], [known]))


def in_jax(p: ArrayProgram, arrays: list[np.ndarray], compiled: Callable[..., Any] = compiled_in_jax) -> tuple[list[float], bool]:
    from teg.backends.jax.runtime import MISSED

    found, note = compiled(p, tuple(arrays[2].tolist()))(*arrays[:2])
    return [float(v) for v in found], bool(int(note) & MISSED)


def in_c(p: ArrayProgram, arrays: list[np.ndarray]) -> tuple[list[float], bool]:
    found = compile_c_arrays(p).results([], arrays, 1)
    return [float(v[0]) for v in found.values], found.missed


def in_numpy(p: ArrayProgram, arrays: list[np.ndarray]) -> tuple[list[float], bool]:
    found = LaneKernel(p, compile_numpy).results([], arrays, 1)
    return [float(v[0]) for v in found.values], found.missed


def left_over(first: float, last: float, rows: np.ndarray, places: int) -> np.ndarray:
    """The length and the moment of what is not covered, on a fine partition by all places."""
    ends = np.unique(np.clip([first, last, *rows[:, :places].ravel()], first, last))
    total = np.zeros(2)
    for p, q in pairwise(ends):
        middle, covered = 0.5 * (p + q), False
        for row in rows:
            piece = int(np.searchsorted(row[:places], middle))
            flag, tie = row[places + piece], row[2 * places + 1 + piece]
            covered |= (tie if 0.25 <= flag <= 0.75 else flag) > 0.5
        total += [0.0, 0.0] if covered else [q - p, q * q - p * p]
    return total


def some(lines: int, places: int, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 6, lines)
    n = int(counts.sum())
    at = np.sort(rng.uniform(-0.3, 1.3, (n, places)), axis=1)
    at[(at < 0.0) | (at > 1.0)] = np.inf
    flags = rng.choice([0.0, 0.0, 1.0, 0.5], (n, places + 1))
    ties = rng.choice([0.0, 1.0], (n, places + 1))
    candidates = np.c_[np.sort(at, axis=1), flags, ties, np.zeros(n)]
    return [candidates, np.c_[np.zeros(lines), np.ones(lines)], np.cumsum([0, *counts])]


RUNS: dict[str, Callable[..., tuple[list[float], bool]]] = {"c": in_c, "numpy": in_numpy, "jax": in_jax}


@pytest.mark.parametrize("backend", RUNS)
@pytest.mark.parametrize("places", [0, 1, 3])
def test_what_is_left_over(x64_for_jax: Any, backend: str, places: int) -> None:
    for seed in range(1 if backend == "jax" else 3):
        candidates, lines, first = arrays = some(7, places, seed)
        found, missed = RUNS[backend](program(places), arrays)
        wanted = sum(left_over(p, q, candidates[a:b], places) for (p, q), (a, b) in zip(lines, pairwise(first), strict=True))
        assert found == pytest.approx(list(wanted), abs=1e-14)
        assert interpret_arrays(program(places), [], arrays).outputs == pytest.approx(found, abs=1e-14)
        assert not missed


@pytest.mark.parametrize("backend", RUNS)
@pytest.mark.parametrize("places", [0, 1, 3])
def test_ends_that_move(x64_for_jax: Any, backend: str, places: int) -> None:
    """The velocity of a length is a difference of lengths, since ends move along straight lines."""
    for seed in range(1 if backend == "jax" else 5):
        rng = np.random.default_rng(seed)
        candidates, lines, first = some(7, places, seed)
        u, v = rng.normal(size=(len(candidates), places)), rng.normal(size=lines.shape)
        arrays = [np.c_[candidates, u], np.c_[lines, v], first]
        found, _ = RUNS[backend](moving_program(places), arrays)
        assert found[:2] == pytest.approx(interpret_arrays(program(places), [], [candidates, lines, first]).outputs, abs=1e-14)
        step = 1e-7
        later = candidates.copy()
        later[:, :places] += step * u
        several = (
            sum(left_over(p, q, rows[a:b], places)[0] for (p, q), (a, b) in zip(ends, pairwise(first), strict=True))
            for rows, ends in ((later, lines + step * v), (candidates, lines))
        )
        after, before = several
        assert found[2] == pytest.approx((after - before) / step, abs=1e-6)
        assert interpret_arrays(moving_program(places), [], arrays).outputs == pytest.approx(found, abs=1e-14)


@pytest.mark.parametrize("many", [1, 5])
def test_intervals_that_are_there_are_brought_together_in_jax(x64_for_jax: Any, many: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With few of them, and with more than there is room for."""
    monkeypatch.setattr("teg.backends.jax.gaps.SHORT", 0)
    monkeypatch.setattr("teg.backends.jax.gaps.MANY", many)
    arrays = some(7, 3, 5)
    arrays = [np.c_[arrays[0], np.arange(3 * len(arrays[0])).reshape(-1, 3)], np.c_[arrays[1], arrays[1]], arrays[2]]
    found, _ = in_jax(moving_program(3), arrays, compiled_in_jax.__wrapped__)  # with these limits
    assert found == pytest.approx(interpret_arrays(moving_program(3), [], arrays).outputs, abs=1e-13)


WHOLE = [[0.0, 1.0]]
TOUCH = 1e-6
CASES: dict[str, tuple[list[list[float]], list[list[float]], float, bool]] = {  # candidates with two places, the line, the length, missed
    "no candidates": ([], WHOLE, 1.0, False),
    "an empty line": ([], [[1.0, 1.0]], 0.0, False),
    "a line from right to left": ([], [[1.0, 0.0]], 0.0, False),
    "a touch from outside": ([[0.5, 0.5 + TOUCH, 0, 0.5, 0, 1, 1, 1, 0]], WHOLE, 1.0, False),
    "a touch from inside": ([[0.5, 0.5 + TOUCH, 1, 0.5, 1, 0, 0, 0, 0]], WHOLE, 0.0, False),
    "a touch at the begin": ([[TOUCH, np.inf, 0.5, 1, 0, 0, 0, 0, 0]], WHOLE, 0.0, False),
    "a tie all along": ([[np.inf, np.inf, 0.5, 0, 0, 1, 0, 0, 0]], WHOLE, 0.0, False),
    "an unknown place": ([[np.nan, np.inf, 0, 0, 0, 0, 0, 0, 0]], WHOLE, np.nan, False),
    "an unknown piece": ([[0.5, np.inf, 0, np.nan, 0, 0, 0, 0, 0]], WHOLE, np.nan, False),
    "an unknown end": ([[0.5, np.inf, 0, 1, 0, 0, 0, 0, 0]], [[0.0, np.nan]], np.nan, False),
    "a doubt": ([[0.25, 0.5, 0, 1, 0, 0, 0, 0, 1]], WHOLE, 0.75, True),
}


@pytest.mark.parametrize("backend", RUNS)
def test_touching_and_unknown(x64_for_jax: Any, backend: str) -> None:
    for name, (rows, line, length, doubtful) in CASES.items():
        arrays = [np.array(rows).reshape(-1, 9), np.array(line), np.array([0, len(rows)])]
        found, missed = RUNS[backend](program(2), arrays)
        assert found[0] == pytest.approx(length, abs=1e-15, nan_ok=True), name
        assert missed == doubtful, name
        interpreted = interpret_arrays(program(2), [], arrays)
        assert (interpreted.outputs[0], interpreted.missed) == (pytest.approx(found[0], abs=1e-15, nan_ok=True), missed), name


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_doubts_are_in_the_estimates(backend: str) -> None:
    p = with_array_error_estimates(program(2))
    for doubt in (0.0, 1.0):
        arrays = [np.array([[0.25, 0.5, 0, 1, 0, 0, 0, 0, doubt]]), np.array(WHOLE), np.array([0, 1])]
        (length, _, error, _), _ = RUNS[backend](p, arrays)
        assert length == pytest.approx(0.75, abs=1e-15)
        assert 0.0 < error < 1e-13 if not doubt else 1e-6 < error < 1e-5
        assert interpret_arrays(p, [], arrays).outputs[2] == pytest.approx(error, rel=1e-12)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_doubts_are_in_the_estimates_of_rates(backend: str) -> None:
    """What is left of the line is one gap at either side of (0.25, 0.5), whose ends move by 3 and 5: rates of 3 and -5, and of the ends."""
    p = with_array_error_estimates(moving_program(2))
    for doubt in (0.0, 1.0):
        arrays = [np.array([[0.25, 0.5, 0, 1, 0, 0, 0, 0, doubt, 3.0, 5.0]]), np.array([[0.0, 1.0, 0.0, 0.0]]), np.array([0, 1])]
        (*_, rate, _, _, error), _ = RUNS[backend](p, arrays)
        assert rate == -2.0
        assert error == pytest.approx(0.1 * doubt * (3 + 5), abs=1e-13)
        assert interpret_arrays(p, [], arrays).outputs[-1] == pytest.approx(error, abs=1e-13)
