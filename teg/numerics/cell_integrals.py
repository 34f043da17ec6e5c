"""Values of the integrals of the nearest candidate, and tables of their derivatives (`cells.py` says what they are)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

from teg.numerics.arrangement import Arrangement
from teg.numerics.cells import LIMIT, PARTING, SHIFT, SKEW, Layout, Row
from teg.numerics.measured import Measured
from teg.numerics.side_lines import Displaced, displaced

Table = list[list[float]]
"""A row for each candidate, and one for `otherwise`."""


class Integrals(NamedTuple):
    """Values, bounds of the integrals of absolute values, and for each value a table: a row for each candidate, and one for `otherwise`."""

    values: list[float]
    sizes: list[float]
    tables: list[Table]


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
    if speed != 0.0:
        tables = [_settled(*several, shape.columns) for several in zip(tables, *_parted(shape, candidates, otherwise, speed), strict=True)]
    if shape.order:
        values = [_along(table, shape, k, candidates, otherwise) for k, table in enumerate(tables)]
    return Integrals(values, sizes, tables)


def _tables(here: Arrangement, candidates: Sequence[Row], otherwise: Row, measured: Measured) -> list[Table]:
    """Returns the tables of a square, or the mean of both sides."""
    return _means(here, candidates, otherwise) if here.touching or here.concurrent else measured.tables()


def _parted(shape: Layout, candidates: Sequence[Row], otherwise: Row, speed: float) -> tuple[list[Table], list[Table]]:
    """Returns the tables of a square in which lines through one place part along the direction: M(h) and M(2h)."""
    found = []
    for h in (PARTING / speed, 2.0 * PARTING / speed):
        sides = []
        for step in (h, -h):
            rows, rest = [_moved(row, step) for row in candidates], _moved(otherwise, step)
            there = Arrangement(shape, rows)
            sides.append(_tables(there, rows, rest, Measured(shape, there, rows, rest)))
        found.append(_weighted((0.5, 0.5), sides))
    return found[0], found[1]


def _settled(table: Table, near: Table, far: Table, own: int) -> Table:
    """Returns a table whose first `own` columns, second derivatives, are the limit of the mean of both sides."""
    size = max((abs(v) for row in near for v in row[:own] if math.isfinite(v)), default=0.0)

    def limit(v: float, a: float, b: float) -> float:
        return 2.0 * a - b if not math.isnan(v) and abs(a - b) <= LIMIT * size else math.nan

    return [[*map(limit, r[:own], p[:own], q[:own]), *r[own:]] for r, p, q in zip(table, near, far, strict=True)]


def _moved(row: Row, step: float) -> Row:
    """Returns a row with its numbers moved along their direction."""
    half = len(row) // 2
    return [*(v + step * d for v, d in zip(row[:half], row[half:], strict=True)), *row[half:]]


def _means(here: Arrangement, candidates: Sequence[Row], otherwise: Row) -> list[Table]:
    """Returns the tables of a square with something on its sides, or with more equal keys at one place than have a second derivative
    there: as means of both sides."""
    both = [Displaced(0.5, sign, candidates) for sign in (1.0, -1.0)]
    weights, several = [], []
    for weight, sign, rows in displaced(here.shape, candidates) if here.touching else both:
        shift = (sign * SHIFT, sign * SHIFT * SKEW) if here.touching else (0.0, 0.0)
        there = Arrangement(here.shape, rows, shift, sign * bool(here.concurrent))
        there.ambiguous |= here.concurrent > 1 or (here.concurrent > 0 and there.concurrent > 0)
        several.append(Measured(here.shape, there, rows, otherwise).tables())
        weights.append(weight)
    return _weighted(weights, several)


def _weighted(weights: Sequence[float], several: Sequence[list[Table]]) -> list[Table]:
    """Returns the sum of tables with weights."""
    return [
        [[sum(map(mul, weights, numbers)) for numbers in zip(*rows, strict=True)] for rows in zip(*tables, strict=True)]
        for tables in zip(*several, strict=True)
    ]


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
