"""Borders between distances and numbers: additively weighted sites, against cells by angle in NumPy, closed forms and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, t, x, y
from tests.references.distance_sites import mean, mean_by_places, random_sites, slope_along

DISTANCE = teg.sqrt((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2)
WINNER = teg.integral(teg.nearest(D[k, 3] * (1 + x * y), DISTANCE - D[k, 2], ALL), *BOX)


@pytest.mark.parametrize("backend", BACKENDS)
def test_any_number_of_sites(backend: str) -> None:
    """One program for all."""
    f = teg.compile(WINNER, [D], backend=backend)
    assert follows_edges(f)
    for n in (1, 2, 5, 11) if backend == "numpy" else (3,):
        rows = random_sites(n, seed=n)
        direction = np.random.default_rng(n).standard_normal(rows.shape)
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(mean(rows), abs=1e-11)
        assert value == pytest.approx(mean_by_places(rows), abs=2e-4)
        assert (gradient["D"] * direction).sum() == pytest.approx(slope_along(rows, direction), abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_products_with_the_hessian(backend: str) -> None:
    f = teg.compile(WINNER, [D], backend=backend)
    assert follows_edges(f, 2)
    for n in (2, 5):
        rows = random_sites(n, seed=n)
        direction = np.random.default_rng(n).standard_normal(rows.shape)
        product = f.hvp({"D": rows}, {"D": direction})["D"]
        step = 1e-5
        ahead, behind = (f.grad(D=rows + s * step * direction)["D"] for s in (1, -1))
        assert product == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_second_derivatives(backend: str) -> None:
    """By the places of the sites along x, which move."""
    places = teg.array("P", 1)
    distance = teg.sqrt((x - places[k]) ** 2 + (y - D[k, 1]) ** 2)
    winner = teg.nearest(D[k, 3] * (1 + x * y), distance - D[k, 2], ALL)
    f = teg.compile(teg.integral(winner, *BOX), [places], backend=backend)
    assert follows_edges(f, 2)
    rows, direction, step = random_sites(5, seed=5), np.random.default_rng(5).standard_normal(5), 1e-5
    ahead, behind = (f.grad(D=rows, P=rows[:, 0] + s * step * direction)["P"] for s in (1, -1))
    assert f.hvp({"D": rows, "P": rows[:, 0]}, {"P": direction})["P"] == pytest.approx((ahead - behind) / (2 * step), abs=1e-5)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(WINNER, [D], kernel=kernel)
    rows = random_sites(3, seed=5)
    direction = np.random.default_rng(5).standard_normal(rows.shape)
    gradient = np.asarray(jax.grad(lambda d: f(D=d))(rows))
    assert (gradient * direction).sum() == pytest.approx(slope_along(rows, direction), abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_in_a_metric_that_all_share(backend: str) -> None:
    """Where one axis is t times as long, in coordinates in which it is not: the mean does not depend on t. In C with derivatives by
    all data, too, which takes longer."""
    u, v = x - D[k, 0], y - D[k, 1] / t
    mean_of = t * teg.integral(
        teg.nearest(D[k, 3] * (1 + x * y * t), teg.sqrt(3 * u**2 + 3 * t**2 * v**2) - D[k, 2], ALL), (x, 0, 1), (y, 0, 1 / t)
    )
    f = teg.compile(mean_of, [t] if backend == "numpy" else [D, t], backend=backend)
    assert follows_edges(f, 2)
    rows, direction = random_sites(4, seed=8), np.random.default_rng(8).standard_normal((4, 4))
    stretched = np.array([1.0, 1.0, np.sqrt(3.0), 1.0])
    for length in (0.4, 1.0, 1.7):
        value, gradient = f.value_and_grad(D=rows * stretched, t=length)
        assert value == pytest.approx(mean(rows), abs=1e-11)
        assert gradient["t"] == pytest.approx(0.0, abs=1e-10)
        if "D" in gradient:
            assert (gradient["D"] * direction).sum() == pytest.approx(slope_along(rows, direction / stretched), abs=1e-8)
    assert f.hvp({"D": rows * stretched, "t": 1.3}, {"t": 1.0})["t"] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("shift", [0.0, 1e-15, -1e-9, 1e-5, 0.1, -0.3, 0.39, 0.39999])
def test_from_a_line_to_a_needle(shift: float) -> None:
    """Two sites 0.4 apart: at 0 the border is a line, towards 0.4 a cell becomes a needle. Its width where x is x: of the branch
    (x - ½)²/a² - (y - ½)²/b² = 1 with a = |shift|/2, b² = 0.04 - a²."""
    f = teg.compile(WINNER, [D])
    rows = np.array([[0.3, 0.5, 0.0, 0.0], [0.7, 0.5, shift, 1.0]])
    value, gradient = f.value_and_grad(D=rows)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    a, heights = abs(shift) / 2, 0.5 * nodes
    b = np.sqrt(0.04 - a * a)
    border = 0.5 - np.sign(shift) * a * np.sqrt(1 + (heights / b) ** 2)  # a larger number is nearer
    left = np.clip(border, 0.0, 1.0)
    expected = 0.5 * weights @ (1 - left + (0.5 + heights) * (1 - left**2) / 2)
    leaves = ((border < 0) | (border > 1)).any()  # a bend, at which rules are less exact
    assert value == pytest.approx(expected, abs=1e-4 if leaves else 1e-12)
    assert value == pytest.approx(mean(rows), abs=1e-11)
    assert gradient["D"][1, 2] == pytest.approx(-gradient["D"][0, 2], rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_degenerate_sites(backend: str) -> None:
    f = teg.compile(WINNER, [D], backend=backend)
    same = [[0.3, 0.4, 0.1, 1.0], [0.3, 0.4, 0.1, 2.0], [0.7, 0.6, 0.1, 3.0]]
    assert f(D=same) == pytest.approx(mean(np.array([same[0], same[2]])), abs=1e-12)  # the first of equal ones
    beaten = [[0.3, 0.4, 0.0, 1.0], [0.35, 0.4, 0.2, 2.0], [0.7, 0.6, 0.1, 3.0]]
    value, gradient = f.value_and_grad(D=beaten)
    assert value == pytest.approx(mean(np.array(beaten)), abs=1e-12)
    assert np.array_equal(gradient["D"][0], np.zeros(4))  # another site is nearer everywhere
    near = [[0.5, 0.5, 0.2, 1.0], [0.52, 0.5, 0.0, 2.0], [0.6, 0.5, 0.22, 3.0]]  # without a border of the second one
    assert f(D=near) == pytest.approx(mean(np.array(near)), abs=1e-12)
    corners = [[0.5, 0.5, 0.2, 1.0], [0.0, 0.0, 0.0, 2.0], [1.0, 0.0, 0.0, 3.0], [0.0, 1.0, 0.0, 5.0], [1.0, 1.0, 0.0, 7.0]]
    assert f(D=corners) == pytest.approx(mean(np.array(corners)), abs=1e-11)
    around = [[0.25, 0.25, 0.1, 1.0], [0.25, 0.75, 0.1, 2.0], [0.75, 0.25, 0.1, 3.0], [0.75, 0.75, 0.1, 4.0]]
    assert f(D=around) == pytest.approx(mean(np.array(around)), abs=1e-12)
    far = [[100.25, 0.25, 100.0, 1.0], [0.75, 0.25, 0.2, 2.0], [0.5, 0.75, 0.1, 3.0]]
    assert f(D=far) == pytest.approx(mean(np.array(far)), abs=1e-11)


def test_times_of_arrival() -> None:
    """Crystals that begin to grow at different times, all with one speed, at first and in a scaled key; the first time itself."""
    rows = random_sites(4, seed=3)
    rows[:, 2] *= -1.0  # now times
    scaled = teg.nearest(D[k, 3] * (1 + x * y), 2 * t * (D[k, 2] + DISTANCE / t), ALL)
    f = teg.compile(teg.integral(scaled, *BOX), [D, t])
    assert follows_edges(f)
    by_speed = rows.copy()
    by_speed[:, 2] *= -1.3
    assert f(D=rows, t=1.3) == pytest.approx(mean(by_speed), abs=1e-11)
    first = teg.compile(teg.integral(teg.minimum_of(D[k, 2] + DISTANCE / t, ALL), *BOX), [D, t])
    value, gradient = first.value_and_grad(D=rows, t=1.3)
    assert gradient["D"][:, 2].sum() == pytest.approx(1.0, abs=1e-9)  # all later: it is later
    step = 1e-4
    by_t = (first(D=rows, t=1.3 + step) - first(D=rows, t=1.3 - step)) / (2 * step)
    assert gradient["t"] == pytest.approx(float(by_t), abs=1e-7)
    assert value == pytest.approx(_mean_of_first(rows, 1.3), abs=1e-5)


def _mean_of_first(rows: np.ndarray, speed: float) -> float:
    at = (np.arange(600) + 0.5) / 600
    u, v = np.meshgrid(at, at)
    return float(np.min([s + np.hypot(u - p, v - q) / speed for p, q, s, _ in rows], axis=0).mean())


@pytest.mark.parametrize(("scale", "winner"), [(0.0, 2.0), (1e-200, 2.0), (-1.0, None)])
def test_distances_that_do_not_count(scale: float, winner: float | None) -> None:
    """Times a number that may be 0 or negative: at 0 the numbers beside the distances decide, below it the farthest site is chosen."""
    f = teg.compile(teg.integral(teg.nearest(D[k, 3], t * DISTANCE - D[k, 2], ALL), *BOX), [D, t])
    rows = [[0.3, 0.4, 0.1, 1.0], [0.7, 0.6, 0.3, 2.0], [0.5, 0.9, 0.2, 5.0]]
    value, gradient = f.value_and_grad(D=rows, t=scale)
    if winner is not None:
        assert value == winner
        assert np.array_equal(gradient["D"][:, 3], [0.0, 1.0, 0.0])
        assert gradient["t"] == 0.0
    else:
        at = (np.arange(1000) + 0.5) / 1000
        u, v = np.meshgrid(at, at)
        farthest = np.argmax([np.hypot(u - p, v - q) + c for p, q, c, _ in rows], axis=0)
        assert value == pytest.approx(np.array(rows)[farthest, 3].mean(), abs=2e-4)


def test_where_lines_are() -> None:
    """Sites that count on one side of a line only."""
    inside = x + 0.5 * y < 1.1 - D[k, 2]
    chosen = teg.nearest(D[k, 3] * (1 + x * y), DISTANCE - D[k, 2], ALL, where=inside, otherwise=0.5)
    f = teg.compile(teg.integral(chosen, *BOX), [D])
    assert follows_edges(f)
    rows = random_sites(4, seed=7)
    direction = np.random.default_rng(7).standard_normal(rows.shape)
    value, gradient = f.value_and_grad(D=rows)
    at = (np.arange(1500) + 0.5) / 1500
    u, v = np.meshgrid(at, at)
    keys = np.array([np.where(u + 0.5 * v < 1.1 - s, np.hypot(u - p, v - q) - s, np.inf) for p, q, s, _ in rows])
    there = np.isfinite(keys).any(axis=0)
    assert value == pytest.approx(np.where(there, rows[keys.argmin(axis=0), 3] * (1 + u * v), 0.5).mean(), abs=2e-3)
    step = 1e-5
    ahead, behind = (float(f(D=rows + s * step * direction)) for s in (1, -1))
    assert (gradient["D"] * direction).sum() == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)


def test_borders_that_share_no_focus() -> None:
    """Regions |z - p| - |z - q| > c with foci of their own are written out."""
    near, far = (teg.sqrt((x - D[k, i]) ** 2 + (y - D[k, i + 1]) ** 2) for i in (0, 2))
    f = teg.compile(teg.integral(teg.bracket(teg.any(near - far > D[k, 4], ALL)), *BOX), [D])
    rows = np.array([[0.2, 0.3, 0.7, 0.6, 0.1], [0.9, 0.1, 0.3, 0.8, 0.4]])
    direction = np.random.default_rng(1).standard_normal(rows.shape)
    at = (np.arange(1000) + 0.5) / 1000
    u, v = np.meshgrid(at, at)
    inside = [np.hypot(u - p, v - q) - np.hypot(u - r, v - s) > c for p, q, r, s, c in rows]
    value, gradient = f.value_and_grad(D=rows)
    assert value == pytest.approx(np.any(inside, axis=0).mean(), abs=1e-4)
    step = 1e-4
    ahead, behind = (float(f(D=rows + s * step * direction)) for s in (1, -1))
    assert (gradient["D"] * direction).sum() == pytest.approx((ahead - behind) / (2 * step), abs=1e-6)
