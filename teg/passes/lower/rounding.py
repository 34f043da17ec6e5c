"""Conditions that may be ties, and the rounding errors behind them.

A condition on a surface is a tie where it is 0 up to rounding: up to a few ε times Σ|terms|, and times the running error bound of its
terms (Wilkinson, Rounding Errors in Algebraic Processes, 1963).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

from teg.analysis.polynomial import Shadow
from teg.ir.expr import MINUS_ONE, Add, Call, Compare, Cond, Const, Expr, Mul, Param, Pow, Var, Where
from teg.ir.node import postorder
from teg.ir.traverse import fresh, replace_node
from teg.passes.lower.levels import Level, Truths
from teg.program import TIE_EPS, Arg

if TYPE_CHECKING:
    from teg.passes.lower.emit import Emitter

SHORT = 4
"""The degree up to which a polynomial without roots on a piece is not nearly 0 in the middle of it."""
CLEAR = 2.0**10 * TIE_EPS
"""A function larger than this, relative to its scale, is certainly not 0."""
_EPSILON = 2.0**-52
_TINY = 2.0**-1022
_SLACK = 8.0
"""So many roundings of a product are within the factor 4 of `TIE_EPS`."""


class Rounding:
    """Statements for ties and for bounds of rounding errors, made with an emitter."""

    def __init__(self, out: Emitter) -> None:
        self.out = out

    def tie(self, c: Compare, g: Arg, home: Level) -> Truths:
        """Returns the truths of a condition on a surface: decided by its sign, or by its resolution where it ties."""
        holds_first = self.out.truths_of(cast(Cond, c.resolution), home)[0]
        scale = self.tie_scale(c.g, home)
        if home.elsewhere is not None and not c.g.has_integral and not self.is_short(c.g, home):
            g, scale = self._clearest(c.g, g, scale, home)
        if c in home.coincident:
            scale = self.out.assign(home, "select", home.coincident[c], scale, 0.0)
        k = self.out.number_of_tie(cast("tuple[str, str]", c.rivals), at_place=home.var is None)
        holds = self.out.assign(home, "tie", g, scale, holds_first, k)
        fails = self.out.assign(home, "not", holds)
        ok = self.out.assign(home, "ok", g)
        return (holds, self.out.assign(home, "and", fails, ok))

    def is_short(self, g: Expr, home: Level) -> bool:
        """Returns whether a function is a polynomial of low degree in the variable, or in its tangent.

        Such a function cannot be nearly 0 in the middle of a piece without roots.
        """
        x = cast(Var, home.var)
        if x not in g.free or home.twisted:
            return False
        calls = [n for n in postorder([g]) if isinstance(n, Call) and x in n.free]
        if len(calls) == 1 and calls[0].name == "tan":  # monotone between its poles, which are breaks
            mark = fresh("tan", g.free)
            in_tangent = cast(Expr, replace_node(g, calls[0], mark))
            x, g = (x, g) if x in in_tangent.free else (mark, in_tangent)
        degree = Shadow((x,)).degree(g)
        return degree is not None and degree <= SHORT

    def _clearest(self, e: Expr, g: Arg, scale: Arg, home: Level) -> tuple[Arg, Arg]:
        """Returns a function without roots on a piece, and its scale, at a place where it is not nearly 0.

        It has one sign there, so surfaces that only approach each other are told apart where they are apart; those that coincide are a
        tie at every place.
        """
        reach = self.out.assign(home, "mul", TIE_EPS, scale)
        unclear = self.out.assign(home, "ge0", self.out.assign(home, "sub", reach, self.out.size_of(g, home)))
        for other in cast("Callable[[], Sequence[Level]]", home.elsewhere)():
            there, room = self.out.number(e, other), self.tie_scale(e, other)
            away = self.out.assign(home, "sub", self.out.size_of(there, home), self.out.assign(home, "mul", CLEAR, room))
            better = self.out.assign(home, "and", unclear, self.out.assign(home, "gt0", away))
            g, scale = (self.out.assign(home, "select", better, new, old) for new, old in ((there, g), (room, scale)))
        return g, scale

    def tie_scale(self, g: Expr, home: Level) -> Arg:
        """Returns the scale of a tie: Σ|terms| of an atom, and the rounding errors of its terms. Times a few ε it bounds the atom's error
        near 0."""
        terms, error = self.terms_size(g, home), self.error(g, home)
        return terms if error == 0.0 else self.out.assign(home, "add", terms, error)

    def terms_size(self, g: Expr, home: Level) -> Arg:
        """Returns Σ|terms|, of the branch that is taken and after a numerical factor in front."""
        if isinstance(g, Where):
            holds = self.out.truths(g.condition, home)[0]
            return self.out.assign(home, "select", holds, self.terms_size(g.then, home), self.terms_size(g.otherwise, home))
        if isinstance(g, Mul) and len(g.children) == 2 and isinstance(g.children[0], Const):
            return self.out.assign(home, "mul", abs(g.children[0].data), self.terms_size(g.children[1], home))
        if not isinstance(g, Add):
            return self.out.size(g, home)
        return self.out.assign(home, "add", *(self.out.size(t, home) for t in g.children))

    def error(self, root: Expr, level: Level) -> Arg:
        """Returns a running error bound in units of ε. Parameters and variables are exact (except those in `errors`); each operation rounds
        once."""
        stack: list[tuple[Expr, Level]] = [(root, level)]
        while stack:
            e, at = stack[-1]
            home = self.out.home_of(e, at)
            if e in home.errors:
                stack.pop()
                continue
            inside: Sequence[Expr] = ()
            if isinstance(e, Add | Mul | Pow | Call) and not (isinstance(e, Call) and e.name in ("chosen", "exact")):
                inside = cast("Sequence[Expr]", e.children)
            elif isinstance(e, Where):
                inside = (e.then, e.otherwise)
            missing = [(c, home) for c in inside if c not in self.out.home_of(c, home).errors]
            if missing:
                stack.extend(missing)
                continue
            home.errors[e] = self._own_error(e, [self.out.home_of(c, home).errors[c] for c in inside], home)
            stack.pop()
        return self.out.home_of(root, level).errors[root]

    def _own_error(self, e: Expr, errors: list[Arg], home: Level) -> Arg:
        """Returns the bound for one operation, from those of its children."""

        def put(op: str, *args: Arg) -> Arg:
            return self.out.assign(home, op, *args)

        def size(child: Expr) -> Arg:
            return self.out.size(child, home)

        def total(*parts: Arg) -> Arg:
            kept = [p for p in parts if p != 0.0]
            return put("add", *kept) if len(kept) > 1 else kept[0] if kept else 0.0

        match e:
            case Const() | Param() | Var() | Call(name="chosen" | "exact"):
                return 0.0
            case Mul() if e.children[0] is MINUS_ONE and len(e.children) == 2:
                return errors[1]
            case Mul():
                carried = []
                for i, err in enumerate(errors):
                    if err != 0.0:
                        carried.append(put("mul", err, *(size(f) for j, f in enumerate(e.children) if j != i)))
                return total(size(e), *carried)
            case Pow():
                own = self._weighted(max(1.0, abs(e.exponent) / _SLACK), size(e), home)  # as many roundings as there are products
                if errors[0] == 0.0:
                    return own
                if e.exponent < 0:  # base^(k - 1) may overflow where the relative error and the power are finite
                    return total(own, put("mul", float(abs(e.exponent)), put("div", errors[0], size(e.base)), size(e)))
                return total(own, put("mul", float(abs(e.exponent)), errors[0], put("powi", size(e.base), e.exponent - 1)))
            case Where():
                return errors[0] if errors[0] == errors[1] else put("select", self.out.truths(e.condition, home)[0], *errors)
            case Call() if e.name == "magnitude":
                return errors[0]
            case Add() if len(e.children) > 2:  # partial sums can be larger than the sum
                return total(put("add", *(size(c) for c in e.children)), *errors)
            case Call() if any(error != 0.0 for error in errors):
                return total(size(e), *self._carried_by(e, errors, home))
            case Add():
                return total(size(e), *errors)
            case _:
                return size(e)

    def _weighted(self, weight: float, value: Arg, home: Level) -> Arg:
        """Returns weight·value."""
        return value if weight == 1.0 else self.out.assign(home, "mul", weight, value)

    def _carried_by(self, e: Call, errors: list[Arg], home: Level) -> list[Arg]:
        """Returns bounds of the errors of the arguments times the slopes of the function.

        A slope that is infinite at one point is taken an error away from there: the function changes by no more than a few times that.
        """

        def put(op: str, *args: Arg) -> Arg:
            return self.out.assign(home, op, *args)

        def over(error: Arg, size: Arg) -> Arg:
            """Returns error/size, 0 where both are 0: √0 of an exact 0 is exact."""
            return put("div", error, put("max", size, _TINY))

        first, u, error = self.out.size(e, home), self.out.size(e.children[0], home), errors[0]
        match e.name:
            case "exp" | "cosh":
                return [first if error == 1.0 else put("mul", error, first)]
            case "log":
                return [put("div", error, u)]
            case "log1p":
                return [put("div", error, put("abs", put("add", 1.0, self.out.number(e.children[0], home))))]
            case "erfinv" | "erfcinv":
                return [put("mul", error, put("exp", put("mul", first, first)))]
            case "erf" | "erfc":
                return [put("mul", 1.13, error)]  # the slope is at most 2/√π
            case "sqrt" | "root":
                return [over(error, put("add", first, put("sqrt", put("mul", _EPSILON, error))))]
            case "tan":
                return [put("mul", error, put("add", 1.0, put("mul", first, first)))]
            case "tanh":
                return [put("mul", error, put("abs", put("sub", 1.0, put("mul", first, first))))]
            case "sinh" | "expm1":
                return [put("mul", error, put("add", 1.0, first))]
            case "atan":
                return [put("div", error, put("add", 1.0, put("mul", u, u)))]
            case "asin" | "acos":
                away = put("abs", put("sub", 1.0, put("mul", u, u)))
                return [over(error, put("sqrt", put("add", away, put("mul", _EPSILON, error))))]
            case "pow":
                return self._carried_by_power(e, errors, home)
            case "atan2":
                v = self.out.size(e.children[1], home)
                square = put("add", put("mul", u, u), put("mul", v, v))
                return [over(put("add", put("mul", v, error), put("mul", u, errors[1])), square)]
            case _:  # sin, cos: slopes of at most 1; floor and mod between their steps
                return errors

    def _carried_by_power(self, e: Call, errors: list[Arg], home: Level) -> list[Arg]:
        """Returns bounds of the effect of the errors of base and exponent on a power: |y|·|x|^(y-1)·Δx and |log x|·|x|^y·Δy."""

        def put(op: str, *args: Arg) -> Arg:
            return self.out.assign(home, op, *args)

        base, exponent = self.out.size(e.children[0], home), self.out.number(e.children[1], home)
        parts: list[Arg] = []
        if errors[0] != 0.0:
            away = put("max", put("add", base, put("mul", _EPSILON, errors[0])), _TINY)
            steep = put("max", 1.0, put("abs", exponent)) if isinstance(exponent, str) else max(1.0, abs(exponent))
            parts.append(put("mul", errors[0], put("div", put("mul", steep, self.out.power(away, exponent, home)), away)))
        if errors[1] != 0.0:
            parts.append(put("mul", errors[1], self.out.size(e, home), put("abs", put("log", base))))
        return parts
