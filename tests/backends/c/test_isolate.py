"""Isolation of roots and sums over them in the C backend: known answers, cost, every cut of the text, standalone files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from teg.backends.c.kernel import compile_c, print_kernel
from teg.backends.c.standalone import standalone_c
from teg.backends.numpy.kernel import compile_numpy
from teg.errors import OptionError
from teg.program import ISOLATE_DEPTH, Adaptive, Assign, Isolate, Stmt
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
from tests.backends.isolate_programs import ISOLATE_CASES, ROOTS, SUMS, TRIANGLE
from tests.backends.isolate_surfaces import Surface, cubic, isolate, kink, line, numbered, root, square, sum_over, wave
from tests.backends.programs import Case, integrate, let, program

pytestmark = in_c


# Values


@pytest.mark.parametrize("case", ISOLATE_CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    has_its_values(case)


@pytest.mark.parametrize("case", [ROOTS[0], *SUMS], ids=lambda case: case.name)
def test_any_number_of_threads(case: Case) -> None:
    any_number_of_threads_gives_the_same(case, 300)


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
    counted = program(1, (isolate("vr0 vr1 vr2", g, lo, hi),), "vr0")
    return count_of_calls(counted, "teg_answer(&search, f);", "static void teg_answer", p)


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


@pytest.mark.parametrize(("case", "limits"), in_turn([ROOTS[0], ROOTS[4], *SUMS], LIMITS))
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    limits_change_no_bit(case, limits, monkeypatch)


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
    lines_are_short(ISOLATE_CASES)


# Standalone files


def test_standalone_files(tmp_path: Path) -> None:
    standalone_files_work(tmp_path, program(1, TRIANGLE, "varea", "vmoment"), "area", [1.0, 2.0, 0.5])


@pytest.mark.parametrize("name", ["roots_1", "sum_2"])
def test_names_of_routines_are_taken(name: str) -> None:
    with pytest.raises(OptionError):
        standalone_c(program(0, (), 1.0), name)


@pytest.mark.slow
def test_text_compiles_without_warnings(tmp_path: Path) -> None:
    text_compiles_without_warnings(tmp_path, (*ROOTS, *SUMS))


@pytest.mark.slow
def test_no_undefined_behaviour(tmp_path: Path) -> None:
    """Every case, at the widest level and beyond it."""
    behaviour_is_defined(tmp_path, (*ROOTS, *SUMS))
