"""Integrals of choices over boxes: conditions of all forms, polynomials of higher degree, boxes that are no unit squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import teg
from teg.ir.node import postorder
from teg.ir.partition import Partition
from teg.passes.normalise.partitions import Refused, partitioned

K, A = teg.index("k"), teg.array("A", 2)
V, W = teg.array("V"), teg.array("W")
OVER = (K, 0, teg.length(V))
x, y = teg.vars("x y")
SQUARE = (x, 0, 1), (y, 0, 1)


class Problem(NamedTuple):
    """An integral of a choice among candidates with the numbers V and W, and what it and its derivatives are."""

    integral: teg.Expr
    v: list[float]
    w: list[float]
    value: float
    by_v: list[float]
    by_w: list[float]


PROBLEMS = {
    "outside of a corner": Problem(
        teg.integral(teg.nearest(x * x, V[K], OVER, where=~((x < V[K]) & (y < W[K])), otherwise=0), *SQUARE),
        [0.25], [0.5], (1 - 0.25**3 * 0.5) / 3, [-(0.25**2) * 0.5], [-(0.25**3) / 3],
    ),
    "alternatives of one condition and of two": Problem(
        teg.integral(teg.nearest(y * y, V[K], OVER, where=(x < V[K]) | ((x > W[K]) & (y < 0.5)), otherwise=0), *SQUARE),
        [0.25], [0.75], 0.25 / 3 + 0.25 * 0.5**3 / 3, [1 / 3], [-(0.5**3) / 3],
    ),
    "a box": Problem(
        teg.integral(teg.nearest(x * x * y, V[K], OVER, where=x > V[K], otherwise=W[0]), (x, 1, 3), (y, 0, 2)),
        [2.0], [5.0], (27 - 8) / 3 * 2 + 5 * 2, [-4 * 2 + 5 * 2], [2.0],
    ),
    "the nearest of two": Problem(
        teg.integral(teg.nearest(x * W[K], (x - V[K]) ** 2, OVER), *SQUARE),
        [0.25, 0.5], [3.0, 7.0], (3 * 0.375**2 + 7 * (1 - 0.375**2)) / 2, [-0.75, -0.75], [0.375**2 / 2, (1 - 0.375**2) / 2],
    ),
    "one variable": Problem(
        teg.integral(teg.nearest(x**3 * W[K], V[K] * x, OVER, where=x > V[K], otherwise=1), (x, 0, 2)),
        [0.5], [2.0], 2 * (16 - 0.5**4) / 4 + 0.5, [-2 * 0.5**3 + 1], [(16 - 0.5**4) / 4],
    ),
}  # fmt: skip


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_values_and_derivatives(name: str, backend: str) -> None:
    problem = PROBLEMS[name]
    f = teg.compile(problem.integral, [V, W], backend=backend)
    value, gradient = f.value_and_grad(V=np.array(problem.v), W=np.array(problem.w))
    assert value == pytest.approx(problem.value, rel=1e-13)
    np.testing.assert_allclose(gradient["V"], problem.by_v, rtol=1e-12)
    np.testing.assert_allclose(gradient["W"], problem.by_w, rtol=1e-12)


def test_integrals_become_partitions() -> None:
    for problem in PROBLEMS.values():
        assert any(isinstance(n, Partition) for n in postorder([partitioned(problem.integral)]))  # type: ignore[arg-type]


def test_what_is_no_partition_is_refused() -> None:
    curved = teg.integral(teg.nearest(x, V[K], OVER, where=x * y < V[K], otherwise=0), *SQUARE)
    with pytest.raises(Refused, match="not affine"):
        partitioned(curved)  # type: ignore[arg-type]


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("rows", [[[1, 1, 1], [0, 0, 0]], [[0, 0, 0], [1, 1, 1]], [[0, 0, 0]]], ids=["last", "first", "alone"])
def test_a_row_of_zeros(rows: list[list[float]], backend: str, x64_for_jax: None) -> None:
    """0 > 0 holds nowhere and 0 >= 0 everywhere: rows that fill a table up. x + y > 1 holds on half of the square."""
    form, other = A[K, 0] * x + A[K, 1] * y - A[K, 2], 0.5 if len(rows) > 1 else 0.0
    n = (K, 0, teg.length(A))
    expected = {
        teg.bracket(teg.any(form > 0, n)): other,
        teg.bracket(teg.any(~(form <= 0), n)): other,
        teg.bracket(teg.any(form >= 0, n)): 1.0,
        teg.bracket(teg.all(form <= 0, n)): 1.0 - other,
        teg.bracket(teg.all(form < 0, n)): 0.0,
        teg.bracket(teg.maximum_of(form, n) > 0): other,
        teg.nearest(1.0, x, n, where=form > 0, otherwise=0.0): other,
    }
    for e, value in expected.items():
        f = teg.compile(teg.integral(e, (x, 0, 1), (y, 0, 1)), backend=backend)
        assert f(A=np.asarray(rows, dtype=float)) == pytest.approx(value, abs=1e-14)
