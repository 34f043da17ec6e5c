"""C files for use without Python: they compile without a warning anywhere, compute what the evaluator does, and say what they compute."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import teg
from teg.__main__ import main
from teg.backends.c.build import load_library
from teg.backends.c.kernel import compile_c, print_kernel
from teg.backends.c.loops import print_arrays
from teg.backends.c.standalone import ROUTINES, standalone_c
from teg.errors import OptionError
from teg.program import Adaptive
from tests.backends.c.test_frame import SCENES, program_of
from tests.backends.c_checks import STRICT, _compile, in_c, standalone_files_work
from tests.backends.programs import TWO_VARIABLES, integrate, let, program
from tests.bench.scenes import picture

pytestmark = in_c
SOURCE = """
import teg
x, y = teg.vars("x y")
t, a, b = teg.params("bound tilt rate")
affine = teg.integral(teg.bracket(x + a*y < t) * (1 + b*x*y), (x, 0, 1), (y, 0, 1))
disk = teg.integral(teg.bracket((x - a)**2 + y*y < t) * teg.exp(b*x), (x, -1, 1), (y, -1, 1))
both = teg.tuple(affine, teg.tuple(t*a, disk))
constant = teg.integral(x*x, (x, 0, 3))
"""
AT = {"bound": [0.5, 0.7, 1.1], "tilt": [0.3, 0.3, 0.3], "rate": [1.0, -2.0, 0.25]}
"""In the order in which they are created: no other module has these names."""


def flat(values: object) -> list[float]:
    return [leaf for entry in values for leaf in flat(entry)] if isinstance(values, tuple) else [float(values)]  # type: ignore[arg-type]


def expected(f: teg.Evaluator, order: int, point: dict[str, float]) -> list[float]:
    """All outputs at a point, in the order of the header."""
    value, gradient = f.value_and_grad(point)
    hessian = f.hessian(point) if order > 1 else {}
    names = [p.name for p in f.wrt]
    found = flat(value)
    if order > 0:
        found += [flat(gradient[k])[i] for i in range(len(flat(value))) for k in names]
    if order > 1:
        found += [flat(hessian[j, k])[i] for i in range(len(flat(value))) for j in names for k in names]
    return found


def run_main(folder: Path, name: str, real: str = "double", flags: tuple[str, ...] = ("-O2",), batch: int = 3) -> np.ndarray:
    """The outputs at AT, from a main program that knows nothing but the header: the second parameter is shared by the batch."""
    rows = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in AT.values())
    (folder / "main.c").write_text(f"""
#include <stdio.h>
#include "{name}.h"
int main(void)
{{
    {real} values[3][3] = {{{rows}}}, found[{name.upper()}_OUTPUTS * {batch}], *out[{name.upper()}_OUTPUTS];
    const {real} *p[{name.upper()}_INPUTS + 1] = {{0}};
    long stride[{name.upper()}_INPUTS + 1] = {{0}}, notes[{batch}];
    for (int i = 0; i < {name.upper()}_INPUTS; i++) p[i] = values[i], stride[i] = i != 1;
    for (int j = 0; j < {name.upper()}_OUTPUTS; j++) out[j] = found + j * {batch};
    if ({name}({batch}, p, stride, NULL, out, notes, 2)) return 1;
    for (int j = 0; j < {name.upper()}_OUTPUTS * {batch}; j++) printf("%.17g\\n", (double)found[j]);
    return 0;
}}
""")
    _compile(folder, *STRICT, "-Wpedantic", "-Wconversion", "-Wno-sign-conversion", "-Wno-float-conversion", *flags,
             "main.c", f"{name}.c", "-o", "main", "-lm")  # fmt: skip
    printed = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout.split()
    return np.array([float(word) for word in printed]).reshape(-1, batch)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "scene.py"
    path.write_text(SOURCE)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("which", ["affine", "both"])
def test_what_the_command_line_writes(source: Path, which: str, order: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Value, gradient and Hessian in plain C99 with every warning an error, beside the evaluator's."""
    assert main(["compile", f"{source}:{which}", "--target", "c", "--derivatives", str(order), "-o", str(source.with_name("scene.c"))]) == 0
    assert "scene(bound, tilt, rate)" in capsys.readouterr().out
    found = run_main(source.parent, "scene")
    e = teg.__main__.load_expression(f"{source}:{which}")
    f = teg.compile(e)
    for k in range(3):
        wanted = expected(f, order, {name: AT[name][k] for name in AT})
        np.testing.assert_allclose(found[:, k], wanted, rtol=1e-12, atol=1e-12)
    header = source.with_name("scene.h").read_text()
    listed = re.findall(r"out\[(\d+)\]  (.*)", header)
    assert [int(j) for j, _ in listed] == list(range(len(found)))
    assert [text for _, text in listed] == f.output_names(order)
    assert re.findall(r"p\[(\d)\]  (.*)", header) == [("0", "bound"), ("1", "tilt"), ("2", "rate")]


