"""One operation as a line of Python, for NumPy (`np.sin`) and JAX (`jnp.sin`) alike.

Names stand for arrays or array scalars, whose arithmetic is IEEE's. An operation on literals alone would be
Python's own, which raises where IEEE has inf or NaN; there the first is wrapped: `np.float64(1.0) / 0.0`.

XLA fuses a product and a sum into one rounding, and has no switch against it. So JAX prints products as
`x * y + zero`, where `zero` is -0.0 at run time and unknown to the compiler: that sum takes the fusion and
changes no value, and the one that follows is plain.

XLA also multiplies by reciprocals, of square roots and of divisors that are the same for all elements, and joins quotients of quotients.
Roots of one curve by two formulas would then differ by more than rounding, with a piece between them on which nothing is known. JAX prints
`rt.quotient(x, y, zero)` instead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from teg.program import Arg, Assign

OPERANDS = 16
"""Operands a printed expression may have: Python's own parser recurses over them."""

PLAIN = "{first} / {second}"
_INFIX = {"add": " + ", "sub": " - ", "mul": " * ", "and": " & ", "or": " | "}
_ASSOCIATIVE = ("add", "mul", "and", "or")
_COMPARE = {"gt0": ">", "ge0": ">=", "lt0": "<", "le0": "<="}
_RENAMED = {
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "atan2": "arctan2",
    "pow": "power",
    "select": "where",
    "min": "minimum",
    "max": "maximum",
    "lower": "minimum",
    "upper": "maximum",
}


@dataclass(frozen=True, slots=True)
class Dialect:
    """A module of array functions, and the term that is added to a product to keep it from being fused with a sum."""

    module: str
    guard: str = ""
    call: str = ""
    """How the result of function k at arguments is written."""
    quotient: str = PLAIN
    """How a quotient is written."""


def assignment(stmt: Assign, dialect: Dialect) -> list[str]:
    """Returns the lines of a statement; an operation on many operands takes several, from the left."""
    cut = OPERANDS if stmt.op in _ASSOCIATIVE else len(stmt.args)
    lines = [f"{stmt.name} = {operation(stmt.op, stmt.args[:cut], dialect)}"]
    for i in range(cut, len(stmt.args), OPERANDS):
        more = (stmt.name, *stmt.args[i : i + OPERANDS])
        lines.append(f"{stmt.name} = {operation(stmt.op, more, dialect)}")
    return lines


def operation(op: str, args: tuple[Arg, ...], dialect: Dialect) -> str:
    """Returns the right-hand side of any operation but `tie`, in a dialect."""
    module, guard = dialect.module, dialect.guard
    values = [value(arg, module) for arg in args]
    first = strict(args[0], module)
    match op:
        case "div":
            return dialect.quotient.format(first=first, second=values[1])
        case "const" | "add" | "sub" | "mul" | "and" | "or":
            if not any(isinstance(arg, str) for arg in args):
                values[0] = first
            return _INFIX.get(op, "").join(values) + (guard if op == "mul" else "")
        case "gt0" | "ge0" | "lt0" | "le0":
            return f"{first} {_COMPARE[op]} 0.0"
        case "neg":
            return f"-{first}"
        case "not":
            return f"~{first}"
        case "ok":
            return f"{first} == {first}"
        case "mod":
            product = f"{values[1]} * {module}.floor({first} / {values[1]})"
            return f"{first} - ({product}{guard})" if guard else f"{first} - {product}"
        case "powi":
            power = args[1]
            if isinstance(power, int) and 0 < power < 4:
                return " * ".join([first] * power) + guard
            return f"rt.powi({first}, {power}){guard}"
        case "erf" | "erfc":
            return f"rt.{op}({first})"
        case "call":
            return dialect.call.format(k=args[0], arguments=", ".join(strict(arg, module) for arg in args[1:]))
        case _:
            return f"{module}.{_RENAMED.get(op, op)}({', '.join(values)})"


def value(arg: Arg, module: str) -> str:
    """Returns a name, or a literal as Python writes it."""
    if isinstance(arg, float) and not math.isfinite(arg):
        return f"{module}.nan" if math.isnan(arg) else f"{module}.inf" if arg > 0 else f"-{module}.inf"
    return arg if isinstance(arg, str) else repr(arg)


def strict(arg: Arg, module: str) -> str:
    """Returns a name, or a literal as an array scalar."""
    if isinstance(arg, str):
        return arg
    return f"{module}.{'bool_' if isinstance(arg, bool) else 'float64'}({value(arg, module)})"


def inside(items: Iterable[str]) -> str:
    """Returns the inside of a tuple display: a single item keeps its comma."""
    listed = list(items)
    return listed[0] + "," if len(listed) == 1 else ", ".join(listed)
