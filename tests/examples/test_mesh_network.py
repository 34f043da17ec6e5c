"""The mesh network demo: its loss against the triangulation's, its gradients, what it learns, what it leaves on disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.__main__ import main
from teg.errors import InputError, MissingPackageError

jax = pytest.importorskip("jax")
pytest.importorskip("optax")
Image = pytest.importorskip("PIL.Image")
pytest.importorskip("skimage")
pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")
jnp = jax.numpy

from teg.examples.mesh_network import run, training  # noqa: E402
from teg.examples.mesh_network.coverage import Cover, exact_cover, sampled_cover  # noqa: E402
from teg.examples.mesh_network.crops import cut_crops  # noqa: E402
from teg.examples.mesh_network.mesh import CELL, REACH, GridMesh, make_mesh, signed_areas  # noqa: E402
from teg.examples.mesh_network.mesh_loss import best_colours, mesh_loss  # noqa: E402
from teg.examples.mesh_network.network import first_weights, predict_vertices  # noqa: E402
from teg.examples.mesh_network.run import run_mesh_network  # noqa: E402
from teg.examples.mesh_network.training import State, Trainer  # noqa: E402
from teg.examples.triangulation.image_loss import ImageLoss  # noqa: E402
from teg.examples.triangulation.scene import compile_scene  # noqa: E402

SMALL: dict[str, Any] = {"cells": 4, "progress": False}
random = np.random.default_rng


def disk(size: int, x: float, y: float, radius: float) -> np.ndarray:
    """A dark disk on a bright ground."""
    rows, columns = np.mgrid[0:size, 0:size]
    inside = (columns - x) ** 2 + (rows - y) ** 2 < radius**2
    return np.where(inside[..., None], [0.2, 0.3, 0.1], [0.9, 0.8, 0.9]).astype(np.float32)


@pytest.fixture(scope="module")
def cover() -> Cover:
    return exact_cover()


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photo") / "disk.png"
    Image.fromarray(np.rint(255 * disk(64, 26, 35, 18)).astype(np.uint8)).save(path)
    return path


@pytest.fixture(scope="module")
def trainers(cover: Cover) -> Callable[..., Trainer]:
    """Trainers with few crops, of disks, compiled once: what a run changes is its state only."""
    made: dict[tuple[int, int], Trainer] = {}
    disks = [disk(24, 11.5 + k, 12.3 - k, 7.1 + k) for k in range(3)]

    def trainer(_: Cover, photos: Any, held_out: np.ndarray, mesh: GridMesh, seed: int) -> Trainer:
        key = (mesh.cells, seed)
        if key not in made:
            made[key] = Trainer(cover, disks, held_out, mesh, seed, crops=16, batch=4)
        return made[key]

    return trainer


@pytest.fixture
def few_crops(trainers: Callable[..., Trainer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "Trainer", trainers)


def moved(mesh: GridMesh, seed: int = 0, far: float = 1.5) -> np.ndarray:
    return np.asarray(mesh.vertices + mesh.movable * random(seed).uniform(-far, far, mesh.vertices.shape), dtype=np.float32)


# -- the mesh ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cells", [1, 2, 5])
def test_the_grid_covers_the_picture(cells: int) -> None:
    mesh = make_mesh(cells)
    areas = signed_areas(mesh.vertices, mesh.triangles)
    np.testing.assert_array_equal(areas, CELL**2 / 2)
    assert len(areas) == 2 * cells**2
    corners = {(0, 0), (0, mesh.size), (mesh.size, 0), (mesh.size, mesh.size)}
    assert corners == {tuple(v) for v in mesh.vertices[~mesh.movable.any(axis=1)].tolist()}


def test_windows_hold_all_pixels_that_a_triangle_can_touch() -> None:
    mesh = make_mesh(4)
    for seed in range(20):
        corners = moved(mesh, seed, REACH)[mesh.triangles]
        first, last = np.floor(corners.min(axis=1)), np.ceil(corners.max(axis=1)) - 1
        assert (mesh.pixels.min(axis=(1, 2)) <= first).all()
        assert (mesh.pixels.max(axis=(1, 2)) >= last).all()
    assert mesh.pixels.min() == 0
    assert mesh.pixels.max() == mesh.size - 1


def test_crops_are_squares_of_the_photos_the_same_for_the_same_seed() -> None:
    photos = [random(k).uniform(0, 1, (n, n, 3)) for k, n in enumerate((20, 31))]
    crops = cut_crops(photos, 16, 5, (3, 1))
    assert crops.shape == (5, 16, 16, 3)
    np.testing.assert_array_equal(crops, cut_crops(photos, 16, 5, (3, 1)))
    assert not np.array_equal(crops, cut_crops(photos, 16, 5, (3, 2)))
    every = {tuple(p) for photo in photos for p in photo.reshape(-1, 3).tolist()}
    assert {tuple(p) for p in crops.reshape(-1, 3).tolist()} <= every


# -- the loss ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_loss_gradient_and_colours_are_those_of_the_triangulation(cover: Cover) -> None:
    """Another program, with arrays, colours as parameters and the pixels of bounding boxes, in NumPy."""
    mesh = make_mesh(3)
    picture = random(1).uniform(0, 1, (mesh.size, mesh.size, 3)).astype(np.float32)
    vertices = moved(mesh)
    image = ImageLoss(compile_scene("numpy"), picture, mesh.triangles)
    loss, colours = image.best_colours(vertices, np.full((len(mesh.triangles), 3), 0.5))
    found, slopes = jax.jit(jax.value_and_grad(lambda v: mesh_loss(cover, mesh, v, picture)))(vertices)
    assert float(found) == pytest.approx(loss, rel=1e-5)
    np.testing.assert_allclose(best_colours(cover, mesh, vertices, picture), colours, atol=1e-5)
    wanted = image.gradient(vertices, colours)  # at the best colours it is that of the least loss
    np.testing.assert_allclose(slopes, wanted, atol=1e-5 * np.abs(wanted).max())


@pytest.mark.slow
def test_sampled_triangles_have_the_same_loss_and_no_gradient(cover: Cover) -> None:
    mesh, picture = make_mesh(2), random(3).uniform(0, 1, (2 * CELL, 2 * CELL, 3)).astype(np.float32)
    vertices = moved(mesh, far=1.0)
    exact = float(mesh_loss(cover, mesh, vertices, picture))
    loss, slopes = jax.value_and_grad(lambda v: mesh_loss(sampled_cover, mesh, v, picture))(jnp.asarray(vertices))
    assert float(loss) == pytest.approx(exact, rel=0.1)
    assert not slopes.any()


@pytest.mark.slow
def test_a_fold_costs(cover: Cover) -> None:
    """Over a picture of one colour every mesh is exact, folded or not; else what is covered twice is paid for twice."""
    mesh = make_mesh(2)
    vertices = mesh.vertices.copy()
    vertices[4] = [-2.0, 4.0]  # the one in the middle, beyond the left side
    assert signed_areas(vertices, mesh.triangles).min() < 0
    grey, picture = jnp.full((8, 8, 3), 0.5), jnp.asarray(random(4).uniform(0, 1, (8, 8, 3)).astype(np.float32))
    assert abs(float(mesh_loss(cover, mesh, vertices, grey))) < 1e-6
    assert float(mesh_loss(cover, mesh, vertices, picture)) > float(mesh_loss(cover, mesh, mesh.vertices, picture))


@pytest.mark.slow
def test_the_first_mesh_is_the_grid_and_no_weights_take_it_out_of_reach() -> None:
    mesh = make_mesh(3)
    pictures = jnp.asarray(random(5).uniform(0, 1, (2, mesh.size, mesh.size, 3)).astype(np.float32))
    weights = first_weights(0)
    np.testing.assert_array_equal(predict_vertices(weights, mesh, pictures), np.broadcast_to(mesh.vertices, (2, 16, 2)))
    weights["movement"] = (weights["movement"][0] + 9.0, weights["movement"][1])
    vertices = np.asarray(predict_vertices(weights, mesh, pictures))
    assert np.abs(vertices - mesh.vertices).max() == pytest.approx(REACH, rel=1e-3)
    still = mesh.movable == 0
    np.testing.assert_array_equal(vertices[:, still], np.broadcast_to(mesh.vertices[still], (2, still.sum())))


# -- the run -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.usefixtures("few_crops")
def test_the_network_learns_and_a_resumed_run_ends_where_an_uninterrupted_one_does(
    photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trainers: Callable[..., Trainer]
) -> None:
    report = run_mesh_network(photo, epochs=8, out=tmp_path / "whole", **SMALL)
    assert len(report["losses"]) == 9
    assert np.mean(report["training"][-3:]) < 0.8
    assert report["loss"]["ratio"] < 0.98
    assert report["sampled"]["largest_slope"] == 0
    assert 0 < report["mesh"]["largest_movement"] < REACH * 2**0.5
    assert json.loads((tmp_path / "whole" / "run.json").read_text(encoding="utf-8")) == report
    assert (tmp_path / "whole" / "before.png").read_bytes() != (tmp_path / "whole" / "after.png").read_bytes()
    for picture in report["pictures"]:
        assert Path(picture).stat().st_size > 1000
    assert not list((tmp_path / "whole").glob("*.partial"))

    def interrupted_at_the_fourth(state: State) -> State:
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return go_on(state)

    calls: list[int] = []
    trainer = trainers(None, None, None, make_mesh(4), 0)
    go_on = trainer.next_state
    monkeypatch.setattr(trainer, "next_state", interrupted_at_the_fourth)
    partial = run_mesh_network(photo, epochs=8, out=tmp_path / "parts", **SMALL)
    assert partial["interrupted"]
    assert partial["epochs"] == 3
    monkeypatch.setattr(trainer, "next_state", go_on)
    resumed = run_mesh_network(photo, epochs=8, out=tmp_path / "parts", resume=True, **SMALL)
    assert resumed["losses"] == report["losses"]
    with np.load(tmp_path / "whole" / "checkpoint.npz") as first, np.load(tmp_path / "parts" / "checkpoint.npz") as second:
        np.testing.assert_array_equal(first["numbers"], second["numbers"])
    assert (tmp_path / "whole" / "after.png").read_bytes() == (tmp_path / "parts" / "after.png").read_bytes()

    with pytest.raises(InputError, match="nothing to resume"):
        run_mesh_network(photo, epochs=8, out=tmp_path / "none", resume=True, **SMALL)
    with pytest.raises(InputError, match="discontinuities was 'exact', is 'ignore'"):
        run_mesh_network(photo, epochs=8, out=tmp_path / "parts", resume=True, discontinuities="ignore", **SMALL)


@pytest.mark.slow
def test_without_the_motion_of_edges_nothing_is_learnt(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Trainer
    monkeypatch.setattr(training, "Trainer", lambda *args: real(*args, crops=8, batch=8))
    report = run_mesh_network(photo, epochs=3, out=tmp_path, discontinuities="ignore", **SMALL)
    assert report["loss"]["ratio"] == 1
    assert report["training"] == [1.0]
    assert report["mesh"]["largest_movement"] == 0
    assert "exactly 0" in report["note"]


@pytest.mark.slow
@pytest.mark.usefixtures("few_crops")
def test_the_command_line(photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--cells", "4", "--epochs", "1", "--quiet", "-o", str(tmp_path)]
    assert main(["demo", "mesh-network", str(photo), *small]) == 0
    out = capsys.readouterr().out
    assert "after 1 epochs" in out
    assert "mesh_network.png" in out


@pytest.mark.parametrize("options", [{"cells": 3}, {"cells": 1000}, {"epochs": -1}, {"seed": -1}], ids=str)
def test_numbers_that_make_no_picture_are_input_errors(photo: Path, tmp_path: Path, options: dict[str, int]) -> None:
    with pytest.raises(InputError) as error:
        run_mesh_network(photo, out=tmp_path, **(SMALL | options))
    assert error.value.hint


def test_photos_folders_and_packages_that_are_missing_are_told(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="missing"):
        run_mesh_network(tmp_path / "missing.jpg", out=tmp_path, **SMALL)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        run_mesh_network(photo, out=tmp_path / "file", **SMALL)
    monkeypatch.setitem(run.PACKAGES, "a_package_that_is_not_there", "thing")
    with pytest.raises(MissingPackageError, match="thing") as error:
        run_mesh_network(photo, out=tmp_path, **SMALL)
    assert "teg-compiler[network]" in error.value.hint
