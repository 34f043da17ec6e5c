"""Values of the integrals of the nearest candidate, and tables of their derivatives (`cells.py` says what they are)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from teg.numerics.arrangement import Arrangement
from teg.numerics.cells import PARTING, SHIFT, SKEW, Layout, Row
from teg.numerics.measured import Measured


class Integrals(NamedTuple):
    """Values, bounds of the integrals of absolute values, and for each value a table: a row for each candidate, and one for `otherwise`."""

    values: list[float]
    sizes: list[float]
    tables: list[list[list[float]]]


def integrals(shape: Layout, candidates: Sequence[Row], otherwise: Row, slopes: bool) -> Integrals:
    """Returns the integrals of polynomials of the nearest candidate.

    A candidate is a row: guards part by part, key, the coefficients of each polynomial; and the direction of all these if
    `shape.order` is 1. `otherwise` are the coefficients where there is no candidate, and their direction. Then the values are the
    derivatives along the direction, and a table has the derivatives of these by the numbers, and behind them by the direction.
    """
    here = Arrangement(shape, candidates)
    measured = Measured(shape, here, candidates, otherwise)
    values, sizes = measured.values()
    if not slopes and not shape.order:
        return Integrals(values, sizes, [])
    tables = _tables(here, candidates, otherwise, measured)
    speed = measured.parting() if shape.order and here.guarded and not here.undefined else 0.0
    if speed > 0.0:
        tables = _parted(shape, candidates, otherwise, PARTING / speed)
    if shape.order:
        values = [_along(table, shape, k, candidates, otherwise) for k, table in enumerate(tables)]
    return Integrals(values, sizes, tables)


def _tables(here: Arrangement, candidates: Sequence[Row], otherwise: Row, measured: Measured) -> list[list[list[float]]]:
    """Returns the tables of a square, or the mean of both sides."""
    return _means(here, candidates, otherwise) if here.touching or here.concurrent else measured.tables()


def _parted(shape: Layout, candidates: Sequence[Row], otherwise: Row, step: float) -> list[list[list[float]]]:
    """Returns the tables of a square in which lines through one place part along the direction: the mean of both sides, 2·M(h) - M(2h)."""
    found = []
    for h in (step, -step, 2.0 * step, -2.0 * step):
        rows, rest = [_moved(row, h) for row in candidates], _moved(otherwise, h)
        there = Arrangement(shape, rows)
        found.append(_tables(there, rows, rest, Measured(shape, there, rows, rest)))
    return [
        [[a + b - 0.5 * (c + d) for a, b, c, d in zip(*rows, strict=True)] for rows in zip(*tables, strict=True)]
        for tables in zip(*found, strict=True)
    ]


def _moved(row: Row, step: float) -> Row:
    """Returns a row with its numbers moved along their direction."""
    half = len(row) // 2
    return [*(v + step * d for v, d in zip(row[:half], row[half:], strict=True)), *row[half:]]


def _means(here: Arrangement, candidates: Sequence[Row], otherwise: Row) -> list[list[list[float]]]:
    """Returns the tables of a square with something on its sides, or with more equal keys at one place than have a second derivative
    there: as means of both sides."""
    sides = []
    for sign in (1.0, -1.0):
        shift = (sign * SHIFT, sign * SHIFT * SKEW) if here.touching else (0.0, 0.0)
        there = Arrangement(here.shape, candidates, shift, sign * bool(here.concurrent))
        there.ambiguous |= here.concurrent > 1 or (here.concurrent > 0 and there.concurrent > 0)
        sides.append(Measured(here.shape, there, candidates, otherwise).tables())
    return [[[0.5 * (a + b) for a, b in zip(r, s, strict=True)] for r, s in zip(p, q, strict=True)] for p, q in zip(*sides, strict=True)]


def _along(table: Sequence[Row], shape: Layout, body: int, candidates: Sequence[Row], otherwise: Row) -> float:
    """Returns the derivative along the direction, from a table of derivatives of order 1."""
    total = 0.0
    count = shape.coefficients
    for row, numbers in zip(table, candidates, strict=False):
        half = len(numbers) // 2
        first = half + shape.forms + body * count
        moving = (*numbers[half : half + shape.forms], *numbers[first : first + count])
        total += sum(d * s for d, s in zip(moving, row[shape.columns :], strict=True) if s)
    half = len(otherwise) // 2
    moving = tuple(otherwise[half + body * count : half + (body + 1) * count])
    return total + sum(d * s for d, s in zip(moving, table[-1][shape.columns + shape.forms :], strict=True) if s)
