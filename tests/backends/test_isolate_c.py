"""Isolation of roots and sums over them in the C backend: known answers, cost, every cut of the text, standalone files."""

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
from teg.backends.numpy_backend import compile_numpy
from teg.errors import OptionError
from teg.program import ISOLATE_DEPTH, Adaptive, Assign, Isolate, Stmt
from tests.backends.isolate_programs import (
    ISOLATE_CASES,
    ROOTS,
    SUMS,
    TRIANGLE,
    Surface,
    cubic,
    isolate,
    kink,
    line,
    numbered,
    root,
    square,
    sum_over,
    wave,
)
from tests.backends.programs import Case, columns, expected, integrate, let, program

pytestmark = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")


@pytest.fixture(autouse=True, scope="module")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One empty cache for the tests of this module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_CACHE_DIR", str(tmp_path_factory.mktemp("teg")))
        yield


# Values


@pytest.mark.parametrize("case", ISOLATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_c(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.parametrize("case", [ROOTS[0], *SUMS], ids=lambda case: case.name)
def test_any_number_of_threads_gives_the_same(case: Case) -> None:
    many = [np.tile(column, 300) if column.ndim else column for column in columns(case)]
    one = compile_c(case.program)(many, 300 * case.n)
    for threads in (2, 7):
        np.testing.assert_array_equal(compile_c(case.program, threads=threads)(many, 300 * case.n), one)


@pytest.mark.parametrize(
    "g", [cubic("p0"), wave("p0", "p1"), square("p0", "p1"), line("p0", "p1"), kink("p0", "p1"), root("p0")], ids=lambda g: g.point[0].name
)
def test_agrees_with_numpy(g: Surface) -> None:
    """Roots at random, between random bounds. A root that only bisection finds is the same number too."""
    results = numbered(12)
    roots = program(4, (isolate(results, g, "p2", "p3"),), *results.split())
    given = list(np.random.default_rng(11).normal(0.0, 3.0, (4, 400)))
    given[0] = np.abs(given[0])
    found = compile_c(roots)(given, 400)
    assert np.isfinite(found).any()
    np.testing.assert_allclose(found, compile_numpy(roots)(given, 400), rtol=1e-14, atol=1e-15)


def test_integrals_isolations_and_sums_in_the_blocks() -> None:
    """g(x) = ∫₀ˣ 2t dt - y, y the root of y - p; its bounds are x² - p at the ends."""
    enclosure = (
        sum_over("vl", "x1", ("x0l",), (let("vl2", "powi", "x1", 2), let("vlow", "sub", "vl2", "p0")), "vlow"),
        sum_over("vr", "x2", ("x0r",), (let("vr2", "powi", "x2", 2), let("vhigh", "sub", "vr2", "p0")), "vhigh"),
        let("vdl", "mul", 2.0, "x0l"),
        let("vdr", "mul", 2.0, "x0r"),
    )
    bounds = (let("va", "sub", "x4l", "p0"), let("vb", "sub", "x4r", "p0"))
    point = (
        Isolate("x4", 0.0, 10.0, "x4l", "x4r", bounds, ("va", "vb", 1.0, 1.0), (let("vyg", "sub", "x4", "p0"),), "vyg", 1.0, ("vy",)),
        integrate("vi", "x3", 0.0, "x0", (let("vt", "mul", 2.0, "x3"),), "vt", rule=Adaptive(1e-12)),
        let("vg", "sub", "vi", "vy"),
        let("vd", "mul", 2.0, "x0"),
    )
    g = Surface(enclosure, ("vl", "vr", "vdl", "vdr"), point, "vg", "vd")
    p = np.array([0.25, 2.0, 9.5])
    found = compile_c(program(1, (isolate("vr0 vr1", g, 0.0, 3.0),), "vr0", "vr1"))([p], 3)
    np.testing.assert_allclose(found, [[0.5, math.sqrt(2.0), np.inf], [np.inf] * 3], rtol=1e-15)


# Cost


def evaluations(g: Surface, lo: float, hi: float, p: float) -> int:
    """How often g is evaluated to find its roots."""
    text = print_kernel(program(1, (isolate("vr0 vr1 vr2", g, lo, hi),), "vr0"))
    counted = text.replace("teg_answer(&search, f);", "teg_answer(&search, f); evaluations++;")
    library = c_build.load_library(counted.replace("static void teg_answer", "int evaluations;\n\nstatic void teg_answer"))
    counter = ctypes.c_int.in_dll(library, "evaluations")
    counter.value = 0
    value, out, stride = ctypes.c_double(p), ctypes.c_double(), ctypes.c_long(0)
    assert library.teg_kernel(ctypes.c_long(1), ctypes.byref(ctypes.pointer(value)), ctypes.byref(stride), ctypes.byref(out), 1) == 0
    return counter.value


@pytest.mark.parametrize(
    ("g", "p", "most"),
    [
        (line(2.0, "p0"), 0.3, 4),  # the ends, the middle, the root
        (line(2.0, "p0"), 1.5, 2),  # monotone, no change of sign: the ends
        (square(0.3, "p0"), -0.1, 2),  # bounds without 0
        (wave(1.0, "p0"), 0.7, 8),  # Newton's method converges quadratically
        (kink(0.3, "p0"), 0.2, 16),
        (square(0.3, "p0"), 0.0, 3 * ISOLATE_DEPTH),  # a tangency: two boxes or fewer a level
    ],
)
def test_cost(g: Surface, p: float, most: int) -> None:
    assert evaluations(g, 0.0, 1.0, p) <= most


# Text


@pytest.mark.slow
@pytest.mark.parametrize("limits", [{"PART": 2}, {"BY_VALUE": 0}, {"ON_STACK": 1}, {}], ids=str)
@pytest.mark.parametrize("case", [ROOTS[0], ROOTS[4], *SUMS], ids=lambda case: case.name)
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts, values and arrays in the workspace, at every size: as in one function on the stack."""
    plain = compile_c(case.program)(columns(case), case.n)
    for name in ("PART", "BY_VALUE", "ON_STACK", "BREAKS_ON_STACK", "LITERALS", "INLINE", "ARGUMENT"):
        module = c_print if name == "BREAKS_ON_STACK" else c_frame
        monkeypatch.setattr(module, name, 0 if not limits else limits.get(name, getattr(module, name)))
    np.testing.assert_array_equal(compile_c(case.program)(columns(case), case.n), plain)


def geometric(x: str, length: int) -> tuple[tuple[Assign, ...], str]:
    """2x as x + ½(x + ½(x + …))."""
    body: list[Assign] = []
    last: str | float = 0.0
    for i in range(length // 2):
        body += [let(f"vh{x}{i}", "mul", 0.5, last), let(f"vs{x}{i}", "add", x, f"vh{x}{i}")]
        last = f"vs{x}{i}"
    return tuple(body), str(last)


def test_long_blocks_and_many_captured_values() -> None:
    """2x - p in the three blocks, each longer than a C function may be; p is the sum of more values than are passed as arguments."""
    parts = tuple(let(f"vp{i}", "mul", "p0", 0.01) for i in range(100))
    total = let("vp", "add", *(f"vp{i}" for i in range(100)))
    left, l2 = geometric("x0l", 1_000)
    right, r2 = geometric("x0r", 1_000)
    middle, x2 = geometric("x0", 1_000)
    body, s2 = geometric("x1", 2_000)
    enclosure = (*left, *right, let("va", "sub", l2, "p0"), let("vb", "sub", r2, "p0"))
    g = Surface(enclosure, ("va", "vb", 2.0, 2.0), (*middle, total, let("vg", "sub", x2, "vp")), "vg", 2.0)
    last = (*body, let("vq", "add", s2, *(f"vp{i}" for i in range(100))))
    whole = (*parts, isolate("vr0 vr1", g, -1.0, 4.0), sum_over("vs", "x1", ("vr0", "vr1"), last, "vq"))
    kernel = compile_c(program(1, whole, "vr0", "vs"))
    assert kernel.source.count("static void roots_") > 4
    found = kernel([np.array([1.0, 3.0, 9.0])], 3)
    np.testing.assert_allclose(found, [[0.5, 1.5, np.inf], [2.0, 6.0, 0.0]], rtol=1e-13)


def test_many_results_and_points() -> None:
    """More than are kept on the C stack or passed as C arguments."""
    names = numbered(100).split()
    body = (let("vx", "mul", "x1", "p0"),)
    sums = [f"vs{i}" for i in range(70)]
    points = (*names, *(float(i) for i in range(300)))
    found_roots = isolate(" ".join(names), wave(math.pi), 0.5, "p0")
    whole = (found_roots, sum_over(" ".join(sums), "x1", points, body, "vx", *[1.0] * 69))
    found = compile_c(program(1, whole, *names, *sums))([np.array([40.25, 0.75])], 2)
    np.testing.assert_allclose(found[:40, 0], np.arange(1, 41), rtol=1e-15)
    assert (found[40:100] == np.inf).all()
    assert (found[:100, 1] == np.inf).all()
    np.testing.assert_allclose(found[100], [40.25 * (820 + 44850), 0.75 * 44850], rtol=1e-14)
    np.testing.assert_array_equal(found[101:], np.tile([340.0, 300.0], (69, 1)))


def test_similar_isolations_and_sums_share_a_function() -> None:
    body: list[Stmt] = []
    for k in range(300):
        x = f"x{k}"
        ends = (let(f"va{k}", "sub", f"{x}l", (k + 0.1) / 7), let(f"vb{k}", "sub", f"{x}r", (k + 0.1) / 7))
        point = (let(f"vg{k}", "sub", x, (k + 0.1) / 7),)
        body.append(Isolate(x, 0.0, "p0", f"{x}l", f"{x}r", ends, (f"va{k}", f"vb{k}", 1.0, 1.0), point, f"vg{k}", 1.0, (f"vr{k}",)))
        body.append(sum_over(f"vs{k}", f"x{k}s", (f"vr{k}",), (let(f"vt{k}", "mul", f"x{k}s", 7.0),), f"vt{k}"))
    kernel = compile_c(program(1, (*body, let("vz", "add", *(f"vs{k}" for k in range(300)))), "vz"))
    assert kernel.source.count("static double roots_") == kernel.source.count("static double sum_") == 1
    np.testing.assert_allclose(
        kernel([np.array([50.0, 0.5])], 2), [[sum(k + 0.1 for k in range(300)), sum(k + 0.1 for k in range(4))]], rtol=1e-13
    )


def test_only_what_is_needed_of_the_runtime_is_printed() -> None:
    sums = print_kernel(SUMS[1].program)
    assert "teg_isolation" not in sums
    assert "ISOLATE" not in sums
    assert "teg_min" not in print_kernel(SUMS[1].program)
    roots = print_kernel(ROOTS[0].program)
    assert f"#define TEG_ISOLATE_DEPTH {ISOLATE_DEPTH}" in roots
    assert "teg_pair" not in roots
    for case in ISOLATE_CASES:
        assert max(map(len, print_kernel(case.program).splitlines())) <= 130


# Standalone files


STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-pedantic"]
MAIN = """
#include <stdio.h>
#include "area.h"
int main(void) {
    double t[3] = {1.0, 2.0, 0.5}, out[6];
    const double *p[1] = {t};
    const long stride[1] = {1};
    const int status = area(3, p, stride, out, 1);
    for (int i = 0; i < 6; i++) printf("%.17g\\n", out[i]);
    return status;
}
"""


def test_standalone_files(tmp_path: Path) -> None:
    whole = program(1, TRIANGLE, "varea", "vmoment")
    source, header = standalone_c(whole, "area")
    (tmp_path / "area.c").write_text(source)
    (tmp_path / "area.h").write_text(header)
    (tmp_path / "main.c").write_text(MAIN)
    subprocess.run([*c_build.find_compiler(), *STRICT, "-O2", "main.c", "area.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    printed = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True).stdout.split()
    found = np.array([float(word) for word in printed]).reshape(2, 3)
    np.testing.assert_allclose(found, compile_c(whole)([np.array([1.0, 2.0, 0.5])], 3), rtol=1e-15)


@pytest.mark.parametrize("name", ["roots_1", "sum_2"])
def test_names_of_routines_are_taken(name: str) -> None:
    with pytest.raises(OptionError):
        standalone_c(program(0, (), 1.0), name)


def test_text_compiles_without_warnings(tmp_path: Path) -> None:
    names = []
    for case in (*ROOTS, *SUMS):
        names.append(f"kernel_{len(names)}.c")
        (tmp_path / names[-1]).write_text(print_kernel(case.program))
    subprocess.run([*c_build.find_compiler(), *STRICT, "-O1", "-fopenmp", "-c", *names], cwd=tmp_path, check=True)


def test_no_undefined_behaviour(tmp_path: Path) -> None:
    """Every case under the sanitizers, at the widest level and beyond it."""
    compiler, flags = c_build.find_compiler(), ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    (tmp_path / "probe.c").write_text("int main(void) { return 0; }")
    if subprocess.run([*compiler, *flags, "probe.c", "-o", "probe"], cwd=tmp_path, capture_output=True, check=False).returncode:
        pytest.skip("the compiler has no sanitizers")
    calls, sources = [], ["main.c"]
    for i, case in enumerate((*ROOTS, *SUMS)):
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
