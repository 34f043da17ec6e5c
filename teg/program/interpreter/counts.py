"""What a run does: how often integrands are evaluated, and functions whose sign decides where they jump.

Counted while the interpreter runs a program, so every branch that is not taken and every loop that ends early counts as it is. *Decisions*
are the signs of surface functions and of other conditions, half-planes and half-lines that a domain is clipped by, evaluations in a search
for roots, and in a choice among data the guards and keys of its candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from teg.program.arrays import ArrayProgram, Cells, Run
from teg.program.interpreter.arrays import ArrayMachine
from teg.program.interpreter.machine import Machine, Value
from teg.program.statements import Arg, Assign, Ellipse, Hyperbola, Isolate, Locate, Polygon, Polyhedron, Program, Segment, Stmt

SIGNS = frozenset(("gt0", "ge0", "lt0", "le0", "tie"))
CORNERS = 4
"""Values of a bilinear function that decide where its hyperbola lies."""


class Counts(NamedTuple):
    """The evaluations of integrands without an integral inside, and the decisions."""

    evaluations: int
    decisions: int


@dataclass
class CountingMachine(Machine):
    """A run that counts its decisions."""

    decisions: int = 0
    _searching: int = 0

    @staticmethod
    def of_program(program: Program, arguments: Sequence[float], order: int) -> CountingMachine:
        """Returns the state before the first statement."""
        return CountingMachine(program, order, {f"p{i}": float(x) for i, x in enumerate(arguments)})

    def at(self, block: Sequence[Stmt], values: Sequence[Arg], **variables: float) -> list[float]:
        self.decisions += self._searching > 0
        return super().at(block, values, **variables)

    def _operation(self, stmt: Assign) -> Value:
        self.decisions += stmt.op in SIGNS
        return super()._operation(stmt)

    def _results(self, stmt: Stmt) -> Sequence[float]:
        match stmt:
            case Polygon():
                self.decisions += len(stmt.half_planes)
            case Polyhedron():
                self.decisions += len(stmt.half_spaces)
            case Segment():
                self.decisions += len(stmt.half_lines)
            case Hyperbola() | Ellipse():
                self.decisions += CORNERS
            case _:
                pass
        searching = isinstance(stmt, Isolate | Locate)
        self._searching += searching
        results = super()._results(stmt)
        self._searching -= searching
        return results


def counts_of(program: Program, arguments: Sequence[float]) -> Counts:
    """Returns the counts of a run at one point; where a tie is met, those of both orders together."""
    first = CountingMachine.of_program(program, arguments, +1)
    first.outputs()
    runs = [first]
    if first.met:
        runs.append(CountingMachine.of_program(program, arguments, -1))
        runs[-1].outputs()
    return Counts(sum(m.evaluations for m in runs), sum(m.decisions for m in runs))


@dataclass
class _CountingArrays(ArrayMachine):
    """A run of a program with arrays that counts what its kernels do."""

    evaluations: int = 0
    decisions: int = 0

    def _kernel(self, step: Run) -> None:
        found = counts_of(step.program, [float(self.of(a)) for a in step.inputs])
        self.evaluations += found.evaluations
        self.decisions += found.decisions
        super()._kernel(step)

    def _cells(self, step: Cells) -> None:
        self.decisions += (self.of(step.hi) - self.of(step.lo)) * (step.shape.parts * step.shape.guards + 1)
        super()._cells(step)


def counts_of_arrays(program: ArrayProgram, arguments: Sequence[float], arrays: Sequence[Any]) -> Counts:
    """Returns the counts of a run for scalar arguments and arrays, as `interpret_arrays` takes them."""
    machine = _CountingArrays(arrays, {f"p{k}": float(x) for k, x in enumerate(arguments)})
    machine.run(program.body)
    return Counts(machine.evaluations, machine.decisions)
