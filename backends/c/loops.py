"""Programs with arrays as C99: nested loops, gathers, flat programs, scatters, one after the other without temporary arrays.

    compile_c_arrays(program)  ->  CArrayKernel: a call gives every output

A flat program is a static function, as integrals are in `c_print`. An outermost loop is cut into chunks, which threads share. Each chunk
adds into sums, and into copies of the outputs that are scattered into, of its own; then these are added in the order of the chunks. How
many there are depends on the number of iterations, on what one costs, and on the size of the outputs, never on the number of threads:
results have the same bits for any.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.branches import with_branches_in_loops
from teg.backends.c.batch import ABI, exported, unwatched
from teg.backends.c.build import load_library
from teg.backends.c.chunks import Chunked, Target
from teg.backends.c.crossed import POINTS
from teg.backends.c.frame import Routine
from teg.backends.c.kernel import LONG, optimisation
from teg.backends.c.lanes import SIDE, Straight, decisive_branch
from teg.backends.c.printer import Printer
from teg.backends.c.queues import Queue, queue_of
from teg.backends.c.runtime import runtime
from teg.backends.c.signals import Caller
from teg.backends.c.tabled import tabled_entry
from teg.backends.c.text import indent, literal, packed, wrapped
from teg.backends.c.threads import team_size
from teg.backends.numpy.loops import Results
from teg.errors import BackendError
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import Integrate, compound, has_ties
from teg.program.arrays import (
    AddTo,
    Arg,
    ArrayProgram,
    Blank,
    Cells,
    Factors,
    Integers,
    Least,
    Like,
    Load,
    Loop,
    Number,
    Rows,
    Run,
    Scatter,
    Step,
    Take,
    scattered,
    steps,
    work,
)
from teg.program.fields import operands, result_names
from teg.program.joined import input_residues
from teg.program.summed import summed, with_enclosing
from teg.program.tabled import TabledProgram

BY_VALUE = 120
"""Inputs of a flat program that are C arguments: it is called in one place, and inlined there."""
ON_STACK = 512
"""Numbers in a workspace that is on the C stack."""
NO_MEMORY = 16
"""The bit of a note that says that there was no memory for cells."""
CELLS_ON_STACK = 1024
"""Numbers of candidates and tables that are on the C stack."""


class _View(ctypes.Structure):
    _fields_ = [("data", ctypes.c_void_p), ("stride", ctypes.c_long), ("shape", ctypes.c_void_p)]


class CArrayKernel:
    """A compiled program with arrays. `source` is its C text; pickling keeps the program and compiles it again."""

    def __init__(self, program: ArrayProgram, threads: int = 1) -> None:
        self.program = program
        self.threads = threads
        self.source = print_arrays(program)
        self._call = Caller(load_library(self.source, optimise=optimisation(self.source), openmp=threads != 1))

    def __reduce__(self) -> tuple[object, ...]:
        return (CArrayKernel, (self.program, self.threads))

    @property
    def address(self) -> int:
        """Returns the address of the kernel that can be watched (`teg_kernel_watched`) in this process."""
        return self._call.address

    def results(self, columns: Sequence[npt.NDArray[Any]], arrays: Sequence[npt.NDArray[Any]], n: int) -> Results:
        """Returns the outputs of a batch of n, as `LaneKernel.results` gives them. Subscripts have been checked."""
        specs = self.program.arrays
        kept = [np.asarray(c, dtype=np.float64, order="C") for c in columns]
        data = [np.ascontiguousarray(a, dtype=np.int64 if s.integers else np.float64) for a, s in zip(arrays, specs, strict=True)]
        shapes = [np.array(a.shape[a.ndim - s.dimensions :], dtype=np.int64) for a, s in zip(data, specs, strict=True)]
        views = (_View * max(len(data), 1))()
        for view, a, shape, spec in zip(views, data, shapes, specs, strict=False):
            view.data, view.shape = a.ctypes.data, shape.ctypes.data
            view.stride = int(np.prod(shape)) if a.ndim > spec.dimensions else 0
        out = [np.zeros((n, *shapes[o.array])) if isinstance(o, Like) else np.empty(n) for o in self.program.outputs]
        pointers = np.array([c.ctypes.data for c in kept] or [0], dtype=np.uintp)
        strides = np.array([1 if c.ndim else 0 for c in kept] or [0], dtype=LONG)
        targets = np.array([o.ctypes.data for o in out] or [0], dtype=np.uintp)
        notes = np.zeros(n, dtype=LONG)
        team = team_size(self.threads)
        told = notes.ctypes.data
        if n and self._call.batch(n, pointers.ctypes.data, strides.ctypes.data, ctypes.addressof(views), targets.ctypes.data, told, team):
            raise BackendError("there is no memory for the kernel's workspace")
        noted = int(np.bitwise_or.reduce(notes)) if n else 0
        return Results(out, bool(noted & 2), 0, bool(noted & 4))


def compile_c_arrays(program: ArrayProgram, *, threads: int = 1) -> CArrayKernel:
    """Returns the program as a compiled C kernel (from the cache on disk if it was compiled before)."""
    return CArrayKernel(program, threads)


def print_arrays(program: ArrayProgram, name: str = "teg_kernel", tabled: TabledProgram | None = None) -> str:
    """Returns the translation unit; that of a `tabled` program takes no arrays, but fills them."""
    return _ArrayPrinter(program, name, tabled).text()


def _title(program: ArrayProgram) -> str:
    """Returns the comment at the top; of the users' names only harmless characters."""

    def harmless(text: str) -> str:
        return re.sub(r"[^A-Za-z0-9_ ]", "_", text)[:40]

    lines = [f"p[{i}] = {harmless(p)}" for i, p in enumerate(program.parameters[:40])]
    for i, a in enumerate(program.arrays):
        lines.append(f"a[{i}] = {harmless(a.name)}: {a.dimensions} dimensions of {'int64_t' if a.integers else 'double'}")
    for j, o in enumerate(program.outputs[:40]):
        if isinstance(o, Like):
            lines.append(f"out[{j}]: an array like a[{o.array}]")
    return "\n".join([f"/* Generated by teg. {len(program.outputs)} outputs.", *(f" * {line}" for line in lines), " */"])


