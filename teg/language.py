"""The functions with which users write programs: variables, parameters, functions, conditions, integrals. They check their arguments."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable
from typing import cast

from teg.errors import BoundError, NameClashError, OperandError, ParameterError, ScopeError
from teg.ir import expr as ex
from teg.ir.expr import Cond, Const, Expr, Param, Tuple, Var, as_condition, as_number
from teg.ir.index import Index, as_index, index_call
from teg.ir.integral import Integral, integral_over
from teg.ir.integral import delta as _delta
from teg.ir.node import postorder
from teg.ir.traverse import parameters


def _names(text: str, what: str) -> list[str]:
    if not isinstance(text, str):
        raise OperandError(f"{what} are named by a string, not by {type(text).__name__}", None, f'write teg.{what}("x y")')
    names = [n for n in re.split(r"[\s,]+", text) if n]
    if len(set(names)) != len(names):
        raise NameClashError(f"a name is given twice in {text!r}")
    return names


def _name(text: str, what: str) -> str:
    if not isinstance(text, str) or not text:
        raise OperandError(f"a {what} is named by a string that is not empty, not by {text!r}")
    return text


def var(name: str) -> Var:
    """Returns a variable of integration. The same name is the same variable."""
    return Var.make(_name(name, "variable"), ())


def vars(names: str) -> tuple[Var, ...]:
    """Returns variables of integration, named in one string: ``x, y = teg.vars("x y")``."""
    return tuple(var(n) for n in _names(names, "vars"))


def param(name: str) -> Param:
    """Returns a parameter, by which derivatives are taken. The same name is the same parameter."""
    return Param.make(_name(name, "parameter"), ())


def params(names: str) -> tuple[Param, ...]:
    """Returns parameters, named in one string: ``t, a = teg.params("t a")``."""
    return tuple(param(n) for n in _names(names, "params"))


def integral(integrand: object, *domain: tuple[object, object, object]) -> Expr:
    """Returns ∫ … ∫ integrand over the triples (variable, lower bound, upper bound), the first triple innermost.

    A bound may be a number (also ±math.inf) or an expression of parameters and of the variables of later triples; lower > upper is the
    signed integral. Raises ScopeError for a malformed triple, or one whose first entry is not a variable.

        x, y = teg.vars("x y")
        teg.integral(x * y, (x, 0, y), (y, 0, 1))       # ∫₀¹ ∫₀ʸ x·y dx dy = 1/8
    """
    e = integrand if isinstance(integrand, Tuple) else as_number(integrand)
    if not domain:
        raise ScopeError("an integral needs a variable and its bounds", e, "write teg.integral(e, (x, 0, 1))")
    for triple in domain:
        if not isinstance(triple, tuple | list) or len(triple) != 3:
            raise ScopeError(
                f"{triple!r:.80} is not (variable, lower, upper)",
                e,
                "write teg.integral(e, (x, 0, 1), (y, 0, 1))",
            )
        v, lo, hi = triple
        if not isinstance(v, Var):
            kind = "a parameter" if isinstance(v, Param) else f"{type(v).__name__}"
            raise ScopeError(f"an integral runs over a variable, not over {kind}", v, 'make one with x = teg.var("x")')
        bounds = as_number(lo), as_number(hi)
        for bound in bounds:
            if isinstance(bound, Const) and math.isnan(bound.data):
                raise BoundError(
                    f"a bound of {v.name} is not a number",
                    e,
                    "a number, an expression, or ±math.inf",
                )
        whole = integral_over(e, v, *bounds)
        e = Integral.make(v, (e, *bounds)) if whole is ex.ZERO and not isinstance(e, Const) else whole  # as written: no parameter is lost
    return e


def bracket(condition: object) -> Expr:
    """Returns Iverson's bracket: 1 where the condition holds, else 0."""
    return ex.bracket(as_condition(condition))


def where(condition: object, then: object, otherwise: object) -> Expr:
    """Returns `then` where the condition holds, else `otherwise`. The value not taken never matters, even if it is NaN."""
    c, a, b = as_condition(condition), as_number(then), as_number(otherwise)
    return ex.Where.make(None, (c, a, b)) if a is b and not isinstance(c, ex.Truth) else ex.where(c, a, b)


def tuple_(*entries: object) -> Tuple:
    """Returns several expressions to be evaluated together. Nested Python tuples of expressions become nested tuples."""
    return ex.tuple_of(*(tuple_(*e) if isinstance(e, list | tuple) else e if isinstance(e, Tuple) else as_number(e) for e in entries))


def delta(argument: object) -> Expr:
    """Returns Dirac's δ(argument). It may be added and multiplied, under an integral that binds one of its variables."""
    return _delta(as_number(argument))


def sin(u: object) -> Expr:
    """Returns the sine of u, in radians."""
    return ex.call("sin", as_number(u))


def cos(u: object) -> Expr:
    """Returns the cosine of u, in radians."""
    return ex.call("cos", as_number(u))


def tan(u: object) -> Expr:
    """Returns the tangent of u, in radians."""
    return ex.call("tan", as_number(u))


def asin(u: object) -> Expr:
    """Returns the inverse sine, in [-π/2, π/2]."""
    return ex.call("asin", as_number(u))


def acos(u: object) -> Expr:
    """Returns the inverse cosine, in [0, π]."""
    return ex.call("acos", as_number(u))


def atan(u: object) -> Expr:
    """Returns the inverse tangent, in (-π/2, π/2)."""
    return ex.call("atan", as_number(u))


