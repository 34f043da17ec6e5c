"""Expressions, the forms that SymPy has for them, and the comparison of values."""

from __future__ import annotations

import math
from typing import Any

import pytest

import teg
from teg.ir import expr as ex
from teg.ir.expr import const
from teg.ir.simplify import call

sympy: Any = pytest.importorskip("sympy")

x, y, r, p = teg.vars("x y r p")
t, a, b = teg.params("t a b")
X, Y, T, A, B = (sympy.Symbol(name, real=True) for name in ["x", "y", "t", "a", "b"])
F, G = sympy.Heaviside, sympy.DiracDelta


def value(e: Any, **values: float) -> Any:
    return teg.evaluate(e, values)


def same(found: float, wanted: float, tolerance: float = 1e-13) -> bool:
    return found == wanted or (found != found and wanted != wanted) or abs(found - wanted) <= tolerance * max(abs(wanted), 1e-3)


SAME_NAME = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "floor", "erf", "erfc")
FORMS: list[tuple[Any, Any]] = [
    (ex.ONE, sympy.Integer(1)),
    (const(0.1), sympy.Float(0.1)),
    (const(math.inf), sympy.oo),
    (const(-math.inf), -sympy.oo),
    (const(math.nan), sympy.nan),
    (t, T),
    (x, X),
    (x + 2 * t, X + 2 * T),
    (x - t, X - T),
    (x * t**3 / a, X * T**3 / A),
    (x**t, X**T),
    (teg.sqrt(1 + t), sympy.sqrt(1 + T)),
    (call("root", t), sympy.sqrt(sympy.Abs(T))),
    (call("magnitude", t), sympy.Abs(T)),
    (call("min", t, a), sympy.Min(T, A)),
    (call("max", t, a), sympy.Max(T, A)),
    *(
        (getattr(teg, f)(t), getattr(sympy, f)(T))
        for f in ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "floor", "erf", "erfc"]
    ),
    (call("erfinv", t), sympy.erfinv(T)),
    (call("erfcinv", t), sympy.erfcinv(T)),
    (teg.log1p(t), sympy.log(1 + T)),
    (teg.expm1(t), sympy.exp(T) - 1),
    (call("ceil", t), sympy.ceiling(T)),
    (teg.atan2(t, a), sympy.atan2(T, A)),
    (teg.mod(t, a), sympy.Mod(T, A)),
    (teg.abs(t), sympy.Abs(T)),
    (teg.sign(t - a), sympy.sign(T - A)),
    (teg.minimum(t, a), sympy.Min(T, A)),
    (teg.maximum(t, a), sympy.Max(T, A)),
    (teg.bracket(x < t), F(T - X, 0)),
    (teg.bracket(x <= t), F(T - X, 1)),
    (teg.bracket(~(x < t)), F(X - T, 1)),
    (teg.bracket((x < t) & (x > a)) * x, X * F(T - X, 0) * F(X - A, 0)),
    (teg.bracket(x > 0) * teg.log(x), sympy.Piecewise((sympy.log(X), X > 0), (0, True))),
    (teg.bracket((x < t) | (x < a)), sympy.Piecewise((1, (X < T) | (X < A)), (0, True))),
    (teg.where(x < t, a, b), sympy.Piecewise((A, X < T), (B, True))),
    (teg.where(~((x < t) & (x < a)), a, b), sympy.Piecewise((B, (X < T) & (X < A)), (A, True))),
    (teg.integral(teg.bracket(x < t), (x, 0, a)), sympy.Integral(F(T - X, 0), (X, 0, A))),
    (teg.integral(x * y, (x, 0, y), (y, 0, 1)), sympy.Integral(X * Y, (X, 0, Y), (Y, 0, 1))),
    (teg.integral(teg.delta(x - t), (x, 0, 1)), sympy.Integral(G(X - T), (X, 0, 1))),
    (teg.tuple(t, a), sympy.Tuple(T, A)),
    (x < t, X < T),
    (x <= t, X <= T),
    ((x < t) & ~(x <= a), (X < T) & (X > A)),
    ((x < t) | (x < a), (X < T) | (X < A)),
    (ex.TRUE, sympy.true),
    (ex.FALSE, sympy.false),
]
