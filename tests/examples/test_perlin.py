"""The Perlin demo: the loss and its gradient against direct computations, the descent, what it leaves on disk."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from teg.__main__ import main
from teg.errors import InputError, MissingPackageError

Image = pytest.importorskip("PIL.Image")
pytest.importorskip("scipy")
pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")

from teg.examples.perlin import pictures, run, shader_loss  # noqa: E402
from teg.examples.perlin.descent import State, first_state, next_state  # noqa: E402
from teg.examples.perlin.noise import BLENDS, PERSISTENCE, make_noise  # noqa: E402
from teg.examples.perlin.run import run_perlin, simple_approximations  # noqa: E402
from teg.examples.perlin.scene import CORNERS, TARGET, CompiledScene, colour_names, compile_scene  # noqa: E402
from teg.examples.perlin.shader_loss import ShaderLoss  # noqa: E402

ABOVE, BELOW = tuple(colour_names(2)[:3]), tuple(colour_names(2)[3:])
AFTER_GRADIENTS = 7  # parameters: a threshold and two colours
SMALL: dict[str, Any] = {"size": 16, "cells": 3, "octaves": 2, "levels": 2, "backend": "numpy", "progress": False}


@cache
def compiled(backend: Any, discontinuities: Any, _threads: int, levels: int) -> CompiledScene:
    return compile_scene(backend, discontinuities, levels=levels)


@pytest.fixture(autouse=True, scope="module")
def _small_pictures() -> Iterator[None]:
    """Of scenes that are compiled once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "SMALLEST", 64)
        patch.setattr(run, "compile_scene", compiled)
        yield
    compiled.cache_clear()


