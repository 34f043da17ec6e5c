"""The steps of a program with arrays as C, one after the other: integers, flat programs, folds, cells and tables.

StepPrinter       what is common to all steps; how loops are printed is up to `iterations`
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from teg.backends.c.cells import NO_MEMORY, CellPrinter
from teg.backends.c.chunks import Target
from teg.backends.c.delayed import delayed, readers_of
from teg.backends.c.frame import Routine
from teg.backends.c.printer import Printer
from teg.backends.c.text import indent, literal, packed, spelled
from teg.program import Integrate, compound, has_ties
from teg.program.arrays import (
    AddTo,
    Arg,
    ArrayProgram,
    Blank,
    Cells,
    Combined,
    Factors,
    Gaps,
    Integers,
    Least,
    Load,
    Loop,
    Number,
    Rows,
    Run,
    Scatter,
    SeenLoop,
    Step,
    Take,
)
from teg.program.fields import operands, result_names
from teg.program.vanishing import FLAT, with_zeros


def _weighed(count: int, array: str, first: str) -> list[str]:
    """Returns lines that end a run in both orders of ties, and, where these change nothing, with all ties true and false: only ties that
    matter are noted. `first` has the results of the first order, then the mean of both."""
    return [
        "if (!ctx.tied) break;",
        f"if (ctx.order != 1) differ = teg_differ({first}, {array}, {count});",
        f"for (int j = 0; ctx.order == 1 && j < {count}; j++) {first}[j] = {array}[j];",
        f"for (int j = 0; ctx.order == -1 && j < {count}; j++) {first}[j] = 0.5 * ({first}[j] + {array}[j]);",
        "if (differ || ctx.order == -2) {",
        *indent(
            f"for (int j = 0; j < {count}; j++) {array}[j] = {first}[j];",
            "ctx.order = +1, ctx.tied = 0, note |= differ;",
            "break;",
        ),
        "}",
        "ctx.order = ctx.order == -1 ? 2 : -ctx.order;",
    ]


class StepPrinter(CellPrinter):
    """Prints steps in the scope of one element of the batch."""

    def __init__(self, program: ArrayProgram) -> None:
        super().__init__(program)
        self.program = program
        self.printer = Printer()
        self.routines: dict[int, Routine] = {}
        self.copied: frozenset[int | str] = frozenset()  # the outputs and tables of which the chunk that is printed has a copy
        self.idle: set[int] = set()  # the flat programs that only points in queues needed, which compute them again
        self.by_moments: list[tuple[Step, ...]] = []  # iterations of loops over candidates without edges, and their flat programs
        self.readers = readers_of(program)
        self.places: dict[Arg, str] = {}  # how numbers are spelled that have no name of their own in C
        self.telling: set[int] = set()  # the flat programs that return whether their branch is taken

    @abstractmethod
    def _loop(self, step: Loop, depth: int) -> list[str]:
        """Returns a loop inside another one."""

    @abstractmethod
    def _chunks(self, step: Loop) -> list[str]:
        """Returns an outermost loop."""

    def _block(self, block: Sequence[Step], depth: int, decisive: Run | None = None) -> list[str]:
        """Returns the lines of a block, in which a decisive flat program may end the iteration. Recursion is as deep as loops are."""
        lines: list[str] = []
        waiting = delayed(block, self.readers)
        late = {id(run) for runs in waiting.values() for run in runs}
        for step in block:
            match step:
                case Integers():
                    lines.append(f"const int64_t {step.name} = {self._integers(step)};")
                case Number():
                    lines.append(f"const double {step.name} = (double){spelled(step.integer)};")
                case Load():
                    lines.append(f"const double {step.name} = a{step.array}[{place_of(step.array, step.subscripts)}];")
                case Scatter():
                    place, value = place_of(step.array, step.subscripts), spelled(step.value)
                    target, copied = target_of(step.output), step.output in self.copied
                    lines += [target.added(place, value, copied), *(target.marked(place) if copied else [])]
                case AddTo():
                    lines += self._added_to_table(step, block)
                case Blank():
                    lines += self._new_table(step.table, spelled(step.rows), step.columns)
                case Rows():
                    lines += self._rows(step, depth)
                case Run() if id(step) in self.idle or id(step) in late:
                    pass
                case Run():
                    lines += [*self._run(step), *named(step)]
                    if step is decisive:
                        lines.append(f"if (!{array_of(step)}_taken) continue;")
                case Least() | Factors():
                    lines += self._fold(step, depth)
                case Gaps():
                    lines += self._gaps(step, depth, waiting[id(step)])
                case Cells():
                    lines += self._cells(step, depth)
                case Combined():
                    lines += self._combine(step)
                case Take():
                    lines.append(f"const double {step.name} = {self._taken(step)};")
                case Loop() if depth:
                    lines += self._loop(step, depth)
                case Loop():
                    lines += self._chunks(step)
        return [*lines, *self._held(block)]

    def _integers(self, step: Integers) -> str:
        args = [spelled(a) for a in step.args]
        match step.op:
            case "length":
                return f"s{step.array}[{args[0]}]"
            case "param":
                return f"(int64_t)p{step.args[0]}"
            case "gather":
                return f"a{step.array}[{place_of(step.array, step.args)}]"
            case "add" | "sub" | "mul":
                return f"{args[0]} {'+-*'[('add', 'sub', 'mul').index(step.op)]} {args[1]}"
            case "min" | "max":
                return f"{args[0]} {'<' if step.op == 'min' else '>'} {args[1]} ? {args[0]} : {args[1]}"
            case "floordiv":
                return f"teg_floordiv({args[0]}, {args[1]})"
            case _:
                return f"{args[0]} - {args[1]} * teg_floordiv({args[0]}, {args[1]})"

    def _run(self, step: Run) -> list[str]:
        routine = self.routines[id(step)]
        count, ties = len(step.results), has_ties(step.program.body)
        array = array_of(step)
        below = routine.workspace
        inputs = [self._spelled(a) if isinstance(a, str) else literal(float(a)) for a in step.inputs]

        passed = [*([] if routine.indirect else inputs), array, *["w"] * (routine.workspace > 0), *["&ctx"] * routine.context]
        told = id(step) in self.telling
        call = f"{f'{array}_taken = ' if told else ''}{routine.name}({', '.join(passed)});"
        gather = packed(f"w[{i}] = {value};" for i, value in enumerate(inputs)) if routine.indirect else []
        gather += ["ctx.work = 0;"] if any(isinstance(s, Integrate) for s in compound(step.program.body)) else []
        lines = [f"double {array}[{count}];", *([f"int {array}_taken;"] if told else [])]
        if not ties:
            return [*lines, *gather, call]
        first = f"(w + {below})"
        if step.program.weighs_ties:
            return [*lines, "for (int differ = 0;;) {", *indent(*gather, call, *_weighed(count, array, first)), "}"]
        return [  # one call, so that it is inlined
            *lines,
            "for (;;) {",
            *indent(
                *gather,
                call,
                "if (!ctx.tied) break;",
                "if (ctx.order < 0) {",
                *indent(
                    f"for (int j = 0; j < {count}; j++) {array}[j] = 0.5 * ({first}[j] + {array}[j]);",
                    "ctx.order = +1, ctx.tied = 0, note |= 1;",
                    "break;",
                ),
                "}",
                f"for (int j = 0; j < {count}; j++) {first}[j] = {array}[j];",
                "ctx.order = -1;",
            ),
            "}",
        ]

    def _spelled(self, arg: Arg) -> str:
        """Returns an operand in C."""
        return self.places.get(arg) or spelled(arg)

    def _fold(self, step: Least | Factors, depth: int) -> list[str]:
        """Returns a loop for the index of the least value, or for a product."""
        found = step.results
        if isinstance(step, Factors):
            start = [f"double {r} = 1.0;" for r in found]
            each = [f"{r} *= {spelled(v)};" for r, v in zip(found, step.values, strict=True)]
        else:
            start = [f"double {r} = -1.0, {r}_least = INFINITY;" for r in found]
            each = [
                f"teg_least({spelled(v)}, {spelled(p)}, {step.index}, &{r}_least, &{r});"
                for r, v, p in zip(found, step.values, step.eligible, strict=True)
            ]
        inside = ["if (teg_stopped(pace)) break;", *self._block(step.body, depth + 1), *each]
        lo, hi = spelled(step.lo), spelled(step.hi)
        return [*start, f"for (int64_t {step.index} = {lo}; {step.index} < {hi}; {step.index}++) {{", *indent(*inside), "}"]

    def _gaps(self, step: Gaps, depth: int, before: Sequence[Run]) -> list[str]:
        """Returns a sum over the gaps that candidates leave, in front of which flat programs are run if there is a line."""
        at, count = f"{step.results[0]}_gaps", f"{step.results[0]}_count"
        first, last = (spelled(end) if isinstance(end, str) else literal(float(end)) for end in (step.first, step.last))
        given, velocities = (
            ", ".join(spelled(v) if isinstance(v, str) else literal(float(v)) for v in several)
            for several in (step.values, step.velocities)
        )
        moving = f"(const double[]){{{velocities}}}" if velocities else "NULL"
        outer = [spelled(v) if isinstance(v, str) else literal(float(v)) for v in step.outer]
        lo, width = spelled(step.lo), 4 if step.moving else 2
        candidate = [
            "if (teg_stopped(pace)) break;",
            *self._block(step.body, depth + 1),
            f"teg_add_covered(&{at}, {step.places}, (const double[]){{{given}}}, {moving});",
        ]
        gap = [
            f"const double {step.left} = k < {count} ? {at}.ends[{width} * k] : {at}.first;",
            f"const double {step.right} = k < {count} ? {at}.ends[{width} * k + 1] : {at}.last;",
            f"if (!teg_is_piece({step.left}, {step.right})) break;",
            *(
                f"const double {name} = k < {count} ? {at}.ends[{width} * k + {2 + side}] : {last_one};"
                for side, (name, last_one) in enumerate(zip(step.moving, (f"{at}.outer", *outer[1:]), strict=False))
            ),
            *self._block(step.inside, depth + 1),
            *packed(f"{r} += {spelled(v)};" for r, v in zip(step.results, step.terms, strict=True)),
        ]
        lost = f"isnan({first}) || isnan({last})"
        on_line = [
            *(line for run in before for line in (*self._run(run), *named(run))),
            f"for (int64_t {step.index} = {lo}; {step.index} < {spelled(step.hi)} && !{at}.closed; {step.index}++) {{",
            *indent(*candidate),
            "}",
            f"const int64_t {count} = teg_find_gaps(&{at});",
            *packed([f"{r} = {at}.lost ? NAN : 0.0" for r in step.results], "", ", ", ";"),
            f"for (int64_t k = 0; k <= {count} && !{at}.lost; k++) {{",
            *indent(*gap),
            "}",
        ]
        return [
            f"teg_gaps {at} = {{{first}, {last}, NULL, 0, 0, {lost}, 0, 0, 0, {width}, {outer[0] if outer else '0.0'}}};",
            *packed([f"{r} = {at}.lost ? NAN : 0.0" for r in step.results], "double ", ", ", ";"),
            f"if ({first} < {last}) {{",
            *indent(*on_line),
            "}",
            f"if ({at}.full) note |= {NO_MEMORY};",
            f"if ({at}.doubtful) ctx.missed = 1;",
            *(f"const double {name} = {at}.doubtful;" for name in step.doubtful),
            f"free({at}.ends);",
        ]

    def _taken(self, step: Take) -> str:
        """Returns a number of a table."""
        if step.table not in self.widths:
            return self._derivative(step)
        return f"{step.table}[{spelled(step.row)} * {self.widths[step.table]} + {step.column}]"

    def _new_table(self, name: str, rows: str, columns: int) -> list[str]:
        """Returns the declaration of a table of zeros, which is freed at the end of the function."""
        self.widths[name] = columns
        freed = [f"free({other});" for other in self.widths]
        return [
            f"const int64_t {name}_size = {rows} * {columns};",
            f"teg_reserve({name}_size);",
            f"double *const {name} = calloc((size_t){name}_size + 1, sizeof *{name});",
            f"if (!{name}) {{",
            *indent(*freed, "return -1;"),
            "}",
        ]

    def _rows(self, step: Rows, depth: int) -> list[str]:
        """Returns the rows of a table."""
        name, width = step.table, len(step.values)
        stored = packed(f"{name}[{step.index} * {width} + {j}] = {spelled(v)};" for j, v in enumerate(step.values))
        inside = [*self._skipped(step), "if (teg_stopped(pace)) break;", *self._block(step.body, depth + 1), *stored]
        head = f"for (int64_t {step.index} = 0; {step.index} < {spelled(step.hi)}; {step.index}++) {{"
        return self._with_list(step, [*self._new_table(name, spelled(step.hi), width), head, *indent(*inside), "}"])

    def _with_list(self, step: Loop, lines: list[str]) -> list[str]:
        """Returns lines in front of which it is found which rows are listed, if only these are iterations: once for all loops over the same
        rows."""
        if step.listed < 0:
            return lines
        name = f"{step.index}_listed"
        rows = step.listed, spelled(step.hi)
        if rows in self.lists:
            return [f"const unsigned char *const {name} = {self.lists[rows]};", *lines]
        self.lists[rows] = name
        count = " * ".join(f"s{step.listed}[{axis}]" for axis in range(self.program.arrays[step.listed].dimensions))
        return [
            f"unsigned char *const {name} = teg_listed(a{step.listed}, {count}, {spelled(step.hi)});",
            f"if (!{name}) note |= {NO_MEMORY};",
            *lines,
        ]

    def _added_to_table(self, step: AddTo, block: Sequence[Step]) -> list[str]:
        """Returns lines that add to a table; the first ones of a block mark the row."""
        width = self.widths[step.table]
        row = f"{spelled(step.row)} * {width}"
        first = next(s for s in block if isinstance(s, AddTo) and (s.table, s.row) == (step.table, step.row)) is step
        target, copied = target_of(step.table), step.table in self.copied
        marks = target.marked(row, width) if first and copied else []
        return [*marks, target.added(f"{row} + {step.column}", spelled(step.value), copied)]

    def _skipped(self, loop: Loop) -> list[str]:
        """Returns lines that leave out what is not listed, or adds nothing."""
        if isinstance(loop, SeenLoop):
            return self._unseen(loop.table, loop.index)
        return [f"if (!{loop.index}_listed || !{loop.index}_listed[{loop.index}]) continue;"] if loop.listed >= 0 else []

    def _without_edges(self, loop: Loop, depth: int, ends: Sequence[str]) -> list[str]:
        """Returns lines that do an iteration for a candidate that has no edges: all derivatives by its forms are 0."""
        if not isinstance(loop, SeenLoop) or not self.sources[loop.table].kept or not all(isinstance(s, FLAT) for s in loop.body):
            return []
        forms = self.sources[loop.table].columns
        taken = [s for s in loop.body if isinstance(s, Take) and (s.table, s.row) == (loop.table, loop.index)]
        body = with_zeros(loop.body, {s.name for s in taken if s.column < forms})
        runs = ([s for s in steps if isinstance(s, Run)] for steps in (loop.body, body))
        self.routines |= {id(run): self.routines[id(old)] for old, run in zip(*runs, strict=True)}
        self.by_moments.append(body)  # keeps what `routines` knows by its identity
        lines = [*self._block(body, depth), *packed(_unread(body, loop.values)), *ends, "continue;"]
        return [f"if ({self._has_no_edges(loop.table, loop.index)}) {{", *indent(*lines), "}"]

    def _without_candidates(self, loop: Loop, cut: int, depth: int, ends: Sequence[str]) -> list[str]:
        """Returns lines that do the rest of an iteration, from its cells on, if there are no candidates: all that is taken from them are
        integrals of what is outside."""
        cells, rest = loop.body[cut], loop.body[cut + 1 :]
        flat = [s for s in rest if isinstance(s, FLAT)]
        over = [s for s in rest if isinstance(s, SeenLoop) and isinstance(cells, Cells) and (s.lo, s.hi) == (cells.lo, cells.hi)]
        combined = [s for s in rest if isinstance(s, Combined)]
        if not isinstance(cells, Cells) or not self._is_kept(cells) or len(flat) + len(over) + len(combined) < len(rest):
            return []
        if not {*cells.tables, *(s.table for s in combined)}.isdisjoint(s.table for s in flat if isinstance(s, Take)):
            return []
        live, body = set(loop.values), list[Step]()
        for step in reversed(flat):
            if isinstance(step, AddTo | Scatter) or not live.isdisjoint(result_names(step)):
                live.update(operands(step))
                body.insert(0, step)
        given = [*self._outside(cells), *((r, "0.0") for s in over for r in s.results)]
        numbers = packed([f"{name} = {value}" for name, value in given if name in live], "const double ", ", ", ";")
        lines = [*numbers, *self._block(body, depth), *packed(_unread(body, loop.values)), *ends, "continue;"]
        return [f"if ({spelled(cells.hi)} <= {spelled(cells.lo)}) {{", *indent(*lines), "}"]


def _unread(body: Sequence[Step], values: Sequence[Arg]) -> list[str]:
    """Returns lines that say that results of flat programs are not read."""
    read = {a for s in body for a in operands(s)} | set(values)
    return [f"(void){name};" for s in body if isinstance(s, Run) for name in s.results if name not in read]


def needed(block: Sequence[Step], wanted: set[Arg]) -> list[Step]:
    """Returns the steps of a block without loops that matter for these names."""
    live, kept = set(wanted), []
    for step in reversed(block):
        if not live.isdisjoint(result_names(step)):
            live.update(operands(step))
            kept.append(step)
    return kept[::-1]


def only_run(loop: Loop) -> Run | None:
    """Returns the flat program of an innermost loop that has just one."""
    runs = [s for s in loop.body if isinstance(s, Run)]
    return runs[0] if len(runs) == 1 and not any(isinstance(s, Loop) for s in loop.body) else None


def target_of(to: int | str) -> Target:
    """Returns an output, or a table."""
    return Target(to, f"{to}_size") if isinstance(to, str) else Target(f"t{to}", f"n{to}")


def named(step: Run) -> list[str]:
    """Returns names for the results of a flat program."""
    return packed([f"{name} = {array_of(step)}[{j}]" for j, name in enumerate(step.results)], "const double ", ", ", ";")


def array_of(step: Run) -> str:
    """Returns the results of a flat program in C."""
    return f"r{step.results[0][1:]}"


def place_of(array: int, subscripts: Sequence[Arg]) -> str:
    """Returns the place of an entry, row by row."""
    place = spelled(subscripts[0])
    for axis, s in enumerate(subscripts[1:], 1):
        place = f"({place}) * s{array}[{axis}] + {spelled(s)}"
    return place
