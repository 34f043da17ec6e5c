"""Meshes that are edited: penalties on their shape, pinned vertices, colours that stay, and files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.errors import InputError

pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")

from teg.examples.options import resolved
from teg.examples.triangulation.descent import State, first_state, next_state
from teg.examples.triangulation.image_loss import ImageLoss
from teg.examples.triangulation.mesh import inner, make_mesh, pin_border, signed_areas
from teg.examples.triangulation.mesh_files import read_mesh, write_obj, write_ply
from teg.examples.triangulation.refinement import refine
from teg.examples.triangulation.regularisers import Penalty
from teg.examples.triangulation.run import _first_mesh
from teg.examples.triangulation.scene import CompiledScene, compile_scene

WIDE = (24, 16)


@pytest.fixture(scope="module")
def scene() -> CompiledScene:
    return compile_scene("c")


def target() -> np.ndarray:
    x, y = np.meshgrid(np.arange(WIDE[0]) + 0.5, np.arange(WIDE[1]) + 0.5)
    inside = (x - 9) ** 2 + (y - 7) ** 2 < 30
    return np.stack([np.where(inside, 0.9, 0.2), np.where(inside, 0.1, 0.8), x / 24], axis=-1)


def descended(image: ImageLoss, state: State, steps: int = 12) -> State:
    for _ in range(steps):
        if not state.stuck:
            state = next_state(image, state, WIDE)
    return state


def test_the_penalty_is_what_it_says_and_has_its_derivatives() -> None:
    mesh = make_mesh(20, WIDE, seed=4)
    penalty = Penalty(mesh, 0.3, 0.7, "numpy")
    corners, count = mesh.vertices[mesh.triangles], len(mesh.triangles)
    edges = np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=(1, 2)) / (3 * mesh.cell**2)
    shares = (0.3 * edges + 0.7 * mesh.area / count / signed_areas(mesh.vertices, mesh.triangles)) / count
    np.testing.assert_allclose(penalty.of_triangles(mesh.vertices, mesh.triangles), shares, rtol=1e-12)
    h, direction = 1e-5, np.random.default_rng(0).normal(size=mesh.vertices.shape)
    ahead, behind = mesh.vertices + h * direction, mesh.vertices - h * direction
    slope = (penalty.of_triangles(ahead, mesh.triangles).sum() - penalty.of_triangles(behind, mesh.triangles).sum()) / (2 * h)
    assert np.sum(penalty.gradient(mesh.vertices, mesh.triangles) * direction) == pytest.approx(slope, rel=1e-6)
    turn = (penalty.gradient(ahead, mesh.triangles) - penalty.gradient(behind, mesh.triangles)) / (2 * h)
    np.testing.assert_allclose(penalty.hessian_product(mesh.vertices, mesh.triangles, direction), turn, atol=1e-6 * np.abs(turn).max())


def test_penalties_keep_triangles_large_and_edges_short(scene: CompiledScene) -> None:
    mesh = make_mesh(40, WIDE)

    def end(smoothness: float, keep_area: float) -> State:
        image = ImageLoss(scene, target(), mesh.triangles, Penalty(mesh, smoothness, keep_area, "c"))
        state = first_state(mesh, image)
        after = descended(image, state)
        assert after.loss < state.loss
        return after

    def smallest(state: State) -> float:
        return float(signed_areas(state.vertices, state.triangles).min())

    def edges(state: State) -> float:
        corners = state.vertices[state.triangles]
        return float(np.sum((corners - np.roll(corners, 1, axis=1)) ** 2))

    bare = end(0, 0)
    assert smallest(end(0, 0.05)) > 2 * smallest(bare)
    assert edges(end(1.0, 0)) < edges(bare)


def test_a_refinement_counts_penalties_and_keeps_pins(scene: CompiledScene) -> None:
    mesh = pin_border(make_mesh(40, WIDE))
    stays = np.flatnonzero(mesh.movable.all(axis=1))[3]
    pinned = replace(mesh, movable=mesh.movable & (np.arange(len(mesh.vertices)) != stays)[:, None])
    image = ImageLoss(scene, target(), mesh.triangles, Penalty(mesh, 0.01, 0.001, "c"))
    before = descended(image, first_state(pinned, image), 6)
    after = refine(image, before, WIDE, pinned_border=True)
    assert not np.array_equal(after.triangles, before.triangles)
    assert after.loss < before.loss
    loss, _ = image.best_colours(after.vertices, after.colours)
    assert after.loss == pytest.approx(loss, rel=1e-12)
    border = ~inner(after.vertices, WIDE).all(axis=1)
    assert not after.movable[border].any()
    end = descended(image, after, 4)
    assert mesh.vertices[stays].tolist() in end.vertices.tolist()
    np.testing.assert_array_equal(end.vertices[border], after.vertices[border])


def test_colours_that_are_kept_have_the_gradient_of_their_loss(scene: CompiledScene) -> None:
    mesh = make_mesh(30, WIDE, seed=2)
    shades = np.random.default_rng(1).uniform(size=(len(mesh.triangles), 3))
    image = ImageLoss(scene, target(), mesh.triangles, keep_colours=True)
    state = first_state(replace(mesh, colours=shades), image)
    np.testing.assert_array_equal(state.colours, shades)
    end = descended(image, state)
    np.testing.assert_array_equal(end.colours, shades)
    assert end.loss < state.loss


def test_files_keep_places_colours_and_pins(tmp_path: Path) -> None:
    mesh = make_mesh(20, WIDE)
    shades = np.random.default_rng(0).uniform(size=(len(mesh.triangles), 3))
    pinned = np.arange(len(mesh.vertices)) % 2 == 0
    write_ply(tmp_path / "mesh.ply", mesh.vertices, mesh.triangles, shades, WIDE, pinned)
    write_obj(tmp_path / "mesh.obj", mesh.vertices, mesh.triangles, shades)
    for name in ("mesh.ply", "mesh.obj"):
        same = read_mesh(tmp_path / name, WIDE)
        np.testing.assert_allclose(same.vertices, mesh.vertices, atol=1e-12)
        np.testing.assert_array_equal(same.triangles, mesh.triangles)
        assert same.colours is not None
        np.testing.assert_array_equal(same.colours, shades)
        np.testing.assert_array_equal(same.movable, mesh.movable & (name == "mesh.obj" or ~pinned[:, None]))
    (tmp_path / "mesh.mtl").unlink()
    assert read_mesh(tmp_path / "mesh.obj", WIDE).colours is None


def test_colours_in_bytes_and_properties_in_another_order(tmp_path: Path) -> None:
    lines = [
        "ply",
        "format ascii 1.0",
        "element vertex 4",
        "property uchar pinned",
        "property float y",
        "property float x",
        "element face 2",
    ]
    lines += ["property list uchar int vertex_indices", *(f"property uchar {c}" for c in ("red", "green", "blue")), "end_header"]
    lines += ["0 0 0", "1 0 1", "0 1 1", "0 1 0", "3 0 1 2 255 51 0", "3 0 2 3 0 0 255"]
    path = tmp_path / "square.ply"
    path.write_text("\n".join(lines) + "\n")
    mesh = read_mesh(path, (8, 8))
    assert mesh.colours is not None
    np.testing.assert_allclose(mesh.colours, [[1, 0.2, 0], [0, 0, 1]])
    assert mesh.vertices.tolist() == [[0, 0], [8, 0], [8, 8], [0, 8]]


@pytest.mark.parametrize(
    "options",
    [
        {"keep_colours": True},
        {"keep_colours": True, "mesh": "mesh.ply", "refine": 3},
        {"keep_colours": True, "mesh": "mesh.ply", "colours": "linear"},
        {"shared_by": "pairs", "backend": "jax", "smoothness": 1.0},
    ],
    ids=str,
)
def test_options_that_exclude_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any]) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = make_mesh(20, WIDE)
    write_ply(Path("mesh.ply"), mesh.vertices, mesh.triangles, np.full((len(mesh.triangles), 3), 0.5), WIDE)
    with pytest.raises(InputError) as error:
        _first_mesh(resolved("triangulation", options), WIDE)
    assert error.value.hint


@pytest.mark.parametrize("penalised", [False, True])
def test_products_of_the_hessian_are_those_of_the_least_loss(scene: CompiledScene, penalised: bool) -> None:
    mesh, picture = make_mesh(20, WIDE, seed=5), np.random.default_rng(3).uniform(size=(16, 24, 3))
    image = ImageLoss(scene, picture, mesh.triangles, Penalty(mesh, 0.1, 0.01, "c") if penalised else None)
    direction = np.where(mesh.movable, np.random.default_rng(0).normal(size=mesh.vertices.shape), 0)
    vertices = mesh.vertices + 0.1 * direction  # no edge along a border of pixels, where the gradient jumps
    colours = first_state(replace(mesh, vertices=vertices), image).colours
    ahead, behind = (
        image.gradient(places, image.best_colours(places, colours)[1])[mesh.movable]
        for places in (vertices + 1e-5 * direction, vertices - 1e-5 * direction)
    )
    product = image.hessian_product(vertices, colours, direction)[mesh.movable]
    np.testing.assert_allclose(product, (ahead - behind) / 2e-5, atol=1e-8 * np.abs(product).max())


def test_newton_steps_lower_the_loss(scene: CompiledScene) -> None:
    mesh = make_mesh(20, WIDE)
    image = ImageLoss(scene, target(), mesh.triangles)
    state = first_state(mesh, image)
    for _ in range(8):
        after = next_state(image, state, WIDE, "newton")
        assert after.loss < state.loss
        assert signed_areas(after.vertices, after.triangles).min() > 0
        state = after
    assert state.loss < 0.7 * image.best_colours(mesh.vertices, state.colours)[0]
