"""The springs demo: the integrals against a simulation that knows none of them, derivatives, the design."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")

from teg.examples.springs.design import GRAVITY, Jump, optimise, pull_of, violation
from teg.examples.springs.run import run_springs
from teg.examples.springs.scene import compile_fall

CORDS = np.array([300.0, 120.0, 6.0, 3.0, 25.0])


@pytest.fixture(scope="module")
def jump() -> Jump:
    return Jump(30.0, 75.0, 1.0, compile_fall("c"))


def test_the_integrals_are_those_of_a_simulated_jump(jump: Jump) -> None:
    way = jump.simulated(CORDS)["way"][-1]  # where the fall really ends
    design = np.array([*CORDS[:4], way])
    time, force, energy = (float(v) for v in jump.fall(jump._values(design)))
    flight = jump.simulated(design)
    assert time == pytest.approx(flight["time"][-1], rel=1e-6)
    assert force == pytest.approx(float(pull_of(design, way)), rel=1e-12)
    assert abs(energy) < 1e-4 * jump.mass * GRAVITY * way
    assert way > 6 + 3 * (1 + 300 / 120)  # cord 1 was locked


def test_derivatives_agree_with_differences_and_plain_ones_do_not(jump: Jump) -> None:
    values, slopes = jump.outcome(CORDS)
    np.testing.assert_allclose(values, jump.values(CORDS), rtol=1e-13)
    np.testing.assert_allclose(slopes, jump.differences(CORDS), rtol=1e-6, atol=1e-8)
    plain = Jump(jump.drop, jump.mass, jump.weight, compile_fall("c", "ignore")).outcome(CORDS)[1]
    assert (plain[:2, 3] == 0).all()  # where the string locks: automatic differentiation does not see it
    assert (np.abs(slopes[:2, 3]) > 1e-3).all()


@pytest.mark.parametrize("weight", [0.3, 1.0])
def test_the_design_is_feasible_and_no_feasible_one_near_it_is_better(jump: Jump, weight: float) -> None:
    own = Jump(jump.drop, jump.mass, weight, jump.fall)
    found = optimise(own, lambda design: own.outcome(design)[1], 100, own.start())
    assert found.failure == ""
    assert found.violation < 1e-9
    assert own.simulated(found.design)["way"][-1] == pytest.approx(found.design[-1], abs=1e-4)
    best, random, tried = own.values(found.design)[0], np.random.default_rng(0), 0
    low, high = np.array(own.bounds()).T
    for near in np.clip(found.design * (1 + 0.02 * random.normal(size=(1000, 5))), low, high):
        values, slopes = own.outcome(near)
        near[0] -= values[1] / slopes[1, 0]  # so that the fall ends at the lowest point, nearly
        values = own.values(near)
        if violation(values) < 1e-4 and (near >= low).all() and (near <= high).all():
            tried += 1
            assert values[0] > best - 1e-3
    assert tried > 20


def test_a_run_writes_its_report_and_says_when_it_did_not_converge(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = run_springs(out=tmp_path, backend="c")
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    plain, differences = (report["beside"][name] for name in ("plain automatic differentiation", "finite differences"))
    assert not plain["converged"]
    assert differences["loss"] == pytest.approx(report["loss"], abs=1e-6)
    assert report["simulated"]["lowest"] == pytest.approx(report["design"]["lowest"], abs=1e-4)
    assert main(["demo", "springs", "--steps", "1", "--alone", "-o", str(tmp_path)]) == 3
    assert "did not converge" in capsys.readouterr().err
    assert main(["demo", "springs", "--drop", "-3", "-o", str(tmp_path)]) == 2
