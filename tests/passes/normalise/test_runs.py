"""Sums over lists as sums over runs of equal entries: which entries may have runs, and the program by runs."""

from __future__ import annotations

import numpy as np
import pytest

import teg
from teg.ir.index import Index, index_const
from teg.passes.normalise.runs import Entry, Listed, Rows, Runs, by_runs, listed_sums

values, weights, pairs, starts = teg.array("A"), teg.array("W", 2), teg.indices("P", 2), teg.indices("S")
n, k, m = teg.index("n"), teg.index("k"), teg.param("m")
first, second = pairs[n, 0], pairs[n, 1]
LENGTH = teg.length(pairs)
FIRST, SECOND = Entry(pairs, (None, 0)), Entry(pairs, (None, 1))


def listed(body: teg.Expr, hi: object = LENGTH) -> list[Listed]:
    return listed_sums(teg.sum(body, (n, 0, hi)))  # type: ignore[arg-type]


def test_entries_that_choose_numbers_alone() -> None:
    assert listed(values[first] * weights[first, 2]) == [Listed(index_const(0), LENGTH, (FIRST,), "n", (FIRST,))]
    assert listed(values[first] * values[second])[0].entries == (FIRST, SECOND)


def test_entries_as_they_are_written() -> None:
    assert listed(values[first] * values[second])[0].written == ["P[n, 0]", "P[n, 1]"]


def test_entries_behind_entries() -> None:
    assert listed(values[starts[first] + 1])[0].entries == (FIRST,)


@pytest.mark.parametrize("body", [weights[first, second], weights[n, 0] * first, weights[n, first], values[n]])
def test_numbers_that_more_than_one_entry_chooses(body: teg.Expr) -> None:
    assert listed(body) == []


def test_all_entries_if_the_index_is_used_in_no_other_way() -> None:
    assert set(listed(values[first] * second)[0].every) == {FIRST, SECOND}
    assert set(listed(values[first] * weights[starts[second] + 1, first])[0].every) == {FIRST, SECOND}
    for other in (values[n], second * n, weights[pairs[n, first], 0], teg.sum(values[k], (k, 0, n))):
        assert listed(values[first] * other)[0].every == ()
    e = teg.sum(values[first], (n, 0, LENGTH)) + teg.sum(second * n, (n, 0, LENGTH))
    assert listed_sums(e)[0].every == ()


def test_sums_inside_of_others_are_left_alone() -> None:
    assert listed_sums(teg.sum(values[pairs[k, n]], (k, 0, 3), (n, 0, LENGTH))) == []
    inner = teg.sum(values[pairs[n, 1]], (n, 0, 4))
    assert listed_sums(teg.sum(inner * values[k], (k, 0, 3))) == []


def test_only_ends_that_a_call_tells() -> None:
    assert listed(values[first], m)
    assert listed(values[first], 7)
    assert listed(values[first], starts[0]) == []


def test_the_program_by_runs() -> None:
    e = teg.sum(values[first] * second, (n, 0, LENGTH))
    end: tuple[Index, Index] = index_const(0), LENGTH
    found = by_runs(e, {end: Runs((FIRST,), starts)})
    assert str(found).count("S[") == 3
    assert listed_sums(found) == []
    data = np.array([[0, 1], [0, 5], [2, 1], [2, 2], [1, 0]])
    given = {"A": [2.0, 3.0, 5.0], "P": data}
    assert teg.evaluate(found, {**given, "S": [0, 2, 4, 5]}) == teg.evaluate(e, given) == 2.0 * 6 + 5.0 * 3
    assert by_runs(e, {}) is e


def test_runs_of_one_entry_leave_others_as_they_are() -> None:
    e = teg.sum(values[first] * values[second], (n, 0, LENGTH))
    found = by_runs(e, {(index_const(0), LENGTH): Runs((FIRST,), starts)})
    given = {"A": [2.0, 3.0, 5.0], "P": np.array([[0, 1], [0, 2], [1, 1]])}
    assert teg.evaluate(found, {**given, "S": [0, 2, 3]}) == teg.evaluate(e, given)


def test_the_program_by_rows() -> None:
    """Pairs (0, 4), (0, 5), (0, 9); (2, 1), (2, 2): two runs, the first one of two rows."""
    table, third = teg.indices("R", 2), Entry(pairs, (None, 2))
    e = teg.sum(values[first] * (second + 10 * second**2) * pairs[n, 2], (n, 0, LENGTH))
    rows = Rows(table, (FIRST, third), SECOND)
    found = by_runs(e, {(index_const(0), LENGTH): Runs((FIRST,), starts, rows)})
    assert "P[n" not in str(found)
    data = np.array([[0, 4, 7], [0, 5, 7], [0, 9, 8], [2, 1, 3], [2, 2, 3]])
    given = {"A": [2.0, 3.0, 5.0], "P": data}
    of_rows = {"S": [0, 2, 3], "R": np.array([[0, 7, 4, 6], [0, 8, 9, 10], [2, 3, 1, 3]])}
    expected = sum(given["A"][a] * (b + 10 * b * b) * c for a, b, c in data.tolist())
    assert teg.evaluate(found, {**given, **of_rows}) == expected
