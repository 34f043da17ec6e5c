"""Iterations that surfaces cross, kept until there are as many as are computed side by side.

    push     an iteration writes the inputs of its flat program, and its indices, into the queue
    flush    the queue is computed by the line of points that surfaces cross; those that are not good by the program as it is

A queue belongs to the innermost loop whose flat program has such a line, and lives as long as one run of its *carrier*: the outermost loop
around it through which the results are only added up. Sums of the carrier take what the iterations give, whenever that is: each place
side by side has sums of its own, *lanes*, which are added up at the end, with those of iterations that need not wait.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from teg.backends.c.joined import joined
from teg.backends.c.lanes import SIDE
from teg.backends.c.text import indent
from teg.program.arrays import Arg, Integers, Loop, Run, Scatter, Step, steps
from teg.program.fields import operands, result_names


@dataclass(frozen=True, slots=True)
class Queue:
    """The queue of an innermost loop. `run` is computed of what waits, `chain` has the loops from the carrier to that one, `varying` the
    numbers of the inputs that change inside the carrier, `sums` the results of the carrier with the results of the flat program that are
    added to them, `integers` what the subscripts in `after` are computed from."""

    run: Run
    chain: tuple[Loop, ...]
    varying: tuple[int, ...]
    sums: tuple[tuple[str, Arg], ...]
    after: tuple[Scatter, ...]
    integers: tuple[Integers, ...]

    @property
    def carrier(self) -> Loop:
        """Returns the loop whose run the queue belongs to."""
        return self.chain[0]

    @property
    def indices(self) -> tuple[str, ...]:
        """Returns the indices that an entry has."""
        return tuple(loop.index for loop in self.chain) if self.after else ()

    @property
    def name(self) -> str:
        """Returns the last part of the names in C."""
        return self.run.results[0][1:]

    def opened(self) -> list[str]:
        """Returns the declaration of the queue."""
        name = self.name
        places = [f"int64_t place_{name}[{len(self.indices)}][{SIDE}];"] if self.indices else []
        lanes = [f"double lanes_{name}[{len(self.sums)}][{SIDE}] = {{{{0.0}}}};"] if self.sums else []
        return [f"double queue_{name}[{max(1, len(self.varying))}][{SIDE}];", *places, f"int waiting_{name} = 0;", *lanes]

    def into_lanes(self, value: str) -> list[str]:
        """Returns a loop that adds results of iterations side by side to the sums; `value` is one of them in C, {at} + k its place."""
        places = [SIDE * self.run.results.index(str(v)) for _, v in self.sums]
        each = [f"lanes_{self.name}[{m}][k] += {value.format(at=at)};" for m, at in enumerate(places)]
        return [f"for (int k = 0; k < {SIDE}; k++) {{", *indent(*each), "}"] if each else []

    def covered(self, lanes: str) -> list[str]:
        """Returns lines that add the results of the straight line where they are right, in the first of some lanes."""
        kept = f"for (int k = 0; k < {SIDE}; k++) kept[k] = fast[k] & (k < {lanes}) ? 1.0 : 0.0;"
        return [f"double kept[{SIDE}];", kept, *self.into_lanes("kept[k] != 0.0 ? f[{at} + k] : 0.0")]

    def closed(self) -> list[str]:
        """Returns lines that add up the lanes."""
        return [f"for (int k = 0; k < {SIDE}; k++) {total} += lanes_{self.name}[{m}][k];" for m, (total, _) in enumerate(self.sums)]


def with_enclosing(body: Sequence[Step]) -> Iterator[tuple[Loop, tuple[Loop, ...]]]:
    """Yields every loop that adds up with the loops around it, outermost first, up to one that does something else."""
    stack: list[tuple[Sequence[Step], tuple[Loop, ...]]] = [(body, ())]
    while stack:
        block, around = stack.pop()
        for step in block:
            if type(step) is Loop:
                yield step, around
                stack.append((step.body, (*around, step)))
            elif isinstance(step, Loop):
                stack.append((step.body, ()))


def queue_of(loop: Loop, run: Run, around: Sequence[Loop]) -> Queue | None:
    """Returns the queue of an innermost loop with one flat program; None if an iteration does more than add up its results."""
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
    inside = {name for s in steps(chain[0].body) for name in result_names(s)} | {step.index for step in _loops(chain)}
    run = joined(run, [s for s in steps(chain[0].body) if isinstance(s, Run) and s is not run])
    varying = tuple(i for i, arg in enumerate(run.inputs) if arg in inside)
    integers = _integers(chain, {a for s in scatters for a in s.subscripts})
    return None if integers is None else Queue(run, tuple(chain), varying, tuple(sums), scatters, integers)


def _loops(chain: Sequence[Loop]) -> Iterator[Loop]:
    for loop in chain:
        yield from (s for s in steps((loop,)) if isinstance(s, Loop))


def _integers(chain: Iterable[Loop], wanted: set[Arg]) -> tuple[Integers, ...] | None:
    """Returns the steps that compute integers inside of the loops; None if these steps need more than integers."""
    block = [s for loop in chain for s in loop.body if not isinstance(s, Loop)]
    kept: list[Integers] = []
    live = set(wanted)
    for step in reversed(block):
        if not live.isdisjoint(result_names(step)):
            if not isinstance(step, Integers):
                return None
            live.update(operands(step))
            kept.append(step)
    return tuple(reversed(kept))
