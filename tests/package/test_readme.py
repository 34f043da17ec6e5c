"""The README's example does what the README says."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

README = Path(__file__).parents[2] / "README.md"


EXAMPLES = re.findall(r"```python\n((?:(?!```).)*)```\s+```\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize(("code", "printed"), EXAMPLES)
def test_the_examples_print_what_it_says(code: str, printed: str) -> None:
    for package in re.findall(r"^import (jax|torch)$", code, re.MULTILINE):
        pytest.importorskip(package)
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, "README.md", "exec"), {})
    number = r"-?\d+\.\d+"
    assert re.sub(number, "#", out.getvalue()) == re.sub(number, "#", printed)
    for found, promised in zip(re.findall(number, out.getvalue()), re.findall(number, printed), strict=True):
        assert float(found) == pytest.approx(float(promised), rel=1e-13)


def test_every_program_says_what_it_prints_and_stands_alone() -> None:
    assert len(EXAMPLES) == README.read_text(encoding="utf-8").count("```python")
    assert all("import teg" in code for code, _ in EXAMPLES)


def test_pictures_and_pages_exist() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README.read_text(encoding="utf-8")):
        assert target.startswith("http") or (README.parent / target).exists(), target
