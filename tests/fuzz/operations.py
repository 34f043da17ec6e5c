"""The operations of a tree, in 80-bit floating point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.fuzz.syntax import Term

Real = np.longdouble
Array = Any


def result_of(node: Term, v: Sequence[Array]) -> Array:
    match node.op:
        case "+":
            return v[0] + v[1]
        case "-":
            return v[0] - v[1]
        case "*":
            return v[0] * v[1]
        case "/":
            return v[0] / v[1]
        case "neg":
            return -v[0]
        case "abs":
            return np.abs(v[0])
        case "pow":
            exponent = node.parts[1]
            if exponent.op == "number" and exponent.data == int(exponent.data) and 0 <= exponent.data <= 4:
                return _small_power(v[0], int(exponent.data))
            return v[0] ** v[1]
        case "<":
            return v[0] < v[1]
        case "<=":
            return v[0] <= v[1]
        case ">":
            return v[0] > v[1]
        case ">=":
            return v[0] >= v[1]
        case "and":
            return v[0] & v[1]
        case "or":
            return v[0] | v[1]
        case "not":
            return ~v[0]
        case "min":
            return np.minimum(v[0], v[1])
        case "max":
            return np.maximum(v[0], v[1])
        case "bracket":
            return v[0].astype(Real)
        case "call":
            return _call(node.data, v)
    raise ValueError(node.op)


def _small_power(u: Array, n: int) -> Array:
    result = np.ones_like(u)
    for _ in range(n):
        result = result * u
    return result


def _call(name: str, v: Sequence[Array]) -> Array:
    match name:
        case "asin" | "acos" | "atan":
            return getattr(np, "arc" + name[1:])(v[0])
        case "atan2":
            return np.arctan2(v[0], v[1])
        case "mod":
            return v[0] - v[1] * np.floor(v[0] / v[1])
        case "round":
            return np.floor(v[0] + Real(0.5))
    return getattr(np, name)(v[0])
