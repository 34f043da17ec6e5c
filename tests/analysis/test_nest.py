"""Nests of integrals: chains around bodies, ranges that depend on nothing, and the binders of a surface apart from the others."""

from __future__ import annotations

import teg
from teg.analysis.nest import Binder, divided, nest, ranges_of
from teg.ir.expr import ONE, ZERO

x, y, z = teg.vars("x y z")
t = teg.param("t")
OUTER, INNER = Binder(y, ZERO, ONE), Binder(x, ZERO, y)


def test_the_first_binder_is_the_outermost() -> None:
    assert nest(x * t, (OUTER, INNER)) is teg.integral(x * t, (x, 0, y), (y, 0, 1))
    assert nest(t, ()) is t


def test_a_bound_that_moves_has_its_extreme_values() -> None:
    assert ranges_of((OUTER, INNER)) == [(ZERO, ONE), (ZERO, ONE)]


def test_a_bound_that_is_not_affine_has_no_range() -> None:
    assert ranges_of((OUTER, Binder(x, ZERO, y * y))) is None


def test_the_variables_of_a_surface_apart_from_the_others() -> None:
    other = Binder(z, ZERO, t)
    assert divided((other, OUTER, INNER), {x, y}) == ((OUTER, INNER), (other,), (OUTER, Binder(x, ZERO, ONE)))


def test_bounds_of_one_part_may_not_depend_on_the_other() -> None:
    assert divided((OUTER, INNER), {x}) is None  # x goes to y
    assert divided((Binder(z, ZERO, ONE), Binder(x, ZERO, ONE), Binder(y, ZERO, x)), {x, z}) is None  # y goes to x
