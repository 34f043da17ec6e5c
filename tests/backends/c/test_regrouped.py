"""The straight line with more of it the same at all points: fewer operations that differ, and the same numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from teg.backends.c.crossed import Crossed
from teg.backends.c.items import Item, Nodes
from teg.backends.c.regrouped import alike, regrouped
from teg.program import Arg, Assign, Program
from teg.program.interpreter import interpret

SAME, DIFFERING = ["p0", "p1"], ["p2", "p3"]


def positive(name: str, arg: Arg) -> Assign:
    """Whether a number is positive."""
    return Assign(name, "gt0", (arg,))


CONDITIONS = [positive("b0", "p0"), positive("b1", "p1"), positive("b2", "p2"), positive("b3", "p3")]
LINES: dict[str, tuple[list[Assign], Arg]] = {
    "a conjunction": (
        [*CONDITIONS, Assign("b4", "and", ("b2", "b0")), Assign("b5", "and", ("b4", "b3")), Assign("b6", "and", ("b5", "b1"))],
        "b6",
    ),
    "a disjunction in it": ([*CONDITIONS, Assign("b4", "or", ("b2", "b0", "b1")), Assign("b5", "and", ("b4", "b3"))], "b5"),
    "a maximum": ([Assign("v0", "upper", ("p0", "p2")), positive("b0", "v0")], "b0"),
    "a lower bound": ([positive("b0", "p0"), Assign("v0", "upper", ("p2", "p3")), Assign("v1", "select", ("b0", "v0", "p2"))], "v1"),
    "no lower bound": ([positive("b0", "p0"), Assign("v0", "upper", ("p2", "p3")), Assign("v1", "select", ("b0", "p2", "v0"))], "v1"),
    "an upper bound": ([positive("b0", "p0"), Assign("v0", "lower", ("p2", "p3")), Assign("v1", "select", ("b0", "v0", "p2"))], "v1"),
    "no upper bound": ([positive("b0", "p0"), Assign("v0", "lower", ("p2", "p3")), Assign("v1", "select", ("b0", "p2", "v0"))], "v1"),
}


def result(items: Sequence[Item], output: Arg, numbers: Sequence[float]) -> float:
    """The output of a line at one point; `lower` and `upper` are minimum and maximum where nothing is NaN."""
    plain = {"lower": "min", "upper": "max"}
    body = [Assign(i.name, plain.get(i.op, i.op), i.args) for i in items if isinstance(i, Assign)]
    if isinstance(output, str) and output.startswith("b"):
        body.append(Assign("v99", "select", (output, 1.0, 0.0)))
        output = "v99"
    return interpret(Program((*SAME, *DIFFERING), tuple(body), (output,)), list(numbers)).outputs[0]


@pytest.mark.parametrize("name", LINES)
def test_the_numbers_are_the_same(name: str) -> None:
    items, output = LINES[name]
    made = regrouped(Crossed(tuple(items), (output,), True), {2, 3})
    for numbers in np.random.default_rng(3).standard_normal((40, 4)):
        assert result(made.items, output, list(numbers)) == result(items, output, list(numbers))


def differing(items: Sequence[Item]) -> list[str]:
    """The operations that are not the same at all points."""
    names, ops = set(DIFFERING), []
    for item in items:
        assert isinstance(item, Assign)
        if not names.isdisjoint(map(str, item.args)):
            names.add(item.name)
            ops.append(item.op)
    return ops


@pytest.mark.parametrize(
    ("name", "ops"),
    [
        ("a conjunction", ["gt0", "gt0", "and"]),
        ("a disjunction in it", ["gt0", "gt0", "or", "and"]),
        ("a maximum", ["gt0", "or"]),
        ("a lower bound", ["add", "upper"]),
        ("no upper bound", ["add", "lower"]),
    ],
)
def test_less_differs_between_points(name: str, ops: list[str]) -> None:
    items, output = LINES[name]
    assert sorted(differing(regrouped(Crossed(tuple(items), (output,), True), {2, 3}).items)) == sorted(ops)


def test_a_selection_by_a_condition_that_differs_stays() -> None:
    items = [positive("b0", "p2"), Assign("v0", "upper", ("p0", "p3")), Assign("v1", "select", ("b0", "v0", "p0"))]
    assert list(regrouped(Crossed(tuple(items), ("v1",), True), {2, 3}).items) == items


def test_conditions_are_joined_before_sums_over_nodes() -> None:
    """Two conditions that are known before the sum are one there; the third one is not known yet."""
    nodes = Nodes({"v9": (0.5,)}, (1.0,), (Assign("v8", "mul", ("v9", "p2")),), ("v8",), ("v7",))
    items = [positive("b0", "p2"), positive("b1", "p3"), nodes, positive("b2", "v7"), Assign("b3", "and", ("b0", "b2", "b1"))]
    made = regrouped(Crossed(tuple(items), (), "b3"), {2, 3}).items
    (first, last) = (i for i in made if isinstance(i, Assign) and i.op == "and")
    assert first.args == ("b0", "b1")
    assert last.args == (first.name, "b2")


def test_lines_share_what_is_the_same_at_all_points() -> None:
    """Values that are computed alike have one name, whatever they are called in each line; 0 and -0 are two numbers."""
    one = (Assign("v0", "mul", ("p0", 0.0)), Assign("v1", "add", ("v0", "p2")))
    other = (Assign("v5", "mul", ("p0", -0.0)), Assign("v6", "mul", ("p0", 0.0)), Assign("v7", "add", ("v6", "v5", "p3")))
    first, second = alike([Crossed(one, ("v1",), True), Crossed(other, ("v7",), True)], {2, 3})
    same = {i.name for line in (first, second) for i in line.items if isinstance(i, Assign) and i.op == "mul"}
    assert len(same) == 2
    assert first.items[0] in second.items
    for line, items, output in ((first, one, "v1"), (second, other, "v7")):
        numbers = [0.5, 1.0, -2.0, 3.0]
        assert result(line.items, line.outputs[0], numbers) == result(items, output, numbers)
