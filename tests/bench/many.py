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
from tests.references import distance_sites
from tests.references.disks import slopes_of_layers, slopes_of_union
from tests.references.ellipses import random_ellipses
from tests.references.ellipses import slopes_of_union as slopes_of_ellipses
from tests.references.weighted_sites import random_sites
from tests.references.weighted_sites import slopes as slopes_of_sites

SAMPLE = 12


def many_rows() -> list[Row]:
    """C, one thread, nothing compiled before. The error is the largest one in a sample of pixels beside the clipper, and for the last two
    beside the midpoint rule over time or lens, whose own it is."""
    with empty_cache():
        mesh = occlusion.Scene(512, 10_000, "c")
        rows = [mesh_row(mesh), mesh_row(occlusion.Scene(1024, 100_000, "c"), mesh.evaluator)]
        rows += [shadow_row(64, 1000), transport_row(1000), cells_row(32)]
        rows += [union_row(300), ellipses_row(300), painting_row(60), sites_row(40), arrivals_row(40), disks_row(64, 60)]
        return [*rows, blur_row("motion-blur", 64), blur_row("depth-of-field", 32)]


def processor_time(action: Callable[[], object]) -> float:
    """Seconds of the processor, the median of five: one thread, whoever else computes."""
    times = []
    for _ in range(5):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return statistics.median(times)


def row(
    name: str, candidates: int, evaluator: teg.Evaluator, given: dict[str, Any], error: Callable[[], float], direction: Any = None
) -> Row:
    """One row; the time of compiling is that of a clock. With a `direction` it has those of its product with the Hessian, too."""
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
        **product(evaluator, given, direction),
        "error": error(),
    }


def product(evaluator: teg.Evaluator, given: dict[str, Any], direction: Any) -> Row:
    """The time to derive and compile a product with the Hessian, by a clock, and that of one; of none without a direction."""
    if direction is None:
        return {"product, compile, s": "", "product, s": ""}
    start = time.perf_counter()
    evaluator.hvp(given, direction)
    compiled = time.perf_counter() - start
    return {"product, compile, s": compiled, "product, s": processor_time(lambda: evaluator.hvp(given, direction))}


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


