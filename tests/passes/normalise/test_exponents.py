"""Exponentials of a product as one: the form, and expectations under normal densities against closed forms."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import pytest
from scipy.integrate import quad

import teg
from teg.ir.expr import Call
from teg.ir.integral import Integral
from teg.ir.node import nodes_of
from teg.passes.normalise.exponents import MOST_TERMS, with_common_exponents

x, y, t = teg.vars("x y t")
s, a, b = teg.params("s a b")
LINE = (-math.inf, math.inf)
PLANE = ((y, *LINE), (x, *LINE))
NORMAL = teg.exp(-x * x / 2) * teg.exp(-y * y / 2) / (2 * math.pi)
AT = {"s": 0.25, "a": 1.05, "b": 1.2}


def exponentials(e: teg.Expr) -> int:
    """Returns how many exponentials stand in the products of an integrand."""
    return len(nodes_of(Call, with_common_exponents(e)))


def test_factors_become_one_exponential() -> None:
    e = teg.integral(teg.exp(s * (x + y)) * NORMAL, *PLANE)
    made = with_common_exponents(e)
    assert len(nodes_of(Call, made)) == 1
    assert with_common_exponents(made) is made


def test_sums_are_multiplied_out() -> None:
    assert exponentials(teg.integral((teg.exp(s * (x + y)) - a) * NORMAL, *PLANE)) == 2
    assert exponentials(teg.integral((0.5 * (teg.exp(s * x) + teg.exp(s * (x + y))) - a) * NORMAL, *PLANE)) == 3


def test_factors_beside_an_integral() -> None:
    together = teg.exp(-(x * x + y * y) / 2)
    inner = teg.integral(teg.where(x < a, x * together, 0), (x, *LINE))
    made = with_common_exponents(teg.integral(teg.exp(s * y) * inner, (y, *LINE)))
    assert len(nodes_of(Call, made)) == 1
    deeper = teg.integral(teg.exp(s * y) * teg.integral(t * inner, (t, 0, math.inf)), (y, *LINE))
    assert len(nodes_of(Call, with_common_exponents(deeper))) == 1


@pytest.mark.parametrize(
    "e",
    [
        teg.integral(teg.exp(s * x) * NORMAL, *PLANE),  # factors of one variable each
        teg.integral(teg.exp(-((x - y) ** 2)) * NORMAL, *PLANE),  # which falls off
        teg.integral(teg.exp(s * (x + y)) * NORMAL, (y, -8, 8), (x, -8, 8)),  # which is bounded
        teg.integral(teg.exp(s * x) * teg.exp(-x * x), (x, *LINE)),
        teg.integral(teg.sum(teg.exp(s * x) * NORMAL, (teg.index("k"), 0, 3)), *PLANE),
        teg.integral((sum((teg.exp(i * s * (x + y)) for i in range(1, MOST_TERMS + 2)), a)) * NORMAL, *PLANE),
    ],
    ids=["one variable", "falling", "bounded", "one integral", "sum over an index", "long"],
)
def test_others_stay(e: teg.Expr) -> None:
    assert with_common_exponents(e) is e
    assert nodes_of(Integral, e)


def _below(z: float) -> float:
    return 0.5 * math.erfc(-z / math.sqrt(2))


def _call(s: float, a: float) -> float:
    """E max(exp(s·Z) - a, 0) of a standard normal Z (Black and Scholes 1973)."""
    d = -math.log(a) / s
    return math.exp(s * s / 2) * _below(d + s) - a * _below(d)


def _asian(s: float, a: float, b: float) -> float:
    def inner(z: float) -> float:
        known, density = math.exp(s * z), math.exp(-z * z / 2) / math.sqrt(2 * math.pi)
        strike = (2 * a - known) / known
        value = _call(s, strike) if strike > 0 else math.exp(s * s / 2) - strike
        return density * known * value / 2

    turn = math.log(2 * a) / s
    return sum(quad(inner, p, q, epsabs=1e-14, epsrel=1e-13, limit=400)[0] for p, q in [(-9, 0), (0, turn), (turn, turn + 9)])


EXPECTATIONS: list[tuple[str, teg.Expr, Callable[[float, float, float], float]]] = [
    ("part", teg.bracket(x + y < b) * teg.exp(s * (x + y)), lambda s, a, b: math.exp(s * s) * _below((b - 2 * s) / math.sqrt(2))),
    (
        "another part",
        teg.bracket(x + 2 * y < b) * teg.exp(s * (x + y)),
        lambda s, a, b: math.exp(s * s) * _below((b - 3 * s) / math.sqrt(5)),
    ),
    ("call", teg.maximum(teg.exp(s * (x + y)) - a, 0), lambda s, a, b: _call(s * math.sqrt(2), a)),
    (
        "exchange",
        teg.maximum(teg.exp(s * x) - a * teg.exp(s * (b * x + y) / 2), 0),
        lambda s, a, b: _exchange(s, a, b),
    ),
    ("two dates", teg.maximum((teg.exp(s * x) + teg.exp(s * (x + y))) / 2 - a, 0), _asian),
]


def _exchange(s: float, a: float, b: float) -> float:
    """E max(exp(U) - a·exp(V), 0) of normal U and V (Margrabe 1978)."""
    of_u, of_v, both = s * s, s * s * (b * b + 1) / 4, s * s * b / 2
    spread = math.sqrt(of_u + of_v - 2 * both)
    first = (of_u - both - math.log(a)) / spread
    second = (both - of_v - math.log(a)) / spread
    return math.exp(of_u / 2) * _below(first) - a * math.exp(of_v / 2) * _below(second)


@pytest.mark.parametrize("backend", ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "integrand", "exact"), EXPECTATIONS, ids=[e[0] for e in EXPECTATIONS])
def test_expectations(
    name: str, integrand: teg.Expr, exact: Callable[[float, float, float], float], backend: str, request: pytest.FixtureRequest
) -> None:
    """exp(s·(x + y)) overflowed far away beside a density that is 0: NaN, or an infinite estimate after minutes."""
    if backend == "jax":
        request.getfixturevalue("x64_for_jax")
    f = teg.compile(teg.integral(integrand * NORMAL, *PLANE), backend=backend)
    at = {p: AT[p] for p in f.parameters}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, estimate = f.value_and_error(at)
        slopes = f.grad(at)
    assert value == pytest.approx(exact(**AT), rel=1e-10)
    assert estimate < 1e-9
    for p in at:
        h = 1e-4
        far, near = ((exact(**{**AT, p: AT[p] + k * h}) - exact(**{**AT, p: AT[p] - k * h})) / (2 * k * h) for k in (2, 1))
        assert slopes[p] == pytest.approx((4 * near - far) / 3, abs=1e-8), p


TOGETHER = teg.exp(-(x * x + y * y) / 2) / (2 * math.pi)
CORRELATED = teg.exp(-(x * x - y * x + y * y) / 1.5) / (2 * math.pi * math.sqrt(0.75))  # by 1/2


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("integrand", "exact"),
    [
        (teg.bracket(x < a) * teg.exp(s * y) * TOGETHER, lambda s, a: math.exp(s * s / 2) * _below(a)),
        (teg.bracket(x < y) * teg.exp(s * y) * TOGETHER, lambda s, a: math.exp(s * s / 2) * _below(s / math.sqrt(2))),
        (teg.bracket(x < a) * teg.exp(s * y) * CORRELATED, lambda s, a: math.exp(s * s / 2) * _below(a - s / 2)),
        (teg.maximum(teg.exp(s * x) - a * teg.exp(s * y), 0) * CORRELATED, lambda s, a: _correlated_exchange(s, a)),
        (teg.maximum(teg.exp(s * x) - a * teg.exp(s * y), 0) * TOGETHER, lambda s, a: _correlated_exchange(s, a, 0.0)),
    ],
    ids=["a half", "a diagonal", "correlated", "correlated exchange", "exchange"],
)
def test_a_factor_that_the_inner_integral_does_not_have(integrand: teg.Expr, exact: Callable[[float, float], float], order: int) -> None:
    """exp(s·y) stood outside of an integral whose integrand falls off in y: its value or gradient was no number."""
    f = teg.compile(teg.integral(integrand, *PLANE[::order]))
    at = {p: AT[p] for p in f.parameters}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        value, slopes = f.value_and_grad(at)
    s, a = AT["s"], AT["a"]
    assert value == pytest.approx(exact(s, a), rel=1e-10)
    h = 1e-4
    for p, ds, da in (("s", h, 0.0), ("a", 0.0, h)):
        far, near = ((exact(s + k * ds, a + k * da) - exact(s - k * ds, a - k * da)) / (2 * k * h) for k in (2, 1))
        assert slopes.get(p, 0.0) == pytest.approx((4 * near - far) / 3, abs=1e-8), p


def _correlated_exchange(s: float, a: float, correlation: float = 0.5) -> float:
    spread = s * math.sqrt(2 - 2 * correlation)
    middle = -math.log(a) / spread
    return math.exp(s * s / 2) * (_below(middle + spread / 2) - a * _below(middle - spread / 2))
