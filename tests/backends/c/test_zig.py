"""The C compiler of the Python package ziglang, where the system has none: found, and the results are those of the system's compiler."""

from __future__ import annotations

import shutil
import sys
from importlib import util
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import teg
from teg.backends.c import build
from teg.backends.c.cache import clear

ZIG = pytest.mark.skipif(util.find_spec("ziglang") is None, reason="ziglang is not installed")
SYSTEM = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler of the system")


@pytest.fixture
def no_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A system without a C compiler, and an empty cache."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)


@pytest.fixture
def wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package ziglang whose compiler is an empty file."""
    program = tmp_path / "ziglang" / ("zig.exe" if sys.platform == "win32" else "zig")
    program.parent.mkdir()
    program.touch(mode=0o700)
    package = SimpleNamespace(submodule_search_locations=[str(program.parent)])
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: package if name == "ziglang" else None)
    return program


def test_the_compiler_of_the_wheel_is_found_without_another(no_compiler: None, wheel: Path) -> None:
    assert build.find_compiler() == (str(wheel), "cc")


def test_a_compiler_that_is_named_comes_first(no_compiler: None, wheel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", sys.executable)
    assert build.find_compiler() == (sys.executable,)


@SYSTEM
def test_a_compiler_of_the_system_comes_first(wheel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    assert Path(build.find_compiler()[0]).stem in ("cc", "gcc", "clang")


def test_flags_that_zig_does_not_know_are_left_out() -> None:
    flags = ("-O1", *build.LIGHT, build.NATIVE, build.OPENMP)
    assert build._flags_for(("/wheel/zig", "cc"), flags) == ("-O1", build.NATIVE, "-fno-sanitize=undefined")
    assert build._flags_for(("/usr/bin/gcc",), flags) == flags


@SYSTEM
def test_it_keeps_its_parts_beside_compiled_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It never ends where it cannot write to its usual folder. What the user chose comes first."""
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("ZIG_GLOBAL_CACHE_DIR", raising=False)
    folders, run = [], build.subprocess.run

    def watched(command: list[str], **options: Any) -> Any:
        folders.append((options.get("env") or {}).get("ZIG_GLOBAL_CACHE_DIR"))
        return run(command, **options)

    monkeypatch.setattr(build.subprocess, "run", watched)
    build._version.cache_clear()
    build.load_library("int one(void) { return 1; }")
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", "/elsewhere")
    build.load_library("int two(void) { return 2; }")
    assert set(folders) - {None} == {str(tmp_path / "cache" / "zig"), "/elsewhere"}
    (tmp_path / "cache" / "zig").mkdir()
    clear(tmp_path / "cache")
    assert not (tmp_path / "cache" / "zig").exists()


@ZIG
@SYSTEM
@pytest.mark.slow
def test_the_results_have_the_same_bits(request: pytest.FixtureRequest, as_users_compile: None) -> None:
    x, y = teg.vars("x y")
    t, a = teg.params("t a")
    V, k = teg.array("V"), teg.index("k")
    disk = teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(a * x), (x, -1, 1), (y, -1, 1))
    steps = teg.sum(teg.integral(teg.bracket(V[k] < x) * teg.exp(x * t), (x, 0, 1)), (k, 0, teg.length(V)))
    points = {"t": np.linspace(0.05, 0.9, 20), "a": 1.2}

    def results() -> list[np.ndarray]:
        f, g = teg.compile(disk, [t, a], backend="c", threads=2), teg.compile(steps, [V, t], backend="c")
        (value, slopes), (total, by_array) = f.value_and_grad(points), g.value_and_grad(V=np.linspace(0, 1, 9), t=0.3)
        return [value, slopes["t"], slopes["a"], np.asarray(total), by_array["V"]]

    expected = results()
    request.getfixturevalue("no_compiler")
    assert build.find_compiler() == build.zig_of_wheel()
    for one, other in zip(expected, results(), strict=True):
        np.testing.assert_array_equal(one, other)
