"""Location of common zeros in the C backend: known answers, the text in plain Python, cost, every cut of the text, standalone files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from teg.backends.c.kernel import compile_c, print_kernel
from teg.backends.c.standalone import standalone_c
from teg.errors import OptionError
from teg.program import LOCATE_HALVINGS, LOCATE_WIDTH, Arg, Locate, Stmt
from tests.backends.c_checks import (
    LIMITS,
    any_number_of_threads_gives_the_same,
    behaviour_is_defined,
    count_of_calls,
    has_its_values,
    in_c,
    in_turn,
    limits_change_no_bit,
    lines_are_short,
    standalone_files_work,
    text_compiles_without_warnings,
)
from tests.backends.isolate_programs import ROOTS
from tests.backends.isolate_surfaces import numbered, sum_over
from tests.backends.locate_literally import literally
from tests.backends.locate_pairs import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Pair,
    chord,
    ends,
    locate,
    point,
    root,
    sloped_circles,
    sloped_ends,
    sloped_wave,
    two_circles,
    wave,
)
from tests.backends.locate_programs import LOCATE_CASES, NESTS, PLACES, SAME, SPAN, ZERO
from tests.backends.programs import Case, columns, let, program

pytestmark = in_c


# Values


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    has_its_values(case)


@pytest.mark.parametrize("case", [PLACES[0], PLACES[3], *NESTS], ids=lambda case: case.name)
def test_any_number_of_threads(case: Case) -> None:
    any_number_of_threads_gives_the_same(case, 40)


@pytest.mark.parametrize("case", PLACES, ids=lambda case: case.name)
def test_table_is_the_text(case: Case) -> None:
    """Every case, to the last bit as the text in plain Python has it."""
    (stmt,) = case.program.body
    assert isinstance(stmt, Locate)
    given = np.array([np.broadcast_to(column, case.n) for column in columns(case)]).reshape(len(case.columns), case.n)
    sides = (stmt.lo, stmt.hi, stmt.low, stmt.high)
    found = compile_c(case.program)(columns(case), case.n)
    for i in range(case.n):
        values: dict[Arg, float] = {f"p{k}": float(x) for k, x in enumerate(given[:, i])}
        lo, hi, low, high = (values[side] if isinstance(side, str) else float(side) for side in sides)
        assert (
            found[:, i].tolist() == literally(Pair(stmt.enclosure, stmt.bounds), lo, hi, low, high, len(stmt.results), values)[: len(found)]
        )


@pytest.mark.parametrize(
    "pair",
    [
        ends("p0", "p1", "p2"),
        two_circles("p0", "p1", "p2", 3.0),
        chord("p0", "p1"),
        wave("p2", "p1"),
        point("p0", "p1"),
        root("p0", "p1"),
        sloped_ends("p0", "p1", "p2"),
        sloped_circles("p0", "p1", "p2", 3.0),
        sloped_wave("p2", "p1"),
    ],
    ids=["ends", "two circles", "chord", "wave", "point", "root", "sloped ends", "sloped circles", "sloped wave"],
)
def test_random_pairs_are_the_text(pair: Pair) -> None:
    """Parameters and rectangles at random; the places are the same to the last bit."""
    results = numbered(6)
    given = np.random.default_rng(5).normal(0.0, 2.0, (7, 40))
    given[2] = np.abs(given[2])
    found = compile_c(program(7, (locate(results, pair, "p3", "p4", "p5", "p6"),), *results.split()))(list(given), 40)
    assert np.isfinite(found).any()
    for i in range(40):
        values: dict[Arg, float] = {f"p{k}": float(x) for k, x in enumerate(given[:, i])}
        assert found[:, i].tolist() == literally(pair, *given[3:, i].tolist(), 6, values)[:6]


# Cost


def rectangles(pair: Pair, p: float) -> int:
    """How many rectangles are bounded to locate the places of a pair in (-2, 3) × (-1.5, 1.75)."""
    counted = program(1, (locate("vr0 vr1 vr2", pair, -2.0, 3.0, -1.5, 1.75),), "vr0")
    return count_of_calls(counted, "teg_judge(&search, f);", "static void teg_locate", p)


@pytest.mark.parametrize(
    ("pair", "p", "most"),
    [
        (Pair((), ("p0", 2.0, -1.0, 1.0)), 1.0, 1),  # bounds without 0
        (point("p0", 0.3), 0.7, 4 * LOCATE_HALVINGS + 1),  # one rectangle of a level is kept
        (ends(0.0, 0.0, "p0"), 1.0, 16 * LOCATE_HALVINGS),  # two ends, few rectangles about each
        (ends(0.0, 0.0, "p0"), -1.0, 8),
        (ZERO, 1.0, 2 * LOCATE_WIDTH),  # given up as soon as a level is full
        (SAME, 1.0, 6 * LOCATE_WIDTH),
        (sloped_ends(0.0, 0.0, "p0"), 1.0, 400),  # bounds, middles and Newton's steps
    ],
)
def test_cost(pair: Pair, p: float, most: int) -> None:
    assert 1 <= rectangles(pair, p) <= most


# Text


@pytest.mark.parametrize(("case", "limits"), in_turn([PLACES[0], PLACES[3], PLACES[13], *NESTS], LIMITS))
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    limits_change_no_bit(case, limits, monkeypatch)


def test_a_long_block_and_many_captured_values() -> None:
    """f = v - p by 2000 steps, longer than a C function may be; p is the sum of more values than are passed as arguments."""
    parts = tuple(let(f"vp{i}", "mul", "p0", 0.01) for i in range(100))
    block: list[Stmt] = [let("vp", "add", *(f"vp{i}" for i in range(100)))]
    last = {LEFT: LEFT, RIGHT: RIGHT}
    for i in range(1_000):
        for side, before in last.items():
            block.append(let(f"v{side}{i}", "add", before, 1.0 if i % 2 else -1.0))
            last[side] = f"v{side}{i}"
    block += [let("va", "sub", last[LEFT], "vp"), let("vb", "sub", last[RIGHT], "vp")]
    block += [let("vc", "sub", BOTTOM, "p1"), let("vd", "sub", TOP, "p1")]
    pair = Pair(tuple(block), ("va", "vb", "vc", "vd"))
    kernel = compile_c(program(2, (*parts, locate("vr0 vr1", pair, -1.0, 4.0, -1.0, 1.0)), "vr0", "vr1"))
    assert kernel.source.count("static void places_") > 4
    found = kernel([np.array([1.0, 3.0, 9.0, 2.0]), np.array([0.5, -0.5, 0.5, 1.5])], 4)
    np.testing.assert_allclose(found, [[1.0, 3.0, np.inf, np.inf], [np.inf] * 4], rtol=1e-7)


def test_many_results() -> None:
    """More than are kept on the C stack."""
    names = numbered(100).split()
    found_places = locate(" ".join(names), wave(math.pi, 0.3), 0.4, "p0", 0.0, 1.0)
    total = sum_over("vs", "x2", tuple(names), (), "x2")
    found = compile_c(program(1, (found_places, total), *names, "vs"))([np.array([70.4, 0.7])], 2)
    np.testing.assert_allclose(found[:70, 0], np.arange(1, 71), rtol=3e-6)
    assert (found[70:100] == np.inf).all()
    assert (found[:100, 1] == np.inf).all()
    np.testing.assert_allclose(found[100], [35 * 71, 0.0], rtol=1e-6)


def test_similar_locations_share_a_function() -> None:
    body: list[Stmt] = []
    for k in range(100):
        sides = tuple(f"x{k}{side}" for side in "lrbt")
        shifts = ((k + 0.1) / 7, (k + 0.1) / 7, 0.75, 0.75)
        block = tuple(let(f"va{side}", "sub", side, by) for side, by in zip(sides, shifts, strict=True))
        a, b, c, d = (f"va{side}" for side in sides)
        body.append(Locate(0.0, "p0", 0.0, 1.0, *sides, block, (a, b, c, d), (f"vr{k}",)))
    total = sum_over("vs vn", "xs", tuple(f"vr{k}" for k in range(100)), (), "xs", 1.0)
    kernel = compile_c(program(1, (*body, total), "vs", "vn"))
    assert kernel.source.count("static double places_") == 1
    whole, some = sum((k + 0.1) / 7 for k in range(100)), sum((k + 0.1) / 7 for k in range(4))
    np.testing.assert_allclose(kernel([np.array([50.0, 0.5])], 2), [[whole, some], [100.0, 4.0]], rtol=1e-6)


def test_only_what_is_needed_of_the_runtime_is_printed() -> None:
    text = print_kernel(PLACES[0].program)
    assert f"#define TEG_LOCATE_HALVINGS {LOCATE_HALVINGS}" in text
    assert f"#define TEG_LOCATE_WIDTH {LOCATE_WIDTH}" in text
    assert "ISOLATE" not in text
    assert "teg_pair" not in text
    assert "LOCATE" not in print_kernel(ROOTS[0].program)
    lines_are_short(LOCATE_CASES)


# Standalone files


def test_standalone_files(tmp_path: Path) -> None:
    standalone_files_work(tmp_path, program(1, SPAN, "vspan", "varea"), "span", [1.0, 2.0, 0.5])


def test_names_of_routines_are_taken() -> None:
    with pytest.raises(OptionError):
        standalone_c(program(0, (), 1.0), "places_1")


@pytest.mark.slow
def test_text_compiles_without_warnings(tmp_path: Path) -> None:
    text_compiles_without_warnings(tmp_path, LOCATE_CASES)


@pytest.mark.slow
def test_no_undefined_behaviour(tmp_path: Path) -> None:
    """Every case, at the fullest level and beyond it."""
    behaviour_is_defined(tmp_path, LOCATE_CASES)
