"""docs/jax.md: its code prints what it says, and its tables say what its script measures, but for times."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator
from importlib import util
from pathlib import Path
from typing import Any

import pytest

jax = pytest.importorskip("jax")
pytest.importorskip("mpmath")

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "jax.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
OPTIONAL = ("optax", "equinox", "flax")
NUMBER = re.compile(r"-?\d+\.\d+")


@pytest.fixture(scope="module", autouse=True)
def importable() -> Iterator[None]:
    """The modules of docs/, importable by the tests of this file only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS))
        yield
        for name in ("jax_methods", "compare_jax"):
            sys.modules.pop(name, None)


@pytest.fixture
def x64() -> Iterator[None]:
    """64 bits, and XLA's optimisations: whether a point of a grid is inside of a triangle depends on how sums are rounded."""
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", bool(os.environ.get("JAX_DISABLE_MOST_OPTIMIZATIONS")))
    jax.config.update("jax_enable_x64", before)


def table(name: str) -> list[list[str]]:
    """The cells of a table of the page, row by row, without the line below the heading."""
    text = PAGE[PAGE.index(f"<!-- begin {name} -->") : PAGE.index(f"<!-- end {name} -->")]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")]
    return [rows[0], *rows[2:]]


def agree(stated: str, measured: float) -> bool:
    """Within a factor of two, and of ten and a few roundings where an error is one of rounding."""
    from compare_jax import error_text

    if stated == "**is 0**":
        return error_text(measured) == stated
    number = 0.0 if stated == "exact" else float(stated)
    return measured <= 10 * number + 1e-14 if number < 1e-8 else number / 2 <= measured <= 2 * number


def test_the_page_is_short_and_its_links_lead_somewhere() -> None:
    assert len(PAGE.splitlines()) <= 165
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert target.startswith("http") or (DOCS / target).exists(), target


@pytest.mark.parametrize("needs", ["", *OPTIONAL])
def test_the_code_runs_and_prints_what_its_comments_say(needs: str) -> None:
    """The blocks that need nothing but JAX; or the first, which defines what the others use, and the one that needs a package."""
    if needs:
        pytest.importorskip(needs)
    packages = [next((k for k in OPTIONAL if re.search(rf"^(import|from) {k}", code, re.MULTILINE)), "") for code in BLOCKS]
    chosen = [code for code, package in zip(BLOCKS, packages, strict=True) if package == needs]
    assert chosen
    names: dict[str, Any] = {}
    for code in chosen if not needs else [BLOCKS[0], *chosen]:
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(code, "jax.md", "exec"), names)
        promised = [line.partition("  # ")[2] for line in code.splitlines() if line.startswith("print(")]
        found = out.getvalue().splitlines()
        assert [NUMBER.sub("#", line) for line in found] == [NUMBER.sub("#", line) for line in promised]
        assert list(map(float, NUMBER.findall(" ".join(found)))) == pytest.approx(
            list(map(float, NUMBER.findall(" ".join(promised)))), rel=1e-6
        )
    if "slopes" in names:
        assert max(float(abs(s).max()) for s in jax.tree.leaves(names["slopes"])) > 1e-4


def test_the_rows_are_those_that_the_script_writes() -> None:
    from compare_jax import METHODS, WIDTHS
    from jax_methods import PROBLEMS

    errors = table("errors")
    assert errors[0][1:] == [p.name for p in PROBLEMS]
    assert [row[0] for row in errors[1:]] == [row[0] for row in table("times")[1:]] == list(METHODS)
    assert [float(row[0]) for row in table("widths")[1:]] == list(WIDTHS)


@pytest.mark.parametrize("label", ["`jax.grad` of midpoints", "softened, width 0.01", "`teg.jax_function`"])
def test_the_errors_are_those_that_are_measured(label: str, x64: None) -> None:
    from compare_jax import METHODS, measure
    from jax_methods import PROBLEMS

    row = next(row for row in table("errors") if row[0] == label)
    for problem, cell in zip(PROBLEMS, row[1:], strict=True):
        compiled = 1 if problem.name == "a disk" and "teg" in label else 3  # its derivatives take XLA 15 s
        found = [m.error for m in measure(METHODS[label](problem), problem, compiled)]
        assert all(agree(stated, error) for stated, error in zip(cell.split(", "), found, strict=False)), (problem.name, cell, found)
    if label == "`teg.jax_function`":
        assert all(error == "exact" or float(error) < 1e-13 for cell in row[1:] for error in cell.split(", "))


def test_the_errors_of_widths_are_those_that_are_measured(x64: None) -> None:
    from compare_jax import measure, softened
    from jax_methods import PROBLEMS

    for row in table("widths")[1:3]:
        found = [m.error for m in measure(softened(PROBLEMS[-1], float(row[0])), PROBLEMS[-1])]
        assert all(map(agree, row[1:], found)), (row, found)


@pytest.mark.skipif(util.find_spec("quadax") is None, reason="quadax is not installed")
@pytest.mark.parametrize("label", ["quadax", "quadax, breaks marked", "quadax, one rule a piece"])
def test_the_errors_of_quadax_in_one_dimension_are_those_that_are_measured(label: str, x64: None) -> None:
    from compare_jax import METHODS, measure
    from jax_methods import PROBLEMS

    cell = next(row for row in table("errors") if row[0] == label)[1]
    found = [m.error for m in measure(METHODS[label](PROBLEMS[0]), PROBLEMS[0], orders=2)]
    assert all(map(agree, cell.split(", "), found)), (cell, found)


def test_the_script_writes_a_page_between_marks_only(tmp_path: Path) -> None:
    from compare_jax import main, markdown, write_page

    from teg.errors import InputError

    page = tmp_path / "page.md"
    page.write_text("before\n<!-- begin errors -->\nold\n<!-- end errors -->\nafter\n", encoding="utf-8")
    rows = [["", "a step"], ["method", "1e-2"]]
    write_page(page, {"errors": rows})
    assert page.read_text(encoding="utf-8") == f"before\n<!-- begin errors -->\n{markdown(rows)}<!-- end errors -->\nafter\n"
    with pytest.raises(InputError, match="no place for times"):
        write_page(page, {"times": rows})
    with pytest.raises(InputError, match="some are missing"):
        main(["--quick", "--page", str(page)])