def test_output_names() -> None:
    t, a = teg.params("t a")
    f = teg.compile(teg.tuple(t * a, teg.tuple(t)), [t, a])
    assert f.output_names() == ["value[0]", "value[1][0]"]
    assert f.output_names(1)[2:] == ["d value[0] / d t", "d value[0] / d a", "d value[1][0] / d t", "d value[1][0] / d a"]
    assert teg.compile(t * a, [a]).output_names(2) == ["value", "d value / d a", "d2 value / d a d a"]


def test_single_precision(source: Path) -> None:
    assert main(["compile", f"{source}:disk", "--dtype", "float32", "-o", str(source.with_name("disk.c"))]) == 0
    found = run_main(source.parent, "disk", "float")
    f = teg.compile(teg.__main__.load_expression(f"{source}:disk"))
    for k in range(3):
        wanted = expected(f, 1, {name: AT[name][k] for name in AT})
        np.testing.assert_allclose(found[:, k], wanted, rtol=2e-6, atol=2e-6)


@pytest.mark.slow
def test_threads_and_optimisation_change_nothing(source: Path) -> None:
    assert main(["compile", f"{source}:disk", "-o", str(source.with_name("disk.c"))]) == 0
    plain = run_main(source.parent, "disk")
    np.testing.assert_array_equal(run_main(source.parent, "disk", flags=("-O2", "-fopenmp")), plain)
    np.testing.assert_allclose(run_main(source.parent, "disk", flags=("-O3", "-march=native")), plain, rtol=1e-13)


def test_a_program_without_parameters(source: Path) -> None:
    assert main(["compile", f"{source}:constant", "-o", str(source.with_name("constant.c"))]) == 0
    assert run_main(source.parent, "constant").ravel() == pytest.approx([9.0] * 3)


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no C++ compiler")
def test_the_header_is_for_cpp_too(source: Path) -> None:
    assert main(["compile", f"{source}:affine", "-o", str(source.with_name("scene.c"))]) == 0
    folder = source.parent
    call = "scene(0, nullptr, nullptr, nullptr, nullptr, nullptr, 1)"
    (folder / "main.cpp").write_text(f'#include "scene.h"\nint main() {{ return {call}; }}\n')
    _compile(folder, "-std=c99", "-c", "scene.c")
    subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "main.cpp", "scene.o", "-o", "cpp", "-lm"], cwd=folder, check=True)
    subprocess.run([str(folder / "cpp")], check=True)


def test_two_programs_in_one_binary(source: Path) -> None:
    folder = source.parent
    for name in ("affine", "disk"):
        assert main(["compile", f"{source}:{name}", "-o", str(folder / f"{name}.c")]) == 0
    (folder / "two.c").write_text(
        '#include "affine.h"\n#include "disk.h"\nint main(void) { return AFFINE_INPUTS + DISK_INPUTS - 6 + '
        "affine(0, 0, 0, 0, 0, 0, 1) + disk(0, 0, 0, 0, 0, 0, 1); }\n"
    )
    _compile(folder, *STRICT, "two.c", "affine.c", "disk.c", "-o", "two", "-lm")
    subprocess.run([str(folder / "two")], check=True)


def test_a_watched_call_can_be_stopped(tmp_path: Path) -> None:
    """The poll of plain C is told how it goes on, and what it returns is how long it is not asked."""
    case = TWO_VARIABLES[2]
    text, header = standalone_c(case.program, "disc")
    assert "disc_watched" in header
    (tmp_path / "disc.c").write_text(text)
    (tmp_path / "disc.h").write_text(header)
    (tmp_path / "main.c").write_text("""
#include <stdio.h>
#include "disc.h"
typedef struct { int asked, stop_at; long pieces; } state;
static long poll(void *data)
{
    state *const s = data;
    return ++s->asked == s->stop_at ? 0 : s->pieces;
}
int main(void)
{
    static double t[4000], found[8000];
    double *const out[2] = {found, found + 4000};
    const double *p[1] = {t};
    const long stride[1] = {1};
    state s[3] = {{0, -1, 100}, {0, -1, 1000}, {0, 5, 100}};
    int status[3];
    for (int i = 0; i < 4000; i++) t[i] = 1.0;
    for (int k = 0; k < 3; k++) status[k] = disc_watched(4000, p, stride, NULL, out, NULL, 1, poll, &s[k]);
    for (int k = 0; k < 3; k++) printf("%d %d\\n", status[k], s[k].asked);
    return 0;
}
""")
    _compile(tmp_path, *STRICT, "-O1", "main.c", "disc.c", "-o", "main", "-lm")
    lines = subprocess.run([str(tmp_path / "main")], check=True, capture_output=True, text=True).stdout.split("\n")
    (free, often), (free_too, seldom), (stopped, asked) = (map(int, line.split()) for line in lines[:3])
    assert (free, free_too, stopped) == (0, 0, 2)
    assert asked == 5
    assert 8 * seldom < often < 12 * seldom


