"""Error estimates carried through a flat program: for every output one more, an estimate of its error.

Errors begin in the integrals: each has its rule's own estimate (`Integrate.estimates`), to which the integral of its integrand's error
is added; where its integrand is a closed form, that is the rounding of the functions in it. Values computed from inexact numbers are
inexact to first order (`propagation.py`). Exact values have no companion, so a program without integrals of integrals gains a few
statements. Roundings of the numbers that intrinsics depend on are companions of their own (`roundings.py`): they make no condition
doubtful. Linear in the size of the program.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from teg.passes.intrinsics import STATEMENTS
from teg.passes.lower.intrinsic import LEAST, ROUNDINGS
from teg.passes.program.propagation import Functions, Propagation
from teg.passes.program.roundings import Roundings
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

ROUNDED = ("sin", "cos", "exp", "expm1")
"""Functions of which closed forms are differences."""


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
        self._functions: Functions = {(f.callee, f.derivative): k for k, f in enumerate(program.functions)}
        self._carried = Propagation(self.fresh, self._functions)
        self.op, self.sum_of, self.times, self.error = self._carried.op, self._carried.sum_of, self._carried.times, self._carried.error
        self.errors = self._carried.errors
        self.errors.update({f"p{i}": f"p{first + j}" for j, i in enumerate(inexact)})
        self._roundings = Roundings(program, Propagation(self.fresh, self._functions))
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
        return without_dead_code(replace(self.program, body=body, outputs=outputs, functions=functions))

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

    def uncertainty(self, arg: Arg, out: list[Stmt]) -> Arg:
        """Returns the error of a number and of its roundings."""
        return self.sum_of((self.error(arg), self._roundings.of(arg)), out)

    def block(self, block: Sequence[Stmt]) -> tuple[Stmt, ...]:
        """Returns a block with the companions of its values."""
        out: list[Stmt] = []
        for stmt in block:
            match stmt:
                case Assign():
                    out.append(stmt)
                    self._carried.carry(stmt, out)
                    self._roundings.append(stmt, out)
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
        """Appends roots with their errors. A root in a cluster may be anywhere in it; an error e of a soft one counts as e^1.5/√|hi - lo|.

        A root of an inexact function is off by Δg/|g'|: both are computed there.
        """
        point = list(self.block(stmt.point))
        error = self.error(stmt.value)
        for root, cluster in zip(stmt.results, stmt.errors, strict=True):
            known = self.op(out, "gt0", self.op(out, "sub", math.inf, cluster))
            lost = self.op(out, "select", known, cluster, 0.0)
            if stmt.soft:
                extent = self.op(out, "max", self.op(out, "abs", self.op(out, "sub", stmt.hi, stmt.lo)), LEAST)
                lost = self.op(out, "mul", lost, self.op(out, "sqrt", self.op(out, "div", lost, extent)))
            self.errors[root] = lost
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

    def _rounded(self, stmt: Assign, out: list[Stmt]) -> None:
        """Appends the rounding of a function, and of its argument, in a closed form: differences of these may be small."""
        size: Arg = 1.0 if stmt.op in ("sin", "cos") else self.op(out, "abs", stmt.name)
        if stmt.op != "expm1":  # of an argument below 0, whose rounding is less than that of the result
            size = self.op(out, "mul", size, self.op(out, "max", 1.0, self.op(out, "abs", stmt.args[0])))
        self.errors[stmt.name] = self.sum_of((self.error(stmt.name), self.op(out, "mul", EDGE, size)), out)
