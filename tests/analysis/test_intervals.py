"""Interval enclosures: they hold every value that is taken, are tight where a function is monotone, and close in on a point."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import teg
from teg.analysis.intervals import enclose
from teg.errors import NotDifferentiableError
from teg.evaluator.accuracy import AccuracyWarning
from teg.ir.expr import Expr, Param, Var
from teg.ir.simplify import call
from teg.ir.traverse import substitute

X = teg.var("x")
LEFT, RIGHT = teg.var("left"), teg.var("right")
P, Q, T = teg.params("p q t")

FUNCTIONS: dict[str, Expr] = {
    "affine": 3 - 2 * X,
    "cubic": X**3 - 2 * X * X + T,
    "even power": (X - T) ** 4,
    "reciprocal": 1 / (X + 5),
    "odd reciprocal": (X + 6) ** -3,
    "product": (X - 1) * (X + 2) * X,
    "exp": teg.exp(-X) * X,
    "log": teg.log(X + 4),
    "log1p": teg.log1p(X + 3),
    "expm1": teg.expm1(-X),
    "erf": teg.erf(X / 2),
    "erfc": teg.erfc(X),
    "erfinv": call("erfinv", X / 4),
    "erfcinv": call("erfcinv", X / 4 + 1),
    "sqrt": teg.sqrt(X + 4),
    "sin": teg.sin(3 * X),
    "cos": teg.cos(X * X),
    "tan": teg.tan(X / 3),
    "asin": teg.asin(X / 4),
    "acos": teg.acos(X / 4),
    "atan": teg.atan(X),
    "atan2": teg.atan2(X, X * X + 1),
    "atan2 around": teg.atan2(X, X - 1),
    "sinh": teg.sinh(X),
    "cosh": teg.cosh(X),
    "tanh": teg.tanh(2 * X),
    "abs": teg.abs(X - T),
    "magnitude": call("magnitude", X - T),
    "root": call("root", X),
    "maximum": teg.maximum(X, T * X * X),
    "where": teg.where((X < T) | (X > 2 * T) & ~(X < 1), X, -X),
    "power": (X + 4) ** 1.7,
    "exponent": teg.exp(teg.log(X + 4) * T),
    "power by its logarithm": 2 * (X + 4) ** 3 * teg.log(X + 4),
    "unknown power by its logarithm": call("pow", X + 4, T) * teg.log(X + 4) * X,
    "floor": teg.floor(2 * X),
    "mod": teg.mod(X, 0.7),
    "free": T * T,
}


def bounds_at(e: Expr, p: float, q: float, t: float) -> tuple[float, float]:
    pair = enclose(e, {X: (LEFT, RIGHT)})
    closed = [substitute(b, {LEFT: P, RIGHT: Q}) for b in pair]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # bounds may be no numbers
        lo, hi = (teg.evaluate(b + 0 * (P + Q + T), {P: p, Q: q, T: t}) for b in closed)
    return float(lo), float(hi)


def values_in(e: Expr, p: float, q: float, t: float) -> np.ndarray:
    at = substitute(e, {X: P})
    points = np.linspace(p, q, 201)
    return np.asarray(teg.evaluate(at + 0 * (P + T), {P: points, T: t}))


@pytest.mark.parametrize("name", FUNCTIONS)
@settings(max_examples=25, deadline=None)
@given(ends=st.tuples(st.floats(-3.5, 3.5), st.floats(0, 3)), t=st.floats(-2, 2))
def test_bounds_hold_every_value(name: str, ends: tuple[float, float], t: float) -> None:
    e = FUNCTIONS[name]
    p, q = ends[0], min(ends[0] + ends[1], 3.7)
    lo, hi = bounds_at(e, p, q, t)
    values = values_in(e, p, q, t)
    scale = 1e-12 * (1 + np.abs(values).max())
    assert lo <= values.min() + scale
    assert hi >= values.max() - scale


@pytest.mark.parametrize("name", [n for n in FUNCTIONS if n not in ("tan", "atan2 around", "floor", "mod", "where")])
def test_bounds_close_in_on_a_point(name: str) -> None:
    e = FUNCTIONS[name]
    lo, hi = bounds_at(e, 0.9, 0.9 + 1e-9, 0.3)
    value = values_in(e, 0.9, 0.9, 0.3)[0]
    assert lo == pytest.approx(value, abs=1e-6)
    assert hi == pytest.approx(value, abs=1e-6)


def test_a_wave_reaches_its_crest_and_trough() -> None:
    assert bounds_at(teg.cos(X), -0.5, 0.5, 0) == (pytest.approx(math.cos(0.5)), 1.0)
    assert bounds_at(teg.sin(X), 1.0, 5.0, 0) == (-1.0, 1.0)
    assert bounds_at(teg.sin(X), 3.0, 3.1, 0) == (pytest.approx(math.sin(3.1)), pytest.approx(math.sin(3.0)))


def test_what_is_defined_nowhere_has_no_bounds() -> None:
    for e in (teg.sqrt(X), teg.log(X), X**0.5, teg.asin(X - 5)):
        lo, hi = bounds_at(e, -2.0, -1.0, 0)
        assert math.isnan(lo)
        assert math.isnan(hi)


def test_what_is_defined_partly_is_bounded_there() -> None:
    assert bounds_at(teg.sqrt(X), -1.0, 4.0, 0) == (0.0, 2.0)
    lo, hi = bounds_at(teg.log(X), -1.0, 1.0, 0)
    assert (lo, hi) == (-math.inf, 0.0)


@pytest.mark.parametrize("power", [X**3, X**2.5, call("pow", X, T)])
def test_a_power_by_its_logarithm_is_bounded_together(power: Expr) -> None:
    """x^k·log x falls from 0 to -1/(e·k), and rises; the logarithm by itself has no bound beside 0."""
    k = {"x³": 3.0}.get(str(power), 2.5)
    e = power * teg.log(X)
    assert bounds_at(e, -0.5, 0.9, 2.5) == pytest.approx((-1 / (math.e * k), 0.0))
    assert bounds_at(e, 0.0, 0.01, 2.5) == pytest.approx((0.01**k * math.log(0.01), 0.0))
    assert bounds_at(e, 0.8, 2.0, 2.5) == pytest.approx((0.8**k * math.log(0.8), 2.0**k * math.log(2.0)))


def test_a_negative_power_by_its_logarithm_has_none() -> None:
    assert bounds_at(call("pow", X, T) * teg.log(X), 0.0, 0.5, -1.0)[0] == -math.inf


def test_a_pole_inside_gives_everything() -> None:
    assert bounds_at(1 / X, -1.0, 1.0, 0) == (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("ends", "expected"), [((0.0, 2.0), (0.5, math.inf)), ((-2.0, 0.0), (-math.inf, -0.5)), ((2.0, math.inf), (0.0, 0.5))]
)
def test_a_pole_at_an_end_gives_one_side(ends: tuple[float, float], expected: tuple[float, float]) -> None:
    assert bounds_at(1 / X, *ends, 0) == expected


def test_an_integral_over_the_variable_is_refused() -> None:
    y: Var = teg.var("y")
    with pytest.raises(NotDifferentiableError):
        enclose(teg.integral(X * y, (y, 0, 1)), {X: (LEFT, RIGHT)})


@pytest.mark.slow
def test_a_deep_expression_is_enclosed_in_linear_time() -> None:
    e: Expr = X
    for i in range(20_000):
        e = teg.sin(e) if i % 2 else e + 1
    lo, hi = enclose(e, {X: (LEFT, RIGHT)})
    assert lo.free == hi.free == {LEFT, RIGHT}
    assert teg.size(lo, hi) < 60 * 20_000


def test_parameters_are_points() -> None:
    assert isinstance(T, Param)
    assert enclose(T * T, {X: (LEFT, RIGHT)}) == (T * T, T * T)
