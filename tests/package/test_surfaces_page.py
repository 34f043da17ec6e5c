"""docs/surfaces.md: its pictures exist and are small, what is drawn is what the evaluators compute, and its table says what is measured."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import teg
from teg.program import Assign, Program

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "surfaces.md").read_text(encoding="utf-8")
PICTURES = re.findall(r"!\[[^]]+\]\(([^)]+)\)", PAGE)
ROWS = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in PAGE.splitlines() if line.startswith("| ")]
QUICK = ["half-plane", "triangle", "parabola", "bilinear", "disk", "stripes", "cubic"]


@pytest.fixture(scope="module", autouse=True)
def importable() -> Iterator[None]:
    """The modules of docs/, importable by the tests of this file only."""
    pytest.importorskip("mpmath")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DOCS))
        yield
        for name in ("surface_runs", "surface_families", "recorded_run"):
            sys.modules.pop(name, None)


@pytest.fixture
def family(importable: None, request: pytest.FixtureRequest) -> Any:
    """The surface whose name is the parameter."""
    from surface_families import FAMILIES, LINES

    return next(f for f in (*FAMILIES, *LINES) if f.name == request.param)


def test_every_family_has_its_picture() -> None:
    assert len(PICTURES) == 15
    assert {DOCS / p for p in PICTURES} == set((DOCS / "surfaces").glob("*.png"))


@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_are_small(picture: str) -> None:
    content = (DOCS / picture).read_bytes()
    assert content.startswith(b"\x89PNG")
    assert 1_000 < len(content) < 60_000


@pytest.mark.parametrize("family", QUICK, indirect=True)
def test_what_is_drawn_is_what_is_computed(family: Any) -> None:
    from surface_runs import TOL, value_run

    run = value_run(family)
    e, parameters = family.integral()
    assert run.outputs[0] == pytest.approx(teg.compile(e, parameters, tol=TOL)(family.values), rel=1e-12)
    assert run.outputs[0] == pytest.approx(float(family.exact_pair()[0]), rel=TOL)
    assert run.pieces or family.dimensions == 1


@pytest.mark.parametrize("family", ["triangle", "parabola", "disk"], indirect=True)
def test_points_of_the_derivative_are_on_the_surface(family: Any) -> None:
    from surface_families import Numbers
    from surface_runs import gradient_run

    marks = [m for m in gradient_run(family).marks if m.weight > 0]
    assert marks
    for m in marks:
        assert min(abs(g) for g in family.surfaces(Numbers, m.x, m.y, *family.values.values())) < 1e-12


def test_the_table_has_the_rows_that_the_command_prints() -> None:
    from surface_families import FAMILIES, LINES
    from surface_runs import GROUPS

    assert ROWS[0] == ["family", "error of the value", "of the derivative", "rule"]
    assert [row[0] for row in ROWS[1:]] == [label for label, _ in GROUPS]
    assert {name for _, names in GROUPS for name in names.split()} == {f.name for f in (*FAMILIES, *LINES)}


@pytest.mark.parametrize("family", QUICK, indirect=True)
def test_the_table_says_what_is_measured(family: Any) -> None:
    """Within a factor of ten and a few roundings, which other machines need."""
    from surface_runs import GROUPS, errors_of, rules_of

    label = next(label for label, names in GROUPS if family.name in names.split())
    _, value, slope, rule = next(row for row in ROWS if row[0] == label)
    measured = errors_of(family)
    assert measured[0] <= 10 * float(value) + 1e-15
    assert measured[1] <= 10 * float(slope) + 1e-15
    assert rules_of(family) in {rule, *(part.partition(": ")[2] for part in rule.split("; "))}


# -- what a recorded run does not know -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Unknown:
    """A statement that the language might get."""

    results: tuple[str, ...] = ("v0",)
    when: str | None = None


@dataclass(frozen=True)
class RoundedAssign(Assign):
    """A statement that says more than it did."""

    rounding: str = "nearest"


@pytest.mark.parametrize("statement", [Unknown(), Assign("v0", "conjugate", (1.0,)), RoundedAssign("v0", "neg", (1.0,), "up")], ids=str)
def test_it_is_refused(statement: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import recorded_run

    monkeypatch.setitem(recorded_run.KNOWN, RoundedAssign, recorded_run.KNOWN[Assign])
    as_before = Program((), (RoundedAssign("v0", "neg", (1.0,)),), ("v0",))
    assert recorded_run.RecordedRun(as_before, {}).outputs == [-1.0]
    with pytest.raises(NotImplementedError):
        recorded_run.RecordedRun(Program((), (statement,), ("v0",)), {})