def test_files_of_a_program(tmp_path: Path) -> None:
    """They agree with the kernel to the last bit at the same flags."""
    standalone_files_work(tmp_path, TWO_VARIABLES[2].program, "disc", [1.0, 2.25, -1.0])


def test_notes_say_of_each_point_what_happened_there() -> None:
    """A tie is 1, a tolerance missed 2, too little room for roots 4, an evaluation 8; the caller need not want to know,
    and the header says so."""
    body = (
        let("b0", "tie", "p0", 1.0, True, 0),
        let("v0", "select", "b0", 1.0, 3.0),
        integrate("v2", "x0", 0.0, 1.0, (let("v1", "pow", "x0", "p1"),), "v1", rule=Adaptive(1e-9)),
    )
    whole = program(2, body, "v0", "v2", ties=1)
    run = load_library(print_kernel(whole, counted=True)).teg_kernel
    columns = [np.array([1.0, 0.0, 1.0, 0.0]), np.array([1.0, 1.0, -0.9, -0.9])]
    pointers = np.array([column.ctypes.data for column in columns], dtype=np.uintp)
    stride, out, notes = np.ones(2, dtype=np.dtype(ctypes.c_long)), np.empty((2, 4)), np.full(4, -1, dtype=np.dtype(ctypes.c_long))
    for told in (notes.ctypes.data, None):
        rows = np.array([row.ctypes.data for row in out], dtype=np.uintp)
        given = (ctypes.c_void_p(x) for x in (pointers.ctypes.data, stride.ctypes.data, None, rows.ctypes.data, told))
        assert run(ctypes.c_long(4), *given, ctypes.c_int(1)) == 0
        np.testing.assert_array_equal(out[0], [1.0, 2.0, 1.0, 2.0])
    assert (notes & 3).tolist() == [0, 1, 2, 3]
    assert (notes >> 3)[:2].tolist() == [10, 20]  # a tie takes two runs
    assert (notes >> 3)[3] == 2 * (notes >> 3)[2] > 1000
    header = standalone_c(whole, "told")[1]
    assert "notes    NULL, or room for n" in header
    assert "double *const *out, long *notes, int threads);" in header


# Names


NAMES = ["", "int", "class", "a-b", "1a", "a b", "teg_mod", "TEG_X", "element", "integral_1", "f(", "é", "_x", "sin", "sinf", "y0", "main",
         "exit", "malloc", "NULL", "NAN", "DBL_MAX", "INT64_C", "size_t", "int64_t", "strcat", "memmove", "select", "finite",
         "a" * 60, "x;y", "decision_2", "straight_3", "branch_4", "crossed_5", "rest_6"]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_standalone_names_must_be_usable(name: str) -> None:
    with pytest.raises(OptionError):
        standalone_c(TWO_VARIABLES[2].program, name)


def test_names_of_routines_are_refused() -> None:
    """Whatever the printers call a function or a table, the exported function cannot be called so."""
    texts = [print_kernel(program_of(scene)) for scene in SCENES]
    scene, wrt = picture()
    texts.append(print_arrays(teg.compile(scene, wrt, backend="numpy").program(1)))  # type: ignore[arg-type]
    names = {name for text in texts for name in re.findall(r"^(?:static|TEG_[A-Z]+) [^(=\[]*?\b(\w+)(?=[(\[])", text, re.MULTILINE)}
    own = {name for name in names if not name.startswith("teg_")}
    assert {"integral", "polygon", "crossed", "rest"} <= {name.split("_")[0] for name in own}
    assert not {name for name in own if ROUTINES.fullmatch(name) is None}


@pytest.mark.parametrize("name", ["f", "n", "w", "y2", "area", "ends2", "a" * 51, "Sin", "p0", "stress", "AREA", "area_t", "Area_T"])
def test_other_names_compile(name: str, tmp_path: Path) -> None:
    for suffix, text in zip("ch", standalone_c(program(1, (let("v0", "mul", "p0", 2.0),), "v0"), name), strict=True):
        (tmp_path / f"{name}.{suffix}").write_text(text)
    (tmp_path / "both.c").write_text(f'#include "{name}.h"\n#include "{name}.c"\n')
    _compile(tmp_path, *STRICT, "-c", "both.c")
    assert compile_c(TWO_VARIABLES[2].program)([np.array(1.0)], 1).shape == (2, 1)
