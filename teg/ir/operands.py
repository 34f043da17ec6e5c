"""Values that users give as numbers and conditions, and the operators on them.

Operators simplify, but do not drop operands: `t - t` still has the parameter t, because it is an argument of the program.
"""

from __future__ import annotations

from collections.abc import Callable
from numbers import Real
from typing import Any, cast

from teg.errors import ConditionError, OperandError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Cond, Const, Expr, Mul, Pow, Tuple, const
from teg.ir.node import Node
from teg.ir.simplify import add, div, positive, power, sub, tuple_of


def as_number(value: object) -> Expr:
    """Returns the expression for a value that a user gives as a number."""
    if isinstance(value, Expr):
        if isinstance(value, Tuple):
            raise OperandError("a tuple stands where one number is expected", value, "use its entries: e[0], e[1], …")
        return value
    if isinstance(value, Cond):
        value._is_no_number()
    if isinstance(value, Node) and hasattr(value, "_as_expression"):  # an index, a node of a later module
        return cast(Expr, value._as_expression())
    if isinstance(value, bool):
        raise ConditionError(
            f"{value} is a Python truth value, not an expression",
            None,
            "== compares by identity; write conditions with < <= > >=",
        )
    if isinstance(value, Real) or (hasattr(value, "__float__") and getattr(value, "ndim", None) == 0):
        try:
            return const(float(cast(Any, value)))
        except OverflowError:
            raise OperandError("a number is too large for floating point", None, "divide it out: the largest is about 1.8e308") from None
        except TypeError:  # a tracer of JAX
            hint = 'what is known only in a call is a parameter: teg.param("t"), and a function of JAX by teg.jax_function'
            raise OperandError(f"{type(value).__name__} has no value while the program is being written", None, hint) from None
    if isinstance(value, tuple | list):
        kind = type(value).__name__
        raise OperandError(
            f"a Python {kind} is not an expression: {value!r:.80}", None, "several expressions are one by teg.tuple(e1, e2, …)"
        )
    raise OperandError(f"{type(value).__name__} is not a number or an expression: {value!r:.80}", None, _instead_of(value))


def _instead_of(value: object) -> str:
    """Returns the hint for a value that is no number."""
    if value is None:
        return "a bound without an end is math.inf or -math.inf; a function of Python without a return gives None"
    if hasattr(value, "expression"):
        return "it is compiled: f.expression is its expression"
    if callable(value):
        return "call it with its arguments: what it returns may be an expression"
    return "build programs from numbers, teg.param, teg.var; arrays of values are given when the compiled function is called"


def refuse_list(value: object, what: str, instead: str) -> None:
    """Raises OperandError for a list, which functions of Python with such names take."""
    if isinstance(value, tuple | list):
        hint = f"{instead}; teg.{what}(V[k], (k, 0, n)) runs over an index"
        raise OperandError(f"teg.{what} takes one expression and the range of an index, not a Python {type(value).__name__}", None, hint)


def as_program(value: object) -> Node:
    """Returns the expression or condition for a value that a user gives as either."""
    return value if isinstance(value, Node) else as_number(value)


def entrywise(build: Callable[..., Expr], *operands: object) -> Expr:
    """Returns the result of an operation on numbers; on tuples, entry by entry. A number goes with every entry of a tuple.

    Raises OperandError for tuples of different lengths.
    """
    tuples = [operand for operand in operands if isinstance(operand, Tuple)]
    if not tuples:
        return build(*map(as_number, operands))
    if len({len(operand) for operand in tuples}) > 1:
        lengths = " and ".join(str(len(operand)) for operand in tuples)
        raise OperandError(f"tuples of {lengths} entries do not go together", tuples[0], "an operation on tuples is entry by entry")
    columns = (operand.children if isinstance(operand, Tuple) else (operand,) * len(tuples[0]) for operand in operands)
    return tuple_of(*(entrywise(build, *row) for row in zip(*columns, strict=True)))


def as_condition(value: object) -> Cond:
    """Returns the condition for a value that a user gives as one. Raises ConditionError, which says what to write instead."""
    if isinstance(value, Cond):
        return value
    if isinstance(value, bool):
        raise ConditionError(
            f"{value} is a Python truth value, not a condition of the program",
            None,
            "== compares expressions by identity; conditions are written with < <= > >= on variables and parameters",
        )
    raise ConditionError(
        "a condition was expected",
        value,
        "write a comparison such as x < t; teg.bracket(condition) turns one into 0 or 1",
    )


def binary(a: object, b: object, build: Callable[[Expr, Expr], Expr]) -> Expr:
    """Returns the result of a user's operator: simplified, but never to a number that lacks the operands; of tuples entry by entry."""
    if isinstance(a, Tuple) or isinstance(b, Tuple):
        return entrywise(lambda left, right: binary(left, right, build), a, b)
    left, right = as_number(a), as_number(b)
    result = build(left, right)
    constants = isinstance(left, Const) and isinstance(right, Const)
    if not constants and (isinstance(result, Const) or _is_nothing(left) or _is_nothing(right)):
        return _as_written(left, right, build)
    return result


def _is_nothing(e: Expr) -> bool:
    return isinstance(e, Mul) and e.children[0] is ZERO


def _as_written(a: Expr, b: Expr, build: Callable[[Expr, Expr], Expr]) -> Expr:
    """Returns the plain node of an operation that simplification would drop. Its parameters remain arguments of the program."""
    if build is power:
        return Add.make(None, (ONE, Mul.make(None, (ZERO, a)))) if b is ZERO else build(a, b)
    if build is sub:
        return Add.make(None, (a, Mul.make(None, (MINUS_ONE, b))))
    if build is div:
        return Mul.make(None, (a, Pow.make(-1, (b,))))
    return (Add if build is add else Mul).make(None, (a, b))


def less(a: object, b: object, strict: bool) -> Cond:
    """Returns a < b, or a <= b."""
    if isinstance(a, Tuple) or isinstance(b, Tuple):
        hint = "compare their entries: (e[0] < a) & (e[1] < b)"
        raise ConditionError("tuples are not compared", a if isinstance(a, Tuple) else b, hint)
    if isinstance(a, Cond) or isinstance(b, Cond):
        raise ConditionError(
            "a condition cannot be compared",
            a if isinstance(a, Cond) else b,
            "write (a < x) & (x < b) for a < x < b",
        )
    g = as_number(b) - as_number(a)
    return positive(g, strict)
