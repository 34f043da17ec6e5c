"""The operations of an `Assign`: the kinds of its operands and result, and its meaning on plain Python numbers.

    floats    const(x)  add(x, y, …)  sub(x, y)  mul(x, y, …)  div(x, y)  neg(x)  powi(x, n)  pow(x, y)  abs(x)  floor(x)  mod(x, y)
              sin cos tan asin acos atan sinh cosh tanh exp expm1 log log1p sqrt erf erfc (x)
              atan2(y, x)   select(b, x, y)   min(x, y)  max(x, y)
              call(k, x, …), function k of the program, an integer literal
    booleans  gt0 ge0 lt0 le0 (x)   ok(x)   and(b, …)  or(b, …)  not(b)   tie(g, scale, r, k)

Arithmetic is plain IEEE double, without contraction to fused multiply-add. `add` and `mul` associate to the left. `powi` has an integer
literal. `select` takes x where b holds and never lets the other value through. `ok(x)` is x == x: not NaN. `call` and `tie` need a program
to have a meaning, which they have in `teg.program.interpreter`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from teg.program.fields import Kind


class Operation(NamedTuple):
    """The kinds of the operands and of the result; the last operand may be `repeated`."""

    operands: tuple[Kind, ...]
    result: Kind
    meaning: Callable[..., float | bool] | None
    repeated: bool = False


def _where_it_exists(function: Callable[..., float], beyond: Callable[..., float]) -> Callable[..., float]:
    """Returns the function with the infinity or NaN of IEEE arithmetic where Python raises an error."""

    def meaning(*args: float) -> float:
        try:
            return function(*args)
        except (ValueError, OverflowError, ZeroDivisionError):
            return beyond(*args)

    return meaning


def total(*terms: float) -> float:
    """Returns the sum, from the left."""
    result = terms[0]
    for term in terms[1:]:
        result = result + term
    return result


def product(*factors: float) -> float:
    """Returns the product, from the left."""
    result = factors[0]
    for factor in factors[1:]:
        result = result * factor
    return result


def divide(x: float, y: float) -> float:
    """Returns x/y; an infinity or NaN where y is 0."""
    if y != 0.0:
        return x / y
    return math.nan if x == 0.0 or x != x else math.copysign(math.inf, x) * math.copysign(1.0, y)


def power(x: float, n: int) -> float:
    """Returns x to an integer power, by squaring; 1/power(x, -n) where n is negative."""
    if n < 0:
        return divide(1.0, power(x, -n))
    result = 1.0
    while n:
        if n & 1:
            result = result * x
        n >>= 1
        if n:
            x = x * x
    return result


def floor(x: float) -> float:
    """Returns the largest whole number that is not above x, with the sign of a 0."""
    return math.copysign(float(math.floor(x)), x) if math.isfinite(x) else x


def least(x: float, y: float) -> float:
    """Returns the smaller of two numbers, NaN if one is."""
    return x if x < y or x != x else y


def largest(x: float, y: float) -> float:
    """Returns the larger of two numbers, NaN if one is."""
    return x if x > y or x != x else y


def _infinite_power(x: float, y: float) -> float:
    """Returns xʸ where Python raises: a negative base and a broken exponent, 0 to a negative power, a number that is too large."""
    if x < 0.0 and y != math.floor(y):
        return math.nan
    return -math.inf if math.copysign(1.0, x) < 0.0 and y % 2.0 == 1.0 else math.inf


def _not_a_number(*args: float) -> float:
    return math.nan


_NUMBER: tuple[Kind, ...] = ("number",)
_CONDITION: tuple[Kind, ...] = ("condition",)


def _of_number(function: Callable[[float], float], beyond: Callable[..., float] = _not_a_number) -> Operation:
    return Operation(_NUMBER, "number", _where_it_exists(function, beyond))


def _of_two(function: Callable[[float, float], float], beyond: Callable[..., float] = _not_a_number) -> Operation:
    return Operation(_NUMBER * 2, "number", _where_it_exists(function, beyond))


OPERATIONS: dict[str, Operation] = {
    "const": _of_number(float),
    "add": Operation(_NUMBER, "number", total, repeated=True),
    "sub": _of_two(lambda x, y: x - y),
    "mul": Operation(_NUMBER, "number", product, repeated=True),
    "div": _of_two(divide),
    "neg": _of_number(lambda x: -x),
    "powi": Operation(("number", "integer"), "number", power),
    "pow": _of_two(math.pow, _infinite_power),
    "abs": _of_number(abs),
    "floor": _of_number(floor),
    "mod": _of_two(lambda x, y: x - y * floor(divide(x, y))),
    "sin": _of_number(math.sin),
    "cos": _of_number(math.cos),
    "tan": _of_number(math.tan),
    "asin": _of_number(math.asin),
    "acos": _of_number(math.acos),
    "atan": _of_number(math.atan),
    "sinh": _of_number(math.sinh, lambda x: math.copysign(math.inf, x)),
    "cosh": _of_number(math.cosh, lambda x: math.inf),
    "tanh": _of_number(math.tanh),
    "exp": _of_number(math.exp, lambda x: math.inf),
    "log": _of_number(math.log, lambda x: -math.inf if x == 0.0 else math.nan),
    "expm1": _of_number(math.expm1, lambda x: math.inf),
    "log1p": _of_number(math.log1p, lambda x: -math.inf if x == -1.0 else math.nan),
    "sqrt": _of_number(math.sqrt),
    "erf": _of_number(math.erf),
    "erfc": _of_number(math.erfc),
    "atan2": _of_two(math.atan2),
    "select": Operation(("condition", "number", "number"), "number", lambda b, x, y: x if b else y),
    "min": _of_two(least),
    "max": _of_two(largest),
    "call": Operation(("integer", "number"), "number", None, repeated=True),
    "gt0": Operation(_NUMBER, "condition", lambda x: x > 0.0),
    "ge0": Operation(_NUMBER, "condition", lambda x: x >= 0.0),
    "lt0": Operation(_NUMBER, "condition", lambda x: x < 0.0),
    "le0": Operation(_NUMBER, "condition", lambda x: x <= 0.0),
    "ok": Operation(_NUMBER, "condition", lambda x: x == x),
    "and": Operation(_CONDITION, "condition", lambda *b: all(b), repeated=True),
    "or": Operation(_CONDITION, "condition", lambda *b: any(b), repeated=True),
    "not": Operation(_CONDITION, "condition", lambda b: not b),
    "tie": Operation(("number", "number", "condition", "integer"), "condition", None),
}
"""By name."""

INTEGER_OPERATIONS: dict[str, Callable[[int, int], int]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "floordiv": lambda a, b: a // b,
    "mod": lambda a, b: a % b,
    "min": min,
    "max": max,
}
"""Operations of two integers in programs with arrays; gather, length and param read what is given."""


def letter_of(op: str) -> str:
    """Returns the first letter of names for the results of an operation (`teg.program.names`)."""
    return "b" if OPERATIONS[op].result == "condition" else "v"
