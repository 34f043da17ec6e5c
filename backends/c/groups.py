"""Loops around the carrier of a queue: what an iteration computes before its carrier and behind it is computed for eight side by side.

    for eight iterations:
        for each:   read data                           into arrays
        flat programs before the carrier, and what all that waits in its queue shares
        for each:   the carrier
        flat programs behind it
        for each:   scatter, add up

A short carrier takes less time than the flat programs around it would take one by one (the pixels of a small triangle, say).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from teg.backends.c.lane_functions import signature, straight, used_inputs
from teg.backends.c.lanes import SIDE, WIDE, WIDEST, Packed, as_products, decisive_branch
from teg.backends.c.steps import array_of
from teg.backends.c.text import indent, spelled, wrapped
from teg.program import Assign, Program, assigned, statements, without_branches
from teg.program.arrays import Arg, Integers, Load, Loop, Number, Run, Scatter, Step
from teg.program.fields import operands, result_names
from teg.program.names import unused_numbers


@dataclass(frozen=True, slots=True)
class Around:
    """A loop around a carrier, and the steps of an iteration before the carrier and behind it."""

    loop: Loop
    before: tuple[Step, ...]
    carrier: Loop
    after: tuple[Step, ...]

    @property
    def index(self) -> str:
        """Returns the index of the loop."""
        return self.loop.index

    @property
    def at(self) -> str:
        """Returns the number of an iteration among the eight in C."""
        return f"{self.index}_at"

    @property
    def made(self) -> set[str]:
        """Returns the numbers that an iteration has before the carrier."""
        return {name for s in self.before if not isinstance(s, Integers) for name in result_names(s)}

    @property
    def integers(self) -> list[Integers]:
        """Returns the steps that compute integers."""
        return [s for s in (*self.before, *self.after) if isinstance(s, Integers)]

    @property
    def read(self) -> list[Step]:
        """Returns the steps before the carrier that are not computed side by side."""
        return [s for s in self.before if not isinstance(s, Run)]

    def columns(self) -> dict[Arg, str]:
        """Returns where the numbers of eight iterations lie in C."""
        found: dict[Arg, str] = {s.name: f"{s.name}_eight" for s in self.before if isinstance(s, Number | Load)}
        found |= {name: f"{name}_eight" for name in self.carrier.results}
        for s in (*self.before, *self.after):
            if isinstance(s, Run):
                found |= {name: f"({array_of(s)}_eight + {SIDE * j})" for j, name in enumerate(s.results)}
        return found


def around_carrier(loop: Loop | None, carrier: Loop) -> Around | None:
    """Returns a loop around a carrier if all else that it does can be done for eight iterations side by side."""
    if loop is None or type(loop) is not Loop or loop.listed >= 0:
        return None
    cut = next(n for n, s in enumerate(loop.body) if s is carrier)
    before, after = loop.body[:cut], loop.body[cut + 1 :]
    if not all(isinstance(s, Integers | Number | Load | Run) for s in before):
        return None
    if not all(isinstance(s, Integers | Run | Scatter) for s in after):
        return None
    runs = [s for s in (*before, *after) if isinstance(s, Run)]
    return Around(loop, before, carrier, after) if runs and all(_simple(s.program) for s in runs) else None


def _simple(program: Program) -> list[Assign] | None:
    """Returns the operations of a program that has nothing else, and none that C compilers do not compute side by side."""
    if decisive_branch(program) is not None:
        return None  # an iteration may end there
    body = without_branches(program).body
    names = (f"v{n}" for n in unused_numbers(n for s in statements(body) for n in assigned(s)))
    found: list[Assign] = []
    for s in body:
        if not isinstance(s, Assign):
            return None
        found += as_products(s, names) if s.op == "powi" else [s]
    return found if len(found) <= WIDEST and all(s.op in WIDE for s in found) else None


def function(program: Program, varying: Sequence[int]) -> tuple[str, list[int]]:
    """Returns the C function @ of a program for eight points side by side, and the inputs that it reads; those in `varying` differ."""
    body = _simple(program)
    assert body is not None
    found = Packed(True, True, (), (), tuple(body), program.outputs, wide=True)
    inputs = used_inputs(found)[1]
    head = f"TEG_EIGHT void @({signature(inputs, varying, 'double *restrict f')})"
    return wrapped([head, "{", *indent(*straight(found, varying, SIDE)), "}"]), inputs


def for_each(around: Around, number: str, *lines: str, repeated: bool = False) -> Iterator[str]:
    """Yields a loop over the eight iterations, numbered so; the last one is `repeated` where there are fewer."""
    first, count = f"{around.index}_first", f"{around.index}_count"
    last = f"({number} < {count} ? {number} : {count} - 1)" if repeated else number
    yield f"for (int {number} = 0; {number} < {SIDE if repeated else count}; {number}++) {{"
    yield from indent(f"const int64_t {around.index} = {first} + {last};", *lines)
    yield "}"


def passed(inputs: Sequence[Arg], columns: dict[Arg, str]) -> list[str]:
    """Returns the arguments of a function of eight iterations."""
    return [columns[a] if a in columns else spelled(a) for a in inputs]


def read_by(steps: Sequence[Step]) -> set[Arg]:
    """Returns the names that steps read."""
    return {a for s in steps for a in operands(s)}
