"""Surfaces that coincide by an identity of functions, and surfaces that nearly do."""

from __future__ import annotations

import math
import warnings

import pytest

import teg
from teg import Expr
from teg.analysis.coincidence import coincide
from teg.analysis.numeric_zeros import is_zero_on

x, y = teg.vars("x y")
t, s = teg.params("t s")
PRODUCT, SUM = x * y - t, x + y - t
exp, log, sin, cos, sqrt = teg.exp, teg.log, teg.sin, teg.cos, teg.sqrt


@pytest.mark.parametrize(
    ("e", "g"),
    [
        (sqrt(x) * sqrt(y) - sqrt(t), PRODUCT),
        (exp(log(x) + log(y)) - t, PRODUCT),
        (exp(x) * exp(y) / exp(t) - 1, SUM),
        (sin(x) * cos(y) + cos(x) * sin(y) - sin(t), SUM),
        (PRODUCT, log(x) + log(y) - log(t)),
        (sin(x) ** 2 - t, 1 - cos(x) ** 2 - t),
        ((exp(x) * exp(y) / exp(t) - 1) * (x - s), SUM),
    ],
)
def test_an_identity_is_seen(e: Expr, g: Expr) -> None:
    assert is_zero_on(e, g)
    assert coincide(e, g)


@pytest.mark.parametrize(
    ("e", "g"),
    [
        (sin(x) - t + 1e-12, sin(x) - t),
        (exp(x) * exp(y) - exp(t) * (1 + 1e-13), SUM),
        (teg.abs(x + y) - t, SUM),
        (sqrt(x * x + y * y) - t, SUM),
        (teg.maximum(x, y) - t, x - t),
        (sin(x) - sin(s), sin(x) - sin(t)),
        (teg.bracket(x**2.5 > t**2.5) * sin(x), x - t),
        (teg.integral(sin(y) * x, (y, 0, 1)) - t, x - t),
        (x - t, x * x - t * t),
        (exp(-1e5 * x) * 1e5, x - t),
        (exp(-1e5 * x) * x - exp(-1e6 * x), x - t),
        (exp(-1e5 * x) * (x - t + s), x - t),
    ],
)
def test_what_only_nearly_or_partly_coincides_is_not(e: Expr, g: Expr) -> None:
    assert not is_zero_on(e, g)


def test_large_expressions_are_left_alone() -> None:
    long = x
    for _ in range(200):
        long = sin(long) + t
    assert not is_zero_on(long - long * 1, PRODUCT)


AT = 0.3
AREAS = {"product": (PRODUCT, AT - AT * math.log(AT), -math.log(AT)), "sum": (SUM, AT * AT / 2, AT)}


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize(
    ("shape", "other"),
    [
        ("product", log(x) + log(y) < log(t)),
        ("product", sqrt(x) * sqrt(y) < sqrt(t)),
        ("product", exp(log(x) + log(y)) < t),
        ("sum", exp(x) * exp(y) < exp(t)),
        ("sum", exp(x) / exp(t) * exp(y) < 1),
    ],
)
def test_one_region_in_two_wordings(shape: str, other: teg.Cond, backend: str) -> None:
    g, area, slope = AREAS[shape]
    for condition in ((g < 0) & other, (g < 0) | other):
        f = teg.compile(teg.integral(teg.bracket(condition), (x, 0, 1), (y, 0, 1)), [t], backend=backend)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            value, gradient = f.value_and_grad(t=AT)
        assert value == pytest.approx(area, rel=1e-11)
        assert gradient["t"] == pytest.approx(slope, rel=1e-11)