@pytest.fixture(scope="module")
def scene() -> CompiledScene:
    return compiled("numpy", "exact", 1, 2)


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dark disk on a bright ground, off the centre."""
    y, x = np.mgrid[0:64, 0:64]
    disk = (x - 26) ** 2 + (y - 35) ** 2 < 18**2
    pixels = np.stack([np.where(disk, 40, 230), np.where(disk, 60, 200), np.where(disk, 90, 170)], axis=-1).astype(np.uint8)
    path = tmp_path_factory.mktemp("photo") / "disk.png"
    Image.fromarray(pixels).save(path)
    return path


def small_shader(scene: CompiledScene, size: int = 8, seed: int = 0) -> tuple[ShaderLoss, np.ndarray]:
    """A shader against a random picture, and random parameters."""
    random = np.random.default_rng(seed)
    noise, gradients = make_noise(size, 2, 2, seed)
    parameters = np.concatenate([gradients, [0.05], random.uniform(0, 1, 6)])
    return ShaderLoss(scene, noise, random.uniform(0, 1, (size, size, 3))), parameters


# -- the loss ----------------------------------------------------------------------------------------------------------


def test_a_pixel_cut_by_a_line_is_the_sum_of_its_two_parts(scene: CompiledScene) -> None:
    colours = dict(zip(ABOVE + BELOW + TARGET, np.linspace(0.1, 0.9, 9).tolist(), strict=True))
    corners = dict(zip(CORNERS, (-0.25, 0.75, -0.25, 0.75), strict=True)) | {"threshold_0": 0.0}  # above where x > ¼
    above, below, target = (np.array([colours[k] for k in names]) for names in (ABOVE, BELOW, TARGET))
    expected = 0.75 * np.sum((above - target) ** 2) + 0.25 * np.sum((below - target) ** 2)
    loss, slopes = scene.loss.value_and_grad(corners | colours)
    assert loss == pytest.approx(expected, rel=1e-14)
    np.testing.assert_allclose(scene.colour(corners | {k: colours[k] for k in ABOVE + BELOW}), 0.75 * above + 0.25 * below, rtol=1e-14)
    jump = np.sum((above - target) ** 2) - np.sum((below - target) ** 2)
    assert sum(slopes[k] for k in CORNERS) == pytest.approx(jump, rel=1e-13)  # raising all moves the line by as much


def test_the_gradient_agrees_with_differences_of_the_loss(scene: CompiledScene) -> None:
    shader, parameters = small_shader(scene)
    _, gradient = shader.value_and_gradient(parameters)
    random, h = np.random.default_rng(1), 1e-5
    shown = [*random.choice(len(parameters) - AFTER_GRADIENTS, 12, replace=False), *range(-AFTER_GRADIENTS, 0)]
    assert np.count_nonzero(gradient[shown]) > 12
    for k in shown:
        step = np.zeros(len(parameters))
        step[k] = h
        ahead, behind = (shader.value_and_gradient(parameters + s * step)[0] for s in (1, -1))
        assert gradient[k] == pytest.approx((ahead - behind) / (2 * h), rel=1e-6, abs=1e-10)
    direction = random.normal(size=len(parameters))
    ahead, behind = (shader.value_and_gradient(parameters + s * h * direction)[0] for s in (1, -1))
    assert gradient @ direction == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)


def test_three_colours_have_two_borders_and_the_gradient_agrees_with_differences() -> None:
    random, h = np.random.default_rng(3), 1e-5
    noise, gradients = make_noise(8, 2, 2)
    shader = ShaderLoss(compile_scene("numpy", levels=3), noise, random.uniform(0, 1, (8, 8, 3)))
    parameters = np.concatenate([gradients, [0.2, -0.1], random.uniform(0, 1, 9)])
    _, gradient = shader.value_and_gradient(parameters)
    for k in (*random.choice(len(gradients), 6, replace=False), *range(-11, 0)):
        step = np.zeros(len(parameters))
        step[k] = h
        ahead, behind = (shader.value_and_gradient(parameters + s * step)[0] for s in (1, -1))
        assert gradient[k] == pytest.approx((ahead - behind) / (2 * h), rel=1e-5, abs=1e-9)
    shown = shader.picture(parameters, 8)  # almost all of these pixels have one colour
    colours = parameters[-9:].reshape(3, 3)
    distance = np.abs(shown[..., None, :] - colours).max(axis=-1)
    assert (distance.min(axis=-1) < 1e-12).mean() > 0.7
    assert set(np.argmin(distance, axis=-1)[distance.min(axis=-1) < 1e-12]) == {0, 1, 2}


def test_maps_of_colours_are_interpolated_and_their_gradient_agrees_with_differences(scene: CompiledScene) -> None:
    random, h = np.random.default_rng(5), 1e-5
    noise, gradients = make_noise(8, 2, 2)
    shader = ShaderLoss(scene, noise, random.uniform(0, 1, (8, 8, 3)), colour_cells=2)
    even, ramp = (shader.tints.down @ shade for shade in shader.tints.along(np.array([np.ones(9), np.tile([0.0, 1, 2], 3)])))
    np.testing.assert_allclose(even, np.ones((8, 8)))
    np.testing.assert_allclose(ramp, np.tile((np.arange(8) + 0.5) / 4, (8, 1)))
    parameters = np.concatenate([gradients, [0.1], random.uniform(0, 1, 6 * 9)])
    _, gradient = shader.value_and_gradient(parameters)
    for k in random.choice(54, 8, replace=False) - 54:
        step = np.zeros(len(parameters))
        step[k] = h
        ahead, behind = (shader.value_and_gradient(parameters + s * step)[0] for s in (1, -1))
        assert gradient[k] == pytest.approx((ahead - behind) / (2 * h), rel=1e-5, abs=1e-9)
    even = np.concatenate([gradients, [0.1], np.repeat(np.arange(6) / 6, 9)])
    one = ShaderLoss(scene, noise, np.zeros((8, 8, 3)))
    np.testing.assert_allclose(shader.picture(even, 2), one.picture(np.concatenate([gradients, [0.1], np.arange(6) / 6]), 2), atol=1e-14)


@pytest.mark.parametrize("colour_cells", [0, 2])
def test_a_picture_may_be_cut_into_bands_of_rows(scene: CompiledScene, monkeypatch: pytest.MonkeyPatch, colour_cells: int) -> None:
    random = np.random.default_rng(6)
    noise, gradients = make_noise((8, 7), 2, 2)
    target, loss, slopes = random.uniform(0, 1, (7, 8, 3)), [], []
    for pixels in (1000, 3 * 8):
        monkeypatch.setattr(shader_loss, "BAND", pixels)
        shader = ShaderLoss(scene, noise, target, colour_cells)
        value, gradient = shader.value_and_gradient(np.concatenate([gradients, [0.1], np.linspace(0, 1, 6 * shader.nodes)]))
        loss.append(value)
        slopes.append(gradient)
    assert loss[0] == pytest.approx(loss[1], rel=1e-14)
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-12, atol=1e-15)


def test_automatic_differentiation_sees_the_colours_only(scene: CompiledScene) -> None:
    shader, parameters = small_shader(scene)
    plain = ShaderLoss(compile_scene("numpy", "ignore"), shader.noise, np.stack([shader.target[k] for k in TARGET], axis=-1))
    (loss, gradient), (same, seen) = shader.value_and_gradient(parameters), plain.value_and_gradient(parameters)
    assert same == loss
    assert not seen[:-6].any()
    assert np.linalg.norm(gradient[:-6]) > 1e-3
    np.testing.assert_allclose(seen[-6:], gradient[-6:], rtol=1e-13)


def test_a_finer_picture_is_of_the_same_shader(scene: CompiledScene) -> None:
    shader, parameters = small_shader(scene)
    fine = shader.picture(parameters, 3)
    assert fine.shape == (24, 24, 3)
    np.testing.assert_allclose(fine.reshape(8, 3, 8, 3, 3).mean(axis=(1, 3)), shader.picture(parameters), atol=1e-13)


# -- the noise ---------------------------------------------------------------------------------------------------------


def test_the_noise_is_perlins() -> None:
    size, cells, seed = 12, 3, 4
    noise, gradients = make_noise(size, cells, 2, seed)
    shifts = np.random.default_rng(seed).uniform(0, 1, (2, 2))
    first = 2 * (cells + 2) ** 2
    lattices = [gradients[:first].reshape(cells + 2, cells + 2, 2), gradients[first:].reshape(2 * cells + 2, 2 * cells + 2, 2)]

    def smoothstep(w: float) -> float:
        return 3 * w**2 - 2 * w**3

    def value(column: int, row: int) -> float:
        total = 0.0
        for k, lattice in enumerate(lattices):
            x, y = (place * cells * 2**k / size + s for place, s in zip((column, row), shifts[k], strict=True))
            u, v = x % 1, y % 1
            inner = [[lattice[int(y) + j, int(x) + i] @ [u - i, v - j] for i in (0, 1)] for j in (0, 1)]
            rows = [a + smoothstep(u) * (b - a) for a, b in inner]
            total += PERSISTENCE**k * (rows[0] + smoothstep(v) * (rows[1] - rows[0]))
        return total

    corners = noise.corners(gradients)
    for column, row in ((0, 0), (12, 12), (5, 7), (1, 11), (12, 3)):
        assert corners[row, column] == pytest.approx(value(column, row), abs=1e-14)


def test_derivatives_go_back_by_the_transpose() -> None:
    noise, gradients = make_noise(10, 2, 2)
    slopes = np.random.default_rng(0).normal(size=(11, 11))
    assert np.sum(slopes * noise.corners(gradients)) == pytest.approx(noise.pull_back(slopes) @ gradients, rel=1e-12)
    assert np.linalg.norm(gradients.reshape(-1, 2), axis=1) == pytest.approx(1)


@pytest.mark.parametrize(("blend", "quarter"), [("smoothstep", 0.15625), ("quintic", 0.103515625), ("linear", 0.25)])
def test_a_blend_goes_from_one_node_to_the_next(blend: str, quarter: float) -> None:
    np.testing.assert_allclose(BLENDS[blend](np.array([0, 0.25, 0.5, 1])), [0, quarter, 0.5, 1], atol=1e-15)
    noise, gradients = make_noise((12, 6), 3, 2, 4, blend)
    assert noise.corners(gradients).shape == (7, 13)
    square, same = make_noise(12, 3, 1, 4, blend)
    assert noise.nodes < 25 + 64
    assert square.corners(same).shape == (13, 13)


def test_a_wide_picture_has_the_gradient_of_its_loss_and_its_derivative_is_that_of_the_picture(scene: CompiledScene) -> None:
    random, h = np.random.default_rng(2), 1e-5
    noise, gradients = make_noise((10, 6), 2, 2, 0, "quintic")
    shader = ShaderLoss(scene, noise, random.uniform(0, 1, (6, 10, 3)), colour_cells=3)
    parameters = np.concatenate([gradients, [0.05], random.uniform(0, 1, 6 * shader.nodes)])
    assert shader.nodes == 4 * 3
    direction = random.normal(size=len(parameters))
    ahead, behind = (shader.value_and_gradient(parameters + s * h * direction)[0] for s in (1, -1))
    assert shader.value_and_gradient(parameters)[1] @ direction == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)
    direction[len(gradients) + 1 :] = 0  # colours do not move
    after, before = (shader.picture(parameters + s * h * direction, 2) for s in (1, -1))
    slope = shader.slope_picture(parameters, direction, 2)
    assert slope.shape == (12, 20, 3)
    np.testing.assert_allclose(slope, (after - before) / (2 * h), atol=1e-6 * np.abs(slope).max())


# -- the descent and the run -------------------------------------------------------------------------------------------


def test_the_loss_falls_further_than_without_the_motion_of_the_border(photo: Path, tmp_path: Path) -> None:
    report = run_perlin(photo, steps=60, out=tmp_path, **SMALL)
    beside, marks = report["beside"], report["simple_approximations"]
    assert len(report["losses"]) == len(beside["losses"]) == 61
    assert report["loss"]["ratio"] < 0.3
    assert report["loss"]["end"] < 0.5 * beside["loss"]["end"]
    assert beside["shader"]["largest_movement"] == 0
    assert beside["shader"]["thresholds"] == report["beside"]["shader"]["thresholds"]
    assert "exactly 0" in beside["note"]
    assert report["note"] == ""
    assert beside["loss"]["end"] < beside["loss"]["start"]  # by its colours
    assert marks["2 colours, each pixel free to choose"] < report["loss"]["end"] < marks["one colour"]
    assert json.loads((tmp_path / "run.json").read_text(encoding="utf-8")) == report
    for picture in ("target.png", "before.png", "after.png", "ignore.png"):
        with Image.open(tmp_path / picture) as image:
            assert image.size == (64, 64)
    assert (tmp_path / "before.png").read_bytes() != (tmp_path / "after.png").read_bytes()
    assert (tmp_path / "perlin.png").stat().st_size > 10_000
    assert not list(tmp_path.glob("*.partial"))


def test_a_resumed_run_ends_where_an_uninterrupted_one_does(photo: Path, tmp_path: Path) -> None:
    whole = run_perlin(photo, steps=6, out=tmp_path / "whole", **SMALL)
    run_perlin(photo, steps=2, out=tmp_path / "parts", **SMALL)
    resumed = run_perlin(photo, steps=6, out=tmp_path / "parts", resume=True, **SMALL)
    assert resumed["losses"] == whole["losses"]
    assert resumed["beside"]["losses"] == whole["beside"]["losses"]
    for name in ("after.png", "ignore.png"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes()
    with pytest.raises(InputError, match="octaves was 2, is 1"):
        run_perlin(photo, steps=6, out=tmp_path / "parts", resume=True, **(SMALL | {"octaves": 1}))
    with pytest.raises(InputError, match="nothing to resume"):
        run_perlin(photo, steps=6, out=tmp_path / "none", resume=True, **SMALL)


def test_a_run_may_be_alone(photo: Path, tmp_path: Path) -> None:
    alone = run_perlin(photo, steps=2, out=tmp_path / "alone", alone=True, **SMALL)
    assert alone["beside"] is None
    assert not (tmp_path / "alone" / "ignore.png").exists()
    plain = run_perlin(photo, steps=2, out=tmp_path / "plain", discontinuities="ignore", **SMALL)
    assert plain["beside"] is None
    assert plain["shader"]["largest_movement"] == 0
    assert plain["losses"][0] == alone["losses"][0]


def test_an_interrupt_writes_what_there_is(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted_at_the_third(shader: ShaderLoss, state: State) -> State:
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return next_state(shader, state)

    calls: list[int] = []
    monkeypatch.setattr(run, "next_state", interrupted_at_the_third)
    report = run_perlin(photo, steps=6, out=tmp_path, **SMALL)
    assert report["interrupted"]
    assert (report["steps"], report["beside"]["steps"]) == (2, 0)
    monkeypatch.undo()
    resumed = run_perlin(photo, steps=6, out=tmp_path, resume=True, **SMALL)
    assert resumed["losses"][:3] == report["losses"]
    assert (resumed["steps"], resumed["beside"]["steps"]) == (6, 6)


def test_a_picture_of_one_colour_has_nothing_to_fit(scene: CompiledScene, tmp_path: Path) -> None:
    grey = np.full((8, 8, 3), 0.5)
    noise, gradients = make_noise(8, 2, 1)
    state = first_state(ShaderLoss(scene, noise, grey), gradients, grey)
    assert state.stuck
    assert simple_approximations(grey, 2) == {"one colour": 0.0}
    Image.new("RGB", (16, 16), "teal").save(tmp_path / "teal.png")
    report = run_perlin(tmp_path / "teal.png", steps=3, out=tmp_path / "out", **SMALL)
    assert report["loss"]["end"] == pytest.approx(0, abs=1e-20)
    assert report["converged"]


@pytest.mark.parametrize(
    "options",
    [{"size": 3}, {"size": 10**5}, {"cells": 0}, {"octaves": 0}, {"octaves": 4}, {"steps": -1}, {"seed": -1}],
    ids=str,
)
def test_numbers_that_make_no_picture_are_input_errors(photo: Path, tmp_path: Path, options: dict[str, int]) -> None:
    with pytest.raises(InputError) as error:
        run_perlin(photo, out=tmp_path, **(SMALL | options))
    assert error.value.hint


def test_photos_and_folders_that_cannot_be_used_are_input_errors(photo: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing"):
        run_perlin(tmp_path / "missing.jpg", out=tmp_path, **SMALL)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        run_perlin(photo, out=tmp_path / "file", **SMALL)


def test_a_missing_package_is_named(photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(run.PACKAGES, "a_package_that_is_not_there", "thing")
    with pytest.raises(MissingPackageError, match="thing"):
        run_perlin(photo, out=tmp_path, **SMALL)


def test_the_command_line(photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--size", "16", "--cells", "3", "--octaves", "2", "--steps", "3", "--backend", "numpy", "--quiet", "-o", str(tmp_path)]
    assert main(["demo", "perlin", str(photo), *small]) == 0
    out = capsys.readouterr().out
    assert "exact gradient: loss" in out
    assert "plain automatic differentiation: loss" in out
    assert "perlin.png" in out
    assert (tmp_path / "derivatives.png").stat().st_size > 5000
    assert main(["demo", "perlin", str(photo), *small, "--node", "9999"]) == 2
    assert "the number of the nodes" in capsys.readouterr().err
    assert main(["demo", "perlin", str(photo), *small, "--cells", "0"]) == 2
    assert "at least 1" in capsys.readouterr().err


@pytest.mark.slow
def test_the_default_run_meets_its_goal(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    report = run_perlin(out=tmp_path, steps=120, size=160, octaves=4, progress=False)
    assert report["loss"]["ratio"] < 0.25
    assert report["loss"]["end"] < 0.5 * report["beside"]["loss"]["end"]
