"""Names in programs: 'v…' is a number, 'b…' a condition, 'x…' a variable of integration, 'p…' a parameter, each with a number behind it.

Only this file knows what the letters mean.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count


def is_condition(arg: object) -> bool:
    """Returns whether an argument is the name of a condition."""
    return isinstance(arg, str) and arg.startswith("b")


def is_number(arg: object) -> bool:
    """Returns whether an argument is the name of a computed number: no parameter, variable or condition."""
    return isinstance(arg, str) and arg.startswith("v")


def is_parameter(arg: object) -> bool:
    """Returns whether an argument is the name of a parameter."""
    return isinstance(arg, str) and arg.startswith("p")


def parameter_number(name: str) -> int:
    """Returns the place of a parameter among those of its program."""
    return int(name[1:])


def parameter_numbers(args: Iterable[object]) -> list[int]:
    """Returns the places of the parameters among some arguments, ascending."""
    return sorted({parameter_number(a) for a in args if isinstance(a, str) and is_parameter(a)})


def of_kind(name: str, number: int) -> str:
    """Returns a name of the same kind with another number."""
    return f"{name[0]}{number}"


def unused_numbers(names: Iterable[str]) -> count[int]:
    """Returns the numbers behind the largest one in some names."""
    return count(1 + max((int(name[1:]) for name in names if name[1:].isdigit()), default=0))
