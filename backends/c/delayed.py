"""Flat programs that only a sum over gaps reads: they are run where there is a line at all.

An edge of which nothing is seen is a line of length 0. Most edges are such, and what stands in front of its candidates, which all of them
share, would be computed for nothing. Cost: a visit a step.
"""

from __future__ import annotations

from collections.abc import Sequence

from teg.program.arrays import ArrayProgram, Gaps, Run, Step, steps
from teg.program.fields import operands, result_names

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
    found: dict[int, list[Run]] = {}
    for k, gaps in enumerate(block):
        if isinstance(gaps, Gaps):
            inside = {id(step) for step in steps((gaps,))}
            needed = {gaps.first, gaps.last, gaps.lo, gaps.hi, *gaps.outer}  # what is read in front of the line
            waiting: list[Run] = []
            for step in reversed(block[:k]):
                names = result_names(step)
                if isinstance(step, Run) and needed.isdisjoint(names) and all(readers.get(name, {0}) <= inside for name in names):
                    waiting.insert(0, step)
                    inside.add(id(step))
            found[id(gaps)] = waiting
    return found
