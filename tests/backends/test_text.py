"""Operations as lines of Python: literals, chains from the left, and powers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from teg.backends.text import Dialect, assignment, inside, operation, strict, value
from teg.program import Arg, Assign
from teg.program.operations import OPERATIONS

NUMPY = Dialect("np")


def run(op: str, *args: Arg, **names: float) -> float:
    """The result of one operation as NumPy runs it."""
    scope = {"np": np, **{name: np.float64(v) for name, v in names.items()}}
    exec("\n".join(assignment(Assign("v0", op, args), NUMPY)), scope)
    return float(scope["v0"])


@pytest.mark.parametrize("number", [0.1, -2.5, 1e-300, math.inf, -math.inf])
def test_literals_are_read_back(number: float) -> None:
    assert eval(value(number, "np"), {"np": np}) == number
    assert eval(strict(number, "np"), {"np": np}) == number


def test_nan_is_a_literal_too() -> None:
    assert math.isnan(eval(value(math.nan, "np"), {"np": np}))


@pytest.mark.parametrize(
    ("op", "args"), [("add", (0.1, "a", "b")), ("mul", ("a", "b", 3.0)), ("sub", ("a", "b")), ("atan2", ("a", "b")), ("div", (1.0, "a"))]
)
def test_arithmetic_has_the_meaning_of_the_operation(op: str, args: tuple[Arg, ...]) -> None:
    names = {"a": 0.7, "b": -1.3}
    meaning = OPERATIONS[op].meaning
    assert meaning is not None
    assert run(op, *args, **names) == meaning(*(names[a] if isinstance(a, str) else a for a in args))


def test_a_long_sum_takes_several_lines_from_the_left() -> None:
    lines = assignment(Assign("v0", "add", tuple(f"a{k}" for k in range(200))), NUMPY)
    assert len(lines) > 1
    names = {f"a{k}": 10.0 ** (k % 17) for k in range(200)}
    total = 0.0
    for k in range(200):
        total = total + names[f"a{k}"]
    assert run("add", *names, **names) == total


def test_a_single_item_keeps_its_comma() -> None:
    assert inside(["a"]) == "a,"
    assert inside(["a", "b"]) == "a, b"


def test_selections_are_of_the_module() -> None:
    assert operation("select", ("b0", "v1", 0.0), NUMPY).startswith("np.where(")
