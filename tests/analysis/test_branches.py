"""Functions without branches: every combination of the values of `where` on variables."""

from __future__ import annotations

import teg
from teg.analysis.branches import MAX_BRANCHES, branches_of

x, y = teg.vars("x y")
t = teg.param("t")


def test_both_values_stand_alone() -> None:
    e = teg.where(x < t, x * x, y) + 1
    assert set(branches_of(e) or ()) == {x * x + 1, y + 1}


def test_branches_in_branches() -> None:
    inner = teg.where(y < t, y, 2 * y)
    assert set(branches_of(teg.where(x < t, inner, x)) or ()) == {y, 2 * y, x}


def test_a_condition_on_parameters_is_kept() -> None:
    e = teg.where(t > 0, x, x * x)
    assert branches_of(e) == (e,)


def test_too_many_combinations_are_none() -> None:
    e = sum((teg.where(x < k * t, x, y**k) for k in range(1, 2 * MAX_BRANCHES)), t)
    assert branches_of(e) is None
