"""Coefficients of polynomials about the corner of a box."""

from __future__ import annotations

import teg
from teg.analysis.boxes import coefficients, coefficients_along
from teg.analysis.nest import Binder
from teg.ir.expr import ONE, ZERO, const

x, y = teg.vars("x y")
s, t = teg.params("s t")
UNIT = Binder(y, ZERO, ONE), Binder(x, ZERO, ONE)


def test_coefficients_about_the_corner() -> None:
    assert coefficients(t + 2 * x * y + y**2, UNIT) == {(0, 0): t, (1, 1): const(2.0), (0, 2): ONE}


def test_a_quotient_that_is_a_polynomial_has_none() -> None:
    """(x + t)², but at x = 0 it is 0·∞."""
    assert coefficients(x**2 * (1 + t / x) ** 2, UNIT) is None
    assert coefficients((x / t) ** 2, UNIT) is not None


def test_coefficients_along_bases_keep_these() -> None:
    """x·((y - x)/s)²/s, with q = (y - x)/s; a base that does not stand in the polynomial has no powers."""
    bases = (x + y) / t, (y - x) / s
    assert coefficients_along(x * (y - x) ** 2 / s**3, UNIT, bases) == {(1, 0, 0, 2): s**2 / s**3}
    assert coefficients_along(x * y, UNIT, bases) == {(1, 1, 0, 0): ONE}
    assert coefficients_along(1 / (x + t), UNIT, bases) is None
