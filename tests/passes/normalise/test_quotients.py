"""Quotients by the size of an expression."""

from __future__ import annotations

from typing import cast

import teg
from teg.ir.expr import Mul
from teg.passes.normalise.quotients import with_whole_branches

x, y = teg.vars("x y")
a = teg.param("a")
u = x - a


def test_a_quotient_by_a_size_is_a_sign() -> None:
    quotient = cast(Mul, u / teg.abs(u))
    whole = with_whole_branches(quotient)
    assert whole is teg.where(u > 0, 1, -1)
    assert with_whole_branches(cast(Mul, y * u / teg.abs(u))) is teg.where(u > 0, y, -y)


def test_other_branches_stay() -> None:
    for e in (y * teg.where(u > 0, x, 2), y * teg.where(u > 0, 1 / (x + 2), 3), x * y):
        assert with_whole_branches(cast(Mul, e)) is e
