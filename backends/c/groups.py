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
from teg.backends.c.queues import Queue
from teg.backends.c.spans import rows_of
from teg.backends.c.steps import array_of, needed, only_run
from teg.backends.c.text import indent, packed, spelled, wrapped
from teg.backends.c.waiting import WaitingPrinter
from teg.program import Assign, Program, assigned, statements, without_branches
from teg.program.arrays import Arg, ArrayProgram, Integers, Load, Loop, Number, Run, Scatter, Step, steps
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


class GroupPrinter(WaitingPrinter):
    """Prints loops around carriers, of which eight iterations are begun and ended side by side."""

    def __init__(self, program: ArrayProgram) -> None:
        super().__init__(program)
        self.around: dict[int, Around] = {}  # of such a loop

    def _eight_at_once(self, around: Around, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop around a carrier, of which eight are begun and ended side by side."""
        step, carrier, columns = around.loop, around.carrier, around.columns()
        queue = next(q for q in self.queues.values() if q.carrier is carrier)
        begun, begun_reads = self._runs_of_eight(around.before, columns)
        shared, shared_reads = self._shared_by_queues(queue, columns)
        ended, ended_reads = self._runs_of_eight(around.after, columns)
        named, by_place = self._read_in(carrier, queue)
        values = {*(s.value for s in around.after if isinstance(s, Scatter)), *step.values}
        wanted = begun_reads | shared_reads | ended_reads | named | by_place | values
        read = [s.name for s in around.read if isinstance(s, Load | Number) and s.name in wanted]
        gathered = [*self._block(needed(around.read, set(read)), depth), *packed(f"{name}_eight[k] = {name};" for name in read)]
        first, count, at = f"{step.index}_first", f"{step.index}_count", around.at
        place = {name: f"{text}[{at}]" for name, text in columns.items()}
        without = [f"for (int k = {count}; k < {SIDE}; k++) {name}_eight[k] = 0.0;" for name in carrier.results if name in ended_reads]
        return [
            f"for (int64_t {first} = {lo}; {first} < {hi}; {first} += {SIDE}) {{",
            *indent(
                "if (teg_stopped(pace)) break;",
                f"const int {count} = {hi} - {first} < {SIDE} ? (int)({hi} - {first}) : {SIDE};",
                *packed([f"{name}_eight[{SIDE}]" for name in (*read, *carrier.results)], "double ", ", ", ";"),
                *for_each(around, "k", *gathered, repeated=True),
                *begun,
                *shared,
                *for_each(around, at, *self._one_carrier(around, place, named, depth)),
                *packed(without),
                *ended,
                *for_each(around, at, *self._one_end(around, place, values, depth)),
            ),
            "}",
        ]

    def _one_carrier(self, around: Around, place: dict[Arg, str], named: set[Arg], depth: int) -> list[str]:
        """Returns the carrier of one of eight iterations, in which some numbers are `named`, and others spelled where they lie."""
        self.places, self.at = {name: place[name] for name in around.made - named}, around.at
        lines = [
            *self._block(needed(around.integers, named), depth),
            *packed(f"const double {name} = {place[name]};" for name in place if name in named & around.made),
            *self._block([around.carrier], depth),
            *packed(f"{place[name]} = {name};" for name in around.carrier.results),
        ]
        self.places, self.at = {}, ""
        return lines

    def _one_end(self, around: Around, place: dict[Arg, str], values: set[Arg], depth: int) -> list[str]:
        """Returns what one of eight iterations scatters and adds up."""
        scattered = [s for s in around.after if isinstance(s, Scatter)]
        return [
            *self._block(needed(around.integers, {a for s in scattered for a in operands(s)}), depth),
            *packed(f"const double {name} = {place[name]};" for name in place if name in values),
            *self._block(scattered, depth),
            *self._added(around.loop),
        ]

    def _shared_by_queues(self, queue: Queue, columns: dict[Arg, str]) -> tuple[list[str], set[Arg]]:
        """Returns lines that compute what all points of a queue share, for eight queues, and what these read."""
        straight, lines, reads = self._straight_of(queue), list[str](), set[Arg]()
        for kind, staged in (("same", straight.crossed), ("alike", straight.covered)):
            if staged is not None:
                array, given = f"{kind}_{queue.name}_eight", [queue.run.inputs[i] for i in staged.steady.inputs]
                lines.append(f"double {array}[{SIDE * staged.kept}];")
                lines.append(f"{staged.steady.name}({', '.join([*passed(given, columns), array])});")
                reads.update(given)
        return lines, reads

    def _runs_of_eight(self, block: Sequence[Step], columns: dict[Arg, str]) -> tuple[list[str], set[Arg]]:
        """Returns lines that run the flat programs of a block for eight iterations side by side, and what these read."""
        lines: list[str] = []
        reads: set[Arg] = set()
        for run in block:
            if not isinstance(run, Run) or id(run) in self.idle:
                continue
            text, inputs = function(run.program, [i for i, arg in enumerate(run.inputs) if arg in columns])
            given = [run.inputs[i] for i in inputs]
            array = f"{array_of(run)}_eight"
            lines.append(f"double {array}[{SIDE * len(run.results)}];")
            lines.append(f"{self.printer.once('eight', text).name}({', '.join([*passed(given, columns), array])});")
            reads.update(given)
        return lines, reads

    def _read_in(self, carrier: Loop, queue: Queue) -> tuple[set[Arg], set[Arg]]:
        """Returns the names that a carrier reads, and numbers that it reads where they lie."""
        only = next(run for run, q in ((s, self.queues.get(id(s))) for s in steps(carrier.body) if isinstance(s, Run)) if q is queue)
        inside = [s for s in steps(carrier.body) if not isinstance(s, Run)]
        narrow = self.straights[id(only)].narrow
        given = {*queue.run.inputs, *(only.inputs[i] for i in (narrow.inputs if narrow else ()))}
        named = {a for s in (carrier, *inside) for a in operands(s)}
        rows = rows_of(carrier, self.idle)
        if not (self.straights[id(only)].spanned and rows is not None and self._spanned(carrier, rows.row)):
            named |= {*only.inputs, *given}
        return named, given - named

    def _spanned(self, step: Loop, row: Loop) -> Run | None:
        """Returns the flat program of the loop `row` inside of `step` if its spans are known, and its queue is kept from row to row."""
        run = only_run(row)
        straight = self.straights.get(id(run))
        return run if straight is not None and straight.spanned and step in self.queues[id(run)].chain else None
