"""The iterations of loops as C: one after the other, or eight side by side, with those that surfaces cross in queues (`waiting.py`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from teg.backends.c.covered import PIECE, CoveredRuns, covered_runs
from teg.backends.c.eights import SideBySide, match_squares
from teg.backends.c.groups import GroupPrinter
from teg.backends.c.lanes import SIDE, decisive_branch
from teg.backends.c.spans import HELD, LINES, PLACES, Rows, function, prefetched, rows_of
from teg.backends.c.steps import array_of, named, needed, only_run
from teg.backends.c.straights import Straight
from teg.backends.c.text import indent, packed, spelled
from teg.backends.c.waiting import differing, shared_by
from teg.program import without_branches
from teg.program.arrays import Cells, Integers, Load, Loop, Number, Run, Scatter, Step
from teg.program.fields import operands, result_names

BY_VALUE = 120
"""Inputs of a flat program that are C arguments: it is called in one place, and inlined there."""


class IterationPrinter(GroupPrinter):
    """Prints loops inside other loops, and the iterations of all."""

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
            closing += self._emptied(q)
            closing += [f"if (plain_{q.name}) {{", *indent(*self._flushed_plain(q)), "}"] if self._straight_of(q).covered else []
            closing += q.closed()
        return [*opening, *self._each(step, lo, hi, depth), *closing]

    def _each(self, step: Loop, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations without what waits."""
        if step_around := self.around.get(id(step)):
            return self._eight_at_once(step_around, lo, hi, depth)
        only = only_run(step)
        if only and id(only) in self.straights:
            return self._side_by_side(step, only, lo, hi, depth)
        if (rows := rows_of(step, self.idle)) and (run := self._spanned(step, rows.row)):
            return self._rows_side_by_side(step, rows, run, lo, hi, depth)
        added = self._added(step)
        inside = [*self._skipped(step), "if (teg_stopped(pace)) break;", *self._without_edges(step, depth, added)]
        cut = next((k for k, s in enumerate(step.body) if isinstance(s, Cells)), 0)
        if step.body and (shorter := self._without_candidates(step, cut, depth, added)):
            side_by_side = self._squares(step, cut, depth)
            waits = side_by_side.wait() if side_by_side else []
            if side_by_side:
                self.later[id(step.body[cut])] = side_by_side.later()
                shorter = side_by_side.with_empty_ones(shorter, hi)
            inside += [*self._block(step.body[:cut], depth), *shorter, *waits, *self._block(step.body[cut:], depth), *added]
            if side_by_side and self.chunk is not None:
                self.chunk.append(side_by_side.tried_so_far())
                return side_by_side.lines(lo, hi, inside)
        else:
            inside += [*self._block(step.body, depth, decisive(step)), *added]
        return [f"for (int64_t {step.index} = {lo}; {step.index} < {hi}; {step.index}++) {{", *indent(*inside), "}"]

    def _squares(self, step: Loop, cut: int, depth: int) -> SideBySide | None:
        """Returns what prints the iterations of a loop with cells eight side by side, if they may be."""
        cells, squares = step.body[cut], match_squares(step, self.routines)
        if squares is None or self.chunk is None or not isinstance(cells, Cells) or self._in_lanes(step) or step.listed >= 0:
            return None
        return SideBySide(squares, self._shape(cells), lambda steps: self._block([*map(self._straightened, steps)], depth))

    def _straightened(self, step: Step) -> Step:
        """Returns a step of which eight are run side by side: a flat program has no branches."""
        if not isinstance(step, Run):
            return step
        run = replace(step, program=without_branches(step.program))
        self.routines[id(run)] = self.printer.element(run.program, "run", BY_VALUE, lazy=False)
        self.by_moments.append((run,))  # keeps what `routines` knows by its identity
        return run

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
            lines = self._block(needed(before, {run.inputs[i] for i in moving}), depth)
            given = packed(f"q{i}[k] = {spelled(run.inputs[i])};" for i in moving)
            names = packed([f"q{i}[{SIDE}]" for i in moving], "double ", ", ", ";")
            return [*names, f"for (int k = 0; k < {SIDE}; k++) {{", *indent(index, *lines, *given), "}"]

        def arguments(wanted: Sequence[int], *more: str) -> str:
            values = [run.inputs[i] for i in wanted]
            return ", ".join([*(f"q{i}" if v in inside else spelled(v) for i, v in zip(wanted, values, strict=True)), *more])

        adding = not only_adds(step, run)  # whether an iteration that is not live has something to add
        later = [i for i in straight.used if i not in straight.decided_by]
        queue = self.queues.get(id(run))
        told = ["live", "fast", *(["held"] if queue and self._apart(queue) else [])]
        decided = [*gathered(straight.decided_by), f"int64_t {', '.join(f'{array}[{SIDE}]' for array in told)};"]
        decided.append(f"const int some = {straight.decision}({arguments(straight.decided_by, *told)});")
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
        apart = self._apart(self.queues[id(run)])
        lines = list(enumerate(LINES, len(PLACES))) if apart else []
        width = len(PLACES) + len(lines) + len(HELD) * apart
        routine = self.printer.once("spans", function(narrow.name, narrow.known, indices, set(moving), apart > 0))
        given = [f"q{i}" if i in moving else self._spelled(run.inputs[i]) for i in narrow.inputs if i not in indices]
        wanted = {*(run.inputs[i] for i in moving), row.lo, row.hi}
        gathered = [
            f"{row.index}_lo[k] = (double){spelled(row.lo)};",
            f"{row.index}_length[k] = (double)({spelled(row.hi)} - {spelled(row.lo)});",
        ]
        gathered += [f"q{i}[k] = {spelled(run.inputs[i])};" for i in moving]
        ends = [f"const int64_t {row.index}_{end} = {spelled(row.lo)} + (int64_t){spans}[{m}][k];" for m, end in enumerate(PLACES)]
        told = [f"const int {row.index}_{end} = (int){spans}[{m}][k];" for m, end in lines]
        first = len(PLACES) + len(lines)
        held = [(f"{spans}[{first + 2 * h}][k]", f"{spans}[{first + 2 * h + 1}][k]") for h in range(apart)]
        held = [(f"{row.index} - {spelled(row.lo)} >= {a}", f"{row.index} - {spelled(row.lo)} < {b}") for a, b in held]
        ahead = prefetched(row, run)
        each = [f"const int64_t {step.index} = {at} + k;", *self._block(rows.before, depth), *ends]
        names = [
            f"{row.index}_lo[{SIDE}]",
            f"{row.index}_length[{SIDE}]",
            f"{spans}[{width}][{SIDE}]",
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
                    *self._block(needed(rows.before, wanted), depth),
                    *packed(gathered),
                ),
                "}",
                f"const int {row.index}_long = {routine.name}({', '.join([*given, f'{row.index}_lo', f'{row.index}_length', spans])});",
                *([f"for (int k = 0; k < {count}; k++) {{", *indent(*each, *ahead), "}"] if ahead else []),
                f"if ({row.index}_long) {{",
                *indent(*self._covered_runs(row, run, rows, step.index)),
                "}",
                f"for (int k = 0; k < {count}; k++) {{",
                *indent(*each, *told, *self._span(row, run, held, depth + 1)),
                "}",
            ),
            "}",
        ]

    def _spans(self, step: Loop, run: Run, lo: str, hi: str, depth: int) -> list[str]:
        """Returns the iterations of a loop of which it is known from the first and the last one which are live and which covered."""
        apart = self._apart(self.queues[id(run)])
        narrow, _, _ = _narrowed(step, run, self.straights[id(run)], lo, hi, apart)
        index, (holds, fails) = step.index, HELD
        held = [(f"{index} >= {index}_{holds}_{h}", f"{index} < {index}_{fails}_{h}") for h in range(apart)]
        told = [f"const int {index}_{end} = 0;" for end in (LINES if apart else ())]
        ends = [f"const double {index}_spans[{len(PLACES)}][1] = {{{', '.join(f'{{(double){index}_{end}}}' for end in PLACES)}}};"]
        runs = [f"if ({index}_until - {index}_since >= {SIDE}) {{", *indent(*ends, *self._covered_runs(step, run, None, "")), "}"]
        return [*narrow, *told, *runs, *self._span(step, run, held, depth)]

    def _span(self, step: Loop, run: Run, held: Sequence[tuple[str, str]], depth: int) -> list[str]:
        """Returns the iterations of a loop of which it is known which are live and which covered. `held` has two conditions for each of the
        half-planes that are told apart, under which it holds in an iteration."""
        straight, queue, index = self.straights[id(run)], self.queues[id(run)], step.index
        assert straight.covered is not None
        before = step.body[: step.body.index(run)]
        start, stop, since, until = (f"{index}_{end}" for end in PLACES)
        reading = self._block(needed(before, {queue.run.inputs[i] for i in differing(queue, straight.covered)}), depth)
        bits = " | ".join(f"({first} & {last}) << {h}" for h, (first, last) in enumerate(held))
        return [
            f"const int64_t {index}_at = {until} - (({until} - {since}) & {SIDE - 1});",
            f"for (int64_t {index} = {index}_at; {index} < {until}; {index}++) {{",
            *indent(*reading, *self._pushed_plain(queue, straight.covered, "if (teg_stopped(pace)) break;")),
            "}",
            "for (int side = 0; side < 2; side++) {",
            *indent(
                f"const int64_t first = side ? {until} : {start}, last = side ? {stop} : {since};",
                *([f"const int every = side ? {index}_{LINES[1]} : {index}_{LINES[0]};"] if held else []),
                f"for (int64_t {index} = first; {index} < last; {index}++) {{",
                *indent(
                    *self._block(before, depth),
                    *(["int line = every;", f"if (!line) line = line_of_{queue.name}[{bits}];"] if held else ["const int line = 0;"]),
                    *self._pushed(queue, "if (teg_stopped(pace)) break;"),
                ),
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
                line = f"line_of_{queue.name}[held[k]]" if self._apart(queue) else "0"
                return [f"const int line = {line};", *self._pushed(queue)]
            waits = ["if (!fast[k]) {", *indent("const int line = 0;", *self._pushed(queue), "continue;"), "}"]
            return [*waits, declaration, *([copied] if straight.line else [])]
        declaration, *call = self._run(run)
        ways = [f"if (!live[k]) teg_fill({array}, {count}, 0.0);", "else {"] if adding else ["{"]
        if straight.line:
            ways[-1:] = [f"{ways[-1][:-1]}if (fast[k]) {copied}", "else {"]
        return [declaration, *ways, *indent(*call), "}"]

    def _covered_runs(self, loop: Loop, run: Run, rows: Rows | None, row: str) -> list[str]:
        """Returns lines that compute and add up the covered iterations of a loop, all that make groups of SIDE, for up to SIDE rows, whose
        index is `row`."""
        queue = self.queues[id(run)]
        covered = self.straights[id(run)].covered
        assert covered is not None
        assert covered.point is not None
        runs = self._runs(loop, run, rows, row, {i: str(queue.run.inputs[i]) for i in covered.point.inputs})
        routine = self.printer.once("runs", covered_runs(runs, covered.point, covered.grouped))
        spans = f"{loop.index}_spans"
        common = [
            *(f"{spans}[{PLACES.index(end)}]" for end in PLACES[2:]),
            "from",
            *shared_by(f"alike_{queue.name}", covered),
            f"lanes_{queue.name}",
        ]
        return [
            f"for (int64_t from = 0; {routine.name}({', '.join([*runs.arguments, *common])}); from += {PIECE})",
            *indent("if (teg_stopped(pace)) break;"),
        ]

    def _runs(self, loop: Loop, run: Run, rows: Rows | None, row: str, inputs: dict[int, str]) -> CoveredRuns:
        """Returns what is read in the iterations of a loop, and in the rows around it, for these inputs of its flat program."""
        inner = needed(loop.body[: loop.body.index(run)], set(inputs.values()))
        lo = loop.lo if rows else 0
        outer = needed(rows.before, {lo, *inputs.values(), *(a for s in inner for a in operands(s))}) if rows else []
        steps = [*outer, *inner]
        made = {name for s in steps for name in result_names(s)} | {loop.index, row}
        read = dict.fromkeys(
            [a for s in steps for a in operands(s) if isinstance(a, str)] + [*inputs.values(), *([lo] if isinstance(lo, str) else [])]
        )
        given = [f"{'int64_t' if name.startswith('i') else 'double'} {name}" for name in read if name not in made]
        given += dict.fromkeys(f"double p{s.args[0]}" for s in steps if isinstance(s, Integers) and s.op == "param")
        arrays: dict[int, tuple[str, int, int | None]] = {}
        for s in steps:
            if isinstance(s, Load | Integers) and s.array >= 0:
                spec = self.program.arrays[s.array]
                arrays[s.array] = ("int64_t" if spec.integers else "double", spec.dimensions, _entries(s.array, inner, loop.index))
        inside = {name for s in inner for name in result_names(s)}
        return CoveredRuns(
            loop.index, spelled(lo), row or None, self._block(outer, 1), self._block(inner, 1), inputs, inside, given, arrays
        )


def counted(loop: Loop) -> set[str]:
    """Returns the numbers that are the index of a loop."""
    return {s.name for s in loop.body if isinstance(s, Number) and s.integer == loop.index}


def _narrowed(step: Loop, run: Run, straight: Straight, lo: str, hi: str, apart: int = 0) -> tuple[list[str], str, str]:
    """Returns lines that leave out iterations at both ends that have no result but 0, and the range that is left. If iterations that are
    covered are computed apart, theirs is {index}_since … {index}_until: a part of the other one, or nothing, at its end. Half-planes that
    are told apart hold in {index}_holds_0 … {index}_fails_0 and so on."""
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
        *([] if narrow.known.decides else [f"if (!({told} & 1))"]),
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
        for h in range(apart):
            first, last = (f"{step.index}_{end}_{h}" for end in HELD)
            lines.append(f"int64_t {first} = {start}, {last} = {stop};")
            place = narrow.heights + narrow.known.planes[h]
            evaluated.insert(2, f"teg_cover(1, {heights}[0] + {place}, {heights}[1] + {place}, &{first}, &{last});")
        evaluated += [
            f"if ({since} < {start}) {since} = {start};",
            f"if ({until} > {stop}) {until} = {stop};",
            f"if ({since} >= {until}) {since} = {until} = {stop};",
        ]
    return [*lines, f"if ({stop} - {start} > {least}) {{", *indent(*evaluated), "}"], start, stop


def _entries(array: int, block: Sequence[Step], index: str) -> int | None:
    """Returns how many entries are read from the start of the last axis of an array in each iteration, if `index` is the subscript before
    and nothing else is read."""
    read = [s.subscripts for s in block if isinstance(s, Load) and s.array == array]
    last = {subscripts[-1] for subscripts in read}
    if any(len(subscripts) < 2 or subscripts[-2] != index for subscripts in read) or last != set(range(len(last))):
        return None
    return len(last) or None


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
