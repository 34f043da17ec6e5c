"""Many points with polygons in NumPy: the straight line gives what clipping corner by corner gives, and leaves it what it cannot decide."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import teg
from teg.backends.numpy.kernel import compile_numpy
from teg.backends.numpy.side_by_side import BLOCK, LEAST, SideBySideKernel, compile_side_by_side
from teg.program import Program
from tests.bench.scenes import bilinear_pixel, half_planes, picture, triangle_pixel

Array = npt.NDArray[np.float64]
x, y = teg.vars("x y")
a, t = teg.params("a t")
SCENES = {
    "half-plane": (teg.integral(teg.bracket(x + a * y < t) * (1 + x), (x, 0, 1), (y, 0, 1)), [a, t]),
    "half-planes": half_planes(3),
    "constant": triangle_pixel(0),
    "linear": triangle_pixel(1),
    "a border": (teg.diff(triangle_pixel(0)[0], triangle_pixel(0)[1][0]), []),
}


def kernels(name: str) -> tuple[SideBySideKernel, Program]:
    e, wrt = SCENES[name]
    program = teg.compile(e, wrt or None, backend="numpy").program(1 if wrt else 0)
    assert isinstance(program, Program)
    kernel = compile_side_by_side(program)
    assert isinstance(kernel, SideBySideKernel)
    return kernel, program


def points(program: Program, n: int, seed: int) -> list[Array]:
    """Returns boxes of about 1 around the origin, and anything of this size around them."""
    rng = np.random.default_rng(seed)
    edges = {"left": -0.5, "bottom": -0.5, "right": 0.5, "top": 0.5}
    return [edges[p] + rng.uniform(-0.2, 0.2, n) if p in edges else rng.uniform(-1.5, 1.5, n) for p in program.parameters]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("n", [LEAST, BLOCK + 17])
def test_as_corner_by_corner(name: str, n: int) -> None:
    kernel, program = kernels(name)
    columns = points(program, n, n)
    np.testing.assert_allclose(kernel(columns, n), compile_numpy(program)(columns, n), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_ties_and_numbers_that_are_not_finite(name: str) -> None:
    """Lattice points, of which many are ties, and points with NaN, infinity and very large numbers: as alone."""
    kernel, program = kernels(name)
    rng = np.random.default_rng(3)
    n = 400
    columns = [np.round(2.0 * c) / 2.0 for c in points(program, n, 5)]
    for column in columns:
        column[rng.integers(0, n, 5)] = rng.choice([np.nan, np.inf, -np.inf, 1e200, 0.0], 5)
    expected = compile_numpy(program)(columns, n)
    np.testing.assert_allclose(kernel(columns, n), expected, rtol=1e-11, atol=1e-11)


def test_thin_triangles_are_clipped() -> None:
    kernel, program = kernels("constant")
    n = 200
    columns = dict(zip(program.parameters, points(program, n, 7), strict=True))
    thin = np.logspace(-1, -9, n)
    for k, (u, v) in enumerate(((-2.0, -2.1), (2.0, 2.0), (-2.0, -2.1))):
        columns[f"x{k}"], columns[f"y{k}"] = np.full(n, u), v + (thin if k == 2 else 0.0)
    given = [columns[p] for p in program.parameters]
    np.testing.assert_allclose(kernel(given, n), compile_numpy(program)(given, n), rtol=1e-9, atol=1e-13)


def test_columns_that_the_batch_shares() -> None:
    kernel, _ = kernels("half-plane")
    at = np.linspace(-0.5, 2.5, 300)
    shared = kernel([np.array(0.7), at], 300)
    np.testing.assert_array_equal(shared, kernel([np.full(300, 0.7), at], 300))
    strided = np.repeat(at, 3)[::3]
    np.testing.assert_array_equal(shared, kernel([np.array(0.7), strided], 300))


def test_points_do_not_see_their_neighbours() -> None:
    kernel, program = kernels("linear")
    columns = points(program, 1000, 11)
    whole = kernel(columns, 1000)
    part = kernel([c[300:500] for c in columns], 200)
    np.testing.assert_array_equal(whole[:, 300:500], part)


def test_pickled_and_with_little_memory() -> None:
    kernel, program = kernels("half-planes")
    columns = points(program, 3000, 2)
    expected = kernel(columns, 3000)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(kernel))(columns, 3000), expected)
    np.testing.assert_array_equal(compile_side_by_side(program, memory=2**20)(columns, 3000), expected)


def test_programs_without_a_line() -> None:
    for e, wrt in (bilinear_pixel(), (teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), [a, t])):
        program = teg.compile(e, wrt, backend="numpy").program(1)
        assert isinstance(program, Program)
        assert not isinstance(compile_side_by_side(program), SideBySideKernel)


def test_what_evaluators_run() -> None:
    """Batches are computed side by side, as in closed form; evaluations are counted as before."""
    e, wrt = SCENES["half-plane"]
    f = teg.compile(e, wrt, backend="numpy")
    assert "side by side" in f.source
    rng = np.random.default_rng(0)
    at = {"a": rng.uniform(0.1, 2.0, 500), "t": rng.uniform(-0.5, 3.5, 500)}
    value = f(at)
    u, w = np.polynomial.legendre.leggauss(40)
    pieces = np.stack([np.zeros(500), *(np.clip((at["t"] - c) / at["a"], 0.0, 1.0) for c in (1.0, 0.0)), np.ones(500)])
    total = np.zeros(500)
    for lo, hi in pairwise(pieces):
        for node, weight in zip(0.5 + 0.5 * u, 0.5 * w, strict=True):
            inside = np.clip(at["t"] - at["a"] * (lo + node * (hi - lo)), 0.0, 1.0)
            total += weight * (hi - lo) * (inside + inside**2 / 2)
    np.testing.assert_allclose(value, total, rtol=1e-12, atol=1e-14)
    assert f.evaluations(at) == teg.compile(e, wrt, backend="numpy", intrinsics=True).evaluations(at) > 0


def test_in_loops() -> None:
    e, wrt = picture()
    f, plain = (teg.compile(e, wrt, backend=backend) for backend in ("numpy", "c"))
    rng = np.random.default_rng(5)
    values: dict[str, Any] = {
        "V": np.array([[-3.0, -2.0], [12.0, 1.0], [5.0, 9.0], [0.25, 0.25]]),
        "F": np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3]]),
        "B": np.array([[0, 9, 0, 8], [0, 0, 0, 6], [0, 9, 3, 8]]),
        "C": rng.random((3, 9)),
        "T": rng.random((8, 9, 3)),
    }
    value, slopes = f.value_and_grad(values)
    expected, others = plain.value_and_grad(values)
    assert value == pytest.approx(expected, rel=1e-12)
    for name, slope in slopes.items():
        np.testing.assert_allclose(slope, others[name], rtol=1e-10, atol=1e-12)
