"""An integrand as a C function that SciPy calls without Python (`scipy.LowLevelCallable`), from the same definition as all others.

The body of a problem is run once with a notation whose numbers write a statement of C for each operation. Parameters, the number of
evaluations and their limit are in an array that is passed along; beyond the limit the function returns NaN, which ends QUADPACK's search.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from teg.examples.charts.problem import Problem

COUNT, LIMIT, FIRST = 0, 1, 2
"""The places of the number of evaluations, its limit, and the first parameter in the array."""


class Text:
    """A number or a condition of the C function, by the name of the variable that holds it."""

    def __init__(self, lines: list[str], value: str, kind: str = "double") -> None:
        self.lines = lines
        self.name = f"t{len(lines)}"
        lines.append(f"const {kind} {self.name} = {value};")

    def _with(self, template: str, *others: Any, kind: str = "double") -> Text:
        return Text(self.lines, template.format(self.name, *(_name(o) for o in others)), kind)

    def __add__(self, other: Any) -> Text:
        return self._with("{} + {}", other)

    def __sub__(self, other: Any) -> Text:
        return self._with("{} - {}", other)

    def __rsub__(self, other: Any) -> Text:
        return self._with("{1} - {0}", other)

    def __mul__(self, other: Any) -> Text:
        return self._with("{} * {}", other)

    def __truediv__(self, other: Any) -> Text:
        return self._with("{} / {}", other)

    def __rtruediv__(self, other: Any) -> Text:
        return self._with("{1} / {0}", other)

    def __pow__(self, power: Any) -> Text:
        return self._with("pow({}, {})", power)

    def __neg__(self) -> Text:
        return self._with("-{}")

    def __lt__(self, other: Any) -> Text:
        return self._with("{} < {}", other, kind="int")

    def __le__(self, other: Any) -> Text:
        return self._with("{} <= {}", other, kind="int")

    def __gt__(self, other: Any) -> Text:
        return self._with("{} > {}", other, kind="int")

    def __ge__(self, other: Any) -> Text:
        return self._with("{} >= {}", other, kind="int")

    def __and__(self, other: Any) -> Text:
        return self._with("{} && {}", other, kind="int")

    def __or__(self, other: Any) -> Text:
        return self._with("{} || {}", other, kind="int")

    def __invert__(self) -> Text:
        return self._with("!{}", kind="int")

    __radd__, __rmul__ = __add__, __mul__


def _name(value: Any) -> str:
    return value.name if isinstance(value, Text) else f"({float(value)!r})"


def _notation(lines: list[str]) -> SimpleNamespace:
    """Returns the functions of the language, which write into these lines."""

    def written(template: str) -> Any:
        return lambda *values: Text(lines, template.format(*map(_name, values)))

    names = {"abs": "fabs", "minimum": "fmin", "maximum": "fmax"}
    plain = {name: written(f"{names.get(name, name)}({{}})") for name in ("sin", "cos", "exp", "log", "sqrt", "atan", "floor", "abs")}
    pairs = {name: written(f"{names[name]}({{}}, {{}})") for name in ("minimum", "maximum")}
    return SimpleNamespace(**plain, **pairs, where=written("{} ? {} : {}"), bracket=written("{} ? 1.0 : 0.0"))


def c_text(problem: Problem) -> str:
    """Returns the C function `f(n, x, data)` of a problem, the innermost variable first."""
    lines: list[str] = []
    variables = [Text(lines, f"x[{i}]") for i in range(problem.dimension)]
    parameters = {name: Text(lines, f"data[{FIRST + i}]") for i, name in enumerate(problem.parameters)}
    result = _name(problem.body(_notation(lines), *variables, **parameters))
    body = "\n    ".join(lines)
    return f"""#include <math.h>
double f(int n, double *x, double *data)
{{
    data[{COUNT}] += 1;
    if (data[{COUNT}] > data[{LIMIT}]) return NAN;
    {body}
    return {result};
}}
"""


@cache
def _function(text: str) -> Any:
    from teg.backends.c.build import load_library

    function = load_library(text).f
    function.restype, function.argtypes = ctypes.c_double, (ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    return function


class CIntegrand:
    """A problem as a C function with values of its parameters. `callback` is for SciPy; `evaluations` are counted."""

    def __init__(self, problem: Problem, parameters: Mapping[str, float], most: float) -> None:
        from scipy import LowLevelCallable

        self._data = np.array([0.0, most, *parameters.values()])
        pointer = ctypes.cast(self._data.ctypes.data, ctypes.c_void_p)
        self.callback = LowLevelCallable(_function(c_text(problem)), pointer, "double (int, double *, void *)")

    @property
    def evaluations(self) -> int:
        return int(min(self._data[COUNT], self._data[LIMIT]))

    @property
    def is_stopped(self) -> bool:
        """Returns whether the limit was passed."""
        return bool(self._data[COUNT] > self._data[LIMIT])
