"""Cut cells: quadrature of a bent region and its boundary, the disk against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from teg.examples.cut_cells import b_splines, quadrature, solve


def test_splines_sum_to_one_and_their_gradients_are_their_slopes() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    values, gradients = b_splines(points, 5)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-13)
    step = np.array([1e-6, 0])
    ahead, behind = (b_splines(points + s, 5)[0] for s in (step, -step))
    np.testing.assert_allclose(gradients[0], (ahead - behind) / 2e-6, atol=1e-8)


def test_the_disk_is_solved_exactly() -> None:
    disk = solve(4, 0.75, 0.0)
    assert disk.energy == pytest.approx(math.pi * 0.75**4 / 8, rel=1e-12)
    assert disk.slopes["s"] == pytest.approx(math.pi * 0.75**3 / 2, rel=1e-12)
    middle = disk.values(np.array([[0.0, 0.0], [0.3, 0.4], [1.0, 0.0]]), 0.75, 0.0)
    np.testing.assert_allclose(middle, [0.75**2 / 4, (0.75**2 - 0.25) / 4, 0], atol=1e-12)


def test_a_bent_region_has_the_area_of_its_polar_integral() -> None:
    _, points, weights = quadrature(3, 0.75, 0.35, "numpy")
    angles = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    radii = np.array(
        [min(r.real for r in np.roots([0.35 * math.cos(3 * v), -1, 0, 0.75**2]) if abs(r.imag) < 1e-9 and r.real > 0) for v in angles]
    )
    assert weights.sum() == pytest.approx((radii**2 / 2).mean() * 2 * math.pi, rel=1e-8)
    assert weights @ points[:, 0] ** 3 == pytest.approx((radii**5 / 5 * np.cos(angles) ** 3).mean() * 2 * math.pi, rel=1e-7)
