"""The triangulation demo: the loss against direct computations, the descent, what it leaves on disk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.errors import InputError, MissingPackageError

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")

from teg.examples.photo import read_target  # noqa: E402
from teg.examples.triangulation import descent, pictures, run  # noqa: E402
from teg.examples.triangulation.image_loss import ImageLoss, bounding_boxes  # noqa: E402
from teg.examples.triangulation.mesh import SHRINK, Mesh, limit_step, make_mesh, signed_areas  # noqa: E402
from teg.examples.triangulation.run import run_triangulation  # noqa: E402
from teg.examples.triangulation.scene import CompiledScene, compile_scene  # noqa: E402

SMALL: dict[str, Any] = {"triangles": 12, "size": 32, "backend": "numpy", "alone": True, "progress": False}


DRAWN = {name: getattr(pictures, name) for name in ("draw_sheet", "draw_loss")}


@pytest.fixture(autouse=True, scope="module")
def _small_pictures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name in ("SMALLEST", "FINE", "FILM_SIDE"):
            patch.setattr(pictures, name, 64)
        for name in DRAWN:  # a second each
            patch.setattr(pictures, name, lambda path, *_: Image.new("RGB", (1, 1)).save(path))
        yield


@pytest.fixture(scope="module")
def scene() -> CompiledScene:
    return compile_scene("numpy")


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dark disk on a bright ground, off the centre, with a coloured slope."""
    y, x = np.mgrid[0:64, 0:64]
    disk = (x - 26) ** 2 + (y - 35) ** 2 < 18**2
    pixels = np.stack([np.where(disk, 40, 230), np.where(disk, 60, 200), 3 * x], axis=-1).astype(np.uint8)
    path = tmp_path_factory.mktemp("photo") / "disk.png"
    Image.fromarray(pixels).save(path)
    return path


def two_halves(size: int, at: float) -> Mesh:
    """The square in two trapezia, four triangles, parted by the line x = at from the top edge to the bottom edge."""
    vertices = np.array([[0, 0], [at, 0], [size, 0], [0, size], [at, size], [size, size]], dtype=float)
    triangles = np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]])
    inner = np.zeros((6, 2), dtype=bool)
    inner[[1, 4], 0] = True
    return Mesh(vertices, triangles, inner, (size, size))


def random_target(size: int) -> np.ndarray:
    return np.random.default_rng(7).uniform(0, 1, (size, size, 3))


# -- the loss ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [2.0, 3.25, 5.999])
def test_the_loss_of_two_halves_is_the_sum_over_their_columns(scene: CompiledScene, at: float) -> None:
    size, target = 8, random_target(8)
    mesh = two_halves(size, at)
    left, right = np.array([0.2, 0.4, 0.6]), np.array([0.9, 0.1, 0.5])
    share = np.clip(at - np.arange(size), 0, 1)[None, :]  # of each pixel that lies in the left half
    errors = [np.sum((target - colour) ** 2, axis=2) for colour in (left, right)]
    expected = np.sum(share * errors[0] + (1 - share) * errors[1]) / size**2

    image = ImageLoss(scene, target, mesh.triangles)
    values = image._values(mesh.vertices, np.array([left, left, right, right]))
    assert scene.by_vertices(values) == pytest.approx(expected, rel=1e-13)

    loss, colours = image.best_colours(mesh.vertices, np.zeros((4, 3)))
    assert loss < expected
    again, same = image.best_colours(mesh.vertices, colours)
    assert again == pytest.approx(loss, rel=1e-12)
    np.testing.assert_allclose(same, colours, atol=1e-12)


def test_the_gradient_moves_the_line_by_the_difference_of_the_errors(scene: CompiledScene) -> None:
    size, at, target = 8, 3.25, random_target(8)
    mesh = two_halves(size, at)
    colours = np.array([[0.2, 0.4, 0.6]] * 2 + [[0.9, 0.1, 0.5]] * 2)
    column = target[:, 3]
    density = np.sum((column - colours[0]) ** 2, axis=1) - np.sum((column - colours[2]) ** 2, axis=1)
    gradient = ImageLoss(scene, target, mesh.triangles).gradient(mesh.vertices, colours)
    assert gradient[1, 0] + gradient[4, 0] == pytest.approx(density.sum() / size**2, rel=1e-12)


