"""Checks that the C backend's tests make of any table of programs: values, threads, every cut of the text, standalone files, sanitizers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.backends.c import build as c_build
from teg.backends.c import frame as c_frame
from teg.backends.c import routines as c_routines
from teg.backends.c.kernel import compile_c, print_kernel
from teg.backends.c.standalone import standalone_c
from teg.backends.c.text import literal
from teg.program import Program
from tests.backends.programs import Case, columns, expected

in_c = [pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")]
"""The marks of a module of tests that compile C."""

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-pedantic"]
SANITIZERS = ["-std=c99", "-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
LIMITS = ({"PART": 2}, {"BY_VALUE": 0}, {"ON_STACK": 1}, {})
"""Limits of the text that are made small, one at a time; {}: all of them."""
LONGEST_LINE = 130


def in_turn(cases: Sequence[Any], limits: Sequence[dict[str, int]], *quick: dict[str, int]) -> list[Any]:
    """Parameters: each case with the `quick` limits, and with one of the others in turn; `make thorough` sees it with all of them."""
    pairs = [pytest.param(case, few, id=f"{case.name}-{few}") for few in quick for case in cases]
    for i, case in enumerate(cases):
        for k, few in enumerate(limits):
            marks = [pytest.mark.slow, *([] if k == i % len(limits) else [pytest.mark.thorough])]
            pairs.append(pytest.param(case, few, id=f"{case.name}-{few}", marks=marks))
    return pairs


def has_its_values(case: Case) -> None:
    """The known answers, to the case's tolerance."""
    found = compile_c(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


def any_number_of_threads_gives_the_same(case: Case, copies: int) -> None:
    """A batch of copies of the case, divided among threads, to the last bit."""
    many = [np.tile(column, copies) if column.ndim else column for column in columns(case)]
    one = compile_c(case.program)(many, copies * case.n)
    for threads in (2, 7):
        np.testing.assert_array_equal(compile_c(case.program, threads=threads)(many, copies * case.n), one)


def limits_change_no_bit(case: Case, limits: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts, values and arrays in the workspace, at every size: as in one function on the stack."""
    plain = compile_c(case.program)(columns(case), case.n)
    for name in ("PART", "BY_VALUE", "ON_STACK", "BREAKS_ON_STACK", "LITERALS", "INLINE", "ARGUMENT"):
        module = c_routines if name == "BREAKS_ON_STACK" else c_frame
        monkeypatch.setattr(module, name, 0 if not limits else limits.get(name, getattr(module, name)))
    np.testing.assert_array_equal(compile_c(case.program)(columns(case), case.n), plain)


def lines_are_short(cases: Iterable[Case]) -> None:
    """The generated text can be read."""
    for case in cases:
        assert max(map(len, print_kernel(case.program).splitlines())) <= LONGEST_LINE


def count_of_calls(counted: Program, call: str, function: str, p: float) -> int:
    """How often one run for the parameter p comes to the line `call`; the counter is put before `function`, the first that may need it."""
    text = print_kernel(counted)
    assert call in text
    assert function in text
    with_counter = text.replace(call, f"{call} calls++;").replace(function, f"int calls;\n\n{function}")
    library = c_build.load_library(with_counter)
    counter = ctypes.c_int.in_dll(library, "calls")
    counter.value = 0
    value, out, stride = ctypes.c_double(p), ctypes.c_double(), ctypes.c_long(0)
    inputs, outputs = ctypes.byref(ctypes.pointer(value)), ctypes.byref(ctypes.pointer(out))
    assert library.teg_kernel(ctypes.c_long(1), inputs, ctypes.byref(stride), None, outputs, None, 1) == 0
    return counter.value


# Files


def _compile(folder: Path, *arguments: str) -> None:
    subprocess.run([*c_build.find_compiler(), *arguments], cwd=folder, check=True)


def standalone_files_work(folder: Path, whole: Program, name: str, given: Sequence[float]) -> None:
    """A main program of one's own, linked with the files of a program of one parameter, prints what the kernel computes."""
    for suffix, text in zip(("c", "h"), standalone_c(whole, name), strict=True):
        (folder / f"{name}.{suffix}").write_text(text)
    n, outputs = len(given), len(whole.outputs)
    (folder / "main.c").write_text(f"""
#include <stdio.h>
#include "{name}.h"
int main(void) {{
    double t[{n}] = {{{", ".join(map(literal, given))}}}, found[{n * outputs}], *out[{outputs}];
    const double *p[1] = {{t}};
    const long stride[1] = {{1}};
    for (int j = 0; j < {outputs}; j++) out[j] = found + j * {n};
    const int status = {name}({n}, p, stride, NULL, out, NULL, 1);
    for (int i = 0; i < {n * outputs}; i++) printf("%.17g\\n", found[i]);
    return status;
}}
""")
    _compile(folder, *STRICT, "-O2", "main.c", f"{name}.c", "-o", "main", "-lm")
    printed = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout.split()
    found = np.array([float(word) for word in printed]).reshape(outputs, n)
    np.testing.assert_allclose(found, compile_c(whole)([np.array(given)], n), rtol=1e-15)


def text_compiles_without_warnings(folder: Path, cases: Iterable[Case], counted: bool = False) -> None:
    """Strictly C99; `counted` kernels count their evaluations."""
    names = []
    for case in cases:
        names.append(f"kernel_{len(names)}.c")
        (folder / names[-1]).write_text(print_kernel(case.program, counted=counted))
    _compile(folder, *STRICT, "-O1", "-fopenmp", "-c", *names)


def behaviour_is_defined(folder: Path, cases: Iterable[Case], counted: bool = False) -> None:
    """Every case under the sanitizers for addresses and undefined behaviour; the test is skipped where the compiler has none."""
    (folder / "probe.c").write_text("int main(void) { return 0; }")
    try:
        _compile(folder, *SANITIZERS, "probe.c", "-o", "probe")
    except subprocess.CalledProcessError:
        pytest.skip("the compiler has no sanitizers")
    calls, sources = [], ["main.c"]
    for i, case in enumerate(cases):
        sources.append(f"case_{i}.c")
        (folder / sources[-1]).write_text(print_kernel(case.program, f"case_{i}", counted))
        given = [np.broadcast_to(column, case.n) for column in columns(case)]
        table = ", ".join(f"{{{', '.join(map(literal, map(float, column)))}}}" for column in given) or "{0.0}"
        rows, outputs = max(1, len(given)), len(case.program.outputs)
        calls += [
            f"int case_{i}(long, const double *const *, const long *, const void *, double *const *, long *, int);",
            f"static int run_{i}(void) {{",
            f"    static double t[{rows}][{case.n}] = {{{table}}}, found[{outputs * case.n}];",
            f"    const double *p[{rows}]; long stride[{rows}], notes[{case.n}];",
            f"    for (int k = 0; k < {rows}; k++) p[k] = t[k], stride[k] = 1;",
            f"    double *out[{max(outputs, 1)}] = {{0}};",
            f"    for (int j = 0; j < {outputs}; j++) out[j] = found + j * {case.n};",
            f"    return case_{i}({case.n}, p, stride, 0, out, notes, 1);",
            "}",
        ]
    run = " + ".join(f"run_{i}()" for i in range(len(sources) - 1))
    (folder / "main.c").write_text("\n".join(["#include <math.h>", *calls, f"int main(void) {{ return {run}; }}"]))
    _compile(folder, *SANITIZERS, *sources, "-o", "main", "-lm")
    subprocess.run([str(folder / "main")], check=True)
