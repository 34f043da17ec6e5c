"""The meaning of programs with arrays: loops are loops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, assert_never

import numpy as np

from teg.numerics.cell_integrals import integrals
from teg.program.arrays import (
    TIE_FROM,
    TIE_TO,
    TOUCH,
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
)
from teg.program.interpreter.machine import interpret
from teg.program.limits import PIECE_EPS
from teg.program.operations import INTEGER_OPERATIONS

Entries = dict[tuple[int, ...], float]
"""An array that was scattered into, by subscripts; entries that are not there are 0."""


class InterpretedArrays(NamedTuple):
    """The outputs, whether a tolerance was missed, and whether a search found more roots than it has room for."""

    outputs: tuple[float | Entries, ...]
    missed: bool
    crowded: bool


def interpret_arrays(program: ArrayProgram, arguments: Sequence[float], arrays: Sequence[Any]) -> InterpretedArrays:
    """Returns the outputs of a program for scalar arguments and arrays, which have a `shape` and are indexed by tuples."""
    machine = ArrayMachine(arrays, {f"p{k}": float(x) for k, x in enumerate(arguments)})
    machine.run(program.body)
    outputs = (machine.scattered.get(k, {}) if isinstance(o, Like) else float(machine.of(o)) for k, o in enumerate(program.outputs))
    return InterpretedArrays(tuple(outputs), machine.missed, machine.crowded)


@dataclass
class ArrayMachine:
    """The state of one run: the given arrays, the values of all names so far, and what was scattered into outputs, by the numbers
    of these."""

    arrays: Sequence[Any]
    values: dict[str, float | int]
    scattered: dict[int, Entries] = field(default_factory=dict)
    missed: bool = False
    crowded: bool = False
    tables: dict[str, tuple[list[list[float]], int]] = field(default_factory=dict)

    def of(self, arg: Arg) -> Any:
        """Returns the number that a name or a literal stands for."""
        return self.values[arg] if isinstance(arg, str) else arg

    def number(self, arg: Arg) -> float:
        """Returns the float that a name or a literal stands for."""
        return float(self.of(arg))

    def run(self, block: Sequence[Step]) -> None:
        """Run the steps of a block. Recursion is as deep as loops are."""
        for step in block:
            match step:
                case Integers():
                    self.values[step.name] = self._integer(step)
                case Load():
                    self.values[step.name] = float(self.arrays[step.array][self._places(step.subscripts)])
                case Number():
                    self.values[step.name] = float(self.of(step.integer))
                case Run():
                    self._kernel(step)
                case Least():
                    self._least(step)
                case Factors():
                    self._factors(step)
                case Cells():
                    self._cells(step)
                case Gaps():
                    self._gaps(step)
                case Rows():
                    self._rows(step)
                case Loop():
                    self._loop(step)
                case Combined():
                    self._combined(step)
                case Blank():
                    rows = [[0.0] * step.columns for _ in range(self.of(step.rows))]
                    self.tables[step.table] = rows, 0
                case AddTo():
                    self.tables[step.table][0][self.of(step.row)][step.column] += self.number(step.value)
                case Take():
                    table, first = self.tables[step.table]
                    self.values[step.name] = table[self.of(step.row) - first][step.column]
                case Scatter():
                    entries = self.scattered.setdefault(step.output, {})
                    place = self._places(step.subscripts)
                    entries[place] = entries.get(place, 0.0) + self.number(step.value)
                case _:
                    assert_never(step)

    def _places(self, subscripts: Sequence[Arg]) -> tuple[int, ...]:
        return tuple(self.of(s) for s in subscripts)

    def _integer(self, step: Integers) -> int:
        match step.op:
            case "gather":
                return int(self.arrays[step.array][self._places(step.args)])
            case "length":
                return int(self.arrays[step.array].shape[int(step.args[0])])
            case "param":
                return int(self.values[f"p{step.args[0]}"])
            case _:
                first, second = (self.of(a) for a in step.args)
                return INTEGER_OPERATIONS[step.op](first, second)

    def _kernel(self, step: Run) -> None:
        found = interpret(step.program, [self.number(a) for a in step.inputs])
        self.values.update(zip(step.results, found.outputs, strict=True))
        self.missed |= found.missed
        self.crowded |= found.crowded

    def _iterations(self, step: Loop) -> Iterator[int]:
        """Runs the body of a loop for each index, and yields it."""
        wanted = range(self.of(step.lo), self.of(step.hi))
        listed = None if step.listed < 0 else {int(i) for i in np.ravel(self.arrays[step.listed])}
        for i in wanted if listed is None else sorted(listed.intersection(wanted)):
            self.values[step.index] = i
            self.run(step.body)
            yield i

    def _least(self, step: Least) -> None:
        best = [(math.inf, -1.0)] * len(step.results)
        for i in self._iterations(step):
            for k, (value, eligible) in enumerate(zip(step.values, step.eligible, strict=True)):
                key, present, (least, winner) = self.number(value), self.number(eligible), best[k]
                if math.isnan(present) or math.isnan(winner) or (present and math.isnan(key)):
                    best[k] = (math.nan, math.nan)
                elif present and (winner < 0 or key < least):
                    best[k] = (key, float(i))
        self.values.update(zip(step.results, (winner for _, winner in best), strict=True))

    def _factors(self, step: Factors) -> None:
        products = [1.0] * len(step.results)
        for _ in self._iterations(step):
            products = [p * self.number(v) for p, v in zip(products, step.values, strict=True)]
        self.values.update(zip(step.results, products, strict=True))

    def _cells(self, step: Cells) -> None:
        rows = [[self.number(v) for v in step.values] for _ in self._iterations(step)]
        otherwise = [self.number(v) for v in step.otherwise]
        found = integrals(step.shape, rows, otherwise, bool(step.tables))
        self.values.update(zip(step.results, found.values, strict=True))
        self.values.update(zip(step.sizes, found.sizes, strict=False))
        first = self.of(step.lo)
        self.tables.update((name, (table, first)) for name, table in zip(step.tables, found.tables, strict=False))

    def _gaps(self, step: Gaps) -> None:
        first, last = self.number(step.first), self.number(step.last)
        covered: list[tuple[float, float, float, float]] = []
        outer = tuple(self.number(v) for v in step.outer) or (0.0, 0.0)
        is_known, doubtful = first == first and last == last, 0
        n = step.places
        for _ in self._iterations(step) if first < last else ():
            values = [self.number(v) for v in step.values]
            places, flags, ties = values[:n], values[n : 2 * n + 1], values[2 * n + 1 : -1]
            doubtful += values[-1] > 0.0
            ends = [first, *(min(p, last) for p in places), last]
            moving = [outer[0], *(self.number(v) for v in step.velocities or [0.0] * n), outer[1]]
            flags = _settled(ends, flags, ties)
            is_known &= not any(math.isnan(v) for v in (*places, *flags))
            pieces = zip(ends, ends[1:], moving, moving[1:], flags, strict=False)
            covered += [(p, q, u, v) for p, q, u, v, flag in pieces if flag > TIE_TO and _is_piece(p, q)]
        self.missed |= doubtful > 0
        self.values.update(dict.fromkeys(step.doubtful, float(doubtful)))
        sums = [0.0 if is_known else math.nan] * len(step.results)
        for p, q, *moving in _between((first, outer[0]), sorted(covered), (last, outer[1])) if is_known else ():
            self.values.update(zip((step.left, step.right, *step.moving), (p, q, *moving), strict=False))
            self.run(step.inside)
            sums = [s + self.number(v) for s, v in zip(sums, step.terms, strict=True)]
        self.values.update(zip(step.results, sums, strict=True))

    def _combined(self, step: Combined) -> None:
        tables, first = [self.tables[name][0] for name in step.of], self.tables[step.of[0]][1]
        weights = [self.number(w) for w in step.weights]
        forms, columns = step.shape.forms, step.shape.columns
        rows = []
        for several in zip(*tables, strict=True):
            by_form = [sum(w * row[c] for w, row in zip(weights, several, strict=True) if row[c] != 0.0) for c in range(forms)]
            rows.append([*by_form, *several[0][forms:columns]])
        self.tables[step.table] = rows, first

    def _rows(self, step: Rows) -> None:
        table = [[math.nan] * len(step.values) for _ in range(self.of(step.hi))]
        for i in self._iterations(step):
            table[i] = [self.number(v) for v in step.values]
        self.tables[step.table] = table, 0

    def _loop(self, step: Loop) -> None:
        sums = [0.0] * len(step.results)
        for _ in self._iterations(step):
            sums = [s + self.number(v) for s, v in zip(sums, step.values, strict=True)]
        self.values.update(zip(step.results, sums, strict=True))


_End = tuple[float, float]


def _settled(ends: Sequence[float], flags: Sequence[float], ties: Sequence[float]) -> list[float]:
    """Returns whether pieces are covered, with ties decided."""
    found: list[float | None] = []
    for p, q, flag, tie in zip(ends, ends[1:], flags, ties, strict=False):
        if not TIE_FROM <= flag <= TIE_TO:
            found.append(flag)
        elif q - p < TOUCH * (ends[-1] - ends[0]):
            found.append(found[-1] if found else None)
        else:
            found.append(tie)
    behind = next((flag for flag in found if flag is not None), 0.0)
    return [behind if flag is None else flag for flag in found]


def _is_piece(p: float, q: float) -> bool:
    return q - p > PIECE_EPS * max(abs(p), abs(q))


def _between(first: _End, covered: Sequence[tuple[float, ...]], last: _End) -> Iterator[tuple[float, ...]]:
    """Yields the gaps that intervals in ascending order leave, with the velocities of their ends. An end is a place and its velocity."""
    end = first
    for p, q, u, v in (*covered, (last[0], last[0], last[1], last[1])):
        if _is_piece(end[0], p):
            yield end[0], p, end[1], u
        end = max(end, (q, v), key=lambda e: e[0])
