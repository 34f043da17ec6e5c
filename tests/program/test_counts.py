"""What a run does, counted: evaluations as the evaluator counts them, and decisions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import teg
from teg.ir.expr import Expr
from teg.program import Program
from teg.program.arrays import ArrayProgram
from teg.program.interpreter.counts import Counts, counts_of, counts_of_arrays

x, y = teg.vars("x y")
t, a = teg.params("t a")


def over_square(e: Any) -> Expr:
    return teg.integral(e, (x, 0, 1), (y, 0, 1))


def counts(e: Expr, orders: int = 1, **values: float) -> Counts:
    f = teg.compile(e)
    program = f.program(orders)
    assert isinstance(program, Program)
    return counts_of(program, [values[name] for name in program.parameters])


@pytest.mark.parametrize(
    ("e", "at"),
    [
        (over_square(teg.bracket(x + a * y < t) * x), {"t": 0.7, "a": 0.5}),
        (over_square(teg.bracket(x + a * y < t) * teg.exp(teg.sin(x * y))), {"t": 0.7, "a": 0.5}),
        (teg.integral(teg.bracket(teg.sin(5 * x) < t) * x * a, (x, 0, 1)), {"t": 0.7, "a": 0.5}),
        (over_square(teg.bracket(x * x + y * y < t)), {"t": 0.7}),
    ],
    ids=["polygon", "adaptive", "isolated", "disk"],
)
def test_evaluations_are_those_of_the_evaluator(e: Expr, at: dict[str, float]) -> None:
    for orders in (0, 1):
        assert counts(e, orders, **at).evaluations == teg.compile(e).evaluations(at, derivatives=orders)


def test_where_nothing_is_crossed_few_decisions_are_made() -> None:
    e = over_square(teg.bracket(x * x + a * y * y < t) * teg.exp(x * y))
    beside, across = (counts(e, t=at, a=1.3) for at in (-1.0, 1.2))
    assert beside.evaluations == 0 < across.evaluations
    assert 0 < beside.decisions < across.decisions / 5


def test_half_planes_corners_and_searches_are_decisions() -> None:
    pair = over_square(teg.bracket(x + a * y < t) * teg.bracket(x - y < a) * x)
    assert counts(pair, 0, t=0.5, a=0.2).decisions - counts(over_square(teg.bracket(x + a * y < t) * x), 0, t=0.5, a=0.2).decisions >= 1
    assert counts(over_square(teg.bracket(x * y > t)), 0, t=0.2).decisions >= 4
    roots = teg.integral(teg.bracket(x * teg.exp(-x) < t) * x, (x, 0, 1))
    assert counts(roots, 0, t=0.2).decisions > 10


def test_a_tie_counts_both_orders() -> None:
    e = teg.integral(teg.bracket(x < t) * teg.bracket(x < a) * teg.exp(teg.sin(x)), (x, 0, 1))
    apart, equal = (counts(e, t=0.5, a=at) for at in (0.500001, 0.5))
    assert equal.decisions > apart.decisions


def test_loops_add_up_and_candidates_are_decisions() -> None:
    k, heights = teg.index("k"), teg.array("H")
    summed = teg.compile(teg.sum(teg.integral(teg.bracket(x < heights[k]) * teg.exp(teg.sin(x)), (x, 0, 1)), (k, 0, teg.length(heights))))
    given = np.array([0.2, 0.7, 2.0])
    program = summed.program(1)
    assert isinstance(program, ArrayProgram)
    found = counts_of_arrays(program, [], [given])
    assert found.evaluations == summed.evaluations(H=given, derivatives=1)
    nearest = teg.compile(over_square(teg.nearest(heights[k], (x - heights[k]) ** 2, (k, 0, teg.length(heights)))))
    program = nearest.program(0)
    assert isinstance(program, ArrayProgram)
    three, six = (counts_of_arrays(program, [], [np.linspace(0.1, 0.9, n)]).decisions for n in (3, 6))
    assert six - three >= 3
