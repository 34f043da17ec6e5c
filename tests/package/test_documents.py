"""The documents and docstrings name files, modules and programs that are there."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import teg

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("teg", "backends", "examples", "tests", "docs")
SOURCES = sorted(p for folder in ("teg", "backends", "examples") for p in (ROOT / folder).rglob("*.py"))
FILES = {p.relative_to(ROOT).as_posix() for folder in FOLDERS for p in (ROOT / folder).rglob("*") if "__pycache__" not in p.parts}
FILES |= {f"{name}/" for name in FILES if (ROOT / name).is_dir()} | {f"{folder}/" for folder in FOLDERS}
PATH = re.compile(r"`([\w./<>-]+(?:\.py|\.h|/))`")
MODULE = re.compile(r"\bteg(?:\.[a-z_]\w*)+")
PACKAGES = {p.parent.relative_to(ROOT).as_posix().replace("/", ".") for p in SOURCES if p.name == "__init__.py"}


def is_there(path: str) -> bool:
    """Whether a path from the root, or the end of one, names a file or folder; one with a <placeholder> names its folder."""
    path = path[: path.rindex("/", 0, path.index("<")) + 1] if "<" in path else path
    return path in FILES or any(name.endswith("/" + path) for name in FILES)


@pytest.mark.parametrize("document", ["ARCHITECTURE.md", "CONTRIBUTING.md", "README.md"])
def test_every_path_in_a_document_exists(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    assert [path for path in PATH.findall(text) if not is_there(path)] == []
    links = [link for link in re.findall(r"\]\(([\w./-]+)\)", text) if not (ROOT / link).exists()]
    assert links == []


def test_links_of_the_changelog_lead_to_pages_from_the_root_and_in_the_site() -> None:
    links = re.findall(r"\]\(([\w./-]+)\)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert [link for link in links if not (link.startswith("docs/") and (ROOT / link).exists())] == []
    assert ":relative-docs: docs/" in (ROOT / "docs" / "changelog.md").read_text(encoding="utf-8")


def test_every_folder_has_its_paragraph() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    folders = {f"`{p.as_posix()}/`" for p in (s.parent.relative_to(ROOT) for s in SOURCES if s.parts[-3] in ("teg", "passes"))}
    assert [folder for folder in sorted(folders) if folder not in text and folder != "`teg/passes/`"] == []


def test_the_expression_that_is_followed_through_is_as_written() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    run = subprocess.run([sys.executable, "-c", program + "print(teg.diff(area, t)); print(f.explain())"], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    derivative, *explanation = run.stdout.splitlines()
    assert derivative == "∫[y: 0..1] (∫[x: 0..1] exp(x)·δ(t - (x + a·y)))"
    report = "\n".join(explanation)
    assert "affine in x, y" in report
    assert "adaptive" in report


def words(path: Path) -> str:
    """The docstrings and comments of a file, and other texts of their kind."""
    source = path.read_text(encoding="utf-8")
    texts = [n.value.value for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)]
    comments = re.findall(r"#.*", source)
    return "\n".join([*(t for t in texts if isinstance(t, str)), *comments])


def is_module_or_name(dotted: str) -> bool:
    """Whether `teg.a.b.c` is a module, or a name in one; a public name, for `teg.name`."""
    parts = dotted.replace("teg.backends", "backends", 1).replace("teg.examples", "examples", 1).split(".")
    depth = max(n for n in range(1, len(parts) + 1) if ".".join(parts[:n]) in PACKAGES)
    if depth == len(parts):
        return True
    folder, name = ROOT.joinpath(*parts[:depth]), parts[depth]
    known = teg.__all__ if parts[:depth] == ["teg"] else (folder / "__init__.py").read_text(encoding="utf-8")
    return (folder / f"{name}.py").exists() or name in known


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_docstrings_name_modules_that_exist(path: Path) -> None:
    text = words(path)
    assert [m for m in MODULE.findall(text) if not is_module_or_name(m)] == []
    assert [p for p in PATH.findall(text) if p.endswith(".py") and not is_there(p)] == []
    assert "DESIGN" not in text
