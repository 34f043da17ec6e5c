"""The springs demo: the published loss, the integrals against a simulation that knows none of them, derivatives, the design."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import teg
from teg.__main__ import main

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")

from teg.examples.springs.design import FIRST, LAST, Jump, Optimum, optimise, violation
from teg.examples.springs.run import run_springs
from teg.examples.springs.scene import DESIGN, compile_fall, published_loss

CORDS = np.array([3.0, 6.0, 1.5, 10.0])
START = {"k1": 1.0, "k2": 10.0, "l1": 2.0, "l2": 10.0}
# by mpmath with 40 digits, the singularity divided out: F = (r - x)·(x - q)·k₂/2 beyond the lock
LOSS = 417.5041438097947041529152
GRADIENT = {"k1": 16.68998087989015700136, "k2": 122.6344088607128376358729, "l1": -401.2715757504907578117586, "l2": 0.0}


@pytest.fixture(scope="module")
def jump() -> Jump:
    return Jump(5.0, 1.0, 1.0, compile_fall("c"))


def optimised(jump: Jump, steps: int = 100) -> Optimum:
    return optimise(jump, jump.values, lambda design: jump.outcome(design)[1], steps)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_the_published_loss_and_its_gradient_whose_singularity_moves(backend: str) -> None:
    f = teg.compile(published_loss(5.0, 1.0), [teg.param(name) for name in DESIGN], backend=backend)
    loss, gradient = f.value_and_grad(START)
    assert loss == pytest.approx(LOSS, rel=1e-14)
    assert gradient == pytest.approx(GRADIENT, rel=1e-10)


def test_the_integrals_are_those_of_a_simulated_jump() -> None:
    jump = Jump(5.0, 1.0, 1.0, compile_fall("c"))
    flight = jump.simulated(CORDS)
    own = Jump(float(flight["way"][-1]), 1.0, 1.0, jump.fall)  # where the fall really ends
    time, acceleration, energy = (float(v) for v in own.fall(own.values_of(CORDS)))
    assert time == pytest.approx(flight["time"][-1], abs=2e-3)  # which starts at NADIR
    assert acceleration == pytest.approx(10 - float(own.stress(CORDS, own.apex)), rel=1e-12)
    assert abs(energy) < 1e-5
    assert CORDS[2] * (1 + CORDS[0] / CORDS[1]) < own.apex  # cord 1 was locked


def test_on_admitted_designs_the_loss_is_the_published_one(jump: Jump) -> None:
    """The fall ends where the singularity lies, so the root is moved behind the bound: by δ, which the loss feels as √δ."""
    design = optimised(jump).design * np.array([1 - 1e-12, 1, 1, 1])
    f = teg.compile(published_loss(5.0, 1.0), [teg.param(name) for name in DESIGN], backend="numpy", inaccurate="ignore")
    assert f(dict(zip(DESIGN, design, strict=True))) == pytest.approx(jump.values(design)[0], abs=1e-5)


def test_derivatives_agree_with_differences_and_plain_ones_do_not(jump: Jump) -> None:
    values, slopes = jump.outcome(CORDS)
    np.testing.assert_allclose(values, jump.values(CORDS), rtol=1e-12)
    np.testing.assert_allclose(slopes, jump.differences(CORDS), rtol=1e-6, atol=1e-7)
    by_z = slopes @ jump.design(jump.moved(CORDS))[1]
    for k, step in enumerate(1e-6 * np.eye(4)):
        ahead, behind = (jump.values(jump.design(jump.moved(CORDS) + s)[0]) for s in (step, -step))
        np.testing.assert_allclose(by_z[:, k], (ahead - behind) / 2e-6, rtol=1e-6, atol=1e-7)
    plain = Jump(5.0, 1.0, 1.0, compile_fall("c", "ignore")).outcome(CORDS)[1]
    assert np.abs(plain[:2, :3] - slopes[:2, :3]).min() > 1e-4


@pytest.mark.parametrize("weight", [0.3, 1.0])
def test_the_design_is_feasible_and_no_feasible_one_near_it_is_better(jump: Jump, weight: float) -> None:
    own = Jump(jump.apex, jump.mass, weight, jump.fall)
    optimum = optimised(own)
    assert optimum.failure == ""  # the gradient along the constraints is 0 to 1e-6
    assert optimum.violation < 1e-12
    assert own.simulated(optimum.design)["way"][-1] == pytest.approx(own.apex, abs=1e-4)
    best, random, tried = own.values(optimum.design)[0], np.random.default_rng(0), 0
    low, high = own.bounds().T
    for near in np.clip(own.moved(optimum.design) + 0.02 * random.normal(size=(300, 4)), low, high):
        values, slopes = own.outcome(own.design(near)[0])
        near[1] -= values[1] / (slopes @ own.design(near)[1])[1, 1]  # so that the fall ends at the apex, nearly
        values = own.values(own.design(near)[0])
        if violation(values) < 1e-4:
            tried += 1
            assert values[0] > best - 1e-3
    assert tried > 20
    assert FIRST <= own.moved(optimum.design)[2] <= LAST + 1e-12


def test_a_run_writes_its_report(tmp_path: Path) -> None:
    report = run_springs(out=tmp_path, backend="c")
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    plain, differences = (report["beside"][name] for name in ("plain automatic differentiation", "finite differences"))
    assert not plain["converged"]
    assert differences["loss"] == pytest.approx(report["loss"], abs=1e-6)
    assert report["simulated"]["lowest"] == pytest.approx(5.0, abs=1e-4)
    assert report["published"]["loss"] == pytest.approx(LOSS, rel=1e-13)
    assert run_springs(out=tmp_path, backend="c", resume=True)["design"] == report["design"]


def test_what_cannot_be_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "springs", "--steps", "1", "--alone", "-o", str(tmp_path)]) == 3
    assert "did not converge" in capsys.readouterr().err
    assert main(["demo", "springs", "--apex", "-3", "-o", str(tmp_path)]) == 2
    assert main(["demo", "springs", "--mass", "2", "--resume", "-o", str(tmp_path)]) == 2
    assert "mass was 1.0, is 2.0" in capsys.readouterr().err