def atan2(y: object, x: object) -> Expr:
    """Returns the angle of the point (x, y), in (-π, π]."""
    return ex.call("atan2", as_number(y), as_number(x))


def sinh(u: object) -> Expr:
    """Returns the hyperbolic sine."""
    return ex.call("sinh", as_number(u))


def cosh(u: object) -> Expr:
    """Returns the hyperbolic cosine."""
    return ex.call("cosh", as_number(u))


def tanh(u: object) -> Expr:
    """Returns the hyperbolic tangent."""
    return ex.call("tanh", as_number(u))


def exp(u: object) -> Expr:
    """Returns the exponential."""
    return ex.call("exp", as_number(u))


def expm1(u: object) -> Expr:
    """Returns exp(u) - 1, accurate also where u is small: ``teg.evaluate(teg.expm1(teg.param("r")), {"r": 1e-20})`` is 1e-20."""
    return ex.call("expm1", as_number(u))


def log(u: object) -> Expr:
    """Returns the natural logarithm."""
    return ex.call("log", as_number(u))


def log1p(u: object) -> Expr:
    """Returns log(1 + u), accurate also where u is small; NaN for u < -1."""
    return ex.call("log1p", as_number(u))


def erf(u: object) -> Expr:
    """Returns the error function, 2/√π·∫ exp(-s²) ds over (0, u).

    The distribution function of a normal number of mean m and deviation s is 1/2·erfc((m - x)/(s·√2)):

        x, m, s = teg.params("x m s")
        normal = 0.5 * teg.erfc((m - x) / (s * 2**0.5))
    """
    return ex.call("erf", as_number(u))


def erfc(u: object) -> Expr:
    """Returns 1 - erf(u), accurate also where erf(u) is nearly 1."""
    return ex.call("erfc", as_number(u))


def sqrt(u: object) -> Expr:
    """Returns the square root; NaN for u < 0."""
    return ex.call("sqrt", as_number(u))


def floor(u: object) -> Expr:
    """Returns the largest integer not above u."""
    return ex.call("floor", as_number(u))


def ceil(u: object) -> Expr:
    """Returns the smallest integer not below u."""
    return ex.call("ceil", as_number(u))


def round_(u: object) -> Expr:
    """Returns the nearest integer.

    A half goes to the even side, as in Python and NumPy. If u has variables of integration a half goes up, which changes no integral.
    """
    return ex.call("round", as_number(u))


def mod(u: object, period: object) -> Expr:
    """Returns u - period·floor(u/period). It has the sign of the period, as in Python."""
    return ex.call("mod", as_number(u), as_number(period))


def abs_(u: object) -> Expr:
    """Returns |u|."""
    return ex.absolute(as_number(u))


def sign(u: object) -> Expr:
    """Returns -1, 0 or 1."""
    v = as_number(u)
    return ex.where(ex.positive(v), ex.ONE, ex.where(ex.less(v, 0, True), ex.MINUS_ONE, ex.ZERO))


def minimum(first: object, *others: object) -> Expr:
    """Returns the smallest of two or more numbers or indices. The minimum of indices is an index."""
    return _extremum(first, others, "min", lambda a, b: ex.less(a, b, True))


def maximum(first: object, *others: object) -> Expr:
    """Returns the largest of two or more numbers or indices. The maximum of indices is an index."""
    return _extremum(first, others, "max", lambda a, b: ex.less(b, a, True))


def _extremum(first: object, others: tuple[object, ...], name: str, wins: object) -> Expr:
    arguments = (first, *others)
    if any(isinstance(i, Index) for i in arguments) and all(isinstance(i, Index | int) for i in arguments):
        return cast(Expr, functools.reduce(lambda a, b: index_call(name, a, b), map(as_index, arguments)))
    best = as_number(first)
    for other in others:
        u = as_number(other)
        best = ex.where(cast("Cond", wins(best, u)), best, u)  # type: ignore[operator]
    return best


def check_program(e: Expr) -> None:
    """Checks that a program is closed and gives each name to one thing. Raises ScopeError or NameClashError."""
    if e.free:
        names = ", ".join(sorted(v.name for v in e.free))
        one = next(iter(e.free))
        raise ScopeError(
            f"a variable stands outside its integral: {names}",
            e,
            f"integrate over it, teg.integral(e, ({one.name}, 0, 1)), or make it a parameter: teg.param({one.name!r})",
        )
    bound = {n.var.name for n in postorder([e]) if isinstance(n, Integral)}
    for p in parameters(e):
        if p.name in bound:
            raise NameClashError(
                f"{p.name!r} is a parameter and a variable of integration in one program",
                e,
                "rename one of them",
            )


def check_parameters(wrt: object) -> list[Param]:
    """Returns a user's list of parameters, one or several, each once. Raises ParameterError."""
    if isinstance(wrt, Param):
        return [wrt]
    if isinstance(wrt, Expr) or not isinstance(wrt, Iterable):
        raise ParameterError("derivatives are taken by parameters", wrt, 'make one with t = teg.param("t")')
    chosen: dict[Param, None] = {}
    for p in wrt:
        if not isinstance(p, Param):
            raise ParameterError("derivatives are taken by parameters", p, 'make one with t = teg.param("t")')
        if p in chosen:
            raise ParameterError(f"the parameter {p.name!r} is listed twice")
        chosen[p] = None
    return list(chosen)
