"""The headers of the C runtime: units that are printed only where they are needed."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from teg.backends.c.build import find_compiler
from teg.backends.c.runtime import LIMITS, read_headers, runtime
from teg.backends.c.text import identifiers

UNITS = read_headers()[1]


def without_comments(text: str) -> str:
    code = ""
    while text:
        before, _, text = text.partition("/*")
        code += before
        text = text.partition("*/")[2]
    return code


def test_a_unit_defines_its_name_and_needs_earlier_ones_only() -> None:
    known: set[str] = set()
    names = {name for name, _ in UNITS}
    assert len(names) == len(UNITS)
    for name, text in UNITS:
        used = identifiers(without_comments(text)) & names
        assert name in used
        assert used - {name} <= known, name
        known.add(name)


def test_only_what_is_needed_is_printed() -> None:
    always, defines, *parts = runtime(["x = teg_clamp(x, 0.0, TEG_POLE);"])
    assert "#include <math.h>" in always
    assert defines == f"#define TEG_POLE {LIMITS['TEG_POLE']!r}"
    assert [part.partition("static")[2].split("(")[0].split()[-1] for part in parts] == ["teg_clamp"]
    assert runtime(["int teg_clamped;"]) == [always]


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
def test_everything_compiles_together(tmp_path: Path) -> None:
    text = "\n\n".join(runtime([name for name, _ in UNITS]))
    (tmp_path / "all.c").write_text(text + "\n", encoding="ascii")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-fsyntax-only"]
    subprocess.run([*find_compiler(), *flags, "all.c"], cwd=tmp_path, check=True)
