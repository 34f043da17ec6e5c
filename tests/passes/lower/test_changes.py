"""What a small node can change: bounds of the part of an integrand that comes from it, against values at many places."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.intervals import Enclosure
from teg.ir.expr import Call, Expr, Pow, const
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.lower.changes import Changes, curved_nodes

x, y = teg.vars("x y")
t = teg.param("t")
BOX = (const(0.25), const(0.5))


def bound(body: Expr, node: Expr, most: float, inner: Integral | None = None) -> float:
    return float(values_of([Changes([body], Enclosure({x: BOX})).of(node, const(most), inner)], {})[0])


def power_of(body: Expr) -> Expr:
    return next(n for n in postorder([body]) if isinstance(n, Pow) and n.exponent > 2)


@pytest.mark.parametrize(
    ("beside", "rate"),
    [
        (lambda n: n, 1.0),
        (lambda n: 5 + n, 1.0),
        (lambda n: 3 * x * n, 1.5),
        (lambda n: teg.where(x < 0.3, n, 7), 1.0),
        (lambda n: x * n + (1 - x) * n, 1.0),
    ],
)
def test_a_node_changes_an_integrand_by_its_size_times_a_rate(beside: Callable[[Expr], Expr], rate: float) -> None:
    power = (x - 0.3) ** 20
    assert rate * 1e-9 <= bound(beside(power), power, 1e-9) <= 1.3 * rate * 1e-9


def test_what_is_not_linear_in_a_node_has_no_bound() -> None:
    power = (x - 0.3) ** 20
    for body in (teg.sqrt(power + 1), power * (power + 1), 1 / (1 + power)):
        assert bound(body, power, 1e-9) == math.inf


@pytest.mark.parametrize("singular", [1 / teg.sqrt(x - 0.25), (x - 0.25) ** -0.7, (0.5 - x) ** -0.5 + 3, (x * x - 0.0625) ** -0.25])
def test_beside_an_integrable_singularity_the_bound_is_that_of_what_is_not_too_near_to_it(singular: teg.Expr) -> None:
    power = (x - 0.3) ** 20
    assert 1e-9 < bound(singular * power, power, 1e-9) < 100.0
    assert bound((x - 0.25) ** -1.5 * power, power, 1e-9) == math.inf


def test_a_power_of_what_has_no_largest_value_is_bounded_where_that_is_least() -> None:
    power = (x - 0.3) ** 20
    changes = Changes([(1 / x + 1) ** -0.5 * power], Enclosure({x: (const(0.0), const(0.5))}))
    assert 3.0**-0.5 * 1e-9 <= float(values_of([changes.of(power, const(1e-9), None)], {})[0]) <= 1e-9


def test_a_slope_that_tells_of_a_step_is_no_size() -> None:
    step = teg.tanh(100 * x)
    assert bound(step, step, 1e-9) == math.inf


def test_the_change_of_an_inner_integral() -> None:
    """∫₀² (1 + 3y)·N dy changes by 2·7·|N|, and 1 + 4·∫ by four times that."""
    body = teg.integral((1 + 3 * y) * (x - y) ** 20 + 8, (y, 0, 2))
    inner = next(n for n in postorder([body]) if isinstance(n, Integral))
    power = power_of(inner.body)
    assert bound(1 + 4 * body, power, 1e-9, inner) == pytest.approx(4 * 14e-9)
    assert bound(body, power, 1e-9) == math.inf  # as a node outside of an integral it is none of this body


def test_a_logarithm_beside_a_power_has_half_of_it() -> None:
    """u²⁰·log u changes by |log u·u¹⁰|·√(u²⁰), which has a bound where u vanishes."""
    u = x - 0.25
    body = u**20 * teg.log(u)
    node = power_of(body)
    assert isinstance(next(n for n in postorder([body]) if isinstance(n, Call)), Call)
    for place in (0.2500001, 0.26, 0.3, 0.5):
        size = (place - 0.25) ** 20
        assert size * abs(math.log(place - 0.25)) <= bound(body, node, size) < 1e-4 * math.sqrt(size)


def test_nodes_in_powers_and_functions_are_curved() -> None:
    """A body may be linear in others: factors, terms, branches, what a condition or a floor holds."""
    u, v, w, c = teg.exp(x), teg.sin(x), teg.cosh(x), teg.exp(-x)
    body = u * t + teg.exp(v + t) ** 2 + teg.where(c < t, w, x) + teg.floor(teg.tanh(x))
    curved = curved_nodes([body])
    assert {v, v + t, teg.exp(v + t)} <= curved
    assert curved.isdisjoint({u, w, c, body, u * t, teg.tanh(x)})
    assert teg.tanh(x) in curved_nodes([body, teg.sqrt(teg.tanh(x))])
