"""Iterations that wait in queues, as C: they join groups of eight, which are computed together when they are full, and at the end."""

from __future__ import annotations

from teg.backends.c.lanes import SIDE
from teg.backends.c.queues import Queue
from teg.backends.c.steps import StepPrinter, array_of
from teg.backends.c.straights import Staged, Straight
from teg.backends.c.text import indent, packed, spelled
from teg.program.arrays import ArrayProgram, Loop

FEW = 5
"""Points that wait at the end for a line of their own up to which they rather join those that wait for any."""


class WaitingPrinter(StepPrinter):
    """Prints how queues are opened, joined, emptied and closed."""

    def __init__(self, program: ArrayProgram) -> None:
        super().__init__(program)
        self.straights: dict[int, Straight] = {}  # of the only flat program of an innermost loop
        self.queues: dict[int, Queue] = {}  # of such a flat program
        self.chunk: list[str] | None = None  # declarations of the chunk that is printed
        self.at = ""  # the number of the iteration whose carrier is printed among eight side by side

    def _straight_of(self, queue: Queue) -> Straight:
        """Returns the functions of what waits in a queue."""
        return next(self.straights[only] for only, q in self.queues.items() if q is queue)

    def _opened(self, queue: Queue) -> list[str]:
        """Returns the declaration of a queue, with what is the same for all that waits in it."""
        straight, apart = self._straight_of(queue), self._apart(queue)
        room = [queue.room(apart)]
        lines = queue.opened(apart)
        for name, staged in (("same", straight.crossed), ("alike", straight.covered)):
            if staged is not None and staged.grouped:
                lines += self._shared(f"{name}_{queue.name}", staged)
            elif staged is not None:
                given = [spelled(queue.run.inputs[i]) for i in staged.steady.inputs]
                lines.append(f"double {name}_{queue.name}[{staged.kept}];")
                lines.append(f"{staged.steady.name}({', '.join([*given, f'{name}_{queue.name}'])});")
        if straight.covered is not None:
            room.append(f"double simple_{queue.name}[{max(1, len(differing(queue, straight.covered)))}][{SIDE}] = {{{{0.0}}}};")
            lines.append(f"int plain_{queue.name} = 0;")
        if self.chunk is None:
            return [*room, *lines]
        self.chunk += room  # numbers that nothing waits for any more do no harm
        return lines

    def _shared(self, array: str, staged: Staged) -> list[str]:
        """Returns lines that find what all points of a queue share among that of eight queues; conditions are repeated for each point."""
        lines = [f"const double *const {array} = {array}_eight + {self.at};"]
        if not staged.conditions:
            return [*lines, f"const double *const {array}_m = {array};"]
        first = f"{array}[{SIDE} * ({staged.kept - staged.conditions} + j)]"
        return [
            *lines,
            f"double {array}_m[{SIDE * staged.conditions}];",
            f"for (int j = 0; j < {staged.conditions}; j++) for (int k = 0; k < {SIDE}; k++) {array}_m[{SIDE} * j + k] = {first};",
        ]

    def _emptied(self, queue: Queue) -> list[str]:
        """Returns lines that compute what waits at the end. Few points that wait for a line of their own join those that wait for any."""
        apart, name = self._apart(queue), queue.name
        if not apart:
            return [f"if (waiting_{name}[0]) {{", *indent(*self._flushed(queue, "0")), "}"]
        return [
            f"for (int line = {apart}; line >= 0; line--) {{",
            *indent(
                f"const int few = line && waiting_{name}[line] < {FEW} && waiting_{name}[0] + waiting_{name}[line] <= {SIDE};",
                f"for (int k = 0; few && k < waiting_{name}[line]; k++) {{",
                *indent(
                    f"for (int m = 0; m < {len(queue.varying)}; m++)",
                    *indent(f"queue_{name}[0][m][waiting_{name}[0]] = queue_{name}[line][m][k];"),
                    f"waiting_{name}[0]++;",
                ),
                "}",
                f"if (few || !waiting_{name}[line]) {{",
                *indent(f"waiting_{name}[line] = 0;", "continue;"),
                "}",
                *self._flushed(queue, "line"),
            ),
            "}",
        ]

    def _apart(self, queue: Queue) -> int:
        """Returns how many lines there are for points that one half-plane alone crosses."""
        crossed = self._straight_of(queue).crossed
        return crossed.apart if crossed else 0

    def _called(self, queue: Queue, which: str, *more: str) -> list[str]:
        """Returns the call of the function of eight points for which a queue waits."""
        crossed, run, name = self._straight_of(queue).crossed, queue.run, queue.name
        assert crossed is not None
        calls: list[str] = []
        for line in crossed.lines:
            given = [f"waits[{queue.varying.index(i)}]" if i in queue.varying else spelled(run.inputs[i]) for i in line.inputs]
            calls.append(f"{line.name}({', '.join([*given, *shared_by(f'same_{name}', crossed), *more])});")
        if len(calls) == 1:
            return calls
        cases = [f"{f'case {n}' if n else 'default'}: {call} break;" for n, call in enumerate(calls)]
        return [f"switch ({which}) {{", *cases, "}"]

    def _flushed(self, queue: Queue, which: str) -> list[str]:
        """Returns lines that compute the iterations in a queue, of which not all places need be taken. Where they are only added up, the
        function does so, but for those that are not good."""
        run, name, array, count = queue.run, queue.name, array_of(queue.run), len(queue.run.results)
        declaration, *call = self._run(run)
        inputs = [f"const double {run.inputs[i]} = waits[{m}][k];" for m, i in enumerate(queue.varying)]
        opening = [
            f"double (*const waits)[{SIDE}] = queue_{name}[{which}];",
            f"const int waiting = waiting_{name}[{which}];",
        ]

        def one_by_one(*lines: str) -> list[str]:
            inside = ["if (good[k] != 0.0) continue;", declaration, *inputs, *call, *lines]
            return [
                "int left = 0;",
                f"for (int k = 0; k < {SIDE}; k++) left |= (k < waiting) & (good[k] == 0.0);",
                "for (int k = 0; left && k < waiting; k++) {",
                *indent(*inside),
                "}",
            ]

        if not queue.after:
            return [
                *opening,
                f"double good[{SIDE}];",
                *self._called(queue, which, f"lanes_{name}", "waiting", "good"),
                *one_by_one(*packed(f"lanes_{name}[{m}][k] += {array}[{j}];" for m, j in enumerate(queue.added))),
                f"waiting_{name}[{which}] = 0;",
            ]
        return [
            *opening,
            f"double f[{SIDE * count}], good[{SIDE}];",
            *self._called(queue, which, "f", "good"),
            *one_by_one(f"for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = {array}[j];"),
            f"for (int k = waiting; k < {SIDE}; k++) for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = 0.0;",
            *queue.into_lanes("f[{at} + k]"),
            "for (int k = 0; k < waiting; k++) {",
            *indent(
                *(f"const int64_t {index} = place_{name}[{m}][k];" for m, index in enumerate(queue.indices)),
                *packed([f"{r} = f[{SIDE * j} + k]" for j, r in enumerate(run.results)], "const double ", ", ", ";"),
                *self._block([*queue.integers, *queue.after], 1),
            ),
            "}",
            f"waiting_{name}[{which}] = 0;",
        ]

    def _flushed_plain(self, queue: Queue) -> list[str]:
        """Returns lines that compute and add up the iterations with a simple value that wait."""
        covered, name = self._straight_of(queue).covered, queue.name
        assert covered is not None
        kept = differing(queue, covered)
        given = [f"simple_{name}[{kept.index(i)}]" if i in kept else spelled(queue.run.inputs[i]) for i in covered.lines[0].inputs]
        return [
            f"{covered.lines[0].name}({', '.join([*given, *shared_by(f'alike_{name}', covered), f'lanes_{name}', f'plain_{name}'])});",
            f"plain_{name} = 0;",
        ]

    def _pushed(self, queue: Queue, *more: str) -> list[str]:
        """Returns lines by which an iteration joins what waits for `line`, one of the lines of a queue."""
        name = queue.name
        return [
            f"const int at = waiting_{name}[line]++;",
            *packed(f"queue_{name}[line][{m}][at] = {queue.run.inputs[i]};" for m, i in enumerate(queue.varying)),
            *packed(f"place_{name}[{m}][at] = {index};" for m, index in enumerate(queue.indices)),
            f"if (at == {SIDE - 1}) {{",
            *indent(*self._flushed(queue, "line"), *more),
            "}",
        ]

    def _pushed_plain(self, queue: Queue, covered: Staged, *more: str) -> list[str]:
        """Returns lines by which an iteration with a simple value joins those that wait."""
        name = queue.name
        return [
            *packed(f"simple_{name}[{m}][plain_{name}] = {queue.run.inputs[i]};" for m, i in enumerate(differing(queue, covered))),
            f"if (++plain_{name} == {SIDE}) {{",
            *indent(*self._flushed_plain(queue), *more),
            "}",
        ]

    def _added(self, step: Loop) -> list[str]:
        """Returns lines that add up the results of an iteration, but for what is added up in the lanes of a queue."""
        lanes = self._in_lanes(step)
        return [f"{r} += {spelled(v)};" for r, v in zip(step.results, step.values, strict=True) if v not in lanes]

    def _in_lanes(self, step: Loop) -> set[str]:
        """Returns the results of an iteration that are added up in the lanes of a queue."""
        return {r for q in self.queues.values() if not q.after and step in q.chain for s in q.chain for r in (*s.results, *q.run.results)}


def shared_by(array: str, staged: Staged) -> list[str]:
    """Returns the arguments that have what all points of a queue share."""
    return [array, f"{array}_m"] if staged.grouped else [array]


def differing(queue: Queue, staged: Staged) -> list[int]:
    """Returns the inputs of a function that differ between the points of a queue."""
    return [i for i in queue.varying if i in staged.lines[0].inputs]
