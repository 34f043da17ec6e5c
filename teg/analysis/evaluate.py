"""Numerical values of expressions, computed from the tree. Used for checks at sample points; programs are compiled."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Mapping, Sequence
from typing import Any

from teg.errors import OperandError
from teg.ir.expr import FUNCTIONS, Add, And, Call, Compare, Const, Expr, Mul, Not, Or, Pow, Truth, Where, const
from teg.ir.node import Node, postorder
from teg.ir.traverse import parameters


def values_of(expressions: Sequence[Expr], at: Mapping[Any, Any]) -> list[Any]:
    """Returns the values of expressions as float64 arrays that broadcast together, at given values of their parameters and variables.

    NaN and infinities are valid results. Raises OperandError for a node that has no value at a point: an integral, a delta, a
    tuple, a function of the user's.
    """
    import numpy as np

    known: dict[Any, Any] = dict(at)
    with np.errstate(all="ignore"):
        for node in postorder(expressions):
            if node not in known:
                known[node] = _value(node, [known[c] for c in node.children], np)
    return [known[e] for e in expressions]


def folded(e: Expr) -> Expr:
    """Returns the value of an expression without parameters and variables as a number; ±∞ and NaN are possible."""
    if isinstance(e, Const) or e.free or e.has_integral or parameters(e):
        return e
    return const(float(values_of([e], {})[0]))


def _value(node: Node, parts: list[Any], np: Any) -> Any:
    match node:
        case Const() | Truth():
            return np.asarray(node.data)
        case Add():
            return sum(parts[1:], start=parts[0])
        case Mul():
            return math.prod(parts[1:], start=parts[0])
        case Pow():
            return np.power(parts[0], float(node.exponent))
        case Call():
            if node.name == "mod":
                return parts[0] - parts[1] * np.floor(parts[0] / parts[1])
            if node.name == "root":
                return np.sqrt(np.abs(parts[0]))
            if node.name in ("erf", "erfc"):
                return np.vectorize(FUNCTIONS[node.name], otypes=[float])(*parts)
            if node.name in ("erfinv", "erfcinv"):
                least, most = (-1.0, 1.0) if node.name == "erfinv" else (0.0, 2.0)
                inside = (parts[0] > least) & (parts[0] < most)
                return np.where(inside, np.vectorize(FUNCTIONS[node.name], otypes=[float])(np.where(inside, parts[0], 0.5)), np.nan)
            function = getattr(np, _NAMES.get(node.name, node.name), None)
            if function is None:
                raise OperandError(f"{node.name} has no value at a point", node)
            return function(*parts)
        case Where():
            return np.where(*parts)
        case Compare():
            return parts[0] > 0.0 if node.strict else parts[0] >= 0.0
        case Not():
            return np.logical_not(parts[0])  # `~` makes -2 of True
        case And():
            return functools.reduce(operator.and_, parts)
        case Or():
            return functools.reduce(operator.or_, parts)
        case _:
            raise OperandError(f"{type(node).__name__} has no value at a point", node)


_NAMES = {
    "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "pow": "power", "magnitude": "abs", "min": "minimum",
    "max": "maximum", "chosen": "positive", "exact": "positive",
}  # fmt: skip
