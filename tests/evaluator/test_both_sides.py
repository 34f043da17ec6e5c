"""Second derivatives at ties: means of both sides, beside differences of gradients, which are continuous there."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import teg

x, y = teg.vars("x y")
a, b, c, d, e, k, p, t = teg.params("a b c d e k p t")
LINES = {"a": 1.0, "b": 2.0, "c": 0.0, "d": 1.0, "e": -1.0, "k": 0.0}
"""Two lines through the corner (0, 0)."""
THROUGH = {"a": 1.0, "b": 2.0, "c": 1.5, "d": 1.0, "e": -1.0, "k": 0.0, "p": 0.5}
"""Three lines through (½, ½)."""
BETWEEN = teg.integral(teg.bracket((a * x + b * y > c) & (d * x + e * y < k)), (x, 0, 1), (y, 0, 1))
BELOW = teg.integral(teg.bracket((a * x + b * y > c) & (d * x + e * y < k) & (x < p)), (x, 0, 1), (y, 0, 1))
CIRCLE = teg.integral(teg.bracket((x - a) ** 2 + y * y < t), (x, 0, 1), (y, 0, 1))
BACKENDS = ["numpy", "c"]


def one_sided(f: Any, at: Mapping[str, Any], along: Mapping[str, Any], h: float) -> dict[str, Any]:
    """Returns the one-sided derivative of the gradient, extrapolated; along -direction it is that of the other side for h < 0."""
    here = f.grad(dict(at))
    beside = [f.grad({**at, **{n: at[n] + s * np.asarray(v) for n, v in along.items()}}) for s in (h, 0.5 * h)]
    return {n: (4.0 * (beside[1][n] - here[n]) - (beside[0][n] - here[n])) / h for n in here}


def assert_mean(f: Any, at: Mapping[str, Any], along: Mapping[str, Any], jumps: bool = True) -> None:
    """The product of the Hessian is the mean of both sides, without a warning, and where these differ they do so by something."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        product = f.hvp(dict(at), dict(along))
    above, below = (one_sided(f, at, along, h) for h in (1e-5, -1e-5))
    size = max(np.abs(above[n]).max() + np.abs(below[n]).max() for n in above)
    assert not jumps or max(np.abs(above[n] - below[n]).max() for n in above) > 1e-3 * size
    for n in product:
        np.testing.assert_allclose(product[n], 0.5 * (above[n] + below[n]), rtol=0.0, atol=3e-7 * max(1.0, size))


@pytest.mark.parametrize("backend", BACKENDS)
def test_vertices_in_corners(backend: str) -> None:
    """Products were outside of both sides, -¼ for 0 and -⅙, without a word."""
    f = teg.compile(BETWEEN, [a, b, c, d, e, k], backend=backend)
    for along in ({"c": 1.0}, {"k": 1.0}, {"c": 1.0, "k": -0.5}, {"a": 1.0, "c": 0.3, "k": 1.0}):
        assert_mean(f, LINES, along)
        (found,) = f.diagnose(LINES)
        assert found.kind == "second derivative"
        assert "their mean is given" in found.message
    product = f.hvp(LINES, {"c": 1.0})
    assert (product["c"], product["k"]) == pytest.approx((-1 / 12, -1 / 6), abs=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_hessians_with_more_than_two_sides_are_not_numbers(backend: str) -> None:
    f = teg.compile(BETWEEN, [a, b, c, d, e, k], backend=backend)
    with pytest.warns(teg.AccuracyWarning, match="the Hessian is not a number"):
        hessian = f.hessian(LINES)
    assert {pair for pair, v in hessian.items() if np.isnan(v)} == {("c", "c"), ("c", "k"), ("k", "c"), ("k", "k")}
    assert "more than two sides" in f.diagnose(LINES)[0].message


@pytest.mark.parametrize("backend", BACKENDS)
def test_three_lines_through_one_place(backend: str) -> None:
    f = teg.compile(BELOW, [a, b, c, d, e, k, p], backend=backend)
    hessian = f.hessian(THROUGH)
    for name in ("c", "k", "p"):
        along = {name: 1.0}
        assert_mean(f, THROUGH, along)
        product = f.hvp(THROUGH, along)
        assert [hessian[n, name] for n in product] == pytest.approx([*product.values()], abs=1e-8)


def test_elements_beside_a_tie_keep_their_bits() -> None:
    f = teg.compile(BETWEEN, [a, b, c, d, e, k])
    batch = {**LINES, "c": np.array([0.3, 0.0, 0.1]), "k": np.array([0.1, 0.0, 0.0])}
    products = f.hvp(batch, {"c": 1.0, "k": -0.5})
    for i in range(3):
        alone = f.hvp({**batch, "c": batch["c"][i], "k": batch["k"][i]}, {"c": 1.0, "k": -0.5})
        assert [v[i] for v in products.values()] == [*alone.values()]


@pytest.mark.parametrize("backend", BACKENDS)
def test_circles_through_corners(backend: str) -> None:
    """Outside of (1, 1) everything is covered, so its second derivatives there are 0, and half of those inside are the mean."""
    f = teg.compile(CIRCLE, [t, a], backend=backend)
    at = {"t": 2.0, "a": 0.0}
    assert f.diagnose(at) == []  # a gradient is all that was asked for
    assert [float(v) for v in f.hessian(at).values()] == pytest.approx([-1 / 8, -1 / 4, -1 / 4, -1 / 2], abs=1e-9)
    assert [found.kind for found in f.diagnose(at)] == ["second derivative"]
    assert_mean(f, at, {"t": 1.0, "a": 0.2})


def test_steps_that_meet_a_bound() -> None:
    """∫∫ floor(a·x + y + t) = t + a/2 near here, whichever step is at a corner: there are two sides with the same second derivatives."""
    f = teg.compile(teg.integral(teg.floor(a * x + y + t), (x, 0, 1), (y, 0, 1)), [t, a])
    assert [float(v) for v in f.hessian(t=0.0, a=1.0).values()] == pytest.approx([0.0] * 4, abs=1e-12)
    assert f.diagnose(t=0.0, a=1.0) == []


def test_surfaces_that_touch_stay_infinite() -> None:
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 2 + y * y < t), (x, -9, 5), (y, -9, 9)), [t, a])
    assert [float(v) for v in f.hessian(t=25.0, a=0.0).values()] == [-np.inf] * 4
    assert "infinite" in f.diagnose(t=25.0, a=0.0)[0].message


