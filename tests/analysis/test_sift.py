"""The coefficient of a δ and the integrals around it."""

from __future__ import annotations

import pytest

import teg
from teg.analysis.nest import Binder
from teg.analysis.sift import deltas_of, linear_part, without
from teg.errors import DeltaError
from teg.ir.expr import ONE, ZERO, Expr, const
from teg.ir.integral import Delta, delta, integral_over
from teg.ir.simplify import add, mul, where

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
D = delta(t - x - y)
OTHER = delta(a - x)
IN_X, IN_Y = Binder(x, ZERO, ONE), Binder(y, ZERO, const(2.0))
assert isinstance(D, Delta)
WHEN = a < b


def over_x(e: Expr) -> Expr:
    return integral_over(e, x, ZERO, ONE)


def over_y(e: Expr) -> Expr:
    return integral_over(e, y, ZERO, const(2.0))


@pytest.mark.parametrize(
    ("e", "parts"),
    [
        (D, {(): ONE}),
        (mul(a, D, x), {(): mul(a, x)}),
        (add(D, mul(a, D)), {(): add(ONE, a)}),
        (mul(b, over_x(mul(x, D))), {(IN_X,): mul(x, b)}),
        (over_y(mul(y, over_x(mul(x, D)))), {(IN_Y, IN_X): mul(x, y)}),
        (add(over_x(D), over_y(D)), {(IN_X,): ONE, (IN_Y,): ONE}),
        (where(WHEN, D, mul(t, OTHER)), {(): where(WHEN, ONE, ZERO)}),
        (where(WHEN, mul(t, D), mul(x, D)), {(): add(where(WHEN, t, ZERO), where(WHEN, ZERO, x))}),
        (add(OTHER, t), {}),
    ],
    ids=str,
)
def test_coefficients(e: Expr, parts: dict[tuple[Binder, ...], Expr]) -> None:
    found = linear_part(e, D)
    assert list(found) == list(parts)
    assert all(found[chain] is k for chain, k in parts.items()), found


def test_deltas_are_listed_once_and_can_be_left_out() -> None:
    e = add(mul(a, D), over_x(add(OTHER, D)), t)
    assert set(deltas_of(e)) == {D, OTHER}
    assert len(deltas_of(e)) == 2
    assert without(e, {D}) is add(over_x(OTHER), t)
    assert deltas_of(t) == []


def test_places_without_a_meaning() -> None:
    with pytest.raises(DeltaError, match="twice"):
        linear_part(mul(add(D, a), add(D, b)), D)
    with pytest.raises(DeltaError, match="non-linear"):
        linear_part(add(D, a) ** 2, D)
    with pytest.raises(DeltaError, match="bound"):
        linear_part(integral_over(x, x, ZERO, add(D, a)), D)
