"""Are the integers of a program in their ranges? Checked before it is run, so that no backend ever reads outside of an array.

First by intervals: the integers of a program over whole loops, entries of index arrays between the least and the largest; a range from
one column of an index array to another one is compared row by row. That settles nearly every program in one pass over the index arrays.
Where it does not (a padding of -1 that no iteration reads), the integers are evaluated, iteration by iteration, and the first one that is
out of its range is named in the error. Integers have 64 bits when a program runs: one that has not room in them is an error as well.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from teg.errors import ArrayIndexError
from teg.program.arrays import AddTo, Arg, ArrayProgram, Integers, Load, Loop, Scatter, Step, Take

Interval = tuple[int, int]
Whole = npt.NDArray[np.int64]
EXACT: dict[str, tuple[str, Callable[[int, int], int]]] = {
    "add": ("+", operator.add), "sub": ("-", operator.sub), "mul": ("·", operator.mul), "floordiv": ("//", operator.floordiv),
}  # fmt: skip
LEAST, MOST = -(2**63), 2**63 - 1
BLOCK = 2**18
"""Iterations that are checked at a time."""
FEW, TOGETHER = 8, 256
"""Columns of an index array all of which are looked at if one is, and its rows that are looked at as one."""


def check_ranges(
    program: ArrayProgram, integers: Mapping[int, Whole], arrays: Sequence[npt.NDArray[np.generic]], shapes: Sequence[Sequence[int]]
) -> None:
    """Every subscript is inside its array, every range has a length of at least 0; raises ArrayIndexError.

    `integers` are the integer parameters by number, of any shape; `arrays` as they are given, `shapes` without leading axes of a batch.
    """
    if any(_settled(program, integers, arrays, shapes, rough) for rough in (True, False)):
        return
    batched = [a.shape[0] for a, s in zip(arrays, shapes, strict=True) if a.ndim > len(s)]
    if 0 in batched:  # a batch of no elements reads nothing
        return
    for element in range(max([1, *(v.size for v in integers.values()), *batched])):
        values = {k: int(v.reshape(-1)[element if v.size > 1 else 0]) for k, v in integers.items()}
        _Exact(program, values, [_element(a, len(s), element) for a, s in zip(arrays, shapes, strict=True)]).block(program.body, {}, 1)


def _element(array: npt.NDArray[np.generic], dimensions: int, element: int) -> npt.NDArray[np.generic]:
    if array.ndim == dimensions:
        return array
    rows: npt.NDArray[np.generic] = array.reshape(-1, *array.shape[array.ndim - dimensions :])
    return np.asarray(rows[element])


def _settled(
    program: ArrayProgram,
    integers: Mapping[int, Whole],
    arrays: Sequence[npt.NDArray[np.generic]],
    shapes: Sequence[Sequence[int]],
    rough: bool,
) -> bool:
    """Returns whether intervals show that everything is in its range; `rough` ones of long tables may begin at 0."""
    known: dict[Arg, Interval] = {}

    def of(arg: Arg) -> Interval:
        return (arg, arg) if isinstance(arg, int) else known[arg]

    spans = _Spans(arrays, rough)
    entries_of: dict[Arg, Integers] = {}
    ordered: dict[tuple[Integers | None, Integers | None], bool] = {}
    tables = program.tables
    for step in program.subscripted:
        match step:
            case Loop():
                (least, most), end = of(step.lo), of(step.hi)
                pair = entries_of.get(step.lo), entries_of.get(step.hi)
                if end[0] < most and pair not in ordered:
                    ordered[pair] = _are_ranges(*pair, arrays)
                if end[0] < most and not ordered[pair]:
                    return False
                if not _has_room((end[0] - most, end[1] - least)):
                    return False
                known[step.index] = (least, max(end[1] - 1, least))
            case Integers(name, "length", (axis,), k):
                known[name] = (shapes[k][int(axis)],) * 2
            case Integers(name, "param", (k,)):
                values = integers[int(k)]
                known[name] = (int(values.min()), int(values.max())) if values.size else (0, 0)
            case Integers(name, "gather", places, k):
                if not _inside(list(map(of, places)), shapes[k]):
                    return False
                known[name], entries_of[name] = spans.of(k, places[-1]), step
            case Integers(name, op, (a, b)):
                found = _combined(op, of(a), of(b))
                if found is None or not _has_room(found):
                    return False
                known[name] = found
            case Load() | Scatter():
                if not _inside(list(map(of, step.subscripts)), shapes[step.array]):
                    return False
            case Take() | AddTo():
                if not all(_inside([of(step.row)], shapes[k][:1]) for k in tables.get(step.table, ())):
                    return False
            case _:
                pass
    return True


class _Spans:
    """The intervals of the entries of arrays, each looked up once; `rough` ones of long tables may begin at 0."""

    def __init__(self, arrays: Sequence[npt.NDArray[np.generic]], rough: bool) -> None:
        self._arrays, self._rough = arrays, rough
        self._known: dict[tuple[int, Arg], Interval] = {}

    def of(self, k: int, last: Arg) -> Interval:
        """Returns the interval of the entries of an array with this subscript at the end, or of all of them if it is no number."""
        array, key = self._arrays[k], (k, last if isinstance(last, int) else "")
        if key not in self._known and isinstance(last, int) and _is_long_table(array):
            self._known |= {(k, column): span for column, span in enumerate(column_intervals(array, self._rough))}
        elif key not in self._known:
            self._known[key] = _interval(array[..., last] if isinstance(last, int) else array)
        return self._known[key]


def _interval(entries: npt.NDArray[np.generic]) -> Interval:
    """Returns the least and the largest of some integers; 0 if there is none."""
    return (int(entries.min()), int(entries.max())) if entries.size else (0, 0)


def _is_long_table(array: npt.NDArray[np.generic]) -> bool:
    """Returns whether an array is a table of few columns, whose rows lie side by side, and of many rows."""
    return array.ndim == 2 and array.flags.c_contiguous and array.shape[1] <= FEW and array.shape[0] >= 8 * TOGETHER


def column_intervals(table: npt.NDArray[np.generic], rough: bool = False) -> list[Interval]:
    """Returns the least and the largest integer of each column of a long table. Many rows are looked at as one: a column alone is read in
    steps, and the table once for each of them. `rough`: where no integer is negative, 0 and the largest one, for which the table is
    read once: negative integers without their signs are larger than all others."""
    if rough and table.dtype == np.int64:
        most = [int(b) for b in _of_columns(table.view(np.uint64), np.maximum)]
        if max(most) <= MOST:
            return [(0, b) for b in most]
    return [(int(a), int(b)) for a, b in zip(_of_columns(table, np.minimum), _of_columns(table, np.maximum), strict=True)]


def _of_columns(table: npt.NDArray[np.generic], larger: np.ufunc) -> npt.NDArray[np.generic]:
    """Returns the least or the largest integer of each column of a long table."""
    rows, columns = table.shape
    whole = rows - rows % TOGETHER
    wide, rest = table[:whole].reshape(-1, TOGETHER * columns), table[whole:]
    found = larger.reduce(np.concatenate([larger.reduce(wide, axis=0).reshape(TOGETHER, columns), rest]), axis=0)
    return cast("npt.NDArray[np.generic]", found)


def listed_rows(entries: npt.NDArray[np.generic], rows: int) -> Whole:
    """Returns the rows of a table that are entries of an index array, ascending."""
    listed = np.zeros(rows, dtype=bool)
    flat = np.asarray(entries, dtype=np.int64).ravel()
    listed[flat[(flat >= 0) & (flat < rows)]] = True
    return np.flatnonzero(listed)


def _are_ranges(lo: Integers | None, hi: Integers | None, arrays: Sequence[npt.NDArray[np.generic]]) -> bool:
    """Returns whether two entries of an array of indices are the ends of ranges in every row, because they stand in two columns of the same
    row."""
    if lo is None or hi is None or lo.array != hi.array or lo.args[:-1] != hi.args[:-1]:
        return False
    first, last = lo.args[-1], hi.args[-1]
    rows = arrays[lo.array]
    return isinstance(first, int) and isinstance(last, int) and bool((rows[..., first] <= rows[..., last]).all())  # type: ignore[operator]


def _inside(places: Sequence[Interval], shape: Sequence[int]) -> bool:
    return all(low >= 0 and high < n for (low, high), n in zip(places, shape, strict=True))


def _combined(op: str, a: Interval, b: Interval) -> Interval | None:
    """Returns the interval of an operation; None where it is not known."""
    match op:
        case "add":
            return a[0] + b[0], a[1] + b[1]
        case "sub":
            return a[0] - b[1], a[1] - b[0]
        case "mul":
            ends = [x * y for x in a for y in b]
            return min(ends), max(ends)
        case "min" | "max":
            choose = min if op == "min" else max
            return choose(a[0], b[0]), choose(a[1], b[1])
        case "floordiv" if b[0] > 0:
            ends = [x // y for x in a for y in b]
            return min(ends), max(ends)
        case "mod" if b[0] > 0:
            return (a[0], a[1]) if a[0] >= 0 and a[1] < b[0] else (0, b[1] - 1)
        case _:
            return None


def _has_room(span: Interval) -> bool:
    return span[0] >= LEAST and span[1] <= MOST


class _Exact:
    """Every iteration of one element of the batch."""

    def __init__(self, program: ArrayProgram, integers: Mapping[int, int], arrays: Sequence[npt.NDArray[np.generic]]) -> None:
        self.program, self.integers, self.arrays = program, integers, arrays
        self.tables = program.tables

    def block(self, block: Sequence[Step], values: dict[Arg, Whole], lanes: int) -> None:
        """Run the integers of a block on lanes, one an iteration of the loops around it. Recursion is as deep as loops are."""
        for step in block:
            match step:
                case Integers():
                    values[step.name] = np.broadcast_to(self._integers(step, values), (lanes,))
                case Load() | Scatter():
                    self._check(step.array, step.subscripts, values, lanes)
                case Take() | AddTo():
                    for k in self.tables.get(step.table, ()):
                        self._check(k, (step.row,), values, lanes)
                case Loop() if step.listed >= 0:
                    rows = listed_rows(self.arrays[step.listed], int(self._of(step.hi, values).flat[0]))
                    inner = {name: np.broadcast_to(v, (1,)).repeat(rows.size) for name, v in values.items()}
                    if rows.size:
                        self.block(step.body, {**inner, step.index: rows}, rows.size)
                case Loop():
                    self._loop(step, values, lanes)
                case _:
                    pass

    def _loop(self, step: Loop, values: dict[Arg, Whole], lanes: int) -> None:
        lo, hi = (np.broadcast_to(self._of(a, values), (lanes,)) for a in (step.lo, step.hi))
        if (hi < lo).any():
            at = int(np.argmax(hi < lo))
            raise ArrayIndexError(
                f"a sum has a negative length: from {lo[at]} to {hi[at]}", None, "an empty range ends where it begins; a range is half-open"
            )
        ends = np.cumsum(exactly("sub", hi, lo))
        total = int(ends[-1]) if lanes else 0
        if float(np.sum((hi - lo).astype(np.float64))) >= MOST:
            raise ArrayIndexError(f"a sum is too long: from {lo[0]} to {hi[0]}")
        for start in range(0, total, BLOCK):
            flat = np.arange(start, min(start + BLOCK, total))
            parent = np.searchsorted(ends, flat, side="right")
            inner = {name: v[parent] for name, v in values.items()}
            inner[step.index] = flat - (ends - (hi - lo))[parent] + lo[parent]
            self.block(step.body, inner, flat.size)

    def _of(self, arg: Arg, values: Mapping[Arg, Whole]) -> Whole:
        return np.asarray(arg) if isinstance(arg, int) else values[arg]

    def _integers(self, step: Integers, values: Mapping[Arg, Whole]) -> Whole:
        if step.op == "length":
            return np.asarray(self.arrays[step.array].shape[int(step.args[0])])
        if step.op == "param":
            return np.asarray(self.integers[int(step.args[0])])
        args = [self._of(a, values) for a in step.args]
        if step.op == "gather":
            self._check(step.array, step.args, values, max((a.size for a in args), default=1))
            return np.asarray(self.arrays[step.array][tuple(args)], dtype=np.int64)
        return exactly(step.op, args[0], args[1])

    def _check(self, k: int, places: Sequence[Arg], values: Mapping[Arg, Whole], lanes: int) -> None:
        shape, spec = self.arrays[k].shape, self.program.arrays[k]
        for axis, place in enumerate(places):
            at = np.broadcast_to(self._of(place, values), (lanes,))
            wrong = (at < 0) | (at >= shape[axis])
            if wrong.any():
                lane = int(np.argmax(wrong))
                subscripts = ", ".join(str(int(np.broadcast_to(self._of(p, values), (lanes,))[lane])) for p in places)
                raise ArrayIndexError(
                    f"the index {int(at[lane])} is out of range: axis {axis} of {spec.name!r} has length {shape[axis]}, and the program "
                    f"reads {spec.name}[{subscripts}]",
                    None,
                    "indices count from 0, also where a condition drops the value: keep them inside by % or by teg.minimum",
                )


def exactly(op: str, a: Whole, b: Whole) -> Whole:
    """Returns an integer operation on lanes; raises ArrayIndexError where a result has more than 64 bits, or is divided by 0."""
    if op in ("floordiv", "mod") and (b == 0).any():
        raise ArrayIndexError("an index is divided by 0")
    if not a.size or not b.size:
        return apply(op, a, b)
    ends = [(int(v.min()), int(v.max())) for v in (a, b)]
    span = (LEAST, MOST) if op == "mod" else _combined(op, *ends)
    if span is None:  # divided by numbers of either sign
        span = (LEAST, MOST) if ends[0][0] > LEAST else (LEAST, MOST + 1)
    if not _has_room(span):
        sign, of = EXACT[op]
        lanes = np.broadcast(a, b)
        wrong = next(((int(x), int(y)) for x, y in lanes if not LEAST <= of(int(x), int(y)) <= MOST), None)
        if wrong is not None:
            raise ArrayIndexError(
                f"an index is too large: {wrong[0]} {sign} {wrong[1]} is {of(*wrong)}, which 64 bits do not hold",
                None,
                "indices, and the integers that they are computed from, lie between -2⁶³ and 2⁶³",
            )
    return apply(op, a, b)


def apply(op: str, a: Whole, b: Whole) -> Whole:
    """Returns an integer operation on lanes."""
    match op:
        case "add":
            return np.asarray(a + b)
        case "sub":
            return np.asarray(a - b)
        case "mul":
            return np.asarray(a * b)
        case "floordiv":
            return np.asarray(a // b)
        case "mod":
            return np.asarray(a % b)
        case "min":
            return np.minimum(a, b)
        case _:
            return np.maximum(a, b)
