"""Programs with arrays as C files for use without Python: they compile without a warning, and compute what the evaluator does."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg
from teg.__main__ import main
from teg.backends.c.standalone import standalone_c
from teg.errors import OptionError
from tests.backends.c_checks import _compile, in_c

pytestmark = in_c
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
SOURCE = """
import teg
V, F = teg.array("scene_V", 2), teg.indices("scene_F", 2)  # names of their own: their order is that of their first creation
k, j = teg.index("k"), teg.index("j")
x, (t, n) = teg.var("x"), teg.params("t n")
length = teg.sum(
    teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.exp(-t * x * V[F[k, 1], 1]), (x, 0, 1)), (k, 0, teg.length(F, 0))
)
pairs = teg.sum(teg.sqrt(1 + (V[k, 0] - V[j, 1]) ** 2) * t, (j, 0, k + 1), (k, 0, n))
e = teg.tuple(length, pairs)
square = teg.integral(teg.sum(teg.bracket(x < V[k, 0]), (k, 0, teg.length(V, 0))) ** 2, (x, 0, 1))
"""
VERTICES = np.array([[0.25, 0.5], [0.75, 1.5], [0.75, -0.5], [0.125, 0.25]])
FACES = np.array([[0, 1], [1, 2], [3, 0]])


def numbers(values: Any) -> str:
    return "{" + ", ".join(repr(v) for v in np.ravel(values).tolist()) + "}"


def run_main(folder: Path, name: str, sizes: list[int], flags: tuple[str, ...] = ("-O2",)) -> list[np.ndarray]:
    """The outputs of a batch of two, of so many numbers each, from a main program that knows nothing but the header; t and V differ."""
    big, total = name.upper(), 2 * sum(sizes)
    places = ", ".join(f"results + {2 * sum(sizes[:j])}" for j in range(len(sizes)))
    (folder / "main.c").write_text(f"""
