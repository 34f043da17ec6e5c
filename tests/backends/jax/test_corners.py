"""Polygons whose corners are written out are those of arrays of corners, bit by bit; results are numbers that no kernel joins."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg

jax = pytest.importorskip("jax")
jnp = jax.numpy

from teg.backends.jax import corners, polygon  # noqa: E402
from teg.backends.jax.corners import Cut  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")
PLANES, COUNT = 4, 400
x, y = teg.vars("x y")


def random_planes(rng: np.random.Generator) -> Any:
    return rng.normal(size=(COUNT, PLANES, 3))


def through_grid_points(rng: np.random.Generator) -> Any:
    """Corners on the border, and ones that only rounding puts outside."""
    return rng.integers(-4, 5, size=(COUNT, PLANES, 3)) / 2 + rng.integers(-3, 4, size=(COUNT, PLANES, 3)) * 1e-17


def nearly_the_same(rng: np.random.Generator) -> Any:
    first = rng.normal(size=(COUNT, 1, 3))
    return np.concatenate([first, first * (1 + rng.integers(-2, 3, size=(COUNT, PLANES - 1, 3)) * 2.0**-52)], axis=1)


def written_out(planes: Any, cuts: Any, zero: Any) -> tuple[Any, Any]:
    places, left = polygon.box(jnp.float64(1.0), jnp.float64(1.0)), jnp.bool_(True)
    for i in range(PLANES):
        places, left = corners.clipped(places, left, Cut(cuts[i], *planes[i]), zero)
    return jnp.array(places).T, left


def in_arrays(planes: Any, cuts: Any, zero: Any) -> tuple[Any, Any]:
    places, left = jnp.array(polygon.box(jnp.float64(1.0), jnp.float64(1.0))).T, jnp.bool_(True)
    for i in range(PLANES):
        places, left = polygon.clipped(places, left, Cut(cuts[i], *planes[i]), zero)
    return places, left


@pytest.mark.parametrize("kind", [random_planes, through_grid_points, nearly_the_same])
def test_written_out_corners_are_those_of_arrays(kind: Callable[[np.random.Generator], Any]) -> None:
    rng = np.random.default_rng(5)
    planes, cuts = kind(rng), rng.random((COUNT, PLANES)) < 0.9
    zero = np.full(COUNT, -0.0)  # not a constant: it keeps products and sums apart
    one, left = jax.jit(jax.vmap(written_out))(planes, cuts, zero)
    other, remains = jax.jit(jax.vmap(in_arrays))(planes, cuts, zero)
    np.testing.assert_array_equal(left, remains)
    assert 0.1 < np.mean(left) < 0.9
    np.testing.assert_array_equal(np.asarray(one)[np.asarray(left)], np.asarray(other)[np.asarray(left)])


@pytest.mark.parametrize("sides", [3, 5, 7])
def test_few_and_many_corners_have_the_area_of_a_regular_polygon(sides: int) -> None:
    """Written out up to five half-planes, in arrays from six on: a colour's integral over it, and derivatives."""
    r, u, v = teg.params("r u v")
    colour: Any = 1 + x
    for k in 2 * np.pi * np.arange(sides) / sides:
        colour = colour * teg.bracket(float(np.cos(k)) * (x - u) + float(np.sin(k)) * (y - v) < r)
    area = teg.jax_function(teg.integral(colour, (x, -3, 3), (y, -3, 3)), kernel="xla")
    at = {"r": 0.5, "u": 0.125, "v": -0.25}
    value, slopes = jax.value_and_grad(area)(at)
    unit = sides * np.tan(np.pi / sides)
    np.testing.assert_allclose(value, unit * 0.25 * 1.125, rtol=1e-14)
    np.testing.assert_allclose([slopes["r"], slopes["u"], slopes["v"]], [unit * 1.125, unit * 0.25, 0.0], rtol=1e-13, atol=1e-14)


def test_results_are_not_joined_in_an_array() -> None:
    """XLA computes an array of results entry by entry, each in a branch of its own, and not several elements of a batch at once."""
    t, a = teg.params("t a")
    f = teg.jax_function(teg.integral(teg.bracket(x + a * y < t), (x, 0, 1), (y, 0, 1)), [t, a], kernel="xla")
    many = {"t": np.linspace(0.1, 0.9, 64), "a": np.full(64, 1.2)}
    text = jax.jit(jax.value_and_grad(lambda p: f(p).sum())).lower(many).as_text()
    assert not re.search(r"stablehlo\.concatenate.*tensor<64x[23]xf64>", text)
