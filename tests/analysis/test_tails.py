"""Integrals to infinity on finite intervals: the map covers the interval, ascends, and has the derivative that is given."""

from __future__ import annotations

import itertools
import math

import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.tails import finite_place, infinite_ends, is_unbounded
from teg.ir.expr import Const
from teg.ir.integral import Integral

x = teg.var("x")
t = teg.param("t")


def over(lo: float | teg.Expr, hi: float | teg.Expr) -> Integral:
    node = teg.integral(teg.exp(-x * x), (x, lo, hi))
    assert isinstance(node, Integral)
    return node


def test_bounds_that_are_infinite_as_written() -> None:
    assert infinite_ends(over(0, math.inf)) == (0.0, math.inf)
    assert infinite_ends(over(-math.inf, t)) == (-math.inf, 0.0)
    assert [is_unbounded(over(*ends)) for ends in ((0, 1), (t, math.inf), (0, t))] == [False, True, False]


@pytest.mark.parametrize("ends", [(0.0, math.inf), (-math.inf, 2.0), (-math.inf, math.inf), (-3.0, math.inf)])
def test_the_map_covers_the_interval(ends: tuple[float, float]) -> None:
    s, (lo, hi), place, rate = finite_place(over(*ends), [])
    assert isinstance(lo, Const)
    assert isinstance(hi, Const)
    low, high = float(lo), float(hi)
    grid = [low + (high - low) * (k + 0.5) / 2000 for k in range(2000)]
    values = [values_of([place, rate], {s: u}) for u in grid]
    assert all(r > 0 for _, r in values)
    ascends = not (math.isinf(ends[0]) and math.isfinite(ends[1]))  # from right to left if only the lower bound is infinite
    assert all((a[0] < b[0]) == ascends for a, b in itertools.pairwise(values))
    values, grid = (values, grid) if ascends else (values[::-1], grid[::-1])
    for end, first, last in ((ends[0], values[0], values[1]), (ends[1], values[-1], values[-2])):
        assert abs(first[0]) > 100 if math.isinf(end) else abs(first[0] - end) < abs(last[0] - end)
    for k in (300, 1000, 1700):
        step = abs(grid[k + 1] - grid[k - 1])
        assert (values[k + 1][0] - values[k - 1][0]) / step == pytest.approx(values[k][1], rel=1e-4)


def test_the_new_variable_has_a_name_of_its_own() -> None:
    s, *_ = finite_place(over(0, math.inf), [])
    other, *_ = finite_place(over(0, math.inf), [s])
    assert other is not s
