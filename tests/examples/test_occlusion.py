"""The pose of a mesh: the picture is that of sampled rays, the gradient that of differences, and the descent ends at the pose."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from teg.__main__ import main
from teg.examples.meshes import Array, grid_of, knot, torus
from teg.examples.occlusion import BACKGROUND, POSE, START, TRUE, Scene, candidates, seen
from tests.examples.clipped_scenes import clipped_pixel
from tests.examples.clipper import slope

SIZE = 12


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(SIZE, 480, "c")


@pytest.mark.parametrize(("mesh", "volume"), [(torus, 2 * np.pi**2 * 0.42**2), (knot, 1.17)])
def test_faces_turn_outwards(mesh: Callable[[int, int], tuple[Array, Array]], volume: float) -> None:
    vertices, faces = mesh(*grid_of(2000))
    a, b, c = (vertices[faces[:, n]] for n in range(3))
    assert float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6 == pytest.approx(volume, rel=0.1)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges) == len(np.unique(np.sort(edges, axis=1), axis=0)) * 2  # closed


def test_the_picture_is_what_rays_see(scene: Scene) -> None:
    many = 40
    px, py, depth = seen(tuple(scene.vertices.T), TRUE, np)  # type: ignore[arg-type]
    ticks = (np.arange(SIZE * many) + 0.5) * 2 / (SIZE * many) - 1
    x, y = np.meshgrid(ticks, ticks)
    nearest, colour = np.full(x.shape, np.inf), np.full(x.shape, BACKGROUND)
    for face, grey in zip(scene.faces, scene.colours, strict=True):
        columns, rows = (slice(*np.searchsorted(ticks, [p[face].min(), p[face].max()])) for p in (px, py))
        rays = x[rows, columns]
        corners = np.stack([np.ones(3), px[face], py[face]])
        weights = np.linalg.solve(corners, np.stack([np.ones(rays.size), rays.ravel(), y[rows, columns].ravel()])).reshape(3, *rays.shape)
        at = -(weights / depth[face][:, None, None]).sum(axis=0)  # -1/depth
        hit = (weights >= 0).all(axis=0) & (at < nearest[rows, columns])
        nearest[rows, columns][hit], colour[rows, columns][hit] = at[hit], grey
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


@pytest.mark.parametrize(("size", "triangles"), [(64, 2000), (1024, 100_000)])
def test_many_triangles_beside_the_clipper(scene: Scene, size: int, triangles: int) -> None:
    """All of a picture is computed, and a sample of it looked at, half of it where much meets."""
    large = Scene(size, triangles, "c")
    large.evaluator = scene.evaluator  # the text of the program does not depend on how many there are
    assert len(large.faces) == pytest.approx(triangles, rel=0.02)
    lists = candidates(large.vertices, large.faces, TRUE, large.size)
    counts = np.diff(lists["R"], axis=1).ravel()
    assert counts.sum() < 5 * triangles + size**2
    rng = np.random.default_rng(0)
    crowded = np.nonzero((counts > 6) & (counts < 30))[0]
    sample = np.concatenate([rng.choice(np.nonzero(counts)[0], 20), rng.choice(crowded, 20)])
    picture = large.picture(TRUE)
    np.testing.assert_allclose(picture.ravel()[sample], [clipped_pixel(large, lists, TRUE, int(n)) for n in sample], atol=1e-9)
    target = picture.copy()
    target.ravel()[sample] -= 0.5  # the derivative of the loss is that of the sum over the sample
    _, slopes = large.loss_and_slopes(TRUE, target)
    largest = max(abs(float(slopes[name])) for name in POSE)
    for name in POSE:

        def of_sample(s: float, name: str = name) -> float:
            pose = {**TRUE, name: TRUE[name] + s}
            return sum(clipped_pixel(large, lists, pose, int(n)) for n in np.unique(sample))

        assert float(slopes[name]) == pytest.approx(slope(of_sample, 1e-6), rel=1e-5, abs=1e-6 * largest)


@pytest.mark.slow
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "occlusion", "--size", "16", "-o", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name in POSE:
        (line,) = [text for text in lines if text.startswith(name)]
        assert float(line.split("->")[1].split()[0]) == pytest.approx(TRUE[name], abs=1e-4)
    (line,) = [text for text in lines if text.startswith("loss")]
    (plain,) = [text for text in lines if text.startswith("without")]
    assert line.split()[1] == plain.split()[-1]
    assert (tmp_path / "pose.png").stat().st_size > 5000
