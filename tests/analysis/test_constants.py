"""Constants that are products of powers of one another."""

from __future__ import annotations

import math

from teg.analysis.constants import with_symbols, with_values
from teg.analysis.polynomial import is_null
from teg.ir.expr import Param, const
from teg.ir.simplify import add, call, div, integer_power, mul, sub

s = Param.make("s", ())
C = math.sqrt(2 * math.pi)


def test_what_cancels_by_a_square_of_a_constant() -> None:
    """2c²/(c·s)³ - 2/(c·s³) is 0, with the rounded number 2c²."""
    cs = mul(const(C), s)
    e = sub(mul(const(2 * C * C), integer_power(cs, -3)), div(const(2.0), mul(const(C), integer_power(s, 3))))
    assert not is_null(e)
    (exact,), symbols = with_symbols([e])
    assert is_null(exact)
    assert len(symbols) == 1


def test_products_of_two_constants() -> None:
    """(3.3c + s²·c)·s - (3.3 + s²)·(c·s) is 0."""
    square = integer_power(s, 2)
    e = sub(mul(add(const(3.3 * C), mul(const(C), square)), s), mul(add(const(3.3), square), const(C), s))
    assert not is_null(e)
    (exact,), symbols = with_symbols([e])
    assert is_null(exact)
    assert len(symbols) == 2


def test_numbers_that_have_nothing_to_do_with_each_other() -> None:
    _, symbols = with_symbols([add(mul(const(math.pi), s), mul(const(math.e), integer_power(s, 2)), const(math.sqrt(3)))])
    assert len(symbols) == 3


def test_few_bits_and_functions_stay() -> None:
    e = add(mul(const(0.375), s), call("sin", mul(const(C), s)), const(math.inf))
    assert with_symbols([e]) == ([e], {})


def test_values_come_back() -> None:
    e = add(mul(const(2 * C), s), div(const(1 / C), s), integer_power(mul(const(C), s), 2))
    changed, symbols = with_symbols([e])
    assert changed != [e]
    (back,) = with_values(changed, symbols)
    assert with_symbols([back])[0] == changed
