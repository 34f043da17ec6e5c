"""Soft shadows: the share of a light that a receiver sees is that of an independent clipper, with derivatives by mesh, light and ground."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.examples.fit import fit
from teg.examples.replay import not_kept
from teg.examples.soft_shadow.run import START, TRUE, Scene
from teg.examples.soft_shadow.scene import POSE
from tests.examples.clipped_scenes import clipped_share
from tests.examples.clipper import slope

SIZE = 8


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(SIZE, 60, "c", "LGPQ")


@pytest.mark.parametrize("pose", [TRUE, START])
def test_the_shadow_is_that_of_the_clipper(scene: Scene, pose: dict[str, float]) -> None:
    expected = [clipped_share(scene, scene.arrays, pose, n) for n in range(SIZE * SIZE)]
    assert min(expected) < 0.4
    np.testing.assert_allclose(scene.picture(pose).ravel(), expected, atol=1e-12)


def test_the_derivatives_are_those_of_the_clipper(scene: Scene) -> None:
    receiver = int(np.argmin(abs(scene.picture(TRUE) - 0.5)))
    target = scene.picture(TRUE)
    target.ravel()[receiver] -= 0.5  # the loss is the square of 0.5, its derivative that of the share
    _, slopes = scene.loss_and_slopes(TRUE, target)
    rng = np.random.default_rng(0)
    for name in POSE:
        by_clipper = slope(lambda s, name=name: clipped_share(scene, scene.arrays, {**TRUE, name: TRUE[name] + s}, receiver), 1e-4)
        assert float(slopes[name]) == pytest.approx(by_clipper, rel=1e-6, abs=1e-7)
    for name in "LGPQ":
        direction = rng.normal(size=scene.arrays[name].shape)
        along = {s: {**scene.arrays, name: scene.arrays[name] + s * direction} for s in (1e-4, -1e-4, 2e-4, -2e-4)}
        by_clipper = slope(lambda s, along=along: clipped_share(scene, along[s], TRUE, receiver), 1e-4)
        assert float((slopes[name] * direction).sum()) == pytest.approx(by_clipper, rel=1e-6, abs=1e-7)


def test_a_triangle_beyond_the_light_hides_nothing(scene: Scene) -> None:
    assert scene.picture({**TRUE, "up": 6.0}).ravel() == pytest.approx(np.ones(SIZE * SIZE))


def test_lists_grow_with_the_mesh_and_those_of_a_tile_hardly() -> None:
    lists = [Scene(SIZE, triangles, "c").candidates(TRUE) for triangles in (1000, 4000, 16000)]
    lengths, longest = ([f(one) for one in lists] for f in (lambda one: len(one["I"]), lambda one: int(np.diff(one["R"]).max())))
    assert lengths[2] < 5 * lengths[1] < 25 * lengths[0]
    assert longest[2] < 4 * longest[0]  # and not 16 times: a union costs the square of them


def test_tiles_change_nothing(scene: Scene) -> None:
    lists = scene.candidates(TRUE)
    assert lists["E"].tolist() == [-1.0, 1.0]
    tiled = {"E": np.array([-1.0, -0.2, 0.5, 1.0]), "R": np.broadcast_to(lists["R"], (SIZE * SIZE, 3, 3, 2)).copy()}
    given = {**scene.arrays, **TRUE, "T": np.zeros(SIZE * SIZE)}
    value, slopes = scene.evaluator.value_and_grad({**given, **lists})
    again, others = scene.evaluator.value_and_grad({**given, **lists, **tiled})
    assert float(again) == pytest.approx(float(value), rel=1e-13)
    for name, slope_by_it in slopes.items():
        np.testing.assert_allclose(others[name], slope_by_it, atol=1e-10)


def test_the_pose_is_found_from_the_shadow(scene: Scene) -> None:
    target = scene.picture(TRUE)
    found = fit(lambda pose: scene.loss_and_slopes(pose, target), START, 60, not_kept)
    assert found.losses[-1] < 1e-15
    assert found.numbers[-1] == pytest.approx(TRUE, abs=1e-6)


@pytest.mark.thorough
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "soft-shadow", "--size", "12", "--triangles", "60", "-o", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in POSE:
        (line,) = [text for text in lines if text.startswith(name)]
        assert float(line.split("->")[1].split()[0]) == pytest.approx(TRUE[name], abs=1e-6)
    assert (tmp_path / "shadow.png").stat().st_size > 5000
    before = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert main(["demo", "soft-shadow", "--size", "12", "--triangles", "60", "--resume", "-o", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))["losses"] == before["losses"]
    assert main(["demo", "soft-shadow", "--size", "10", "--triangles", "60", "--resume", "-o", str(tmp_path)]) == 2  # of another run