def union_row(disks: int) -> Row:
    """The area of a union of disks, each with each; the error is that of its derivatives, beside arcs."""
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    inside = (x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 < D[k, 2] ** 2
    area = teg.integral(teg.bracket(teg.any(inside, (k, 0, teg.length(D, 0)))), (x, 0, 1), (y, 0, 1))
    evaluator = teg.compile(area, [D], backend="c")
    rng = np.random.default_rng(1)
    given = {"D": np.c_[rng.random((disks, 2)), np.full(disks, 0.5 / np.sqrt(disks))]}
    exact = slopes_of_union(given["D"], lambda u, v: 1 + 0 * u)
    direction = {"D": rng.normal(size=(disks, 3))}
    return row(
        f"union of {disks} disks", disks**2, evaluator, given, lambda: float(np.abs(evaluator.grad(given)["D"] - exact).max()), direction
    )


def painting_row(disks: int) -> Row:
    """Disks of all sizes with depths and shades, a dozen over each place; the error is that of the derivatives, beside arcs."""
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    inside = (x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 < D[k, 2] ** 2
    shade = teg.nearest(D[k, 4], D[k, 3], (k, 0, teg.length(D, 0)), where=inside, otherwise=0.1)
    evaluator = teg.compile(teg.integral(shade, (x, 0, 1), (y, 0, 1)), [D], backend="c")
    rng = np.random.default_rng(0)
    rows = np.c_[rng.uniform(-0.1, 1.1, (disks, 2)), rng.uniform(0.1, 0.4, disks), rng.permutation(disks), rng.random(disks)]
    exact = slopes_of_layers(rows[:, :3], rows[:, 3], rows[:, 4], 0.1)
    name = f"painting of {disks} disks"
    direction = {"D": rng.normal(size=rows.shape)}
    return row(name, disks**2, evaluator, {"D": rows}, lambda: float(np.abs(evaluator.grad(D=rows)["D"][:, :3] - exact).max()), direction)


def ellipses_row(ellipses: int) -> Row:
    """The area of a union of ellipses, each given by its matrix; the error is that of its derivatives, beside arcs."""
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    u, v = x - D[k, 0], y - D[k, 1]
    inside = D[k, 2] * u**2 + D[k, 3] * u * v + D[k, 4] * v**2 < 1
    area = teg.integral(teg.bracket(teg.any(inside, (k, 0, teg.length(D, 0)))), (x, 0, 1), (y, 0, 1))
    evaluator = teg.compile(area, [D], backend="c")
    given = {"D": random_ellipses(ellipses, 1) * [1.0, 1.0, *[ellipses / 10] * 3]}
    exact = slopes_of_ellipses(given["D"], lambda u, v: 1 + 0 * u)
    direction = {"D": np.random.default_rng(1).normal(size=(ellipses, 5)) * [1.0, 1.0, *[ellipses] * 3]}
    name = f"union of {ellipses} ellipses by their matrices"
    return row(name, ellipses**2, evaluator, given, lambda: float(np.abs(evaluator.grad(given)["D"] - exact).max()), direction)


def sites_row(sites: int) -> Row:
    """The mean value of the site of least w·|z - c|², whose borders are circles; the error is that of the derivatives, beside arcs."""
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    key = D[k, 2] * ((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2)
    mean = teg.integral(teg.nearest(D[k, 3], key, (k, 0, teg.length(D, 0))), (x, 0, 1), (y, 0, 1))
    evaluator = teg.compile(mean, [D], backend="c")
    rows = random_sites(sites, 1)
    exact = slopes_of_sites(rows)[:, :3]
    direction = {"D": np.random.default_rng(1).normal(size=rows.shape)}
    name = f"{sites} sites with weights"
    return row(name, sites**2, evaluator, {"D": rows}, lambda: float(np.abs(evaluator.grad(D=rows)["D"][:, :3] - exact).max()), direction)


def arrivals_row(sites: int) -> Row:
    """The mean value of the site of least |z - c| - v, with branches of hyperbolas as borders; the error is that of the derivative along a
    direction, beside differences of order 8."""
    D, k = teg.array("D", 2), teg.index("k")
    x, y = teg.vars("x y")
    key = teg.sqrt((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2) - D[k, 2]
    mean = teg.integral(teg.nearest(D[k, 3] * (1 + x * y), key, (k, 0, teg.length(D, 0))), (x, 0, 1), (y, 0, 1))
    evaluator = teg.compile(mean, [D], backend="c")
    rows = distance_sites.random_sites(sites, 1)
    direction = np.random.default_rng(1).normal(size=rows.shape)
    exact = distance_sites.slope_along(rows, direction, 1e-5)
    name = f"{sites} sites by distance and a number"
    return row(
        name,
        sites**2,
        evaluator,
        {"D": rows},
        lambda: abs(float((evaluator.grad(D=rows)["D"] * direction).sum() - exact)),
        {"D": direction},
    )


def disks_row(size: int, disks: int) -> Row:
    """A picture of disks that overlap: Σ over pixels of (covered area - target)², with the disks of each pixel; the error is that of the
    sum of derivatives by the radii, of covered areas, beside arcs."""
    D, p, k = teg.array("D", 2), teg.index("p"), teg.index("k")
    first, listed = teg.indices("first", 1), teg.indices("listed", 1)
    x, y = teg.vars("x y")
    inside = (x - D[listed[k], 0]) ** 2 + (y - D[listed[k], 1]) ** 2 < D[listed[k], 2] ** 2
    pixel = (x, p % size, p % size + 1), (y, p // size, p // size + 1)
    covered = teg.integral(teg.bracket(teg.any(inside, (k, first[p], first[p + 1]))), *pixel)
    evaluator, sums = (teg.compile(teg.sum(e, (p, 0, size * size)), [D], backend="c") for e in ((covered - 0.3) ** 2, covered))
    rng = np.random.default_rng(0)
    at = np.c_[rng.uniform(0, size, (disks, 2)), rng.uniform(0.2, 0.6, disks) * size / np.sqrt(disks)]
    rows, columns = np.divmod(np.arange(size * size), size)
    away = [np.maximum(np.maximum(c[:, None] - at[:, i], at[:, i] - c[:, None] - 1), 0) for i, c in enumerate((columns, rows))]
    pairs = np.nonzero(away[0] ** 2 + away[1] ** 2 < at[:, 2] ** 2)
    given = {"D": at, "first": np.searchsorted(pairs[0], np.arange(size * size + 1)), "listed": pairs[1]}
    exact = slopes_of_union(at / size, lambda u, v: 1 + 0 * u)[:, 2].sum() * size
    name = f"{disks} disks that overlap, {size}² pixels"
    return row(name, len(pairs[0]), evaluator, given, lambda: abs(float(sums.grad(given)["D"][:, 2].sum() / exact) - 1))


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
