"""The state of one run, the meaning of the simple statements, and the two runs that a program with ties takes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, assert_never

from teg.numerics.sobol import random_coordinate, replicated, sobol_coordinate
from teg.program.fields import absent
from teg.program.interpreter.arcs import ellipse
from teg.program.interpreter.clipped import polygon, segment
from teg.program.interpreter.integrate import integrate, is_leaf
from teg.program.interpreter.isolate import isolate
from teg.program.interpreter.locate import locate
from teg.program.interpreter.moments import hyperbola
from teg.program.interpreter.polyhedra import polyhedron
from teg.program.limits import SAME_MEANS, TIE_EPS
from teg.program.operations import OPERATIONS
from teg.program.statements import (
    Arg,
    Assign,
    Ellipse,
    Hyperbola,
    Integrate,
    Isolate,
    Locate,
    Polygon,
    Polyhedron,
    Program,
    Sample,
    Segment,
    Stmt,
    SumOver,
    When,
)
from teg.program.walk import assigned

Value = float | bool


class Interpreted(NamedTuple):
    """The results of a run: the outputs, the numbers of the ties that were met, whether a tolerance was missed, whether a search found more
    roots than it has room for, and the number of points at which integrands without integrals inside were evaluated."""

    outputs: tuple[float, ...]
    ties: tuple[int, ...]
    missed: bool
    crowded: bool
    evaluations: int


def interpret(program: Program, arguments: Sequence[float]) -> Interpreted:
    """Returns the outputs of a program at one point; where a tie is met, the mean of both orders."""
    first = Machine.of_program(program, arguments, +1)
    outputs = first.outputs()
    if not first.met:
        return Interpreted(outputs, (), first.missed, first.crowded, first.evaluations)
    second = Machine.of_program(program, arguments, -1)
    mean = tuple(0.5 * a + 0.5 * b for a, b in zip(outputs, second.outputs(), strict=True))
    missed, crowded = first.missed or second.missed, first.crowded or second.crowded
    return Interpreted(mean, tuple(sorted(first.met | second.met)), missed, crowded, first.evaluations + second.evaluations)


@dataclass
class Machine:
    """The state of a run of a program in one order of ties: the values of all names so far, and the notes of the run. Names are unique in a
    program, so blocks share one table; running a block again replaces its values."""

    program: Program
    order: int
    values: dict[str, Value]
    met: set[int] = field(default_factory=set)
    missed: bool = False
    crowded: bool = False
    evaluations: int = 0

    @staticmethod
    def of_program(program: Program, arguments: Sequence[float], order: int) -> Machine:
        """Returns the state before the first statement."""
        assert len(arguments) == len(program.parameters)
        return Machine(program, order, {f"p{i}": float(x) for i, x in enumerate(arguments)})

    def outputs(self) -> tuple[float, ...]:
        """Run the program; its outputs."""
        self.run(self.program.body)
        return tuple(self.numbers(self.program.outputs))

    def number(self, arg: Arg) -> float:
        """Returns the number that a name or a literal stands for."""
        return float(self.values[arg] if isinstance(arg, str) else arg)

    def numbers(self, args: Sequence[Arg]) -> list[float]:
        """Returns the numbers that names or literals stand for."""
        return [self.number(arg) for arg in args]

    def holds(self, arg: Arg | None) -> bool:
        """Returns whether a condition holds; one that is not there does."""
        return arg is None or bool(self.values[arg] if isinstance(arg, str) else arg)

    def at(self, block: Sequence[Stmt], values: Sequence[Arg], **variables: float) -> list[float]:
        """Returns the numbers that are known after a block was run with these values of its variables."""
        self.values.update(variables)
        self.run(block)
        return self.numbers(values)

    def run(self, block: Sequence[Stmt]) -> None:
        """Run the statements of a block. Recursion is as deep as blocks are in each other."""
        for stmt in block:
            if isinstance(stmt, Assign):
                self.values[stmt.name] = self._operation(stmt)
            elif not self.holds(stmt.when):
                self.values.update(absent(stmt))
            elif isinstance(stmt, When):
                self.run(stmt.body)
            else:
                self.values.update(zip(assigned(stmt), self._results(stmt), strict=True))

    def _results(self, stmt: Stmt) -> Sequence[float]:
        """Returns the numbers that a statement with blocks gives its results, where its condition holds."""
        match stmt:
            case Integrate():
                return integrate(self, stmt)
            case Isolate():
                return isolate(self, stmt)
            case Locate():
                return locate(self, stmt)
            case SumOver():
                return self._sum(stmt)
            case Sample():
                return self._mean(stmt)
            case Polygon():
                return polygon(self, stmt)
            case Polyhedron():
                return polyhedron(self, stmt)
            case Segment():
                return segment(self, stmt)
            case Hyperbola():
                return hyperbola(self, stmt)
            case Ellipse():
                return ellipse(self, stmt)
            case Assign() | When():
                raise AssertionError("has no numbers of its own")
            case _:
                assert_never(stmt)

    def _operation(self, stmt: Assign) -> Value:
        if stmt.op == "call":
            body = self.program.functions[int(stmt.args[0])].body
            assert body is not None, "a function without a body"
            return Machine.of_program(body, self.numbers(stmt.args[1:]), self.order).outputs()[0]
        args = [self.values[a] if isinstance(a, str) else a for a in stmt.args]
        if stmt.op == "tie":
            g, scale, resolution, k = args
            if abs(g) <= TIE_EPS * scale and math.isfinite(g):
                self.met.add(int(k))
                return bool(resolution) if self.order > 0 else not resolution
            return g > 0.0
        meaning = OPERATIONS[stmt.op].meaning
        assert meaning is not None
        return meaning(*args)

    def _sum(self, stmt: SumOver) -> list[float]:
        sums = [0.0] * len(stmt.results)
        points = self.numbers(stmt.points)
        if any(math.isnan(x) for x in points):
            return [math.nan] * len(sums)
        for x in points:
            if math.isfinite(x):
                values = self.at(stmt.body, stmt.values, **{stmt.var: x})
                sums = [s + v for s, v in zip(sums, values, strict=True)]
        return sums

    def _mean(self, stmt: Sample) -> list[float]:
        count, tested = len(stmt.values), len(stmt.estimates)
        replicates, each = replicated(stmt.kind, stmt.count)
        rows: list[list[list[float]]] = [[] for _ in range(replicates)]  # of each replicate, the values at its points
        for r in range(replicates):
            for i in range(each):
                at = {name: _coordinate(stmt, r, i, d) for d, name in enumerate(stmt.points)}
                rows[r].append(self.at(stmt.body, stmt.values, **at))
        self.evaluations += replicates * each if is_leaf(stmt) else 0
        means = [[sum(row[j] for row in part) / each for j in range(count)] for part in rows]
        mean = [sum(m[j] for m in means) / replicates for j in range(count)]
        return [
            *mean,
            *(_standard_error([m[j] for m in means], [[row[j] for row in part] for part in rows], mean[j]) for j in range(tested)),
        ]


def _coordinate(stmt: Sample, replicate: int, index: int, dimension: int) -> float:
    if stmt.kind == "montecarlo":
        return random_coordinate(stmt.seed, index, dimension)
    return sobol_coordinate(stmt.seed, replicate, index, dimension)


def _standard_error(means: Sequence[float], values: Sequence[Sequence[float]], mean: float) -> float:
    """Returns the standard error of the mean of several means, or of one mean of all values. Squares are computed relative to the first
    value of a replicate, so that nothing cancels."""
    r, n = len(means), len(values[0])
    if not math.isfinite(mean) or r * n == 1:
        return math.nan
    scatter = sum((m - mean) ** 2 for m in means)
    squares = n * scatter
    for m, (first, *others) in zip(means, values, strict=True):
        squares += max(sum((v - first) ** 2 for v in others) - n * (m - first) ** 2, 0.0)
    if r == 1:
        return math.sqrt(squares / (n - 1.0) / n)
    variance = squares / (r * n)
    hidden = scatter <= SAME_MEANS**2 * (mean**2 + variance)
    return math.sqrt(max(scatter / (r * (r - 1.0)), variance / n**2 if hidden else 0.0))
