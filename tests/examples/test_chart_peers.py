"""What other packages are given: a C callback, the breaks, limits; and descents with each estimator."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("scipy", minversion="1.15")
pytest.importorskip("mpmath")
pytest.importorskip("matplotlib")
pytest.importorskip("vegas")

import teg
from teg.__main__ import main
from teg.errors import TegError
from teg.examples.charts import descents, measure, run_descents, stability_report
from teg.examples.charts.breaks import BREAKS
from teg.examples.charts.c_integrand import CIntegrand, c_text
from teg.examples.charts.descents import Array
from teg.examples.charts.families_of_shapes import SHAPES
from teg.examples.charts.optional_peers import OPTIONAL, is_installed
from teg.examples.charts.peers import PEERS, relative_error, split
from teg.examples.charts.problem import Integrand, TooManyEvaluationsError
from teg.examples.charts.references import read
from teg.examples.charts.regions import REGIONS
from teg.examples.charts.stability import CASES
from teg.examples.charts.stability_report import CLASSES, PEERLESS, answer_of_peer, judge, reference_of

# -- the integrand in C ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["triangle", "Perlin pixel", "annulus ∩ half-plane"])
def test_the_function_in_c_is_the_integrand(name: str) -> None:
    problem = REGIONS[name]
    compiled = CIntegrand(problem, problem.parameters, math.inf)
    plain = Integrand(problem, problem.parameters)
    function, _ = compiled.callback.function, compiled.callback.signature
    assert function is not None
    from scipy.integrate import quad

    for y in (0.3, 0.55):
        smooth = [0.0, *sorted(x for x in BREAKS[name].inner(y, **problem.parameters) if 0 < x < 1), 1.0]
        sums = [sum(quad(f, a, b, args=(y,))[0] for a, b in pairwise(smooth)) for f in (compiled.callback, plain.scalar)]
        assert sums[0] == pytest.approx(sums[1], rel=1e-13)
    assert compiled.evaluations == plain.evaluations > 0


def test_every_case_of_the_table_can_be_written_in_c() -> None:
    for c in CASES:
        assert "return" in c_text(c.problem)


def test_every_case_of_the_report_can_be_given_to_other_packages() -> None:
    """A case in words that only this package knows would be a failure of theirs in the report."""
    for name, group in CLASSES.items():
        for c in group if name not in PEERLESS else ():
            assert "return" in c_text(c.problem), c.name
            points = np.full((2, c.problem.dimension), 0.37)
            assert Integrand(c.problem, c.problem.parameters).on_cube(points).shape == (2,), c.name


def test_a_fault_of_this_program_is_no_answer_of_another_package() -> None:
    words = SHAPES["narrow and smooth"][0]
    broken = replace(words, problem=replace(words.problem, body=lambda m, x, **_: teg.exp(x)))
    with pytest.raises(TegError, match="not a number"):
        answer_of_peer(broken, reference_of(words), "SciPy quad")


def test_the_function_in_c_stops_at_its_limit() -> None:
    disk = REGIONS["disk"]
    with pytest.raises(TooManyEvaluationsError):
        PEERS["dblquad"](disk, disk.parameters, 1e-8, 1000)


# -- the rival that is told the breaks ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", REGIONS)
def test_the_breaks_of_each_region_are_all_there(name: str) -> None:
    problem = REGIONS[name]
    found = split(problem, problem.parameters, 1e-12)
    assert relative_error(found.value, read("regions")[name].value) < 1e-13
    assert found.evaluations < 200_000


def test_only_our_boundary_integral_is_called_that() -> None:
    assert all("our" not in s.name("value") for s in measure.SERIES.values())
    ours = {m for m, s in measure.SERIES.items() if s.name("gradient").startswith("our boundary integral")}
    assert ours == {"midpoint", "montecarlo", "qmc"}
    assert {t.quantity for t in measure.tasks(quick=True) if measure.SERIES[t.method].differenced} == {"gradient"}


def test_plain_sampling_with_differences_is_less_exact_than_the_boundary_integral() -> None:
    exact, problem = read("regions")["disk"], "disk"
    errors = {}
    for method in ("qmc", "qmc-differences"):
        (point,) = measure.measure(measure.Task(problem, "gradient", method, (2**12,)), exact, "numpy", lambda key: None)
        errors[method] = point.error
    assert errors["qmc"] < errors["qmc-differences"] / 5


# -- the report --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", SHAPES)
def test_the_exact_gradient_of_each_new_family_is_right_or_says_so(family: str) -> None:
    for c in (SHAPES[family][0], SHAPES[family][-1]):
        answer = judge(c, "numpy", ["exact"])["exact"]
        assert answer["score"] in ("right", "imprecise", "said in the call"), (c.name, answer)


def test_other_packages_are_judged_where_they_can_be_asked() -> None:
    smooth = SHAPES["narrow and smooth"][0]
    assert answer_of_peer(smooth, reference_of(smooth), "SciPy quad")["score"] in ("right", "imprecise")
    inner = SHAPES["conditions on integrals"][0]
    assert set(judge(inner, "numpy", ["ignore", *stability_report.PEERS])) == {"ignore"}


@pytest.mark.parametrize("name", OPTIONAL)
def test_optional_packages_integrate(name: str) -> None:
    if not is_installed(name):
        pytest.skip(f"{name} is not installed")
    for shape, tol in ("narrow and smooth", 1e-9), ("cut peaks", 1e-2):
        c = SHAPES[shape][0] if shape in SHAPES else CLASSES[shape][0]
        found = OPTIONAL[name](c.problem, c.problem.parameters, 1e-10, 10**5)
        assert relative_error(found.value, reference_of(c).value) < tol, c.name
        assert 0 < found.evaluations < 2 * 10**5


def test_packages_that_are_not_installed_have_no_column(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stability_report, "is_installed", lambda name: name not in OPTIONAL)
    smooth = SHAPES["narrow and smooth"][0]
    answers = {smooth.name: judge(smooth, "numpy", ["exact", "SciPy quad", "cubature", "quadax"])}
    assert stability_report.columns(answers) == ["exact", "SciPy quad"]
    assert list(stability_report.counts(answers)) == ["exact", "SciPy quad"]


# -- descents ----------------------------------------------------------------------------------------------------------


def test_a_descent_follows_a_gradient_and_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    def gradient(method: str) -> Callable[[Array], Array]:
        return lambda z: 2 * z if method == "exact" else 0 * z

    bowl = descents.Task(np.array([1.0, -2.0]), 0.125, lambda z: float(np.sum(z * z)), gradient, 1)
    monkeypatch.setattr(descents, "task_of", lambda problem, backend: bowl)
    exact, still = (descents.descend("bowl", m, "numpy", math.inf, 40) for m in ("exact", "ignore"))
    assert exact.losses[-1] < 0.1
    assert not exact.has_failed
    assert still.losses == (5.0,) * len(still.losses)
    assert exact.seconds[0] == 0.0
    assert sorted(exact.seconds) == list(exact.seconds)


def test_colours_at_corners_are_descended_in_place_of_a_photo() -> None:
    pytest.importorskip("skimage")
    scene = descents.photo("numpy")
    start = np.concatenate([scene.mesh.vertices.ravel(), np.full(9 * len(scene.mesh.triangles), 0.5)])
    assert np.abs(scene.shown(start) - 0.5).max() < 0.01
    assert scene.values(start)["boxes"].shape == (len(scene.mesh.triangles), 4)


def test_a_table_of_descents_says_who_failed() -> None:
    good = descents.Descent("polygon", "exact", (0.0, 1.0), (1.0, 0.1), (0.5,))
    bad = descents.Descent("polygon", "spsa", (0.0, 1.0), (1.0, math.nan), (math.nan,))
    assert [run_descents.descent_of(run_descents.data_of(d)).has_failed for d in (good, bad)] == [False, True]
    table = run_descents.descent_table([good, bad])
    assert "| exact | 1.0e-01, near the best in 1 s | 0 |" in table
    assert "| spsa | nan | 1 |" in table


@pytest.mark.slow
def test_a_quick_chart_of_descents(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("skimage")
    page = tmp_path / "page.md"
    page.write_text("<!-- begin descents: written by `teg chart descents` -->\n<!-- end descents -->\n", encoding="utf-8")
    command = ["chart", "descents", "-o", str(tmp_path), "--page", str(page), "--quick", "--quiet", "--backend", "numpy"]
    assert main(command) == 0
    assert "3 descents, 0 of which ended above their start" in capsys.readouterr().out
    assert (tmp_path / "descents.png").is_file()
    assert (tmp_path / "results.png").is_file()
    assert "| exact |" in page.read_text(encoding="utf-8")
    assert main(command) == 0  # nothing is descended again
