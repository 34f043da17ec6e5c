"""Derivatives of cells of regular sites, where many pairs of sites have one bisector, against half-planes.

The reference cuts every cell by all bisectors and shares nothing with the compiler. Derivatives along random directions are compared with
central differences of it; values that jump from cell to cell make every wrong owner of an edge visible.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from tests.end_to_end.test_nearest_scenes import slope_along


def grid(count: int, seed: int | None = None) -> np.ndarray:
    places = (np.arange(count) + 0.5) / count
    sites = np.stack([axis.ravel() for axis in np.meshgrid(places, places)], axis=1)
    return sites if seed is None else sites[np.random.default_rng(seed).permutation(len(sites))]


def turned(sites: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (sites - 0.5) @ np.array([[c, s], [-s, c]]) + 0.5


def hexagonal() -> np.ndarray:
    sites = [[0.1 + 0.3 * i + 0.15 * (j % 2), 0.1 + 0.3 * np.sqrt(0.75) * j] for i in range(3) for j in range(4)]
    return np.array(sites)[np.random.default_rng(4).permutation(12)]


SITES = {
    **{f"grid {n}": grid(n) for n in (2, 3, 4)},
    **{f"shuffled grid {n}, {s}": grid(n, s) for n in (2, 3, 4) for s in range(2)},
    "hexagonal": hexagonal(),
    "one line": np.stack([np.array([0.1, 0.7, 0.3, 0.9]), np.full(4, 0.4)], axis=1),
    "turned grid": turned(grid(3, 1), 30.0),
    "turned hexagons": turned(hexagonal(), 30.0),
    "borders on the box": grid(3, 2) + np.array([1 / 6, 0.0]),
    "wide": (grid(4, 3) - 0.5) * 1.7 + 0.5,
}
WEIGHTED = {"alternating": lambda n: 0.01 * (np.arange(n) % 2), "equal": lambda n: np.full(n, 0.3)}


def problem(kind: str) -> tuple[teg.Expr, Any]:
    """The integral over the cells of sites S with weights W, and what the reference integrates in each cell."""
    k = teg.index("k")
    x, y = teg.vars("x y")
    S, W, V = teg.array("S", 2), teg.array("W"), teg.array("V", 2)
    key = (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2 - W[k]
    several = (k, 0, teg.length(W))
    value = teg.nearest(V[k, 0] + V[k, 1] * x, key, several) if kind == "nearest" else teg.minimum_of(key, several)
    return teg.integral(value, (x, 0, 1), (y, 0, 1)), S


def reference(kind: str, given: dict[str, Any]) -> float:
    """Each cell is the box, cut by the bisectors with all other sites; the midpoints of the sides of triangles are exact for squares."""
    S, W, V = given["S"], given["W"], given["V"]
    total = 0.0
    for k, (s, w, v) in enumerate(zip(S, W, V, strict=True)):
        corners = [np.array(corner) for corner in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
        for m in range(len(S)):
            if m != k:
                corners = cut(corners, S[m] @ S[m] - W[m] - s @ s + w, 2 * (s - S[m]))
        for i in range(1, len(corners) - 1):
            p, q, r = corners[0], corners[i], corners[i + 1]
            (a, b), (c, d) = q - p, r - p
            for x, y in ((p + q) / 2, (q + r) / 2, (r + p) / 2):
                body = v[0] + v[1] * x if kind == "nearest" else (x - s[0]) ** 2 + (y - s[1]) ** 2 - w
                total += (a * d - b * c) / 6 * body
    return float(total)


def cut(corners: list[Any], constant: float, slope: Any) -> list[Any]:
    """The part of a convex polygon on which constant + slope·(x, y) >= 0."""
    values = [constant + slope @ corner for corner in corners]
    part = []
    for (p, d), (q, e) in zip(
        zip(corners, values, strict=True), zip(corners[1:] + corners[:1], values[1:] + values[:1], strict=True), strict=True
    ):
        if d >= 0:
            part.append(p)
        if d * e < 0:
            part.append(p + d / (d - e) * (q - p))
    return part


def given_for(sites: np.ndarray, weights: Any = None) -> dict[str, Any]:
    rng = np.random.default_rng(len(sites))
    return {"S": sites, "W": np.zeros(len(sites)) if weights is None else weights, "V": rng.normal(size=(len(sites), 2))}


def directions(given: dict[str, Any], seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=given[name].shape) for name in "SWV"}


@pytest.fixture(scope="module")
def programs() -> dict[tuple[str, str], Any]:
    return {
        (kind, backend): teg.compile(problem(kind)[0], backend=backend) for kind in ("nearest", "minimum") for backend in ("c", "numpy")
    }


def check(f: Any, kind: str, given: dict[str, Any], h: float = 1e-6) -> None:
    known = {name: given[name] for name in given if kind == "nearest" or name != "V"}
    value, gradient = f.value_and_grad(**known)
    assert float(value) == pytest.approx(reference(kind, given), abs=1e-10)
    for seed, names in enumerate(("S", "W", "SWV")):
        if kind == "minimum":
            names = names.replace("V", "")
        direction = {name: d for name, d in directions(given, seed).items() if name in names}
        exact = sum(float((gradient[name] * d).sum()) for name, d in direction.items())
        one, two = (slope_along(lambda v: reference(kind, v), given, direction, step) for step in (h, h / 4))
        assert abs(one - two) < 1e-4
        assert exact == pytest.approx(two, abs=1e-6 + 3 * abs(one - two)), names


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("kind", ["nearest", "minimum"])
@pytest.mark.parametrize("name", SITES)
def test_cells_of_sites(programs: Any, name: str, kind: str, backend: str) -> None:
    check(programs[kind, backend], kind, given_for(SITES[name]))


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("weights", WEIGHTED)
@pytest.mark.parametrize("count", [2, 3])
def test_power_cells_of_grids(programs: Any, count: int, weights: str, backend: str) -> None:
    sites = grid(count, 5)
    check(programs["nearest", backend], "nearest", given_for(sites, WEIGHTED[weights](len(sites))))


@pytest.mark.parametrize("name", ["shuffled grid 3, 1", "hexagonal", "turned grid"])
def test_forward_derivatives(programs: Any, name: str) -> None:
    given = given_for(SITES[name])
    direction = directions(given, 3)
    for backend in ("c", "numpy"):
        f = programs["nearest", backend]
        gradient = f.grad(**given)
        expected = sum(float((gradient[n] * d).sum()) for n, d in direction.items())
        assert float(f.jvp(given, direction)[1]) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_many_boxes_have_the_derivatives_of_one(backend: str) -> None:
    """Pixels of a picture of a grid: borders of cells lie inside of some and on the sides of others."""
    k, i, j = teg.index("k"), teg.index("i"), teg.index("j")
    x, y = teg.vars("x y")
    S, V = teg.array("S", 2), teg.array("V")
    nearest = teg.nearest(V[k], (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2, (k, 0, teg.length(V)))
    one = teg.compile(teg.integral(nearest * (1 + x), (x, 0, 1), (y, 0, 1)), backend=backend)
    pixel = (x, i / 6, (i + 1) / 6), (y, j / 6, (j + 1) / 6)
    many = teg.compile(teg.sum(teg.integral(nearest * (1 + x), *pixel), (i, 0, 6), (j, 0, 6)), backend=backend)
    for sites in (grid(2, 1), grid(3, 2), grid(4, 7), turned(grid(3, 3), 30.0)):
        given = {"S": sites, "V": np.random.default_rng(1).normal(size=len(sites))}
        whole, parts = one.grad(**given), many.grad(**given)
        for name in "SV":
            np.testing.assert_allclose(parts[name], whole[name], atol=1e-8)


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]])
def test_three_keys_equal_on_a_line_have_no_derivative(backend: str, order: list[int]) -> None:
    """The one in the middle is seen as soon as its key is any less: from one side only."""
    k = teg.index("k")
    x, y = teg.vars("x y")
    A, V = teg.array("A"), teg.array("V")
    several = (k, 0, teg.length(V))
    f = teg.compile(teg.integral(teg.nearest(V[k], A[k] * (x + 0.3 * y - 0.6), several), (x, 0, 1), (y, 0, 1)), backend=backend)
    given = {"A": np.array([0.0, -1.0, -2.0])[order], "V": np.array([1.0, 5.0, 2.0])[order]}
    assert np.isfinite(float(f(**given)))
    with pytest.warns(teg.AccuracyWarning):
        gradient = f.grad(**given)
    assert np.isnan(gradient["A"]).any()


def sides_and_product(f: Any, given: dict[str, Any], direction: dict[str, Any], h: float = 1e-6) -> list[np.ndarray]:
    """Derivatives of the gradient along a direction, from behind and ahead, and the product with the Hessian, each (numbers,)."""

    def gradient(step: float) -> np.ndarray:
        there = {n: v + step * direction[n] if n in direction else v for n, v in given.items()}
        return np.concatenate([np.ravel(v) for v in f.grad(**there).values()])

    behind, ahead = (gradient(-h) - gradient(-2 * h)) / h, (gradient(2 * h) - gradient(h)) / h
    return [behind, ahead, np.concatenate([np.ravel(v) for v in f.hvp(given, direction).values()])]


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("kind", ["nearest", "minimum"])
@pytest.mark.parametrize("name", ["grid 2", "shuffled grid 3, 1", "hexagonal", "turned grid"])
def test_second_derivatives_of_grids_are_means(programs: Any, name: str, kind: str, backend: str) -> None:
    """Four sites around one place may be taken apart in two ways. Where several pairs have one bisector, the derivatives were NaN."""
    given = given_for(SITES[name])
    given, direction = ({n: v for n, v in numbers.items() if kind == "nearest" or n != "V"} for numbers in (given, directions(given, 2)))
    behind, ahead, product = sides_and_product(programs[kind, backend], given, direction)
    np.testing.assert_allclose(product, (behind + ahead) / 2, atol=1e-3 * np.abs(product).max())


@pytest.fixture(scope="module")
def colours() -> dict[str, Any]:
    k = teg.index("k")
    x, y = teg.vars("x y")
    S, V = teg.array("S", 2), teg.array("V")
    nearest = teg.nearest(V[k], (x - S[k, 0]) ** 2 + (y - S[k, 1]) ** 2, (k, 0, teg.length(V)))
    e = teg.integral(nearest, (x, 0, 1), (y, 0, 1))
    return {backend: teg.compile(e, [S], backend=backend) for backend in ("c", "numpy")}  # type: ignore[call-overload]


PLACES = {
    "three sites around a place on a side": [[0, 0], [1, 0], [0.5, 0.5]],
    "the same, one cell outside": [[0, 0], [1, 0], [0.5, -0.5]],
    "a bisector through corners": [[0, 0], [1, 1]],
    "a bisector past a corner": [[1, 0.5], [1.5, 1]],
    "four sites around a place": [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]],
    "four sites on a circle": [[0.9, 0.5], [0.5, 0.9], [0.1, 0.5], [0.74, 0.82]],
}


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("name", PLACES)
def test_second_derivatives_that_jump_are_means(colours: Any, name: str, backend: str) -> None:
    """They were outside of both sides, without a warning."""
    given = {"S": np.array(PLACES[name], dtype=float), "V": np.array([0.0, 1.0, 3.0, 7.0])[: len(PLACES[name])]}
    direction = {"S": np.array([[1.0, -2.0], [3.0, 2.0], [7.0, 10.0], [-4.0, 3.0]])[: len(PLACES[name])]}
    behind, ahead, product = sides_and_product(colours[backend], given, direction)
    assert np.abs(behind - ahead).max() > 0.1
    np.testing.assert_allclose(product, (behind + ahead) / 2, atol=1e-3 * np.abs(product).max())


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("sites", [[[0, 0.5], [0, 1.5], [-0.5, 1]], [[0.9, 0.5], [0.5, 0.9], [0.1, 0.5], [0.5, 0.1], [0.74, 0.82]]])
def test_second_derivatives_with_more_than_two_sides_are_not_known(colours: Any, sites: list[list[float]], backend: str) -> None:
    """Three sites around a corner of the box, and five around a place."""
    given = {"S": np.array(sites, dtype=float), "V": np.arange(float(len(sites)))}
    with pytest.warns(teg.AccuracyWarning):
        product = colours[backend].hvp(given, {"S": np.ones((len(sites), 2))})
    assert np.isnan(product["S"]).any()
