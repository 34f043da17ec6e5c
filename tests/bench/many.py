"""Scenes of many surfaces, and pictures integrated over a third variable: candidates, compile time, value, gradient, error."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import teg
from teg.examples import occlusion, voronoi
from teg.examples.blur.run import Blur
from teg.examples.soft_shadow import run as shadow
from tests.bench.rows import Row, empty_cache
from tests.bench.scenes import cut_cells
from tests.examples.clipped_scenes import clipped_pixel, clipped_share, over_lens, over_time

SAMPLE = 12


def many_rows() -> list[Row]:
    """C, one thread, nothing compiled before. The error is the largest one in a sample of pixels beside the clipper, and for the last two
    beside the midpoint rule over time or lens, whose own it is."""
    with empty_cache():
        mesh = occlusion.Scene(512, 10_000, "c")
        rows = [mesh_row(mesh), mesh_row(occlusion.Scene(1024, 100_000, "c"), mesh.evaluator)]
        rows += [shadow_row(64, 1000), transport_row(1000), cells_row(32)]
        return [*rows, blur_row("motion-blur", 64), blur_row("depth-of-field", 32)]


def processor_time(action: Callable[[], object]) -> float:
    """Seconds of the processor, the median of five: one thread, whoever else computes."""
    times = []
    for _ in range(5):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return statistics.median(times)


def row(name: str, candidates: int, evaluator: teg.Evaluator, given: dict[str, Any], error: Callable[[], float]) -> Row:
    """One row; the time of compiling is that of a clock."""
    start = time.perf_counter()
    evaluator.value_and_grad(given)  # derives and compiles
    compiled = time.perf_counter() - start
    evaluator(given)
    return {
        "scene": name,
        "candidates": candidates,
        "compile, s": compiled,
        "value, s": processor_time(lambda: evaluator(given)),
        "gradient, s": processor_time(lambda: evaluator.value_and_grad(given)),
        "error": error(),
    }


def sampled(picture: Callable[[], np.ndarray], exact: Callable[[int], float]) -> float:
    """The largest error in a sample of pixels that are neither dark nor bright."""
    flat = picture().ravel()
    grey = np.nonzero((flat > 0.1) & (flat < 0.9))[0]
    return max(abs(float(flat[n]) - exact(int(n))) for n in np.random.default_rng(0).choice(grey, SAMPLE))


def mesh_row(scene: occlusion.Scene, evaluator: teg.Evaluator | None = None) -> Row:
    """A mesh in perspective with occlusion."""
    scene.evaluator = evaluator or scene.evaluator
    lists = occlusion.candidates(scene.vertices, scene.faces, occlusion.TRUE, scene.size)
    given = {"P": scene.vertices, "F": scene.faces, "C": scene.colours, "T": np.full((scene.size, scene.size), 0.3)}
    given |= {**lists, **occlusion.TRUE}
    name = f"mesh, {len(scene.faces)} triangles, {scene.size}² pixels"
    picture = partial(scene.picture, occlusion.TRUE)
    return row(
        name, len(lists["L"]), scene.evaluator, given, lambda: sampled(picture, lambda n: clipped_pixel(scene, lists, occlusion.TRUE, n))
    )


def shadow_row(size: int, triangles: int) -> Row:
    """A soft shadow."""
    scene = shadow.Scene(size, triangles, "c")
    lists = scene.candidates(shadow.TRUE)
    given = {"T": np.full(size * size, 0.3), **scene.arrays, **lists, **shadow.TRUE}
    name = f"soft shadow, {len(scene.faces)} triangles, {size}² receivers"
    picture = partial(scene.picture, shadow.TRUE)
    return row(
        name,
        len(lists["I"]),
        scene.evaluator,
        given,
        lambda: sampled(picture, lambda n: clipped_share(scene, scene.arrays, shadow.TRUE, n)),
    )


def transport_row(sites: int) -> Row:
    """Masses of power cells; the error is that of their sum, which is 1."""
    places, masses = voronoi.scene(sites, 0)
    evaluator = teg.compile(voronoi.programs()[0], [voronoi.W], backend="c")
    lists = voronoi.candidates(places, np.zeros(sites))
    given = {"S": places, "W": np.zeros(sites), "M": masses, **lists}
    name = f"power diagram, {sites} sites, {voronoi.TILES}² tiles"
    return row(name, len(lists["L"]), evaluator, given, lambda: abs(float(evaluator.grad(given)["W"].sum())))


def cells_row(size: int) -> Row:
    """Volumes of a tetrahedron in the cells of a grid; the error is that of their sum."""
    corners = size * np.array([[0.1, 0.2, 0.15], [0.9, 0.25, 0.2], [0.3, 0.85, 0.1], [0.4, 0.3, 0.95]])
    given = {"V": corners, "N": np.zeros(size)}
    exact = float(np.linalg.det(corners[1:] - corners[0])) / 6
    evaluator, sums = (teg.compile(*cut_cells(power), backend="c") for power in (2, 1))
    return row(f"tetrahedron in {size}³ cells", size**3, evaluator, given, lambda: abs(float(sums(given)) / exact - 1))


def blur_row(demo: str, size: int) -> Row:
    """A triangle in motion, or through a lens."""
    scene = Blur(demo, size, "c")
    given = {"T": np.full((size, size), 0.3), **scene.given, **scene.true}
    picture = partial(scene.picture, scene.true)
    exact, count = (over_time, 4000) if demo == "motion-blur" else (over_lens, 400)
    return row(
        f"{demo.replace('-', ' ')}, {size}² pixels",
        1,
        scene.evaluator,
        given,
        lambda: sampled(picture, lambda n: exact(size, scene.true, *divmod(n, size), count)),
    )
