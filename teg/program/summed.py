"""Flat programs whose results are only summed up, by the loops around them.

for i:  for j:  r = flat program(i, j);  s += r        the carrier: the outermost loop through which r is only added up
… s …                                                  what it adds up is used behind it
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from teg.program.arrays import Arg, Loop, Run, Scatter, Step, steps
from teg.program.fields import operands, result_names


@dataclass(frozen=True, slots=True)
class Summed:
    """A flat program in an innermost loop. `chain` has the loops from the carrier to that one, `sums` the results of the carrier with the
    results of the flat program that are added to them, `after` what an iteration scatters."""

    run: Run
    chain: tuple[Loop, ...]
    sums: tuple[tuple[str, Arg], ...]
    after: tuple[Scatter, ...]

    @property
    def carrier(self) -> Loop:
        """Returns the loop behind which the sums are used."""
        return self.chain[0]

    @property
    def names(self) -> set[str]:
        """Returns the names that are computed in the carrier, and the indices of its loops."""
        loops = [self.carrier, *(s for s in steps(self.carrier.body) if isinstance(s, Loop))]
        return {name for s in steps(self.carrier.body) for name in result_names(s)} | {loop.index for loop in loops}

    @property
    def makers(self) -> list[Run]:
        """Returns the other flat programs in the carrier."""
        return [s for s in steps(self.carrier.body) if isinstance(s, Run) and s is not self.run]


def with_enclosing(body: Sequence[Step]) -> Iterator[tuple[Loop, tuple[Loop, ...]]]:
    """Yields every loop that adds up with the loops around it, outermost first, up to one that does something else."""
    stack: list[tuple[Sequence[Step], tuple[Loop, ...]]] = [(body, ())]
    while stack:
        block, around = stack.pop()
        for step in block:
            if type(step) is Loop and step.listed < 0:
                yield step, around
                stack.append((step.body, (*around, step)))
            elif isinstance(step, Loop):
                stack.append((step.body, ()))


def summed(loop: Loop, run: Run, around: Sequence[Loop]) -> Summed | None:
    """Returns the loops through which the results of a flat program are added up; None if an iteration does more than that."""
    after = loop.body[loop.body.index(run) + 1 :]
    sums: list[tuple[str, Arg]] = list(zip(loop.results, loop.values, strict=True))
    given = set(run.results)
    scatters = tuple(s for s in after if isinstance(s, Scatter))
    if len(scatters) < len(after) or not given.issuperset([v for _, v in sums] + [s.value for s in scatters]):
        return None
    chain = [loop]
    for outer in reversed(around):
        results = set(chain[0].results)
        others = list(steps(tuple(s for s in outer.body if s is not chain[0])))
        read = {a for s in others for a in operands(s)} | {v for s in others if isinstance(s, Loop) for v in s.values}
        if not results.isdisjoint(read):
            break
        known = dict(sums)
        sums = [(r, known[v]) for r, v in zip(outer.results, outer.values, strict=True) if isinstance(v, str) and v in known]
        chain.insert(0, outer)
    return Summed(run, tuple(chain), tuple(sums), scatters)