def test_on_a_pixel_border_the_gradient_is_the_mean_of_its_sides(scene: CompiledScene) -> None:
    size, target = 8, random_target(8)
    colours = np.array([[0.2, 0.4, 0.6]] * 2 + [[0.9, 0.1, 0.5]] * 2)
    image = ImageLoss(scene, target, two_halves(size, 3).triangles)
    before, there, after = (image.gradient(two_halves(size, at).vertices, colours)[[1, 4], 0].sum() for at in (3 - 1e-6, 3.0, 3 + 1e-6))
    assert before != pytest.approx(after, rel=1e-3)
    assert there == pytest.approx((before + after) / 2, rel=1e-9)


def test_the_gradient_agrees_with_differences_of_the_loss(scene: CompiledScene) -> None:
    mesh, target = make_mesh(12, 16, seed=3), random_target(16)
    image = ImageLoss(scene, target, mesh.triangles)
    random = np.random.default_rng(0)
    vertices = mesh.vertices + np.where(mesh.movable, random.uniform(-0.3, 0.3, mesh.vertices.shape), 0)
    _, colours = image.best_colours(vertices, np.zeros((len(mesh.triangles), 3)))
    gradient = np.where(mesh.movable, image.gradient(vertices, colours), 0)
    direction = np.where(mesh.movable, random.normal(size=vertices.shape), 0)
    h = 1e-5  # the colours follow the vertices: the gradient at the best ones is that of the least loss
    ahead, behind = (image.best_colours(vertices + s * h * direction, colours)[0] for s in (1, -1))
    assert np.sum(gradient * direction) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)


def test_no_overlapping_pair_is_missed() -> None:
    mesh = make_mesh(60, 24, seed=1)
    boxes = bounding_boxes(mesh.vertices[mesh.triangles], 24)
    points = np.random.default_rng(2).uniform(0, 24, (4000, 2))
    for (left, right, top, bottom), (a, b, c) in zip(boxes, mesh.vertices[mesh.triangles], strict=True):
        within = np.ones(len(points), dtype=bool)
        for p, q in ((a, b), (b, c), (c, a)):
            within &= (q[0] - p[0]) * (points[:, 1] - p[1]) > (q[1] - p[1]) * (points[:, 0] - p[0])
        for x, y in points[within].astype(int).tolist():
            assert left <= x < right
            assert top <= y < bottom


def test_backends_agree(scene: CompiledScene) -> None:
    mesh, target = make_mesh(40, 16), random_target(16)
    colours = np.full((len(mesh.triangles), 3), 0.5)
    whole = ImageLoss(scene, target, mesh.triangles).gradient(mesh.vertices, colours)
    for threads in (1, 2):
        image = ImageLoss(compile_scene("c", threads=threads), target, mesh.triangles)
        np.testing.assert_allclose(image.gradient(mesh.vertices, colours), whole, atol=1e-15)


# -- the mesh ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("triangles", [2, 3, 12, 50, 300, 2000])
def test_a_mesh_covers_the_square_with_about_as_many_triangles(triangles: int) -> None:
    mesh = make_mesh(triangles, 100)
    areas = signed_areas(mesh.vertices, mesh.triangles)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(100**2, rel=1e-12)
    assert len(areas) == pytest.approx(triangles, rel=0.1, abs=2)
    corners = {(0, 0), (0, 100), (100, 0), (100, 100)}
    assert corners == {tuple(v) for v in mesh.vertices[~mesh.movable.any(axis=1)].tolist()}


def test_no_step_folds_a_triangle() -> None:
    mesh = make_mesh(60, 50)
    vertices, random = mesh.vertices, np.random.default_rng(5)
    for _ in range(50):
        before = signed_areas(vertices, mesh.triangles)
        vertices = limit_step(mesh, vertices, random.normal(scale=8, size=vertices.shape))
        after = signed_areas(vertices, mesh.triangles)
        assert (after >= np.minimum(before, np.maximum(SHRINK * before, mesh.floor))).all()
        assert after.sum() == pytest.approx(50**2, rel=1e-12)
    assert np.ptp(vertices, axis=0).tolist() == [50, 50]


# -- the run -----------------------------------------------------------------------------------------------------------