V, C, D, F = teg.array("V", 2), teg.array("C"), teg.array("D"), teg.indices("F", 2)
n, i, j = teg.index("n"), teg.index("i"), teg.index("j")
ANGLES = np.array([0.3, 1.5, 2.9, 4.1, 5.2])
FAN = np.vstack([[1.0, 1.0], 1.0 + 0.8 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)])
"""Five triangles around a corner of four pixels."""
FACES = np.array([[0, 1, 2], [2, 3, 0], [0, 3, 4], [5, 0, 4], [0, 5, 1]])


def edge(first: Any, last: Any) -> Any:
    return (V[last, 0] - V[first, 0]) * (y - V[first, 1]) - (V[last, 1] - V[first, 1]) * (x - V[first, 0])


INSIDE = (edge(F[n, 0], F[n, 1]) > 0) & (edge(F[n, 1], F[n, 2]) > 0) & (edge(F[n, 2], F[n, 0]) > 0)


def over_pixels(body: Any) -> Any:
    return teg.sum(teg.sum(teg.integral(body, (x, i, i + 1), (y, j, j + 1)), (i, 0, 2)), (j, 0, 2))


SUM = teg.sum(over_pixels(teg.bracket(INSIDE) * C[n] * (1 + x * (i + 1) + y * y * (j + 1))), (n, 0, teg.length(F, 0)))
NEAREST = over_pixels((teg.nearest(C[n] * (1 + x), D[n], (n, 0, teg.length(F, 0)), where=INSIDE, otherwise=0.3) - 0.2) ** 2)
VALUES = {"V": FAN, "C": np.array([1.0, -2.0, 0.7, 3.0, 0.1]), "D": np.arange(5.0), "F": FACES}
DIRECTIONS = [np.outer(np.eye(6)[0], [1.0, 0.3]), np.outer(np.eye(6)[0], [1.0, 0.0]), np.random.default_rng(0).normal(size=(6, 2))]


@pytest.mark.parametrize("backend", BACKENDS)
def test_triangles_around_a_corner_of_pixels(backend: str) -> None:
    f = teg.compile(SUM, [V, C], backend=backend)
    at = {name: VALUES[name] for name in f.parameters}
    assert f.diagnose(at) == []
    for along in DIRECTIONS:
        assert_mean(f, at, {"V": along})
    found = f.diagnose(at)
    assert {diagnosis.kind for diagnosis in found} == {"second derivative"}
    assert all(diagnosis.iteration for diagnosis in found)
    aside = {**at, "V": FAN + 0.01}
    assert f.diagnose(aside) == []


@pytest.mark.parametrize("backend", BACKENDS)
def test_nearest_triangles_around_a_corner_of_pixels(backend: str) -> None:
    """Pixels do not matter here, and nothing jumps: products were off by 364."""
    f = teg.compile(NEAREST, [V, C, D], backend=backend)
    for along in DIRECTIONS:
        assert_mean(f, VALUES, {"V": along}, jumps=False)
    assert f.diagnose(VALUES) == []


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("front", [1.0, -1.0])
def test_a_vertex_on_an_edge_behind_or_in_front(backend: str, front: float) -> None:
    f = teg.compile(NEAREST, [V, C, D], backend=backend)
    corners = np.array([[0.5, 0.5], [1.5, 0.6], [0.7, 1.4], [0.1, 0.3], [0.9, 0.7], [0.2, 0.9]])
    at = {"V": corners, "C": VALUES["C"][:2], "D": front * VALUES["D"][:2], "F": np.array([[0, 1, 2], [3, 4, 5]])}
    for along in DIRECTIONS:
        assert_mean(f, at, {"V": along})
    assert [diagnosis.kind for diagnosis in f.diagnose(at)] == ["second derivative"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_three_edges_through_one_place(backend: str) -> None:
    f = teg.compile(NEAREST, [V, C, D], backend=backend)
    corners = [[0.5 + 0.4 * np.cos(g + s), 0.5 + 0.4 * np.sin(g + s)] for g in (0.2, 1.3, 2.4) for s in (0.0, 1.5, np.pi)]
    at = {**VALUES, "V": np.array(corners), "C": VALUES["C"][:3], "D": VALUES["D"][:3], "F": np.arange(9).reshape(3, 3)}
    random = np.random.default_rng(1)
    for along in (np.outer(np.eye(9)[0], [1.0, 0.3]), random.normal(size=(9, 2))):
        assert_mean(f, at, {"V": along})
