"""The billiards demo: contacts found from the action alone, against the laws of collisions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.errors import InputError

pytest.importorskip("matplotlib")
pytest.importorskip("PIL")

from teg.examples.billiards.newton import search
from teg.examples.billiards.paths import energies, paths
from teg.examples.billiards.run import _derivatives, _flown_error, run_billiards
from teg.examples.billiards.table import fly, scene
from teg.examples.replay import Replay


@pytest.mark.parametrize("name", ["exchange", "collision", "cushions", "break", "stack"])
def test_flights_keep_energy_and_end_where_their_velocities_say(name: str) -> None:
    table = scene(name)
    flight = fly(table)
    own = paths(table, flight, flight.unknowns)
    total = energies(table, own, np.linspace(0, table.duration, 200)).sum(axis=0)
    assert np.ptp(total) < 1e-10 * np.abs(total).max()
    for path, ball, end in zip(own, table.balls, flight.velocities, strict=True):
        np.testing.assert_allclose(path.velocity(np.array([0.0, table.duration])), [ball.velocity, end], atol=1e-9)


def test_equal_balls_exchange_their_velocities(tmp_path: Path) -> None:
    report = run_billiards(out=tmp_path, scene="exchange", backend="numpy", alone=True)
    before, after = np.array(report["velocities"])[:, :, 0].T
    np.testing.assert_allclose(before, [0, 1], atol=1e-15)
    np.testing.assert_allclose(after, [1, 0], atol=1e-15)
    assert report["unknowns"]["time_0"] == pytest.approx(0.8, abs=1e-15)
    assert report["converged"]
    assert report["steps"] <= 20


def test_newton_finds_all_contacts(tmp_path: Path) -> None:
    table = scene("break", seed=3)
    flight = fly(table)
    derivatives = _derivatives(table, flight, {"backend": "numpy"}, "exact", Replay(tmp_path / "checkpoint.npz", {}, False))
    end = search(table, flight, derivatives, 20)
    assert not end.failure
    np.testing.assert_allclose(end.z, flight.unknowns, atol=1e-13)
    assert end.steps[-1] < 1e-10


def test_a_run_resumes_and_plain_derivatives_do_not_converge(tmp_path: Path) -> None:
    report = run_billiards(out=tmp_path, backend="numpy")
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    assert report["steps"] <= 20
    assert report["newton_steps"][-1] < 1e-10
    assert report["largest_error"] < 1e-13
    assert report["energy_error"] < 1e-12
    assert not report["beside"]["converged"]
    assert (tmp_path / "billiards.gif").stat().st_size > 1000
    resumed = run_billiards(out=tmp_path, backend="numpy", alone=True, resume=True)
    assert resumed["unknowns"] == report["unknowns"]


def test_what_cannot_be_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["demo", "billiards", "--scene", "exchange", "--alone", "--backend", "numpy", "-o", str(tmp_path)]
    assert main([*words, "--steps", "2"]) == 3
    assert "did not converge: the last of 2 Newton steps was" in capsys.readouterr().err
    for wrong in (["--duration", "-1"], ["--duration", "0.1"], ["--duration", "nan"]):
        assert main([*words, *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_scene_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "mine.json", tmp_path / "out"
    balls = [
        {"mass": 1, "radius": 0.1, "place": [0, 0], "velocity": [1, 0]},
        {"mass": 3, "radius": 0.1, "place": [1, 0], "velocity": [0, 0]},
    ]
    words = ["demo", "billiards", "--balls", str(file), "--alone", "--backend", "numpy", "-o", str(out)]
    file.write_text(json.dumps({"balls": balls, "duration": 1.5}))
    assert main(words) == 0
    velocities = np.array(json.loads((out / "run.json").read_text(encoding="utf-8"))["velocities"])
    np.testing.assert_allclose(velocities[:, 1], [[-0.5, 0], [0.5, 0]], atol=1e-13)
    capsys.readouterr()
    wrong = [
        {"balls": balls[:1] * 2},
        {"balls": [balls[0] | {"mass": 0}]},
        {"balls": [balls[0] | {"place": 1}]},
        {"walls": [[0, None]] * 2},
    ]
    for text in ("[", "[]", "{}", *(json.dumps({"balls": balls, "duration": 1.5} | change) for change in wrong)):
        file.write_text(text)
        assert main(words) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_another_true_path_is_recognised() -> None:
    table = replace(scene("stack"), duration=1.2)
    flight = fly(table)
    assert _flown_error(table, flight, flight.unknowns) < 1e-9
    assert _flown_error(table, flight, flight.unknowns + 1e-3) > 1e-6


def test_endless_contacts_are_refused() -> None:
    with pytest.raises(InputError, match="more than 24 times"):
        fly(replace(scene("cushions"), duration=1e3))
