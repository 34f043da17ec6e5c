"""What vanishes where some numbers are 0, in flat programs and in steps around them, if no number is infinite or NaN."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from teg.program.arrays import AddTo, Integers, Load, Number, Run, Scatter, Step, Take
from teg.program.statements import Arg, Assign, Program
from teg.program.walk import statements

FLAT = Integers | Number | Load | Take | Run | AddTo | Scatter


def vanishing(program: Program, zeros: Collection[int]) -> set[int]:
    """Returns which outputs of a flat program are 0 where the parameters of these numbers are. Linear in the program.

    Sums of zeros are, and products with one; a selection is if both sides are 0, or NaN, which a condition on a NaN selects.
    """
    known = {f"p{i}" for i in zeros}

    def is_zero(arg: Arg) -> bool:
        return arg in known if isinstance(arg, str) else arg == 0.0 and not isinstance(arg, bool)

    def is_nothing(arg: Arg) -> bool:
        return is_zero(arg) or (isinstance(arg, float) and math.isnan(arg))

    for s in statements(program.body):
        match s:
            case Assign(name, "const" | "add" | "sub" | "neg" | "abs" | "min" | "max", args) if all(map(is_zero, args)):
                known.add(name)
            case Assign(name, "mul", args) if any(map(is_zero, args)):
                known.add(name)
            case Assign(name, "div", (numerator, _)) if is_zero(numerator):
                known.add(name)
            case Assign(name, "select", (_, x, y)) if is_nothing(x) and is_nothing(y):
                known.add(name)
            case _:
                pass
    return {j for j, output in enumerate(program.outputs) if is_zero(output)}


def with_zeros(body: Sequence[Step], zeros: Collection[str]) -> tuple[Step, ...]:
    """Returns the steps of an iteration without loops where the numbers of these names, taken from tables, are 0: they are not taken, and
    what is 0 is not added anywhere. Flat programs remain in their order, with literals among their inputs."""
    known, kept = set(zeros), list[Step]()
    for step in body:
        match step:
            case Take() if step.name in known:
                pass
            case AddTo() | Scatter() if step.value in known:
                pass
            case Run():
                inputs = tuple(0.0 if a in known else a for a in step.inputs)
                gone = vanishing(step.program, {i for i, a in enumerate(inputs) if not isinstance(a, str) and a == 0.0})
                known.update(step.results[j] for j in gone)
                kept.append(replace(step, inputs=inputs))
            case _:
                kept.append(step)
    return tuple(kept)