#include <stdio.h>
#include "{name}.h"
int main(void)
{{
    const double t[2] = {{0.5, 2.0}}, n[1] = {{4.0}};
    const double vertices[16] = {numbers([VERTICES, VERTICES[::-1]])};
    const int64_t faces[6] = {numbers(FACES)}, of_vertices[2] = {{4, 2}}, of_faces[2] = {{3, 2}};
    const double *p[{big}_INPUTS + 1] = {{t, n}};
    const long stride[{big}_INPUTS + 1] = {{1, 0}};
    const teg_array a[{big}_ARRAYS] = {{{{vertices, 8, of_vertices}}, {{faces, 0, of_faces}}}};
    double results[{total}], *out[{big}_OUTPUTS] = {{{places}}};
    long notes[2] = {{9, 9}};
    if ({name}(2, p, stride, a, out, notes, 2)) return 1;
    for (int i = 0; i < {total}; i++) printf("%.17g\\n", results[i]);
    printf("%ld\\n%ld\\n", notes[0], notes[1]);
    return 0;
}}
""")
    _compile(folder, *STRICT, *flags, "main.c", f"{name}.c", "-o", "main", "-lm")
    printed = subprocess.run([str(folder / "main")], check=True, capture_output=True, text=True).stdout.split()
    found = [float(word) for word in printed]
    assert found[total:] == [0.0, 0.0]
    parts = np.split(np.array(found[:total]), np.cumsum([2 * s for s in sizes])[:-1])
    return [part.reshape(2, s) for part, s in zip(parts, sizes, strict=True)]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "scene.py"
    path.write_text(SOURCE)
    return path


def evaluated(source: Path) -> tuple[Any, dict[str, Any]]:
    """An evaluator of the program of the file, and the arguments of the C program."""
    space: dict[str, Any] = {}
    exec(SOURCE, space)
    f = teg.compile(space["e"], backend="numpy")
    return f, {"scene_V": np.stack([VERTICES, VERTICES[::-1]]), "scene_F": FACES, "t": [0.5, 2.0], "n": 4}


@pytest.mark.parametrize("flags", [("-O2",), ("-O1", "-fopenmp"), ("-O1", "-fsanitize=undefined,address")])
def test_value_and_gradient(source: Path, tmp_path: Path, flags: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", str(source), "--target", "c", "-o", str(tmp_path / "scene.c")]) == 0
    head, names = re.search(r"(value and gradient of scene)\((.*)\)", capsys.readouterr().out).groups()  # type: ignore[union-attr]
    assert (head, sorted(names.split(", "))) == ("value and gradient of scene", ["n", "scene_F", "scene_V", "t"])
    f, given = evaluated(source)
    value, slopes = f.value_and_grad(given)
    wanted = dict(zip(f.output_names(1), [*value, *(slopes[p.name][i] for i in range(2) for p in f.wrt)], strict=True))
    order = re.findall(r"out\[\d\]  ([^,\n]*)", (tmp_path / "scene.h").read_text())
    assert sorted(order) == sorted(wanted)
    found = run_main(tmp_path, "scene", [np.size(wanted[name]) // 2 for name in order], flags)
    for name, a in zip(order, found, strict=True):
        np.testing.assert_allclose(a, np.reshape(wanted[name], a.shape), rtol=1e-13, atol=1e-14, err_msg=name)


def test_the_header_names_arrays_and_outputs(source: Path, tmp_path: Path) -> None:
    main(["compile", str(source), "--derivatives", "1", "-o", str(tmp_path / "scene.c")])
    header = (tmp_path / "scene.h").read_text()
    for text in ("V, 2 dimensions of double", "F, 2 dimensions of int64_t", "n, a whole number", "out[1]  value[1]",
                 "d value[0] / d scene_V, an array of the shape of a[0]", "#define SCENE_ARRAYS 2", "NOT checked"):  # fmt: skip
        assert text in header
    assert max(map(len, header.splitlines())) <= 140
    if shutil.which("g++"):
        (tmp_path / "use.cpp").write_text('#include "scene.h"\nint main() { return SCENE_OUTPUTS != 6; }\n')
        subprocess.run(["g++", "-Wall", "-Wextra", "-Werror", "use.cpp", "-c"], cwd=tmp_path, check=True)


def test_the_second_order_is_the_product_with_a_direction(source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", str(source), "--derivatives", "2", "-o", str(tmp_path / "scene.c")]) == 0
    assert "Hessian times a direction" in capsys.readouterr().out
    header = (tmp_path / "scene.h").read_text()
    assert "d2 value[1] / d scene_V d direction, an array of the shape of a[0]" in header
    f, given = evaluated(source)
    program = f.program(2)
    directions = {"t": 0.5, "scene_V": np.cos(np.arange(8.0)).reshape(4, 2)}
    from teg.backends.c.loops import compile_c_arrays

    numbers_given = {"t": np.array([0.5, 2.0]), "n": np.array(4.0), "∂t": np.array(0.5)}
    arrays = {"scene_V": given["scene_V"], "scene_F": FACES, "∂scene_V": directions["scene_V"]}
    columns = [numbers_given[name] for name in program.parameters]
    found = compile_c_arrays(program).results(columns, [arrays[a.name] for a in program.arrays], 2).values
    product = f.hvp(given, directions)
    for name, values in zip(f.output_names(2), found, strict=True):
        if name.startswith("d2"):
            i, by = int(name[name.index("[") + 1]), name.split(" / d ")[1].split()[0]
            np.testing.assert_allclose(values, product[by][i], rtol=1e-12, atol=1e-13, err_msg=name)


def test_what_cannot_be_written(source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "scene.c")
    assert main(["compile", f"{source}:square", "-o", out]) == 2
    assert "lengths of its arrays" in capsys.readouterr().err
    assert main(["compile", str(source), "--dtype", "float32", "-o", out]) == 2
    assert "arrays of double only" in capsys.readouterr().err
    f, _ = evaluated(source)
    for name in ("element", "int", "teg_array", "2nd"):
        with pytest.raises(OptionError, match="name of a C function"):
            standalone_c(f.program(0), name)


def test_explain_on_the_command_line(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(source)]) == 0
    text = capsys.readouterr().out
    assert "surfaces that move in Σ k: 0 .. length(scene_F, 0)" in text
    assert "scene_V[scene_F[k, 0], 0] - x = 0" in text
    assert "loops of the program of value and gradient" in text
    assert main(["explain", str(source), "--json"]) == 0
    assert '"index": "k"' in capsys.readouterr().out
