"""erf, erfc and their inverses against mpmath, to a few roundings, on their whole range."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import mpmath
import numpy as np
import pytest

from teg.backends.numpy.arrays import NUMPY
from teg.backends.shared.error_function import erf, erfc
from teg.numerics.error_function import inverse_erf, inverse_erfc

RANGES = {
    "erf": [(-1e-300, 1e-300), (-1e-5, 1e-5), (-1.0, 1.0), (0.9, 1.1), (-7.0, 7.0)],
    "erfc": [(-7.0, 0.0), (-1.1, -0.9), (-1e-5, 1e-5), (0.4, 0.6), (0.5, 5.0), (5.0, 26.0)],
}
CASES = [(name, low, high) for name, ranges in RANGES.items() for low, high in ranges]


def worst(name: str, points: Any, values: Any) -> float:
    exact = getattr(mpmath, name)
    with mpmath.workdps(40):
        return max(float(abs(mpmath.mpf(float(v)) / exact(mpmath.mpf(float(x))) - 1)) for x, v in zip(points, values, strict=True))


@pytest.mark.parametrize(("name", "low", "high"), CASES)
@pytest.mark.parametrize("backend", ["numpy", "jax"])
def test_values(backend: str, name: str, low: float, high: float, request: pytest.FixtureRequest) -> None:
    points = np.random.default_rng(1).uniform(low, high, 300)
    f = {"erf": erf, "erfc": erfc}[name]
    if backend == "jax":
        request.getfixturevalue("x64")
        jax, arrays = import_module("jax"), import_module("teg.backends.jax.arrays").JAX
        values = np.asarray(jax.jit(lambda x: f(arrays, x))(points))
    else:
        values = f(NUMPY, points)
    assert worst(name, points, values) < 5e-16


def test_a_block_of_any_shape() -> None:
    points = np.linspace(-3, 3, 24).reshape(4, 6)
    assert np.array_equal(erf(NUMPY, points), erf(NUMPY, points.ravel()).reshape(4, 6))
    assert np.array_equal(erfc(NUMPY, points.T), erfc(NUMPY, points).T)
    assert isinstance(erf(NUMPY, np.float64(0.3)), np.float64)


def test_the_ends() -> None:
    ends = np.array([math.inf, -math.inf, math.nan, 0.0, 28.0, -28.0])
    np.testing.assert_array_equal(erf(NUMPY, ends), [1.0, -1.0, math.nan, 0.0, 1.0, -1.0])
    np.testing.assert_array_equal(erfc(NUMPY, ends), [0.0, 2.0, math.nan, 1.0, 0.0, 2.0])


@pytest.mark.parametrize("c", [1e-300, 1e-20, 0.1, 0.4999, 0.5, 0.7, 0.999, 1 - 1e-12])
def test_inverses(c: float) -> None:
    inverses: list[tuple[Callable[[float], float], float, Any]] = [
        (inverse_erf, c, mpmath.erf),
        (inverse_erf, -c, mpmath.erf),
        (inverse_erfc, c, mpmath.erfc),
    ]
    for inverse, value, function in inverses:
        with mpmath.workdps(40):
            root = inverse(value)
            error = (function(mpmath.mpf(root)) - mpmath.mpf(value)) / mpmath.diff(function, mpmath.mpf(root))
        assert abs(error) <= 4e-16 * abs(root), (value, root)


def test_there_is_no_inverse_outside() -> None:
    for inverse, value in ((inverse_erf, 1.0), (inverse_erf, -1.5), (inverse_erfc, 0.0), (inverse_erfc, 2.0)):
        with pytest.raises(ValueError, match="never"):
            inverse(value)
