"""The pose of a mesh: the picture is that of sampled rays, the gradient that of differences, and the descent ends at the pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.examples.occlusion import BACKGROUND, POSE, START, TRUE, Scene, seen, torus

SIZE = 12


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(SIZE, "c", "sift")


def test_faces_turn_outwards() -> None:
    vertices, faces, _ = torus()
    a, b, c = (vertices[faces[:, n]] for n in range(3))
    assert float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6 == pytest.approx(2 * np.pi**2 * 0.42**2, rel=0.1)  # the volume


def test_the_picture_is_what_rays_see(scene: Scene) -> None:
    many = 40
    px, py, depth = seen(tuple(scene.vertices.T), TRUE, np)  # type: ignore[arg-type]
    ticks = (np.arange(SIZE * many) + 0.5) * 2 / (SIZE * many) - 1
    x, y = np.meshgrid(ticks, ticks)
    nearest, colour = np.full(x.shape, np.inf), np.full(x.shape, BACKGROUND)
    for face, grey in zip(scene.faces, scene.colours, strict=True):
        corners = np.stack([np.ones(3), px[face], py[face]])
        weights = np.linalg.solve(corners, np.stack([np.ones(x.size), x.ravel(), y.ravel()])).reshape(3, *x.shape)
        at = -(weights / depth[face][:, None, None]).sum(axis=0)  # -1/depth
        hit = (weights >= 0).all(axis=0) & (at < nearest)
        nearest[hit], colour[hit] = at[hit], grey
    sampled = colour.reshape(SIZE, many, SIZE, many).mean(axis=(1, 3))
    np.testing.assert_allclose(scene.picture(TRUE), sampled, atol=4e-3)


def test_the_gradient_by_the_pose(scene: Scene) -> None:
    target = scene.picture(TRUE)
    _, slopes = scene.loss_and_slopes(START, target)
    for name in POSE:
        h = 1e-5
        values = [scene.loss_and_slopes({**START, name: START[name] + s * h}, target)[0] for s in (1, -1, 2, -2)]
        expected = (8 * (values[0] - values[1]) - (values[2] - values[3])) / (12 * h)
        assert float(slopes[name]) == pytest.approx(expected, rel=1e-5, abs=1e-5)


@pytest.mark.slow
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "occlusion", "--size", "16", "-o", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in POSE:
        (line,) = [text for text in lines if text.startswith(name)]
        assert float(line.split("->")[1].split()[0]) == pytest.approx(TRUE[name], abs=1e-4)
    (line,) = [text for text in lines if text.startswith("loss")]
    start, plain = line.split()[1], line.split()[-1]
    assert start == plain
    assert (tmp_path / "pose.png").stat().st_size > 5000
