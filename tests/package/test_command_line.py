"""The command line: what it prints, its exit codes, that mistakes come without a traceback."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import teg
from teg.__main__ import load_expression, main
from teg.errors import InputError

PROGRAM = """
import teg
x, y = teg.vars("x y")
t = teg.param("t")
e = teg.integral(teg.bracket(x + y < t), (x, 0, 1), (y, 0, 1))
twice = 2 * e
number = 3
"""


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "half_plane.py"
    path.write_text(PROGRAM)
    return path


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"teg {teg.__version__}\n"


def test_explain(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(program)]) == 0
    assert "affine" in capsys.readouterr().out
    assert main(["explain", f"{program}:twice"]) == 0


def test_explain_as_json(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", str(program), "--json", "--derivatives", "1", "--tol", "1e-6"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [s["family"] for s in data["surfaces"]] == ["affine"]
    assert data["options"]["tol"] == 1e-6


def test_what_the_file_prints_is_not_in_the_json(program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program.write_text(program.read_text() + "\nprint('loading the scene')\n")
    assert main(["explain", str(program), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["expression"]
    assert "loading the scene" in err
    assert main(["explain", str(program)]) == 0
    assert "loading the scene" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "command", "message"),
    [
        (["explain", "--bogus", "x.py"], "teg explain", "unknown arguments: --bogus"),
        (["demo", "perlin", "--bakend", "c"], "teg demo perlin", "is it --backend?"),
        (["cache", "info", "--verbose"], "teg cache info", "unknown arguments: --verbose"),
        (["--bogus", "cache", "info"], "teg", "unknown arguments: --bogus"),
    ],
)
def test_unknown_arguments_are_refused_by_their_command_in_one_line(
    arguments: list[str], command: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(f"{command}: error: ")
    assert error.count("\n") == 1
    assert message in error


def test_compile(program: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "area.c"
    assert main(["compile", str(program), "--target", "c", "-o", str(out)]) == 0
    assert "area(t)" in capsys.readouterr().out
    assert re.search(r"\bint area\(", out.read_text())
    assert re.search(r"\bint area\(", out.with_suffix(".h").read_text())


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_what_compile_writes_runs_without_python(program: Path, tmp_path: Path) -> None:
    assert main(["compile", str(program), "-o", str(tmp_path / "area.c")]) == 0
    caller = tmp_path / "caller.c"
    caller.write_text(
        '#include <stdio.h>\n#include "area.h"\n'
        "int main(void) { double t = 0.5, found[2], *out[] = {found, found + 1}; const double *p[] = {&t}; long stride[] = {0};\n"
        'int bad = area(1, p, stride, NULL, out, NULL, 1); printf("%g %g", found[0], found[1]); return bad; }\n'
    )
    binary = tmp_path / "caller"
    subprocess.run(["cc", "-std=c99", "area.c", "caller.c", "-o", str(binary), "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([binary], capture_output=True, check=True, text=True).stdout == "0.125 0.5"


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("nothing.py", "no file"),
        ("half_plane.py:other", "does not define 'other'"),
        ("half_plane.py:number", "is not an expression but of type int"),
        ("half_plane.py:t", ""),
        ("syntax.py", "line 2"),
        ("fails.py", "ZeroDivisionError"),
        ("misuse.py", "hint"),
    ],
)
def test_mistakes_are_told_without_a_traceback(
    place: str, message: str, program: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(program.parent)
    Path("syntax.py").write_text("x = 1\ny = = 2\n")
    Path("fails.py").write_text("1 / 0\n")
    Path("misuse.py").write_text("import teg\nx = teg.var('x')\nif x < 1:\n    e = x\n")
    code = main(["explain", place])
    error = capsys.readouterr().err
    if not message:
        assert code == 0
        return
    assert code == 2
    assert error.startswith("teg: error: ")
    assert message in error
    assert "Traceback" not in error


def test_a_missing_name_lists_those_there_are(program: Path) -> None:
    with pytest.raises(InputError) as error:
        load_expression(f"{program}:other")
    assert "it defines e, twice:" in error.value.hint


def test_a_file_may_import_its_neighbour(program: Path) -> None:
    path = program.with_name("user.py")
    path.write_text("from half_plane import e as first\ne = first + 1\n")
    before = list(sys.path)
    assert load_expression(str(path)) is not None
    assert sys.path == before
    del sys.modules["half_plane"]


@pytest.mark.parametrize("out", ["area.cpp", "no folder/area.c", "2 areas.c"])
def test_an_output_that_cannot_be_written(out: str, program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", str(program), "-o", str(program.parent / out)]) == 2
    assert capsys.readouterr().err.startswith("teg: error: ")


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = pytest.importorskip("PIL.Image")
    pytest.importorskip("matplotlib")
    image.new("RGB", (20, 20), "teal").save(tmp_path / "photo.png")
    small = ["--triangles", "6", "--size", "16", "--steps", "2", "--backend", "numpy", "--quiet", "-o", str(tmp_path / "out")]
    assert main(["demo", "triangulation", str(tmp_path / "photo.png"), *small]) == 0
    assert "after.png" in capsys.readouterr().out
    assert main(["demo", "triangulation", str(tmp_path / "none.png"), *small]) == 2
    assert "none.png" in capsys.readouterr().err


def test_importing_loads_no_optional_package() -> None:
    heavy = ["matplotlib", "skimage", "PIL", "scipy", "jax", "sympy", "tqdm"]
    check = f"import sys, teg.__main__; print([m for m in {heavy} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_help_of_a_demo_names_its_own_treatments_of_discontinuities(capsys: pytest.CaptureFixture[str]) -> None:
    for demo, has_smooth in {"triangulation": True, "billiards": False}.items():
        with pytest.raises(SystemExit):
            main(["demo", demo, "--help"])
        assert ("softened" in capsys.readouterr().out) is has_smooth


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
def test_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from teg.backends.c.build import load_library

    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("TEG_CACHE_SIZE", "20")
    load_library("int f(void) { return 1; }")
    assert main(["cache", "info"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"{tmp_path}: 1 compiled file, 0.0 MB of at most 20 MB")
    assert main(["cache", "clear"]) == 0
    assert capsys.readouterr().out.startswith(f"{tmp_path}: removed 1 compiled file")
    assert not list(tmp_path.iterdir())
    file = tmp_path / "a file"
    file.touch()
    monkeypatch.setenv("TEG_CACHE_DIR", str(file / "below"))
    assert main(["cache", "info"]) == 0
    assert "cannot be used" in capsys.readouterr().err
    monkeypatch.setenv("TEG_CACHE_SIZE", "large")
    assert main(["cache", "info"]) == 2
    assert "TEG_CACHE_SIZE" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_an_output_on_a_full_disk_is_told_without_a_traceback() -> None:
    with Path("/dev/full").open("w") as full:
        run = subprocess.run([sys.executable, "-m", "teg", "chart"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert run.returncode == 2
    assert run.stderr == "teg: error: cannot write the output: No space left on device\n"


def test_an_integral_that_does_not_converge(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "endless.py"
    path.write_text("import teg\nx = teg.var('x')\nteg.evaluate(teg.integral(1 / x**2, (x, 0, 1)), {}, inaccurate='raise')\n")
    assert main(["explain", str(path)]) == 3
    assert "error" in capsys.readouterr().err
