"""A formula as a user writes it, read as an expression."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from typing import Any

import teg
from teg.errors import InputError
from teg.ir.expr import Expr

FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "atan", "abs", "minimum", "maximum")
OPERATORS: dict[type, Any] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
    ast.USub: lambda a: -a,
    ast.UAdd: lambda a: a,
}


def read_formula(text: str, names: Mapping[str, Expr], what: str, example: str) -> Expr:
    """Returns a formula such as "0.2*sin(3*x) + 0.5*t" as an expression: numbers, pi, the `names`, + - * / ** and FUNCTIONS.

    Raises InputError for anything else, which says `what` the formula is, and gives an `example`.
    """
    known = {**names, "pi": math.pi}

    def read(node: ast.AST) -> Any:
        match node:
            case ast.Constant(value=int() | float()) if not isinstance(node.value, bool):
                return node.value
            case ast.Name(id=name) if name in known:
                return known[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                return OPERATORS[type(op)](*_decimal(read(left), read(right)))
            case ast.UnaryOp(op=op, operand=operand) if type(op) in OPERATORS:
                return OPERATORS[type(op)](read(operand))
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
                return getattr(teg, name)(*map(read, arguments))
            case _:
                hint = f"numbers, {', '.join(known)}, + - * / ** and " + ", ".join(FUNCTIONS)
                raise InputError(f"{what} {text!r} has {ast.unparse(node)!r}, which is not understood", None, hint)

    try:
        formula: Expr = read(ast.parse(text, mode="eval").body) + sum(0 * name for name in names.values())
    except (SyntaxError, TypeError, ZeroDivisionError, OverflowError, RecursionError, ValueError) as problem:
        if isinstance(problem, InputError):
            raise
        raise InputError(f"{what} {text!r} is not a formula of {' and '.join(names)}", None, f"as in {example!r} ({problem})") from None
    return formula


def _decimal(a: Any, b: Any) -> tuple[Any, Any]:
    """Returns two numbers as floats, so that 9**9**9 is an overflow and not a long calculation; leaves expressions."""
    numbers = isinstance(a, int | float) and isinstance(b, int | float)
    return (float(a), float(b)) if numbers else (a, b)
