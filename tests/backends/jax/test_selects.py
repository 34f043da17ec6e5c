"""Choices that are made already, left out of straight lines."""

from __future__ import annotations

import pytest

from teg.backends.c.crossed import Crossed
from teg.backends.jax.selects import chosen_once
from teg.program import Arg, Assign
from teg.program.operations import OPERATIONS


def selects(line: Crossed) -> int:
    return sum(isinstance(item, Assign) and item.op == "select" for item in line.items)


def line(*items: tuple[str, str, tuple[Arg, ...]], outputs: tuple[Arg, ...]) -> Crossed:
    return Crossed(tuple(Assign(*item) for item in items), outputs, True)


INNER = (
    ("b0", "lt0", ("p0",)),
    ("b1", "lt0", ("p1",)),
    ("b2", "or", ("b0", "b1")),
    ("b3", "not", ("b2",)),
    ("b4", "ge0", ("p0",)),
    ("b5", "ge0", ("p1",)),
    ("b6", "gt0", ("p2",)),
    ("b7", "and", ("b4", "b5", "b6")),
    ("v8", "select", ("b7", "p3", 0.0)),
    ("v9", "select", ("b7", "p4", 0.0)),
)


def test_a_choice_twice() -> None:
    found = chosen_once(line(*INNER, ("v10", "select", ("b7", "v8", 0.0)), outputs=("v10",)))
    assert found.outputs == ("v8",)
    assert selects(found) == 1


def test_a_sum_of_choices_by_a_condition_that_follows_from_theirs() -> None:
    """b7 holds only where p0 ≥ 0 and p1 ≥ 0, so where neither is below 0: b3."""
    found = chosen_once(line(*INNER, ("v10", "add", ("v8", "v9")), ("v11", "select", ("b3", "v10", 0.0)), outputs=("v11",)))
    assert found.outputs == ("v10",)
    assert selects(found) == 2


@pytest.mark.parametrize(
    "last",
    [
        ("v11", "select", ("b2", "v8", 0.0)),  # does not follow
        ("v11", "select", ("b3", "p3", 0.0)),  # a value that is not 0 elsewhere
        ("v11", "select", ("b3", "v8", 1.0)),  # another value
        ("v11", "select", ("b6", "v12", 0.0)),  # NaN where p5 is
    ],
)
def test_other_choices_stay(last: tuple[str, str, tuple[Arg, ...]]) -> None:
    before = line(*INNER, ("v12", "mul", ("v8", "p5")), last, outputs=("v11",))
    assert chosen_once(before).outputs == ("v11",)


def test_signs_of_what_is_no_number() -> None:
    """Where p0 is NaN, p0 < 0 does not hold, and p0 ≥ 0 does not either: one does not follow from the other's failing."""
    items = (("b0", "lt0", ("p0",)), ("b1", "not", ("b0",)), ("b2", "ge0", ("p0",)), ("v3", "select", ("b1", "p1", 0.0)))
    assert selects(chosen_once(line(*items, ("v4", "select", ("b2", "v3", 0.0)), outputs=("v4",)))) == 2
    assert (
        selects(chosen_once(line(*items[:3], ("v3", "select", ("b2", "p1", 0.0)), ("v4", "select", ("b1", "v3", 0.0)), outputs=("v4",))))
        == 1
    )


def test_the_comparisons_are_those_of_programs() -> None:
    from teg.backends.jax.selects import SIGNS

    assert set(SIGNS) <= set(OPERATIONS)
