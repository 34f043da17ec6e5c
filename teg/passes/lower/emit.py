"""Numbers and conditions as statements of `teg.program`: every value is computed once, at the outermost level where its inputs exist.

A condition is two booleans, *holds* and *fails*: both are false where it is NaN, and `where` on it is then NaN (Kleene's logic), so NaN
comes out where NaN went in, unless the branch that holds it is not taken.

Conditions on surfaces that may be ties are made in `rounding.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import cast

from teg.analysis.extents import Extent, Extents
from teg.analysis.intervals import Interval
from teg.analysis.polynomial import Point
from teg.analysis.surfaces import binders_inside
from teg.ir.expr import MINUS_ONE, ONE, Add, And, Call, Compare, Cond, Const, Expr, Mul, Not, Or, Param, Pow, Truth, Tuple, Var, Where
from teg.ir.function import Apply, Callee
from teg.ir.integral import ClosedForm, Delta, Integral
from teg.ir.node import Node
from teg.ir.simplify import add
from teg.numerics.field import divided
from teg.passes.lower.inverse_erf import inverse_of_erf, inverse_of_erfc
from teg.passes.lower.levels import Level, Truths
from teg.passes.lower.rounding import Rounding
from teg.passes.lower.scaled import ByExponents
from teg.passes.lower.vanishing import Underflow, Vanishing
from teg.program import TIE_EPS, Arg, Assign
from teg.program.operations import letter_of

NAN = float("nan")
QUARTERS = {k / 4 for k in (-7, -6, -5, -3, -2, -1, 1, 2, 3, 5, 6, 7)}
"""Exponents of powers that are computed by square roots."""


class Emitter:
    """Names for expressions and conditions, and the statements that compute them.

    `integrate` gives an integral a name in `names` of its level; its body has none yet. `closed_form` names a number that an intrinsic
    computes.
    """

    def __init__(
        self, parameters: Sequence[str], integrate: Callable[[Integral, Level], None], closed_form: Callable[[ClosedForm, Level], Arg]
    ) -> None:
        self.integrate, self.closed_form = integrate, closed_form
        self.parameter_names = {p: f"p{i}" for i, p in enumerate(parameters)}
        self.ties: dict[tuple[tuple[str, str], bool], int] = {}
        self.functions: dict[tuple[Callee, tuple[int, ...]], int] = {}
        self.rounding = Rounding(self)
        self._count = 0
        self._binders: dict[Node, frozenset[Var]] = {}
        self._points = (Point("first"), Point("second"))
        self.ranges: Mapping[Var, Interval] = {}  # of the variables of outer integrals, if they are known in numbers
        self._vanishing = Vanishing()
        extents = Extents(self._box)
        self._by_exponents, self._underflow = ByExponents(extents), Underflow(extents)

    def fresh(self, kind: str) -> str:
        """Returns an unused name: "v…" for a number, "b…" for a boolean, "x…" for a variable."""
        self._count += 1
        return f"{kind}{self._count}"

    def number_of_tie(self, surfaces: tuple[str, str], at_place: bool = False) -> int:
        """Returns the number of a tie of two surfaces, at one place or along a curve."""
        return self.ties.setdefault((surfaces, at_place), len(self.ties))

    def binders(self, nodes: Sequence[Node]) -> frozenset[Var]:
        """Returns the variables of the integrals inside."""
        for node in nodes:
            if node not in self._binders:
                self._binders[node] = binders_inside(node)
        return frozenset().union(*(self._binders[n] for n in nodes))

    # -- levels of values ----------------------------------------------------------------------------------------------

    def home_of(self, node: Node, level: Level) -> Level:
        """Returns the outermost level where the inputs of a node exist."""
        while level.var is not None:
            if level.var in node.free:
                return level.middle if level.middle is not None and level.is_constant(node) else level
            level = level.outer  # type: ignore[assignment]
        return level

    def assign(self, home: Level, op: str, *args: Arg) -> str:
        """Returns the name of op(args), computed once a level."""
        key = (op, args)
        if key not in home.computed:
            home.computed[key] = self.fresh(letter_of(op))
            home.block.append(Assign(home.computed[key], op, args))
        return home.computed[key]

    def number(self, e: Expr, level: Level) -> Arg:
        """Returns the name of an expression, or its literal."""
        self.emit(e, level)
        return self._number_of(e, level)

    def truths(self, c: Cond, level: Level) -> Truths:
        """Returns the names of *holds* and *fails*."""
        self.emit(c, level)
        return self.truths_of(c, level)

    def emit(self, root: Node, level: Level) -> None:
        """Gives the node and everything below it a name, children first, without recursion (except for nested integrals)."""
        home_of = self.home_of
        stack: list[tuple[Node, Level]] = [(root, level)]
        while stack:
            node, at = stack[-1]
            home = home_of(node, at)
            if node in home.names:
                stack.pop()
                continue
            children: Sequence[Node] = node.children[1:] if isinstance(node, Integral) else node.children
            missing = [(c, home) for c in children if c not in home_of(c, home).names]
            if missing:
                stack.extend(reversed(missing))
                continue
            if isinstance(node, Integral):
                self.integrate(node, home)
            elif isinstance(node, Cond):
                home.names[node] = self.condition(node, home)
            else:
                home.names[node] = self.value(node, home)  # type: ignore[arg-type]
            stack.pop()

    def _number_of(self, e: Expr, level: Level) -> Arg:
        return self.home_of(e, level).names[e]  # type: ignore[return-value]

    def truths_of(self, c: Cond, level: Level) -> Truths:
        """Returns *holds* and *fails* of a condition that has names."""
        return self.home_of(c, level).names[c]  # type: ignore[return-value]

    # -- values -------------------------------------------------------------------------------------------------------

    def value(self, e: Expr, home: Level) -> Arg:
        """Returns the name of a number whose children have names."""
        match e:
            case Const():
                return cast(float, e.data)
            case Param():
                return self.parameter_names[e.name]
            case Add():
                return self.sum(e, home)
            case Mul():
                by_exponents = self._by_exponents.product(e, partial(self.home_of, level=home))
                result = self.product(e, home) if by_exponents is None else self.number(by_exponents, home)
                small = self._vanishing.of(e)
                if small is not None:
                    return self._unless_vanished(small, result, home)
                small = self._underflow.of(e)
                return result if small is None else self._unless_underflown(small, result, home)
            case Pow() if e.exponent >= 3 and home.constants is not None:
                return self._power_by_products(e, home)
            case Pow():
                base = self._number_of(e.base, home)
                return self.assign(home, "div", 1.0, base) if e.exponent == -1 else self.assign(home, "powi", base, e.exponent)
            case Apply():
                k = self.functions.setdefault((e.callee, e.derivative), len(self.functions))
                return self.assign(home, "call", k, *(self._number_of(c, home) for c in e.children))
            case ClosedForm():
                return self.closed_form(e, home)
            case Call() if e.name in ("chosen", "exact"):
                return self._number_of(e.children[0], home)
            case Call() if e.name in ("erfinv", "erfcinv"):
                u = e.children[0]
                return self.number(inverse_of_erf(u) if e.name == "erfinv" else inverse_of_erfc(u), home)
            case Call() if e.name == "log" and (by_exponents := self._by_exponents.logarithm(e)) is not None:
                return self.number(by_exponents, home)
            case Call():
                args = [self._number_of(c, home) for c in e.children]
                if e.name in ("sqrt", "log", "pow") and self._keeps_its_sign(e.children[0], home):
                    args[0] = self._of_sign_in_the_middle(e.children[0], args[0], home)
                if e.name == "root":
                    return self.assign(home, "sqrt", self.assign(home, "abs", *args))
                if e.name == "pow":
                    return self.power(args[0], args[1], home)
                if e.name == "log" and isinstance(e.children[0], Add) and ONE in e.children[0].children:
                    others = add(*(term for term in e.children[0].children if term is not ONE))
                    return self.assign(home, "log1p", self.number(others, home))
                return self.assign(home, "abs" if e.name == "magnitude" else e.name, *args)
            case Where():
                holds, fails = self.truths_of(e.condition, home)
                otherwise: Arg = self._number_of(e.otherwise, home) if fails is not False else NAN
                if not isinstance(fails, bool) and otherwise == otherwise:  # a number that is not written as NaN
                    otherwise = self.assign(home, "select", fails, otherwise, NAN)
                return self.assign(home, "select", holds, self._number_of(e.then, home), otherwise)
            case Tuple() | Delta() | _:
                raise AssertionError(f"{type(e).__name__} cannot be scheduled")

    def power(self, base: Arg, exponent: Arg, home: Level) -> Arg:
        """Returns a power, that of a whole number of quarters by square roots."""
        if exponent not in QUARTERS:
            return self.assign(home, "pow", base, exponent)
        quarters = int(abs(cast(float, exponent)) * 4.0)
        half = self.assign(home, "sqrt", base)
        factors = [base] * (quarters // 4) + [half] * (quarters // 2 % 2)
        if quarters % 2:
            factors.append(self.assign(home, "sqrt", half))
        power = factors[0] if len(factors) == 1 else self.assign(home, "mul", *factors)
        return power if cast(float, exponent) > 0.0 else self.assign(home, "div", 1.0, power)

    def _keeps_its_sign(self, u: Expr, home: Level) -> bool:
        """Returns whether the roots of u are breaks of the integral around it, so that u has one sign on each piece."""
        if home.middle is None or home.breaks is None or home.var not in u.free:
            return False
        own = [p.value(u) for p in self._points]
        for g in home.breaks.handled if all(own) else ():
            ratios = [divided(p.value(g) or 0, cast(int, v)) for p, v in zip(self._points, own, strict=True)]
            if ratios[0] == ratios[1] != 0:
                return True
        return False

    def _of_sign_in_the_middle(self, u: Expr, value: Arg, home: Level) -> Arg:
        """Returns u, and its size where it is positive in the middle of the piece: beside a root only rounding makes it negative. So it
        does in the middle of a piece that is as short as rounding makes it."""
        middle = cast(Level, home.middle)
        noise = self.assign(middle, "mul", TIE_EPS, self.rounding.terms_size(u, middle))
        above = self.assign(middle, "gt0", self.assign(middle, "add", self.number(u, middle), noise))
        return self.assign(home, "select", above, self.size_of(value, home), value)

    def sum(self, e: Add, home: Level) -> Arg:
        """Returns a sum. Terms are added from the left in the order written; a term -u is subtracted. Constants are
        added first, outside. exp(u) - 1 is one operation."""
        power = _less_one(e)
        if power is not None:
            u, sign = power
            result = self.assign(home, "expm1", self.number(u, home))
            return result if sign > 0 else self.assign(home, "neg", result)
        if home.constants is not None:
            outside = [term for term in e.children if not self._varies(term, home)]
            if len(outside) >= 2:
                e = Add.make(None, (add(*outside), *(term for term in e.children if self._varies(term, home))))
        total: list[Arg] = []
        for term in e.children:
            negative = isinstance(term, Mul) and isinstance(term.children[0], Const) and term.children[0].data == -1.0
            if total and negative and len(term.children) == 2:
                left = total[0] if len(total) == 1 else self.assign(home, "add", *total)
                total = [self.assign(home, "sub", left, self.number(cast(Expr, term.children[1]), home))]
            else:
                total.append(self.number(term, home))
        return total[0] if len(total) == 1 else self.assign(home, "add", *total)

    def _unless_vanished(self, small: Expr, product: Arg, home: Level) -> Arg:
        """Returns a product, but its small factors where they are 0."""
        factor = self.number(small, home)
        return self.assign(home, "select", self.assign(home, "gt0", self.size_of(factor, home)), product, factor)

    def _unless_underflown(self, small: Expr, product: Arg, home: Level) -> Arg:
        """Returns a product, but 0 where it is not a number and its small factors are 0."""
        factor = self.number(small, home)
        otherwise = self.assign(home, "select", self.assign(home, "gt0", factor), product, factor)
        return self.assign(home, "select", self.assign(home, "gt0", self.size_of(product, home)), product, otherwise)

    def _box(self) -> dict[Var, Extent]:
        return {v: (_number(lo), _number(hi)) for v, (lo, hi) in self.ranges.items()}

    def product(self, e: Mul, home: Level) -> Arg:
        """Returns a product. Factors are multiplied from the left, then divided by the denominators, then negated."""
        if home.constants is not None:
            return self._product_with_constant(e, home, home.constants)
        above: list[Arg] = []
        below: list[Arg] = []
        sign = False
        for factor in e.children:
            if isinstance(factor, Pow) and factor.exponent == -1:
                below.append(self.number(factor.base, home))
            elif isinstance(factor, Const) and factor.data == -1.0:
                sign = True
            else:
                above.append(self.number(factor, home))
        result: Arg = 1.0 if not above else above[0]
        if len(above) > 1:
            result = self.assign(home, "mul", *above)
        for divisor in below:
            result = self.assign(home, "div", result, divisor)
        return self.assign(home, "neg", result) if sign else result

    # -- where many nodes are computed side by side --------------------------------------------------------------------

    def _varies(self, e: Expr, home: Level) -> bool:
        """Returns whether an expression is not constant where many nodes are computed side by side."""
        return self.home_of(e, home).constants is not None

    def _product_with_constant(self, e: Mul, home: Level, outside: Level) -> Arg:
        """Returns a product whose constants are multiplied first, outside; a division is one by one number, done once."""
        constant = [f for f in e.children if not self._varies(f, home)]
        varying = [self.number(f, home) for f in e.children if self._varies(f, home)]
        if not constant:
            return self.assign(home, "mul", *varying)
        if len(constant) == 1 and constant[0] is MINUS_ONE:
            result = varying[0] if len(varying) == 1 else self.assign(home, "mul", *varying)
            return self.assign(home, "neg", result)
        return self.assign(home, "mul", self.constant(constant, outside), *varying)

    def constant(self, factors: Iterable[Expr], home: Level) -> Arg:
        """Returns the name of a product of numbers."""
        numbers = [self.number(f, home) for f in factors if f is not ONE]
        return 1.0 if not numbers else numbers[0] if len(numbers) == 1 else self.assign(home, "mul", *numbers)

    def _power_by_products(self, e: Pow, home: Level) -> Arg:
        """Returns a power by repeated squaring, because lanes of numbers have no other."""
        base, result, k = self.number(e.base, home), None, e.exponent
        while k:
            if k & 1:
                result = base if result is None else self.assign(home, "mul", result, base)
            k >>= 1
            base = self.assign(home, "mul", base, base) if k else base
        return cast(Arg, result)

    # -- conditions ----------------------------------------------------------------------------------------------------

    def condition(self, c: Cond, home: Level) -> Truths:
        """Returns the truths of a condition whose children have names."""
        match c:
            case Truth():
                return (bool(c.data), not c.data)
            case Not():
                holds, fails = self.truths_of(c.operand, home)
                return (fails, holds)
            case And() | Or():
                parts = [self.truths_of(child, home) for child in c.children]
                both, either = ("and", "or") if isinstance(c, And) else ("or", "and")
                return (
                    self.assign(home, both, *(p[0] for p in parts)),
                    self.assign(home, either, *(p[1] for p in parts)),
                )
            case Compare():
                g = self._number_of(c.g, home)
                if c.resolution is not None:
                    return self.rounding.tie(c, g, home)
                ops = ("gt0", "le0") if c.strict else ("ge0", "lt0")
                return (self.assign(home, ops[0], g), self.assign(home, ops[1], g))
            case _:
                raise AssertionError(f"unknown condition {type(c).__name__}")

    # -- sizes ---------------------------------------------------------------------------------------------------------

    def size(self, e: Expr, home: Level) -> Arg:
        """Returns |e|."""
        return self.size_of(self.number(e, home), home)

    def size_of(self, value: Arg, home: Level) -> Arg:
        """Returns |value| of a named value."""
        return abs(value) if isinstance(value, float | int) else self.assign(home, "abs", value)


def _number(e: Expr) -> float:
    """Returns the value of a constant."""
    return cast(float, cast(Const, e).data)


def _less_one(e: Add) -> tuple[Expr, int] | None:
    """Returns u and 1 for exp(u) - 1, u and -1 for 1 - exp(u), else None."""
    if len(e.children) != 2:
        return None
    for one, term in (e.children, e.children[::-1]):
        sign = -1 if one is ONE else 1 if one is MINUS_ONE else 0
        if sign < 0 and isinstance(term, Mul) and len(term.children) == 2 and term.children[0] is MINUS_ONE:
            term = term.children[1]
        elif sign < 0:
            continue
        if sign and isinstance(term, Call) and term.name == "exp":
            return term.children[0], sign
    return None
