"""The functions with which users write programs: variables, parameters, functions, conditions, integrals. They check their arguments."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, cast, overload

from teg.errors import BoundError, NameClashError, OperandError, ParameterError, ScopeError
from teg.ir import expr as ex
from teg.ir.arrays import identifier
from teg.ir.creation import created
from teg.ir.expr import Cond, Const, Expr, Operand, Param, Tuple, Var, as_condition, as_number, entrywise
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
    """Returns a variable of integration. The same name is the same variable. Raises OperandError for what is no text.

    x = teg.var("x")
    teg.evaluate(teg.integral(x**2, (x, 0, 3)))        # 9.0
    """
    return Var.make(_name(name, "variable"), ())


def vars(names: str) -> tuple[Var, ...]:
    """Returns variables of integration, named in one string, a tuple.

        x, y = teg.vars("x y")
        str(x * y)                                          # x·y

    Raises OperandError for what is no text, NameClashError for a name that is given twice.
    """
    return tuple(var(n) for n in _names(names, "vars"))


def param(name: str) -> Param:
    """Returns a parameter, by which derivatives are taken. The same name is the same parameter.

    Parameters are arguments of compiled programs, so a name is an identifier of Python. (The value of a name that is a keyword, such as
    "lambda", is given in a dict.) Raises ParameterError for another name, OperandError for what is no text.

        t = teg.param("t")
        f = teg.compile(t**2)
        f(t=0.5)                                            # 0.25
    """
    return param_of_any_name(identifier(_name(name, "parameter"), "params"))


def param_of_any_name(name: str) -> Param:
    """Returns the parameter of a name that need not be an identifier, such as a symbol of SymPy: its value is given in a dict."""
    return created(Param.make(name, ()))


def params(names: str) -> tuple[Param, ...]:
    """Returns parameters, named in one string, a tuple.

        t, a = teg.params("t a")
        teg.compile(a * t, [t, a]).grad(t=2.0, a=3.0)       # {'t': 3.0, 'a': 2.0}

    Raises OperandError for what is no text, NameClashError for a name that is given twice, ParameterError for one that is no identifier.
    """
    return tuple(param(n) for n in _names(names, "params"))


@overload
def integral(integrand: Tuple, *domain: tuple[Var, Operand, Operand]) -> Tuple: ...
@overload
def integral(integrand: Operand, *domain: tuple[Var, Operand, Operand]) -> Expr: ...
def integral(integrand: Operand, *domain: tuple[Var, Operand, Operand]) -> Expr:
    """Returns ∫ … ∫ integrand over the triples (variable, lower bound, upper bound), the first triple innermost.

    A bound may be a number (also ±math.inf) or an expression of parameters and of the variables of later triples; lower > upper is the
    signed integral. A tuple is integrated entry by entry. Raises ScopeError for a malformed triple, one whose first entry is not a
    variable, or two of one variable.

        x, y = teg.vars("x y")
        e = teg.integral(x * y, (x, 0, y), (y, 0, 1))      # ∫₀¹ ∫₀ʸ x·y dx dy
        teg.evaluate(e)                                     # 0.125
    """
    e = integrand if isinstance(integrand, Tuple) else as_number(integrand)
    if not domain:
        raise ScopeError("an integral needs a variable and its bounds", e, "write teg.integral(e, (x, 0, 1))")
    over: list[Var] = []
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
            name = next((w.name for w in triple if isinstance(w, Var)), "")
            w = v.name if isinstance(v, Param) else "x"
            made = f'{w} = teg.var("{w}")'
            hint = f"the variable comes first: ({name}, lower, upper)" if name else f"make one with {made}"
            raise ScopeError(f"an integral runs over a variable, not over {kind}", v, hint)
        if v in over:
            hint = (
                f"name another variable; for an integral over {v.name} of an integral over {v.name} write one teg.integral inside the other"
            )
            raise ScopeError(f"the variable {v.name} is in two triples of one integral", e, hint)
        over.append(v)
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


def bracket(condition: Cond) -> Expr:
    """Returns Iverson's bracket: 1 where the condition holds, else 0. Raises ConditionError for what is no condition.

        f = teg.compile(teg.integral(teg.bracket((x < t) & (x > 0.1)), (x, 0, 1)), [t])
        f(t=0.5)                                  # 0.4

    On its border a condition is as written: `[t > 0]` is 0 at t = 0, and `[t >= 0]` is 1.
    """
    return ex.bracket(as_condition(condition))


@overload
def where(condition: Cond, then: Tuple, otherwise: Operand) -> Tuple: ...
@overload
def where(condition: Cond, then: Operand, otherwise: Tuple) -> Tuple: ...
@overload
def where(condition: Cond, then: Operand, otherwise: Operand) -> Expr: ...
def where(condition: Cond, then: Operand, otherwise: Operand) -> Expr:
    """Returns `then` where the condition holds, else `otherwise`. The value not taken never matters, even if it is NaN.

        f = teg.compile(teg.where(t > 0, teg.log(t), -1), [t])
        f(t=-2.0)                                 # -1.0

    Of tuples of one length it is a tuple, entry by entry; a number beside a tuple goes with every entry. Raises ConditionError for what is
    no condition, OperandError for values that are no numbers.
    """
    c = as_condition(condition)

    def chosen(a: Expr, b: Expr) -> Expr:
        return ex.Where.make(None, (c, a, b)) if a is b and not isinstance(c, ex.Truth) else ex.where(c, a, b)

    return entrywise(chosen, then, otherwise)


def tuple_(*entries: Operand | tuple[Any, ...] | list[Any]) -> Tuple:
    """Returns several expressions to be evaluated together. Nested Python tuples of expressions become nested tuples.

        f = teg.compile(teg.tuple(t * a, teg.sin(t)), [t])
        f(t=0.0, a=3.0)                                     # (0.0, 0.0)
        f.grad(t=0.0, a=3.0)                                # {'t': (3.0, 1.0)}

    Arithmetic, functions and `teg.where` work on tuples entry by entry. Raises OperandError for an entry that is no number.
    """
    return ex.tuple_of(*(tuple_(*e) if isinstance(e, list | tuple) else e if isinstance(e, Tuple) else as_number(e) for e in entries))


def delta(argument: Operand) -> Expr:
    """Returns Dirac's δ(argument). It may be added and multiplied, under an integral that binds one of its variables.

        f = teg.compile(teg.integral(teg.delta(2 * x - t) * teg.exp(x), (x, 0, 1)), [t])
        f(t=1.0)                                  # 0.8243606353500641

    It has the unit of 1/argument. Raises DeltaError where it stands in a function, a condition or a denominator.
    """
    return _delta(as_number(argument))


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
    return entrywise(ex.absolute, u)


def sign(u: Operand) -> Expr:
    """Returns -1, 0 or 1.

    teg.evaluate(teg.sign(t), t=-2.0)                   # -1.0
    """
    return entrywise(lambda v: ex.where(ex.positive(v), ex.ONE, ex.where(ex.less(v, 0, True), ex.MINUS_ONE, ex.ZERO)), u)


def minimum(first: Operand, *others: Operand) -> Expr:
    """Returns the smallest of two or more numbers or indices. The minimum of indices is an index.

        teg.evaluate(teg.minimum(t, a, 1), t=3.0, a=2.0)    # 1.0

    Raises OperandError for a list or tuple of Python, and for what is no number. Over an index: `teg.minimum_of`.
    """
    return _extremum((first, *others), "min", lambda a, b: ex.less(a, b, True))


def maximum(first: Operand, *others: Operand) -> Expr:
    """Returns the largest of two or more numbers or indices. The maximum of indices is an index.

        teg.evaluate(teg.maximum(t, a, 1), t=3.0, a=2.0)    # 3.0

    Raises OperandError for a list or tuple of Python, and for what is no number. Over an index: `teg.maximum_of`.
    """
    return _extremum((first, *others), "max", lambda a, b: ex.less(b, a, True))


def _extremum(arguments: Sequence[Operand], name: str, wins: Callable[[Expr, Expr], Cond]) -> Expr:
    if isinstance(arguments[0], list | tuple):
        hint = f"teg.{name}imum(e1, e2, …), or with a star: teg.{name}imum(*entries); over an index: teg.{name}imum_of(V[k], (k, 0, n))"
        raise OperandError(f"teg.{name}imum takes numbers, not a Python {type(arguments[0]).__name__} of them", None, hint)
    if any(isinstance(i, Index) for i in arguments) and all(isinstance(i, Index | int) for i in arguments):
        return cast(Expr, functools.reduce(lambda a, b: index_call(name, a, b), map(as_index, arguments)))
    best = arguments[0] if isinstance(arguments[0], Tuple) else as_number(arguments[0])
    for other in arguments[1:]:
        best = entrywise(lambda a, b: ex.where(wins(a, b), a, b), best, other)
    return best


def _applied(name: str, *arguments: Operand) -> Expr:
    """Returns a function of the language applied to numbers; to tuples, entry by entry."""
    return entrywise(functools.partial(ex.call, name), *arguments)


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
    if isinstance(wrt, str):
        raise ParameterError(f"derivatives are taken by parameters, not by the text {wrt!r:.80}", None, f"[teg.param({wrt!r:.80})]")
    chosen: dict[Param, None] = {}
    for p in wrt:
        if not isinstance(p, Param):
            made = f"teg.param({p!r:.80})" if isinstance(p, str) else 't = teg.param("t")'
            raise ParameterError("derivatives are taken by parameters", p, f"make one with {made}")
        if p in chosen:
            raise ParameterError(f"the parameter {p.name!r} is listed twice")
        chosen[p] = None
    return list(chosen)
