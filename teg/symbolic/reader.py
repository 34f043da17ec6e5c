"""SymPy's nodes converted to the language's, each once. An unsupported node is refused before anything is converted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, reduce
from importlib import import_module
from typing import Any, cast

from teg.errors import BoundError, NameClashError, OperandError
from teg.ir import expr as ex
from teg.ir import operands, simplify
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Cond, Const, Expr, Mul, Var
from teg.ir.node import Node
from teg.language import functions, programs
from teg.symbolic.nodes import in_postorder, parts_of, shown, sympy_package


def readable(root: Any) -> list[Any]:
    """Returns every node of a SymPy expression once, parts first. Raises OperandError or BoundError for unsupported nodes."""
    return in_postorder(root, _check)


def _check(node: Any) -> None:
    """Raises OperandError or BoundError for a node that the language does not have."""
    sympy = sympy_package()
    if type(node) is sympy.Integral:
        for limit in node.args[1:]:
            x, *bounds = limit.args
            if not x.is_Symbol or len(bounds) != 2:
                raise BoundError("an integral needs a symbol and two bounds", shown(node), "write Integral(e, (x, 0, 1))")
            if any(b in (sympy.oo, -sympy.oo, sympy.zoo, sympy.nan) for b in bounds if not b.args):
                hint = f"substitute, for instance {x} = tan(u) with u in (-π/2, π/2) and the factor 1 + tan(u)², or cut the tail off"
                raise BoundError(f"the bounds of {x} are not finite", shown(node), hint)
    elif type(node) is sympy.DiracDelta and len(node.args) > 1 and node.args[1] != 0:
        raise OperandError("a derivative of a Dirac delta is not in the language", shown(node), "differentiate with teg.diff")
    elif type(node) not in builders() and not (isinstance(node, sympy.Basic) and _is_leaf(node)):
        unevaluated = isinstance(node, sympy.Derivative | sympy.Subs | sympy.Sum | sympy.Product | sympy.Limit)
        hint = "its .doit() may find a closed form" if unevaluated else ""
        raise OperandError(f"SymPy's {type(node).__name__} is not in the language", shown(node), hint)


def _is_leaf(node: Any) -> bool:
    sympy = sympy_package()
    numbers = sympy.Symbol | sympy.Rational | sympy.Float | sympy.NumberSymbol
    return isinstance(node, numbers) or node in (sympy.true, sympy.false, sympy.oo, -sympy.oo, sympy.nan)


def names_of(order: list[Any], wanted: frozenset[str], outside: frozenset[Any]) -> tuple[list[Any], dict[Any, Expr]]:
    """Returns the symbols that integrals bind, and the expression for every symbol.

    Symbols in `outside` are free somewhere, so their names are taken.
    """
    sympy = sympy_package()
    bound = list(dict.fromkeys(limit[0] for n in order if isinstance(n, sympy.Integral) for limit in n.limits))
    among = frozenset(bound)
    free = [n for n in order if n.is_Symbol and (n not in among or n in outside)]
    taken: dict[str, Any] = {}
    names: dict[Any, Expr] = {}
    for symbol in free:
        if taken.setdefault(symbol.name, symbol) != symbol:
            raise NameClashError(f"two symbols are called {symbol.name!r}", symbol.name, "rename one, or give both the same assumptions")
        names[symbol] = programs.var(symbol.name) if symbol.name in wanted else programs.param_of_any_name(symbol.name)
    for symbol in bound:
        name = symbol.name
        while name in taken:
            name += "′"
        taken[name] = symbol
        names[symbol] = programs.var(name)
    return bound, names


class Reader:
    """Converts SymPy's nodes to the language's, each once."""

    def __init__(self, names: Mapping[Any, Expr], at_zero: float | None, places: frozenset[Var] = frozenset()) -> None:
        self.sympy = sympy_package()
        self.functions = builders()
        self.names = names
        self.at_zero = at_zero  # the value of Heaviside(u) at u = 0; None: the rule of from_sympy
        self.places = places  # variables that may still become parameters

    def read(self, order: list[Any]) -> Node:
        """Returns the expression for the last of SymPy's nodes in postorder."""
        done: dict[int, Any] = {}
        for node in order:
            done[id(node)] = self.form(node, [done[id(part)] for part in parts_of(node)])
        return cast(Node, done[id(order[-1])])

    def form(self, node: Any, parts: list[Any]) -> Node:
        sympy, kind = self.sympy, type(node)
        if node.is_Symbol:
            return self.names[node]
        if not node.args:
            return _leaf(node)
        if kind is sympy.Integral:
            return self.integral(node, *parts)
        if kind is sympy.Piecewise:
            result: Expr = ex.const(math.nan)
            for then, condition in zip(parts[-2::-2], parts[::-2], strict=True):
                result = programs.where(condition, then, result)
            return result
        if kind is sympy.Heaviside:
            return self.heaviside(node, *map(operands.as_number, parts))
        if kind is sympy.Mul and node.args[0].is_Rational:
            return self.functions[kind](*parts[1:], parts[0])  # x/3 is a quotient, not a product with a rounded third
        if kind is sympy.Pow and node.exp.is_Rational:
            return operands.as_number(parts[0]) ** _nearest(node.exp)
        return self.functions[kind](*parts)

    def integral(self, node: Any, body: Expr, *bounds: Expr) -> Expr:
        for i, limit in enumerate(node.limits):
            body = programs.integral(body, (cast(Var, self.names[limit[0]]), bounds[2 * i], bounds[2 * i + 1]))
        return body

    def heaviside(self, node: Any, u: Expr, at_zero: Expr) -> Expr:
        if node.args[1] == self.sympy.S.Half:
            at_zero = ex.const(self.at_zero if self.at_zero is not None else 0.0 if u.free - self.places else 0.5)
        if at_zero is ZERO or at_zero is ONE:
            strict = at_zero is ZERO
            if isinstance(u, Mul) and len(u.children) == 2 and u.children[0] is MINUS_ONE and isinstance(u.children[1], Add):
                return programs.bracket(
                    ~simplify.positive(u.children[1], not strict)
                )  # -(a - b), which SymPy does not write: the original was a ~
            return programs.bracket(simplify.positive(u, strict))
        return programs.where(u >= 0, programs.where(u > 0, 1, at_zero), 0)


