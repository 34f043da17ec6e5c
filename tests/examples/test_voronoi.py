"""Optimal transport: Newton's steps end at rounding, the dual is the cost, and the cells are those of sampled points."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.examples.voronoi import candidates, density, run_voronoi, scene, solve

COUNT = 40


def test_masses_and_dual() -> None:
    sites, masses = scene(COUNT, 1)
    found = solve(sites, masses)
    assert found.errors[-1] < 1e-12
    assert found.errors[-1] < found.errors[-2] ** 1.5  # Newton's steps, not the descent's
    assert found.cost == pytest.approx(found.dual, abs=1e-13)
    ticks = (np.arange(800) + 0.5) / 800
    px, py = np.meshgrid(ticks, ticks)
    owner = np.argmin((sites**2).sum(axis=1) - found.weights - 2 * np.stack([px.ravel(), py.ravel()], axis=1) @ sites.T, axis=1)
    sampled = np.bincount(owner, weights=density(px, py).ravel() / 800**2, minlength=COUNT)
    np.testing.assert_allclose(sampled, masses, atol=5e-5)


def test_every_owner_of_a_point_is_a_candidate_of_its_tile() -> None:
    sites, _ = scene(COUNT, 2)
    weights = 0.02 * np.random.default_rng(0).uniform(size=COUNT)
    lists = candidates(sites, weights)
    for point in np.random.default_rng(1).uniform(size=(500, 2)):
        tile = int(point[1] * 16) * 16 + int(point[0] * 16)
        first, end = lists["R"][tile]
        assert np.argmin(((point - sites) ** 2).sum(axis=1) - weights) in lists["L"][first:end]
    assert len(lists["L"]) < 256 * COUNT / 2


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "voronoi", "--sites", "12", "-o", str(tmp_path)]) == 0
    assert "difference" in capsys.readouterr().out
    assert (tmp_path / "cells.png").stat().st_size > 5000


@pytest.mark.usefixtures("as_users_compile")  # as the process that is killed does
def test_killed_after_a_step_and_resumed_it_ends_with_the_same_weights(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    words = [sys.executable, "-m", "teg", "demo", "voronoi", "--sites", "100", "--backend", "c", "-o", str(tmp_path)]
    checkpoint = tmp_path / "checkpoint.npz"
    with subprocess.Popen(words, stdout=subprocess.DEVNULL) as run:
        while not checkpoint.exists():
            assert run.poll() is None
            time.sleep(0.01)
        run.kill()
    assert not (tmp_path / "run.json").exists()
    with np.load(checkpoint) as stored:
        done = len(stored["errors"])
    resumed = run_voronoi(out=tmp_path, sites=100, backend="c", resume=True)
    whole = solve(*scene(100, 0), "c")
    assert done < len(whole.errors)
    assert resumed["errors"] == whole.errors
    assert resumed["cost"] == whole.cost
