"""Location of common zeros in the C backend: known answers, the text in plain Python, cost, every cut of the text, standalone files."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from teg.backends import c_build, c_frame, c_print
from teg.backends.c_backend import compile_c, print_kernel, standalone_c
from teg.backends.c_text import literal
from teg.errors import OptionError
from teg.program import LOCATE_DEPTH, LOCATE_WIDTH, Arg, Locate, Stmt
from tests.backends.isolate_programs import ROOTS, numbered, sum_over
from tests.backends.locate_programs import (
    BOTTOM,
    LEFT,
    LOCATE_CASES,
    NESTS,
    PLACES,
    RIGHT,
    SAME,
    SPAN,
    TOP,
    ZERO,
    Pair,
    chord,
    ends,
    literally,
    locate,
    point,
    root,
    two_circles,
    wave,
)
from tests.backends.programs import Case, columns, expected, let, program

pytestmark = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")


@pytest.fixture(autouse=True, scope="module")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One empty cache for the tests of this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_CACHE_DIR", str(tmp_path_factory.mktemp("teg")))
        yield


# Values


@pytest.mark.parametrize("case", LOCATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_c(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", [PLACES[0], PLACES[3], *NESTS], ids=lambda case: case.name)
def test_any_number_of_threads_gives_the_same(case: Case) -> None:
    many = [np.tile(column, 40) if column.ndim else column for column in columns(case)]
    one = compile_c(case.program)(many, 40 * case.n)
    for threads in (2, 7):
        np.testing.assert_array_equal(compile_c(case.program, threads=threads)(many, 40 * case.n), one)


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
        assert found[:, i].tolist() == literally(Pair(stmt.enclosure, stmt.bounds), lo, hi, low, high, len(stmt.results), values)


@pytest.mark.parametrize(
    "pair",
    [
        ends("p0", "p1", "p2"),
        two_circles("p0", "p1", "p2", 3.0),
        chord("p0", "p1"),
        wave("p2", "p1"),
        point("p0", "p1"),
        root("p0", "p1"),
    ],
    ids=["ends", "two circles", "chord", "wave", "point", "root"],
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
        assert found[:, i].tolist() == literally(pair, *given[3:, i].tolist(), 6, values)


# Cost


def rectangles(pair: Pair, p: float) -> int:
    """How many rectangles are bounded to locate the places of a pair in (-2, 3) × (-1.5, 1.75)."""
    text = print_kernel(program(1, (locate("vr0 vr1 vr2", pair, -2.0, 3.0, -1.5, 1.75),), "vr0"))
    counted = text.replace("teg_judge(&search, f);", "teg_judge(&search, f); rectangles++;")
    library = c_build.load_library(counted.replace("static void teg_locate", "int rectangles;\n\nstatic void teg_locate"))
    counter = ctypes.c_int.in_dll(library, "rectangles")
    counter.value = 0
    value, out, stride = ctypes.c_double(p), ctypes.c_double(), ctypes.c_long(0)
    assert library.teg_kernel(ctypes.c_long(1), ctypes.byref(ctypes.pointer(value)), ctypes.byref(stride), ctypes.byref(out), 1) == 0
    return counter.value


@pytest.mark.parametrize(
    ("pair", "p", "most"),
    [
        (Pair((), ("p0", 2.0, -1.0, 1.0)), 1.0, 1),  # bounds without 0
        (point("p0", 0.3), 0.7, 2 * LOCATE_DEPTH + 1),  # one rectangle of a level is kept
        (ends(0.0, 0.0, "p0"), 1.0, 8 * LOCATE_DEPTH),  # two ends, few rectangles about each
        (ends(0.0, 0.0, "p0"), -1.0, 8),
        (ZERO, 1.0, 2 * LOCATE_WIDTH + LOCATE_DEPTH),  # given up as soon as a level is full
        (SAME, 1.0, 6 * LOCATE_WIDTH),
    ],
)
def test_cost(pair: Pair, p: float, most: int) -> None:
    assert 1 <= rectangles(pair, p) <= most


# Text


@pytest.mark.slow
@pytest.mark.parametrize("limits", [{"PART": 2}, {"BY_VALUE": 0}, {"ON_STACK": 1}, {}], ids=str)
@pytest.mark.parametrize("case", [PLACES[0], PLACES[3], PLACES[13], *NESTS], ids=lambda case: case.name)
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts, values and arrays in the workspace, at every size: as in one function on the stack."""
    plain = compile_c(case.program)(columns(case), case.n)
    for name in ("PART", "BY_VALUE", "ON_STACK", "BREAKS_ON_STACK", "LITERALS", "INLINE", "ARGUMENT"):
        module = c_print if name == "BREAKS_ON_STACK" else c_frame
        monkeypatch.setattr(module, name, 0 if not limits else limits.get(name, getattr(module, name)))
    np.testing.assert_array_equal(compile_c(case.program)(columns(case), case.n), plain)


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
    assert f"#define TEG_LOCATE_DEPTH {LOCATE_DEPTH}" in text
    assert f"#define TEG_LOCATE_WIDTH {LOCATE_WIDTH}" in text
    assert "ISOLATE" not in text
    assert "teg_pair" not in text
    assert "LOCATE" not in print_kernel(ROOTS[0].program)
    for case in LOCATE_CASES:
        assert max(map(len, print_kernel(case.program).splitlines())) <= 130


