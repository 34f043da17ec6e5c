"""`teg.nearest` of smooth regions, followed along edges: against slices and arcs of NumPy, closed forms, and exact cells."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import teg
from teg.passes.normalise import choices
from teg.passes.normalise.partitions import Refused
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, p, t, x, y
from tests.references.disks import integral_of_layers, slopes_of_layers

INSIDE = (x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2 < D[k, 2] ** 2
GROUND = 0.1
PAINTED = teg.integral(teg.nearest(D[k, 4], D[k, 3], ALL, where=INSIDE, otherwise=GROUND), *BOX)  # rows: centre, radius, depth, colour


def some(n: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-0.1, 1.1, (n, 2)), rng.uniform(0.1, 0.4, n), rng.permutation(n), rng.uniform(0, 1, n)]


def painted(rows: np.ndarray) -> tuple[float, np.ndarray]:
    """The value, and derivatives by centres and radii."""
    given = rows[:, :3], rows[:, 3], rows[:, 4], GROUND
    return integral_of_layers(*given), slopes_of_layers(*given)


@pytest.mark.parametrize("backend", BACKENDS)
def test_painted_disks(backend: str) -> None:
    """One program for any number of disks, none of them included."""
    f = teg.compile(PAINTED, [D], backend=backend)
    assert follows_edges(f)
    for n in (0, 1, 2, 7, 25):
        rows = some(n, seed=n)
        value, slopes = f.value_and_grad(D=rows.reshape(n, 5))
        area, expected = painted(rows)
        assert value == pytest.approx(area, abs=1e-10)
        assert slopes["D"][:, :3] == pytest.approx(expected, abs=1e-12)
        assert slopes["D"][:, 3] == pytest.approx(np.zeros(n), abs=1e-14)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_painted_disks_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(PAINTED, [D], kernel=kernel)
    rows = some(3, seed=3)
    value, slopes = jax.jit(jax.value_and_grad(lambda d: f(D=d)))(rows)
    area, expected = painted(rows)
    assert value == pytest.approx(area, abs=1e-10)
    assert np.asarray(slopes)[:, :3] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_painted_disks_on_a_grid(backend: str) -> None:
    """Equal disks, equal depths (the lower index is seen), radii 0, borders on each other and on sides: values of places nearby."""
    f = teg.compile(PAINTED, [D], backend=backend)
    for seed in range(60 if backend == "c" else 15):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 8))
        depth = rng.permutation(n) if seed % 2 else rng.integers(0, 3, n)
        rows = np.c_[rng.integers(0, 11, (n, 2)) / 10, rng.integers(0, 6, n) / 10, depth, rng.uniform(0, 1, n)]
        nearby = rows + np.c_[rng.uniform(-1e-8, 1e-8, (n, 3)), 1e-7 * np.arange(n), np.zeros(n)]
        value, slopes = f.value_and_grad(D=rows)
        assert value == pytest.approx(painted(nearby)[0], abs=1e-6), rows.tolist()
        assert np.isfinite(slopes["D"]).all()


def test_depths_that_change() -> None:
    """Tilted disks, which run through each other, and a colour that is no polynomial."""
    depth = D[k, 3] + D[k, 0] * x - D[k, 2] * y
    f = teg.compile(teg.integral(teg.nearest(D[k, 4] * teg.exp(x * y), depth, ALL, where=INSIDE, otherwise=t), *BOX), [D, t])
    assert follows_edges(f)
    rows = some(4, seed=5)
    rows[:, 3] *= 0.1
    value, slopes = f.value_and_grad(D=rows, t=0.3)
    places = (np.arange(1000) + 0.5) / 1000
    u, v = np.meshgrid(places, places)
    depths = np.array([np.where((u - a) ** 2 + (v - b) ** 2 < r * r, z + a * u - r * v, np.inf) for a, b, r, z, _ in rows])
    seen = np.where(np.isinf(depths).all(axis=0), 0.3, rows[depths.argmin(axis=0), 4] * np.exp(u * v))
    assert value == pytest.approx(seen.mean(), abs=2e-5)
    along = np.random.default_rng(0).normal(size=rows.shape)
    around = [f(D=rows + s * 1e-4 * along, t=0.3) for s in (2, 1, -1, -2)]
    difference = (-around[0] + 8 * around[1] - 8 * around[2] + around[3]) / 12e-4
    assert np.vdot(slopes["D"], along) == pytest.approx(difference, abs=1e-9)
    assert slopes["t"] == pytest.approx(np.isinf(depths).all(axis=0).mean(), abs=2e-5)


@contextmanager
def without_cells() -> Iterator[None]:
    """Affine choices are followed along edges, too, not cut into cells."""
    exact = choices.partitioned

    def refused(node: Any) -> Any:
        if choices.has_choices(node):
            raise Refused("a test")
        return exact(node)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choices, "partitioned", refused)
        yield


HALVES = (D[k, 0] * x + D[k, 1] * y < D[k, 2]) & (D[k, 3] * x + D[k, 4] * y < D[k, 5])
WEDGES = teg.integral(teg.nearest(D[k, 9], D[k, 6] * x + D[k, 7] * y + D[k, 8], ALL, where=HALVES, otherwise=GROUND), *BOX)


def test_as_cells_are() -> None:
    """Wedges with tilted depths, by both ways; on a grid many borders, and lines of equal depth, lie on each other."""
    cells = teg.compile(WEDGES, [D])
    with without_cells():
        edges = teg.compile(WEDGES, [D], backend="c")
        assert follows_edges(edges)
        for seed in range(48):
            rng = np.random.default_rng(seed)
            n = int(rng.integers(1, 6))
            rows = rng.normal(size=(n, 10))
            if seed % 4:
                whole = rng.integers(-1, 2, (n, 9))
                rows[:, :9] = whole * [1, 1, 0.5, 1, 1, 0.5, 1, 1, 1]
            (value, slopes), (expected, others) = edges.value_and_grad(D=rows), cells.value_and_grad(D=rows)
            assert value == pytest.approx(expected, abs=1e-13), rows.tolist()
            if not seed % 4:
                assert slopes["D"] == pytest.approx(others["D"], abs=1e-12)


def test_two_borders_of_a_half_on_one_line() -> None:
    """Halves of the box whose depths are equal on their common edge: a border of both, and the line of equal depth."""
    with without_cells():
        f = teg.compile(WEDGES, [D], backend="c")
        assert follows_edges(f)
        for slope in (1.0, -1.0):
            rows = np.array([[1, 0, 0.5, 0, 0, 1, -slope, 0, 0.5 * slope, 2], [-1, 0, -0.5, 0, 0, 1, 0, 0, 0, 3]])
            assert f(D=rows) == pytest.approx(2.5, abs=1e-13)
            assert f(D=rows[::-1]) == pytest.approx(2.5, abs=1e-13)


def test_common_edges_of_triangles() -> None:
    """Two triangles with a common edge, along which their depths are equal, so that three borders lie on each other."""
    V, P, C, F = teg.array("V", 2), teg.array("P", 2), teg.array("C"), teg.indices("F", 2)
    corner = [(V[F[k, i], 0], V[F[k, i], 1]) for i in range(3)]
    sides = [(b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) for a, b in zip(corner, [*corner[1:], corner[0]], strict=True)]
    inside = (sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)
    depth = P[k, 0] * x + P[k, 1] * y + P[k, 2]
    mesh = teg.integral(teg.nearest(C[k], depth, (k, 0, teg.length(F, 0)), where=inside, otherwise=GROUND), *BOX)
    rows, faces = np.array([[0.1, 0.2], [0.9, 0.15], [0.8, 0.9], [0.2, 0.8]]), np.array([[0, 1, 2], [0, 2, 3]])
    given = {"F": faces, "C": np.array([0.3, 0.9]), "V": rows}
    cells = teg.compile(mesh, [V])
    with without_cells():
        edges = teg.compile(mesh, [V], backend="c")
        assert follows_edges(edges)
        for heights in np.array([[0.1, 0.7, 0.4, 0.2], [0.0, 1.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5]]):
            planes = [np.linalg.solve(np.c_[rows[face], np.ones(3)], heights[face]) for face in faces]
            (value, slopes), (expected, others) = (f.value_and_grad(given | {"P": planes}) for f in (edges, cells))
            assert value == pytest.approx(expected, abs=1e-13)
            assert slopes["V"] == pytest.approx(others["V"], abs=1e-12)


def test_lists_by_pixel() -> None:
    first, listed = teg.indices("first", 1), teg.indices("listed", 1)
    at = listed[k]
    inside = (x - D[at, 0]) ** 2 + (y - D[at, 1]) ** 2 < D[at, 2] ** 2
    seen = teg.nearest((D[at, 4], teg.exp(D[at, 4]) * x), D[at, 3], (k, first[p], first[p + 1]), where=inside, otherwise=(GROUND, 0.0))
    f = teg.compile(teg.sum(teg.integral(seen, (x, p, p + 1), (y, 0, 1)), (p, 0, 2)), [D])
    rows = np.array([[0.4, 0.5, 0.3, 2, 0.5], [0.9, 0.5, 0.35, 1, 0.8], [1.5, 0.4, 0.3, 0, 0.2]])
    value, other = f(D=rows, first=[0, 2, 4], listed=[0, 1, 2, 1])
    right = rows - [1, 0, 0, 0, 0]
    assert value == pytest.approx(painted(rows)[0] + painted(right)[0], abs=1e-10)
    places = (np.arange(1000) + 0.5) / 1000
    u, v = np.meshgrid(2 * places, places)
    depths = np.array([np.where((u - a) ** 2 + (v - b) ** 2 < r * r, z, np.inf) for a, b, r, z, _ in rows])
    moments = np.where(np.isinf(depths).all(axis=0), 0.0, np.exp(rows[depths.argmin(axis=0), 4]) * u)
    assert other == pytest.approx(2 * moments.mean(), abs=1e-4)


@pytest.mark.parametrize("keys", [(1e12 + 100, 1e12), (1.0 + 1e-11, 1.0), (1e308, 0.0), (1.0, 1.0)])
def test_keys_that_hardly_differ(keys: tuple[float, float]) -> None:
    """Numbers are compared as they are: of equal ones the lower index is seen."""
    f = teg.compile(PAINTED, [D], backend="c")
    seen = 2.0 if keys[1] < keys[0] else 1.0
    rows = np.array([[0.5, 0.5, 0.3, keys[0], 1.0], [0.5, 0.5, 0.3, keys[1], 2.0]])
    assert f(D=rows) == pytest.approx(GROUND + (seen - GROUND) * np.pi * 0.09, abs=1e-13)


# -- sides of the box --------------------------------------------------------------------------------------------------

B = teg.array("B")
R = [D[k, i] for i in range(4)]
ONE = [D[0, i] for i in range(4)]
BORDERS: dict[str, tuple[Any, list[float]]] = {
    "half a disk, left": (lambda r: ((x - r[0]) ** 2 + (y - r[1]) ** 2 < r[2] ** 2) & (x <= r[0]), [0.0, 0.5, 0.3, 0.0]),
    "half a disk, left, in another box": (lambda r: ((x - r[0]) ** 2 + (y - r[1]) ** 2 < r[2] ** 2) & (x < r[0]), [1.0, 0.5, 0.3, 0.0]),
    "half a disk, above": (lambda r: ((x - r[0]) ** 2 + (y - r[1]) ** 2 < r[2] ** 2) & (y > r[1]), [0.4, 0.0, 0.3, 0.0]),
    "below a parabola": (lambda r: (y < r[2] + r[3] * (x - r[0]) ** 2) & (y > r[1]), [0.7, 0.0, 0.2, 0.8]),
    "a band that touches": (lambda r: (y > r[1]) & (y < r[2] + r[3] * (x - r[0]) ** 2), [0.3, 0.5, 1.0, 0.0]),
}


@pytest.mark.parametrize(("name", "sides"), list(zip(BORDERS, ["data", "data", "numbers", "numbers", "numbers"], strict=True)))
def test_edges_on_sides_of_boxes(name: str, sides: str) -> None:
    """Borders that lie on a side of the box have the derivatives of the same region written out, the mean of moving in and out."""
    inside, row = BORDERS[name]
    value = teg.exp(x * y) + x
    corner = (B[0], B[1]) if sides == "data" else (0, 1)
    programs = [
        teg.nearest(value, D[k, 3], ALL, where=inside(R), otherwise=x * y),
        teg.where(teg.any(inside(R), ALL), value, x * y),
        teg.where(inside(ONE), value, x * y),
    ]
    found = []
    for program in programs:
        f = teg.compile(teg.integral(program, (x, *corner), (y, *corner)), [D], backend="c")
        assert follows_edges(f) == (len(found) < 2)
        found.append(f.grad({"D": [row]} | ({"B": [0.0, 1.0]} if sides == "data" else {}))["D"])
    assert found[0] == pytest.approx(found[2], abs=1e-12)
    assert found[1] == pytest.approx(found[2], abs=1e-12)


# -- where there is nothing --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_to_choose_from(backend: str) -> None:
    f = teg.compile(teg.integral(teg.nearest(D[k, 4] * x, D[k, 3], ALL, where=INSIDE), *BOX), [D], backend=backend)
    assert follows_edges(f)
    whole = [0.5, 0.5, 0.8, 1.0, 3.0]
    assert f(D=[whole, [0.5, 0.5, 0.1, 2.0, 9.0]]) == pytest.approx(1.5, abs=1e-13)
    with pytest.warns(teg.AccuracyWarning, match="not a number"):
        assert np.isnan(f(D=[[0.5, 0.5, 0.6, 1.0, 3.0]]))


# -- one variable ------------------------------------------------------------------------------------------------------

LOWEST = teg.integral(teg.minimum_of(D[k, 0] * (x - D[k, 1]) ** 2 + D[k, 2], ALL), (x, 0, t))
INTERVALS = teg.integral(teg.nearest(D[k, 0] * x, D[k, 3], ALL, where=(x - D[k, 1]) ** 2 < D[k, 2] ** 2, otherwise=teg.exp(x)), (x, 0, t))


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_lowest_of_parabolas(backend: str) -> None:
    f = teg.compile(LOWEST, [D, t], backend=backend)
    assert follows_edges(f)
    rng = np.random.default_rng(1)
    for n in (1, 2, 6, 40):
        rows = np.c_[rng.uniform(0.5, 3, n), rng.uniform(0, 1, n), rng.uniform(0, 0.2, n)]
        value, slopes = f.value_and_grad(D=rows, t=0.9)
        places = np.linspace(0, 0.9, 200_001)
        heights = rows[:, :1] * (places - rows[:, 1:2]) ** 2 + rows[:, 2:]
        owner, step = heights.argmin(axis=0), places[1]
        weights = np.full(places.size, step)
        weights[[0, -1]] *= 0.5
        assert value == pytest.approx(weights @ heights.min(axis=0), abs=1e-10)
        assert slopes["D"][:, 2] == pytest.approx(np.bincount(owner, weights, n), abs=2e-5)
        away = places - rows[owner, 1]
        assert slopes["D"][:, 1] == pytest.approx(np.bincount(owner, -2 * weights * rows[owner, 0] * away, n), abs=2e-5)
        assert slopes["t"] == pytest.approx(heights[:, -1].min(), abs=1e-12)


def test_parabolas_that_touch_are_said(recwarn: pytest.WarningsRecorder) -> None:
    """Where two keys meet in a double root the value is right; a derivative that is no number is said, once, and by Teg."""
    f = teg.compile(LOWEST, [D, t])
    rows = [[1.0, 0.5, 0.1], [2.0, 0.5, 0.1]]
    value, slopes = f.value_and_grad(D=rows, t=0.9)
    assert value == pytest.approx((0.5**3 + 0.4**3) / 3 + 0.09, abs=1e-13)
    said = [w.category for w in recwarn]
    assert np.isfinite(slopes["D"]).all() or said == [teg.AccuracyWarning]


@pytest.mark.parametrize("backend", BACKENDS)
def test_intervals_on_each_other(backend: str) -> None:
    """By hand: the ends of what is seen, of which some are ends of several intervals."""
    f = teg.compile(INTERVALS, [D, t], backend=backend)
    assert follows_edges(f)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        middles, halves = rng.integers(0, 11, n) / 10, rng.integers(0, 5, n) / 10
        if seed % 2:
            middles, halves = rng.uniform(0, 1, n), rng.uniform(0, 0.5, n)
        rows = np.c_[rng.uniform(0, 1, n), middles, halves, rng.permutation(n)]
        ends = np.unique(np.clip(np.r_[0, 1, middles - halves, middles + halves], 0, 1))
        expected, moved = 0.0, np.zeros((n, 4))
        for lower, upper in pairwise(ends):
            owner = _owner(0.5 * (lower + upper), rows)
            square = 0.5 * (upper**2 - lower**2)
            expected += rows[owner, 0] * square if owner >= 0 else np.exp(upper) - np.exp(lower)
            if owner >= 0:
                moved[owner, 0] += square
        value, slopes = f.value_and_grad(D=rows, t=1.0)
        assert value == pytest.approx(expected, abs=1e-13), rows.tolist()
        assert slopes["D"][:, 0] == pytest.approx(moved[:, 0], abs=1e-13)
        if seed % 2:
            for j in range(n):
                for end, sign in ((middles[j] - halves[j], -1.0), (middles[j] + halves[j], 1.0)):
                    steps = [_shade(end + side * 1e-9, rows) for side in (-sign, sign)]
                    if 0 < end < 1 and _owner(end - sign * 1e-9, rows) == j:
                        moved[j, 1:3] += sign * (steps[0] - steps[1]) * np.array([1.0, sign])
            assert slopes["D"][:, 1:3] == pytest.approx(moved[:, 1:3], abs=1e-7)


def _owner(place: float, rows: np.ndarray) -> int:
    inside = np.flatnonzero(abs(place - rows[:, 1]) < rows[:, 2])
    return int(inside[rows[inside, 3].argmin()]) if inside.size else -1


def _shade(place: float, rows: np.ndarray) -> float:
    owner = _owner(place, rows)
    return float(rows[owner, 0] * place if owner >= 0 else np.exp(place))


@pytest.mark.parametrize("backend", BACKENDS)
def test_parabolas_where_they_hold(backend: str) -> None:
    """Against differences of a sum over pieces. The border between a key and itself is a quadratic equation of zeros and roundings."""
    key, within = (x - D[k, 0]) ** 2 * (1 + D[k, 2]) + 0.05 * D[k, 3], (x - D[k, 0]) ** 2 < 0.3 * D[k, 2] ** 2
    f = teg.compile(teg.integral(teg.nearest(D[k, 4], key, ALL, where=within, otherwise=GROUND), (x, 0, t)), [D, t], backend=backend)
    assert follows_edges(f)
    for n in (1, 2, 5):
        rows, along = some(n, n), np.random.default_rng(n).normal(size=(n, 5))
        value, slopes = f.value_and_grad(D=rows, t=0.8)
        assert value == pytest.approx(_by_pieces(rows, 0.8), abs=1e-13)
        near = [_by_pieces(rows + s * 1e-4 * along, 0.8) for s in (2, 1, -1, -2)]
        assert np.vdot(slopes["D"], along) == pytest.approx((-near[0] + 8 * near[1] - 8 * near[2] + near[3]) / 12e-4, abs=1e-9)


def _by_pieces(rows: np.ndarray, last: float) -> float:
    keys = [[1 + r, -2 * (1 + r) * c, (1 + r) * c * c + 0.05 * depth] for c, _, r, depth, _ in rows]
    halves = np.sqrt(0.3) * rows[:, 2]
    crossings = [np.roots(np.subtract(p, q)) for i, p in enumerate(keys) for q in keys[:i]]
    ends = np.concatenate([[0, last], rows[:, 0] - halves, rows[:, 0] + halves, *(c.real[c.imag == 0] for c in crossings)])
    total = 0.0
    for lower, upper in pairwise(np.unique(np.clip(ends, 0, last))):
        place = 0.5 * (lower + upper)
        holds = np.flatnonzero(abs(place - rows[:, 0]) < halves)
        total += (upper - lower) * (rows[min(holds, key=lambda j: np.polyval(keys[j], place)), 4] if holds.size else GROUND)
    return total


# -- others ------------------------------------------------------------------------------------------------------------


def test_others_are_written_out() -> None:
    """The highest of exponentials: where two cross has no formula."""
    f = teg.compile(teg.integral(teg.maximum_of(D[k, 1] * teg.exp(-D[k, 0] * x), ALL), (x, 0, 1)), [D])
    assert not follows_edges(f)
    value, slopes = f.value_and_grad(D=[[1.0, 1.0], [1.5, 1.3]])
    cross = np.log(1.3) / 0.5
    assert value == pytest.approx(1.3 * (1 - np.exp(-1.5 * cross)) / 1.5 + np.exp(-cross) - np.exp(-1), abs=1e-12)
    assert slopes["D"][:, 1] == pytest.approx([np.exp(-cross) - np.exp(-1), (1 - np.exp(-1.5 * cross)) / 1.5], abs=1e-12)


def test_second_derivatives_are_those_of_candidates_written_out() -> None:
    f = teg.compile(LOWEST, [D, t])
    rows, along = (
        np.array([[1.0, 0.2, 0.1], [2.0, 0.7, 0.0], [1.5, 0.5, 0.15]]),
        np.array([[0.2, -0.1, 0.3], [0.4, 0.3, 0.1], [0.1, 0.2, -0.3]]),
    )
    product = f.hvp({"D": rows, "t": 0.9}, {"D": along, "t": 0.0})["D"]
    near = [f.grad(D=rows + s * 1e-4 * along, t=0.9)["D"] for s in (2, 1, -1, -2)]
    assert product == pytest.approx((-near[0] + 8 * near[1] - 8 * near[2] + near[3]) / 12e-4, abs=1e-8)
