"""What passes say they decided: it is what they did, and what the tables of an explanation say."""

from __future__ import annotations

from typing import Any

import pytest

import teg
from teg.analysis.remarks import Remarks
from teg.analysis.settings import Integration
from teg.passes.differentiate.estimators.exact import Exact
from teg.pipeline import Elimination, compiled_outputs, flatten, program_for
from teg.program import Adaptive, Gauss, Integrate, Rational, statements

x, y = teg.vars("x y")
t, a = teg.params("t a")


def over(f: teg.Expr) -> teg.Expr:
    return teg.integral(f, (x, 0, 1), (y, 0, 1))


PROGRAMS = {
    "line": over(teg.bracket(x + a * y < t)),
    "line, no polynomial": over(teg.bracket(x + a * y < t) * teg.exp(x * y)),
    "bilinear": over(teg.bracket(x * y + a * x < t) * (1 + x)),
    "bilinear, no polynomial": over(teg.bracket(x * y + a * x < t) * teg.sin(x)),
    "disk": over(teg.bracket(x * x + a * y * y < t)),
    "pole": teg.integral(a / (x + t) ** 2, (x, 0, 1)),
    "one variable": teg.integral(teg.bracket(x * x < t) * teg.exp(a * x), (x, 0, 1)),
    "a given δ": over(teg.delta(x * x + y - t) * teg.bracket(x < a)),
}
OPTIONS: list[dict[str, Any]] = [{}, {"intrinsics": False}, {"rule": "gauss", "order": 5}, {"rule": "midpoint"}, {"rule": "qmc"}]
NAMES = {"clipped polygon": "polygon", "clipped interval": "polygon", "hyperbola, closed form": "hyperbola", "sum": "sum over roots"}
"""What tables call what remarks name otherwise."""


def told(report: Any, stage: str) -> dict[str, set[str]]:
    """The choices of a pass, by what they are about."""
    found: dict[str, set[str]] = {}
    for remark in report.data["remarks"]:
        if remark["pass"] == stage:
            found.setdefault(remark["about"], set()).add(remark["choice"])
    return found


@pytest.mark.parametrize("options", OPTIONS, ids=str)
@pytest.mark.parametrize("name", PROGRAMS)
def test_tables_say_what_the_passes_decided(name: str, options: dict[str, Any]) -> None:
    report = teg.compile(PROGRAMS[name], inaccurate="ignore", **options).explain(derivatives=1)
    rows = [row for key in ("integrals", "boundary", "interior") for row in report.data[key]]
    rules = {NAMES.get(row["rule"], "samples" if "points" in row["rule"] else row["rule"]) for row in rows}
    decided = {choice for choices in told(report, "lower").values() for choice in choices}
    assert decided <= rules
    assert decided
    families = told(report, "eliminate")
    for surface in report.data["surfaces"]:
        if surface["status"] == "eliminated":
            assert surface["family"] in families[surface["surface"]]


@pytest.mark.parametrize("name", PROGRAMS)
def test_rules_are_those_of_the_program(name: str) -> None:
    remarks = Remarks()
    program = program_for(flatten(teg.eliminate(PROGRAMS[name])), ["t", "a"], Integration(), remarks=remarks)
    rules = {type(s.rule) for s in statements(program.body) if isinstance(s, Integrate)}
    choices = {r.choice for r in remarks if r.stage == "lower"}
    known = {Gauss: "Gauss, exact", Rational: "Gauss with a pole, exact"}
    is_straight = not rules & {Gauss} or "closed form" in choices  # nodes without a loop, or one at which the mean is evaluated
    closed = {"Gauss, exact"} if is_straight else set()
    assert {known[rule] for rule in rules & known.keys()} - closed == (choices & set(known.values())) - closed
    assert (Adaptive in rules) is any(choice.startswith("adaptive") for choice in choices)
    reasons = {r.reason for r in remarks if r.choice == "Gauss, exact"}
    assert all(reason.startswith(("a polynomial of degree", "a polynomial in sines")) for reason in reasons)


def test_a_boundary_term_in_closed_form_is_told() -> None:
    for options, there in (({}, True), ({"intrinsics": False}, False), ({"rule": "midpoint"}, False)):
        report = teg.compile(PROGRAMS["bilinear"], inaccurate="ignore", **options).explain()  # type: ignore[arg-type]
        (choices,) = told(report, "eliminate").values()
        assert choices == ({"bilinear", "hyperbola"} if there else {"bilinear"})


def test_what_is_carried_along_is_told() -> None:
    remarks = Remarks()
    compiled_outputs(PROGRAMS["disk"], [t], 2, Exact(), Elimination(remarks=remarks))
    reasons = [r.reason for r in remarks if r.stage == "eliminate"]
    assert any("carried along" in reason for reason in reasons)
    assert any("first family" in reason for reason in reasons)


def test_remarks_are_made_once_and_in_order() -> None:
    remarks = Remarks()
    for choice in ("b", "a", "b"):
        remarks.add("eliminate", t, choice, "")
    assert [r.choice for r in remarks] == ["b", "a"]


def test_cells_of_a_program_with_arrays_have_remarks() -> None:
    k, corners = teg.index("k"), teg.array("V", 1)
    e = teg.sum(over(teg.bracket(x + corners[k] * y < t)), (k, 0, teg.length(corners, 0)))
    found = teg.compile(e, [corners, t]).explain().data["remarks"]
    assert {"polygon", "affine"} == {remark["choice"] for remark in found}
    assert all(remark["cell"] in range(2) for remark in found)
