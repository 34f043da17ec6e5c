"""The pages of the site: every block of code runs and prints what the page says, every public name has its place, and the site is built."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import teg

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md"))
MEASURED = ("jax.md",)
"""The page whose blocks another test runs."""
WITH_CODE = [page for page in PAGES if "```python" in (DOCS / page).read_text(encoding="utf-8") and page not in MEASURED]
OPTIONAL = {"jax", "torch", "scipy", "sympy", "optax", "blackjax", "diffrax"}
SPHINX = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--fresh-env", "--quiet"]


def imported(page: str) -> set[str]:
    """The optional packages that the blocks of a page import."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return OPTIONAL & set(re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE))


@pytest.fixture(scope="module", autouse=True)
def importable() -> Iterator[None]:
    """The modules of docs/, importable by the tests of this file only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS))
        yield
        for name in ("page_programs", "docstring_pages"):
            sys.modules.pop(name, None)


def assert_same(printed: str, promised: str) -> None:
    """Compares two outputs: text as it is, numbers to the tolerance of an integral."""
    from page_programs import NUMBER

    assert squeezed(NUMBER.sub("#", printed)) == squeezed(NUMBER.sub("#", promised))
    numbers = [np.array(list(map(float, NUMBER.findall(text)))) for text in (printed, promised)]
    np.testing.assert_allclose(*numbers, rtol=1e-9, atol=1e-11)


def squeezed(text: str) -> str:
    """Text without differences of spaces, as numbers of other lengths make them."""
    return " ".join(text.split())


slow = [pytest.param(page, marks=pytest.mark.slow) if imported(page) & {"jax", "torch"} else page for page in WITH_CODE]


@pytest.mark.parametrize("page", slow)
def test_the_code_of_a_page_prints_what_the_page_says(page: str) -> None:
    from page_programs import blocks_of, output_of

    from teg.pipeline import ESTIMATORS

    for package in imported(page):
        pytest.importorskip(package)
    names: dict[str, Any] = {"__name__": "__main__"}
    known = dict(ESTIMATORS)
    try:
        for block in blocks_of((DOCS / page).read_text(encoding="utf-8")):
            assert_same(output_of(block.code, names, page), block.output or "")
    finally:
        ESTIMATORS.clear()
        ESTIMATORS.update(known)


def test_outputs_are_written_anew_between_the_same_words() -> None:
    from page_programs import rewritten

    page = "Text.\n\n```python\nx = 1\n```\n\n```python\nprint(x + 1)\n```\n\n```text\nold\n```\n\nMore.\n"
    assert rewritten(page, "page") == page.replace("old", "2")


def test_an_error_and_a_warning_are_part_of_the_output() -> None:
    from page_programs import output_of

    said = output_of("import warnings\nprint('first')\nwarnings.warn('look')\nimport teg\nteg.sin('x')\nprint('never')", {})
    first, second, third, *_ = said.splitlines()
    assert (first, second) == ("first", "UserWarning: look")
    assert third.startswith("teg.errors.OperandError: str is not a number")


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_lead_somewhere(page: str) -> None:
    text = re.sub(r"^```.*?^```", "", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"`[^`\n]*`", "", text)
    targets = [t for t in re.findall(r"\]\(([^)#\s]+)", text) if not t.startswith("http")]
    assert [t for t in targets if not (DOCS / page).parent.joinpath(t).exists()] == []


# -- reference -----------------------------------------------------------------------------------------------------------


def test_every_public_name_has_a_docstring_and_a_place() -> None:
    pytest.importorskip("sphinx")
    from docstring_pages import SECTIONS, names_of

    listed = [name for section in [*SECTIONS, "errors"] for name in names_of(section)]
    assert sorted(listed) == sorted(set(teg.__all__) - {"errors", "maps", "ArrayEvaluator"})
    assert all(inspect.getdoc(getattr(teg, name)) for name in listed)
    pages = {
        re.findall(r"{public-names} (\w+)", p.read_text(encoding="utf-8"))[0]
        for p in DOCS.glob("reference/*.md")
        if "-names}" in p.read_text()
    }
    assert pages == set(SECTIONS)


@pytest.mark.parametrize(
    ("docstring", "markdown"),
    [
        ("Returns a*b of `a*b`.", r"Returns a\*b of `a*b`."),
        ("Returns x.\n\n    y = teg.sin(x)\n\nEnd.", "Returns x.\n\n```python\ny = teg.sin(x)\n```\n\nEnd."),
        ("Rules:\n\n    one   first `x`\n    two   second\n\nEnd.", "Rules:\n\n```text\none   first `x`\ntwo   second\n```\n\nEnd."),
    ],
)
def test_a_docstring_is_written_as_markdown(docstring: str, markdown: str) -> None:
    pytest.importorskip("sphinx")
    from docstring_pages import markdown_of

    assert markdown_of(docstring) == markdown


# -- gallery, versions, site ---------------------------------------------------------------------------------------------


def test_every_demonstration_is_in_the_gallery() -> None:
    from teg.__main__ import _parser

    (commands,) = (a.choices for a in _parser()._actions if isinstance(a.choices, dict))
    (demos,) = (a.choices for a in commands["demo"]._actions if isinstance(a.choices, dict))
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert [name for name in demos if f"teg demo {name}" not in text] == []


def test_the_version_is_the_same_everywhere() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    version, day = re.findall(r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[0]
    assert f'version = "{version}"' in project
    assert f"version: {version}\ndate-released: {day}" in citation
    assert teg.__version__ == version
    assert f"version = {{{version}}}" in (DOCS / "citing.md").read_text(encoding="utf-8")


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    for package in ("sphinx", "furo", "myst_nb", "ipykernel", "latex2mathml", "sphinx_copybutton", "matplotlib", "scipy", "jax"):
        pytest.importorskip(package)
    done = subprocess.run([*SPHINX, str(DOCS), str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "searchindex.js").stat().st_size > 10_000
    assert "<math" in (tmp_path / "notebooks" / "threshold.html").read_text(encoding="utf-8")
    page = (tmp_path / "errors.html").read_text(encoding="utf-8")
    assert all(name in page for name in vars(teg.errors) if name.endswith("Error"))
