"""Breaks of features: `Features.count` says how many lowering adds to those of surfaces, which is what `teg.explain` prints."""

from __future__ import annotations

from math import inf

import pytest

import teg
from teg.ir.expr import Expr
from teg.program import Integrate, statements

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")


def bell(u: Expr, at: Expr | float = 0.0) -> Expr:
    return teg.exp(-a * (u - at) ** 2)


def sech(u: Expr) -> Expr:
    return 1 / teg.cosh(u)


COUNTED = {
    "a peak": (teg.integral(bell(x, t), (x, 0, 1)), [3]),
    "two peaks": (teg.integral(bell(x, t) + bell(x, 2 * t), (x, 0, 1)), [6]),
    "the tail of a peak at both ends": (teg.integral(teg.exp(b - a * (x - t) ** 2), (x, 0, 1)), [5]),
    "the tail of a peak beside a condition": (teg.integral(teg.exp(b - a * (x - t) ** 2) * teg.bracket(x < b), (x, 0, inf)), [7]),
    "a peak and a condition": (teg.integral(bell(x, t) * teg.bracket(x < b), (x, -inf, inf)), [5]),
    "no features": (teg.integral(teg.exp(teg.sin(t * x)), (x, 0, 1)), [0]),
    "a centre": (teg.integral(sech(a * (x - t)), (x, -inf, inf)), [1]),
    "a centre beside a bound": (teg.integral(sech(a * (x - t)), (x, 0, inf)), [1]),
    "beside a root": (teg.integral(teg.sqrt(x - t) * teg.exp(-x), (x, t, inf)), [5]),
    "no centre": (teg.integral(1 / (1 + x**4), (x, -inf, inf)), [1]),
    "centres that meet": (teg.integral(sech(a * (x - t)) * sech(b * (y - x)), (x, -inf, inf), (y, 0, 1)), [1, 2]),
    "three pairs that meet": (
        teg.integral(sech(a * (x - t)) * sech(b * (y - x)) * sech(b * (y - 2 * x)), (x, -inf, inf), (y, 0, 1)),
        [3, 6],
    ),
}


@pytest.mark.parametrize("name", COUNTED)
def test_explain_counts_the_breaks_of_the_program(name: str) -> None:
    program, breaks = COUNTED[name]
    rows = [r for r in teg.explain(program, derivatives=0).data["integrals"] if r["kind"] == "integral"]
    assert sorted(r["breaks"] for r in rows) == breaks
    flat = teg.compile(program, backend="numpy").program(0)
    assert sorted(len(s.breaks) for s in statements(flat.body) if isinstance(s, Integrate)) == breaks


def test_a_piece_that_is_singular_at_both_ends_is_cut_in_the_middle() -> None:
    """A chart of a parabola that may be degenerate: its slope vanishes at both ends of a piece."""
    p, q, r = teg.params("p q r")
    region = teg.integral(teg.bracket(p * x**2 + q * x * y + r * y**2 + a * x + b * y + t < 0) * (1 + x), (y, -1, 1), (x, -1, 1))
    rows = teg.explain(region, derivatives=1).data["boundary"]
    flat = teg.compile(region, backend="numpy").program(1)
    most = max(len(s.breaks) for s in statements(flat.body) if isinstance(s, Integrate))
    assert most == max(r["breaks"] for r in rows) == 7


def test_a_tail_has_a_break_beside_a_singular_end() -> None:
    """Powers from 2 on cost less without one, also those by their logarithm."""

    def breaks(body: Expr) -> int:
        flat = teg.compile(teg.integral(body, (x, 0, inf)), backend="numpy").program(0)
        return sum(len(s.breaks) for s in statements(flat.body) if isinstance(s, Integrate))

    decay = teg.exp(-x)
    without = breaks(x**2.5 * decay)
    assert breaks(teg.exp(2.5 * teg.log(x) - x)) == without
    assert [breaks(x**power * decay) - without for power in (-0.5, 0.5, 1.5)] == [2, 2, 2]
