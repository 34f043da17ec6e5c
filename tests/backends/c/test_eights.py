"""Squares with one or two candidates, eight side by side, beside cells that are cut one by one in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from tests.bench.rasteriser import Mesh, candidates, flat, loss, overlapping, waves

Array = Any
SIZE = 24


def triangles(corners: Array, depths: Array) -> Mesh:
    """Returns triangles with colours of their own; corners (n, 3, 2), depths (n, 3)."""
    own = np.arange(3 * len(corners)).reshape(-1, 3)
    rng = np.random.default_rng(5)
    return Mesh(corners.reshape(-1, 2), depths.ravel(), own, rng.random((own.size, 3)), own, np.ones(own.shape, bool))


def before_a_wall() -> Mesh:
    """Returns triangles in front of one that covers the picture, behind it, and through it."""
    rng = np.random.default_rng(3)
    wall = np.array([[[-200.0, -150.0], [300.0, -150.0], [20.0, 400.0]]])
    places = rng.uniform(0, SIZE, (9, 1, 2)) + rng.normal(0, 6, (9, 3, 2))
    turned = (places[:, 1] - places[:, 0])[:, 0] * (places[:, 2] - places[:, 0])[:, 1]
    turned = turned - (places[:, 1] - places[:, 0])[:, 1] * (places[:, 2] - places[:, 0])[:, 0] < 0
    places[turned] = places[turned][:, [0, 2, 1]]
    depths = np.concatenate([np.full((1, 3), 0.5), np.full((4, 3), 0.3), np.full((3, 3), 0.7), rng.uniform(0.3, 0.7, (2, 3))])
    return triangles(np.concatenate([wall, places]), depths)


def on_the_grid() -> Mesh:
    """Returns the halves of squares whose corners are those of pixels, and whose diagonals go through corners."""
    x, y = (a.ravel().astype(float) for a in np.mgrid[2:22:4, 2:22:4])
    corners = [np.stack([[x, y], [x + a, y + b], [x + c, y + d]], axis=0) for a, b, c, d in ((4, 0, 4, 4), (4, 4, 0, 4))]
    return triangles(np.concatenate([np.moveaxis(c, 2, 0) for c in corners]), np.full((2 * x.size, 3), 0.5))


def around_vertices(holes: bool = False) -> Mesh:
    """Returns a mesh with a vertex in most pixels, whose depths jump nowhere; without some of its triangles, if there are `holes`."""
    rng = np.random.default_rng(6)
    count = 19
    x, y = (a.ravel() * 1.4 - 0.6 for a in np.mgrid[0:count, 0:count])
    places = np.stack([x, y], axis=1) + rng.uniform(-0.3, 0.3, (count * count, 2))
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    a, b, c, d = first, first + count, first + count + 1, first + 1
    faces = np.concatenate([np.stack(f, axis=1) for f in ((a, b, c), (a, c, d))])
    faces = faces[rng.random(len(faces)) < (0.9 if holes else 2.0)]
    shades = np.arange(faces.size).reshape(-1, 3)
    return Mesh(places, rng.uniform(0.3, 0.6, len(places)), faces, rng.random((faces.size, 3)), shades, np.ones(faces.shape, bool))


def below_long_edges() -> Mesh:
    """Returns large triangles, along whose lower edges small ones have their corners."""
    rng = np.random.default_rng(7)
    corners: list[list[tuple[float, float]]] = []
    for y in (5.37, 13.61, 21.43):
        corners.append([(-3.0, y), (12.0, y - 7.0), (27.0, y)])
        above, below = ([(x, v) for x in np.arange(-4.0, 30.0, 1.3) + shift] for v, shift in ((y, 0.0), (y + 2.6, 0.65)))
        for k in range(len(above) - 1):
            corners += [[above[k], above[k + 1], below[k]], [above[k + 1], below[k + 1], below[k]]]
    return triangles(np.array(corners), np.repeat(rng.uniform(0.3, 0.6, (len(corners), 1)), 3, axis=1))


SCENES: dict[str, Callable[[], Mesh]] = {
    "side by side": lambda: (scene := flat())._replace(places=scene.places * 1.5 - 80.3),
    "few": lambda: overlapping(12, SIZE),
    "many": lambda: overlapping(60, SIZE),
    "before a wall": before_a_wall,
    "on the grid": on_the_grid,
    "around vertices": around_vertices,
    "below long edges": below_long_edges,
    "around vertices, with holes": lambda: around_vertices(True),
}


@pytest.mark.parametrize("name", SCENES)
def test_squares_side_by_side_are_those_cut_one_by_one(name: str) -> None:
    scene, target = SCENES[name](), waves(SIZE)
    given = {"P": scene.places, "D": scene.depths, "C": scene.colours, "F": scene.faces, "G": scene.shades, "T": target}
    given |= candidates(scene, SIZE)
    found = {backend: teg.compile(*loss(), backend=backend).value_and_grad(given) for backend in ("c", "numpy")}
    assert found["c"][0] == pytest.approx(found["numpy"][0], rel=1e-13)
    for array in "PC":
        exact = found["numpy"][1][array]
        np.testing.assert_allclose(found["c"][1][array], exact, rtol=1e-9, atol=1e-11 * abs(exact).max(), err_msg=array)


def test_the_text_has_them() -> None:
    text = teg.compile(*loss(), backend="c").source
    assert "teg_keep_eight(" in text
    assert "teg_pull_eight(" in text
    assert "teg_keep_fan(" in text
    assert "teg_pull_fan(" in text


x, y = teg.vars("x y")
A, K, W = teg.array("A"), teg.array("K"), teg.array("W")
RANGES, LIST = teg.indices("R", 2), teg.indices("L")
p, k = teg.index("p"), teg.index("k")
TILES = 6
SITE = LIST[k]
LINE, DISTANCE = K[SITE] * x + W[SITE], (x - A[SITE]) ** 2 + (y - K[SITE]) ** 2 - W[SITE]
VALUES = {
    "a constant": (A[SITE], LINE),
    "places beside numbers of candidates": (A[SITE] * x + y, LINE),
    "a product of squares": (A[SITE] * x * x * y * y, LINE),
    "powers": (DISTANCE, DISTANCE),
    "numbers by powers": (A[SITE], DISTANCE),
}


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("by", ["W", "AKW"])
@pytest.mark.parametrize("listed", [[0], [0, 1], [1, 0], [2], [0, 1, 2]])
def test_programs_before_and_behind_the_cells(name: str, by: str, listed: list[int]) -> None:
    """What is not differentiated is computed once for each tile, before its cells, and the density behind them."""
    value, key = VALUES[name]
    row, column = p // TILES, p % TILES
    box = (x, column / TILES, (column + 1) / TILES), (y, row / TILES, (row + 1) / TILES)
    nearest = teg.nearest(value, key, (k, RANGES[p, 0], RANGES[p, 1]))
    total = teg.sum(teg.integral(nearest * (1 + x * y), *box), (p, 0, TILES * TILES))
    ends = np.cumsum([len(listed)] * TILES * TILES)
    given = {"A": [0.3, 0.9, -0.4], "K": [0.2, 0.7, 0.5], "W": [0.1, -0.2, 0.05]}
    given |= {"R": np.stack([ends - len(listed), ends], axis=1), "L": np.array(listed * TILES * TILES)}
    arrays = [array for array in (A, K, W) if array.name in by]
    compiled = [teg.compile(total, arrays, backend=backend) for backend in ("c", "numpy")]
    (v, g), (expected, slopes) = (f.value_and_grad({n: a for n, a in given.items() if n in f.parameters}) for f in compiled)
    assert v == pytest.approx(expected, abs=1e-13)
    for array in by:
        np.testing.assert_allclose(g[array], slopes[array], rtol=0, atol=1e-13)
