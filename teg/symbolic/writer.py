"""The language's nodes converted to SymPy's, by the table of `teg.symbolic`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, cast

from teg.errors import NameClashError, OperandError
from teg.ir import expr as ex
from teg.ir import operands, simplify
from teg.ir.arrays import LEAVES, Ranged
from teg.ir.expr import (
    MINUS_ONE,
    ONE,
    ZERO,
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Mul,
    Not,
    Or,
    Param,
    Pow,
    Still,
    Truth,
    Tuple,
    Var,
    Where,
)
from teg.ir.integral import Delta, Integral
from teg.ir.node import Node, postorder
from teg.language import functions
from teg.symbolic.nodes import as_it_is, sympy_package

_FLATTEN = 8  # so many nested integrals, and factors, are written as one node: more would be quadratic


def symbols_of(root: Node, given: Mapping[Any, Any]) -> dict[Node, Any]:
    """Returns a distinct symbol for every parameter and variable: the one given, or the real one of the same name."""
    symbol = sympy_package().Symbol
    symbols: dict[Node, Any] = {}
    stands_for: dict[Any, Node] = {}
    for node in postorder([root]):
        leaf = node.var if isinstance(node, Integral) else node
        if isinstance(leaf, Still):
            hint = "convert the expression without teg.stop_delta"
            raise OperandError(f"SymPy has no {leaf.name} that stands still in derivatives", root, hint)
        if isinstance(leaf, Param | Var) and leaf not in symbols:
            symbols[leaf] = given[leaf] if leaf in given else symbol(leaf.name, real=True)
            if stands_for.setdefault(symbols[leaf], leaf) is not leaf:
                raise NameClashError(
                    f"{leaf.name!r} would stand for a parameter and a variable", root, "rename one of them, or give symbols="
                )
    return symbols


def written_out(root: Node) -> int:
    """Returns the number of nodes if shared nodes were written out each time."""
    length: dict[Node, int] = {}
    for node in postorder([root]):
        length[node] = 1 + sum([length[c] for c in node.children])
    return length[root]


class Writer:
    """Converts the language's nodes to SymPy's, each once. Several expressions may share them."""

    def __init__(self, symbols: Mapping[Node, Any], evaluate: bool, conditions: str, exact: bool = False) -> None:
        self.sympy = sympy_package()
        self.symbols = symbols
        self.evaluate = evaluate
        self.conditions = conditions
        self.exact = exact  # numbers as fractions, so that SymPy's algebra is exact
        self.done: dict[Node, Any] = {}
        self.finite: set[Node] = set()  # finite everywhere: no pole, no root or logarithm of a negative number
        self.steps: dict[Cond, Any] = {}

    def write(self, root: Node) -> Any:
        for node in postorder([root]):
            if node not in self.done:
                self.done[node] = self.form(node)
                if _is_finite(node, self.finite):
                    self.finite.add(node)
        return self.done[root]

    def make(self, kind: Any, *parts: Any) -> Any:
        """Returns a SymPy node, made by its constructor if it is to be evaluated."""
        return kind(*parts) if self.evaluate else as_it_is(kind, *parts)

    def form(self, node: Node) -> Any:
        sympy, parts = self.sympy, [self.done[c] for c in node.children]
        match node:
            case Const():
                return self.number(node.data)
            case Param() | Var():
                return self.symbols[node]
            case Add():
                return self.make(sympy.Add, *parts)
            case Mul():
                return self.make(sympy.Mul, *parts)
            case Pow():
                return self.make(sympy.Pow, parts[0], sympy.Integer(node.exponent))
            case Call():
                return self.call(node.name, *parts)
            case Where():
                return self.where(node, *parts)
            case Tuple():
                return sympy.Tuple(*parts)
            case Integral():
                return self.integral(self.symbols[node.var], *parts)
            case Delta():
                return self.make(sympy.DiracDelta, parts[0])
            case Truth():
                return sympy.true if node.data else sympy.false
            case Compare():
                return self.comparison(node)
            case Not():
                return self.make(sympy.Not, parts[0])
            case And():
                return self.make(sympy.And, *parts)
            case Or():
                return self.make(sympy.Or, *parts)
            case _ if isinstance(node, (*LEAVES, Ranged)):
                what = "a sum over an index" if isinstance(node, Ranged) else "an entry of an array or an index"
                hint = "convert what one term is: the body of the sum with a parameter for each entry"
                raise OperandError(f"{what} is not written for SymPy", node, hint)
            case _:
                raise OperandError(f"{type(node).__name__} has no form in SymPy", node, "convert the expression before it is eliminated")

    def number(self, value: float) -> Any:
        sympy = self.sympy
        if not math.isfinite(value):
            return sympy.nan if value != value else sympy.oo if value > 0 else -sympy.oo
        if self.exact or value.is_integer():
            return sympy.Rational(*value.as_integer_ratio())
        return sympy.Float(value, precision=53)

    def call(self, name: str, *parts: Any) -> Any:
        sympy = self.sympy
        match name:
            case "sqrt":
                return self.make(sympy.Pow, *parts, sympy.S.Half)
            case "root":
                return self.make(sympy.Pow, self.make(sympy.Abs, *parts), sympy.S.Half)
            case "chosen" | "exact":
                return parts[0]
            case "magnitude":
                return self.make(sympy.Abs, *parts)
            case "expm1":
                return self.make(sympy.Add, self.make(sympy.exp, *parts), sympy.S.NegativeOne)
            case "log1p":
                return self.make(sympy.log, self.make(sympy.Add, sympy.S.One, *parts))
            case "ceil":
                return self.make(sympy.ceiling, *parts)
            case "round":
                return self.round(*parts)
            case "pow" | "mod" | "min" | "max":
                return self.make(getattr(sympy, name.capitalize()), *parts)
            case _:
                return self.make(getattr(sympy, name), *parts)

    def round(self, u: Any) -> Any:
        """Returns ⌊u + ½⌋, less 1 where (2u - 1)/4 is an integer: halves go to the even side."""
        sympy, make = self.sympy, self.make
        quarter = make(sympy.Mul, sympy.Rational(1, 4), make(sympy.Add, make(sympy.Mul, sympy.Integer(2), u), sympy.S.NegativeOne))
        below = make(sympy.Mul, sympy.S.NegativeOne, make(sympy.floor, quarter))
        nearest = make(sympy.floor, make(sympy.Add, u, sympy.S.Half))
        return make(sympy.Add, nearest, make(sympy.ceiling, quarter), below, sympy.S.NegativeOne)

    def integral(self, x: Any, body: Any, lo: Any, hi: Any) -> Any:
        """Returns an integral, never evaluated: SymPy's constructor would multiply out the branches of the integrand."""
        sympy = self.sympy
        limits = [sympy.Tuple(x, lo, hi)]
        if type(body) is sympy.Integral and len(body.args) <= _FLATTEN and all(inner.args[0] != x for inner in body.args[1:]):
            body, *inside = body.args
            limits = [*inside, *limits]
        return as_it_is(sympy.Integral, body, *limits)

    def comparison(self, node: Compare) -> Any:
        """Returns g > 0, as b < a for g = a - b."""
        sympy, g = self.sympy, node.g
        if isinstance(g, Add) and len(g.children) == 2:
            a, b = g.children
            if isinstance(b, Mul) and len(b.children) == 2 and b.children[0] is MINUS_ONE:
                return self.make(sympy.Lt if node.strict else sympy.Le, self.done[b.children[1]], self.done[a])
        return self.make(sympy.Gt if node.strict else sympy.Ge, self.done[g], sympy.S.Zero)

    def where(self, node: Where, condition: Any, then: Any, otherwise: Any) -> Any:
        sympy = self.sympy
        named = _named(node)
        if named is not None:
            return self.make(getattr(sympy, named[0]), *(self.done[a] for a in named[1:]))
        branches = [(c, u) for c, u in ((node.condition, node.then), (simplify.negation(node.condition), node.otherwise)) if u is not ZERO]
        as_products = len(branches) == 1 and _is_product(branches[0][0]) and branches[0][1] in self.finite
        if self.conditions == "heaviside" or (self.conditions == "auto" and as_products):
            return self.total([self.product(self.done[u], self.step(c)) for c, u in branches])
        if self.evaluate and not node.condition.has_integral:  # SymPy would move its branches out of the integral's scope
            return sympy.Piecewise((then, condition), (otherwise, True))
        pair = sympy.functions.elementary.piecewise.ExprCondPair
        pairs = (as_it_is(pair, then, condition), as_it_is(pair, otherwise, sympy.true))
        return as_it_is(sympy.Piecewise, *pairs)

    def total(self, terms: list[Any]) -> Any:
        return self.make(self.sympy.Add, *terms) if len(terms) > 1 else terms[0] if terms else self.sympy.S.Zero

    def product(self, *factors: Any) -> Any:
        mul, one = self.sympy.Mul, self.sympy.S.One
        flat = [a for f in factors for a in (f.args if type(f) is mul and len(f.args) <= _FLATTEN else (f,)) if a is not one]
        return self.make(mul, *flat) if len(flat) > 1 else flat[0] if flat else one

    def step(self, condition: Cond) -> Any:
        """Returns the bracket of a condition by Heavisides."""
        stack = [condition]
        while stack:
            c = stack[-1]
            inside = () if isinstance(c, Compare) else cast("tuple[Cond, ...]", c.children)
            missing = [d for d in inside if d not in self.steps]
            if missing:
                stack.extend(missing)
                continue
            self.steps.setdefault(c, self.step_of(c, [self.steps[d] for d in inside]))
            stack.pop()
        return self.steps[condition]

    def step_of(self, c: Cond, parts: list[Any]) -> Any:
        sympy = self.sympy
        match c:
            case Compare():
                return self.make(sympy.Heaviside, self.done[c.g], sympy.Integer(not c.strict))
            case Not(operand=Compare(g=g, strict=strict)):
                opposite = self.make(sympy.Mul, sympy.S.NegativeOne, self.done[g])
                return self.make(sympy.Heaviside, opposite, sympy.Integer(strict))
            case Not():
                return self.complement(parts[0])
            case And():
                return self.product(*parts)
            case Or():
                return self.complement(self.product(*(self.complement(p) for p in parts)))
            case _:
                return sympy.Integer(c is ex.TRUE)

    def complement(self, step: Any) -> Any:
        sympy = self.sympy
        return self.make(sympy.Add, sympy.S.One, self.make(sympy.Mul, sympy.S.NegativeOne, step))


