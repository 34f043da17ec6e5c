"""Centres: the places around which integrands on infinite ranges have their features."""

from __future__ import annotations

import math
from typing import cast

import pytest

import teg
from teg.analysis.centres import Centres
from teg.analysis.polynomial import Degrees
from teg.ir.expr import Expr
from teg.ir.integral import Integral

x, y = teg.vars("x y")
t, a, b, k = teg.params("t a b k")
LINE = (-math.inf, math.inf)
AT = {"t": 0.7, "a": 2.0, "b": 1.5, "k": 3.0}


def centres(e: Expr) -> list[tuple[float, float]]:
    """The places and widths of the centres of an integral at AT."""

    def number(part: Expr) -> float:
        f = teg.compile(part, [], backend="numpy")
        return float(f(**{name: AT[name] for name in f.parameters}))

    return [(number(c.place), number(c.width)) for c in Centres(Degrees(), lambda e: e).of(cast(Integral, e))]


@pytest.mark.parametrize(
    ("integrand", "expected"),
    [
        (1 / teg.cosh(a * x - t), [(0.35, 0.5)]),
        (teg.exp(-a * (x - t) ** 2), [(0.7, 0.5)]),
        (1 / (1 + (k * (x - t)) ** 2), [(0.7, 1 / 3)]),
        (1 / teg.cosh(x - t) / teg.cosh(x - b), [(0.7, 1.0), (1.5, 1.0)]),
        (x**2 * teg.sin(x - t), []),
        (teg.bracket(x < t) + 0 * x, []),
    ],
    ids=str,
)
def test_centres_are_where_functions_turn(integrand: Expr, expected: list[tuple[float, float]]) -> None:
    found = centres(teg.integral(integrand, (x, *LINE)))
    assert sorted(found) == [pytest.approx(e) for e in sorted(expected)]


def test_centres_of_an_inner_integral_meet_outside() -> None:
    inner = teg.integral(1 / teg.cosh(x - t) / teg.cosh(a * y - x), (x, *LINE))
    assert centres(teg.integral(inner, (y, *LINE))) == [pytest.approx((0.35, 1.0))]


def test_a_centre_meets_a_finite_bound() -> None:
    inner = teg.integral(1 / teg.cosh(y - x), (x, t, math.inf))
    assert centres(teg.integral(inner * teg.exp(-((y - b) ** 2)), (y, *LINE)))[-1] == pytest.approx((0.7, 1.0))
