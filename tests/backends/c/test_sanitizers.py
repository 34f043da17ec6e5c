"""The generated C of every kind of statement under the sanitizers for addresses and undefined behaviour, from plain C."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import teg
from teg.backends.c.build import NATIVE
from teg.backends.c.kernel import print_kernel
from teg.backends.c.standalone import standalone_c
from teg.backends.c.text import literal
from teg.ir.expr import Param
from teg.program import Adaptive, Gauss, Integrate, Isolate, Locate, Midpoint, Program, Sample, SumOver, statements
from teg.program.arrays import Like
from tests.backends import isolate_programs, locate_programs, programs
from tests.backends.c_checks import SANITIZERS, _compile, behaviour_is_defined, in_c, text_compiles_without_warnings
from tests.bench import scenes
from tests.passes.normalise import test_tables as tables

pytestmark = [*in_c, pytest.mark.slow]
CASES = [case for case in programs.CASES if " at " not in case.name]
x, y, z = teg.vars("x y z")


SCENES: dict[str, tuple[Callable[[], tuple[teg.Expr, list[Param]]], dict[str, object]]] = {
    "triangle, constant": (lambda: scenes.triangle_pixel(0), {}),
    "triangle, linear": (lambda: scenes.triangle_pixel(1), {}),
    "triangle, quadratic": (lambda: scenes.triangle_pixel(2), {}),
    "bilinear pixel": (scenes.bilinear_pixel, {}),
    "brackets": (lambda: scenes.heavisides(150), {}),
    "half-planes": (lambda: scenes.half_planes(5), {}),
    "disk": (scenes.disk, {}),
    "superellipse": (scenes.superellipse, {"tol": 1e-5}),
    "heart": (scenes.heart, {"tol": 1e-3}),
    "sphere by samples": (scenes.sphere, {"rule": "qmc", "order": 999}),
    "sphere by random samples": (scenes.sphere, {"rule": "montecarlo", "order": 999}),
    "disk by a uniform rule": (scenes.disk, {"rule": "midpoint", "order": 31}),
    "many kinks": (lambda: scenes.distances(6), {}),
    "staircase": (lambda: (teg.integral(teg.floor(5 * x + teg.param("t")) * x, (x, 0, 1)), [teg.param("t")]), {}),
    "tails": (lambda: (teg.integral(teg.exp(-x * x) * teg.bracket(x < teg.param("t")), (x, -math.inf, math.inf)), [teg.param("t")]), {}),
}


def choices() -> tuple[teg.Expr, list[Param]]:
    """Sixty candidates, two parts each: cells, lines and corners outgrow the stack."""
    k, t, a = teg.index("k"), *teg.params("t a")
    key = (k - 60 * a) * x + (7 * k % 11 - 5) * y * t + (5 * k % 13) / 13
    where = ((x + y * t > k / 80) & (x < a + k / 60)) | (y > (k + 1) / 61)
    chosen = teg.nearest((k * t + x * y, a), key, (k, 0, 60), where=where, otherwise=x * t)
    least = teg.minimum_of((k - 30 * a) ** 2, (k, 0, 60), where=k > 50 * t, otherwise=t)
    over = (x, 0, 1), (y, 0, a)
    return teg.tuple(*(teg.integral(e, *over) for e in chosen), least * teg.prod(t + k, (k, 0, 5))), [t, a]


LOOPS: dict[str, tuple[Callable[[], tuple[teg.Expr, list[Param]]], dict[str, object]]] = {"choices": (choices, {})}


def kinds(whole: Program) -> set[str]:
    found = set()
    for s in statements(whole.body):
        found.add(type(s).__name__)
        if isinstance(s, Integrate):
            found.add(type(s.rule).__name__)
    return found


def program_of(name: str) -> Program:
    (make, options) = (SCENES | LOOPS)[name]
    e, wrt = make()
    return teg.compile(e, wrt, **options).program(1)  # type: ignore[arg-type]


def test_every_kind_of_statement_is_among_them() -> None:
    found = set().union(*(kinds(program_of(name)) for name in SCENES), *(kinds(case.program) for case in CASES))
    wanted = (Integrate, Isolate, Locate, SumOver, Sample, Gauss, Adaptive, Midpoint)
    missing = {kind.__name__ for kind in wanted} - found
    extra = set().union(*(kinds(case.program) for case in (*isolate_programs.ISOLATE_CASES, *locate_programs.LOCATE_CASES)))
    assert missing <= extra


def runs_cleanly(folder: Path, *flags: str) -> None:
    """main.c with scene.c returns 0 under the sanitizers, which say nothing; the test is skipped where the compiler has none."""
    try:
        _compile(folder, *SANITIZERS, *flags, "main.c", "scene.c", "-o", "main", "-lm")
    except subprocess.CalledProcessError:
        _compile(folder, "-std=c99", "main.c", "scene.c", "-o", "main", "-lm")
        pytest.skip("the compiler has no sanitizers")
    done = subprocess.run([str(folder / "main")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("name", "flags"), [*((name, ()) for name in [*SCENES, *LOOPS]), *((name, (NATIVE,)) for name in LOOPS)])
def test_scenes(name: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    """Value and gradient at ordinary points, at ties, far away, at NaN and infinity; every byte that is read was written, and nothing
    behind the ends of the arrays is touched: they are of the exact size, on the heap."""
    whole = program_of(name)
    for suffix, text in zip("ch", standalone_c(whole, "scene"), strict=True):
        (tmp_path / f"scene.{suffix}").write_text(text)
    rng = np.random.default_rng(3)
    n, inputs, outputs = 14, len(whole.parameters), len(whole.outputs)
    table = rng.uniform(0.1, 0.9, (inputs, n))
    table[:, 4:6] = np.round(table[:, 4:6] * 2) / 2
    table[:, 6] = 0.0
    table[:, 7] = 1.0
    table[:, 8] *= 1e8
    table[:, 9] *= -1e-8
    table[:, 10] = np.nan
    table[:, 11] = np.inf
    table[rng.integers(inputs), 12] = np.nan
    table[rng.integers(inputs), 13] = -np.inf
    rows = ",\n".join("{" + ", ".join(map(literal, map(float, row))) + "}" for row in table)
    (tmp_path / "main.c").write_text(f"""
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "scene.h"
static const double table[{inputs}][{n}] = {{{rows}}};
int main(void)
{{
    const double **const p = malloc(SCENE_INPUTS * sizeof *p);
    long *const stride = malloc(SCENE_INPUTS * sizeof *stride), *const notes = malloc({n} * sizeof *notes);
    double *const found = malloc(SCENE_OUTPUTS * {n} * sizeof *found), **const out = malloc(SCENE_OUTPUTS * sizeof *out);
    int numbers = 0;
    for (int i = 0; i < SCENE_INPUTS; i++) {{
        double *const column = malloc(sizeof table[i]);
        memcpy(column, table[i], sizeof table[i]);
        p[i] = column, stride[i] = 1;
    }}
    for (int j = 0; j < SCENE_OUTPUTS; j++) out[j] = found + j * {n};
    if (scene({n}, p, stride, NULL, out, notes, 1)) return 1;
    for (int i = 0; i < SCENE_OUTPUTS * {n}; i++) if (found[i] == found[i]) numbers++;
    for (int i = 0; i < {n}; i++) if (notes[i] < 0 || notes[i] > 3) return 2;
    for (int i = 0; i < SCENE_INPUTS; i++) free((void *)p[i]);
    free(p), free(stride), free(notes), free(out), free(found);
    return numbers < SCENE_OUTPUTS ? 3 : 0;
}}
""")
    assert outputs > 1
    runs_cleanly(tmp_path, *flags)


def test_programs_of_all_statements(tmp_path: Path) -> None:
    behaviour_is_defined(tmp_path, CASES)


def test_programs_that_count(tmp_path: Path) -> None:
    behaviour_is_defined(tmp_path, CASES[::3], counted=True)


def test_no_warnings(tmp_path: Path) -> None:
    text_compiles_without_warnings(tmp_path, CASES)
    single = []
    for i, case in enumerate(CASES[::3]):
        single.append(f"single_{i}.c")
        (tmp_path / single[-1]).write_text(print_kernel(case.program, real="float"))
    _compile(tmp_path, "-std=c99", "-Wall", "-Wextra", "-Wshadow", "-Werror", "-pedantic", "-c", *single)


def test_tables_of_rows(tmp_path: Path) -> None:
    """Tables, their derivatives and the copies of chunks; arrays are of the exact size, and lists hold entries that are not read."""
    f = teg.compile(tables.scene(), [tables.P, tables.C, tables.s], backend="c")
    whole, given = f.program(1), tables.given(1)
    for suffix, text in zip("ch", standalone_c(whole, "scene"), strict=True):
        (tmp_path / f"scene.{suffix}").write_text(text)
    lines = []
    for i, spec in enumerate(whole.arrays):
        array = np.asarray(given[spec.name])
        kind = "int64_t" if spec.integers else "double"
        numbers = ", ".join(map(str, array.ravel()) if spec.integers else map(literal, map(float, array.ravel())))
        lines += [
            f"static const {kind} d{i}[] = {{{numbers}}};",
            f"static const int64_t s{i}[] = {{{', '.join(map(str, array.shape))}}};",
        ]
    copied = [
        f"void *const h{i} = malloc(sizeof d{i}); memcpy(h{i}, d{i}, sizeof d{i}); a[{i}] = (teg_array){{h{i}, 0, s{i}}};"
        for i in range(len(whole.arrays))
    ]
    sizes = [np.size(given[whole.arrays[o.array].name]) if isinstance(o, Like) else 1 for o in whole.outputs]
    outs = [f"out[{j}] = malloc({size} * sizeof(double));" for j, size in enumerate(sizes)]
    (tmp_path / "main.c").write_text(f"""
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "scene.h"
{chr(10).join(lines)}
int main(void)
{{
    const double x = 0.7, *p[] = {{&x}};
    const long stride[] = {{0}};
    long note;
    double *out[{len(sizes)}];
    teg_array a[{len(whole.arrays)}];
    int wrong;
    {chr(10).join(copied + outs)}
    wrong = scene(1, p, stride, a, out, &note, 1) || !(out[0][0] > 0.0);
    {" ".join(f"free(out[{j}]);" for j in range(len(sizes)))}
    {" ".join(f"free(h{i});" for i in range(len(whole.arrays)))}
    return wrong;
}}
""")
    runs_cleanly(tmp_path)