_FINITE = frozenset(
    (
        "sin",
        "cos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "expm1",
        "erf",
        "erfc",
        "floor",
        "ceil",
        "round",
        "magnitude",
        "root",
        "min",
        "max",
        "chosen",
        "exact",
    )
)


def _is_finite(node: Node, finite: set[Node]) -> bool:
    """Returns whether a node is finite for all parameters and variables, if the nodes below it in `finite` are."""
    match node:
        case Const():
            return math.isfinite(node.data)
        case Pow() if node.exponent < 0:
            return node.base in finite and isinstance(node.base, Const) and node.base is not ZERO
        case Call(name="mod"):
            return node.children[0] in finite and isinstance(node.children[1], Const) and node.children[1] is not ZERO
        case Call() if node.name not in _FINITE:
            return False
        case _:
            return all([c in finite for c in node.children])


def _is_product(condition: Cond) -> bool:
    """Returns whether the bracket of a condition is a product of Heavisides."""
    parts = condition.children if isinstance(condition, And) else (condition,)
    return all(isinstance(c.operand if isinstance(c, Not) else c, Compare) for c in parts)


def _named(node: Where) -> tuple[Any, ...] | None:
    """Returns SymPy's name and the arguments, if the node is |u|, sign(u), a minimum or a maximum; else None."""
    condition, then, otherwise = node.condition, node.then, node.otherwise
    if not isinstance(condition, Compare) or not condition.strict or condition.resolution is not None or node.has_delta:
        return None
    if then is condition.g and otherwise is simplify.mul(MINUS_ONE, then):
        return "Abs", then
    if then is ONE and node is functions.sign(condition.g):
        return "sign", condition.g
    if condition is operands.less(then, otherwise, strict=True):
        return "Min", then, otherwise
    if condition is operands.less(otherwise, then, strict=True):
        return "Max", then, otherwise
    return None