def test_the_loss_falls_and_everything_is_written(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, draw in DRAWN.items():
        monkeypatch.setattr(pictures, name, draw)
    report = run_triangulation(photo, steps=6, out=tmp_path, **SMALL)
    losses = report["losses"]
    assert len(losses) == 7
    assert (np.diff(losses) < 0).all()
    assert report["loss"]["ratio"] < 0.8
    assert report["mesh"]["smallest_area"] > 0
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    for picture in ("before.png", "after.png", "target.png"):
        with Image.open(tmp_path / picture) as image:
            assert image.size == (64, 64)
    assert (tmp_path / "loss.png").stat().st_size > 1000
    assert (tmp_path / "sheet.png").stat().st_size > 5000
    assert (tmp_path / "mesh.svg").read_text().count("<path") == report["mesh"]["triangles"] + 1
    assert not list(tmp_path.glob("*.partial"))
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/") == len(report["pictures"])
    assert 'src="http' not in page
    with Image.open(tmp_path / "descent.gif") as animation:
        assert animation.n_frames == 7


def test_a_resumed_run_ends_where_an_uninterrupted_one_does(photo: Path, tmp_path: Path) -> None:
    whole = run_triangulation(photo, steps=6, out=tmp_path / "whole", **SMALL)
    run_triangulation(photo, steps=2, out=tmp_path / "parts", **SMALL)
    resumed = run_triangulation(photo, steps=6, out=tmp_path / "parts", resume=True, **SMALL)
    assert resumed["losses"] == whole["losses"]
    whole_file, parts_file = (tmp_path / name / "checkpoint.npz" for name in ("whole", "parts"))
    with np.load(whole_file) as first, np.load(parts_file) as second:
        for name in ("vertices", "colours", "gradient", "memory"):
            np.testing.assert_array_equal(first[name], second[name])
    for picture in ("before.png", "after.png"):
        assert (tmp_path / "whole" / picture).read_bytes() == (tmp_path / "parts" / picture).read_bytes()


def test_a_checkpoint_of_another_run_is_refused(photo: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing to resume"):
        run_triangulation(photo, steps=1, out=tmp_path, resume=True, **SMALL)
    run_triangulation(photo, steps=1, out=tmp_path, **SMALL)
    with pytest.raises(InputError, match="triangles was 12, is 20"):
        run_triangulation(photo, steps=1, out=tmp_path, resume=True, **(SMALL | {"triangles": 20}))
    (tmp_path / "checkpoint.npz").write_bytes(b"PK\x03\x04 and then nothing")
    with pytest.raises(InputError, match="cannot be read"):
        run_triangulation(photo, steps=1, out=tmp_path, resume=True, **SMALL)


def test_ignoring_discontinuities_moves_nothing(photo: Path, tmp_path: Path) -> None:
    report = run_triangulation(photo, steps=3, out=tmp_path, discontinuities="ignore", **SMALL)
    assert report["mesh"]["largest_movement"] == 0
    assert report["loss"]["end"] == report["loss"]["start"]
    assert "exactly 0" in report["note"]


def test_an_interrupt_writes_what_there_is(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted_at_the_third(image: ImageLoss, state: descent.State, size: tuple[int, int], optimiser: str) -> descent.State:
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return descent.next_state(image, state, size, optimiser)

    calls: list[int] = []
    monkeypatch.setattr(run, "next_state", interrupted_at_the_third)
    report = run_triangulation(photo, steps=6, out=tmp_path, **SMALL)
    assert report["interrupted"]
    assert report["steps"] == 2
    assert (tmp_path / "after.png").exists()
    monkeypatch.undo()
    resumed = run_triangulation(photo, steps=6, out=tmp_path, resume=True, **SMALL)
    assert resumed["losses"][:3] == report["losses"]
    assert resumed["steps"] == 6


@pytest.mark.slow
def test_the_default_run_meets_its_goal(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    report = run_triangulation(out=tmp_path, steps=40, alone=True, progress=False)
    assert report["loss"]["ratio"] < 0.6


# -- the photo ---------------------------------------------------------------------------------------------------------


def test_a_photo_that_cannot_be_used_is_an_input_error(tmp_path: Path) -> None:
    text = tmp_path / "notes.jpg"
    text.write_text("not a picture")
    damaged = tmp_path / "damaged.png"
    Image.new("RGB", (64, 64), "red").save(damaged)
    damaged.write_bytes(damaged.read_bytes()[:60])
    for path in (tmp_path / "missing.jpg", tmp_path / "no folder" / "photo.jpg", tmp_path, text, damaged):
        with pytest.raises(InputError) as error:
            run_triangulation(path, out=tmp_path / "out", **SMALL)
        assert path.name in error.value.what
        assert error.value.hint


def test_a_photo_is_cropped_turned_and_laid_on_white(tmp_path: Path) -> None:
    wide = np.zeros((20, 60, 3), dtype=np.uint8)
    wide[:, 20:40] = 255
    Image.fromarray(wide).save(tmp_path / "wide.png")
    assert read_target(tmp_path / "wide.png", 10).min() > 0.99

    Image.new("RGBA", (30, 30), (255, 0, 0, 0)).save(tmp_path / "clear.png")
    assert read_target(tmp_path / "clear.png", 10).min() == 1.0

    half = np.zeros((32, 32, 3), dtype=np.uint8)
    half[:16] = 255
    turned = Image.Exif()
    turned[0x0112] = 3  # the camera was upside down
    Image.fromarray(half).save(tmp_path / "turned.png", exif=turned)
    assert read_target(tmp_path / "turned.png", 8)[:, 0, 0].round().tolist() == [0] * 4 + [1] * 4

    deep = Image.fromarray(np.full((16, 16), 32768, dtype=np.uint16))
    deep.save(tmp_path / "deep.png")
    assert read_target(tmp_path / "deep.png", 8) == pytest.approx(0.5, abs=0.01)

    for white in (1.0, 255.0, 65535.0):
        Image.fromarray(np.linspace(0.0, white, 64, dtype=np.float32).reshape(8, 8)).save(tmp_path / "numbers.tif")
        assert read_target(tmp_path / "numbers.tif", 8)[-1, :, 0] == pytest.approx(np.arange(56, 64) / 63, abs=0.01)

    for mode in ("1", "L", "LA", "P", "CMYK"):
        path = tmp_path / f"mode.{'tif' if mode == 'CMYK' else 'png'}"
        Image.new(mode, (9, 9)).save(path)
        assert read_target(path, 8).shape == (8, 8, 3)


@pytest.mark.parametrize(
    "options",
    [{"size": 3}, {"triangles": 1}, {"triangles": 10**6}, {"steps": -1}, {"seed": -1}, {"colours": "cubic"}, {"refine": 2.5}, {"depth": 1}],
    ids=str,
)
def test_numbers_that_make_no_picture_are_input_errors(photo: Path, tmp_path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        run_triangulation(photo, out=tmp_path, **(SMALL | options))


def test_a_folder_that_is_a_file_is_an_input_error(photo: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        run_triangulation(photo, out=tmp_path / "out", **SMALL)


def test_a_missing_package_is_named(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(run.PACKAGES, "a_package_that_is_not_there", "thing")
    with pytest.raises(MissingPackageError, match="thing") as error:
        run_triangulation(photo, out=tmp_path, **SMALL)
    assert "teg-compiler[demo]" in error.value.hint


def test_a_picture_of_one_colour_is_not_descended(tmp_path: Path) -> None:
    Image.new("RGB", (20, 30), "teal").save(tmp_path / "teal.png")
    report = run_triangulation(tmp_path / "teal.png", out=tmp_path / "out", steps=5, **SMALL)
    assert report["steps"] == 0
    assert report["converged"]
    assert "nothing to descend" in report["summary"][0]
    assert report["psnr"]["end"] == pytest.approx(124.77, abs=0.01)


def test_a_descent_that_gains_nothing_any_more_has_converged(tmp_path: Path) -> None:
    photo = tmp_path / "photo.png"
    Image.fromarray(np.tril(np.full((12, 12), 255, dtype=np.uint8), 2)).save(photo)
    report = run_triangulation(photo, tmp_path / "out", progress=False, size=12, triangles=6, steps=2000, alone=True, backend="numpy")
    assert report["converged"]
    assert 20 < report["steps"] < 2000
    assert report["losses"][-21] - report["losses"][-1] <= 1e-5 * report["losses"][-1]
    assert "converged" in report["summary"][0]
