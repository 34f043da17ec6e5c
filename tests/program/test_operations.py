"""The meaning of operations on plain Python numbers: IEEE arithmetic where Python raises, and the order of sums."""

from __future__ import annotations

import math

import pytest

from teg.program.operations import OPERATIONS, divide, floor, largest, least, power, product, total


def test_quotients_by_zero() -> None:
    assert (divide(1.0, 0.0), divide(-1.0, 0.0), divide(1.0, -0.0)) == (math.inf, -math.inf, -math.inf)
    assert math.isnan(divide(0.0, 0.0))
    assert divide(1.0, 4.0) == 0.25


def test_sums_and_products_from_the_left() -> None:
    assert total(1e16, 1.0, -1e16) == 0.0 != total(1e16, -1e16, 1.0)
    assert product(1e300, 1e300, 0.0) != product(1e300, 0.0, 1e300)  # inf·0 is NaN


@pytest.mark.parametrize("n", [-3, -1, 0, 1, 2, 7, 31])
def test_integer_powers(n: int) -> None:
    assert power(1.5, n) == pytest.approx(1.5**n, rel=1e-15)
    assert power(-2.0, n) == (-2.0) ** n


def test_powers_of_zero() -> None:
    assert (power(0.0, 2), power(0.0, -1)) == (0.0, math.inf)


def test_floors_keep_the_sign_of_zero() -> None:
    assert math.copysign(1.0, floor(-0.0)) == -1.0
    assert (floor(-0.5), floor(2.5)) == (-1.0, 2.0)
    assert floor(math.inf) == math.inf


@pytest.mark.parametrize("pair", [(1.0, math.nan), (math.nan, 1.0)])
def test_an_extreme_of_nan_is_nan(pair: tuple[float, float]) -> None:
    assert math.isnan(least(*pair))
    assert math.isnan(largest(*pair))


@pytest.mark.parametrize(
    ("op", "x"), [("exp", 1e4), ("log", -1.0), ("sqrt", -1.0), ("asin", 2.0), ("sin", math.inf), ("cosh", 1e4), ("log", 0.0)]
)
def test_no_operation_raises(op: str, x: float) -> None:
    meaning = OPERATIONS[op].meaning
    assert meaning is not None
    assert not math.isfinite(meaning(x))
