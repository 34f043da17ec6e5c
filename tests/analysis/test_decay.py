"""Integrands that fall off like a power, and the largest power among their parts."""

from __future__ import annotations

import math

import pytest

import teg
from teg.analysis.decay import steepest_of_slow
from teg.analysis.evaluate import values_of
from teg.ir.expr import Expr
from teg.ir.integral import Integral

x, y = teg.vars("x y")
a, b, t = teg.params("a b t")
FAR = (x, 1, math.inf)
PLANE = 1 + x**2 + y**2


def steepest(body: Expr, values: dict[str, float]) -> float | None:
    node = teg.integral(body, FAR)
    assert isinstance(node, Integral)
    degree = steepest_of_slow(node)
    return None if degree is None else values_of([degree], {p: values[p.name] for p in (a, b, t)})[0]


SLOW = {
    "a power that is no integer": (x**-1.5, 1),
    "a power that is not known": (a * x ** (-a - 1), 1),
    "of a square": ((1 + x**2) ** -a, 2),
    "growing before it falls": (x ** (b - 1) * (1 + x) ** (-b - a), 4),
    "a root": (1 / (x * teg.sqrt(1 + x)), 1),
    "powers that differ by a half": ((x + teg.sqrt(x)) ** -2, 1),
    "a logarithm": (teg.log(x) / x**2, 1),
    "a logarithm as a factor": (teg.log(1 + x**2) * (1 + x**2) ** -2, 2),
    "a power by its logarithm": (teg.exp(-a * teg.log(x)), 1),
    "powers by their logarithms": (teg.exp(-1 / x - a * teg.log(x)), 1),
    "an exponential that settles": (teg.exp(-1 / x) * x**-1.5, 1),
    "bounded functions": (teg.atan(x) * teg.tanh(x) * x**-1.5, 1),
    "one term of a sum": (teg.exp(-x) + x**-1.5, 1),
    "one branch": (teg.where(x < t, x**-2, x**-1.5), 1),
    "a condition": (teg.bracket(x < t) * x**-1.5, 1),
    "large and small": (teg.maximum(x**-1.5, x**-2), 1),
    "an inner integral": (teg.integral(PLANE**-1.25, (y, -math.inf, math.inf)), 2),
    "coupled by a condition": (teg.integral(teg.bracket(x < y) * y**-3.5, (y, 0, math.inf)), 2),
    "coupled by a bound": (teg.integral(y**-0.5, (y, 0, 1 / x)) / x, 1),
}


@pytest.mark.parametrize("name", SLOW)
def test_slow_integrands(name: str) -> None:
    body, degree = SLOW[name]
    assert steepest(body, {"a": 0.5, "b": 5.0, "t": 3.0}) == degree


FAST = {
    "a series in 1/x": x**-3 + 1 / (1 + x**2),
    "roots that make an integer": (1 + x**2) ** -1.5,
    "two roots": 1 / (x * teg.sqrt(1 + x) * teg.sqrt(2 + x)),
    "an exponential": teg.exp(-x) * x**a,
    "a Gaussian": teg.exp(-(x**2)) * teg.sqrt(x),
    "an exponential of a power": teg.exp(-(x**a)) * x**-1.5,
    "a logarithm squared": teg.exp(-(teg.log(x) ** 2)) * x**-1.5,
    "in a denominator": x**1.5 / (teg.exp(x) + 1),
    "a hyperbolic cosine": x**-0.5 / teg.cosh(x),
    "a wave": teg.sin(x) * x**-1.5,
    "coupled to a series": teg.integral(teg.bracket(y < x) / (1 + y**2), (y, -math.inf, math.inf)) / (1 + x**2),
    "coupled by a bound to a series": teg.integral(teg.exp(-y), (y, 0, 1 / x)) / x,
    "an exponential inside": teg.integral(teg.exp(-x * y) * x**-1.5, (y, 1, 2)),
    "coupled with an exponential": teg.integral(teg.bracket(x < y) * teg.exp(-y), (y, 0, math.inf)) * teg.sqrt(x),
}


@pytest.mark.parametrize("name", FAST)
def test_other_integrands(name: str) -> None:
    assert steepest(FAST[name], {"a": 0.5, "b": 5.0, "t": 3.0}) is None


def test_denominators_count_half() -> None:
    """They may be infinite: their inverses are 0."""
    assert steepest(x**-1.5 / (1 + x**3) ** 2, {"a": 0.5, "b": 1.0, "t": 3.0}) == 3


def test_an_exponent_that_the_inner_variable_decides() -> None:
    body = teg.integral(x ** (-1 - y), (y, 1, 2))
    assert steepest(body, {"a": 0.5, "b": 1.0, "t": 3.0}) is None
