"""The functions with which users write programs: variables, parameters, brackets, choices, tuples, integrals; arguments are checked."""

from __future__ import annotations

import math
import re
from typing import Any, overload

from teg.errors import BoundError, NameClashError, OperandError, ScopeError
from teg.ir import expr as ex
from teg.ir import simplify
from teg.ir.arrays import identifier
from teg.ir.creation import created
from teg.ir.expr import Cond, Const, Expr, Operand, Param, Tuple, Var
from teg.ir.integral import Integral, integral_over
from teg.ir.integral import delta as _delta
from teg.ir.operands import as_condition, as_number, entrywise


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
    """Returns a variable of integration. The same name is the same variable. Raises OperandError for a name that is no string.

    x = teg.var("x")
    teg.evaluate(teg.integral(x**2, (x, 0, 3)))        # 9.0
    """
    return Var.make(_name(name, "variable"), ())


def vars(names: str) -> tuple[Var, ...]:
    """Returns variables of integration, named in one string, a tuple.

        x, y = teg.vars("x y")
        str(x * y)                                          # x·y

    Raises OperandError for names that are no string, NameClashError for a name that is given twice.
    """
    return tuple(var(n) for n in _names(names, "vars"))


def param(name: str) -> Param:
    """Returns a parameter, by which derivatives are taken. The same name is the same parameter.

    Parameters are arguments of compiled programs, so a name is an identifier of Python. (The value of a name that is a keyword, such as
    "lambda", is given in a dict.) Raises ParameterError for another name, OperandError for a name that is no string.

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

    Raises OperandError for names that are no string, NameClashError for a name that is given twice, ParameterError for one that is no
    identifier.
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
    """Returns Iverson's bracket: 1 where the condition holds, else 0. Raises ConditionError for an argument that is no condition.

        f = teg.compile(teg.integral(teg.bracket((x < t) & (x > 0.1)), (x, 0, 1)), [t])
        f(t=0.5)                                  # 0.4

    On its border a condition is as written: `[t > 0]` is 0 at t = 0, and `[t >= 0]` is 1.
    """
    return simplify.bracket(as_condition(condition))


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
        return ex.Where.make(None, (c, a, b)) if a is b and not isinstance(c, ex.Truth) else simplify.where(c, a, b)

    return entrywise(chosen, then, otherwise)


def tuple_(*entries: Operand | tuple[Any, ...] | list[Any]) -> Tuple:
    """Returns several expressions to be evaluated together. Nested Python tuples of expressions become nested tuples.

        f = teg.compile(teg.tuple(t * a, teg.sin(t)), [t])
        f(t=0.0, a=3.0)                                     # (0.0, 0.0)
        f.grad(t=0.0, a=3.0)                                # {'t': (3.0, 1.0)}

    Arithmetic, functions and `teg.where` work on tuples entry by entry. Raises OperandError for an entry that is no number.
    """
    return simplify.tuple_of(*(tuple_(*e) if isinstance(e, list | tuple) else e if isinstance(e, Tuple) else as_number(e) for e in entries))


def delta(argument: Operand) -> Expr:
    """Returns Dirac's δ(argument). It may be added and multiplied, under an integral that binds one of its variables.

        f = teg.compile(teg.integral(teg.delta(2 * x - t) * teg.exp(x), (x, 0, 1)), [t])
        f(t=1.0)                                  # 0.8243606353500641

    It has the unit of 1/argument. Raises DeltaError where it stands in a function, a condition or a denominator.
    """
    return _delta(as_number(argument))
