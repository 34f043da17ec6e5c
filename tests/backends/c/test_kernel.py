"""The C backend: exact values, shape and size of the generated text, the cache on disk, standalone files."""

from __future__ import annotations

import math
import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from teg.backends.c import build as c_build
from teg.backends.c import frame as c_frame
from teg.backends.c import routines as c_routines
from teg.backends.c.kernel import CKernel, compile_c, print_kernel
from teg.backends.c.text import literal
from teg.backends.numpy.kernel import compile_numpy
from teg.errors import CompilerError, OptionError, ParameterError
from teg.program import INSIDE, Adaptive, Assign, Gauss, Integrate, Program
from tests.backends.c_checks import in_c, in_turn
from tests.backends.programs import (
    CASES,
    DISC,
    ONE_VARIABLE,
    TIES,
    TWO_VARIABLES,
    WATCHED,
    Case,
    columns,
    expected,
    integrate,
    let,
    program,
)

pytestmark = [*in_c, pytest.mark.usefixtures("as_users_compile")]


def square(addend: float = 0.0) -> Program:
    return program(1, (let("v0", "powi", "p0", 2), let("v1", "add", "v0", addend)), "v1")


def assert_squares(kernel: CKernel, addend: float = 0.0) -> None:
    np.testing.assert_array_equal(kernel([np.array([1.0, -3.0])], 2), [[1 + addend, 9 + addend]])


# Values


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_value(case: Case) -> None:
    found = compile_c(case.program).outcome(columns(case), case.n)
    np.testing.assert_allclose(found.values, expected(case), rtol=case.tolerance, atol=case.tolerance)
    assert found.missed == case.missed
    assert found.evaluations == 0


@pytest.mark.parametrize("case", [*TWO_VARIABLES, *TIES], ids=lambda case: case.name)
def test_any_number_of_threads_gives_the_same(case: Case) -> None:
    many = [np.tile(column, 300) if column.ndim else column for column in columns(case)]
    one = compile_c(case.program)(many, 300 * case.n)
    for threads in (0, 2, 7):
        np.testing.assert_array_equal(compile_c(case.program, threads=threads)(many, 300 * case.n), one)


@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.5, 0.1, 5e-324, -1.7976931348623157e308, math.inf, -math.inf, math.nan])
def test_literals_are_exact(x: float) -> None:
    found = compile_c(program(0, (), x))([], 1)
    assert found.tobytes() == np.array([[x]]).tobytes() or (math.isnan(x) and np.isnan(found[0, 0]))
    assert "-" not in literal(x) or literal(x)[0] in "(0123456789"


def test_simple_and_many_literals_stay_in_the_text() -> None:
    few = print_kernel(program(0, (integrate("v9", "x0", 0.0, 0.3, (let("v0", "mul", 2.0, "x0"),), "v0"),), "v9"))
    assert "integral_1(0.3)" in few
    assert "2.0 * x" in few


