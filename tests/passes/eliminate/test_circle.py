"""Circles and lines by one chart: sites with weights and half-planes among disks, against arcs of NumPy, closed forms and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, x, y
from tests.references.weighted_sites import mean_by_places, random_sites, slopes

KEY = D[k, 2] * ((x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2)
WINNER = teg.integral(teg.nearest(D[k, 3], KEY, ALL), *BOX)
ROUND = D[k, 0] * (x**2 + y**2) + D[k, 1] * x + D[k, 2] * y + D[k, 3] > 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_sites_with_weights(backend: str) -> None:
    """One program for any number of sites."""
    f = teg.compile(WINNER, [D], backend=backend)
    assert follows_edges(f)
    for n in (1, 2, 7):
        rows = random_sites(n, seed=n)
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(mean_by_places(rows), abs=2e-5)
        assert gradient["D"][:, :3] == pytest.approx(slopes(rows)[:, :3], abs=1e-10)
        assert gradient["D"][:, 3].sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(WINNER, [D], kernel=kernel)
    rows = random_sites(4, seed=8)
    gradient = jax.grad(lambda d: f(D=d))(rows)
    assert np.asarray(gradient)[:, :3] == pytest.approx(slopes(rows)[:, :3], abs=1e-10)


@pytest.mark.parametrize("w", [1.0, 1 + 1e-13, 1 + 1e-9, 1 + 1e-5, 1.2, 4.0, 1e3, 1e6])
def test_from_a_line_to_a_point(w: float) -> None:
    """Two sites: the heavier one wins in a disk around (w·a - b)/(w - 1) of the radius √w·|a - b|/(w - 1), a half-plane where w is 1."""
    f = teg.compile(WINNER, [D])
    rows = [[0.4, 0.5, w, 1.0], [0.6, 0.5, 1.0, 0.0]]
    value, gradient = f.value_and_grad(D=rows)
    radius = 0.2 * np.sqrt(w) / (w - 1) if w > 1 else np.inf
    if w >= 4.0:  # a disk within the square
        assert value == pytest.approx(np.pi * radius**2, rel=1e-11)
        by_w = -np.pi * 0.04 * (w + 1) / (w - 1) ** 3
        assert gradient["D"][0, 2] == pytest.approx(by_w, rel=1e-9)
        assert gradient["D"][:, 0] == pytest.approx([-2 * np.pi * 0.2 * w / (w - 1) ** 2, 2 * np.pi * 0.2 * w / (w - 1) ** 2], rel=1e-9)
        assert gradient["D"][:, 1] == pytest.approx([0.0, 0.0], abs=1e-12)
        return
    nodes, weights = np.polynomial.legendre.leggauss(60)
    half = 0.5 * nodes  # heights from the middle: the border is at centre + √(R² - h²) there, written without a difference
    if w > 1:
        sagitta = half**2 / (radius + np.sqrt(radius**2 - half**2))
        border = 0.5 - 0.1 * (w - 1) / (1 + np.sqrt(w)) ** 2 - sagitta  # on the axis the distances are as √w to 1
        slope_w = ((border - 0.4) ** 2 + half**2) / (2 * w * (border - 0.4) - 2 * (border - 0.6))
    else:
        border, slope_w = 0.5 + 0 * half, (0.01 + half**2) / 0.4
    assert value == pytest.approx(0.5 * weights @ border, abs=1e-13)
    assert gradient["D"][0, 2] == pytest.approx(-0.5 * weights @ slope_w, abs=1e-11)


def test_half_planes_and_disks_in_one_list() -> None:
    """a·(x² + y²) + b·x + c·y + d > 0 is a half-plane, a disk, or what is outside of one."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(ROUND, ALL)) * (1 + x), *BOX), [D], backend="c")
    assert follows_edges(f)
    plane, disk, hole = [0.0, -1.0, 0.0, 0.25], [-1.0, 1.4, 1.0, 0.04 - 0.49 - 0.25], [1.0, -1.0, -1.0, 0.5 - 0.36]
    value, gradient = f.value_and_grad(D=[plane, disk])
    assert value == pytest.approx(0.25 + 0.03125 + np.pi * 0.04 * 1.7)
    assert gradient["D"][:, 3] == pytest.approx([1.25, np.pi * 1.7])  # widths: ds, and ds/(2r)
    assert gradient["D"][:, 1] == pytest.approx([0.25 * 1.25, np.pi * (0.7 * 1.7 + 0.5 * 0.04)])
    inside = np.pi * 0.36 - 4 * (0.36 * np.arccos(0.5 / 0.6) - 0.5 * np.sqrt(0.36 - 0.25))  # a disk that four sides cut
    assert f(D=[hole]) == pytest.approx(1.5 * (1 - inside))
    assert f(D=[[0.0] * 4, disk]) == pytest.approx(np.pi * 0.04 * 1.7)
    assert f(D=[[0.0, 0.0, 0.0, 1.0], disk]) == pytest.approx(1.5)


def test_least_keys() -> None:
    """The integral of the least key, whose derivatives are those of the key where a site wins."""
    f = teg.compile(teg.integral(teg.minimum_of(KEY, ALL), *BOX), [D])
    assert follows_edges(f)
    rows = random_sites(5, seed=11)
    at = (np.arange(1500) + 0.5) / 1500
    keys = np.stack([w * ((at - c) ** 2 + (at[:, None] - d) ** 2) for c, d, w, _ in rows])
    value, gradient = f.value_and_grad(D=rows)
    assert value == pytest.approx(keys.min(axis=0).mean(), abs=1e-6)
    wins = [np.where(keys.argmin(axis=0) == j, keys[j] / rows[j, 2], 0.0).mean() for j in range(5)]
    assert gradient["D"][:, 2] == pytest.approx(wins, abs=2e-5)


def test_products_with_the_hessian() -> None:
    rows, moved = random_sites(2, seed=12), np.random.default_rng(1).normal(size=(2, 4)) * [1.0, 1.0, 1.0, 0.0]
    f = teg.compile(WINNER, [D])
    h = 2e-4
    around = [slopes(rows + s * h * moved) - slopes(rows - s * h * moved) for s in (1, 2, 3)]
    expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
    assert f.hvp({"D": rows}, {"D": moved})["D"][:, :3] == pytest.approx(expected[:, :3], abs=1e-7)


def test_far_from_the_origin() -> None:
    rows = random_sites(3, seed=13)
    far = teg.integral(teg.nearest(D[k, 3], KEY, ALL), (x, 1024, 1025), (y, 1024, 1025))
    moved = rows + np.array([1024.0, 1024.0, 0.0, 0.0])
    rows[:, :2] = moved[:, :2] - 1024.0
    gradient = teg.compile(far, [D]).grad(D=moved)["D"]
    assert gradient[:, :3] == pytest.approx(slopes(rows)[:, :3], abs=1e-9)
