"""Programs whose arrays are tables of parameters and numbers: from the outside, programs without arrays.

    columns of a call   →   the scalar parameters and the arrays of a program with arrays   →   its outputs   →   sums of these

Every entry of a table is a column or a literal, so a call fills the tables, and the derivatives by the entries of a table are added up
at the parameters that stand there.
"""

from __future__ import annotations

from dataclasses import dataclass

from teg.program.arrays import ArrayProgram


@dataclass(frozen=True, slots=True)
class Table:
    """An array of `rows` times `columns` entries, row by row: the number of a column of a call (an int), or a number (a float)."""

    rows: int
    columns: int
    entries: tuple[int | float, ...]


@dataclass(frozen=True, slots=True)
class Sent:
    """A number that is added to the output `to`: the output `number` of the program with arrays, or an entry of it if that is an array."""

    number: int
    entry: int | None
    to: int


@dataclass(frozen=True, slots=True)
class TabledProgram:
    """A program with arrays, all of which are tables. Its scalar parameters are the columns `given` of a call with the parameters
    `parameters`; its outputs are `sent` to `outputs` sums, each over those in their order."""

    program: ArrayProgram
    parameters: tuple[str, ...]
    given: tuple[int, ...]
    tables: tuple[Table, ...]
    outputs: int
    sent: tuple[Sent, ...]
