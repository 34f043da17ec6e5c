"""Programs with arrays by NumPy: iterations become lanes, and flat programs run on them.

    compile_lanes(program, compile)  ->  LaneKernel: a call gives every output

`compile` makes a kernel of a flat program (NumPy's or JAX's). Iterations of nested loops are flattened, some 2¹⁷ of them at a time; each
flat program then runs on as many lanes at once. The order of additions is that of the iterations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.cells import cells_of_lanes
from teg.backends.numpy.gaps import covered_by, gaps_of_lanes
from teg.backends.plan import apply, listed_rows
from teg.program import Program
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
from teg.program.fields import operands

Array = npt.NDArray[Any]
BLOCK = 2**17
"""Iterations that run at a time."""


class Results(NamedTuple):
    """The results of a run of a program with arrays: the outputs, (n,) for a number and (n, *shape) for an array; whether a tolerance was
    missed; the number of evaluations of integrands; whether a search had too little room; and whether ties were met, of all elements
    together or of each, (n,)."""

    values: list[Array]
    missed: bool
    evaluations: int
    crowded: bool = False
    tied: bool | Array = False


class Lanes(NamedTuple):
    """Values on lanes: `size` of them, `element` the element of the batch of each."""

    values: dict[Arg, Array]
    size: int
    element: Array


class LaneKernel:
    """A program as flat kernels and loops around them; `source` is their texts."""

    def __init__(self, program: ArrayProgram, compile: Callable[[Program], Any]) -> None:
        self.program = program
        self._compile = compile
        self._kernels = {id(s): compile(s.program) for s in steps(program.body) if isinstance(s, Run)}
        self._used = {id(s): _used(s) for s in steps(program.body) if isinstance(s, Loop)}
        self.source = "\n".join(k.source for k in self._kernels.values())

    def __reduce__(self) -> tuple[object, ...]:
        return (LaneKernel, (self.program, self._compile))

    def _start(self, arrays: Sequence[Array], n: int) -> Running:
        return Running(self, arrays, n)

    def results(self, columns: Sequence[Array], arrays: Sequence[Array], n: int) -> Results:
        """Returns the outputs of a batch of n. A column is float64, (n,) or (); an array has its shape, with an axis n in front where the
        batch does not share it. Subscripts have been checked (`array_plan.check_ranges`)."""
        run = self._start(arrays, n)
        values: dict[Arg, Array] = {f"p{k}": np.asarray(c) for k, c in enumerate(columns)}
        lanes = Lanes(values, n, np.arange(n))
        with np.errstate(all="ignore"):
            run.block(self.program.body, lanes)
        found: list[Array] = []
        for j, output in enumerate(self.program.outputs):
            if isinstance(output, Like):
                shape = arrays[output.array].shape[-self.program.arrays[output.array].dimensions :]
                found.append(run.targets.get(j, np.zeros(n * int(np.prod(shape)))).reshape(n, *shape))
            else:
                found.append(np.array(np.broadcast_to(lane_values(output, lanes), (n,)), dtype=np.float64))
        return Results(found, run.missed, run.evaluations, run.crowded, run.tied)


class Running:
    """The state of one call: what it has scattered, and what it has noted."""

    def __init__(self, kernel: LaneKernel, arrays: Sequence[Array], n: int) -> None:
        self.kernel = kernel
        self.specs = kernel.program.arrays
        self.arrays = arrays
        self.batched = [a.ndim > s.dimensions for a, s in zip(arrays, self.specs, strict=True)]
        self.n = n
        self.targets: dict[int, Array] = {}
        self.tables: dict[str, Array] = {}  # of all lanes, one below the other
        self.lanes: dict[str, Array] = {}  # the lane of each row of a table that Cells have left
        self.missed = self.crowded = self.tied = False
        self.evaluations = 0

    def block(self, block: Sequence[Step], lanes: Lanes) -> None:
        """The steps of a block on lanes. Recursion is as deep as loops are."""
        for step in block:
            match step:
                case Integers():
                    lanes.values[step.name] = self._integers(step, lanes)
                case Number():
                    lanes.values[step.name] = np.asarray(lane_values(step.integer, lanes), dtype=np.float64)
                case Load():
                    lanes.values[step.name] = self._entry(step.array, step.subscripts, lanes)
                case Run():
                    self._run(step, lanes)
                case Least():
                    self._least(step, lanes)
                case Factors():
                    self._factors(step, lanes)
                case Gaps():
                    self._gaps(step, lanes)
                case Cells():
                    self._cells(step, lanes)
                case Rows():
                    self._rows(step, lanes)
                case Loop():
                    self._loop(step, lanes)
                case Combined():
                    self._combined(step, lanes)
                case Blank():
                    self._keep(step.table, np.zeros((lanes.size * int(lane_values(step.rows, lanes)), step.columns)), lanes)
                case AddTo():
                    self._add(step, lanes)
                case Take():
                    rows = lane_values(step.table, lanes) + lane_values(step.row, lanes)
                    lanes.values[step.name] = self.tables[step.table][rows, step.column]
                case Scatter():
                    self._scatter(step, lanes)

    def _integers(self, step: Integers, lanes: Lanes) -> Array:
        if step.op == "length":
            k = step.array
            return np.asarray(self.arrays[k].shape[int(step.args[0]) + self.batched[k]])
        if step.op == "param":
            return np.asarray(lanes.values[f"p{step.args[0]}"]).astype(np.int64)
        if step.op == "gather":
            return self._entry(step.array, step.args, lanes)
        return apply(step.op, lane_values(step.args[0], lanes), lane_values(step.args[1], lanes))

    def _entry(self, k: int, subscripts: Sequence[Arg], lanes: Lanes) -> Array:
        places = [lane_values(p, lanes) for p in subscripts]
        return np.asarray(self.arrays[k][(lanes.element, *places) if self.batched[k] else tuple(places)])

    def _run(self, step: Run, lanes: Lanes) -> None:
        columns = [np.asarray(lane_values(a, lanes), dtype=np.float64) for a in step.inputs]
        shared = all(c.ndim == 0 for c in columns)
        count = min(lanes.size, 1) if shared else lanes.size
        outcome = self.kernel._kernels[id(step)].outcome(columns, count)
        self.missed |= outcome.missed
        self.crowded |= outcome.crowded
        self.tied |= bool(np.any(outcome.tied))
        self.evaluations += outcome.evaluations
        for name, row in zip(step.results, outcome.values, strict=True):
            lanes.values[name] = row[0] if shared and count else row

    def _iterations(self, step: Loop, lanes: Lanes, only: Array | None = None) -> Iterator[tuple[Lanes, Array]]:
        """Runs the iterations of a loop on lanes, block by block, on `only` some; yields these, and the outer lane of each."""
        lo, hi = (np.broadcast_to(lane_values(a, lanes), (lanes.size,)) for a in (step.lo, step.hi))
        hi = hi if only is None else np.where(only, hi, lo)
        ends = np.cumsum(hi - lo)
        first = ends - (hi - lo)
        outer, listed = self._listed(step, lanes) if step.listed >= 0 else (None, None)
        total = (int(ends[-1]) if lanes.size else 0) if listed is None else listed.size
        used = self.kernel._used[id(step)]
        for start in range(0, total, BLOCK):
            flat = np.arange(start, min(start + BLOCK, total))
            parent = np.searchsorted(ends, flat, side="right") if outer is None else outer[flat]
            inner = {name: v[parent] if v.ndim else v for name in used if (v := lanes.values.get(name)) is not None}
            inner[step.index] = flat - first[parent] + lo[parent] if listed is None else listed[flat]
            inside = Lanes(inner, flat.size, lanes.element[parent])
            self.block(step.body, inside)
            yield inside, parent

    def _loop(self, step: Loop, lanes: Lanes) -> None:
        sums = np.zeros((len(step.results), lanes.size))
        for inside, parent in self._iterations(step, lanes):
            for row, value in zip(sums, step.values, strict=True):
                row += np.bincount(parent, weights=_numbers(value, inside), minlength=lanes.size)
        lanes.values.update(zip(step.results, sums, strict=True))

    def _least(self, step: Least, lanes: Lanes) -> None:
        best = np.full((len(step.results), lanes.size), np.inf)
        winners = np.full((len(step.results), lanes.size), -1.0)
        for inside, parent in self._iterations(step, lanes):
            index = inside.values[step.index].astype(np.float64)
            for least, winner, value, eligible in zip(best, winners, step.values, step.eligible, strict=True):
                key, present = _numbers(value, inside), _numbers(eligible, inside)
                unknown = np.isnan(present) | ((present != 0.0) & np.isnan(key))
                lane = np.flatnonzero((present != 0.0) & ~unknown)
                lane = lane[np.lexsort((index[lane], key[lane], parent[lane]))]
                lane = lane[np.unique(parent[lane], return_index=True)[1]]  # the first of each outer lane
                better = lane[(winner[parent[lane]] == -1.0) | (key[lane] < least[parent[lane]])]
                least[parent[better]], winner[parent[better]] = key[better], index[better]
                winner[parent[unknown]] = np.nan
        lanes.values.update(zip(step.results, winners, strict=True))

    def _factors(self, step: Factors, lanes: Lanes) -> None:
        products = np.ones((len(step.results), lanes.size))
        for inside, parent in self._iterations(step, lanes):
            for row, value in zip(products, step.values, strict=True):
                np.multiply.at(row, parent, _numbers(value, inside))
        lanes.values.update(zip(step.results, products, strict=True))

    def _cells(self, step: Cells, lanes: Lanes) -> None:
        rows = [np.stack([_numbers(v, inside) for v in step.values], axis=1) for inside, _ in self._iterations(step, lanes)]
        candidates = np.concatenate([np.zeros((0, len(step.values))), *rows])
        lo, hi = (np.broadcast_to(lane_values(a, lanes), (lanes.size,)) for a in (step.lo, step.hi))
        otherwise = np.stack([_numbers(v, lanes) for v in step.otherwise], axis=1)
        values, sizes, tables = cells_of_lanes(step.shape, candidates, hi - lo, otherwise, bool(step.tables))
        lanes.values.update(zip(step.results, values, strict=True))
        lanes.values.update(zip(step.sizes, sizes, strict=False))
        for name, table in zip(step.tables, tables, strict=False):
            self.tables[name] = table
            self.lanes[name] = np.repeat(np.arange(lanes.size), hi - lo + 1)
            lanes.values[name] = np.cumsum(hi - lo + 1) - (hi - lo + 1) - lo  # the row of index 0

    def _gaps(self, step: Gaps, lanes: Lanes) -> None:
        first, last = (_numbers(end, lanes) for end in (step.first, step.last))
        outer = tuple(_numbers(v, lanes) for v in step.outer)
        found: list[tuple[Array, ...]] = [(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(4 if step.moving else 2)))]
        lost, doubtful = np.isnan(first) | np.isnan(last), np.zeros(lanes.size)
        for inside, parent in self._iterations(step, lanes, first < last):
            values = np.stack([_numbers(v, inside) for v in step.values])
            doubtful += np.bincount(parent, weights=values[-1] > 0.0, minlength=lanes.size)
            velocities = np.reshape([_numbers(v, inside) for v in step.velocities], (step.places, inside.size)) if step.moving else None
            lane, covered = covered_by(values, first[parent], last[parent], velocities)
            lost[parent[lane]] = True
            found.append((parent[covered[0]], *covered[1:]))
        every, *ends = (np.concatenate(parts) for parts in zip(*found, strict=True))
        lane, *gaps = gaps_of_lanes(every, ends, first, last, outer)
        self.missed |= bool(doubtful.any())
        lanes.values.update(dict.fromkeys(step.doubtful, doubtful))
        known = ~lost[lane]
        sums = np.where(lost, np.nan, np.zeros((len(step.results), lanes.size)))
        for start in range(0, int(known.sum()), BLOCK):
            parent, *ends = (v[known][start : start + BLOCK] for v in (lane, *gaps))
            used = self.kernel._used[id(step)]
            inner = {name: v[parent] if v.ndim else v for name in used if (v := lanes.values.get(name)) is not None}
            inner.update(zip((step.left, step.right, *step.moving), ends, strict=True))
            inside = Lanes(inner, parent.size, lanes.element[parent])
            self.block(step.inside, inside)
            for row, value in zip(sums, step.terms, strict=True):
                row += np.bincount(parent, weights=_numbers(value, inside), minlength=lanes.size)
        lanes.values.update(zip(step.results, sums, strict=True))

    def _combined(self, step: Combined, lanes: Lanes) -> None:
        forms, lane = step.shape.forms, self.lanes[step.of[0]]
        whole = self.tables[step.of[0]][:, : step.shape.columns].copy()
        whole[:, :forms] = 0.0
        for name, weight in zip(step.of, step.weights, strict=True):
            slopes = self.tables[name][:, :forms]
            weights = np.broadcast_to(_numbers(weight, lanes)[lane, None], slopes.shape)
            whole[:, :forms] += np.multiply(weights, slopes, where=slopes != 0.0, out=np.zeros_like(slopes))
        self.tables[step.table] = whole
        lanes.values[step.table] = lanes.values[step.of[0]]

    def _rows(self, step: Rows, lanes: Lanes) -> None:
        rows = int(lane_values(step.hi, lanes))
        table = np.full((lanes.size * rows, len(step.values)), np.nan)
        for inside, parent in self._iterations(step, lanes):
            table[parent * rows + inside.values[step.index]] = np.stack([_numbers(v, inside) for v in step.values], axis=1)
        self._keep(step.table, table, lanes)

    def _listed(self, step: Loop, lanes: Lanes) -> tuple[Array, Array]:
        """Returns the outer lanes and the indices of all iterations of a loop over rows that are listed."""
        rows, entries = int(lane_values(step.hi, lanes)), self.arrays[step.listed]
        several = [listed_rows(e, rows) for e in (entries if self.batched[step.listed] else entries[None])]
        found = [several[element if len(several) > 1 else 0] for element in range(lanes.size)]
        return np.repeat(np.arange(lanes.size), [r.size for r in found]), np.concatenate([np.zeros(0, np.int64), *found])

    def _keep(self, name: str, table: Array, lanes: Lanes) -> None:
        """Keeps a table of all lanes, and in which row those of each lane begin."""
        self.tables[name] = table
        lanes.values[name] = np.arange(lanes.size) * (len(table) // max(lanes.size, 1))

    def _add(self, step: AddTo, lanes: Lanes) -> None:
        table = self.tables[step.table]
        rows = np.broadcast_to(lane_values(step.table, lanes) + lane_values(step.row, lanes), (lanes.size,))
        table[:, step.column] += np.bincount(rows, weights=_numbers(step.value, lanes), minlength=len(table))

    def _scatter(self, step: Scatter, lanes: Lanes) -> None:
        k = step.array
        shape = self.arrays[k].shape[-self.specs[k].dimensions :]
        flat = lanes.element
        for axis, place in enumerate(step.subscripts):
            flat = flat * shape[axis] + lane_values(place, lanes)
        size = self.n * int(np.prod(shape))
        terms = np.broadcast_to(np.asarray(lane_values(step.value, lanes), dtype=np.float64), flat.shape)
        added = np.bincount(flat, weights=terms, minlength=size)
        self.targets[step.output] = self.targets[step.output] + added if step.output in self.targets else added


def _numbers(arg: Arg, lanes: Lanes) -> Array:
    """Returns an argument of a step on lanes, a number for each."""
    return np.broadcast_to(np.asarray(lane_values(arg, lanes), dtype=np.float64), (lanes.size,))


def lane_values(arg: Arg, lanes: Lanes) -> Array:
    """Returns an argument of a step on lanes."""
    return np.asarray(arg) if isinstance(arg, int | float) else lanes.values[arg]


def _used(loop: Loop) -> frozenset[Arg]:
    """Returns the names that the steps of a loop use, its own included."""
    names: set[Arg] = set(operands(loop, "body")) | (set(operands(loop, "inside")) if isinstance(loop, Gaps) else set())
    for step in steps((*loop.body, *(loop.inside if isinstance(loop, Gaps) else ()))):
        names.update([f"p{step.args[0]}"] if isinstance(step, Integers) and step.op == "param" else operands(step))
    return frozenset(n for n in names if isinstance(n, str))
