"""Flat programs that only a sum over gaps reads: they are run where there is a line at all.

An edge of which nothing is seen is a line of length 0. Most edges are such, and what stands in front of its candidates, which all of them
share, would be computed for nothing. Cost: a visit a step.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.program.arrays import Arg, ArrayProgram, Gaps, Run, Step, steps
from teg.program.fields import operands

Readers = dict[str, set[int]]
"""The steps that read a name themselves, by their identity; 0 are the outputs of the program."""


def readers_of(program: ArrayProgram) -> Readers:
    """Returns the readers of every name."""
    found: Readers = {name: {0} for name in program.outputs if isinstance(name, str)}
    for step in steps(program.body):
        for name in operands(step):
            if isinstance(name, str):
                found.setdefault(name, set()).add(id(step))
    return found


def delayed(block: Sequence[Step], readers: Readers) -> dict[int, list[Run]]:
    """Returns the flat programs of a block that can wait for a sum over gaps, in order, by the identity of that sum."""
    waiting: dict[int, list[Run]] = {}
    reader: dict[int, int] = {}  # by a step that is run for a sum over gaps only: that sum
    in_front: set[Arg] = set()  # the names that are read to tell whether there is a line, and where it begins
    for step in reversed(block):
        if isinstance(step, Gaps):
            waiting[id(step)] = []
            reader |= dict.fromkeys(map(id, steps((step,))), id(step))
            in_front |= {step.first, step.last, step.lo, step.hi, *step.outer}
        elif isinstance(step, Run) and in_front.isdisjoint(step.results):
            sums = {reader.get(other) for name in step.results for other in readers.get(name, {0})}
            if len(sums) == 1 and (only := sums.pop()) is not None:
                waiting[only].append(step)
                reader[id(step)] = only
    return {key: runs[::-1] for key, runs in waiting.items()}
