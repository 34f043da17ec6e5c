"""The chart of estimators and the stability report: references, scores, resuming, and what the page shows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("mpmath")
pytest.importorskip("matplotlib")

from teg.__main__ import main
from teg.errors import InputError
from teg.examples.charts import estimators, run_descents, run_estimators, run_report, stability_report, tables
from teg.examples.charts.estimators import SWEEPS, Point, Task, compiled, middle_and_worst, relative_error
from teg.examples.charts.families_of_cases import FAMILIES
from teg.examples.charts.scenes import SCENES, gradient_of
from teg.examples.charts.stability_report import CLASSES, COLUMNS, judge, score_of

PAGE = Path(__file__).resolve().parents[2] / "docs" / "estimators.md"
MARKS = """<!-- begin estimators: written by `teg chart estimators` -->
<!-- end estimators -->
<!-- begin report: written by `teg report stability` -->
<!-- end report -->
"""


@pytest.mark.parametrize("scene", SCENES)
def test_the_exact_gradient_of_a_scene_is_that_of_its_closed_form(scene: str) -> None:
    f = compiled(Task(scene, "exact", ()), 1e-12, "numpy")
    assert relative_error(f.grad(**SCENES[scene].parameters), gradient_of(scene)) < 1e-10


@pytest.mark.parametrize("method", SWEEPS)
def test_each_sweep_is_an_estimator_of_the_gradient(method: str) -> None:
    exact = gradient_of("half-plane")
    setting = SWEEPS[method].settings[1 if method not in ("ignore", "smooth-grid", "edge-tree") else 0]
    (point,) = estimators.measure(Task("half-plane", method, (setting,)), exact, "numpy")
    assert point.error < {"exact": 1e-6, "edge-qmc": 1e-3, "ignore": 1.1, "warp-4": 0.5}.get(method, 0.2)
    assert (point.evaluations > 0) == (method != "ignore" or point.evaluations > 0)
    assert point.seconds > 0


def test_medians_are_of_settings_that_every_scene_has() -> None:
    points = [Point(s, "warp", n, e, 1.0, 10) for s, n, e in [("a", 1, 0.5), ("b", 1, 0.1), ("c", 1, 0.2), ("a", 2, 0.1)]]
    ((middle, worst),) = middle_and_worst(points, "warp")
    assert middle.error == pytest.approx(0.2)
    assert (worst.scene, worst.error) == ("a", 0.5)


@pytest.mark.slow
def test_a_quick_chart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    page.write_text(MARKS, encoding="utf-8")
    command = ["chart", "estimators", "-o", str(tmp_path), "--page", str(page), "--quick", "--quiet", "--backend", "numpy"]
    assert main(command) == 0
    stored = json.loads((tmp_path / "estimators.json").read_text(encoding="utf-8"))
    assert {p["method"] for p in stored["points"]} == set(SWEEPS)
    assert (tmp_path / "summary.png").is_file()
    assert (tmp_path / "scenes.png").is_file()
    assert "| smallest error | half-plane | disk |" in page.read_text(encoding="utf-8")
    assert main(command) == 0
    assert json.loads((tmp_path / "estimators.json").read_text(encoding="utf-8"))["points"] == stored["points"]  # nothing is measured again
    assert "points" in capsys.readouterr().out


# -- the report --------------------------------------------------------------------------------------------------------


def test_there_are_250_cases_with_different_names() -> None:
    names = [c.name for group in CLASSES.values() for c in group]
    assert len(names) == len(set(names)) >= 250


@pytest.mark.parametrize(
    ("error", "admitted", "score"), [(1e-10, False, "right"), (1e-3, False, "imprecise"), (1.0, True, "said in the call")]
)
def test_scores(error: float, admitted: bool, score: str) -> None:
    assert score_of(error, admitted) == score
    assert score_of(1.0, False) == "silently wrong"


@pytest.mark.parametrize("family", FAMILIES)
def test_the_exact_gradient_of_each_family_is_right_or_says_so(family: str) -> None:
    for case in (FAMILIES[family][0], FAMILIES[family][-1]):
        answer = judge(case, "numpy", ["exact"])["exact"]
        assert answer["score"] in ("right", "imprecise", "said in the call"), (case.name, answer)


def test_plain_differentiation_is_silently_wrong_where_the_boundary_moves() -> None:
    answers = judge(FAMILIES["non-linear uses"][0], "numpy", ["ignore", "edge-mc"])
    assert answers["ignore"]["score"] == "silently wrong"
    assert answers["edge-mc"]["score"] == "right"  # a point is no sample


def test_one_case_again(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "stability", "--case", "[x < t]³", "--backend", "numpy"]) == 0
    text = capsys.readouterr().out
    assert all(method in text for method in COLUMNS if stability_report.can_be_asked(method, stability_report.cases()["[x < t]³"][1]))
    with pytest.raises(InputError) as raised:
        run_report.run_case("a disk that")
    assert "a disk that is born" in raised.value.hint


# -- the page ----------------------------------------------------------------------------------------------------------


def test_the_page_shows_what_was_measured() -> None:
    text = PAGE.read_text(encoding="utf-8")
    answers = json.loads((PAGE.with_suffix("") / "report.json").read_text(encoding="utf-8"))["answers"]
    assert set(answers) == set(stability_report.cases())
    assert run_report.report_tables(answers) in text
    assert not {a["exact"]["score"] for a in answers.values()} & {"said by diagnose", "silently wrong", "crash"}
    points = json.loads((PAGE.with_suffix("") / "estimators.json").read_text(encoding="utf-8"))["points"]
    assert {p["scene"] for p in points} == set(SCENES)
    assert run_estimators.estimator_tables([run_estimators.point_of(p) for p in points]) in text
    descents = json.loads((PAGE.with_suffix("") / "descents.json").read_text(encoding="utf-8"))["descents"]
    assert run_descents.descent_table([run_descents.descent_of(row) for row in descents.values()]) in text
    for picture in ("summary", "scenes", "heat-map", "descents", "results", "literature"):
        assert f"estimators/{picture}.png" in text
        assert (PAGE.with_suffix("") / f"{picture}.png").is_file()
    assert tables.read_page(PAGE) == text