# Standalone files


STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-pedantic"]
MAIN = """
#include <stdio.h>
#include "span.h"
int main(void) {
    double t[3] = {1.0, 2.0, 0.5}, out[6];
    const double *p[1] = {t};
    const long stride[1] = {1};
    const int status = span(3, p, stride, out, 1);
    for (int i = 0; i < 6; i++) printf("%.17g\\n", out[i]);
    return status;
}
"""


def test_standalone_files(tmp_path: Path) -> None:
    whole = program(1, SPAN, "vspan", "varea")
    source, header = standalone_c(whole, "span")
    (tmp_path / "span.c").write_text(source)
    (tmp_path / "span.h").write_text(header)
    (tmp_path / "main.c").write_text(MAIN)
    subprocess.run([*c_build.find_compiler(), *STRICT, "-O2", "main.c", "span.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    printed = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True).stdout.split()
    found = np.array([float(word) for word in printed]).reshape(2, 3)
    np.testing.assert_allclose(found, compile_c(whole)([np.array([1.0, 2.0, 0.5])], 3), rtol=1e-15)


def test_names_of_routines_are_taken() -> None:
    with pytest.raises(OptionError):
        standalone_c(program(0, (), 1.0), "places_1")


def test_text_compiles_without_warnings(tmp_path: Path) -> None:
    names = []
    for case in LOCATE_CASES:
        names.append(f"kernel_{len(names)}.c")
        (tmp_path / names[-1]).write_text(print_kernel(case.program))
    subprocess.run([*c_build.find_compiler(), *STRICT, "-O1", "-fopenmp", "-c", *names], cwd=tmp_path, check=True)


def test_no_undefined_behaviour(tmp_path: Path) -> None:
    """Every case under the sanitizers, at the fullest level and beyond it."""
    compiler, flags = c_build.find_compiler(), ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    (tmp_path / "probe.c").write_text("int main(void) { return 0; }")
    if subprocess.run([*compiler, *flags, "probe.c", "-o", "probe"], cwd=tmp_path, capture_output=True, check=False).returncode:
        pytest.skip("the compiler has no sanitizers")
    calls, sources = [], ["main.c"]
    for i, case in enumerate(LOCATE_CASES):
        sources.append(f"case_{i}.c")
        (tmp_path / sources[-1]).write_text(print_kernel(case.program, f"case_{i}"))
        given = [np.broadcast_to(column, case.n) for column in columns(case)]
        table = ", ".join(f"{{{', '.join(map(literal, map(float, column)))}}}" for column in given) or "{0.0}"
        rows, outputs = max(1, len(given)), len(case.program.outputs)
        calls += [
            f"int case_{i}(long, const double *const *, const long *, double *, int);",
            f"static int run_{i}(void) {{",
            f"    static double t[{rows}][{case.n}] = {{{table}}}, out[{outputs * case.n}];",
            f"    const double *p[{rows}]; long stride[{rows}];",
            f"    for (int k = 0; k < {rows}; k++) p[k] = t[k], stride[k] = 1;",
            f"    return case_{i}({case.n}, p, stride, out, 1);",
            "}",
        ]
    run = " + ".join(f"run_{i}()" for i in range(len(sources) - 1))
    (tmp_path / "main.c").write_text("\n".join(["#include <math.h>", *calls, f"int main(void) {{ return {run}; }}"]))
    subprocess.run([*compiler, *flags, *sources, "-o", "main", "-lm"], cwd=tmp_path, check=True)
    subprocess.run([str(tmp_path / "main")], check=True)
