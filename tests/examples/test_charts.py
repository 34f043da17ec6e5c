"""The charts: reference values, the peers, verdicts, resuming, and that ours is never wrong in a difficult case."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.__main__ import main
from teg.errors import InputError, MissingPackageError

pytest.importorskip("scipy", minversion="1.15")
pytest.importorskip("vegas")
pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")
pytest.importorskip("mpmath")

import mpmath

from teg.examples.charts import decomposition, draw, measure, processes, run, tables, verdicts
from teg.examples.charts.case import Case, case
from teg.examples.charts.ours import compiled
from teg.examples.charts.peers import PEERS, best_step, differences, gradient_error, relative_error
from teg.examples.charts.problem import NUMPY, SCALAR, Integrand, Problem, TooManyEvaluationsError
from teg.examples.charts.references import Reference, case_reference, checked_region, read
from teg.examples.charts.regions import INSIDE, REGIONS
from teg.examples.charts.run import run_integration, run_stability
from teg.examples.charts.stability import CASES, GROUPS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "integration.md"
STABILITY = read("stability")
QUICK: dict[str, Any] = {"quick": True, "backend": "numpy", "progress": False}
UNSEEN = {"a Gaussian of width 10⁻³, cut", "a feature of size 2 in a domain of 10⁸", "a Lorentz peak of width 10⁻³"}
"""Cases whose integrand has a feature that a rule without a break there does not see."""
DECOMPOSED = (
    "a line through two corners",
    "a line on a side of the domain",
    "bounds that cross inside the outer domain",
    "bounds that cross, and a weight",
    "a triangle by its bounds, cut by a line",
    "a disk that touches a side from outside",
    "a disk that is born",
    "two lines that cross, xy > 0",
)
"""Cases in two variables for which a cylindrical decomposition takes seconds."""
MARKS = "\n".join(f"<!-- begin {n}: written by `teg chart {n}` -->\n<!-- end {n} -->\n" for n in ("integration", "stability"))


def ids(cases: Any) -> list[str]:
    return [c.name for c in cases]


# -- references --------------------------------------------------------------------------------------------------------


def test_there_are_sixty_cases_and_more_with_a_name_each() -> None:
    assert len(CASES) >= 60
    assert len({c.name for c in CASES}) == len(CASES) == len(STABILITY)
    assert set(read("regions")) == set(REGIONS) == set(INSIDE)
    assert len(REGIONS) == 10


@pytest.mark.parametrize("c", CASES, ids=ids(CASES))
def test_stored_answers_are_those_of_the_closed_forms(c: Case) -> None:
    value, gradient = case_reference(c)
    stored = STABILITY[c.name]
    assert stored.value == float(value)
    assert stored.gradient == {k: float(d) for k, d in gradient.items()}


@pytest.mark.parametrize("c", [c for c in CASES if c.problem.dimension == 1], ids=lambda c: c.name)
def test_closed_forms_in_one_variable_agree_with_quadrature_between_the_breaks(c: Case) -> None:
    check_by_decomposition(c)


@pytest.mark.slow
@pytest.mark.parametrize("c", [c for c in CASES if c.name in DECOMPOSED], ids=lambda c: c.name)
def test_closed_forms_in_two_variables_agree_with_cylindrical_decomposition(c: Case) -> None:
    check_by_decomposition(c)


def check_by_decomposition(c: Case) -> None:
    if c.name in UNSEEN:
        pytest.skip("needs a break where nothing jumps")
    with mpmath.workdps(30 if c.problem.dimension == 1 else 15):
        found = decomposition.integrate(c.problem, {k: mpmath.mpf(v) for k, v in c.problem.parameters.items()})
        exact = STABILITY[c.name].value
        assert abs(found - exact) <= 1e-9 * (abs(exact) or c.scale)


@pytest.mark.parametrize("name", ["half-plane", "hyperbola"])
def test_references_of_regions_are_computed_in_two_ways_that_agree(name: str) -> None:
    value, gradient = checked_region(name)
    stored = read("regions")[name]
    assert stored.value == float(value)
    assert stored.gradient == {k: float(d) for k, d in gradient.items()}


@pytest.mark.parametrize("name", REGIONS)
def test_references_of_regions_are_what_the_compiler_finds(name: str) -> None:
    problem, exact = REGIONS[name], read("regions")[name]
    value, gradient = compiled(problem, "auto", 1e-12, "numpy").value_and_grad(**problem.parameters)
    assert relative_error(value, exact.value) < 1e-10
    assert gradient_error(gradient, exact.gradient) < 1e-10


def test_multiple_roots_are_found_once_and_exactly() -> None:
    with mpmath.workdps(40):
        third = mpmath.mpf(1) / 3
        p = [-third, 1 + 2 * third, -2 - third, mpmath.mpf(1)]  # (x - 1/3)(x - 1)²
        found = decomposition.real_roots(p, mpmath.mpf(-2), mpmath.mpf(2), double=True)
        assert len(found) == 2
        assert max(abs(a - b) for a, b in zip(found, (third, 1), strict=True)) < mpmath.mpf(10) ** -35


# -- peers -------------------------------------------------------------------------------------------------------------


def smooth() -> Case:
    return case("smooth", lambda m, x, y, t: m.exp(x) * y * t, ((0.0, lambda m, y, t: y), (0.0, 1.0)), {"t": 2.0}, lambda m, t: t / 2)


@pytest.mark.parametrize(
    ("name", "setting", "accuracy"), [("midpoint", 200, 1e-4), ("dblquad", 1e-8, 1e-8), ("cubature", 1e-8, 1e-8), ("vegas", 2000, 1e-2)]
)
def test_peers_integrate_a_smooth_function(name: str, setting: float, accuracy: float) -> None:
    problem = smooth().problem
    found = PEERS[name](problem, problem.parameters, setting, math.inf)  # ∫₀¹ 2y(eʸ - 1) dy = 1
    assert found.value == pytest.approx(1, abs=accuracy)
    assert found.evaluations > 0
    assert found.warning == ""
    slopes, evaluations, _ = differences(PEERS[name], problem, setting, best_step(name, setting, accuracy))
    assert slopes["t"].value == pytest.approx(0.5, abs=10 * accuracy)
    assert evaluations >= 2 * found.evaluations * 0.8


def test_all_notations_give_the_same_integrand() -> None:
    for c in CASES:
        f = Integrand(c.problem, c.problem.parameters)
        points = np.random.default_rng(0).uniform(0.01, 0.99, (20, c.problem.dimension))
        plain = f.on_cube(points)
        for point, value in zip(points, plain, strict=True):
            place: list[float] = []
            weight = 1.0
            for i in reversed(range(c.problem.dimension)):
                lower, upper = (limit(*place) for limit in f.limits(i))
                place.insert(0, lower + (upper - lower) * point[i])
                weight *= upper - lower
            assert value == pytest.approx(f.scalar(*place) * weight, rel=1e-12, nan_ok=True), c.name
    assert SCALAR.sqrt(-1.0) != SCALAR.sqrt(-1.0)
    assert NUMPY.bracket(np.array([True, False])).tolist() == [1, 0]


def test_an_integrand_stops_at_its_limit() -> None:
    with pytest.raises(TooManyEvaluationsError):
        PEERS["dblquad"](REGIONS["disk"], REGIONS["disk"].parameters, 1e-8, 1000)


# -- verdicts ----------------------------------------------------------------------------------------------------------


JUDGED = [c for c in CASES if c.name != "a figure of eight at its crossing"]
"""Its gradient diverges logarithmically, and to find that takes NumPy two minutes: `make chart` judges it."""


@pytest.mark.parametrize("c", JUDGED, ids=ids(JUDGED))
def test_ours_is_never_wrong_and_never_crashes(c: Case) -> None:
    answers = verdicts.judge(c, STABILITY[c.name], "ours", "numpy")
    assert set(answers) == {"value", "gradient"}
    for answer in answers.values():
        assert answer["verdict"] not in ("wrong", "crashes"), answer
    assert answers["value"]["verdict"] in ("right", "imprecise"), answers["value"]


@pytest.mark.parametrize(
    ("got", "exact", "said", "expected"),
    [
        (1.0, 1.0, False, "right"),
        (1 + 1e-10, 1.0, False, "right"),
        (1 + 1e-8, 1.0, True, "imprecise"),
        (1.1, 1.0, False, "wrong"),
        (1.1, 1.0, True, "says it cannot"),
        (math.nan, 1.0, False, "wrong"),
        (math.inf, math.inf, False, "right"),
        (1e300, math.inf, False, "wrong"),
        (1e-12, 0.0, False, "right"),
    ],
)
def test_verdicts(got: float, exact: float, said: bool, expected: str) -> None:
    assert verdicts.verdict(relative_error(got, exact), said) == expected
    assert verdicts.verdict(gradient_error({"t": got}, {"t": exact}), said) == expected


def test_a_gradient_is_judged_by_its_worst_entry_and_largest_size() -> None:
    assert gradient_error({"a": 1.0, "b": 1e-6}, {"a": 1.0, "b": 0.0}) == 1e-6
    assert gradient_error({"a": 1.0, "b": math.inf}, {"a": 1.0, "b": math.inf}) == 0
    assert gradient_error({"a": 2.0, "b": math.inf}, {"a": 1.0, "b": math.inf}) == 1


def test_crashes_and_refusals_are_told_apart() -> None:
    def body(m: Any, x: Any, t: Any) -> Any:
        if m is NUMPY:
            raise ZeroDivisionError("of the peer")
        return m.bracket(x < t)

    broken = Case("broken", Problem(body, ((0.0, 1.0),), {"t": 0.5}), lambda m, t: t)
    exact = Reference("0.5", {"t": "1"})
    assert verdicts.judge(broken, exact, "midpoint", "numpy")["value"]["verdict"] == "crashes"
    assert {a["verdict"] for a in verdicts.judge(broken, exact, "ours", "numpy").values()} == {"right"}
    refused = Case("refused", Problem(lambda m, x, t: m.bracket(x < t), ((0.0, math.nan),), {"t": 0.5}), lambda m, t: t)
    assert {a["verdict"] for a in verdicts.judge(refused, exact, "ours", "numpy").values()} == {"says it cannot"}


def test_plain_automatic_differentiation_loses_the_jump() -> None:
    c = next(c for c in CASES if c.name == "the same bracket twice")
    assert verdicts.judge(c, STABILITY[c.name], verdicts.PLAIN, "numpy")["gradient"]["verdict"] == "wrong"


# -- runs --------------------------------------------------------------------------------------------------------------


@pytest.fixture
def one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes.os, "cpu_count", lambda: 1)


@pytest.mark.slow
def test_a_quick_chart_and_what_a_second_run_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_process: None) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{MARKS}after\n", encoding="utf-8")
    report = run_integration(tmp_path, page, **QUICK)
    assert not report["interrupted"]
    found = list(report["points"].values())
    assert {p["region"] for p in found} == set(run.QUICK_REGIONS)
    assert {p["method"] for p in found} == set(measure.SERIES)
    for p in found:
        if p["method"] == "auto" and p["setting"] == 1e-10:
            assert p["error"] < 1e-9
    assert len(report["pictures"]) == 5
    for picture in report["pictures"]:
        assert Path(picture).stat().st_size > 10_000
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "| disk |" in text

    def never(*_: Any) -> Iterator[measure.Point]:
        raise AssertionError("measured again")

    with monkeypatch.context() as patch:
        patch.setattr(measure, "measure", never)
        again = run_integration(tmp_path, page, **QUICK)
        assert again["points"] == json.loads((tmp_path / "integration.json").read_text(encoding="utf-8"))["points"] == report["points"]
        assert page.read_text(encoding="utf-8") == text
        with pytest.raises(AssertionError, match="measured again"):
            run_integration(tmp_path, page, fresh=True, **QUICK)


def test_an_interrupted_chart_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_process: None) -> None:
    real, calls = measure.measure, []
    monkeypatch.setattr(draw, "draw_all", lambda *_: [])

    def interrupted(task: measure.Task, *rest: Any) -> Iterator[measure.Point]:
        calls.append(task)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(task, *rest)

    monkeypatch.setattr(
        measure,
        "tasks",
        lambda quick: [measure.Task("disk", "value", m, (4e-1 if m == "auto" else 4,)) for m in ("auto", "gauss", "midpoint", "vegas")],
    )
    with monkeypatch.context() as patch:
        patch.setattr(measure, "measure", interrupted)
        first = run_integration(tmp_path, **QUICK)
    assert first["interrupted"]
    assert [p["method"] for p in first["points"].values()] == ["auto", "gauss"]
    second = run_integration(tmp_path, **QUICK)
    assert not second["interrupted"]
    assert [p["method"] for p in second["points"].values()] == ["auto", "gauss", "midpoint", "vegas"]
    assert {k: second["points"][k] for k in first["points"]} == first["points"]


def test_a_quick_stability_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_process: None, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text(MARKS, encoding="utf-8")
    command = ["chart", "stability", "-o", str(tmp_path), "--page", str(page), "--quick", "--quiet", "--backend", "numpy"]
    assert main(command) == 0
    assert "ours, value: 3 right" in capsys.readouterr().out
    report = json.loads((tmp_path / "stability.json").read_text(encoding="utf-8"))
    for method, quantities in verdicts.COLUMNS.items():
        for q in quantities:
            assert sum(report["counts"][method][q].values()) == run.QUICK_CASES
    assert f"| {CASES[0].name} | ✓ | ✓ |" in page.read_text(encoding="utf-8")
    monkeypatch.setattr(verdicts, "judge", lambda *_: pytest.fail("judged again"))
    assert main(command) == 0


def test_mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "page.md"
    page.write_text("no marks", encoding="utf-8")
    with pytest.raises(InputError, match="has no place"):
        tables.write_page(page, tables.read_page(page), "stability", "")
    with pytest.raises(InputError, match="cannot read the page"):
        run_stability(tmp_path, tmp_path / "missing.md", **QUICK)
    (tmp_path / "stability.json").write_text("[]", encoding="utf-8")
    with pytest.raises(InputError, match="not a report"):
        run_stability(tmp_path, **QUICK)
    monkeypatch.setattr("teg.examples.harness.util.find_spec", lambda name: None if name == "vegas" else name)
    with pytest.raises(MissingPackageError, match="vegas") as raised:
        run_integration(tmp_path, **QUICK)
    assert "teg-compiler[chart]" in raised.value.hint


def test_without_a_name_the_charts_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chart"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == [
        "integration",
        "stability",
        "estimators",
        "descents",
        "lean",
    ]


def test_the_page_shows_what_was_measured() -> None:
    text = PAGE.read_text(encoding="utf-8")
    answers = json.loads((PAGE.with_suffix("") / "stability.json").read_text(encoding="utf-8"))["answers"]
    assert set(answers) == {c.name for group in GROUPS.values() for c in group}
    assert tables.stability_tables(answers) in text
    for answer in (a for c in answers.values() for a in c["ours"].values()):
        assert answer["verdict"] not in ("wrong", "crashes")
    points = json.loads((PAGE.with_suffix("") / "integration.json").read_text(encoding="utf-8"))["points"]
    assert {p["region"] for p in points.values()} == set(REGIONS)
    assert tables.integration_table([run._point(p) for p in points.values()]) in text
    for picture in ("summary", *(f"{q}-{a}" for q in measure.QUANTITIES for a in ("time", "evaluations"))):
        assert f"integration/{picture}.png" in text
        assert (PAGE.with_suffix("") / f"{picture}.png").is_file()
