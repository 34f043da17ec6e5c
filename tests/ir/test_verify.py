"""Well-formedness: a node with children of the wrong kind is found, and named with the pass after which it stands."""

from __future__ import annotations

import pytest

import teg
from teg.ir.expr import ONE, Add, And, Compare, Pow, Where
from teg.ir.verify import verify

x = teg.var("x")
t = teg.param("t")


@pytest.mark.parametrize("e", [t + 1, teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1)), teg.tuple(t, teg.where(t > 0, 1, t))])
def test_programs_are_well_formed(e: teg.Expr) -> None:
    verify(e)


@pytest.mark.parametrize(
    "wrong",
    [
        Add.make(None, (t, t > 0)),  # type: ignore[arg-type]
        And.make(None, (t > 0, t)),  # type: ignore[arg-type]
        Where.make(None, (t, t, t)),
        Compare.make((True, None), (t > 0,)),
        Pow.make(2, (t, ONE)),
    ],
)
def test_children_of_the_wrong_kind(wrong: teg.Expr) -> None:
    with pytest.raises(AssertionError, match="after a test"):
        verify(wrong, "after a test")
