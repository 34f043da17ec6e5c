"""Error estimates carried through a flat program: for every output one more, an estimate of its error.

Errors begin in the integrals: each has its rule's own estimate (`Integrate.estimates`), to which the integral of its integrand's error
is added; where its integrand is a closed form, that is the rounding of the functions in it. Values computed from inexact numbers are
inexact to first order,

    Δ(u + v) = Δu + Δv     Δ(u·v) = |v|·Δu + |u|·Δv + Δu·Δv     Δf(u) = |f′(u)|·Δu     (Higham 2002, chapter 3)

and a condition g > 0 with |g| <= Δg is *doubtful*: a choice by it may be the other one. Exact values have no companion, so a program
without integrals of integrals gains a few statements. Linear in the size of the program.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import cast

from teg.passes.intrinsics import STATEMENTS
from teg.passes.lower.intrinsic import LEAST, ROUNDINGS
from teg.program import (
    EDGE,
    Arg,
    Assign,
    Called,
    Integrate,
    Isolate,
    Locate,
    Program,
    Sample,
    Stmt,
    SumOver,
    assigned,
    statements,
)
from teg.program.dce import without_dead_code
from teg.program.operations import letter_of

STEEP = ("div", "powi", "pow", "log", "log1p", "sqrt", "asin", "acos", "tan", "atan2")
"""Operations whose slope can be infinite."""
ROUNDED = ("sin", "cos", "exp", "expm1")
"""Functions of which closed forms are differences."""
Errors = dict[Arg, Arg]
"""By name: the error of a number (0.0 if it is not there), or whether a condition is doubtful (False if it is not there)."""


def with_error_estimates(program: Program) -> Program:
    """Returns the program with twice the outputs: the old ones, then an error estimate of each."""
    return _Estimator(program).run(ROUNDINGS)


def with_errors_of(program: Program, inexact: Sequence[int]) -> Program:
    """Returns the same for a part of a larger program: parameters of these numbers are inexact, and their errors are parameters behind the
    others.

    Roundings of the outputs are left to their users; an output without an error has the literal 0.0.
    """
    return _Estimator(program, inexact).run(0.0)


class _Estimator:
    def __init__(self, program: Program, inexact: Sequence[int] = ()) -> None:
        first = len(program.parameters)
        titles = (f"error of {program.parameters[i]}" for i in inexact)
        self.program = replace(program, parameters=(*program.parameters, *titles))
        self.errors: Errors = {f"p{i}": f"p{first + j}" for j, i in enumerate(inexact)}
        self._made: dict[Arg, Assign] = {}
        self._functions = {(f.callee, f.derivative): k for k, f in enumerate(program.functions)}
        self._lost: dict[Arg, Locate] = {}
        self._count = 0
        self._closed = False
        self._has_clusters = any(isinstance(stmt, Isolate) for stmt in statements(program.body))
        self._taken = {name for stmt in statements(program.body) for name in assigned(stmt)}

    def run(self, roundings: float) -> Program:
        body = self.block(self.program.body)
        ends: list[Stmt] = []
        errors = [self.sum_of((self.error(o), self._rounding(o, roundings, ends)), ends) for o in self.program.outputs]
        body, outputs = (*body, *ends), (*self.program.outputs, *errors)
        functions = tuple(Called(*f) for f in self._functions)
        return without_dead_code(Program(self.program.parameters, body, outputs, self.program.ties, functions))

    def _rounding(self, output: Arg, roundings: float, out: list[Stmt]) -> Arg:
        """Returns a few roundings of a value that is computed outside of all integrals."""
        if not isinstance(output, str) or not roundings:
            return 0.0
        return self.op(out, "mul", roundings, self.op(out, "abs", output))

    def fresh(self, kind: str) -> str:
        while True:
            self._count += 1
            name = f"{kind}{self._count}e"
            if name not in self._taken:
                return name

    def error(self, arg: Arg) -> Arg:
        return self.errors.get(arg, 0.0) if isinstance(arg, str) else 0.0

    def _doubt(self, arg: Arg) -> Arg:
        return self.errors.get(arg, False) if isinstance(arg, str) else False

    def block(self, block: Sequence[Stmt]) -> tuple[Stmt, ...]:
        """Returns a block with the companions of its values."""
        out: list[Stmt] = []
        for stmt in block:
            match stmt:
                case Assign():
                    out.append(stmt)
                    self._assignment(stmt, out)
                    if self._closed and stmt.op in ROUNDED:
                        self._rounded(stmt, out)
                case Integrate():
                    self._integral(stmt, out)
                case SumOver():
                    self._sum(stmt, out)
                case Sample():
                    self._sample(stmt, out)
                case Isolate():
                    stmt = replace(stmt, errors=tuple(self.fresh("v") for _ in stmt.results))
                    out.append(stmt)
                    self._roots(stmt, out)
                case Locate():
                    out.append(stmt)
                    if stmt.lost is not None:
                        self._lost.update(dict.fromkeys(stmt.results, stmt))
                case _ if type(stmt) in STATEMENTS:
                    STATEMENTS[type(stmt)].errors(self, stmt, out)
                case _:
                    raise AssertionError(f"no error estimate for {type(stmt).__name__}")
        return tuple(out)

    # -- statements ----------------------------------------------------------------------------------------------------

    def _integral(self, stmt: Integrate, out: list[Stmt]) -> None:
        """Appends an integral with the rule's estimates, and the integral of the error of the integrand.

        An inexact bound moves the result by the integrand's mean size, an inexact break by its mean size where it is not 0.
        """
        around, self._closed = self._closed, bool(stmt.ends) and not stmt.body  # means over pieces
        flags = self.block(stmt.flags)
        body = self._body(stmt)
        self._closed = around
        companions = [self.error(v) for v in stmt.values]
        inexact = [i for i, c in enumerate(companions) if c != 0.0]
        estimates = tuple(self.fresh("v") for _ in stmt.values)
        results = tuple(self.fresh("v") for _ in inexact)
        values = (*stmt.values, *(companions[i] for i in inexact))
        inside = self.sum_of(map(self.error, dict.fromkeys(stmt.breaks)), out)
        sizes: dict[int, tuple[Arg, Arg]] = {}
        if inside != 0.0:
            also = list(body)
            sizes = {i: self._size_and_extent(v, also) for i, v in enumerate(stmt.values)}
            body, values = tuple(also), (*values, *(v for pair in sizes.values() for v in pair))
            sizes = {i: (self.fresh("v"), self.fresh("v")) for i in sizes}
        found = (*stmt.results, *results, *(str(v) for pair in sizes.values() for v in pair))
        out.append(replace(stmt, flags=flags, body=body, values=values, results=found, estimates=estimates))
        more = dict(zip(inexact, results, strict=True))
        given_up = self._given_up(stmt, out)
        ends = self.sum_of((self.error(stmt.lo), self.error(stmt.hi)), out)
        for i, (result, estimate) in enumerate(zip(stmt.results, estimates, strict=True)):
            parts: list[Arg] = [estimate]
            if i in more:  # the companion is not negative, but the bounds may be reversed
                parts.append(self.op(out, "abs", more[i]))
            for part, area in given_up:
                parts.append(self.op(out, "mul", part, self.op(out, "add", area, self.op(out, "abs", result))))
            if ends != 0.0:
                length = self.op(out, "abs", self.op(out, "sub", stmt.hi, stmt.lo))
                parts.append(self.op(out, "mul", ends, self.op(out, "div", self.op(out, "abs", result), length)))
            if i in sizes:
                size, extent = (self.op(out, "abs", v) for v in sizes[i])
                mean = self.op(out, "div", size, self.op(out, "max", extent, LEAST))
                if self._has_clusters:  # a piece that is taken for empty hides the size of the integrand in it
                    mean = self.op(out, "select", self.op(out, "gt0", extent), mean, 1.0)
                parts.append(self.op(out, "mul", inside, mean))
            self.errors[result] = self.sum_of(parts, out)

    def _body(self, stmt: Integrate) -> tuple[Stmt, ...]:
        """Returns the body with companions.

        At the end of a piece where the integrand is a power that is not a multiple of ½, the variable is inexact: beside a singularity
        at c, (v - c)^-0.9 is known to the rounding of v only, which holds (ε|c|)^0.1 of the integral.
        """
        if not any(b.kind == "end" for b in stmt.bends):
            return self.block(stmt.body)
        rounded: list[Stmt] = []
        self.errors[stmt.var] = self.op(rounded, "mul", EDGE, self.op(rounded, "abs", stmt.var))
        body = self.block(stmt.body)
        self.errors.pop(stmt.var)
        return (*rounded, *body)

    def _given_up(self, stmt: Integrate, out: list[Stmt]) -> list[tuple[Arg, Arg]]:
        """Returns, for every rectangle in which the breaks of an integral were searched for, the part that was given up, and its area.

        An unseen region there is taken to be as dense as the integral, or to be 1. Of a boundary term the root of the part counts: a
        region of area A can have a perimeter of √A and more.
        """
        rectangles = dict.fromkeys(self._lost[b] for b in stmt.breaks if b in self._lost)
        border = any(isinstance(s, SumOver) for s in stmt.body)
        found: list[tuple[Arg, Arg]] = []
        for r in rectangles:
            area = self.op(out, "mul", *(self.op(out, "abs", self.op(out, "sub", q, p)) for p, q in ((r.lo, r.hi), (r.low, r.high))))
            lost = cast(Arg, r.lost)
            found.append((self.op(out, "sqrt", lost) if border else lost, area))
        return found

    def _size_and_extent(self, value: Arg, out: list[Stmt]) -> tuple[Arg, Arg]:
        """Returns |value|, and 1 where it is not 0."""
        size = self.op(out, "abs", value)
        return size, self.op(out, "select", self.op(out, "gt0", size), 1.0, 0.0)

    def _roots(self, stmt: Isolate, out: list[Stmt]) -> None:
        """Appends roots with their errors. A root in a cluster may be anywhere in it.

        A root of an inexact function is off by Δg/|g'|: both are computed there.
        """
        point = list(self.block(stmt.point))
        error = self.error(stmt.value)
        for root, cluster in zip(stmt.results, stmt.errors, strict=True):
            known = self.op(out, "gt0", self.op(out, "sub", math.inf, cluster))
            self.errors[root] = self.op(out, "select", known, cluster, 0.0)
        if error == 0.0 or not all(isinstance(s, Assign) for s in point):
            return
        slope = self.op(point, "max", self.op(point, "abs", stmt.slope), LEAST)
        off = self.op(point, "div", error, slope)
        for root in stmt.results:
            names: dict[Arg, Arg] = {}
            body = []
            for s in point:
                assert isinstance(s, Assign)
                args = tuple(names.get(a, a) if isinstance(a, str) else a for a in s.args)
                names[s.name] = self.fresh(s.name[0])
                body.append(Assign(str(names[s.name]), s.op, args))
            moved = self.fresh("v")
            out.append(SumOver(stmt.var, (root,), tuple(body), (names[off],), (moved,), stmt.when))
            self.errors[root] = self.op(out, "add", self.errors[root], moved)

    def _sum(self, stmt: SumOver, out: list[Stmt]) -> None:
        for error in {self.error(p): None for p in stmt.points if self.error(p) != 0.0}:
            known = self.error(stmt.var)
            self.errors[stmt.var] = error if known == 0.0 else self.op(out, "max", known, error)
        body = self.block(stmt.body)
        self.errors.pop(stmt.var, None)
        companions = [self.error(v) for v in stmt.values]
        inexact = [i for i, c in enumerate(companions) if c != 0.0]
        results = tuple(self.fresh("v") for _ in inexact)
        values = (*stmt.values, *(companions[i] for i in inexact))
        out.append(replace(stmt, body=body, values=values, results=(*stmt.results, *results)))
        self.errors.update(zip((stmt.results[i] for i in inexact), results, strict=True))

    def _sample(self, stmt: Sample, out: list[Stmt]) -> None:
        """Appends samples with their standard errors, and the means of the errors of the values at the points."""
        body = self.block(stmt.body)
        companions = [self.error(v) for v in stmt.values]
        inexact = [i for i, c in enumerate(companions) if c != 0.0]
        estimates = tuple(self.fresh("v") for _ in stmt.values)
        results = tuple(self.fresh("v") for _ in inexact)
        values = (*stmt.values, *(companions[i] for i in inexact))
        out.append(replace(stmt, body=body, values=values, results=(*stmt.results, *results), estimates=estimates))
        more = dict(zip(inexact, results, strict=True))
        for i, (result, estimate) in enumerate(zip(stmt.results, estimates, strict=True)):
            self.errors[result] = self.op(out, "add", estimate, self.op(out, "abs", more[i])) if i in more else estimate

    # -- operations ----------------------------------------------------------------------------------------------------

    def op(self, out: list[Stmt], op: str, *args: Arg) -> Arg:
        name = self.fresh(letter_of(op))
        out.append(Assign(name, op, args))
        return name

    def sum_of(self, parts: Iterable[Arg], out: list[Stmt]) -> Arg:
        kept = [p for p in parts if p != 0.0]
        if not kept:
            return 0.0
        return kept[0] if len(kept) == 1 else self.op(out, "add", *kept)

    def times(self, out: list[Stmt], size: Arg, error: Arg) -> Arg:
        """Returns |size|·error."""
        if error == 0.0:
            return 0.0
        return self.op(out, "mul", self.op(out, "abs", size), error)

    def _assignment(self, stmt: Assign, out: list[Stmt]) -> None:
        """Appends the companion of an assignment, if an argument has one."""
        op, args = stmt.op, stmt.args
        self._made[stmt.name] = stmt
        if not any(isinstance(a, str) and a in self.errors for a in args):
            return
        if op in ("and", "or", "not"):
            doubts = [d for d in map(self._doubt, args) if d is not False]
            self.errors[stmt.name] = doubts[0] if len(doubts) == 1 else self.op(out, "or", *doubts)
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

    def _rounded(self, stmt: Assign, out: list[Stmt]) -> None:
        """Appends the rounding of a function, and of its argument, in a closed form: differences of these may be small."""
        size: Arg = 1.0 if stmt.op in ("sin", "cos") else self.op(out, "abs", stmt.name)
        if stmt.op != "expm1":  # of an argument below 0, whose rounding is less than that of the result
            size = self.op(out, "mul", size, self.op(out, "max", 1.0, self.op(out, "abs", stmt.args[0])))
        self.errors[stmt.name] = self.sum_of((self.error(stmt.name), self.op(out, "mul", EDGE, size)), out)

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
                quotient = self.times(out, result, errors[1])
                return o("div", self.sum_of((errors[0], quotient), out), o("abs", args[1]))
            case "powi":
                n = int(args[1])
                return self.times(out, o("mul", float(n), o("powi", args[0], n - 1)), errors[0])
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
