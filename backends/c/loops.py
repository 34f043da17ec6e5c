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
from teg.backends.c.cells import NO_MEMORY
from teg.backends.c.chunks import Chunked
from teg.backends.c.crossed import POINTS
from teg.backends.c.groups import around_carrier
from teg.backends.c.iterations import BY_VALUE, IterationPrinter
from teg.backends.c.kernel import LONG, optimisation
from teg.backends.c.lanes import SIDE, decisive_branch
from teg.backends.c.queues import Queue, queue_of
from teg.backends.c.runtime import runtime
from teg.backends.c.signals import Addresses, Caller
from teg.backends.c.steps import only_run, target_of
from teg.backends.c.straights import Waiting, side_by_side
from teg.backends.c.tabled import tabled_entry
from teg.backends.c.team import shared
from teg.backends.c.text import indent, spelled, wrapped
from teg.backends.c.threads import team_size
from teg.backends.numpy.loops import Results
from teg.errors import BackendError
from teg.program import has_ties
from teg.program.arrays import (
    AddTo,
    ArrayProgram,
    Like,
    Loop,
    Number,
    Run,
    Scatter,
    scattered,
    steps,
    work,
)
from teg.program.fields import operands, result_names
from teg.program.joined import input_residues
from teg.program.summed import summed, with_enclosing
from teg.program.tabled import TabledProgram

ON_STACK = 512
"""Numbers in a workspace that is on the C stack."""


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
        inputs, views_at, told = pointers.ctypes.data, ctypes.addressof(views), notes.ctypes.data
        if n and self._call.batch(n, Addresses(inputs, strides.ctypes.data, views_at, targets.ctypes.data, told), team):
            raise BackendError("there is no memory for the kernel's workspace")
        noted = int(np.bitwise_or.reduce(notes)) if n else 0
        return Results(out, bool(noted & 2), 0, bool(noted & 4), bool(noted & 1) and notes & 1 != 0)


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


class _ArrayPrinter(IterationPrinter):
    def __init__(self, program: ArrayProgram, name: str, tabled: TabledProgram | None) -> None:
        super().__init__(with_branches_in_loops(program))
        self.name, self.tabled, self.space = name, tabled, 0
        program = self.program
        candidates: list[tuple[Loop, Run, Queue | None]] = []
        outer = {id(s): loop for loop in steps(program.body) if isinstance(loop, Loop) for s in loop.body}
        for loop, around in with_enclosing(program.body):
            if only := only_run(loop):
                found = summed(loop, only, around)
                candidates.append((loop, only, queue_of(found) if found else None))
        connected = [input_residues(program.body, [q.run for _, _, q in candidates if q], point) for point in range(POINTS)]
        for loop, only, queue in candidates:
            inside = {name for s in loop.body for name in result_names(s)}
            varying = {i for i, arg in enumerate(only.inputs) if arg in inside}
            numbers = {s.name for s in loop.body if isinstance(s, Number) and s.integer == loop.index}
            counted = {i for i, arg in enumerate(only.inputs) if arg in numbers}
            waiting, eight = None, None
            if queue:
                residues = [c[id(queue.run)] for c in connected]
                alone = not queue.after and [q.carrier for _, _, q in candidates if q].count(queue.carrier) == 1
                eight = around_carrier(outer.get(id(queue.carrier)), queue.carrier) if alone else None
                groups = {i for i, arg in enumerate(queue.run.inputs) if arg in eight.made} if eight else None
                waiting = Waiting(queue.run.program, queue.varying, residues, None if queue.after else queue.added, groups)
            made = side_by_side(self.printer.once, only.program, varying, SIDE, counted, waiting) if varying else None
            if made:
                self.straights[id(only)] = made
            if made and made.crossed and queue:
                self.queues[id(only)] = queue
                if eight:
                    self.around[id(eight.loop)] = eight
        self.idle = self._idle()
        for step in steps(program.body):
            if isinstance(step, Run) and id(step) not in self.idle:
                queue = self.queues.get(id(step))
                branch = None if id(step) in self.straights else decisive_branch(step.program)
                self.telling |= {id(step)} if branch else set()
                run = queue.run if queue else step
                routine = self.printer.element(run.program, "rest" if queue else "run", BY_VALUE, branch.when if branch else None)
                self.routines[id(run)] = routine
                again = len(step.results) if has_ties(step.program.body) else 0
                self.space = max(self.space, routine.workspace + again + len(step.results))
        self.context = any(r.context for r in self.routines.values())

    def _idle(self) -> set[int]:
        """Returns the flat programs of whose results nothing is read: what waits in a queue has its own inputs, and so have its rows."""
        body = list(steps(self.program.body))
        wanted: set[object] = {*self.program.outputs, *(a for s in body if not isinstance(s, Run) for a in operands(s))}
        idle: set[int] = set()
        for step in reversed(body):
            straight = self.straights.get(id(step))
            if not isinstance(step, Run):
                continue
            if straight is not None and straight.spanned and straight.narrow is not None:
                wanted.update(self.queues[id(step)].run.inputs, (step.inputs[i] for i in straight.narrow.inputs))
            elif wanted.isdisjoint(step.results):
                idle.add(id(step))
            else:
                wanted.update(step.inputs)
        return idle

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
                lines.append(f"out[{j}][e] = {spelled(o)};")
        lines += [f"free({name});" for name in (*self.widths, *self.lists.values())]
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

    def _chunks(self, step: Loop) -> list[str]:
        """Returns an outermost loop, which threads share."""
        targets = _shared(step)
        own = [f"double w[{self.space}];", "(void)w;"] if 0 < self.space <= ON_STACK else []
        heap = self.space > ON_STACK
        own += [f"double *const w = malloc({self.space} * sizeof *w);"] if heap else []
        inside = self._in_chunk(step, targets)
        bounds = spelled(step.lo), spelled(step.hi)
        chunked = Chunked(*bounds, work(step.body), step.results, [target_of(to) for to in targets], own, inside, heap)
        return self._with_list(step, chunked.lines())

    def _in_chunk(self, step: Loop, targets: Sequence[int | str]) -> list[str]:
        """Returns the iterations of a chunk, which scatter into its own copies."""
        self.copied, self.chunk = frozenset(targets), []
        lines = self._iterations(step, "first", "last", 1)
        lines, self.copied, self.chunk = [*self.chunk, *lines], frozenset(), None
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
                *shared(
                    ["teg_pace pace = {&watch, 0, 16};"],
                    [
                        "for (long e = 0; e < n; e++) {",
                        *indent(
                            "long note;",
                            "if (teg_stopped(&pace)) continue;",
                            "note = element(e, p, stride, a, out, &pace, inner);",
                            f"if (note < 0 || note & {NO_MEMORY}) failed = 1;",
                            "if (notes) notes[e] = note;",
                        ),
                        "}",
                    ],
                ),
                "return failed ? 1 : watch.stopped ? 2 : 0;",
            ),
            "}",
            "",
            *unwatched(self.name),
        )


def _shared(loop: Loop) -> list[int | str]:
    """Returns the outputs and tables that iterations of a loop add to in the same places: not those with its index in a subscript."""
    axes: dict[int | str, set[int]] = {}
    for s in steps(loop.body):
        if isinstance(s, Scatter | AddTo):
            to, places = (s.output, s.subscripts) if isinstance(s, Scatter) else (s.table, (s.row,))
            own = {axis for axis, i in enumerate(places) if i == loop.index}
            axes[to] = axes.get(to, own) & own
    return [to for to in sorted(axes, key=str) if not axes[to]]
