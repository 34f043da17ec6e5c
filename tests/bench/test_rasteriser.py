"""The comparison with a rasteriser, without it: the exact side is that of a clipper, and the other side gets the same scene."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import rasteriser, run
from tests.bench.rasteriser import Mesh, Ours, as_deodr, candidates, gathered, overlapping, silhouette, turns
from tests.examples.clipper import area, box, region, within, without

SIZE = 6


def few() -> Mesh:
    """Triangles that overlap, each at a depth of its own and of one colour."""
    scene = overlapping(12, SIZE)
    depths = np.repeat(np.linspace(1.0, 0.2, 12), 3)
    return scene._replace(depths=depths, colours=np.repeat(scene.colours[::3], 3, axis=0))


def clipped(scene: Mesh) -> np.ndarray:
    """The picture by the clipper: the last triangle is in front."""
    picture = np.full((SIZE, SIZE, 3), rasteriser.BACKGROUND)
    forms = [region(corners.tolist()) for corners in scene.places[scene.faces]]
    for row, column in np.ndindex(SIZE, SIZE):
        square = box(column, column + 1, row, row + 1)
        for k, own in enumerate(forms):
            parts = [within(square, own)]
            for other in forms[k + 1 :]:
                parts = without([p for p in parts if len(p) > 2], other)
            picture[row, column] += area(parts) * (scene.colours[scene.shades[k, 0]] - rasteriser.BACKGROUND)
    return picture


@pytest.fixture(scope="module")
def ours() -> Ours:
    return Ours(few(), rasteriser.waves(SIZE))


def test_the_exact_picture_is_that_of_a_clipper(ours: Ours) -> None:
    picture = clipped(few())
    np.testing.assert_allclose(ours.picture(), picture, atol=1e-12)
    assert ours().loss == pytest.approx(((picture - rasteriser.waves(SIZE)) ** 2).sum(), rel=1e-12)


def test_the_exact_gradient_is_that_of_differences(ours: Ours) -> None:
    scene, target = few(), rasteriser.waves(SIZE)
    way = np.random.default_rng(0).normal(size=scene.places.shape)
    slope = float((ours().by_place * way).sum())
    assert ours.difference(way) == pytest.approx(slope, rel=1e-6)
    one, two = (((clipped(scene._replace(places=scene.places + s * 1e-6 * way)) - target) ** 2).sum() for s in (1, -1))
    assert (one - two) / 2e-6 == pytest.approx(slope, rel=1e-6)


def test_lists_hold_what_meets_a_pixel() -> None:
    scene = few()
    lists = candidates(scene, SIZE)
    for pixel, (first, end) in enumerate(lists["R"]):
        row, column = divmod(pixel, SIZE)
        square = box(column, column + 1, row, row + 1)
        met = [k for k, corners in enumerate(scene.places[scene.faces]) if len(within(square, region(corners.tolist()))) > 2]
        assert set(met) <= set(lists["L"][first:end].tolist())


def test_the_other_side_gets_the_same_scene() -> None:
    scene = rasteriser.torus(200, SIZE)
    given = as_deodr(scene, SIZE)
    np.testing.assert_array_equal(given["ij"][given["faces"]], scene.places[scene.faces])
    np.testing.assert_array_equal(given["colors"][given["faces"]], scene.colours[scene.shades])
    assert given["faces"].dtype == np.uint32
    assert min(given["depths"]) >= 0.0  # else DEODR takes a triangle to be behind the camera
    assert given["edgeflags"].shape == scene.faces.shape
    for name in ("ij", "depths", "colors", "edgeflags"):
        assert given[name].flags.c_contiguous, name
    ones = gathered(scene.faces, np.ones_like(given["ij"]), len(scene.places))
    np.testing.assert_array_equal(ones[:, 0], np.bincount(scene.faces.ravel()))


def test_outlines() -> None:
    """A square of two triangles and one below it that turns away: its edge is the only one that hides."""
    places = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 0, 3]])
    assert (turns(places[faces]) > 0).tolist() == [True, True, False]
    assert silhouette(places, faces).tolist() == [[True, True, False], [False, True, True], [False, False, False]]


def test_its_absence_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rasteriser, "is_installed", lambda: False)
    assert run.table(rasteriser.rasteriser_rows()) == run.ABSENT


def test_one_table_of_a_page_is_kept() -> None:
    page = "### Search\n\na table\n\n### Sympy\n\nanother\n\n<!-- end bench -->\nmore"
    assert run.kept(page, "search") == ["### Search\n\na table\n"]
    assert run.kept(page, "sympy") == ["### Sympy\n\nanother\n"]
    assert run.kept(page, "single") == []
