"""The functions of numbers in programs. On tuples they work entry by entry, and indices of sums stay indices."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import cast

from teg.errors import OperandError
from teg.ir import expr as ex
from teg.ir import operands, simplify
from teg.ir.expr import Cond, Expr, Operand, Tuple
from teg.ir.index import Index, as_index, index_call
from teg.ir.operands import as_number, entrywise


def sin(u: Operand) -> Expr:
    """Returns the sine of u, in radians.

    teg.evaluate(teg.sin(math.pi * t), t=0.5)           # 1.0
    """
    return _applied("sin", u)


def cos(u: Operand) -> Expr:
    """Returns the cosine of u, in radians.

    teg.evaluate(teg.cos(math.pi * t), t=1.0)           # -1.0
    """
    return _applied("cos", u)


def tan(u: Operand) -> Expr:
    """Returns the tangent of u, in radians.

    teg.evaluate(teg.tan(math.pi * t), t=0.25)          # 1.0
    """
    return _applied("tan", u)


def asin(u: Operand) -> Expr:
    """Returns the inverse sine, in [-π/2, π/2]; NaN for |u| > 1.

    teg.evaluate(teg.asin(t), t=1.0)                    # 1.5707963267948966
    """
    return _applied("asin", u)


def acos(u: Operand) -> Expr:
    """Returns the inverse cosine, in [0, π]; NaN for |u| > 1.

    teg.evaluate(teg.acos(t), t=-1.0)                   # 3.141592653589793
    """
    return _applied("acos", u)


def atan(u: Operand) -> Expr:
    """Returns the inverse tangent, in (-π/2, π/2).

    teg.evaluate(teg.atan(t), t=1.0)                    # 0.7853981633974483
    """
    return _applied("atan", u)


def atan2(y: Operand, x: Operand) -> Expr:
    """Returns the angle of the point (x, y), in (-π, π].

    teg.evaluate(teg.atan2(t, a), t=1.0, a=0.0)         # 1.5707963267948966
    """
    return _applied("atan2", y, x)


def sinh(u: Operand) -> Expr:
    """Returns the hyperbolic sine.

    teg.evaluate(teg.sinh(t), t=1.0)                    # 1.1752011936438014
    """
    return _applied("sinh", u)


def cosh(u: Operand) -> Expr:
    """Returns the hyperbolic cosine.

    teg.evaluate(teg.cosh(t), t=0.0)                    # 1.0
    """
    return _applied("cosh", u)


def tanh(u: Operand) -> Expr:
    """Returns the hyperbolic tangent.

    teg.evaluate(teg.tanh(t), t=0.0)                    # 0.0
    """
    return _applied("tanh", u)


def exp(u: Operand) -> Expr:
    """Returns the exponential.

    teg.evaluate(teg.exp(a * t), t=0.0, a=2.0)          # 1.0
    """
    return _applied("exp", u)


def expm1(u: Operand) -> Expr:
    """Returns exp(u) - 1, accurate also where u is small.

    teg.evaluate(teg.expm1(t), t=1e-20)                 # 1e-20
    """
    return _applied("expm1", u)


def log(u: Operand) -> Expr:
    """Returns the natural logarithm; -inf for 0, NaN for u < 0.

    teg.evaluate(teg.log(t), t=1.0)                     # 0.0
    """
    return _applied("log", u)


def log1p(u: Operand) -> Expr:
    """Returns log(1 + u), accurate also where u is small; NaN for u < -1.

    teg.evaluate(teg.log1p(t), t=1e-20)                 # 1e-20
    """
    return _applied("log1p", u)


def erf(u: Operand) -> Expr:
    """Returns the error function, 2/√π·∫ exp(-s²) ds over (0, u).

    The distribution function of a normal number of mean m and deviation s is 1/2·erfc((m - x)/(s·√2)):

        x, m, s = teg.params("x m s")
        normal = 0.5 * teg.erfc((m - x) / (s * 2**0.5))
        teg.evaluate(normal, x=1.0, m=1.0, s=2.0)           # 0.5
    """
    return _applied("erf", u)


def erfc(u: Operand) -> Expr:
    """Returns 1 - erf(u), accurate also where erf(u) is nearly 1.

    teg.evaluate(teg.erfc(t), t=10.0)                   # 2.088487583762545e-45
    """
    return _applied("erfc", u)


def sqrt(u: Operand) -> Expr:
    """Returns the square root; NaN for u < 0.

    teg.evaluate(teg.sqrt(t), t=2.25)                   # 1.5
    """
    return _applied("sqrt", u)


def floor(u: Operand) -> Expr:
    """Returns the largest integer not above u.

    teg.evaluate(teg.floor(t), t=-0.5)                  # -1.0
    """
    return _applied("floor", u)


def ceil(u: Operand) -> Expr:
    """Returns the smallest integer not below u.

    teg.evaluate(teg.ceil(t), t=1.25)                   # 2.0
    """
    return _applied("ceil", u)


def round_(u: Operand) -> Expr:
    """Returns the nearest integer.

    A half goes to the even side, as in Python and NumPy. If u has variables of integration a half goes up, which changes no integral.

        teg.evaluate(teg.round(t), t=2.5)                   # 2.0
    """
    return _applied("round", u)


def mod(u: Operand, period: Operand) -> Expr:
    """Returns u - period·floor(u/period). It has the sign of the period, as in Python.

    teg.evaluate(teg.mod(t, 1), t=-0.25)                # 0.75
    """
    return _applied("mod", u, period)


def abs_(u: Operand) -> Expr:
    """Returns |u|.

    teg.evaluate(teg.abs(t), t=-2.0)                    # 2.0
    """
    return entrywise(simplify.absolute, u)


def sign(u: Operand) -> Expr:
    """Returns -1, 0 or 1.

    teg.evaluate(teg.sign(t), t=-2.0)                   # -1.0
    """
    return entrywise(
        lambda v: simplify.where(simplify.positive(v), ex.ONE, simplify.where(operands.less(v, 0, True), ex.MINUS_ONE, ex.ZERO)), u
    )


def minimum(first: Operand, *others: Operand) -> Expr:
    """Returns the smallest of two or more numbers or indices. The minimum of indices is an index.

        teg.evaluate(teg.minimum(t, a, 1), t=3.0, a=2.0)    # 1.0

    Raises OperandError for a list or tuple of Python, and for an operand that is no number. Over an index: `teg.minimum_of`.
    """
    return _extremum((first, *others), "min", lambda a, b: operands.less(a, b, True))


def maximum(first: Operand, *others: Operand) -> Expr:
    """Returns the largest of two or more numbers or indices. The maximum of indices is an index.

        teg.evaluate(teg.maximum(t, a, 1), t=3.0, a=2.0)    # 3.0

    Raises OperandError for a list or tuple of Python, and for an operand that is no number. Over an index: `teg.maximum_of`.
    """
    return _extremum((first, *others), "max", lambda a, b: operands.less(b, a, True))


def _extremum(arguments: Sequence[Operand], name: str, wins: Callable[[Expr, Expr], Cond]) -> Expr:
    if isinstance(arguments[0], list | tuple):
        hint = f"teg.{name}imum(e1, e2, …), or with a star: teg.{name}imum(*entries); over an index: teg.{name}imum_of(V[k], (k, 0, n))"
        raise OperandError(f"teg.{name}imum takes numbers, not a Python {type(arguments[0]).__name__} of them", None, hint)
    if any(isinstance(i, Index) for i in arguments) and all(isinstance(i, Index | int) for i in arguments):
        return cast(Expr, functools.reduce(lambda a, b: index_call(name, a, b), map(as_index, arguments)))
    best = arguments[0] if isinstance(arguments[0], Tuple) else as_number(arguments[0])
    for other in arguments[1:]:
        best = entrywise(lambda a, b: simplify.where(wins(a, b), a, b), best, other)
    return best


def _applied(name: str, *arguments: Operand) -> Expr:
    """Returns a function of the language applied to numbers; to tuples, entry by entry."""
    return entrywise(functools.partial(simplify.call, name), *arguments)
