"""OpenDR, the neural mesh renderer and a boundary term of paths: each does what its paper says, with the bias that it has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import teg
from teg.examples.estimators import nmr, opendr, psdr
from teg.examples.estimators.raster import Array, drawn, exact_slopes

N = 32
CORNERS = np.array([[0.2, 0.15], [0.85, 0.35], [0.4, 0.8]])
COLOURS = np.array([1.0, 0.4, 0.7])
UPRIGHT = np.array([[0.3, 0.2], [0.8, 0.5], [0.3, 0.8]])
"""A triangle whose left edge is vertical, 0.6 long, 0.1 pixels from the middles of a column."""
FLAT = np.ones(3)


def shifted(corners: Array, x: float) -> Array:
    return corners + np.array([x, 0.0])


# -- OpenDR ------------------------------------------------------------------------------------------------------------


def test_image_filters_are_exact_inside_of_linear_colours() -> None:
    picture = drawn(CORNERS, COLOURS, 0.1, N)
    border, _ = opendr.silhouette(picture)
    inside = picture.inside & ~border
    for step in (1, -1):  # and no neighbour outside
        for axis in (0, 1):
            inside &= np.roll(picture.inside & ~border, step, axis)
    assert inside.sum() > 50
    truth = exact_slopes(CORNERS, COLOURS, 0.1, N)
    assert np.allclose(opendr.image_slopes(picture)[inside], truth[inside], atol=1e-9)


def test_a_silhouette_along_the_pixels_has_the_right_total() -> None:
    slopes = opendr.image_slopes(drawn(UPRIGHT, FLAT, 0.25, N))[:, 9, [0, 2], 0]  # the left edge's column and ends
    assert slopes.sum() / N**2 == pytest.approx(-0.75 * 0.6, rel=2 / (0.6 * N))


def test_the_filter_does_not_see_motion_within_a_pixel() -> None:
    """The bias of their paper: the derivative of the picture's Taylor expansion, not of what is between the samples."""
    first, moved = (opendr.image_slopes(drawn(shifted(UPRIGHT, x), FLAT, 0.25, N))[:, : N // 3] for x in (0.0, 0.2 / N))
    assert np.allclose(first.sum(axis=2), moved.sum(axis=2))


def test_the_filter_misses_what_is_thinner_than_a_pixel() -> None:
    """Both neighbours of its pixels have the colour of the background."""
    needle = np.array([[0.515, 0.1], [0.518, 0.1], [0.516, 0.9]])
    assert np.abs(opendr.image_slopes(drawn(needle, FLAT, 0.0, N))[..., 0]).sum() == 0.0
    assert np.abs(exact_slopes(needle, FLAT, 0.0, N).sum(axis=(0, 1))).max() > 100


# -- the neural mesh renderer ------------------------------------------------------------------------------------------


def one_pixel(row: int, column: int, slope: float) -> Array:
    slopes = np.zeros((N, N))
    slopes[row, column] = slope
    return slopes


@pytest.mark.parametrize("column", [5, 8])
def test_a_ramp_leads_from_the_edge_to_a_pixel(column: int) -> None:
    picture = drawn(UPRIGHT, FLAT, 0.25, N)
    height, row = (15 + 0.5) / N, 15
    s = (height - 0.8) / (0.2 - 0.8)  # of edge 2 → 0, which is vertical
    distance = (column + 0.5) / N - 0.3 - nmr.EPSILON
    slopes = nmr.loss_slopes(picture, one_pixel(row, column, -1.0))  # a brighter pixel would lower the loss
    assert slopes[:, 0] == pytest.approx([-s * 0.75 / distance, 0.0, -(1 - s) * 0.75 / distance])


def test_a_pixel_that_would_raise_the_loss_has_no_part() -> None:
    picture = drawn(UPRIGHT, FLAT, 0.25, N)
    assert not nmr.loss_slopes(picture, one_pixel(15, 5, 1.0)).any()


def test_inside_of_the_triangle_the_other_side_is_uncovered() -> None:
    picture = drawn(UPRIGHT, FLAT, 0.25, N)
    slopes = nmr.loss_slopes(picture, one_pixel(15, 12, 1.0))  # a darker pixel would lower the loss
    distance = 12.5 / N - 0.3 + nmr.EPSILON
    assert slopes[[0, 2], 0].sum() == pytest.approx(-0.75 / distance, rel=0.02)  # the right edges share a corner each
    assert slopes[1, 0] > 0  # the right edges move to the left


def test_the_ramps_do_not_converge_to_the_derivative() -> None:
    """Their gradient is made for descent: with four times as many pixels it is as far from the derivative as before."""
    ratios = []
    for n in (32, 128):
        picture, goal = (drawn(shifted(UPRIGHT, x), FLAT, 0.25, n) for x in (0.0, 0.1))
        residual = 2 * (picture.image - goal.image) / n**2
        truth = (residual[..., None, None] * exact_slopes(UPRIGHT, FLAT, 0.25, n)).sum(axis=(0, 1))
        ratios.append(nmr.loss_slopes(picture, residual)[:, 0].sum() / truth[:, 0].sum())
    assert min(ratios) > 2
    assert abs(ratios[1] / ratios[0] - 1) < 0.6


# -- a boundary term of paths ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("p", [0.375, 0.1, 0.6])
def test_the_boundary_term_of_paths_is_unbiased(p: float) -> None:
    truth = teg.compile(psdr.radiance()).grad(**{**psdr.AT, "p": p})["p"]
    for seed in range(3):
        slope, error = psdr.boundary_term(2**14, seed, p)
        assert abs(slope - truth) < 4.5 * error


def test_the_error_of_the_boundary_term_falls_with_the_root_of_the_samples() -> None:
    few, many = (psdr.boundary_term(n)[1] for n in (2**8, 2**14))
    assert 6 < few / many < 10


def test_the_integrand_of_the_boundary_is_that_of_the_program() -> None:
    values = {"p": 5.0, "b": 0.75}  # nothing is hidden
    truth = teg.compile(psdr.radiance())(**values)
    x, y = (np.arange(400) + 0.5) / 400, 0.75 * (np.arange(400) + 0.5) / 400
    assert psdr.carried(*np.meshgrid(x, y)).mean() * 0.75 == pytest.approx(truth, rel=1e-5)


# -- the picture -------------------------------------------------------------------------------------------------------


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from teg.examples.estimators import pictures

    assert pictures.draw(tmp_path).is_file()
