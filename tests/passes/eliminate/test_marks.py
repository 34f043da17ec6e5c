"""What covers places of a curve, in the terms of a chart."""

from __future__ import annotations

from typing import cast

import teg
from teg.ir.expr import ZERO, Compare, const
from teg.ir.function import Apply, Slot
from teg.ir.index import IndexVar, index_const
from teg.ir.simplify import mul
from teg.ir.uncovered import marks_of
from teg.passes.differentiate.edges import _seen
from teg.passes.differentiate.gaps import Around
from teg.passes.eliminate.marks import with_conditions_at

x, y = teg.vars("x y")
t, s = teg.params("t s")
k = IndexVar.make("k", ())


def test_conditions_in_terms_of_a_chart() -> None:
    """Conditions at the place are changed, and get its terms; those elsewhere are left alone."""
    covered = cast(teg.Cond, x - t > 0)
    around = Around((k, index_const(0), index_const(2)), covered, ZERO)
    here, there = _seen(around, (x, y)), _seen(around, (y, x))
    seen: list[tuple[object, ...]] = []

    def moved(g: teg.Expr, names: object, about: object) -> teg.Expr:
        seen.append((g, names, about))
        return mul(const(2.0), about[0])  # type: ignore[index]

    result = with_conditions_at(mul(here, there), (x, y), moved, (s, t))
    changed, same = sorted(marks_of(result), key=lambda m: -len(m.children))
    assert (changed.children, same) == ((x, y, s, t), there)
    ((g, names, about),) = seen
    assert (g, names) == (cast(Compare, covered).g, (x, y))
    condition = cast(Slot, cast(Apply, changed).callee).data[4][0].condition
    assert condition.g is mul(const(2.0), about[0])  # type: ignore[index]
