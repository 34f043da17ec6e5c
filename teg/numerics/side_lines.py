"""Candidates over one another that end at one side of the square (`cells.py`).

The line of a guard on a side has one derivative for moving inwards and another one, 0, for moving outwards; the mean counts. Moved inwards
by itself it shows what lies below its candidate, which may be another one with a line on that side: so while one line moves inwards, those
of candidates over or below it must not. Candidates with such lines get colours, different ones where they overlap along the side. Of m
colours

    mean  =  ½·(G₁ + … + Gₘ) + (1 - m/2)·G₀          Gⱼ: lines of colour j are inside of the square, all others outside

in which each of the lines is inside with the weight ½, and everything else has the weight 1. With one colour this is the mean of two
squares moved both ways. Candidates on the other side of the same line, as in a mesh that goes on beyond the square, move with those within.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from teg.numerics.cells import BESIDE, EPSILON, SHIFT, SKEW, Form, Layout, Row

ENDS = ((0, 2), (1, 3), (0, 1), (2, 3))
"""The ends of each side, among the corners (0, 0), (1, 0), (0, 1), (1, 1)."""


class Displaced(NamedTuple):
    """One of the squares whose tables are added up: its weight, the direction in which it is moved, and the candidates in it."""

    weight: float
    sign: float
    candidates: Sequence[Row]


class _Line(NamedTuple):
    """Guards on one side of the square: their region and columns, the side and whether the region is beyond it, the part of the side where
    the other guards hold, and the key in the middle."""

    region: int
    columns: tuple[int, ...]
    side: tuple[int, bool]
    first: float
    last: float
    key: float


def displaced(shape: Layout, candidates: Sequence[Row]) -> list[Displaced]:
    """Returns the squares whose tables have the mean for lines on sides as their sum. Cost: the pairs of lines on one side."""
    lines = sorted(_lines(shape, candidates), key=lambda line: (line.key, line.region))
    colours: list[int] = []
    for line in lines:
        taken = {colour for other, colour in zip(lines, colours, strict=False) if _overlap(line, other)}
        colours.append(next(k for k in range(len(lines)) if k not in taken))
    count = max(colours, default=0) + 1
    if count == 1:
        return [Displaced(0.5, 1.0, candidates), Displaced(0.5, -1.0, candidates)]
    found = []
    for k in range(count + 1):
        weight, sign = (0.5 if k else 1.0 - 0.5 * count), (-1.0 if k == count else 1.0)
        if weight:
            inside = [colour == k - 1 for colour in colours]
            found.append(Displaced(weight, sign, _moved(candidates, zip(lines, inside, strict=True), shape, sign)))
    return found


def side_of(form: Form) -> tuple[int, bool] | None:
    """Returns the side of the square that the line of a form lies on, and whether the form is negative in the square."""
    c, a, b = form
    size = math.hypot(a, b)
    if not 0.0 < size < math.inf:
        return None
    at = [abs(v) <= EPSILON * size for v in (c, c + a, c + b, c + a + b)]
    on = [side for side, (i, j) in enumerate(ENDS) if at[i] and at[j]]
    return (on[0], c + 0.5 * a + 0.5 * b < 0.0) if on else None


def _lines(shape: Layout, candidates: Sequence[Row]) -> list[_Line]:
    found = []
    for region in range(len(candidates) * shape.parts):
        row, first = candidates[region // shape.parts], 3 * (region % shape.parts) * shape.guards
        c, a, b = row[shape.forms - 3 : shape.forms]
        guards = [(row[k], row[k + 1], row[k + 2]) for k in range(first, first + 3 * shape.guards, 3)]
        sides = [side_of(g) for g in guards]
        for side in {s for s in sides if s is not None}:
            columns = tuple(first + 3 * k for k, other in enumerate(sides) if other == side)
            ends = _ends([g for g, other in zip(guards, sides, strict=True) if other != side], side[0])
            if ends[1] - ends[0] > BESIDE:
                found.append(_Line(region, columns, side, *ends, c + 0.5 * a + 0.5 * b))
    return found


def _ends(guards: Sequence[Form], side: int) -> tuple[float, float]:
    """Returns the part of a side where guards hold."""
    first, last = 0.0, 1.0
    for c, a, b in guards:
        at = (c, c + a, c + b, c + a + b)
        d, e = (at[corner] for corner in ENDS[side])
        if d < 0.0 and e < 0.0:
            return 1.0, 0.0
        first = max(first, d / (d - e)) if d < 0.0 else first
        last = min(last, d / (d - e)) if e < 0.0 else last
    return first, last


def _overlap(line: _Line, other: _Line) -> bool:
    return line.side == other.side and min(line.last, other.last) - max(line.first, other.first) > BESIDE


def _moved(candidates: Sequence[Row], lines: Iterable[tuple[_Line, bool]], shape: Layout, sign: float) -> list[list[float]]:
    """Returns candidates whose lines on sides are inside or outside of a square that is moved by SHIFT in a direction."""
    rows = [list(row) for row in candidates]
    for line, inside in lines:
        row = rows[line.region // shape.parts]
        for k in line.columns:
            step = sign * SHIFT * (row[k + 1] + SKEW * row[k + 2])
            row[k] -= step + (abs(step) if inside != line.side[1] else -abs(step))
    return rows
