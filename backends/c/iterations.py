"""The iterations of loops as C: one after the other, or eight side by side, with those that surfaces cross in queues."""

from __future__ import annotations

from collections.abc import Sequence

from teg.backends.c.lanes import SIDE, decisive_branch
from teg.backends.c.queues import Queue
from teg.backends.c.spans import PLACES, Rows, function, prefetched, rows_of
from teg.backends.c.steps import StepPrinter, array_of, named
from teg.backends.c.straights import Staged, Straight
from teg.backends.c.text import indent, packed, spelled
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
        carried = any(q.carrier is step for q in self.queues.values())
        lanes = set() if carried else self._in_lanes(step)
        sums = packed([f"{r} = 0.0" for r, v in zip(step.results, step.values, strict=True) if v not in lanes], "double ", ", ", ";")
        return [*sums, *self._iterations(step, spelled(step.lo), spelled(step.hi), depth + 1)]

    def _iterations(self, step: Loop, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop that is `depth` deep, and what they add to its sums, with what waits in queues."""
        carried = [q for q in self.queues.values() if q.carrier is step]
        opening = [line for q in carried for line in self._opened(q)]
        closing: list[str] = []
        for q in carried:
            closing += [f"if (waiting_{q.name}) {{", *indent(*self._flushed(q)), "}"]
            closing += [f"if (plain_{q.name}) {{", *indent(*self._flushed_plain(q)), "}"] if self._straight_of(q).covered else []
            closing += q.closed()
        return [*opening, *self._each(step, lo, hi, depth), *closing]

    def _straight_of(self, queue: Queue) -> Straight:
        """Returns the functions of what waits in a queue."""
        return next(self.straights[only] for only, q in self.queues.items() if q is queue)

    def _opened(self, queue: Queue) -> list[str]:
        """Returns the declaration of a queue, with what is the same for all that waits in it."""
        straight, lines = self._straight_of(queue), queue.opened()
        for name, staged in (("same", straight.crossed), ("alike", straight.covered)):
            if staged is not None:
                given = [spelled(queue.run.inputs[i]) for i in staged.steady_inputs]
                lines.append(f"double {name}_{queue.name}[{staged.kept}];")
                lines.append(f"{staged.steady}({', '.join([*given, f'{name}_{queue.name}'])});")
        if straight.covered is not None:
            lines += [
                f"double simple_{queue.name}[{max(1, len(_kept(queue, straight.covered)))}][{SIDE}];",
                f"int plain_{queue.name} = 0;",
            ]
        return lines

    def _flushed(self, queue: Queue) -> list[str]:
        """Returns lines that compute the iterations in a queue; if it is not full, the last one is repeated. Where they are only added up,
        the function does so, but for those that are not good."""
        run, name, array, count = queue.run, queue.name, array_of(queue.run), len(queue.run.results)
        crossed = self._straight_of(queue).crossed
        assert crossed is not None
        given = [f"queue_{name}[{queue.varying.index(i)}]" if i in queue.varying else spelled(run.inputs[i]) for i in crossed.inputs]
        declaration, *call = self._run(run)
        inputs = [f"const double {run.inputs[i]} = queue_{name}[{m}][k];" for m, i in enumerate(queue.varying)]
        repeated = [
            f"for (int m = 0; m < {len(queue.varying)}; m++)",
            *indent(f"for (int k = waiting_{name}; k < {SIDE}; k++) queue_{name}[m][k] = queue_{name}[m][waiting_{name} - 1];"),
        ]

        def one_by_one(*lines: str) -> list[str]:
            inside = ["if (good[k] != 0.0) continue;", declaration, *inputs, *call, *lines]
            return [f"for (int k = 0; k < waiting_{name}; k++) {{", *indent(*inside), "}"]

        if not queue.after:
            return [
                *repeated,
                f"double good[{SIDE}];",
                f"{crossed.name}({', '.join([*given, f'same_{name}', f'lanes_{name}', f'waiting_{name}', 'good'])});",
                *one_by_one(*packed(f"lanes_{name}[{m}][k] += {array}[{j}];" for m, j in enumerate(queue.added))),
                f"waiting_{name} = 0;",
            ]
        return [
            *repeated,
            f"double f[{SIDE * count}], good[{SIDE}];",
            f"{crossed.name}({', '.join([*given, f'same_{name}', 'f', 'good'])});",
            *one_by_one(f"for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = {array}[j];"),
            f"for (int k = waiting_{name}; k < {SIDE}; k++) for (int j = 0; j < {count}; j++) f[{SIDE} * j + k] = 0.0;",
            *queue.into_lanes("f[{at} + k]"),
            f"for (int k = 0; k < waiting_{name}; k++) {{",
            *indent(
                *(f"const int64_t {index} = place_{name}[{m}][k];" for m, index in enumerate(queue.indices)),
                *packed([f"{r} = f[{SIDE * j} + k]" for j, r in enumerate(run.results)], "const double ", ", ", ";"),
                *self._block([*queue.integers, *queue.after], 1),
            ),
            "}",
            f"waiting_{name} = 0;",
        ]

    def _flushed_plain(self, queue: Queue) -> list[str]:
        """Returns lines that compute and add up the iterations with a simple value that wait."""
        covered, name = self._straight_of(queue).covered, queue.name
        assert covered is not None
        kept = _kept(queue, covered)
        given = [f"simple_{name}[{kept.index(i)}]" if i in kept else spelled(queue.run.inputs[i]) for i in covered.inputs]
        return [
            f"for (int m = 0; m < {len(kept)}; m++)",
            *indent(f"for (int k = plain_{name}; k < {SIDE}; k++) simple_{name}[m][k] = simple_{name}[m][plain_{name} - 1];"),
            f"{covered.name}({', '.join([*given, f'alike_{name}', f'lanes_{name}', f'plain_{name}'])});",
            f"plain_{name} = 0;",
        ]

    def _each(self, step: Loop, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations without what waits."""
        only = only_run(step)
        if only and id(only) in self.straights:
            return self._side_by_side(step, only, lo, hi, depth)
        if (rows := rows_of(step, self.idle)) and (run := self._spanned(step, rows.row)):
            return self._rows_side_by_side(step, rows, run, lo, hi, depth)
        inside = [*self._skipped(step), "if (teg_stopped(pace)) break;"]
        inside += [*self._block(step.body, depth, decisive(step)), *self._added(step)]
        return [f"for (int64_t {step.index} = {lo}; {step.index} < {hi}; {step.index}++) {{", *indent(*inside), "}"]

    def _spanned(self, step: Loop, row: Loop) -> Run | None:
        """Returns the flat program of the loop `row` inside of `step` if its spans are known, and its queue is kept from row to row."""
        run = only_run(row)
        straight = self.straights.get(id(run))
        return run if straight is not None and straight.spanned and step in self.queues[id(run)].chain else None

    def _side_by_side(self, step: Loop, run: Run, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop with one flat program, SIDE at a time; those that are not on the straight line one by one."""
        straight, count = self.straights[id(run)], len(run.results)
        if straight.spanned:
            return self._spans(step, run, lo, hi, depth)
        at, lanes = f"{step.index}_first", f"{step.index}_count"
        before = step.body[: step.body.index(run)]
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
        decided = [*gathered(straight.decided_by), f"int64_t live[{SIDE}], fast[{SIDE}];"]
        decided.append(f"const int some = {straight.decision}({arguments(straight.decided_by, 'live', 'fast')});")
        decided += [] if adding else ["if (!some) continue;"]
        if straight.line:
            line = [*gathered(later), f"{straight.line}({arguments(straight.used, 'f')});"]
            line += queue.covered(lanes) if queue and not queue.after else []
            decided += [f"double f[{SIDE * count}];", "if (some & 2) {", *indent(*line), "}"]
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
                *indent(*self._one(step, run, adding, depth)),
                "}",
            ),
            "}",
        ]

    def _one(self, step: Loop, run: Run, adding: bool, depth: int) -> list[str]:
        """Returns what is done with one of several iterations side by side. `adding`: one that is not live has something to add."""
        straight, queue, cut = self.straights[id(run)], self.queues.get(id(run)), step.body.index(run)
        is_summed = queue is not None and not queue.after  # results are added up in lanes, and nothing else
        lines = [] if adding else ["if (!live[k]) continue;"]
        lines += ["if (fast[k]) continue;"] if is_summed and straight.covered is None else []
        lines += [f"const int64_t {step.index} = {step.index}_first + k;", *self._block(step.body[:cut], depth)]
        if queue is not None and straight.covered is not None:
            lines += ["if (fast[k]) {", *indent(*self._pushed_plain(queue, straight.covered), "continue;"), "}"]
        lines += self._way(run, straight, adding)
        return lines if is_summed else [*lines, *named(run), *self._block(step.body[cut + 1 :], depth), *self._added(step)]

    def _rows_side_by_side(self, step: Loop, rows: Rows, run: Run, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop over rows, for SIDE of which at a time it is known what is live and what is covered."""
        row, narrow = rows.row, self.straights[id(run)].narrow
        assert narrow is not None
        at, count, spans = f"{step.index}_first", f"{step.index}_count", f"{row.index}_spans"
        inside, numbers = rows.inside | {step.index}, counted(row)
        moving = [i for i in narrow.inputs if run.inputs[i] in inside]
        indices = {i for i in narrow.inputs if run.inputs[i] in numbers}
        routine = self.printer.once("spans", function(narrow.name, narrow.known, indices, set(moving)))
        given = [f"q{i}" if i in moving else spelled(run.inputs[i]) for i in narrow.inputs if i not in indices]
        wanted = {*(run.inputs[i] for i in moving), row.lo, row.hi}
        gathered = [
            f"{row.index}_lo[k] = (double){spelled(row.lo)};",
            f"{row.index}_length[k] = (double)({spelled(row.hi)} - {spelled(row.lo)});",
        ]
        gathered += [f"q{i}[k] = {spelled(run.inputs[i])};" for i in moving]
        ends = [f"const int64_t {row.index}_{end} = {spelled(row.lo)} + (int64_t){spans}[{m}][k];" for m, end in enumerate(PLACES)]
        ahead = prefetched(row, run)
        each = [f"const int64_t {step.index} = {at} + k;", *self._block(rows.before, depth), *ends]
        names = [
            f"{row.index}_lo[{SIDE}]",
            f"{row.index}_length[{SIDE}]",
            f"{spans}[{len(PLACES)}][{SIDE}]",
            *(f"q{i}[{SIDE}]" for i in moving),
        ]
        return [
            f"for (int64_t {at} = {lo}; {at} < {hi}; {at} += {SIDE}) {{",
            *indent(
                "if (teg_stopped(pace)) break;",
                f"const int {count} = {hi} - {at} < {SIDE} ? (int)({hi} - {at}) : {SIDE};",
                *packed(names, "double ", ", ", ";"),
                f"for (int k = 0; k < {SIDE}; k++) {{",
                *indent(
                    f"const int64_t {step.index} = {at} + (k < {count} ? k : {count} - 1);",
                    *self._block(_needed(rows.before, wanted), depth),
                    *packed(gathered),
                ),
                "}",
                f"{routine.name}({', '.join([*given, f'{row.index}_lo', f'{row.index}_length', spans])});",
                *([f"for (int k = 0; k < {count}; k++) {{", *indent(*each, *ahead), "}"] if ahead else []),
                f"for (int k = 0; k < {count}; k++) {{",
                *indent(*each, *self._span(row, run, depth + 1)),
                "}",
            ),
            "}",
        ]

    def _spans(self, step: Loop, run: Run, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop of which it is known from the first and the last one which are live and which covered."""
        narrow, _, _ = _narrowed(step, run, self.straights[id(run)], lo, hi)
        return [*narrow, *self._span(step, run, depth)]

    def _span(self, step: Loop, run: Run, depth: int) -> list[str]:
        """Returns the iterations of a loop of which it is known which are live and which covered."""
        straight, queue, index = self.straights[id(run)], self.queues[id(run)], step.index
        assert straight.covered is not None
        before = step.body[: step.body.index(run)]
        start, stop, since, until = (f"{index}_{end}" for end in PLACES)
        needed = self._block(_needed(before, {queue.run.inputs[i] for i in _kept(queue, straight.covered)}), depth)
        return [
            f"int64_t {index}_at = {since};",
            f"for (; {index}_at + {SIDE} <= {until}; {index}_at += {SIDE}) {{",
            *indent(*self._covered_at_once(queue, straight.covered, index, needed)),
            "}",
            f"for (int64_t {index} = {index}_at; {index} < {until}; {index}++) {{",
            *indent(*needed, *self._pushed_plain(queue, straight.covered, "if (teg_stopped(pace)) break;")),
            "}",
            f"for (int64_t {index} = {start}; {index} < {stop}; {index}++) {{",
            *indent(
                f"if ({index} == {since}) {index} = {until};",
                f"if ({index} >= {stop} || teg_stopped(pace)) break;",
                *self._block(before, depth),
                *self._pushed(queue),
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

    def _covered_at_once(self, queue: Queue, covered: Staged, index: str, needed: Sequence[str]) -> list[str]:
        """Returns lines that compute and add up SIDE iterations with a simple value, from {index}_at on."""
        kept, inputs = _kept(queue, covered), queue.run.inputs
        given = [f"c{i}" if i in kept else spelled(inputs[i]) for i in covered.inputs]
        return [
            "if (teg_stopped(pace)) break;",
            *packed([f"c{i}[{SIDE}]" for i in kept], "double ", ", ", ";"),
            f"for (int k = 0; k < {SIDE}; k++) {{",
            *indent(f"const int64_t {index} = {index}_at + k;", *needed, *packed(f"c{i}[k] = {inputs[i]};" for i in kept)),
            "}",
            f"{covered.name}({', '.join([*given, f'alike_{queue.name}', f'lanes_{queue.name}', str(SIDE)])});",
        ]

    def _pushed_plain(self, queue: Queue, covered: Staged, *more: str) -> list[str]:
        """Returns lines by which an iteration with a simple value joins those that wait."""
        name = queue.name
        return [
            *packed(f"simple_{name}[{m}][plain_{name}] = {queue.run.inputs[i]};" for m, i in enumerate(_kept(queue, covered))),
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


def only_run(loop: Loop) -> Run | None:
    """Returns the flat program of an innermost loop that has just one."""
    runs = [s for s in loop.body if isinstance(s, Run)]
    return runs[0] if len(runs) == 1 and not any(isinstance(s, Loop) for s in loop.body) else None


def counted(loop: Loop) -> set[str]:
    """Returns the numbers that are the index of a loop."""
    return {s.name for s in loop.body if isinstance(s, Number) and s.integer == loop.index}


def _kept(queue: Queue, staged: Staged) -> list[int]:
    """Returns the inputs of a function that differ between the points of a queue."""
    return [i for i in queue.varying if i in staged.inputs]


def _narrowed(step: Loop, run: Run, straight: Straight, lo: str, hi: str) -> tuple[list[str], str, str]:
    """Returns lines that leave out iterations at both ends that have no result but 0, and the range that is left. If iterations that are
    covered are computed apart, theirs is {index}_since … {index}_until: a part of the other one, or nothing, at its end."""
    narrow = straight.narrow
    assert narrow is not None
    numbers = counted(step)
    start, stop, since, until, heights, told = (f"{step.index}_{part}" for part in ("start", "stop", "since", "until", "height", "told"))

    def call(row: int, index: str) -> str:
        values = [f"(double)({index})" if run.inputs[i] in numbers else spelled(run.inputs[i]) for i in narrow.inputs]
        return f"{narrow.name}({', '.join([*values, f'{heights}[{row}]'])})"

    lines = [f"int64_t {start} = {lo}, {stop} = {hi};"]
    least = SIDE
    evaluated = [
        f"double {heights}[2][{narrow.heights + narrow.covers}];",
        f"const int {told} = {call(0, start)} | {call(1, f'{stop} - 1')};",
        *([] if narrow.decides else [f"if (!({told} & 1))"]),
        f"teg_narrow({narrow.heights}, {heights}[0], {heights}[1], &{start}, &{stop});",
    ]
    if straight.spanned:
        least = 0
        lines.append(f"int64_t {since} = {start}, {until} = {stop};")
        behind = f"{heights}[0] + {narrow.heights}, {heights}[1] + {narrow.heights}"
        evaluated[2:2] = [
            f"if ({told} & 2) {until} = {since};",
            f"else teg_cover({narrow.covers}, {behind}, &{since}, &{until});",
        ]
        evaluated += [
            f"if ({since} < {start}) {since} = {start};",
            f"if ({until} > {stop}) {until} = {stop};",
            f"if ({since} >= {until}) {since} = {until} = {stop};",
        ]
    return [*lines, f"if ({stop} - {start} > {least}) {{", *indent(*evaluated), "}"], start, stop


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
