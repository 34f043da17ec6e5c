"""Values of the integrals of the nearest candidate, and tables of their derivatives (`cells.py` says what they are)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from teg.numerics.arrangement import Arrangement
from teg.numerics.cells import SHIFT, SKEW, Layout, Row
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
    tables = measured.tables()
    if here.touching or here.concurrent:
        tables = _means(here, candidates, otherwise)
    if shape.order:
        values = [_along(table, shape, k, candidates, otherwise) for k, table in enumerate(tables)]
    return Integrals(values, sizes, tables)


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
