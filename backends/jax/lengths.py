"""How many lanes the iterations of loops take, before a program is traced: shapes in JAX are static.

From the shapes of arrays and the integer parameters, and where the bounds of a loop depend on index arrays, from their entries.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from teg.backends.plan import exactly
from teg.errors import ArrayIndexError
from teg.program.arrays import Arg, ArrayProgram, Integers, Loop, Step, steps

Whole = Any  # an int, or an array of them, one a lane


class Extents:
    """How many lanes the iterations of each loop take, at most, where it is met: `lengths`, by the id of the loop; how many iterations it
    has, at most, on one lane: `widest`.

    Where no bound of a loop depends on the index of another that is a product; else the iterations of outer loops are enumerated, in
    the blocks in which they will run.
    """

    def __init__(
        self,
        program: ArrayProgram,
        blocks: Mapping[int, int],
        shapes: Sequence[Sequence[int]],
        integers: Mapping[int, int],
        entries: Mapping[int, Any],
    ) -> None:
        self.program, self.blocks, self.shapes, self.integers, self.entries = program, blocks, shapes, integers, entries
        self.needed = _needed(program)
        loops = [s for s in steps(program.body) if isinstance(s, Loop)]
        moving = _depending(program, {s.index for s in loops})
        self.varying = any(isinstance(a, str) and a in moving for s in loops for a in (s.lo, s.hi))
        self.lengths: dict[int, int] = {id(s): 0 for s in loops}
        self.widest = dict(self.lengths)
        self._visit(program.body, {}, 1)

    def _visit(self, block: Sequence[Step], values: dict[Arg, Whole], size: int) -> None:
        """The loops of a block on so many lanes. Recursion is as deep as loops are."""
        for step in block:
            if isinstance(step, Integers) and step.name in self.needed:
                values[step.name] = self._integers(step, values)
            elif isinstance(step, Loop):
                self._loop(step, values, size)

    def _loop(self, step: Loop, values: dict[Arg, Whole], size: int) -> None:
        lo, hi = (a if isinstance(a, int) else values[a] for a in (step.lo, step.hi))
        block = self.blocks[id(step)]
        inner = any(isinstance(s, Loop) for s in step.body)
        if not self.varying:
            total = size * max(int(hi - lo), 0)
            self.lengths[id(step)], self.widest[id(step)] = total, max(int(hi - lo), 0)
            if total and inner:
                self._visit(step.body, dict(values), min(total, block))
            return
        counts = np.broadcast_to(np.maximum(np.asarray(hi) - np.asarray(lo), 0), (size,))
        self.widest[id(step)] = max(self.widest[id(step)], int(counts.max(initial=0)))
        ends = np.cumsum(counts)
        total = int(ends[-1]) if size else 0
        self.lengths[id(step)] = max(self.lengths[id(step)], total)
        for start in range(0, total, block) if inner else ():
            flat = np.arange(start, min(start + block, total))
            parent = np.searchsorted(ends, flat, side="right")
            inside = {name: v[parent] if np.ndim(v) else v for name, v in values.items()}
            before = np.where(parent > 0, ends[parent - 1], 0)
            inside[step.index] = flat - before + np.broadcast_to(np.asarray(lo), (size,))[parent]
            self._visit(step.body, inside, flat.size)

    def _integers(self, step: Integers, values: Mapping[Arg, Whole]) -> Whole:
        if step.op == "length":
            return int(self.shapes[step.array][int(step.args[0])])
        if step.op == "param":
            return self.integers[int(step.args[0])]
        args: list[Any] = [a if isinstance(a, int | float) else values[a] for a in step.args]
        if step.op == "gather":
            if step.array not in self.entries:
                name = self.program.arrays[step.array].name
                raise ArrayIndexError(
                    f"how many terms a sum has depends on {name}, whose entries are not known while JAX traces",
                    None,
                    f"give it as NumPy's array when the function is made: teg.jax_function(e, indices={{{name!r}: {name}}})",
                )
            return np.asarray(self.entries[step.array])[tuple(args)]
        found = exactly(step.op, np.asarray(args[0]), np.asarray(args[1]))
        return found if found.ndim else int(found)


def _needed(program: ArrayProgram) -> set[Arg]:
    """The integers that bounds of loops depend on."""
    order = list(steps(program.body))
    needed: set[Arg] = {a for s in order if isinstance(s, Loop) for a in (s.lo, s.hi)}
    for step in reversed(order):
        if isinstance(step, Integers) and step.name in needed:
            needed.update(step.args)
    return needed


def _depending(program: ArrayProgram, sources: set[str]) -> set[Arg]:
    """The integers that depend on any of these."""
    found: set[Arg] = set(sources)
    for step in steps(program.body):
        if isinstance(step, Integers) and step.op not in ("param", "length") and any(isinstance(a, str) and a in found for a in step.args):
            found.add(step.name)
    return found


def counting_arrays(program: ArrayProgram) -> set[int]:
    """The numbers of the index arrays that bounds of loops depend on."""
    needed = _needed(program)
    return {s.array for s in steps(program.body) if isinstance(s, Integers) and s.op == "gather" and s.name in needed}
