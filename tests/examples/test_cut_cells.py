"""Cut cells: quadrature of a bent region and its boundary, the disk against its closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from teg.errors import InputError

pytest.importorskip("matplotlib")

from teg.examples.cut_cells import b_splines, make_region, quadrature, solve


def test_splines_sum_to_one_and_their_gradients_are_their_slopes() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    values, gradients = b_splines(points, 5)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-13)
    step = np.array([1e-6, 0])
    ahead, behind = (b_splines(points + s, 5)[0] for s in (step, -step))
    np.testing.assert_allclose(gradients[0], (ahead - behind) / 2e-6, atol=1e-8)


def test_the_disk_is_solved_exactly() -> None:
    disk = solve(make_region(values={"s": 0.75, "k": 0.0}), 4)
    assert disk.energy == pytest.approx(math.pi * 0.75**4 / 8, rel=1e-12)
    assert disk.slopes["s"] == pytest.approx(math.pi * 0.75**3 / 2, rel=1e-12)
    middle = disk.values(np.array([[0.0, 0.0], [0.3, 0.4], [1.0, 0.0]]))
    np.testing.assert_allclose(middle, [0.75**2 / 4, (0.75**2 - 0.25) / 4, 0], atol=1e-12)


def test_a_bent_region_has_the_area_of_its_polar_integral() -> None:
    _, points, weights = quadrature(make_region(), 3)
    angles = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    radii = np.array(
        [min(r.real for r in np.roots([0.35 * math.cos(3 * v), -1, 0, 0.75**2]) if abs(r.imag) < 1e-9 and r.real > 0) for v in angles]
    )
    assert weights.sum() == pytest.approx((radii**2 / 2).mean() * 2 * math.pi, rel=1e-8)
    assert weights @ points[:, 0] ** 3 == pytest.approx((radii**5 / 5 * np.cos(angles) ** 3).mean() * 2 * math.pi, rel=1e-7)


def test_a_level_set_of_the_users_is_solved_exactly_where_its_solution_is_a_polynomial() -> None:
    ellipse = make_region("0.36 - x**2 - 2*(y - 0.2)**2", {})  # u = ω/6
    solution = solve(ellipse, 3)
    a, b = 0.6, 0.6 / math.sqrt(2)
    assert solution.energy == pytest.approx(math.pi * a * b * 0.36 / 12, rel=1e-9)
    assert solution.slopes["c"] == pytest.approx(math.pi * a * b / 6, rel=1e-7)
    assert solution.values(np.array([[0.0, 0.2], [1.0, 1.0]])) == pytest.approx([0.06, 0])


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("x + z", "not understood"),
        ("1 +", "not a formula"),
        ("x", "reaches the border"),
        ("-1 - x**2", "positive nowhere"),
        ("sqrt(0.5 - x**2 - y**2)", "not finite"),
    ],
)
def test_a_level_set_without_a_region_in_the_square_is_refused(formula: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_region(formula, {})


def test_a_level_set_of_tiny_numbers_is_refused() -> None:
    with pytest.raises(InputError, match="no cell has nodes"):
        solve(make_region("1e-300*(0.5 - x**2 - y**2)", {}), 2)
