"""The factors in front of integrals."""

from __future__ import annotations

import pytest

import teg
from teg.ir.expr import Const, Expr
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.lower.weights import LARGEST_FACTOR, largest, relative, weights

x = teg.var("x")
a, t = teg.params("a t")
INNER = teg.integral(teg.exp(a * x), (x, 0, 1))


def weight_of(e: Expr) -> object:
    """The weight of the only integral of an expression: a number, an expression, or None."""
    found = weights([e], postorder([e]))
    assert len([n for n in postorder([e]) if isinstance(n, Integral)]) == 1
    weight = next(iter(found.values()), None)
    return weight.data if isinstance(weight, Const) else weight


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (INNER, None),
        (50.0 * INNER, None),
        (1e25 * INNER, 1e25),
        (-1e25 * INNER + t, 1e25),
        (1e300 * INNER, LARGEST_FACTOR),
        (1e25 * teg.sin(INNER), None),
    ],
)
def test_numbers_in_front(e: Expr, expected: float | None) -> None:
    assert weight_of(e) == expected


def test_parameters_in_front() -> None:
    weight = weight_of(t**5 * INNER)
    assert isinstance(weight, Expr)
    for value, expected in ((10.0, 1e5), (-10.0, 1e5), (0.1, 1.0)):
        assert teg.evaluate(weight, {t: value}) == pytest.approx(expected)


def test_a_factor_in_a_branch_that_is_not_taken_does_not_count() -> None:
    weight = weight_of(teg.where(t > 0, teg.sqrt(t) * INNER, a * INNER))
    assert isinstance(weight, Expr)
    assert teg.evaluate(weight, {t: -1.0, a: 50.0}) == 50.0
    assert teg.evaluate(weight, {t: 1e6, a: 50.0}) == 1000.0


def test_the_largest_of_several_places_counts() -> None:
    assert teg.evaluate(weight_of(t * INNER + a * INNER), {t: 300.0, a: -700.0}) == 700.0  # type: ignore[arg-type]
    assert largest([t, t]) is t


OTHER = teg.integral(teg.exp(t * x), (x, 0, 1))


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (INNER, set()),
        (t * INNER**2 + teg.exp(OTHER), set()),
        (t * teg.log(INNER) + OTHER, {INNER}),
        (teg.sqrt(2 + INNER), {INNER}),
        (a / INNER, {INNER}),
        (OTHER * INNER, set()),
        (OTHER / INNER, {INNER, OTHER}),
        (OTHER * teg.log(INNER), {INNER, OTHER}),
        (teg.where(t > 0, OTHER, 1 / (1 + teg.exp(INNER))), {INNER}),
    ],
    ids=[
        "alone",
        "beside another",
        "in a logarithm",
        "in a root",
        "in a denominator",
        "a factor",
        "a quotient",
        "a factor of a logarithm",
        "a branch",
    ],
)
def test_digits_that_count_however_small(e: Expr, expected: set[Expr]) -> None:
    assert relative(postorder([e]), ()) == expected


def test_digits_of_roots() -> None:
    e = a * INNER + OTHER**2
    assert relative(postorder([e]), [e]) == {INNER, OTHER}