def test_columns_of_any_stride_are_read_in_place() -> None:
    kernel = compile_c(program(2, (let("v0", "mul", "p0", 10.0), let("v1", "add", "v0", "p1")), "v1"))
    table = np.arange(24.0).reshape(6, 4)
    expected = 10 * table[::-2, 1] + 5
    np.testing.assert_array_equal(kernel([table[::-2, 1], np.array(5.0)], 3)[0], expected)
    np.testing.assert_array_equal(kernel([np.broadcast_to(2.0, 3), np.ones(3)], 3)[0], [21.0] * 3)
    packed = np.zeros(3, dtype=[("flag", "i1"), ("x", "f8")])
    packed["x"] = [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(kernel([packed["x"], np.array(0.0)], 3)[0], [10.0, 20.0, 30.0])


def test_empty_batch_no_outputs_no_results() -> None:
    assert compile_c(square())([np.empty(0)], 0).shape == (1, 0)
    assert compile_c(program(1, ()))([np.zeros(3)], 3).shape == (0, 3)
    assert compile_c(program(0, (Integrate("x0", 0.0, 1.0, (), (), None, (), (), (), Gauss(1)),), 1.0))([], 2).tolist() == [[1, 1]]


@pytest.mark.parametrize("column", [np.zeros(2), np.zeros(3, dtype=np.float32), np.zeros((3, 1)), np.zeros(3, dtype=">f8")])
def test_columns_that_do_not_fit_are_refused(column: np.ndarray) -> None:
    kernel = compile_c(square())
    with pytest.raises(ParameterError):
        kernel([column], 3)
    with pytest.raises(ParameterError):
        kernel([], 3)


def test_negative_threads_are_refused() -> None:
    with pytest.raises(OptionError):
        compile_c(square(), threads=-1)


def test_pickles() -> None:
    kernel = pickle.loads(pickle.dumps(compile_c(square(2.0), threads=2)))
    assert kernel.threads == 2
    assert_squares(kernel, 2.0)


@pytest.mark.parametrize("nodes", [1, 2, 3, 7, 20, 65])
def test_gauss_is_exact_to_its_degree(nodes: int) -> None:
    powers = range(0, 2 * nodes, max(1, nodes // 4))
    body = tuple(let(f"v{k}", "powi", "x0", k) for k in powers)
    values = [f"v{k}" for k in powers]
    results = " ".join(f"vr{k}" for k in powers)
    found = compile_c(program(0, (integrate(results, "x0", 0.0, 1.0, body, *values, rule=Gauss(nodes)),), *results.split()))([], 1)
    np.testing.assert_allclose(found[:, 0], [1 / (k + 1) for k in powers], rtol=1e-14)


# Long programs


def chain(length: int, first: str = "p0") -> tuple[tuple[Assign, ...], str, Callable[[float], float]]:
    """Statements that each need recent values, some an early one, and a condition; and the same in Python."""
    body, names = [], [first]
    for i in range(length):
        early = names[i // 3 if i % 50 == 0 else max(0, i - 5)]
        name = f"b{first}{i}" if i % 100 == 7 else f"v{first}{i}"
        if i % 100 == 7:
            body.append(let(name, "gt0", names[-1]))
            names.append(names[-1])
            continue
        op = ("select", f"b{first}{7 + 100 * (i // 200)}") if i % 40 == 20 and i > 100 else ("sub", "mul", "add")[i % 3 : i % 3 + 1]
        body.append(let(name, op[0], *op[1:], names[-1], 0.5 if op[0] == "mul" else early))
        names.append(name)

    def value(x: float) -> float:
        known: dict[str, float] = {first: x}
        for stmt in body:
            args = [known[a] if isinstance(a, str) else float(a) for a in stmt.args]
            match stmt.op:
                case "gt0":
                    known[stmt.name] = args[0] > 0
                case "select":
                    known[stmt.name] = args[1] if args[0] else args[2]
                case "sub":
                    known[stmt.name] = args[0] - args[1]
                case "mul":
                    known[stmt.name] = args[0] * args[1]
                case _:
                    known[stmt.name] = args[0] + args[1]
        return known[names[-1]]

    return tuple(body), names[-1], value


@pytest.mark.parametrize("length", [700, 2_000, 20_000])
def test_long_straight_line(length: int) -> None:
    body, last, value = chain(length)
    kernel = compile_c(program(1, body, last))
    assert kernel.source.count("static void element") == 1 + math.ceil((length + 1) / c_frame.PART)
    np.testing.assert_array_equal(kernel([np.array([0.3, -0.7])], 2)[0], [value(0.3), value(-0.7)])


def test_long_body_and_long_flags_of_an_integral() -> None:
    flags, flag, flag_value = chain(1_000, "x0")
    body, last, value = chain(3_000, "p0")
    inner = (*body, let("v1", "mul", last, flag), let("v2", "add", "v1", "x0", flag))
    integral = integrate("v9", "x0", 0.0, "p0", inner, "v2", flags=(*flags, let("bn", "ok", flag)), need="bn", rule=Gauss(2))
    found = compile_c(program(1, (integral,), "v9"))([np.array([2.0, -1.0])], 2)
    for p, result in zip((2.0, -1.0), found[0], strict=True):
        low, high = sorted((0.0, p))
        middle = flag_value(low + INSIDE * (high - low))
        assert result == pytest.approx(p * (value(p) * middle + middle + p / 2), rel=1e-13)


def sum_of_integrals(count: int, shapes: int = 1) -> Program:
    """Σₖ ∫ [x < cₖ] (x + … + x) over (0, p0), cₖ = (k + 0.1)/count, in so many shapes."""
    body: list[Assign | Integrate] = []
    for k in range(count):
        x, cut = f"x{k}", (k + 0.1) / count
        flags = (let(f"vd{k}", "sub", x, cut), let(f"bd{k}", "lt0", f"vd{k}"))
        inner = (let(f"ve{k}", "add", *[x] * (1 + k % shapes)),)
        body.append(
            integrate(
                f"vr{k}",
                x,
                0.0,
                "p0",
                inner,
                f"ve{k}",
                breaks=(cut,),
                flags=flags,
                need=f"bd{k}",
                rule=Gauss(1),
            )
        )
    return program(1, (*body, let("v9", "add", *(f"vr{k}" for k in range(count)))), "v9")


@pytest.mark.parametrize(("count", "shapes"), [(3_000, 1), (1_000, 30)])
def test_similar_integrals_share_a_function(count: int, shapes: int) -> None:
    kernel = compile_c(sum_of_integrals(count, shapes))
    assert kernel.source.count("static double integral_") == shapes
    exact = math.fsum((1 + k % shapes) * ((k + 0.1) / count) ** 2 / 2 for k in range(count))
    assert kernel([np.array(1.0)], 1)[0, 0] == pytest.approx(exact, rel=1e-13)


def test_text_grows_linearly() -> None:
    for family in (sum_of_integrals, lambda n: program(1, chain(n)[0], chain(n)[1])):
        small, large = len(print_kernel(family(1_000))), len(print_kernel(family(4_000)))
        assert large < 4.3 * small


def test_many_captured_values_results_and_breaks() -> None:
    """More than fit in C arguments and on the C stack, in both rules, nested, with ties."""
    count = 300
    given = tuple(let(f"v{k}", "mul", "p0", float(k)) for k in range(count))
    inner = tuple(let(f"vi{k}", "mul", f"v{k}", "x0", "x1") for k in range(count))
    results = " ".join(f"vj{k}" for k in range(count))
    breaks = tuple(f"v{k}" for k in range(count))
    tie = let("b0", "tie", "p1", 1.0, True, 0)
    first = integrate(results, "x0", 0.0, "p0", inner, *(f"vi{k}" for k in range(count)), breaks=breaks, rule=Gauss(1))
    totals = " ".join(f"vk{k}" for k in range(count))
    second = integrate(totals, "x1", 0.0, 2.0, (first,), *results.split(), rule=Adaptive(1e-12))
    last = let("vz", "select", "b0", "vk7", 0.0)
    kernel = compile_c(program(2, (*given, tie, second, last), *totals.split(), "vz", ties=1))
    p0 = np.array([1.0, -2.0])
    found = kernel([p0, np.array([0.0, 1.0])], 2)
    exact = np.array([k * p0 * p0**2 / 2 * 2 for k in range(count)])
    np.testing.assert_allclose(found[:-1], exact, rtol=1e-13)
    np.testing.assert_allclose(found[-1], [exact[7, 0] / 2, exact[7, 1]], rtol=1e-13)


LIMITS = ({"PART": 2}, {"BY_VALUE": 0}, {"ON_STACK": 1}, {"PART": 3, "BY_VALUE": 1}, {"INLINE": 0})


@pytest.mark.parametrize(("case", "limits"), in_turn([c for c in CASES if " at " not in c.name], LIMITS, {}))
def test_limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts, values and arrays in the workspace, at every size: as in one function on the stack."""
    plain = compile_c(case.program)(columns(case), case.n)
    for name in ("PART", "BY_VALUE", "ON_STACK", "BREAKS_ON_STACK", "LITERALS", "INLINE", "ARGUMENT"):
        module = c_routines if name == "BREAKS_ON_STACK" else c_frame
        monkeypatch.setattr(module, name, 0 if not limits else limits.get(name, getattr(module, name)))
    np.testing.assert_array_equal(compile_c(case.program)(columns(case), case.n), plain)


def test_many_parameters() -> None:
    count = 500
    kernel = compile_c(program(count, (let("v0", "add", *(f"p{i}" for i in range(count))),), "v0"))
    shared = [np.array(float(i)) if i % 2 else np.array([i, 2.0 * i]) for i in range(count)]
    even, odd = sum(range(0, count, 2)), sum(range(1, count, 2))
    np.testing.assert_array_equal(kernel(shared, 2)[0], [even + odd, 2 * even + odd])


def test_many_breaks_are_sorted() -> None:
    """∫ [x in the odd cells] over (0, 1) with 400 shuffled breaks."""
    cuts = np.random.default_rng(5).permutation(np.arange(1, 400) / 400).tolist()
    flags = (
        let("v0", "mul", "x0", 200.0),
        let("v1", "mod", "v0", 1.0),
        let("v2", "sub", "v1", 0.5),
        let("b0", "gt0", "v2"),
    )
    integral = integrate("v9", "x0", 0.0, "p0", (), 1.0, breaks=tuple(cuts), flags=flags, need="b0", rule=Gauss(1))
    found = compile_c(program(1, (integral,), "v9"))([np.array([1.0, 0.5])], 2)
    np.testing.assert_allclose(found[0], [0.5, 0.25], rtol=1e-13)


# Text


def test_a_value_used_once_is_printed_where_it_is_used() -> None:
    body = (
        let("v0", "mul", "p0", "p1"),
        let("v1", "neg", "v0"),
        let("v2", "add", "p0", "v1"),
        let("v3", "sub", "p1", "v2"),
        let("b0", "gt0", "v3"),
        let("v4", "div", "p0", "p1"),
        let("v5", "powi", "v4", 2),
        let("v6", "div", "p1", "v5"),
        let("v7", "select", "b0", "v6", -1.0),
        let("v8", "mul", "v7", "v7"),
    )
    source = print_kernel(program(2, body, "v8"))
    inside = source.split("static void element")[1].split("}")[0].splitlines()[2:]
    assert [line.strip() for line in inside if line] == [
        "const double v1 = p0 / p1;",
        "const double v2 = p1 - (p0 - p0 * p1) > 0.0 ? p1 / (v1 * v1) : (-1.0);",
        "f[0] = v2 * v2;",
    ]


def test_the_order_of_operations_is_kept() -> None:
    """Every operand in every place, against the same operations one a statement."""
    ops = (("add", 2), ("sub", 2), ("mul", 2), ("div", 2), ("neg", 1), ("add", 3), ("mul", 3), ("powi", 1), ("select", 2))
    outer = []
    for op, count in ops:
        for place in range(count):
            for within, number in ops:
                k = len(outer)
                inner = [f"p{i}" for i in range(number)]
                args: list[str | int] = [f"p{(i + 1) % 3}" for i in range(count)]
                args[place] = f"vi{k}"
                outer.append(let(f"vi{k}", within, *(["b0"] * (within == "select")), *inner, *([-3] * (within == "powi"))))
                outer.append(let(f"vo{k}", op, *(["b0"] * (op == "select")), *args, *([2] * (op == "powi"))))
    given = [np.random.default_rng(k).normal(size=50) for k in range(3)]
    wanted = program(3, (let("b0", "gt0", "p1"), *outer), *(s.name for s in outer))  # all are outputs: all have names
    short = program(3, (let("b0", "gt0", "p1"), *outer), *(s.name for s in outer if s.name[1] == "o"))
    assert len(print_kernel(short).splitlines()) < 0.8 * len(print_kernel(wanted).splitlines())
    found = compile_c(short)(given, 50)
    np.testing.assert_array_equal(found, compile_c(wanted)(given, 50)[1::2])
    np.testing.assert_array_equal(found, compile_numpy(wanted)(given, 50)[1::2])


def test_only_what_is_needed_of_the_runtime_is_printed() -> None:
    always = {"teg_kernel", "teg_kernel_watched", "teg_watch", "teg_pace", "teg_ask", "teg_stopped", "teg_wait", "teg_array"}
    assert set(re.findall(r"\bteg_\w+", print_kernel(square()))) == always
    disc = print_kernel(DISC)
    assert "teg_nodes_18[18]" in disc
    assert "TEG_MAX_DEPTH 48" in disc
    for absent in ("teg_mod", "teg_tie", "TEG_TIE_EPS", "TEG_WATCH_WIDTH", "teg_substitution", "TEG_NEAR", "evaluations +="):
        assert absent not in disc
    exact = print_kernel(TWO_VARIABLES[0].program)
    for absent in ("teg_assess", "teg_nodes", "teg_context", "null rules"):
        assert absent not in exact
    assert "teg_sink" in print_kernel(ONE_VARIABLE[4].program)


def test_lines_are_short() -> None:
    for text in (print_kernel(case.program) for case in CASES):
        assert max(map(len, text.splitlines())) <= 130


# Names


HOSTILE = ("*/ #error", "??/", "a\\\n#error", "/* x", "λ\u202e", '"', "%s%n", "\0", "int", "*\\\n/ #error")


def test_hostile_names_are_harmless() -> None:
    body = (let("v0", "add", *(f"p{i}" for i in range(len(HOSTILE)))),)
    hostile = Program(HOSTILE, body, ("v0",))
    assert compile_c(hostile)([np.array(1.0)] * len(HOSTILE), 1)[0, 0] == len(HOSTILE)
    assert "#error" not in print_kernel(hostile)
    assert print_kernel(hostile).isascii()


# The compiler


def test_no_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(c_build, "zig_of_wheel", tuple)
    with pytest.raises(CompilerError) as error:
        compile_c(square())
    for word in ("teg-compiler[c]", "apt", "xcode-select", "Windows", 'backend="numpy"'):
        assert word in error.value.hint


def test_cc_names_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler = tmp_path / "my compiler"
    compiler.symlink_to(c_build.find_compiler()[0])
    monkeypatch.setenv("CC", f"'{compiler}' -DNOTHING")
    assert c_build.find_compiler() == (str(compiler), "-DNOTHING")
    assert_squares(compile_c(square(6.0)), 6.0)


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script as compiler")
@pytest.mark.parametrize(
    "unknown", ["-march=native", "-fopenmp", "-march=native|-fopenmp", "-fno-tree-*", "-march=native|-fopenmp|-fno-dse"]
)
def test_flags_the_compiler_does_not_know_are_left_out(unknown: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = c_build.find_compiler()[0]
    compiler = tmp_path / "cc"
    compiler.write_text(f'#!/bin/sh\nfor flag; do case $flag in {unknown}) exit 1;; esac; done\nexec "{real}" "$@"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    assert_squares(compile_c(square(), threads=2))
    light = ("-O1", *c_build.LIGHT)
    assert c_build.load_library("int two(void) { return 2; }", optimise=light, openmp=True).two() == 2


@pytest.mark.parametrize("case", [TWO_VARIABLES[1], TIES[3], WATCHED[3], WATCHED[4]], ids=lambda case: case.name)
def test_text_compiles_without_warnings(case: Case, tmp_path: Path) -> None:
    (tmp_path / "kernel.c").write_text(print_kernel(case.program))
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fopenmp"]
    subprocess.run([*c_build.find_compiler(), *flags, "-c", "kernel.c"], cwd=tmp_path, check=True)
