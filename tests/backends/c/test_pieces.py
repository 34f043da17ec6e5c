"""Convex polygons of few corners in C: their parts, signs of guards, and cells, with eight numbers at a time, four, or one."""

from __future__ import annotations

import ctypes
import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from teg.backends.c.build import load_library
from teg.backends.c.runtime import LIMITS, runtime
from teg.numerics.cells import EPSILON, Layout
from tests.backends.c.test_cells import guards, keys, scattered
from tests.backends.c.test_kept_cells import check, fan, kept_cells, numbers_of

Array = np.ndarray[Any, Any]
pytestmark = pytest.mark.usefixtures("for_this_machine")
WAYS = {"eight": "", "four": "#undef __AVX512F__", "one": "#define TEG_NARROW"}
"""What the instructions of this machine are to be taken for; where it has no others, all ways are one."""
MOST = LIMITS["TEG_PIECE"]
ENTRY = """
int part(int n, const double *x, const double *y, const int *label, const double *g, int side, int cut, double *u, double *v, int *l,
         int *bits)
{
    double d[TEG_PIECE];
    teg_on_corners(g[0], g[1], g[2], x, y, d);
    bits[0] = (int)teg_below_level(d, 0.25), bits[1] = (int)teg_above_level(d, 0.25), bits[2] = (int)teg_on_line(d);
    return teg_part(n, x, y, label, d, side, cut, u, v, l);
}
void signs(const double *f, int count, const double *tile, int *bits)
{
    const teg_signs found = teg_signs_of(f, count, tile, tile + 2, tile[4], tile[5]);
    bits[0] = (int)found.cuts, bits[1] = (int)found.absent, bits[2] = (int)found.infinite;
}
"""
SIDE_LABELS = [4, 2, 6, 0, 11, 20, 31, 40]


class Part(NamedTuple):
    """Corners (n, 2), the labels of the edges behind them, and what stands behind the last corner."""

    corners: Array
    labels: list[int]
    behind: Array


@pytest.fixture(scope="module", params=WAYS)
def library(request: pytest.FixtureRequest) -> ctypes.CDLL:
    always, *parts = runtime(["teg_part", "teg_on_line", "teg_above_level", "teg_below_level", "teg_on_corners", "teg_signs_of"])
    found: ctypes.CDLL = load_library("\n\n".join([WAYS[request.param], always, *parts, ENTRY]), optimise=("-O1",))
    return found


def at(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def part(library: ctypes.CDLL, corners: Array, g: Array, side: int, cut: int) -> tuple[Part, list[int]]:
    """Returns the part of a polygon, in another piece and in its own place, and the bits of its corners."""
    n = len(corners)
    x, y = (np.ascontiguousarray(np.append(c, np.full(MOST - n, c[0]))) for c in corners.T)
    label = np.array(SIDE_LABELS[:n] + [0] * (MOST - n), dtype=np.int32)
    u, v, other, bits = np.zeros(MOST), np.zeros(MOST), np.zeros(MOST, dtype=np.int32), np.zeros(3, dtype=np.int32)
    count = library.part(n, at(x), at(y), at(label), at(g), side, cut, at(u), at(v), at(other), at(bits))
    again = library.part(n, at(x), at(y), at(label), at(g), side, cut, at(x), at(y), at(label), at(bits.copy()))
    assert again == count
    if count:
        assert np.array_equal([x, y], [u, v])
        assert np.array_equal(label, other)
    whole = np.stack([u, v], axis=1)
    return Part(whole[:count], other[:count].tolist(), np.column_stack([whole, other])[count:]), bits.tolist()


def clipped(corners: Array, labels: list[int], g: Array, side: int, cut: int) -> tuple[Array, list[int]]:
    """Returns corner after corner what lies where side·g > 0, from the edge on that leads there (Sutherland and Hodgman)."""
    d = side * (g[0] + corners @ g[1:])
    kept: list[tuple[Array, int]] = []
    for i, p in enumerate(corners):
        j = (i + 1) % len(corners)
        crossing = p + d[i] / (d[i] - d[j]) * (corners[j] - p)
        if d[i] > 0.0:
            kept.append((p, labels[i]))
        if d[i] * d[j] < 0.0:
            kept.append((crossing, labels[i] if d[i] < 0.0 else cut))
    first = next(k for k, (_, label) in enumerate(kept) if label == cut) + 1
    kept = kept[first:] + kept[:first]
    return np.array([p for p, _ in kept]), [label for _, label in kept]


@pytest.mark.parametrize("n", range(3, MOST + 1))
def test_parts_of_a_polygon(library: ctypes.CDLL, n: int) -> None:
    random = np.random.default_rng(n)
    for _ in range(200):
        angles = np.sort(random.uniform(0.0, 2 * np.pi, n))
        corners = 0.5 + np.stack([np.cos(angles), random.uniform(0.2, 1) * np.sin(angles)], axis=1)
        p, way = random.uniform(0.0, 1.0, 2), random.normal(size=2)
        g = np.array([-way @ p, *way]) / np.linalg.norm(way)
        d = g[0] + corners @ g[1:]
        if (d > 0).all() or (d < 0).all():
            continue
        for side in (1, -1):
            found, bits = part(library, corners, g, side, 50)
            of_corners = [sum(1 << k for k in range(n) if test[k]) for test in (d < 0.25, d > 0.25, np.abs(d) < EPSILON)]
            assert [b & (1 << n) - 1 for b in bits] == of_corners
            if n == MOST:
                assert len(found.corners) == 0
                continue
            exact, labels = clipped(corners, SIDE_LABELS[:n], g, side, 50)
            np.testing.assert_allclose(found.corners, exact, rtol=0, atol=1e-15)
            assert found.labels == labels
            assert (found.behind == [*found.corners[0], 0.0]).all()


def test_what_is_not_convex_has_no_part(library: ctypes.CDLL) -> None:
    zigzag = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0], [3.0, 1.0], [1.5, 5.0]])
    found, _ = part(library, zigzag, np.array([-0.5, 0.0, 1.0]), 1, 50)
    assert len(found.corners) == 0


