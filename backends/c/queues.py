"""Iterations that surfaces cross, kept until there are as many as are computed side by side.

    push     an iteration writes the inputs of its flat program, and its indices, into the queue
    flush    the queue is computed by the line of points that surfaces cross; those that are not good by the program as it is

Most points are crossed by one half-plane's border only. They wait in queues of their own, one for each half-plane, because their line is
half as long. What it assumes it checks, so that which queue a point waits in may be decided roughly.

A queue belongs to the innermost loop whose flat program has such a line, and lives as long as one run of its *carrier*: the outermost loop
around it through which the results are only added up. Sums of the carrier take what the iterations give, whenever that is: each place
side by side has sums of its own, *lanes*, which are added up at the end, with those of iterations that need not wait.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from teg.backends.c.lanes import SIDE
from teg.backends.c.text import indent
from teg.program.arrays import Arg, Integers, Loop, Run, Scatter
from teg.program.fields import operands, result_names
from teg.program.joined import joined
from teg.program.summed import Summed


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

    @property
    def added(self) -> list[int]:
        """Returns which results of the flat program are added to the sums."""
        return [self.run.results.index(str(v)) for _, v in self.sums]

    def room(self, apart: int) -> str:
        """Returns the declaration of the queue's numbers, and of those of one for each of the half-planes that are told `apart`."""
        return f"double queue_{self.name}[{1 + apart}][{max(1, len(self.varying))}][{SIDE}] = {{{{{{0.0}}}}}};"

    def opened(self, apart: int) -> list[str]:
        """Returns the declaration of what a run of the carrier begins with."""
        name, n = self.name, 1 + apart
        places = [f"int64_t place_{name}[{len(self.indices)}][{SIDE}];"] if self.indices else []
        lanes = [f"double lanes_{name}[{len(self.sums)}][{SIDE}] = {{{{0.0}}}};"] if self.sums else []
        lines = [1 + h if held == (1 << apart) - 1 - (1 << h) else 0 for held in range(1 << apart) for h in [_missing(held, apart)]]
        table = [f"static const unsigned char line_of_{name}[{len(lines)}] = {{{', '.join(map(str, lines))}}};"] if apart else []
        return [
            *places,
            f"int waiting_{name}[{n}] = {{0}};",
            *lanes,
            *table,
        ]

    def into_lanes(self, value: str) -> list[str]:
        """Returns a loop that adds results of iterations side by side to the sums; `value` is one of them in C, {at} + k its place."""
        each = [f"lanes_{self.name}[{m}][k] += {value.format(at=SIDE * j)};" for m, j in enumerate(self.added)]
        return [f"for (int k = 0; k < {SIDE}; k++) {{", *indent(*each), "}"] if each else []

    def covered(self, lanes: str) -> list[str]:
        """Returns lines that add the results of the straight line where they are right, in the first of some lanes."""
        kept = f"for (int k = 0; k < {SIDE}; k++) kept[k] = fast[k] & (k < {lanes}) ? 1.0 : 0.0;"
        return [f"double kept[{SIDE}];", kept, *self.into_lanes("kept[k] != 0.0 ? f[{at} + k] : 0.0")]

    def closed(self) -> list[str]:
        """Returns lines that add up the lanes."""
        return [f"for (int k = 0; k < {SIDE}; k++) {total} += lanes_{self.name}[{m}][k];" for m, (total, _) in enumerate(self.sums)]


def _missing(bits: int, count: int) -> int:
    """Returns the first of some bits that is 0; 0 if none is."""
    return next((h for h in range(count) if not bits >> h & 1), 0)


def queue_of(found: Summed) -> Queue | None:
    """Returns the queue of a flat program that is summed up; None if what is scattered needs more than integers."""
    run, inside = joined(found.run, found.makers), found.names
    varying = tuple(i for i, arg in enumerate(run.inputs) if arg in inside)
    integers = _integers(found.chain, {a for s in found.after for a in s.subscripts})
    return None if integers is None else Queue(run, found.chain, varying, found.sums, found.after, integers)


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
