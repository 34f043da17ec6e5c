"""The iterations of loops as C: one after the other, or eight side by side, with those that surfaces cross in queues."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.lanes import SIDE, Straight, decisive_branch
from teg.backends.c.queues import Queue
from teg.backends.c.steps import StepPrinter, array_of, named, skipped, spelled
from teg.backends.c.text import indent, packed
from teg.program.arrays import Arg, ArrayProgram, Cells, Loop, Number, Run, Scatter, Step
from teg.program.fields import operands, result_names


class IterationPrinter(StepPrinter):
    """Prints loops inside other loops, and the iterations of all."""

    def __init__(self, program: ArrayProgram) -> None:
        super().__init__(program)
        self.straights: dict[int, Straight] = {}  # of the only flat program of an innermost loop
        self.queues: dict[int, Queue] = {}  # of such a flat program

    def _loop(self, step: Loop, depth: int) -> list[str]:
        """Returns a loop inside another one."""
        sums = packed([f"{r} = 0.0" for r in step.results], "double ", ", ", ";") if step.results else []
        return [*sums, *self._iterations(step, spelled(step.lo), spelled(step.hi), depth + 1)]

    def _iterations(self, step: Loop, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop that is `depth` deep, and what they add to its sums, with what waits in queues."""
        carried = [q for q in self.queues.values() if q.carrier is step]
        opening = [line for q in carried for line in self._opened(q)]
        closing = [line for q in carried for line in (f"if (waiting_{q.name}) {{", *indent(*self._flushed(q)), "}", *q.closed())]
        return [*opening, *self._each(step, lo, hi, depth), *closing]

    def _straight_of(self, queue: Queue) -> Straight:
        """Returns the functions of what waits in a queue."""
        return next(self.straights[only] for only, q in self.queues.items() if q is queue)

    def _opened(self, queue: Queue) -> list[str]:
        """Returns the declaration of a queue, with what is the same for all that waits in it."""
        straight, name = self._straight_of(queue), f"same_{queue.name}"
        given = [spelled(queue.run.inputs[i]) for i in straight.steady_by]
        return [*queue.opened(), f"double {name}[{straight.kept}];", f"{straight.steady}({', '.join([*given, name])});"]

    def _flushed(self, queue: Queue) -> list[str]:
        """Returns lines that compute the iterations in a queue; if it is not full, the last one is repeated."""
        run, name, array, count = queue.run, queue.name, array_of(queue.run), len(queue.run.results)
        straight = self._straight_of(queue)
        given = [f"queue_{name}[{queue.varying.index(i)}]" if i in queue.varying else spelled(run.inputs[i]) for i in straight.crossed_by]
        declaration, *call = self._run(run)
        inputs = [f"const double {run.inputs[i]} = queue_{name}[{m}][k];" for m, i in enumerate(queue.varying)]
        scattered_into = [
            f"for (int k = 0; k < waiting_{name}; k++) {{",
            *indent(
                *(f"const int64_t {index} = place_{name}[{m}][k];" for m, index in enumerate(queue.indices)),
                *packed([f"{r} = f[{SIDE * j} + k]" for j, r in enumerate(run.results)], "const double ", ", ", ";"),
                *self._block([*queue.integers, *queue.after], 1),
            ),
            "}",
        ]
        return [
            f"for (int m = 0; m < {len(queue.varying)}; m++)",
            *indent(f"for (int k = waiting_{name}; k < {SIDE}; k++) queue_{name}[m][k] = queue_{name}[m][waiting_{name} - 1];"),
            f"double f[{SIDE * count}], good[{SIDE}];",
            f"{straight.crossed}({', '.join([*given, f'same_{name}', 'f', 'good'])});",
            f"for (int k = 0; k < waiting_{name}; k++) {{",
            *indent(
                "if (good[k] != 0.0) continue;",
                declaration,
                *inputs,
                *call,
                f"for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = {array}[j];",
            ),
            "}",
            f"for (int k = waiting_{name}; k < {SIDE}; k++) for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = 0.0;",
            *queue.into_lanes("f[{at} + k]"),
            *(scattered_into if queue.after else []),
            f"waiting_{name} = 0;",
        ]

    def _each(self, step: Loop, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations without what waits."""
        only = only_run(step)
        if only and id(only) in self.straights:
            return self._side_by_side(step, only, lo, hi, depth)
        inside = [*skipped(step), "if (teg_stopped(pace)) break;"]
        inside += [*self._block(step.body, depth, decisive(step)), *self._added(step)]
        return [f"for (int64_t {step.index} = {lo}; {step.index} < {hi}; {step.index}++) {{", *indent(*inside), "}"]

    def _side_by_side(self, step: Loop, run: Run, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop with one flat program, SIDE at a time; those that are not on the straight line one by one."""
        straight, count = self.straights[id(run)], len(run.results)
        at, lanes = f"{step.index}_first", f"{step.index}_count"
        cut = step.body.index(run)
        before, after = step.body[:cut], step.body[cut + 1 :]
        inside = {name for s in before for name in result_names(s)} | {step.index}

        def gathered(wanted: Sequence[int]) -> list[str]:
            """Returns the inputs that vary, at the iterations; the last one is repeated."""
            moving = [i for i in wanted if run.inputs[i] in inside]
            if not moving:
                return []
            index = f"const int64_t {step.index} = {at} + (k < {lanes} ? k : {lanes} - 1);"
            lines = self._block(_needed(before, {run.inputs[i] for i in moving}), depth)
            given = packed(f"q{i}[k] = {spelled(run.inputs[i])};" for i in moving)
            names = packed([f"q{i}[{SIDE}]" for i in moving], "double ", ", ", ";")
            return [*names, f"for (int k = 0; k < {SIDE}; k++) {{", *indent(index, *lines, *given), "}"]

        def arguments(wanted: Sequence[int], *more: str) -> str:
            values = [run.inputs[i] for i in wanted]
            return ", ".join([*(f"q{i}" if v in inside else spelled(v) for i, v in zip(wanted, values, strict=True)), *more])

        adding = not only_adds(step, run)  # whether an iteration that is not live has something to add
        later = [i for i in straight.used if i not in straight.decided_by]
        queue = self.queues.get(id(run))
        decided = [*gathered(straight.decided_by), f"int live[{SIDE}], fast[{SIDE}];"]
        decided.append(f"const int some = {straight.decision}({arguments(straight.decided_by, 'live', 'fast')});")
        decided += [] if adding else ["if (!some) continue;"]
        if straight.line:
            line = [*gathered(later), f"{straight.line}({arguments(straight.used, 'f')});"]
            line += queue.covered(lanes) if queue and not queue.after else []
            decided += [f"double f[{SIDE * count}];", "if (some & 2) {", *indent(*line), "}"]
        each = [
            *([] if adding else ["if (!live[k]) continue;"]),
            *(["if (fast[k]) continue;"] if queue and not queue.after else []),
            f"const int64_t {step.index} = {at} + k;",
            *self._block(before, depth),
            *self._way(run, straight, adding),
            *([] if queue and not queue.after else [*named(run), *self._block(after, depth), *self._added(step)]),
        ]
        narrow: list[str] = []
        if straight.narrow and not adding:
            narrow, lo, hi = _narrowed(step, run, straight, lo, hi)
        return [
            *narrow,
            f"for (int64_t {at} = {lo}; {at} < {hi}; {at} += {SIDE}) {{",
            *indent(
                "if (teg_stopped(pace)) break;",
                f"const int {lanes} = {hi} - {at} < {SIDE} ? (int)({hi} - {at}) : {SIDE};",
                *decided,
                f"for (int k = 0; k < {lanes}; k++) {{",
                *indent(*each),
                "}",
            ),
            "}",
        ]

    def _way(self, run: Run, straight: Straight, adding: bool) -> list[str]:
        """Returns lines that give one iteration its results: 0, those of the straight line, or those of the program, at once or from a
        queue."""
        array, count = array_of(run), len(run.results)
        declaration = f"double {array}[{count}];"
        copied = f"for (int j = 0; j < {count}; j++) {array}[j] = f[{SIDE} * j + k];"
        if queue := self.queues.get(id(run)):
            if not queue.after:
                return self._pushed(queue)
            waits = ["if (!fast[k]) {", *indent(*self._pushed(queue), "continue;"), "}"]
            return [*waits, declaration, *([copied] if straight.line else [])]
        declaration, *call = self._run(run)
        ways = [f"if (!live[k]) teg_fill({array}, {count}, 0.0);", "else {"] if adding else ["{"]
        if straight.line:
            ways[-1:] = [f"{ways[-1][:-1]}if (fast[k]) {copied}", "else {"]
        return [declaration, *ways, *indent(*call), "}"]

    def _pushed(self, queue: Queue) -> list[str]:
        """Returns lines by which an iteration joins its queue."""
        name = queue.name
        return [
            *packed(f"queue_{name}[{m}][waiting_{name}] = {queue.run.inputs[i]};" for m, i in enumerate(queue.varying)),
            *packed(f"place_{name}[{m}][waiting_{name}] = {index};" for m, index in enumerate(queue.indices)),
            f"if (++waiting_{name} == {SIDE}) {{",
            *indent(*self._flushed(queue)),
            "}",
        ]

    def _added(self, step: Loop) -> list[str]:
        """Returns lines that add up the results of an iteration, but for what is added up in the lanes of a queue."""
        inner = {r for q in self.queues.values() if not q.after and step in q.chain for s in q.chain for r in (*s.results, *q.run.results)}
        return [f"{r} += {spelled(v)};" for r, v in zip(step.results, step.values, strict=True) if v not in inner]


def only_run(loop: Loop) -> Run | None:
    """Returns the flat program of an innermost loop that has just one."""
    runs = [s for s in loop.body if isinstance(s, Run)]
    return runs[0] if len(runs) == 1 and not any(isinstance(s, Loop) for s in loop.body) else None


def _narrowed(step: Loop, run: Run, straight: Straight, lo: str, hi: str) -> tuple[list[str], str, str]:
    """Returns lines that leave out iterations at both ends that have no result but 0, and the range that is left."""
    numbers = {s.name for s in step.body if isinstance(s, Number) and s.integer == step.index}
    start, stop, heights = (f"{step.index}_{part}" for part in ("start", "stop", "height"))

    def call(row: int, index: str) -> str:
        values = [f"(double)({index})" if run.inputs[i] in numbers else spelled(run.inputs[i]) for i in straight.narrowed_by]
        return f"{straight.narrow}({', '.join([*values, f'{heights}[{row}]'])})"

    lines = [
        f"int64_t {start} = {lo}, {stop} = {hi};",
        f"if ({stop} - {start} > {SIDE}) {{",
        *indent(
            f"double {heights}[2][{straight.heights}];",
            f"if (!({call(0, start)} | {call(1, f'{stop} - 1')}))",
            *indent(f"teg_narrow({straight.heights}, {heights}[0], {heights}[1], &{start}, &{stop});"),
        ),
        "}",
    ]
    return lines, start, stop


def _needed(block: Sequence[Step], wanted: set[Arg]) -> list[Step]:
    """Returns the steps of a block without loops that matter for these names."""
    live, kept = set(wanted), []
    for step in reversed(block):
        if not live.isdisjoint(result_names(step)):
            live.update(operands(step))
            kept.append(step)
    return kept[::-1]


def decisive(loop: Loop) -> Run | None:
    """Returns a flat program without whose branch an iteration adds nothing to anything."""
    if any(isinstance(s, Cells) for s in loop.body):
        return None  # what they hold is freed at the end of an iteration
    runs = (s for s in loop.body if isinstance(s, Run) and decisive_branch(s.program) is not None)
    return next((s for s in runs if only_adds(loop, s)), None)


def only_adds(loop: Loop, run: Run) -> bool:
    """Returns whether nothing but results of a flat program is added to anything in an iteration."""
    rest = loop.body[loop.body.index(run) + 1 :]
    added = [*loop.values, *(s.value for s in rest if isinstance(s, Scatter))]
    return all(isinstance(s, Scatter) for s in rest) and set(added) <= set(run.results)
