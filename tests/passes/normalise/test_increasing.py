"""Keys without increasing functions: which of them is the least stays, and integrals are those of plain keys."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.passes.normalise.increasing import plain_key
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, x, y

SQUARE = (x - D[k, 0]) ** 2 + (y - D[k, 1]) ** 2
DISTANCE = teg.sqrt(SQUARE)
a = teg.param("a")


@pytest.mark.parametrize(
    ("key", "plain"),
    [
        (DISTANCE, SQUARE),
        (3 * DISTANCE - 2 + x * a, SQUARE),
        (SQUARE**1.5, SQUARE),
        (1 / SQUARE, -SQUARE),
        (-1 / DISTANCE, SQUARE),
        (teg.log(SQUARE), SQUARE),
        (-teg.exp(-SQUARE), -1 * (-1 * SQUARE)),
        (teg.erfc(SQUARE), -SQUARE),
        (teg.cosh(DISTANCE), SQUARE),
        ((x - D[k, 0]) ** 3, -1 * D[k, 0]),  # the place is shared, too
        (abs(x - D[k, 0]), (x - D[k, 0]) ** 2),
    ],
    ids=str,
)
def test_functions_in_front(key: teg.Expr, plain: teg.Expr) -> None:
    assert plain_key(key, k) is plain


@pytest.mark.parametrize(
    "key",
    [
        2 * SQUARE + 1,  # nothing to take away
        DISTANCE + D[k, 2],
        teg.sqrt(x - D[k, 0]),  # it may be no number, and so the choice
        teg.log(SQUARE - 1),
        1 / (x - D[k, 0]),
        teg.sin(x - D[k, 0]),
        D[k, 2] * teg.exp(-SQUARE),
        D[k, 2] * SQUARE**1.5,  # w·|w|^(-1/3) has no slope at 0
    ],
    ids=str,
)
def test_keys_that_stay(key: teg.Expr) -> None:
    assert plain_key(key, k) is key


@pytest.mark.parametrize("backend", BACKENDS)
def test_distances_are_as_good_as_their_squares(backend: str) -> None:
    """Any number of sites, bit for bit."""
    rows = np.random.default_rng(2).random((30, 3))
    results = []
    for key in (DISTANCE, SQUARE, -teg.exp(-3 * SQUARE)):
        f = teg.compile(teg.integral(teg.nearest(D[k, 2] * (1 + x), key, ALL), *BOX), [D], backend=backend)
        results.append(f.value_and_grad(D=rows))
    for value, gradient in results[1:]:
        assert value == results[0][0]
        assert np.array_equal(gradient["D"], results[0][1]["D"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_key_that_is_no_number(backend: str) -> None:
    """What all share does not count, but where it is no number no key is one."""
    assert plain_key(DISTANCE + a, k) is SQUARE + a
    f = teg.compile(teg.integral(teg.nearest(D[k, 2], DISTANCE + a, ALL), *BOX), backend=backend)
    rows = [[0.3, 0.4, 1.0], [0.7, 0.4, 2.0]]
    assert f(D=rows, a=0.2) == pytest.approx(1.5, abs=1e-14)
    assert np.isnan(f(D=rows, a=np.nan))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("w", [2.0, -2.0])
def test_weighted_distances_have_circles(backend: str, w: float) -> None:
    """Of w·|z - a| and |z - b| the first one is less outside of a disk around (w²a - b)/(w² - 1); with a weight below 0 it always is."""
    f = teg.compile(teg.integral(teg.nearest(D[k, 3], D[k, 2] * DISTANCE, ALL), *BOX), [D], backend=backend)
    assert follows_edges(f)
    value, gradient = f.value_and_grad(D=[[0.5, 0.5, w, 1.0], [0.3, 0.5, 1.0, 0.0]])
    radius = 0.2 * w / (w**2 - 1)
    if w > 0:  # the disk around 17/30
        assert value == pytest.approx(np.pi * radius**2, rel=1e-12)
        assert gradient["D"][0, 2] == pytest.approx(-2 * np.pi * radius * 0.2 * (w**2 + 1) / (w**2 - 1) ** 2, rel=1e-10)
    else:
        assert value == 1.0
        assert np.array_equal(gradient["D"][:, :3], np.zeros((2, 3)))


@pytest.mark.parametrize("backend", BACKENDS)
def test_mean_distance_to_the_nearest(backend: str) -> None:
    """Of one site in the middle: (√2 + asinh 1)/6. Of more the value changes as the distances in each cell do."""
    f = teg.compile(teg.integral(teg.minimum_of(DISTANCE, ALL), *BOX), [D], backend=backend)
    assert follows_edges(f)
    assert f(D=[[0.5, 0.5]]) == pytest.approx((np.sqrt(2) + np.arcsinh(1.0)) / 6, abs=1e-10)
    rows = np.random.default_rng(3).random((5, 2))
    direction = np.random.default_rng(4).standard_normal(rows.shape)
    gradient = f.grad(D=rows)["D"]
    step = 1e-3
    ahead = [float(f(D=rows + s * step * direction)) for s in (-2, -1, 1, 2)]
    assert (gradient * direction).sum() == pytest.approx((ahead[0] - 8 * ahead[1] + 8 * ahead[2] - ahead[3]) / (12 * step), abs=1e-8)
    places = (np.arange(400) + 0.5) / 400
    nearest = np.min(np.hypot(places[:, None, None] - rows[:, 0], places[None, :, None] - rows[:, 1]), axis=-1)
    assert f(D=rows) == pytest.approx(nearest.mean(), abs=1e-5)
