"""Polynomials over GF(P): division, common factors, roots."""

from __future__ import annotations

import pytest

from teg.analysis.field_polynomials import coefficients, common_factor, derivative, monic, one_root, product, quotient_and_remainder
from teg.numerics.field import P, residue


def test_a_polynomial_in_one_variable_as_a_list() -> None:
    assert coefficients({(2,): 3, (0,): 5}) == [5, 0, 3]


def test_the_derivative() -> None:
    assert derivative([5, 7, 3, 2]) == [7, 6, 6]


def test_division_and_product_are_inverse() -> None:
    p, q = [1, 2, 3, 4, 5], [7, 0, 1]
    quotient, remainder = quotient_and_remainder(p, q)
    back = product(quotient, q)
    assert len(remainder) < len(q)
    assert [(b + r) % P for b, r in zip(back, [*remainder, *[0] * len(back)], strict=False)] == p


def test_the_common_factor_is_monic() -> None:
    first, second = product([2, 1], [3, 1]), product([4, 2], [5, 1])
    assert monic([4, 2]) == [2, 1]
    assert common_factor(first, second) == [2, 1]
    assert common_factor([1, 1], [2, 1]) == [1]


@pytest.mark.parametrize("count", [1, 2, 3])
def test_one_root_is_a_root(count: int) -> None:
    roots = [residue("root", k) for k in range(count)]
    p = [1]
    for r in roots:
        p = product(p, [-r % P, 1])
    assert one_root(p) in roots


def test_a_square_that_is_none_has_no_root() -> None:
    """P is 3 modulo 4, so -1 is no square: v² + 1 has no root."""
    assert P % 4 == 3
    assert one_root([1, 0, 1]) is None
