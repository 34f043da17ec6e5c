"""Coefficients of polynomials about the corner of a box."""

from __future__ import annotations

import teg
from teg.analysis.boxes import coefficients
from teg.analysis.nest import Binder
from teg.ir.expr import ONE, ZERO, const

x, y = teg.vars("x y")
t = teg.param("t")
UNIT = Binder(y, ZERO, ONE), Binder(x, ZERO, ONE)


def test_coefficients_about_the_corner() -> None:
    assert coefficients(t + 2 * x * y + y**2, UNIT) == {(0, 0): t, (1, 1): const(2.0), (0, 2): ONE}


def test_a_quotient_that_is_a_polynomial_has_none() -> None:
    """(x + t)², but at x = 0 it is 0·∞."""
    assert coefficients(x**2 * (1 + t / x) ** 2, UNIT) is None
    assert coefficients((x / t) ** 2, UNIT) is not None
