"""Quadratics that are sums of squares: against exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.polynomial import is_null
from teg.analysis.roots import discriminant_of, quadratic_coefficients
from teg.analysis.squares import discriminant_of_squares, squares_in
from teg.ir.expr import ZERO
from teg.ir.simplify import sub

x, y = teg.vars("x y")
t, a, b, c, s = teg.params("t a b c s")


def test_what_a_sum_of_squares_consists_of() -> None:
    split = squares_in(t - 2 * (x - a) ** 2 - b * (c * x + y) ** 2 + y * y, [x])
    assert split is not None
    assert {str(base): str(factor) for factor, base in split[0]} == {"x - a": "-2", "c·x + y": "-b"}
    assert sorted(map(str, split[1])) == ["t", "y²"]


@pytest.mark.parametrize(
    "g", [x * x + a * x, x**2 + x**4, x * y * (x + y), (x * y + a) ** 2 + x, teg.exp(x) + x * x, (x * x + a) ** 2], ids=str
)
def test_other_sums(g: teg.Expr) -> None:
    assert squares_in(g, [x]) is None
    assert discriminant_of_squares(g, x, ZERO) is None


@pytest.mark.parametrize(
    "g",
    [
        (c * x + s * y) ** 2 + b * (c * y - s * x) ** 2 - t,
        3 * (x - a) ** 2 - t,
        t - (x - a * y) ** 2 - (b * x + y) ** 2 - c * (x + y - s) ** 2,
    ],
    ids=str,
)
@pytest.mark.parametrize("origin", [ZERO, a], ids=str)
def test_the_discriminant_is_that_of_the_coefficients(g: teg.Expr, origin: teg.Expr) -> None:
    by_squares = discriminant_of_squares(g, x, origin)
    p, q, r = quadratic_coefficients(g, x, origin)
    assert by_squares is not None
    assert is_null(sub(by_squares, q * q - 4 * p * r))


@pytest.mark.parametrize("aspect", [1e3, 1e6, 1e9])
def test_nothing_cancels_in_an_ellipse_that_leans(aspect: float) -> None:
    g = (c * (x - 0.3) + s * (y - 0.2)) ** 2 + (b * (c * (y - 0.2) - s * (x - 0.3))) ** 2 - t
    numbers = {c: 0.8, s: 0.6, b: aspect, t: 0.25, y: 0.29}
    exact = {p: Fraction(v) for p, v in numbers.items()}
    p, q = Fraction(-0.3), exact[y] - Fraction(0.2)
    row, other = (exact[c], exact[c] * p + exact[s] * q), (-exact[s] * exact[b], exact[b] * (exact[c] * q - exact[s] * p))
    first, last = row[0] ** 2 + other[0] ** 2, row[1] ** 2 + other[1] ** 2 - exact[t]
    wanted = 4 * (row[0] * row[1] + other[0] * other[1]) ** 2 - 4 * first * last
    d = discriminant_of(g, x, ZERO, quadratic_coefficients(g, x))
    (found,) = values_of([d], numbers)
    assert found == pytest.approx(float(wanted), rel=1e-14)


def test_what_is_short_by_itself_is_left() -> None:
    """Without parameters the coefficients are exact, and a product tells where it is 0."""
    for g, form in (((x - y) ** 2 + (x + 2 * y) ** 2 - 1, "-36·y² + 8"), ((x - a) ** 2 - t, "4·t")):
        assert str(discriminant_of(g, x, ZERO, quadratic_coefficients(g, x))) == form
