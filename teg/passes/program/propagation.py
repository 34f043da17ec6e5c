"""Errors carried through the operations of a flat program, to first order.

    Δ(u + v) = Δu + Δv     Δ(u·v) = |v|·Δu + |u|·Δv + Δu·Δv     Δf(u) = |f′(u)|·Δu     (Higham 2002, chapter 3)

A condition g > 0 with |g| <= Δg is *doubtful*: a choice by it may be the other one. Exact values have no companion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from teg.program import INFINITE, Arg, Assign, Stmt
from teg.program.operations import letter_of

STEEP = ("div", "powi", "pow", "log", "log1p", "sqrt", "asin", "acos", "tan", "atan2")
"""Operations whose slope can be infinite."""
Errors = dict[Arg, Arg]
"""By name: the error of a number (0.0 if it is not there), or whether a condition is doubtful (False if it is not there)."""
Functions = dict[tuple[object, tuple[int, ...]], int]
"""The functions of a program and their derivatives, numbered."""


class Propagation:
    """The errors of names, and statements that carry them on. `fresh` makes names, and `functions` grows by derivatives."""

    def __init__(self, fresh: Callable[[str], str], functions: Functions) -> None:
        self.errors: Errors = {}
        self._fresh, self._functions = fresh, functions
        self._made: dict[Arg, Assign] = {}

    def error(self, arg: Arg) -> Arg:
        """Returns the error of a number."""
        return self.errors.get(arg, 0.0) if isinstance(arg, str) else 0.0

    def _doubt(self, arg: Arg) -> Arg:
        return self.errors.get(arg, False) if isinstance(arg, str) else False

    def op(self, out: list[Stmt], op: str, *args: Arg) -> Arg:
        """Returns the name of op(args)."""
        name = self._fresh(letter_of(op))
        out.append(Assign(name, op, args))
        return name

    def sum_of(self, parts: Iterable[Arg], out: list[Stmt]) -> Arg:
        """Returns the sum of errors."""
        kept = [p for p in parts if p != 0.0]
        if not kept:
            return 0.0
        return kept[0] if len(kept) == 1 else self.op(out, "add", *kept)

    def times(self, out: list[Stmt], size: Arg, error: Arg) -> Arg:
        """Returns |size|·error."""
        if error == 0.0:
            return 0.0
        return self.op(out, "mul", self.op(out, "abs", size), error)

    def carry(self, stmt: Assign, out: list[Stmt]) -> None:
        """Appends the companion of an assignment, if an argument has one."""
        op, args = stmt.op, stmt.args
        self._made[stmt.name] = stmt
        if not any(isinstance(a, str) and a in self.errors for a in args):
            return
        if op in ("and", "or", "not"):
            self.errors[stmt.name] = self._doubt_of(stmt, out)
        elif op in ("gt0", "ge0", "lt0", "le0", "tie"):
            error = self.error(args[0])
            if error != 0.0:
                near = self.op(out, "ge0", self.op(out, "sub", error, self.op(out, "abs", args[0])))
                self.errors[stmt.name] = self.op(out, "and", near, self.op(out, "gt0", error))  # 0 may be exact
        elif op != "ok":
            error = self._of_number(stmt, out)
            if op in STEEP and error != 0.0:  # an exact argument where the slope is infinite: 0·∞
                exact = self.op(out, "le0", self.sum_of(map(self.error, args), out))
                error = self.op(out, "select", exact, 0.0, error)
            if error != 0.0:
                self.errors[stmt.name] = error

    def _doubt_of(self, stmt: Assign, out: list[Stmt]) -> Arg:
        """Returns whether a condition is doubtful: an argument is, and no other one decides it without a doubt."""
        doubts = {a: d for a in stmt.args if (d := self._doubt(a)) is not False}
        doubtful = self._any(list(doubts.values()), out)
        if len(stmt.args) == 1:
            return doubtful
        deciding: list[Arg] = []
        for a in stmt.args:
            decides = a if stmt.op == "or" else self.op(out, "not", a)
            deciding.append(self.op(out, "and", decides, self.op(out, "not", doubts[a])) if a in doubts else decides)
        return self.op(out, "and", doubtful, self.op(out, "not", self._any(deciding, out)))

    def _any(self, conditions: list[Arg], out: list[Stmt]) -> Arg:
        return conditions[0] if len(conditions) == 1 else self.op(out, "or", *conditions)

    def _of_number(self, stmt: Assign, out: list[Stmt]) -> Arg:
        op, args, result = stmt.op, stmt.args, stmt.name

        def o(name: str, *operands: Arg) -> Arg:
            return self.op(out, name, *operands)

        errors = [self.error(a) for a in args]
        match op:
            case "add" | "sub":
                return self.sum_of(errors, out)
            case "neg" | "abs" | "sin" | "cos" | "atan" | "tanh" | "const":
                return errors[0]
            case "mul":
                return self._of_product(args, errors, out)
            case "div":
                quotient = self._unless_endless(args[1], self.times(out, result, errors[1]), out)
                return o("div", self.sum_of((errors[0], quotient), out), o("abs", args[1]))
            case "powi":
                n = int(args[1])
                error = self.times(out, o("mul", float(n), o("powi", args[0], n - 1)), errors[0])
                return self._unless_endless(args[0], error, out) if n < 0 else error
            case "pow":
                relative: Arg = 0.0 if errors[0] == 0.0 else o("div", errors[0], o("abs", args[0]))  # result/base may be infinite beside 0
                by_base = self.times(out, o("mul", args[1], result), relative)
                by_exponent = self.times(out, o("mul", result, o("log", args[0])), errors[1])
                return self.sum_of((by_base, by_exponent), out)
            case "min" | "max":
                return errors[0] if errors[1] == 0.0 else errors[1] if errors[0] == 0.0 else o("max", *errors)
            case "select":
                return self._of_choice(stmt, out)
            case "exp":
                return self.times(out, result, errors[0])
            case "expm1":
                return self.times(out, o("exp", args[0]), errors[0])
            case "log":
                return o("div", errors[0], o("abs", args[0]))
            case "log1p":
                return o("div", errors[0], o("abs", o("add", 1.0, args[0])))
            case "erf" | "erfc":  # the slope 2/√π·exp(-u²) where the argument may be nearest to 0
                nearest = o("max", 0.0, o("sub", o("abs", args[0]), errors[0]))
                bell = o("exp", o("neg", o("powi", nearest, 2)))
                return self.times(out, o("mul", 2.0 / math.sqrt(math.pi), bell), errors[0])
            case "sqrt":  # √(x + Δ) - √x <= Δ/√max(x, Δ)
                return o("div", errors[0], o("sqrt", o("max", args[0], errors[0])))
            case "tan":
                return self.times(out, o("add", 1.0, o("powi", result, 2)), errors[0])
            case "asin" | "acos":
                return o("div", errors[0], o("sqrt", o("sub", 1.0, o("powi", args[0], 2))))
            case "sinh" | "cosh":
                return self.times(out, o("add", 1.0, o("abs", result)), errors[0])
            case "atan2":
                square = o("add", o("powi", args[0], 2), o("powi", args[1], 2))
                return o("div", self.sum_of((self.times(out, args[1], errors[0]), self.times(out, args[0], errors[1])), out), square)
            case "floor" | "mod":
                return errors[0] if op == "mod" else 0.0
            case "call":
                return self._of_call(args, errors, out)
            case _:
                raise AssertionError(f"no error estimate for {op}")

    def _unless_endless(self, divisor: Arg, error: Arg, out: list[Stmt]) -> Arg:
        """Returns the error of a quotient that comes from its divisor: 0 where that is infinite, as cosh(u) far away is with its error."""
        if error == 0.0:
            return 0.0
        endless = self.op(out, "gt0", self.op(out, "sub", self.op(out, "abs", divisor), INFINITE))
        return self.op(out, "select", endless, 0.0, error)

    def _of_call(self, args: Sequence[Arg], errors: Sequence[Arg], out: list[Stmt]) -> Arg:
        """Returns the error of a function: input by input, by its derivatives."""
        callee, order = list(self._functions)[int(args[0])]
        parts = []
        for i, error in enumerate(errors[1:]):
            if error != 0.0:
                slope = (callee, (*order[:i], order[i] + 1, *order[i + 1 :]))
                k = self._functions.setdefault(slope, len(self._functions))
                parts.append(self.times(out, self.op(out, "call", k, *args[1:]), error))
        return self.sum_of(parts, out)

    def _of_product(self, args: Sequence[Arg], errors: Sequence[Arg], out: list[Stmt]) -> Arg:
        """Returns the error of a product, factor by factor: Δ(u·v) = |v|·Δu + |u|·Δv + Δu·Δv."""
        value, error = args[0], errors[0]
        for arg, more in zip(args[1:], errors[1:], strict=True):
            parts = [self.times(out, arg, error), self.times(out, value, more)]
            if error != 0.0 and more != 0.0:
                parts.append(self.op(out, "mul", error, more))
            error = self.sum_of(parts, out)
            value = self.op(out, "mul", value, arg)
        return error

    def _other_value(self, otherwise: Arg) -> Arg:
        """Returns the value taken if a condition did not hold, and not the NaN for a condition that neither holds nor fails."""
        made = self._made.get(otherwise)
        if made is not None and made.op == "select" and isinstance(made.args[2], float) and made.args[2] != made.args[2]:
            return made.args[1]
        return otherwise

    def _of_choice(self, stmt: Assign, out: list[Stmt]) -> Arg:
        """Returns the error of the value taken; if the choice is doubtful, with the distance of the other value."""
        condition, then, otherwise = stmt.args
        first, second = self.error(then), self.error(otherwise)
        chosen: Arg = first if first == second else self.op(out, "select", condition, first, second)
        doubt = self._doubt(condition)
        if doubt is False:
            return chosen
        other = self._other_value(otherwise)
        if isinstance(other, float) and other != other:  # NaN, where a condition neither holds nor fails
            return chosen
        apart = self.op(out, "abs", self.op(out, "sub", then, other))
        return self.op(out, "select", doubt, self.op(out, "add", apart, self.op(out, "max", first, second)), chosen)
