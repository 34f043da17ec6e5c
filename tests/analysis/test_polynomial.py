"""What an expression is as a polynomial."""

from __future__ import annotations

from fractions import Fraction

import pytest

import teg
from teg.analysis.expanded import expanded
from teg.analysis.polynomial import Point, Shadow
from teg.numerics.field import P, sign_of_residue

x, y, z = teg.vars("x y z")
t, a, b = teg.params("t a b")

e01 = (a - 1) * (y - t) - (b - t) * (x - 1)
e12 = (2 - a) * (y - b) - (3 - b) * (x - a)
e20 = (1 - 2) * (y - 3) - (t - 3) * (x - 2)


@pytest.mark.parametrize(
    ("e", "degree"),
    [
        (t * a, 0),
        (x, 1),
        (x * y, 2),
        (x**3 + y, 3),
        ((x + t) ** 5, 5),
        (x - x * t, 1),
        ((x + y) ** 2 - x**2 - 2 * x * y - y**2 + x, 1),
        ((x + 1) * (x - 1) - x * x, 0),
        (teg.sin(t) * x, 1),
        (x / t, 1),
        (x**2 / (1 + t), 2),
        (teg.sin(x), None),
        (1 / x, None),
        (teg.sqrt(x), None),
        (x ** teg.param("k"), None),
        (teg.where(t < a, x, x**2), 2),
        (teg.abs(x) * y, 2),
        (e01 + e12 + e20, 0),  # the denominator of barycentric coordinates: free of x and y after cancellation only
        (e01 / (e01 + e12 + e20), 1),
    ],
    ids=lambda v: str(v),
)
def test_degree(e: teg.Expr, degree: int | None) -> None:
    assert Shadow((x, y)).degree(e) == degree


def test_degree_in_some_variables() -> None:
    e = x**2 * y**3 * z
    assert Shadow((x,)).degree(e) == 2
    assert Shadow((y, z)).degree(e) == 4
    assert Shadow(()).degree(e) == 0


def test_points_tell_equal_from_different() -> None:
    p = Point("one")
    assert p.value((x + t) ** 2) == p.value(x**2 + 2 * x * t + t**2)
    assert p.value((x + t) ** 2) != p.value(x**2 + x * t + t**2)
    assert p.value(x * 3.5 + 0.1) != Point("two").value(x * 3.5 + 0.1)
    assert p.value(teg.sin(x + t)) == p.value(teg.sin(t + x))
    assert p.value(x / x - 1) == 0


@pytest.mark.parametrize(
    "value", [Fraction(1), Fraction(-2), Fraction(3, 7), Fraction(-37, 10), Fraction(2**50 + 1, 3**30), Fraction(-1, 2**60)]
)
def test_the_sign_of_a_fraction_is_recovered(value: Fraction) -> None:
    residue = value.numerator * pow(value.denominator, -1, P) % P
    assert sign_of_residue(residue) == (1 if value > 0 else -1)


def test_expansion_cancels_exactly() -> None:
    assert expanded((x + t) ** 2 - x**2 - t**2 - 2 * x * t) is teg.ir.expr.ZERO
    product = expanded((x + 1) * (y - t))
    assert product is not None
    assert Point("q").value(product) == Point("q").value((x + 1) * (y - t))


def test_expansion_has_a_limit() -> None:
    e = (x + y + z + t + a + b) ** 6
    assert expanded(e, limit=20) is None
