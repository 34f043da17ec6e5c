"""Bounds of expressions as numbers: they hold at random points, and are sharp for the operations by themselves."""

from __future__ import annotations

import math
import random

import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.extents import extent

x, y = teg.vars("x y")
t = teg.param("t")
BOX = {x: (-1.0, 2.0), y: (0.25, 0.5)}


@pytest.mark.parametrize(
    ("e", "lo", "hi"),
    [
        (x + y, -0.75, 2.5),
        (2 * x - 1, -3.0, 3.0),
        (x * y, -0.5, 1.0),
        (1 / y, 2.0, 4.0),
        (teg.exp(y), math.exp(0.25), math.exp(0.5)),
        (teg.where(x < y, y, 1), 0.25, 1.0),
    ],
)
def test_sharp_bounds(e: teg.Expr, lo: float, hi: float) -> None:
    found = extent(e, BOX)
    assert found == pytest.approx((lo, hi), rel=1e-12)
    assert found[0] <= lo
    assert found[1] >= hi


@pytest.mark.parametrize("e", [t, t * x, x + t])
def test_parameters_are_unbounded(e: teg.Expr) -> None:
    assert extent(e, BOX) == (-math.inf, math.inf)


def test_bounds_that_hold_for_all_parameters() -> None:
    lo, hi = extent(teg.sin(t) * x, BOX)
    assert -math.inf < lo <= -2.0
    assert 2.0 <= hi < math.inf


@pytest.mark.parametrize("e", [x**3 - x * y, teg.sin(3 * x) * teg.cos(y), teg.atan(x) / y, teg.exp(-x * x) + teg.sqrt(y), teg.tanh(x - y)])
def test_values_lie_within(e: teg.Expr) -> None:
    drawn = random.Random(1)
    lo, hi = extent(e, BOX)
    for _ in range(300):
        value = values_of([e], {v: drawn.uniform(*ends) for v, ends in BOX.items()})[0]
        assert lo <= value <= hi
