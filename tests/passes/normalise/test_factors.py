"""Products in the conditions of candidates, by the signs of their factors: against cells between lines, sums by hand and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.expr import Compare
from teg.ir.node import nodes_of
from teg.passes.normalise.factors import with_single_factors
from tests.passes.differentiate.candidates import ALL, BACKENDS, BOX, D, k, x, y
from tests.references.hyperbolas import crossing_rows, integral_over_union, slope_of_union

QUADRANTS = D[k, 3] * (x - D[k, 0]) * (y - D[k, 1]) > 0
MEAN = teg.integral(teg.bracket(teg.any(QUADRANTS, ALL)) * (1 + x * y), *BOX)
SHARED = {
    "inside": [[0.8, 0.9, 0, 1], [0.8, 0.5, 0, -1]],
    "on a side": [[1.0, 0.9, 0, 1], [1.0, 0.5, 0, -1]],
    "on the other side": [[0.0, 0.9, 0, 1], [0.0, 0.5, 0, -1]],
    "across": [[0.9, 0.8, 0, 1], [0.5, 0.8, 0, -1]],
    "three": [[0.5, 0.9, 0, -1], [0.5, 1.0, 0, -1], [1.1, 0.7, 0, 1]],
    "twice": [[0.4, 0.3, 0, 1], [0.4, 0.3, 0, 1]],
}


def test_what_is_taken_apart() -> None:
    a, b, c = teg.params("a b c")

    def atoms(condition: Any) -> set[str]:
        return {str(n.g) for n in nodes_of(Compare, with_single_factors(condition))}

    assert atoms(a * (x - b) * (y - c) > 0) == {str(e) for e in (a * (x - b), -a * (x - b), y - c, -(y - c))}
    for left in ((x - b) * (y - c) > a, (x - b) ** 2 * (y - c) > 0, a * (x - b) > 0, a * b > 0):
        assert with_single_factors(left) is left


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", SHARED)
def test_candidates_that_share_a_line(name: str, backend: str) -> None:
    """The side on which a candidate lies changes along it, where its other line crosses."""
    rows = np.array(SHARED[name], float)
    assert teg.compile(MEAN, [D], backend=backend)(D=rows) == pytest.approx(integral_over_union(rows), abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_factor_that_all_terms_have(backend: str) -> None:
    """On the right of the line x = ½, which all share, what is above the lowest one; on the left what is below the highest one."""
    above = (x - 0.5) * y - (x - 0.5) * D[k, 0] > 0
    f = teg.compile(teg.integral(teg.bracket(teg.any(above, ALL)), *BOX), [D], backend=backend)
    value, gradient = f.value_and_grad(D=[[0.3], [0.6], [0.45]])
    assert value == pytest.approx(0.5 * 0.7 + 0.5 * 0.6, abs=1e-12)
    assert gradient["D"].ravel() == pytest.approx([-0.5, 0.5, 0.0], abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_any_number_of_them(backend: str) -> None:
    f = teg.compile(MEAN, [D], backend=backend)
    for n in (0, 1, 2, 5, 9):
        rows, direction = crossing_rows(n, n), np.random.default_rng(n).normal(size=(n, 4)) * [1, 1, 0, 0]
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx(integral_over_union(rows), abs=1e-12)
        assert (gradient["D"] * direction).sum() == pytest.approx(slope_of_union(rows, direction), abs=1e-9)
    rows = np.random.default_rng(1).uniform(0.0, 1.0, (600, 4))
    assert f(D=rows) == pytest.approx(1.25, abs=1e-4)  # all but parts of two corners


def test_products_with_the_hessian() -> None:
    """Corners that two quadrants share have a second derivative: a·b + (1 - a)·(1 - b) has the mixed one 2."""
    f = teg.compile(teg.integral(teg.bracket(teg.any(QUADRANTS, ALL)), *BOX), [D])
    assert f.hessian(D=[[0.3, 0.6, 0.0, 1.0]])["D", "D"][0, :2, 0, :2] == pytest.approx(np.array([[0, 2], [2, 0]]), abs=1e-12)
    rows, direction = crossing_rows(3, 5), np.random.default_rng(5).normal(size=(3, 4)) * [1, 1, 0, 0]
    ahead, back = (f.grad(D=rows + h * direction)["D"] for h in (1e-5, -1e-5))
    assert f.hvp({"D": rows}, {"D": direction})["D"] == pytest.approx((ahead - back) / 2e-5, abs=1e-9)
    many = np.random.default_rng(1).uniform(0.0, 1.0, (300, 4))
    with pytest.raises(teg.TegError, match=r"alternatives that share corners.*300 candidates"):
        f.hvp({"D": many}, {"D": many})


@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_in_jax(x64_for_jax: Any, kernel: str) -> None:
    import jax

    rows = crossing_rows(2, 3)
    f = teg.jax_function(teg.integral(teg.bracket(teg.any(QUADRANTS, ALL)), *BOX), [D], kernel=kernel)
    a, b = rows[0, :2], rows[1, :2]
    value, gradient = jax.value_and_grad(lambda d: f(D=d))(rows)
    g = teg.compile(teg.integral(teg.bracket(teg.any(QUADRANTS, ALL)), *BOX), [D])
    assert (value, np.asarray(gradient)) == (pytest.approx(g(D=rows)), pytest.approx(g.grad(D=rows)["D"]))
    assert not np.array_equal(a, b)
    product = jax.jvp(jax.grad(lambda d: f(D=d)), (rows,), (rows,))[1]
    assert np.asarray(product) == pytest.approx(g.hvp({"D": rows}, {"D": rows})["D"], abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_three_factors_and_other_integrands(backend: str) -> None:
    """Alternating sectors of three lines through no common point, and e^(xy), which is no polynomial: candidates are written out."""
    step = 1 / 512
    u, v = np.meshgrid(*[(np.arange(512) + 0.5) * step] * 2)
    rows = np.array([[0.31, 0.62, 1.11], [0.57, 0.23, 0.87]])
    condition = (x - D[k, 0]) * (y - D[k, 1]) * (x + y - D[k, 2]) <= 0
    there = ((u - rows[:, 0, None, None]) * (v - rows[:, 1, None, None]) * (u + v - rows[:, 2, None, None]) <= 0).any(axis=0)
    for body, sample in ((1 + x, 1 + u), (teg.exp(x * y), np.exp(u * v))):
        f = teg.compile(teg.integral(teg.bracket(teg.any(condition, ALL)) * body, *BOX), [D], backend=backend)
        value, gradient = f.value_and_grad(D=rows)
        assert value == pytest.approx((there * sample).mean(), abs=3e-3)
        ahead, back = (f(D=rows + h) for h in (1e-5, -1e-5))
        assert gradient["D"].sum() == pytest.approx((ahead - back) / 2e-5, abs=1e-7)


def test_the_nearest_where_a_product_holds() -> None:
    rows = np.array([[0.3, 0.7], [0.6, 0.2]])
    shade = teg.nearest(D[k, 0], D[k, 1], ALL, where=(x - D[k, 0]) * (y - D[k, 1]) > 0, otherwise=0)
    f = teg.compile(teg.integral(shade, *BOX), [D])
    front, behind = 0.6 * 0.2 + 0.4 * 0.8, 0.3 * 0.5 + 0.3 * 0.3  # of the second and of the first one, where the second is not
    assert f(D=rows) == pytest.approx(0.6 * front + 0.3 * behind, abs=1e-13)
