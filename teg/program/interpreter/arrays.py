"""The meaning of programs with arrays: loops are loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, assert_never

from teg.program.arrays import Arg, ArrayProgram, Integers, Like, Load, Loop, Number, Run, Scatter, Step
from teg.program.interpreter.machine import interpret
from teg.program.operations import INTEGER_OPERATIONS

Entries = dict[tuple[int, ...], float]
"""An array that was scattered into, by subscripts; entries that are not there are 0."""


class InterpretedArrays(NamedTuple):
    """The outputs, whether a tolerance was missed, and whether a search found more roots than it has room for."""

    outputs: tuple[float | Entries, ...]
    missed: bool
    crowded: bool


def interpret_arrays(program: ArrayProgram, arguments: Sequence[float], arrays: Sequence[Any]) -> InterpretedArrays:
    """The outputs of a program for scalar arguments and arrays, which have a `shape` and are indexed by tuples."""
    machine = _Machine(arrays, {f"p{k}": float(x) for k, x in enumerate(arguments)})
    machine.run(program.body)
    outputs = (machine.scattered.get(k, {}) if isinstance(o, Like) else float(machine.of(o)) for k, o in enumerate(program.outputs))
    return InterpretedArrays(tuple(outputs), machine.missed, machine.crowded)


@dataclass
class _Machine:
    """One run: the given arrays, the values of all names so far, what was scattered into outputs, by their numbers."""

    arrays: Sequence[Any]
    values: dict[str, float | int]
    scattered: dict[int, Entries] = field(default_factory=dict)
    missed: bool = False
    crowded: bool = False

    def of(self, arg: Arg) -> Any:
        """What a name or a literal stands for."""
        return self.values[arg] if isinstance(arg, str) else arg

    def run(self, block: Sequence[Step]) -> None:
        """Run the steps of a block. Recursion is as deep as loops are."""
        for step in block:
            match step:
                case Integers():
                    self.values[step.name] = self._integer(step)
                case Load():
                    self.values[step.name] = float(self.arrays[step.array][self._places(step.subscripts)])
                case Number():
                    self.values[step.name] = float(self.of(step.integer))
                case Run():
                    self._kernel(step)
                case Loop():
                    self._loop(step)
                case Scatter():
                    entries = self.scattered.setdefault(step.output, {})
                    place = self._places(step.subscripts)
                    entries[place] = entries.get(place, 0.0) + float(self.of(step.value))
                case _:
                    assert_never(step)

    def _places(self, subscripts: Sequence[Arg]) -> tuple[int, ...]:
        return tuple(self.of(s) for s in subscripts)

    def _integer(self, step: Integers) -> int:
        match step.op:
            case "gather":
                return int(self.arrays[step.array][self._places(step.args)])
            case "length":
                return int(self.arrays[step.array].shape[int(step.args[0])])
            case "param":
                return int(self.values[f"p{step.args[0]}"])
            case _:
                first, second = (self.of(a) for a in step.args)
                return INTEGER_OPERATIONS[step.op](first, second)

    def _kernel(self, step: Run) -> None:
        found = interpret(step.program, [float(self.of(a)) for a in step.inputs])
        self.values.update(zip(step.results, found.outputs, strict=True))
        self.missed |= found.missed
        self.crowded |= found.crowded

    def _loop(self, step: Loop) -> None:
        sums = [0.0] * len(step.results)
        for i in range(self.of(step.lo), self.of(step.hi)):
            self.values[step.index] = i
            self.run(step.body)
            sums = [s + float(self.of(v)) for s, v in zip(sums, step.values, strict=True)]
        self.values.update(zip(step.results, sums, strict=True))
