"""Ellipses whose matrix is data, followed along their edges: against arcs of NumPy, differences, and what is no ellipse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, follows_edges, k, t, x, y
from tests.references.ellipses import integral_over_union, random_ellipses, slopes, slopes_of_union

U, V = x - D[k, 0], y - D[k, 1]
A, B, C = (D[k, i] for i in (2, 3, 4))
Q = A * U**2 + B * U * V + C * V**2
AREA = teg.bracket(teg.any(Q < 1, ALL))


def weight(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return 1 + u * v


def primitive(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u + 0.5 * u * u * v


WRITTEN: dict[str, teg.Cond] = {
    "about the middle": Q < 1,
    "with other signs": -2 * Q > -2,
    "turned": A * (D[k, 0] - x) ** 2 + B * (D[k, 0] - x) * (D[k, 1] - y) + C * (D[k, 1] - y) ** 2 < 1,
    "expanded": A * x**2 + B * x * y + C * y**2 - (2 * A * D[k, 0] + B * D[k, 1]) * x - (2 * C * D[k, 1] + B * D[k, 0]) * y
    < 1 - (A * D[k, 0] ** 2 + B * D[k, 0] * D[k, 1] + C * D[k, 1] ** 2),
    "by sum and difference": A * U**2 + 0.25 * B * ((U + V) ** 2 - (U - V) ** 2) + C * V**2 < 1,
}


@pytest.mark.parametrize(("name", "backend"), [*((name, "c") for name in WRITTEN), ("about the middle", "numpy"), ("expanded", "numpy")])
def test_however_they_are_written(name: str, backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.any(WRITTEN[name], ALL)) * (1 + x * y), *BOX), [D], backend=backend)
    assert follows_edges(f)
    for n in (0, 1, 9):
        rows = random_ellipses(n, seed=n)
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(integral_over_union(rows, weight, primitive), abs=1e-11)
        assert gradient["D"] == pytest.approx(slopes_of_union(rows, weight), abs=1e-10)


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    f = teg.jax_function(teg.integral(AREA, *BOX), [D], kernel=kernel)
    rows = random_ellipses(4, seed=5)
    value, gradient = jax.value_and_grad(lambda d: f(D=d))(rows)
    assert value == pytest.approx(integral_over_union(rows, lambda u, v: 1 + 0 * u, lambda u, v: u), abs=1e-11)
    assert np.asarray(gradient) == pytest.approx(slopes_of_union(rows, lambda u, v: 1 + 0 * u), abs=1e-10)


def test_splats_with_depths() -> None:
    """Painted from the nearest to the farthest: an edge counts by the colour inside of it less the one behind."""
    depths, colours = np.array([3.0, 1.0, 2.0, 5.0, 4.0]), np.array([0.3, 0.8, -0.4, 0.1, 1.2])
    rows = random_ellipses(5, seed=2)
    shade = teg.nearest(D[k, 6], D[k, 5], ALL, where=Q < 1, otherwise=0.25)
    f = teg.compile(teg.integral(shade, *BOX), [D])
    gradient = f.grad(D=np.c_[rows, depths, colours])["D"]

    def step(j: int, u: float, v: float) -> float:
        p, q = u - rows[:, 0], v - rows[:, 1]
        there = rows[:, 2] * p * p + rows[:, 3] * p * q + rows[:, 4] * q * q < 1
        there[j] = False
        if (there & (depths < depths[j])).any():
            return 0.0
        behind = colours[np.where(there, depths, np.inf).argmin()] if there.any() else 0.25
        return float(colours[j] - behind)

    assert gradient[:, :5] == pytest.approx(slopes(rows, lambda u, v: 1 + 0 * u, step), abs=1e-10)
    assert gradient[:, 5] == pytest.approx(np.zeros(5), abs=1e-12)


def test_products_with_the_hessian() -> None:
    rows, moved = random_ellipses(6, seed=3), np.random.default_rng(0).normal(size=(6, 5)) * [0.1, 0.1, 1.0, 1.0, 1.0]
    f = teg.compile(teg.integral(AREA * (1 + x * y), *BOX), [D], backend="c")
    h = 1e-3
    around = [slopes_of_union(rows + s * h * moved, weight) - slopes_of_union(rows - s * h * moved, weight) for s in (1, 2, 3)]
    expected = (45 * around[0] - 9 * around[1] + around[2]) / (60 * h)
    assert f.hvp({"D": rows}, {"D": moved})["D"] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_no_ellipse_is_no_number(backend: str) -> None:
    """A hyperbola or a strip among ellipses is refused by a warning; a row of zeros has no edge."""
    f = teg.compile(teg.integral(AREA, *BOX), [D], backend=backend)
    for a, b, c in ((3.0, 40.0, 5.0), (30.0, 0.0, 0.0), (0.0, 0.0, 30.0), (9.0, 6.0, 1.0)):
        with pytest.warns(teg.AccuracyWarning, match="not a number"):
            assert np.isnan(f(D=[[0.5, 0.5, 20.0, 0.0, 20.0], [0.4, 0.4, a, b, c]]))
    value, gradient = f.value_and_grad(D=[[0.5, 0.5, 20.0, 0.0, 20.0], [0.0] * 5])
    assert (value, abs(gradient["D"]).max()) == (pytest.approx(1.0), 0.0)
    assert f(D=[[0.5, 0.5, 20.0, 0.0, 20.0], [0.5, 0.5, -3.0, 1.0, -5.0]]) == pytest.approx(1.0)  # less than 1 everywhere


@pytest.mark.parametrize("aspect", [30.0, 300.0])
def test_thin_ones(aspect: float) -> None:
    f = teg.compile(teg.integral(AREA * (1 + x * y), *BOX), [D])
    rows = random_ellipses(6, seed=9, aspect=aspect)
    value, gradient = f.value_and_grad(D=rows)
    assert value == pytest.approx(integral_over_union(rows, weight, primitive), abs=1e-12)
    assert gradient["D"] == pytest.approx(slopes_of_union(rows, weight), abs=1e-10)


def test_far_from_the_origin() -> None:
    """Written about their middles, ellipses keep their digits wherever the box is."""
    far = teg.integral(AREA, (x, t, t + 1), (y, t, t + 1))
    f = teg.compile(far, [D])
    rows = random_ellipses(5, seed=4)
    moved = rows.copy()
    moved[:, :2] += 65536.0
    rows[:, :2] = moved[:, :2] - 65536.0
    value, gradient = f.value_and_grad(D=moved, t=65536.0)
    assert value == pytest.approx(integral_over_union(rows, lambda u, v: 1 + 0 * u, lambda u, v: u), abs=1e-10)
    assert gradient["D"] == pytest.approx(slopes_of_union(rows, lambda u, v: 1 + 0 * u), abs=1e-9)
