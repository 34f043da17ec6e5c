"""Expressions beside a surface: what is 0 there, and conditions on both sides."""

from __future__ import annotations

import teg
from teg.analysis.beside import beside

x, y = teg.vars("x y")
r = teg.params("r")[0]
CIRCLE = r * r - x * x - y * y


def test_a_multiple_of_the_surface_is_0() -> None:
    (node,) = beside((x + teg.sqrt(3 * (x * x + y * y) - 3 * r * r)) ** 20, x, CIRCLE)
    assert str(node) == str(x**20)


def test_conditions_hold_on_one_side_each() -> None:
    inside, outside = beside(teg.where(2 * x * x + 2 * y * y < 2 * r * r, x, y + x * x) ** 3, x, CIRCLE)
    assert (str(inside), str(outside)) == (str(x**3), str((y + x * x) ** 3))
    inside, outside = beside(teg.where(x * x + y * y > r * r, x, y + x * x) ** 3, x, CIRCLE)
    assert (str(outside), str(inside)) == (str(x**3), str((y + x * x) ** 3))


def test_other_surfaces_stay_as_they_are() -> None:
    node = teg.where(x + y < r, x, teg.sqrt(r * r - x * x - 2 * y * y)) ** 20
    assert beside(node, x, CIRCLE) == [node]


def test_the_surface_itself_stays() -> None:
    assert beside(CIRCLE, x, CIRCLE) == [CIRCLE]