@pytest.mark.parametrize("count", range(1, 17))
def test_signs_of_guards(library: ctypes.CDLL, count: int) -> None:
    """By the values at the corners of the tile; guards without slope, of all sizes, on the border, infinite, or no numbers."""
    random = np.random.default_rng(count)
    for _ in range(300):
        u, v = np.sort(random.uniform(size=2)), np.sort(random.uniform(size=2))
        if random.integers(2):
            u, v = np.array([0.0, 1.0]), np.array([0.0, 1.0])
        tile = np.array([*u, *v, *random.choice([0.0, 1e-11], 2)])
        f = random.normal(size=(count, 3)) * 10.0 ** random.integers(-3, 4, (count, 1))
        f[random.uniform(size=count) < 0.2, 1:] = 0.0
        f[random.uniform(size=count) < 0.1] *= 0.0
        f[random.uniform(size=count) < 0.1] = [-1.0, 1.0, 0.0]
        f[random.uniform(size=count) < 0.1, random.integers(3)] = random.choice([np.nan, np.inf, -np.inf])
        bits = np.zeros(3, dtype=np.int32)
        library.signs(at(f), count, at(tile), at(bits))
        cuts, absent, infinite = expected(f.tolist(), tile.tolist())
        assert bits[2] == infinite
        assert (bits[0] & ~infinite, bits[1] & ~infinite) == (cuts, absent)


def expected(f: list[list[float]], tile: list[float]) -> tuple[int, int, int]:
    """Returns which guards cut and are absent, with the margin of a line, and which are not finite."""
    cuts = absent = infinite = 0
    for q, (c, a, b) in enumerate(f):
        base, steep = c + a * tile[4] + b * tile[5], math.hypot(a, b)
        if not (math.isfinite(base) and math.isfinite(steep)):
            infinite |= 1 << q
            continue
        values = [base + a * x + b * y for x in tile[:2] for y in tile[2:4]]
        cuts |= (steep > 0.0 and min(values) <= EPSILON * steep) << q
        absent |= (max(values) < -EPSILON * steep) << q
    return cuts, absent, infinite


@pytest.mark.parametrize("way", WAYS)
def test_cells_of_every_way(way: str) -> None:
    """Fans before triangles that cross each other, some of them with more corners than a piece has."""
    cells, random, far = kept_cells(WAYS[way]), np.random.default_rng(3), np.array([[9.0, 9.0], [-99.0, 8.0], [8.0, -99.0]])
    for k in range(60):
        shape = Layout(1, 3, k % 4)
        front, back = fan(random, 4 + k % 3, random.uniform(size=2)), scattered(2, random)
        triangles = np.concatenate([front[: k % 6], back, *([far[None]] if k % 5 == 0 else [])])
        check(cells, shape, *numbers_of(shape, guards(triangles), keys("crossing", len(triangles), random), 3, random))
