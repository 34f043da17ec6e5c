"""The nodes of a program: at which points it calls a function, and with which weights these calls enter its output.

A run in which the value of each call is 1 and remembers its origin. Sums, and products with numbers, of such values are noted on a tape.
Run backwards, the tape gives the derivative of the output by each call: its weight. Decisions (adaptive intervals, branches) are those of
the values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

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
    def of(program: Program, arguments: Sequence[float], order: int) -> NodeMachine:
        """Returns the state before the first statement."""
        machine = NodeMachine(program, order, {f"p{i}": float(x) for i, x in enumerate(arguments)})
        machine.tape = Tape()
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


def nodes_of(program: Program, arguments: Sequence[float]) -> Nodes:
    """Returns the nodes of a program of one output at one point; where a tie is met, those of both orders with half the weights."""
    first = NodeMachine.of(program, arguments, +1)
    runs = [(first, first.outputs()[0])]
    if first.met:
        second = NodeMachine.of(program, arguments, -1)
        runs.append((second, second.outputs()[0]))
    points, weights = [], []
    for machine, output in runs:
        for number, weight in machine.tape.weights(output).items():
            points.append(machine.tape.points[number])
            weights.append(weight / len(runs))
    output = sum(float(value) for _, value in runs) / len(runs)
    return Nodes(points, weights, output, any(m.missed for m, _ in runs), any(m.crowded for m, _ in runs))