def _nearest(number: Any) -> float:
    """Returns the float64 nearest to a SymPy number."""
    try:
        value = number.p / number.q if number.is_Rational else float(number.evalf(30) if number.is_NumberSymbol else number)
    except OverflowError:
        value = math.inf
    if math.isinf(value) and not number.is_infinite:
        raise OperandError("a number is beyond the range of float64", shown(number))
    return cast(float, value)


def _leaf(node: Any) -> Expr | Cond:
    sympy = sympy_package()
    if node is sympy.true or node is sympy.false:
        return ex.TRUE if node is sympy.true else ex.FALSE
    value = _nearest(node)
    if not node.is_Rational or node.is_Integer or value.as_integer_ratio() == (node.p, node.q):
        return ex.const(value)
    both_exact = all(n.bit_length() < 1024 and int(float(n)) == n for n in (node.p, node.q))
    return simplify.div(ex.const(node.p), ex.const(node.q)) if both_exact else ex.const(value)


@cache
def builders() -> dict[Any, Callable[..., Node]]:
    """Returns, for each SymPy function, the function that builds the language's node from converted arguments."""
    sympy = sympy_package()
    cfunctions = import_module("sympy.codegen.cfunctions")
    of_numbers: dict[Any, Callable[..., Node]] = {
        sympy.Add: _sum,
        sympy.Mul: _product,
        sympy.Pow: lambda base, exponent: base**exponent,
        sympy.exp: functions.exp,
        sympy.log: lambda u, base=None: functions.log(u) if base is None else functions.log(u) / functions.log(base),
        sympy.sin: functions.sin,
        sympy.cos: functions.cos,
        sympy.tan: functions.tan,
        sympy.sec: lambda u: 1 / functions.cos(u),
        sympy.csc: lambda u: 1 / functions.sin(u),
        sympy.cot: lambda u: functions.cos(u) / functions.sin(u),
        sympy.sinc: lambda u: programs.where((u > 0) | (u < 0), functions.sin(u) / u, 1),
        sympy.asin: functions.asin,
        sympy.acos: functions.acos,
        sympy.atan: functions.atan,
        sympy.asec: lambda u: functions.acos(1 / u),
        sympy.acsc: lambda u: functions.asin(1 / u),
        sympy.acot: lambda u: functions.atan(1 / u),
        sympy.atan2: functions.atan2,
        sympy.sinh: functions.sinh,
        sympy.cosh: functions.cosh,
        sympy.tanh: functions.tanh,
        sympy.sech: lambda u: 1 / functions.cosh(u),
        sympy.csch: lambda u: 1 / functions.sinh(u),
        sympy.coth: lambda u: 1 / functions.tanh(u),
        sympy.erf: functions.erf,
        sympy.erfc: functions.erfc,
        sympy.erfinv: lambda u: simplify.call("erfinv", u),
        sympy.erfcinv: lambda u: simplify.call("erfcinv", u),
        sympy.erf2: lambda u, v: functions.erf(v) - functions.erf(u),
        cfunctions.expm1: functions.expm1,
        cfunctions.log1p: functions.log1p,
        sympy.asinh: _asinh,
        sympy.acosh: _acosh,
        sympy.atanh: lambda u: 0.5 * functions.log((1 + u) / (1 - u)),
        sympy.asech: lambda u: _acosh(1 / u),
        sympy.acsch: lambda u: _asinh(1 / u),
        sympy.acoth: lambda u: 0.5 * functions.log((u + 1) / (u - 1)),
        sympy.Abs: functions.abs_,
        sympy.sign: functions.sign,
        sympy.Min: functions.minimum,
        sympy.Max: functions.maximum,
        sympy.floor: functions.floor,
        sympy.ceiling: lambda u: simplify.call("ceil", u),
        sympy.frac: lambda u: functions.mod(u, 1),
        sympy.Mod: functions.mod,
        sympy.re: lambda u: u,
        sympy.conjugate: lambda u: u,
        sympy.UnevaluatedExpr: lambda u: u,
        sympy.DiracDelta: lambda u, order=None: programs.delta(u),
        sympy.Lt: lambda a, b: a < b,
        sympy.Le: lambda a, b: a <= b,
        sympy.Gt: lambda a, b: a > b,
        sympy.Ge: lambda a, b: a >= b,
        sympy.Eq: lambda a, b: (a <= b) & (a >= b),
        sympy.Ne: lambda a, b: (a < b) | (a > b),
    }
    of_conditions: dict[Any, Callable[..., Node]] = {
        sympy.Not: simplify.negation,
        sympy.And: simplify.conjunction,
        sympy.Or: simplify.disjunction,
        sympy.Nand: lambda *c: ~simplify.conjunction(*c),
        sympy.Nor: lambda *c: ~simplify.disjunction(*c),
        sympy.Xor: lambda *c: reduce(lambda a, b: (a & ~b) | (~a & b), c),
        sympy.Implies: lambda a, b: ~a | b,
        sympy.Equivalent: lambda *c: simplify.conjunction(*c) | ~simplify.disjunction(*c),
        sympy.ITE: lambda c, a, b: (c & a) | (~c & b),
    }
    table: dict[Any, Callable[..., Node]] = {sympy.Tuple: programs.tuple_}
    for kinds, check in ((of_numbers, operands.as_number), (of_conditions, operands.as_condition)):
        for kind, f in kinds.items():
            table[kind] = lambda *parts, f=f, check=check: f(*map(check, parts))
    by_hand = (sympy.Integral, sympy.Piecewise, sympy.Heaviside)  # handled by the reader itself
    return table | dict.fromkeys(by_hand, programs.tuple_)


def _sum(*terms: Expr) -> Expr:
    return _remembering(Add, simplify.add(*terms), terms)


def _product(*factors: Expr) -> Expr:
    numbers = [f for f in factors if isinstance(f, Const)]
    return _remembering(Mul, simplify.mul(*factors), (*numbers, *(f for f in factors if not isinstance(f, Const))))


def _remembering(kind: type[Add | Mul], result: Expr, parts: tuple[Expr, ...]) -> Expr:
    """Returns the result, or the plain node if its parameters would vanish."""
    vanishes = isinstance(result, Const) or any(isinstance(p, Mul) and p.children[0] is ZERO for p in parts)
    return kind.make(None, parts) if vanishes and len(parts) > 1 and not all(isinstance(p, Const) for p in parts) else result


def _asinh(u: Expr) -> Expr:
    """Returns log(u + √(u² + 1)), computed from |u|: for u < 0 the terms would cancel."""
    root = functions.sqrt(u**2 + 1)
    return programs.where(u > 0, functions.log(u + root), -functions.log(root - u))


def _acosh(u: Expr) -> Expr:
    return functions.log(u + functions.sqrt(u - 1) * functions.sqrt(u + 1))
