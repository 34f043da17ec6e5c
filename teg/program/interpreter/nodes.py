"""The nodes of a program: at which points it calls a function, and with which weights these calls enter its output.

A run in which the value of each call is 1 and remembers its origin. Sums, and products with numbers, of such values are noted on a tape.
Run backwards, the tape gives the derivative of the output by each call: its weight. Decisions (adaptive intervals, branches) are those of
the values. Programs with arrays have one tape for all their flat programs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

from teg.program.arrays import ArrayProgram, Run
from teg.program.interpreter.arrays import ArrayMachine
from teg.program.interpreter.machine import Machine, Value
from teg.program.operations import OPERATIONS
from teg.program.statements import Arg, Assign, Program

LINEAR = frozenset(("const", "add", "sub", "mul", "div", "neg", "select"))
"""Operations through which a value keeps its origin. Others use it for a decision, or not linearly: the sum of the weights shows that."""


@dataclass
class Tape:
    """The calls of a run, and the terms of each value that depends on them: (number of another value, factor)."""

    points: dict[int, tuple[float, ...]] = field(default_factory=dict)
    terms: list[tuple[tuple[int, float], ...]] = field(default_factory=list)

    def noted(self, value: float, *terms: tuple[Noted, float]) -> Noted:
        """Returns a value with its origin."""
        self.terms.append(tuple((part.number, factor) for part, factor in terms))
        return Noted(value, self, len(self.terms) - 1)

    def call(self, point: Sequence[float]) -> Noted:
        """Returns the value of a call at a point."""
        result = self.noted(1.0)
        self.points[result.number] = tuple(point)
        return result

    def weights(self, output: float) -> dict[int, float]:
        """Returns the derivative of an output by each call that counts."""
        slopes: dict[int, float] = {output.number: 1.0} if isinstance(output, Noted) else {}
        for number in range(max(slopes, default=-1), -1, -1):
            slope = slopes.get(number, 0.0)
            if slope:
                for part, factor in self.terms[number]:
                    slopes[part] = slopes.get(part, 0.0) + slope * factor
        return {number: slopes[number] for number in self.points if slopes.get(number, 0.0)}


class Noted(float):
    """A number that is a sum of calls of a function, with factors."""

    tape: Tape
    number: int

    def __new__(cls, value: float, tape: Tape, number: int) -> Noted:
        made = super().__new__(cls, value)
        made.tape, made.number = tape, number
        return made

    def __add__(self, other: float) -> Noted:
        second = ((other, 1.0),) if isinstance(other, Noted) else ()
        return self.tape.noted(float(self) + float(other), (self, 1.0), *second)

    __radd__ = __add__

    def __neg__(self) -> Noted:
        return self.tape.noted(-float(self), (self, -1.0))

    def __sub__(self, other: float) -> Noted:
        return self + (-other)

    def __rsub__(self, other: float) -> Noted:
        return -self + other

    def __mul__(self, other: float) -> Noted:
        second = ((other, float(self)),) if isinstance(other, Noted) else ()
        return self.tape.noted(float(self) * float(other), (self, float(other)), *second)

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> Noted:
        return self.tape.noted(float(self) / float(other), (self, 1.0 / float(other)))


class NodeMachine(Machine):
    """A run that keeps the origin of values on `tape`."""

    tape: Tape

    @staticmethod
    def of(program: Program, arguments: Sequence[float], order: int, tape: Tape) -> NodeMachine:
        """Returns the state before the first statement. Arguments that have an origin keep it."""
        machine = NodeMachine(program, order, {f"p{i}": x for i, x in enumerate(arguments)})
        machine.tape = tape
        return machine

    def number(self, arg: Arg) -> float:
        value = self.values[arg] if isinstance(arg, str) else arg
        return value if isinstance(value, Noted) else float(value)

    def _operation(self, stmt: Assign) -> Value:
        if stmt.op == "call":
            return self.tape.call([float(x) for x in self.numbers(stmt.args[1:])])
        args = [self.values[a] if isinstance(a, str) else a for a in stmt.args]
        if stmt.op == "const" and isinstance(args[0], Noted):
            return args[0]
        meaning = OPERATIONS[stmt.op].meaning
        if meaning is None:
            return super()._operation(stmt)
        if stmt.op not in LINEAR:
            args = [float(a) if type(a) is Noted else a for a in args]
        return meaning(*args)


@dataclass
class Nodes:
    """Points and weights of a run, its output, and whether it missed a tolerance or had no room for all roots."""

    points: list[tuple[float, ...]]
    weights: list[float]
    output: float
    missed: bool
    crowded: bool


def nodes_of(program: Program | ArrayProgram, arguments: Sequence[float], arrays: Sequence[Any] = ()) -> Nodes:
    """Returns the nodes of a program of one output at one point; where a tie is met, those of both orders with half the weights."""
    tape = Tape()
    run = _noted_arrays(program, arguments, arrays, tape) if isinstance(program, ArrayProgram) else _noted(program, arguments, tape)
    (output,) = run.outputs
    weights = tape.weights(output)
    return Nodes([tape.points[number] for number in weights], list(weights.values()), float(output), run.missed, run.crowded)


class _NotedRun(NamedTuple):
    """The outputs of a run, with their origins, and whether it missed a tolerance or had no room for all roots."""

    outputs: Sequence[float]
    missed: bool
    crowded: bool


def _noted(program: Program, arguments: Sequence[float], tape: Tape) -> _NotedRun:
    """Returns the run of a flat program; where a tie is met, the mean of both orders."""
    first = NodeMachine.of(program, arguments, +1, tape)
    outputs = first.outputs()
    if not first.met:
        return _NotedRun(outputs, first.missed, first.crowded)
    second = NodeMachine.of(program, arguments, -1, tape)
    mean = tuple(0.5 * a + 0.5 * b for a, b in zip(outputs, second.outputs(), strict=True))
    return _NotedRun(mean, first.missed or second.missed, first.crowded or second.crowded)


@dataclass
class _NodeArrays(ArrayMachine):
    """A run of a program with arrays that keeps the origin of values on `tape`. What chooses, or enters a table, is a plain number."""

    tape: Tape = field(default_factory=Tape)

    def number(self, arg: Arg) -> float:
        value = self.of(arg)
        return value if isinstance(value, Noted) else float(value)

    def _kernel(self, step: Run) -> None:
        run = _noted(step.program, [self.number(a) for a in step.inputs], self.tape)
        self.values.update(zip(step.results, run.outputs, strict=True))
        self.missed |= run.missed
        self.crowded |= run.crowded


def _noted_arrays(program: ArrayProgram, arguments: Sequence[float], arrays: Sequence[Any], tape: Tape) -> _NotedRun:
    """Returns the run of a program with arrays whose outputs are numbers."""
    machine = _NodeArrays(arrays, {f"p{k}": float(x) for k, x in enumerate(arguments)}, tape=tape)
    machine.run(program.body)
    return _NotedRun([machine.number(cast(Arg, output)) for output in program.outputs], machine.missed, machine.crowded)