class _ArrayPrinter:
    def __init__(self, program: ArrayProgram, name: str, tabled: TabledProgram | None) -> None:
        self.program, self.name, self.tabled = with_branches_in_loops(program), name, tabled
        program = self.program
        self.printer = Printer()
        self.routines: dict[int, Routine] = {}
        self.tables: dict[str, Cells] = {}
        self.widths: dict[str, int] = {}  # the columns of tables of rows
        self.shapes: dict[str, str] = {}  # the rules of the shapes of cells, by name
        self.space = 0
        self.copied: frozenset[int | str] = frozenset()  # the outputs and tables of which the chunk that is printed has a copy
        self.straights: dict[int, Straight] = {}  # of the only flat program of an innermost loop
        self.queues: dict[int, Queue] = {}  # of such a flat program
        self.telling: set[int] = set()  # the flat programs that return whether their branch is taken
        candidates: list[tuple[Loop, Run, Queue | None]] = []
        for loop, around in with_enclosing(program.body):
            if only := _only_run(loop):
                found = summed(loop, only, around)
                candidates.append((loop, only, queue_of(found) if found else None))
        connected = [input_residues(program.body, [q.run for _, _, q in candidates if q], point) for point in range(POINTS)]
        for loop, only, queue in candidates:
            inside = {name for s in loop.body for name in result_names(s)}
            varying = {i for i, arg in enumerate(only.inputs) if arg in inside}
            numbers = {s.name for s in loop.body if isinstance(s, Number) and s.integer == loop.index}
            counted = {i for i, arg in enumerate(only.inputs) if arg in numbers}
            if not varying or not (made := self.printer.packed(only.program, varying, SIDE, counted)):
                continue
            if queue:
                made = self.printer.with_crossed(made, queue.run.program, queue.varying, [c[id(queue.run)] for c in connected])
                if made.crossed:
                    self.queues[id(only)] = queue
            self.straights[id(only)] = made
        for step in steps(program.body):
            if isinstance(step, Run):
                queue = self.queues.get(id(step))
                branch = None if id(step) in self.straights else decisive_branch(step.program)
                self.telling |= {id(step)} if branch else set()
                run = queue.run if queue else step
                routine = self.printer.element(run.program, "rest" if queue else "run", BY_VALUE, branch.when if branch else None)
                self.routines[id(run)] = routine
                again = len(step.results) if has_ties(step.program.body) else 0
                self.space = max(self.space, routine.workspace + again + len(step.results))
        self.context = any(r.context for r in self.routines.values())

    def text(self) -> str:
        printer = self.printer
        loops = wrapped(list(self._element()))
        entry = wrapped(list(self._entry() if self.tabled is None else tabled_entry(self.tabled, self.name, NO_MEMORY)))
        texts = [*printer.tables(), *printer.texts, loops, entry]
        only = [f"#define TEG_SHAPE(shape) (&{name})" for name in self.shapes if len(self.shapes) == 1]
        first, *needed = runtime([*texts, "teg_context"], {"teg_shape": "\n".join([*self.shapes.values(), *only])})
        return "\n\n".join([_title(self.program), first, ABI, *needed, *texts]) + "\n"

    # -- one element ---------------------------------------------------------------------------------------------------

    def _element(self) -> Iterator[str]:
        """Yields the function of one element of the batch: returns a note, or -1 without memory."""
        program = self.program
        targets = scattered(program.body)
        yield "static long element("
        yield "    long e, const double *const *p, const long *stride, const teg_array *a, double *const *out, teg_pace *pace, int team)"
        yield "{"
        lines = [f"const double p{i} = p[{i}][e * stride[{i}]];" for i in range(len(program.parameters))]
        for i, spec in enumerate(program.arrays):
            kind = "int64_t" if spec.integers else "double"
            lines.append(f"const {kind} *const a{i} = (const {kind} *)a[{i}].data + e * a[{i}].stride;")
            lines.append(f"const int64_t *const s{i} = a[{i}].shape;")
        for j in targets:
            like = program.outputs[j]
            assert isinstance(like, Like)
            size = " * ".join(f"s{like.array}[{axis}]" for axis in range(program.arrays[like.array].dimensions))
            lines += [f"const int64_t n{j} = {size};", f"double *const t{j} = out[{j}] + e * n{j};"]
            lines.append(f"for (int64_t k = 0; k < n{j}; k++) t{j}[k] = 0.0;")
        lines += [f"double w[{self.space}];", "(void)w;"] if 0 < self.space <= ON_STACK else []
        lines += [f"double *const w = malloc({self.space} * sizeof *w);", "if (!w) return -1;"] if self.space > ON_STACK else []
        lines += ["teg_context ctx = {+1, 0, 0, 0, 0, 0, pace};", "long note = 0;"]
        lines += self._block(program.body, 0)
        for j, o in enumerate(program.outputs):
            if not isinstance(o, Like):
                lines.append(f"out[{j}][e] = {_spell(o)};")
        lines += [f"free({name});" for name in self.widths]
        lines += ["free(w);"] if self.space > ON_STACK else []
        used = " ".join(f"(void)p{i};" for i in range(len(program.parameters)))
        used += " ".join(f" (void)a{i}, (void)s{i};" for i in range(len(program.arrays)))
        lines += [used] if used else []
        lines += [
            "(void)ctx, (void)pace, (void)team, (void)p, (void)stride, (void)a;",
            "return note | 2 * (ctx.missed != 0) | 4 * ctx.crowded;",
        ]
        yield from indent(*lines)
        yield "}"

    def _block(self, block: Sequence[Step], depth: int, decisive: Run | None = None) -> list[str]:
        """Returns the lines of a block, in which a decisive flat program may end the iteration. Recursion is as deep as loops are."""
        lines: list[str] = []
        held = [s for s in block if isinstance(s, Cells)]
        for step in block:
            match step:
                case Integers():
                    lines.append(f"const int64_t {step.name} = {self._integers(step)};")
                case Number():
                    lines.append(f"const double {step.name} = (double){_spell(step.integer)};")
                case Load():
                    lines.append(f"const double {step.name} = a{step.array}[{_flat(step.array, step.subscripts)}];")
                case Scatter():
                    place, value = _flat(step.array, step.subscripts), _spell(step.value)
                    target, copied = _target(step.output), step.output in self.copied
                    lines += [target.added(place, value, copied), *(target.marked(place) if copied else [])]
                case AddTo():
                    lines += self._added_to_table(step, block)
                case Blank():
                    lines += self._new_table(step.table, _spell(step.rows), step.columns)
                case Rows():
                    lines += self._rows(step, depth)
                case Run():
                    lines += [*self._run(step), *_named(step)]
                    if step is decisive:
                        lines.append(f"if (!{_array(step)}_taken) continue;")
                case Least() | Factors():
                    lines += self._fold(step, depth)
                case Cells():
                    lines += self._cells(step, depth)
                case Take():
                    lines.append(f"const double {step.name} = {self._taken(step)};")
                case Loop() if depth:
                    lines += self._loop(step, depth)
                case Loop():
                    lines += self._chunks(step)
        return [*lines, *(f"if ({s.results[0]}_rows != {s.results[0]}_here) free({s.results[0]}_rows);" for s in held)]

    def _integers(self, step: Integers) -> str:
        args = [_spell(a) for a in step.args]
        match step.op:
            case "length":
                return f"s{step.array}[{args[0]}]"
            case "param":
                return f"(int64_t)p{step.args[0]}"
            case "gather":
                return f"a{step.array}[{_flat(step.array, step.args)}]"
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
        array = _array(step)
        below = routine.workspace
        inputs = [_spell(a) if isinstance(a, str) else literal(float(a)) for a in step.inputs]

        passed = [*([] if routine.indirect else inputs), array, *["w"] * (routine.workspace > 0), *["&ctx"] * routine.context]
        told = id(step) in self.telling
        call = f"{f'{array}_taken = ' if told else ''}{routine.name}({', '.join(passed)});"
        gather = packed(f"w[{i}] = {value};" for i, value in enumerate(inputs)) if routine.indirect else []
        gather += ["ctx.work = 0;"] if any(isinstance(s, Integrate) for s in compound(step.program.body)) else []
        lines = [f"double {array}[{count}];", *([f"int {array}_taken;"] if told else [])]
        if not ties:
            return [*lines, *gather, call]
        first = f"(w + {below})"
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

    def _fold(self, step: Least | Factors, depth: int) -> list[str]:
        """Returns a loop for the index of the least value, or for a product."""
        found = step.results
        if isinstance(step, Factors):
            start = [f"double {r} = 1.0;" for r in found]
            each = [f"{r} *= {_spell(v)};" for r, v in zip(found, step.values, strict=True)]
        else:
            start = [f"double {r} = -1.0, {r}_least = INFINITY;" for r in found]
            each = [
                f"teg_least({_spell(v)}, {_spell(p)}, {step.index}, &{r}_least, &{r});"
                for r, v, p in zip(found, step.values, step.eligible, strict=True)
            ]
        inside = ["if (teg_stopped(pace)) break;", *self._block(step.body, depth + 1), *each]
        lo, hi = _spell(step.lo), _spell(step.hi)
        return [*start, f"for (int64_t {step.index} = {lo}; {step.index} < {hi}; {step.index}++) {{", *indent(*inside), "}"]

    def _cells(self, step: Cells, depth: int) -> list[str]:
        """Returns the numbers of all candidates, and the cells that are made of them."""
        shape, wide = step.shape, len(step.values)
        at, count = step.results[0], len(step.results)
        lo, hi = _spell(step.lo), _spell(step.hi)
        columns = shape.columns * (1 + shape.order)
        stored = [f"{at}_rows[({step.index} - {lo}) * {wide} + {j}] = {_spell(v)};" for j, v in enumerate(step.values)]
        inside = ["if (teg_stopped(pace)) break;", *self._block(step.body, depth + 1), *packed(stored)]
        given = ", ".join(_spell(v) if isinstance(v, str) else literal(float(v)) for v in step.otherwise)
        table = f"{at}_tables" if step.tables else "NULL"
        lines = [
            f"const int64_t {at}_n = {hi} - {lo};",
            f"const size_t {at}_wide = (size_t){at}_n * {wide};",
            f"const size_t {at}_size = {f'{count} * (size_t)({at}_n + 1) * {columns}' if step.tables else '0'};",
            f"const size_t {at}_bytes = ({at}_wide + {at}_size) * sizeof(double);",
            f"double {at}_here[{CELLS_ON_STACK}], {at}_values[{count}]{f', {at}_sizes[{count}]' if step.sizes else ''};",
            f"double *const {at}_rows = {at}_bytes <= sizeof {at}_here ? {at}_here : malloc({at}_bytes);",
            *([f"double *const {at}_tables = {at}_rows + {at}_wide;"] if step.tables else []),
            f"const double {at}_otherwise[{len(step.otherwise)}] = {{{given}}};",
            f"for (int64_t {step.index} = {lo}; {at}_rows && {step.index} < {hi}; {step.index}++) {{",
            *indent(*inside),
            "}",
        ]
        sizes = f"{at}_sizes" if step.sizes else "NULL"
        call = f"teg_cells(&{self._shape(step)}, {at}_n, {at}_rows, {at}_otherwise, {at}_values, {sizes}, {table})"
        lines += [f"if (!{at}_rows || {call}) {{", *indent(f"note |= {NO_MEMORY};", f"teg_fill({at}_values, {count}, NAN);"), "}"]
        lines += packed([f"{r} = {at}_values[{j}]" for j, r in enumerate(step.results)], "const double ", ", ", ";")
        lines += packed([f"{r} = {at}_sizes[{j}]" for j, r in enumerate(step.sizes)], "const double ", ", ", ";") if step.sizes else []
        for j, name in enumerate(step.tables):
            self.tables[name] = step
            lines.append(f"const double *const {name} = {at}_rows ? {at}_tables + {j} * ({at}_n + 1) * {columns} : NULL;")
        return lines

    def _taken(self, step: Take) -> str:
        """Returns a number of a table."""
        if step.table in self.widths:
            return f"{step.table}[{_spell(step.row)} * {self.widths[step.table]} + {step.column}]"
        cells = self.tables[step.table]
        width = cells.shape.columns * (1 + cells.shape.order)
        return f"{step.table} ? {step.table}[({_spell(step.row)} - {_spell(cells.lo)}) * {width} + {step.column}] : NAN"

    def _new_table(self, name: str, rows: str, columns: int) -> list[str]:
        """Returns the declaration of a table of zeros, which is freed at the end of the function."""
        self.widths[name] = columns
        freed = [f"free({other});" for other in self.widths]
        return [
            f"const int64_t {name}_size = {rows} * {columns};",
            f"double *const {name} = calloc((size_t){name}_size + 1, sizeof *{name});",
            f"if (!{name}) {{",
            *indent(*freed, "return -1;"),
            "}",
        ]

    def _rows(self, step: Rows, depth: int) -> list[str]:
        """Returns the rows of a table."""
        name, width = step.table, len(step.values)
        stored = packed(f"{name}[{step.index} * {width} + {j}] = {_spell(v)};" for j, v in enumerate(step.values))
        inside = [*_skipped(step), "if (teg_stopped(pace)) break;", *self._block(step.body, depth + 1), *stored]
        head = f"for (int64_t {step.index} = 0; {step.index} < {_spell(step.hi)}; {step.index}++) {{"
        return self._with_list(step, [*self._new_table(name, _spell(step.hi), width), head, *indent(*inside), "}"])

    def _with_list(self, step: Loop, lines: list[str]) -> list[str]:
        """Returns lines around which it is known which rows are listed, if only these are iterations."""
        if step.listed < 0:
            return lines
        name = f"{step.index}_listed"
        count = " * ".join(f"s{step.listed}[{axis}]" for axis in range(self.program.arrays[step.listed].dimensions))
        return [
            f"unsigned char *const {name} = teg_listed(a{step.listed}, {count}, {_spell(step.hi)});",
            f"if (!{name}) note |= {NO_MEMORY};",
            *lines,
            f"free({name});",
        ]

    def _added_to_table(self, step: AddTo, block: Sequence[Step]) -> list[str]:
        """Returns lines that add to a table; the first ones of a block mark the row."""
        width = self.widths[step.table]
        row = f"{_spell(step.row)} * {width}"
        first = next(s for s in block if isinstance(s, AddTo) and (s.table, s.row) == (step.table, step.row)) is step
        target, copied = _target(step.table), step.table in self.copied
        marks = target.marked(row, width) if first and copied else []
        return [*marks, target.added(f"{row} + {step.column}", _spell(step.value), copied)]

    def _shape(self, step: Cells) -> str:
        """Returns the name of a shape, of which a table is printed."""
        shape = step.shape
        name = f"cells_{shape.parts}_{shape.guards}_{shape.degree}_{shape.order}_{len(step.results)}"
        if name not in self.shapes:
            rule = [literal(v) for node in triangle_rule(shape.degree) for v in node]
            nodes, weights = gauss_legendre((shape.degree + 1) // 2 + 1)
            gauss = [literal(v) for x, w in zip(nodes, weights, strict=True) for v in (0.5 + 0.5 * x, 0.5 * w)]
            numbers = (
                f"{shape.parts}, {shape.guards}, {shape.degree}, {shape.order}, {len(step.results)}, {len(rule) // 3}, {len(gauss) // 2}"
            )
            self.shapes[name] = "\n".join(
                [
                    f"static const double {name}_rule[] = {{{', '.join(rule)}}};",
                    f"static const double {name}_gauss[] = {{{', '.join(gauss)}}};",
                    f"static const teg_shape {name} = {{{numbers}, {name}_rule, {name}_gauss}};",
                ]
            )
        return name

    def _loop(self, step: Loop, depth: int) -> list[str]:
        """Returns a loop inside another one."""
        sums = packed([f"{r} = 0.0" for r in step.results], "double ", ", ", ";") if step.results else []
        return [*sums, *self._iterations(step, _spell(step.lo), _spell(step.hi), depth + 1)]

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
        given = [_spell(queue.run.inputs[i]) for i in straight.steady_by]
        return [*queue.opened(), f"double {name}[{straight.kept}];", f"{straight.steady}({', '.join([*given, name])});"]

    def _flushed(self, queue: Queue) -> list[str]:
        """Returns lines that compute the iterations in a queue; if it is not full, the last one is repeated."""
        run, name, array, count = queue.run, queue.name, _array(queue.run), len(queue.run.results)
        straight = self._straight_of(queue)
        given = [f"queue_{name}[{queue.varying.index(i)}]" if i in queue.varying else _spell(run.inputs[i]) for i in straight.crossed_by]
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
        only = _only_run(step)
        if only and id(only) in self.straights:
            return self._side_by_side(step, only, lo, hi, depth)
        inside = [*_skipped(step), "if (teg_stopped(pace)) break;"]
        inside += [*self._block(step.body, depth, _decisive(step)), *self._added(step)]
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
            given = packed(f"q{i}[k] = {_spell(run.inputs[i])};" for i in moving)
            names = packed([f"q{i}[{SIDE}]" for i in moving], "double ", ", ", ";")
            return [*names, f"for (int k = 0; k < {SIDE}; k++) {{", *indent(index, *lines, *given), "}"]

        def arguments(wanted: Sequence[int], *more: str) -> str:
            values = [run.inputs[i] for i in wanted]
            return ", ".join([*(f"q{i}" if v in inside else _spell(v) for i, v in zip(wanted, values, strict=True)), *more])

        adding = not _only_adds(step, run)  # whether an iteration that is not live has something to add
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
            *([] if queue and not queue.after else [*_named(run), *self._block(after, depth), *self._added(step)]),
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
        array, count = _array(run), len(run.results)
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
        return [f"{r} += {_spell(v)};" for r, v in zip(step.results, step.values, strict=True) if v not in inner]

    def _chunks(self, step: Loop) -> list[str]:
        """Returns an outermost loop, which threads share."""
        targets = _shared(step)
        own = [f"double w[{self.space}];", "(void)w;"] if 0 < self.space <= ON_STACK else []
        heap = self.space > ON_STACK
        own += [f"double *const w = malloc({self.space} * sizeof *w);"] if heap else []
        inside = self._in_chunk(step, targets)
        bounds = _spell(step.lo), _spell(step.hi)
        chunked = Chunked(*bounds, work(step.body), step.results, [_target(to) for to in targets], own, inside, heap)
        return self._with_list(step, chunked.lines())

    def _in_chunk(self, step: Loop, targets: Sequence[int | str]) -> list[str]:
        """Returns the iterations of a chunk, which scatter into its own copies."""
        self.copied = frozenset(targets)
        lines = self._iterations(step, "first", "last", 1)
        self.copied = frozenset()
        return lines

    # -- the batch -----------------------------------------------------------------------------------------------------

    def _entry(self) -> Iterator[str]:
        """Yields the exported functions. A single element is given all threads, elements of a batch one each."""
        yield from (
            *exported(self.name)[0],
            "{",
            *indent(
                "const int team = threads > 1 && n > 1 ? threads : 1, inner = n > 1 ? 1 : threads;",
                "teg_watch watch = {poll, data, 0};",
                "int failed = 0, working = 0;",
                "(void)team, (void)working;",
                "#ifdef _OPENMP",
                "#pragma omp parallel num_threads(team) if (team > 1)",
                "#endif",
                "{",
                *indent(
                    "teg_pace pace = {&watch, 0, 16};",
                    "#ifdef _OPENMP",
                    "#pragma omp atomic",
                    "working++;",
                    "#pragma omp barrier",
                    "#pragma omp master",
                    "#endif",
                    "pace.caller = 1;",
                    "#ifdef _OPENMP",
                    "#pragma omp for schedule(dynamic, 1) nowait",
                    "#endif",
                    "for (long e = 0; e < n; e++) {",
                    *indent(
                        "long note;",
                        "if (teg_stopped(&pace)) continue;",
                        "note = element(e, p, stride, a, out, &pace, inner);",
                        f"if (note < 0 || note & {NO_MEMORY}) failed = 1;",
                        "if (notes) notes[e] = note;",
                    ),
                    "}",
                    "#ifdef _OPENMP",
                    "teg_wait(&pace, &working);",
                    "#endif",
                ),
                "}",
                "return failed ? 1 : watch.stopped ? 2 : 0;",
            ),
            "}",
            "",
            *unwatched(self.name),
        )


def _only_run(loop: Loop) -> Run | None:
    """Returns the flat program of an innermost loop that has just one."""
    runs = [s for s in loop.body if isinstance(s, Run)]
    return runs[0] if len(runs) == 1 and not any(isinstance(s, Loop) for s in loop.body) else None


def _narrowed(step: Loop, run: Run, straight: Straight, lo: str, hi: str) -> tuple[list[str], str, str]:
    """Returns lines that leave out iterations at both ends that have no result but 0, and the range that is left."""
    numbers = {s.name for s in step.body if isinstance(s, Number) and s.integer == step.index}
    start, stop, heights = (f"{step.index}_{part}" for part in ("start", "stop", "height"))

    def call(row: int, index: str) -> str:
        values = [f"(double)({index})" if run.inputs[i] in numbers else _spell(run.inputs[i]) for i in straight.narrowed_by]
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


def _shared(loop: Loop) -> list[int | str]:
    """Returns the outputs and tables that iterations of a loop add to in the same places: not those with its index in a subscript."""
    axes: dict[int | str, set[int]] = {}
    for s in steps(loop.body):
        if isinstance(s, Scatter | AddTo):
            to, places = (s.output, s.subscripts) if isinstance(s, Scatter) else (s.table, (s.row,))
            own = {axis for axis, i in enumerate(places) if i == loop.index}
            axes[to] = axes.get(to, own) & own
    return [to for to in sorted(axes, key=str) if not axes[to]]


def _target(to: int | str) -> Target:
    """Returns an output, or a table."""
    return Target(to, f"{to}_size") if isinstance(to, str) else Target(f"t{to}", f"n{to}")


def _needed(block: Sequence[Step], wanted: set[Arg]) -> list[Step]:
    """Returns the steps of a block without loops that matter for these names."""
    live, kept = set(wanted), []
    for step in reversed(block):
        if not live.isdisjoint(result_names(step)):
            live.update(operands(step))
            kept.append(step)
    return kept[::-1]


def _skipped(loop: Loop) -> list[str]:
    """Returns lines that leave out what is not listed."""
    return [f"if (!{loop.index}_listed || !{loop.index}_listed[{loop.index}]) continue;"] if loop.listed >= 0 else []


def _decisive(loop: Loop) -> Run | None:
    """Returns a flat program without whose branch an iteration adds nothing to anything."""
    if any(isinstance(s, Cells) for s in loop.body):
        return None  # what they hold is freed at the end of an iteration
    runs = (s for s in loop.body if isinstance(s, Run) and decisive_branch(s.program) is not None)
    return next((s for s in runs if _only_adds(loop, s)), None)


def _only_adds(loop: Loop, run: Run) -> bool:
    """Returns whether nothing but results of a flat program is added to anything in an iteration."""
    rest = loop.body[loop.body.index(run) + 1 :]
    added = [*loop.values, *(s.value for s in rest if isinstance(s, Scatter))]
    return all(isinstance(s, Scatter) for s in rest) and set(added) <= set(run.results)


def _named(step: Run) -> list[str]:
    """Returns names for the results of a flat program."""
    return packed([f"{name} = {_array(step)}[{j}]" for j, name in enumerate(step.results)], "const double ", ", ", ";")


def _array(step: Run) -> str:
    """Returns the results of a flat program in C."""
    return f"r{step.results[0][1:]}"


def _spell(arg: Arg) -> str:
    """Returns a name, or a literal."""
    if isinstance(arg, str):
        return arg
    if isinstance(arg, float):
        return literal(arg)
    return f"INT64_C({arg})" if arg >= 0 else f"(-INT64_C({-arg}))"


def _flat(array: int, subscripts: Sequence[Arg]) -> str:
    """Returns the place of an entry, row by row."""
    place = _spell(subscripts[0])
    for axis, s in enumerate(subscripts[1:], 1):
        place = f"({place}) * s{array}[{axis}] + {_spell(s)}"
    return place
