"""Colours that are polynomials, pictures of any shape, optimisers, refinement, mesh files."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.errors import InputError

pytest.importorskip("PIL")
pytest.importorskip("scipy")

from teg.examples.triangulation.baselines import best_loss, psnr, random_delaunay
from teg.examples.triangulation.colour_fit import TERMS, colours_at, products
from teg.examples.triangulation.descent import OPTIMISERS, State, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import Mesh, make_mesh, signed_areas
from teg.examples.triangulation.mesh_files import _flat_pieces, read_mesh, write_ply, write_svg
from teg.examples.triangulation.pictures import render
from teg.examples.triangulation.refinement import refine
from teg.examples.triangulation.scene import compile_scene

WIDE = (24, 16)


def target_of(size: tuple[int, int], of: Any) -> np.ndarray:
    """A picture whose channels are functions of the centres of the pixels."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return np.stack([of(x, y), 1 - of(x, y), 0.5 * of(x, y)], axis=-1)


def disk(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A disk off the centre, on a slope."""
    return np.where((x - 9) ** 2 + (y - 7) ** 2 < 30, 0.9, 0.2 + 0.01 * x)


@pytest.fixture(scope="module")
def scenes() -> list[Any]:
    return [compile_scene("c", degree=degree) for degree in range(3)]


def test_products_of_monomials_over_a_triangle() -> None:
    corners = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]])  # centroid (2/3, 1/3), unit 4/3
    matrix = products(corners, 2)[0]
    random = np.random.default_rng(0).uniform(size=(2, 400_000))
    s, t = np.where(random.sum(axis=0) > 1, 1 - random, random)
    u, v = (2 * s - 2 / 3) * 0.75, (t - 1 / 3) * 0.75
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    np.testing.assert_allclose(matrix, terms @ terms.T / u.size, atol=2e-3)
    assert matrix[0, 0] == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_best_colours_are_the_best_and_the_gradient_is_that_of_the_least_loss(scenes: list[Any], degree: int) -> None:
    mesh, random = make_mesh(20, WIDE, seed=3), np.random.default_rng(0)
    image = ImageLoss(scenes[degree], target_of(WIDE, disk), mesh.triangles)
    loss, colours = image.best_colours(mesh.vertices, random.uniform(size=(len(mesh.triangles), 3 * TERMS[degree])))
    values = image._values(mesh.vertices, colours)
    assert scenes[degree].by_vertices(values) == pytest.approx(loss, rel=1e-11)
    assert np.abs(scenes[degree].by_colours.grad(values)["colours"]).max() < 1e-12
    gradient = np.where(mesh.movable, image.gradient(mesh.vertices, colours), 0)
    direction, h = np.where(mesh.movable, random.normal(size=gradient.shape), 0), 1e-5
    ahead, behind = (image.best_colours(mesh.vertices + s * h * direction, colours)[0] for s in (1, -1))
    assert np.sum(gradient * direction) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)


def test_more_terms_fit_better_and_a_linear_picture_exactly_but_for_its_pixels(scenes: list[Any]) -> None:
    mesh, colours_of = make_mesh(12, WIDE), {}
    slope = target_of(WIDE, lambda x, y: 0.2 + 0.02 * x + 0.01 * y)
    losses = []
    for degree, scene in enumerate(scenes):
        image = ImageLoss(scene, slope, mesh.triangles)
        loss, colours_of[degree] = image.best_colours(mesh.vertices, np.zeros((len(mesh.triangles), 3 * TERMS[degree])))
        losses.append(loss)
    assert losses[0] > 20 * losses[1] > 0
    assert losses[1] >= losses[2]
    steps = (0.02**2 + 0.01**2) / 12 * (1 + 1 + 0.25)  # of the pixels: they are constant, the slope is not
    assert losses[1] == pytest.approx(steps, rel=0.05)
    centre = np.array([[12.0, 8.0]])
    (face,) = np.nonzero(_contains(mesh, centre[0]))[0][:1]
    shown = colours_at(centre, np.array([face]), mesh.vertices[mesh.triangles], colours_of[1])
    assert shown[0, 0] == pytest.approx(0.2 + 0.02 * 12 + 0.01 * 8, abs=2e-3)


def _contains(mesh: Mesh, point: np.ndarray) -> np.ndarray:
    corners = mesh.vertices[mesh.triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    away = point - corners
    return (edges[..., 0] * away[..., 1] - edges[..., 1] * away[..., 0] >= 0).all(axis=1)


@pytest.mark.parametrize("optimiser", sorted(OPTIMISERS))
def test_every_optimiser_descends_without_folds(scenes: list[Any], optimiser: str) -> None:
    mesh = make_mesh(30, WIDE)
    image = ImageLoss(scenes[1], target_of(WIDE, disk), mesh.triangles)
    state = start = first_state(mesh, image, TERMS[1])
    for _ in range(6):
        state = next_state(image, state, WIDE, optimiser)
        assert signed_areas(state.vertices, state.triangles).min() > 0
    assert state.loss < 0.9 * start.loss


def test_a_refinement_gains_and_covers_the_picture_once(scenes: list[Any]) -> None:
    mesh = make_mesh(80, WIDE)
    image = ImageLoss(scenes[0], target_of(WIDE, disk), mesh.triangles)
    state = first_state(mesh, image)
    losses = [state.loss]
    for _ in range(3):
        state = refine(image, state, WIDE)
        losses.append(state.loss)
        check_mesh(state)
    assert all(after < before for before, after in pairwise(losses))
    assert losses[-1] < 0.8 * losses[0]
    assert len(state.triangles) == pytest.approx(len(mesh.triangles), abs=4)
    assert next_state(image, state, WIDE).loss < state.loss


def check_mesh(state: State) -> None:
    """Positive areas that add up, each inner edge beside two triangles, corners in place."""
    areas = signed_areas(state.vertices, state.triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(WIDE[0] * WIDE[1], rel=1e-12)
    edges = [tuple(sorted((int(f[k]), int(f[k - 1])))) for f in state.triangles for k in range(3)]
    counts = {edge: edges.count(edge) for edge in edges}
    assert set(counts.values()) <= {1, 2}
    for (a, b), count in counts.items():
        on_border = bool(((state.vertices[a] == state.vertices[b]) & ~state.movable[[a, b]].any(axis=0)).any())
        assert (count == 1) == on_border
    assert {(0.0, 0.0), (24.0, 0.0), (0.0, 16.0), (24.0, 16.0)} == {tuple(v) for v in state.vertices[~state.movable.any(axis=1)].tolist()}


def test_a_random_mesh_is_a_mesh(scenes: list[Any]) -> None:
    mesh = random_delaunay(100, WIDE, seed=1)
    assert signed_areas(mesh.vertices, mesh.triangles).min() > 0
    assert signed_areas(mesh.vertices, mesh.triangles).sum() == pytest.approx(24 * 16)
    assert len(mesh.triangles) == pytest.approx(100, abs=10)
    image = ImageLoss(scenes[0], target_of(WIDE, disk), mesh.triangles)
    assert best_loss(image, mesh) == pytest.approx(first_state(mesh, image).loss, rel=1e-12)
    assert psnr(0.003) == pytest.approx(30)


@pytest.mark.parametrize("terms", [1, 3, 6])
def test_a_drawing_has_flat_pieces_of_about_one_colour_and_nothing_shows_through(tmp_path: Path, terms: int) -> None:
    mesh, random = make_mesh(20, WIDE), np.random.default_rng(0)
    colours = np.concatenate(
        [np.full((len(mesh.triangles), 3), 0.5), random.uniform(-0.1, 0.1, (len(mesh.triangles), 3 * terms - 3))], axis=1
    )
    places, shades = _flat_pieces(mesh.vertices, mesh.triangles, colours)
    areas = signed_areas(places.reshape(-1, 2), np.arange(3 * len(places)).reshape(-1, 3))
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(WIDE[0] * WIDE[1], rel=1e-12)
    assert len(places) == len(mesh.triangles) if terms == 1 else len(places) > 4 * len(mesh.triangles)
    write_svg(tmp_path / "mesh.svg", mesh.vertices, mesh.triangles, colours, WIDE)
    text = (tmp_path / "mesh.svg").read_text()
    assert text.count("<path") == len(places) + 1
    assert text.index("<rect") < text.index('id="faces"') < text.index('<use href="#faces"/>') < text.index('id="edges"')
    assert shades.shape == (len(places), 3)


def test_a_mesh_is_written_and_read(tmp_path: Path, scenes: list[Any]) -> None:
    mesh, path = make_mesh(20, WIDE), tmp_path / "mesh.ply"
    colours = np.random.default_rng(0).uniform(size=(len(mesh.triangles), 9))
    write_ply(path, mesh.vertices, mesh.triangles, colours, WIDE)
    same, larger = read_mesh(path, WIDE), read_mesh(path, (48, 32))
    np.testing.assert_allclose(same.vertices, mesh.vertices, atol=1e-12)
    np.testing.assert_array_equal(same.triangles, mesh.triangles)
    np.testing.assert_array_equal(same.movable, mesh.movable)
    np.testing.assert_allclose(larger.vertices, 2 * mesh.vertices, atol=1e-12)
    folded = mesh.vertices.copy()
    folded[mesh.movable.all(axis=1)] = [3.0, 3.0]
    write_ply(tmp_path / "folded.ply", folded, mesh.triangles, colours, WIDE)
    (tmp_path / "text.ply").write_text("ply")
    for name in ("folded.ply", "text.ply", "missing.ply"):
        with pytest.raises(InputError) as error:
            read_mesh(tmp_path / name, WIDE)
        assert name in error.value.what


def test_a_rendered_mesh_has_the_shape_and_the_colours_of_the_picture() -> None:
    mesh = make_mesh(6, WIDE)
    flat = render(mesh.vertices, mesh.triangles, np.full((len(mesh.triangles), 3), 0.25), WIDE, 48)
    assert flat.shape == (32, 48, 3)
    np.testing.assert_allclose(flat, 0.25)
    slanted = np.zeros((len(mesh.triangles), 9))
    centre, spread = (
        mesh.vertices[mesh.triangles].mean(axis=1),
        np.abs(mesh.vertices[mesh.triangles] - mesh.vertices[mesh.triangles].mean(axis=1)[:, None]).max(axis=(1, 2)),
    )
    slanted[:, 0], slanted[:, 3] = centre[:, 0] / 24, spread / 24  # red is x / 24 everywhere
    shown = render(mesh.vertices, mesh.triangles, slanted, WIDE, 48)
    np.testing.assert_allclose(shown[..., 0], np.broadcast_to((np.arange(48) + 0.5) / 48, (32, 48)), atol=1e-9)
