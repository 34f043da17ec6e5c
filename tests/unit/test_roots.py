"""Roots of surfaces in one variable."""

from __future__ import annotations

import math

import pytest

import teg
from teg.expr import ZERO
from teg.roots import Roots, quadratic_coefficients, roots_in

x, y = teg.vars("x y")
a, b, c, t = teg.params("a b c t")


def points(roots: Roots | None, **values: float) -> list[float]:
    assert roots is not None
    return sorted(float(teg.evaluate(p, values)) for p in roots.points)


def test_no_root_where_the_variable_does_not_occur() -> None:
    assert roots_in(t - a, x, ZERO) == Roots((), 0)


def test_affine() -> None:
    assert points(roots_in(a * x + b, x, ZERO), a=2.0, b=-3.0) == [1.5]


def test_an_affine_root_is_taken_from_the_local_origin() -> None:
    corner = 2.0**26
    g = (x - (corner + 0.25)) * 3.0
    assert points(roots_in(g, x, teg.expr.const(corner))) == [corner + 0.25]


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((1.0, -3.0, 2.0), [1.0, 2.0]),
        ((1.0, 3.0, 2.0), [-2.0, -1.0]),
        ((2.0, 0.0, -2.0), [-1.0, 1.0]),
        ((1.0, -1e8, 1.0), [1e-8, 1e8]),
        ((-1.0, 0.5, 0.5), [-0.5, 1.0]),
    ],
)
def test_quadratic_roots_do_not_cancel(coefficients: tuple[float, float, float], expected: list[float]) -> None:
    found = points(roots_in(a * x**2 + b * x + c, x, ZERO), **dict(zip("abc", coefficients, strict=True)))
    assert found == pytest.approx(expected, rel=4e-16)


def test_a_vanishing_leading_coefficient_leaves_the_other_root() -> None:
    roots = roots_in(a * x**2 + b * x + c, x, ZERO)
    assert roots is not None
    found = [float(teg.evaluate(p, {"a": 0.0, "b": 2.0, "c": -1.0})) for p in roots.points]
    assert 0.5 in found
    assert not all(math.isfinite(v) for v in found)


def test_the_discriminant_of_a_shifted_square_is_no_difference_of_squares() -> None:
    roots = roots_in(t - (x - c) ** 2, x, ZERO)
    assert roots is not None
    assert roots.degree == 2
    assert teg.evaluate(roots.discriminant, {t: 1e-20, c: 1e5} if "c" in str(roots.discriminant) else {t: 1e-20}) == pytest.approx(
        4e-20, rel=1e-15
    )


def test_coefficients() -> None:
    found = quadratic_coefficients(a * x**2 + (b + y) * x - c, x)
    assert [str(e) for e in found] == ["a", "b + y", "-c"]


@pytest.mark.parametrize("g", [teg.sin(x) - t, x**3 - t, teg.exp(x) - t, 1 / x - t], ids=str)
def test_no_formula(g: teg.Expr) -> None:
    assert roots_in(g, x, ZERO) is None
