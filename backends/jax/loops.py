"""Programs with arrays and sums as pure functions in JAX.

    ArrayFunction(program, compile)  ->  a function of scalars and arrays: every output, and a note

As in `numpy_arrays`, iterations become lanes: a loop's are numbered through, in blocks of at most `room` (fewer where an iteration has many
nodes); flat programs run on all lanes of a block, mapped; sums are segment sums, entries gathers, and derivatives by arrays scatter-adds.
Where a loop has one range on all lanes its blocks are whole lanes, and its sums those of the rows of a matrix. Blocks are the steps of a
`lax.scan`. Lanes behind the last iteration repeat it, and what they give is dropped.

Shapes are static: how many iterations a loop has is found out before it is traced (`lengths.py`). This module imports JAX.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from teg.backends.jax.cells import cells_on_host, cells_with_most
from teg.backends.jax.gaps import Line, gaps_of_lanes, places_of
from teg.backends.jax.kernel import JaxKernel
from teg.backends.jax.lanes import ARITHMETIC, NOWHERE, Lanes, Repeated, least_of_segments, live_terms, nowhere_or, of_lanes, row_of
from teg.backends.jax.lengths import Extents
from teg.backends.jax.runtime import MISSED, union
from teg.backends.jax.scatters import added, added_by_rows
from teg.backends.plan import exactly
from teg.backends.shared.cells import most_candidates
from teg.program import Program, free_names
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
    Like,
    Load,
    Loop,
    Number,
    Rows,
    Run,
    Scatter,
    Step,
    Take,
    steps,
)

BLOCK, WIDE_BLOCK = 2**17, 2**22
"""Iterations that run at a time, at most: on CPUs, whose caches hold so many, and on other devices, which need as many to be busy."""

FEW_GAPS = 64
"""So many gaps at least run at a time."""
Targets = dict[int | str, Any]
"""What is added to: outputs by their numbers, tables by their names."""


class ArrayFunction:
    """A program as a function; `source` is the text of its flat programs, `room` how many iterations may run at a time."""

    def __init__(self, program: ArrayProgram, compile: Callable[[Program], JaxKernel], room: int = BLOCK) -> None:
        self.program = program
        kernels = {id(s): compile(s.program) for s in steps(program.body) if isinstance(s, Run)}
        self.source = "\n".join(k.source for k in kernels.values())
        self._runs = {k: kernel.run for k, kernel in kernels.items()}
        self._traced = _from_index_arrays(program)
        self.add = added if room <= BLOCK else added_by_rows
        self._blocks = {id(s): _block_size(s, kernels, room) for s in steps(program.body) if isinstance(s, Loop)}

    def __call__(self, scalars: Sequence[Any], arrays: Sequence[Any], indices: Sequence[Any] = ()) -> tuple[list[Any], Any]:
        """The outputs, and the note. A scalar is a number, an integer parameter an `int`; an array has its shape. `indices` are the
        entries of the index arrays, NumPy arrays in their order, where the lengths of loops depend on them, else None."""
        shapes = [v.shape for v in arrays]
        counted = {k: v for k, v in enumerate(scalars) if isinstance(v, int)}
        numbers = [k for k, a in enumerate(self.program.arrays) if a.integers]
        entries = {k: v for k, v in zip(numbers, indices, strict=False) if v is not None}
        run = _Trace(self, arrays, Extents(self.program, self._blocks, shapes, counted, entries))
        lanes = Lanes({f"p{k}": v for k, v in enumerate(scalars)}, 1, None)
        targets: Targets = {j: jnp.zeros(shapes[output.array]) for j, output in enumerate(self.program.outputs) if isinstance(output, Like)}
        targets, note = run.block(self.program.body, lanes, targets, jnp.int32(0))
        found = []
        for j, output in enumerate(self.program.outputs):
            value = targets[j] if isinstance(output, Like) else jnp.asarray(of_lanes(output, lanes), jnp.float64)
            found.append(value.reshape(()) if not isinstance(output, Like) else value)
        return found, note


class _Block(NamedTuple):
    """A block of iterations: the number of the first one, how many there are, and how many of these are known to be live, if it is."""

    start: Any
    size: int
    known: int | None


class _Trace:
    """One trace of a program, in which loops have known extents."""

    def __init__(self, function: ArrayFunction, arrays: Sequence[Any], extents: Extents) -> None:
        self.function, self.arrays, self.lengths, self.widest = function, arrays, extents.lengths, extents.widest
        self.tables: dict[str, Any] = {}
        self.read: dict[int, set[str]] = {}  # the names that a step reads
        self.lanes: dict[str, Any] = {}  # the lane of each row of a table that Cells have left

    def block(self, block: Sequence[Step], lanes: Lanes, targets: Targets, note: Any) -> tuple[Targets, Any]:
        """The steps of a block on lanes, which get their values; targets of scatters, and the note. Recursion is as deep as loops are."""
        targets = dict(targets)
        for step in block:
            match step:
                case Integers():
                    lanes.values[step.name] = self._integers(step, lanes)
                case Number():
                    number = jnp.asarray(of_lanes(step.integer, lanes), jnp.float64)
                    lanes.values[step.name] = (
                        jnp.where(number == NOWHERE, jnp.nan, number) if step.integer in self.function._traced else number
                    )
                case Load():
                    lanes.values[step.name] = self._entry(step.array, step.subscripts, lanes)
                case Run():
                    note = note | self._run(step, lanes)
                case Gaps():
                    note = self._gaps(step, lanes, note)
                case Least() | Factors() | Cells() | Rows():
                    note = self._fold(step, lanes, note)
                case Loop():
                    targets, note = self._loop(step, lanes, targets, note)
                case Combined():
                    self._combined(step, lanes)
                case Blank():
                    targets[step.table] = jnp.zeros((of_lanes(step.rows, lanes), step.columns))
                    lanes.values[step.table] = 0
                case AddTo():
                    targets[step.table] = self._added(targets[step.table], (step.row, step.column), step.value, lanes)
                case Take():
                    rows = of_lanes(step.table, lanes) + of_lanes(step.row, lanes)
                    table = targets[step.table] if step.table in targets else self.tables[step.table]
                    known = not self.function._traced.intersection([step.row])
                    lanes.values[step.name] = table[rows, step.column] if known else row_of(table, rows, step.column)
                case Scatter():
                    targets[step.output] = self._added(targets[step.output], step.subscripts, step.value, lanes)
        return targets, note

    def _added(self, target: Any, places: Sequence[Arg], value: Arg, lanes: Lanes) -> Any:
        terms = live_terms(jnp.broadcast_to(of_lanes(value, lanes), (lanes.size,)), lanes)
        return self.function.add(target, [of_lanes(p, lanes) for p in places], terms)

    def _integers(self, step: Integers, lanes: Lanes) -> Any:
        if step.op == "length":
            return self.arrays[step.array].shape[int(step.args[0])]
        if step.op == "param":
            return lanes.values[f"p{step.args[0]}"]
        if step.op == "gather":
            return self._entry(step.array, step.args, lanes)
        a, b = (of_lanes(arg, lanes) for arg in step.args)
        if isinstance(a, int) and isinstance(b, int):
            return int(exactly(step.op, np.asarray(a), np.asarray(b)))
        if step.name in self.function._traced:
            return nowhere_or(step.op, a, b)
        return ARITHMETIC[step.op](a, b)

    def _entry(self, k: int, subscripts: Sequence[Arg], lanes: Lanes) -> Any:
        """An entry; where a subscript is out of its range, which only traced index arrays can be, NaN or NOWHERE."""
        array = self.arrays[k]
        places = tuple(of_lanes(p, lanes) for p in subscripts)
        floating = jnp.issubdtype(array.dtype, jnp.floating)
        if not self.function._traced.intersection(subscripts):  # checked before
            return array.at[places].get(mode="fill", wrap_negative_indices=False).astype(jnp.float64 if floating else jnp.int64)
        inside = True
        for place, n in zip(places, array.shape, strict=True):  # JAX's own check comes after a conversion to 32 bits
            inside = inside & (place >= 0) & (place < n)
        found = array.at[tuple(jnp.where(inside, place, 0) for place in places)].get(mode="fill", fill_value=0)
        return jnp.where(inside, found, jnp.nan) if floating else jnp.where(inside, found.astype(jnp.int64), NOWHERE)

    def _run(self, step: Run, lanes: Lanes) -> Any:
        run = self.function._runs[id(step)]
        given = [a if isinstance(a, int | float) else lanes.values[a] for a in step.inputs]
        if any(isinstance(v, Repeated) for v in given):
            return self._run_in_rows(step, given, lanes)
        columns = [jnp.asarray(v, jnp.float64) for v in given]
        axes = tuple(0 if c.ndim else None for c in columns)
        if 0 not in axes:
            found, note = run(*columns)
            lanes.values.update(zip(step.results, found, strict=True))
            return note
        found, notes = jax.vmap(run, in_axes=axes)(*columns)
        lanes.values.update(zip(step.results, found, strict=True))
        return union(notes)

    def _run_in_rows(self, step: Run, given: Sequence[Any], lanes: Lanes) -> Any:
        """The same on a matrix of lanes, where some values are those of a row."""
        width = next(v.width for v in given if isinstance(v, Repeated))
        columns = [jnp.asarray(v.rows if isinstance(v, Repeated) else v, jnp.float64) for v in given]
        columns = [c if isinstance(v, Repeated) or not c.ndim else c.reshape(-1, width) for c, v in zip(columns, given, strict=True)]
        row = jax.vmap(self.function._runs[id(step)], in_axes=tuple(0 if c.ndim == 2 else None for c in columns), axis_size=width)
        found, notes = jax.vmap(row, in_axes=tuple(0 if c.ndim else None for c in columns))(*columns)
        lanes.values.update(zip(step.results, (v.reshape(-1) for v in found), strict=True))
        return union(notes.reshape(-1))

    def _fold(self, step: Least | Factors | Cells | Rows, lanes: Lanes, note: Any) -> Any:
        """A loop whose iterations are not added up: all of them at once."""
        total, size = self.lengths[id(step)], lanes.size
        inner, parent, counts, note = self._all_at_once(step, lanes, note)

        def number(arg: Arg) -> Any:
            return jnp.broadcast_to(jnp.asarray(of_lanes(arg, inner), jnp.float64), (total,))

        match step:
            case Cells() | Rows():
                wide = len(step.values)
                rows = jnp.stack([number(v) for v in step.values], axis=1) if total else jnp.zeros((0, wide))
                found = self._cells(step, lanes, rows, counts) if isinstance(step, Cells) else []
                if isinstance(step, Rows):
                    self.tables[step.table], lanes.values[step.table] = rows, 0
            case Least():
                found = [
                    least_of_segments((number(v), number(p), inner.values[step.index], inner.live), parent, size)
                    if total
                    else -jnp.ones(size)
                    for v, p in zip(step.values, step.eligible, strict=True)
                ]
            case _:
                ones = [jnp.where(True if inner.live is None else inner.live, number(v), 1.0) for v in step.values] if total else []
                found = [jax.ops.segment_prod(v, parent, size) for v in ones] if total else [jnp.ones(size)] * len(step.results)
        single = size == 1 and lanes.live is None
        lanes.values.update((name, v[0] if single else v) for name, v in zip(step.results, found, strict=True))
        return note

    def _all_at_once(self, step: Loop, lanes: Lanes, note: Any) -> tuple[Lanes, Any, Any, Any]:
        """The lanes of all iterations of a loop, the outer lane of each, how many each outer lane has, and the note."""
        total = self.lengths[id(step)]
        lo, hi = of_lanes(step.lo, lanes), of_lanes(step.hi, lanes)
        counts = jnp.maximum(jnp.broadcast_to(jnp.asarray(hi - lo, jnp.int64), (lanes.size,)), 0)
        counts = counts if lanes.live is None else jnp.where(lanes.live, counts, 0)
        inner, parent = lanes, jnp.zeros(0, jnp.int64)
        if total and isinstance(lo, int) and isinstance(hi, int) and lanes.live is None:
            values = self._repeated(step, lanes, hi - lo)
            values[step.index] = jnp.broadcast_to(jnp.arange(lo, hi), (lanes.size, hi - lo)).reshape(-1)
            inner, parent = Lanes(values, total, None), Repeated(jnp.arange(lanes.size), hi - lo).spread()
            _, note = self.block(step.body, inner, {}, note)
        elif total:
            inner, parent = self._inside(step, lanes, _Block(0, total, total), total, jnp.cumsum(counts))
            _, note = self.block(step.body, inner, {}, note)
        return inner, parent, counts, note

    def _gaps(self, step: Gaps, lanes: Lanes, note: Any) -> Any:
        """A sum over gaps. As few of the places where there may be one have one, these are computed some at a time."""
        total, size = self.lengths[id(step)], lanes.size
        inner, parent, _, note = self._all_at_once(step, lanes, note)

        def on_lanes(arg: Arg, where: Lanes, count: int) -> Any:
            return jnp.broadcast_to(jnp.asarray(of_lanes(arg, where), jnp.float64), (count,))

        first, last = (on_lanes(end, lanes, size) for end in (step.first, step.last))
        values = jnp.stack([on_lanes(v, inner, total) for v in step.values]) if total else jnp.zeros((len(step.values), 0))
        velocities = [on_lanes(v, inner, total) for v in step.velocities] if total else [jnp.zeros(0)] * len(step.velocities)
        outer = tuple(on_lanes(v, lanes, size) for v in step.outer)
        line = Line(first, last, outer, jnp.reshape(jnp.asarray(velocities), (len(velocities), total)))
        found = gaps_of_lanes(values, (parent, inner.live if total else None), line)
        doubts = jnp.where((values[-1] > 0.0) & (first < last)[parent], 1.0, 0.0)
        doubtful = jax.ops.segment_sum(live_terms(doubts, inner), parent, size) if total else jnp.zeros(size)
        note = note | jnp.where(jnp.any(doubtful > 0.0), MISSED, 0)
        live = found.live if lanes.live is None else found.live & lanes.live[jnp.minimum(found.lane, size - 1)]
        counts = jnp.cumsum(live)
        count, room = counts[-1], min(len(live), max(size, FEW_GAPS))

        def some(carried: Any) -> Any:
            start, sums, note = carried
            number = start + jnp.arange(room)
            here = number < count
            at = jnp.where(here, places_of(number, counts), 0)
            lane = jnp.where(here, found.lane[at], 0)
            given = self._taken(step, lanes, lane)
            ends = zip((step.left, step.right, *step.moving), found.ends, strict=True)
            given.update((name, jnp.where(here, end[at], 0.0)) for name, end in ends)
            within = Lanes(given, room, here)
            _, note = self.block(step.inside, within, {}, note)
            terms = [live_terms(on_lanes(t, within, room), within) for t in step.terms]
            return start + room, sums + jnp.stack([jax.ops.segment_sum(t, lane, size) for t in terms]), note

        start = jnp.zeros((), count.dtype), jnp.zeros((len(step.results), size)), note
        _, sums, note = lax.while_loop(lambda carried: carried[0] < count, some, start)
        sums = jnp.where(found.lost, jnp.nan, sums)
        single = size == 1 and lanes.live is None
        named = zip((*step.results, *step.doubtful), (*sums, doubtful), strict=False)
        lanes.values.update((name, v[0] if single else v) for name, v in named)
        return note

    def _read(self, step: Step, lanes: Lanes) -> tuple[dict[Arg, Any], dict[Arg, Any]]:
        """The values that a step may read, on lanes inside of it: those that all lanes share, and those that each has."""
        if id(step) not in self.read:
            self.read[id(step)] = set(free_names(cast(Any, step)))
        read = self.read[id(step)]
        values = {name: of_lanes(name, lanes) for name, v in lanes.values.items() if name in read or isinstance(v, int)}
        own = {name: v for name, v in values.items() if getattr(v, "ndim", 0)}
        return {name: v for name, v in values.items() if name not in own}, own

    def _repeated(self, step: Step, lanes: Lanes, width: int) -> dict[Arg, Any]:
        """The values that a step may read, on `width` lanes each."""
        shared, own = self._read(step, lanes)
        return shared | {name: Repeated(v, width).spread() for name, v in own.items()}

    def _taken(self, step: Step, lanes: Lanes, lane: Any) -> dict[Arg, Any]:
        """The values that a step may read, on other lanes, whose own one is `lane`: numbers in double precision by one gather."""
        shared, own = self._read(step, lanes)
        numbers = [name for name, v in own.items() if v.dtype == jnp.float64]
        table = jnp.stack([own[name] for name in numbers]) if numbers else jnp.zeros((0, lanes.size))
        taken = dict(zip(numbers, table.at[:, lane].get(mode="promise_in_bounds"), strict=True))
        others = {name: v.at[lane].get(mode="promise_in_bounds") for name, v in own.items() if name not in taken}
        return shared | taken | others

    def _cells(self, step: Cells, lanes: Lanes, rows: Any, counts: Any) -> list[Any]:
        others = jnp.stack([jnp.broadcast_to(jnp.asarray(of_lanes(v, lanes), jnp.float64), (lanes.size,)) for v in step.otherwise], axis=1)
        most = self.widest[id(step)]
        if most <= most_candidates(step.shape):
            values, tables = cells_with_most(step.shape, rows, counts, others, most)
            first = jnp.arange(lanes.size) * (most + 1)
            lane = jnp.repeat(jnp.arange(lanes.size), most + 1)
        else:
            values, tables = cells_on_host(step.shape, rows, counts, others, bool(step.tables))
            ends = jnp.cumsum(counts + 1)
            first = ends - (counts + 1)
            lane = jnp.searchsorted(ends, jnp.arange(len(rows) + lanes.size), side="right")
        for name, table in zip(step.tables, tables, strict=False):
            self.tables[name], self.lanes[name] = table, lane
            lanes.values[name] = first - of_lanes(step.lo, lanes)
        return list(values)

    def _combined(self, step: Combined, lanes: Lanes) -> None:
        forms, lane = step.shape.forms, self.lanes[step.of[0]]
        moments = self.tables[step.of[0]][:, forms : step.shape.columns]
        by_form = jnp.zeros((len(moments), forms))
        for name, weight in zip(step.of, step.weights, strict=True):
            slopes = self.tables[name][:, :forms]
            weights = jnp.broadcast_to(jnp.asarray(of_lanes(weight, lanes), jnp.float64), (lanes.size,))
            by_form += jnp.where(slopes != 0.0, weights.at[lane].get(mode="fill", fill_value=0.0)[:, None] * slopes, 0.0)
        self.tables[step.table] = jnp.concatenate([by_form, moments], axis=1)
        lanes.values[step.table] = lanes.values[step.of[0]]

    def _loop(self, step: Loop, lanes: Lanes, targets: Targets, note: Any) -> tuple[Targets, Any]:
        lo, hi, cap = of_lanes(step.lo, lanes), of_lanes(step.hi, lanes), self.function._blocks[id(step)]
        sums = jnp.zeros((len(step.results), lanes.size))
        if not self.lengths[id(step)]:
            pass
        elif isinstance(lo, int) and isinstance(hi, int) and lanes.size > 1 and hi - lo <= cap:
            sums, targets, note = self._in_rows(step, lanes, targets, note)
        else:
            sums, targets, note = self._in_segments(step, lanes, targets, note)
        if lanes.size == 1 and lanes.live is None:
            sums = sums[:, 0]  # the program's own level: numbers
        lanes.values.update(zip(step.results, sums, strict=True))
        return targets, note

    def _in_rows(self, step: Loop, lanes: Lanes, targets: Targets, note: Any) -> tuple[Any, Targets, Any]:
        """The sums of a loop that has the same range on all lanes, the targets, and the note: a block has whole lanes, one in a row."""
        first, end = of_lanes(step.lo, lanes), of_lanes(step.hi, lanes)
        width = end - first
        rows = min(self.function._blocks[id(step)] // width, lanes.size)
        count = -(-lanes.size // rows)
        if not any(isinstance(s, Loop) for s in step.body):
            rows = -(-lanes.size // count)  # little is wasted in the last block

        def block(carried: Any, start: Any) -> Any:
            targets, note = carried
            own, live = start + jnp.arange(rows), lanes.live
            values = {name: of_lanes(name, lanes) for name in lanes.values}
            if count > 1:
                known = jnp.where(own < lanes.size, own, 0)
                values = {name: v[known] if getattr(v, "ndim", 0) else v for name, v in values.items()}
                live = (own < lanes.size) if live is None else (own < lanes.size) & live[known]
            values = {name: Repeated(v, width) if getattr(v, "ndim", 0) else v for name, v in values.items()}
            values[step.index] = jnp.broadcast_to(first + jnp.arange(width), (rows, width)).reshape(-1)
            inner = Lanes(values, rows * width, None if live is None else Repeated(live, width).spread())
            targets, note = self.block(step.body, inner, targets, note)
            terms = [live_terms(jnp.broadcast_to(jnp.asarray(of_lanes(v, inner), jnp.float64), (inner.size,)), inner) for v in step.values]
            return (targets, note), [jnp.sum(term.reshape(rows, width), axis=1) for term in terms]

        if count == 1:
            (targets, note), sums = block((targets, note), 0)
        else:
            (targets, note), parts = lax.scan(block, (targets, note), jnp.arange(0, count * rows, rows))
            sums = [part.reshape(-1)[: lanes.size] for part in parts]
        return sums, targets, note

    def _in_segments(self, step: Loop, lanes: Lanes, targets: Targets, note: Any) -> tuple[Any, Targets, Any]:
        """The sums of a loop, the targets, and the note."""
        total, cap = self.lengths[id(step)], self.function._blocks[id(step)]
        lo, hi = of_lanes(step.lo, lanes), of_lanes(step.hi, lanes)
        ends = None
        if isinstance(lo, int) and isinstance(hi, int) and lanes.live is None:
            total = lanes.size * (hi - lo)
        else:
            length = jnp.broadcast_to(jnp.asarray(hi - lo, jnp.int64), (lanes.size,))
            length = jnp.maximum(length, 0)
            ends = jnp.cumsum(length if lanes.live is None else jnp.where(lanes.live, length, 0))
        count = -(-total // cap)
        if count > 1 and not any(isinstance(s, Loop) for s in step.body):
            cap = -(-total // count)  # little is wasted in the last block

        def part(start: Any, size: int, known: int | None, targets: Targets, note: Any) -> tuple[Any, Targets, Any]:
            inner, parent = self._inside(step, lanes, _Block(start, size, known), total, ends)
            targets, note = self.block(step.body, inner, targets, note)
            terms = [live_terms(jnp.broadcast_to(jnp.asarray(of_lanes(v, inner), jnp.float64), (size,)), inner) for v in step.values]
            if not terms:
                return jnp.zeros((0, lanes.size)), targets, note
            if lanes.size == 1:
                return jnp.sum(jnp.stack(terms), axis=1)[:, None], targets, note
            if self.function.add is added_by_rows:
                return jnp.stack([added_by_rows(jnp.zeros(lanes.size), [parent], term) for term in terms]), targets, note
            found = jax.ops.segment_sum(jnp.stack(terms, axis=1), parent, lanes.size, indices_are_sorted=True)
            return found.T, targets, note

        if count == 1:
            return part(0, total, total, targets, note)

        def block(carried: Any, start: Any) -> tuple[Any, None]:
            sums, targets, note = carried
            found, targets, note = part(start, cap, None, targets, note)
            return (sums + found, targets, note), None

        sums = jnp.zeros((len(step.results), lanes.size))
        return lax.scan(block, (sums, targets, note), jnp.arange(0, total, cap))[0]

    def _inside(self, step: Loop, lanes: Lanes, block: _Block, total: int, ends: Any) -> tuple[Lanes, Any]:
        """The lanes of a block of iterations, and the outer lane of each."""
        start, size, known = block
        flat = start + jnp.arange(size)
        if ends is None:
            lo, hi = of_lanes(step.lo, lanes), of_lanes(step.hi, lanes)
            live = None if known is not None else flat < total
            flat = jnp.minimum(flat, total - 1)
            parent, index = flat // (hi - lo), lo + flat % (hi - lo)
        else:
            live = flat < ends[-1]
            flat = jnp.clip(flat, 0, jnp.maximum(ends[-1] - 1, 0))
            parent = jnp.minimum(jnp.searchsorted(ends, flat, side="right"), lanes.size - 1)
            before = jnp.where(parent > 0, ends[jnp.maximum(parent - 1, 0)], 0)
            lo = jnp.broadcast_to(jnp.asarray(of_lanes(step.lo, lanes)), (lanes.size,))
            index = lo[parent] + flat - before
        shared, own = self._read(step, lanes)
        values = shared | {name: v.at[parent].get(mode="promise_in_bounds") for name, v in own.items()}
        values[step.index] = index
        return Lanes(values, size, live), parent


def _block_size(loop: Loop, kernels: Mapping[int, JaxKernel], room: int) -> int:
    """How many iterations of a loop run at a time: so many that their nodes fit. With room for more there is memory for more nodes too."""
    times = max(1, room // (4 * BLOCK))
    return min([room, *(times * kernels[id(s)]._step for s in loop.body if isinstance(s, Run))])


def _from_index_arrays(program: ArrayProgram) -> set[Arg]:
    """The integers that depend on entries of index arrays, which may be traced."""
    found: set[Arg] = set()
    for step in steps(program.body):
        if isinstance(step, Loop) and (step.lo in found or step.hi in found):
            found.add(step.index)
        elif isinstance(step, Integers) and (step.op == "gather" or (step.op not in ("param", "length") and found.intersection(step.args))):
            found.add(step.name)
    return found
