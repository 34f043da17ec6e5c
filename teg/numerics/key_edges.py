"""Edges on lines of equal keys where several pairs of candidates have one line, as in regular grids of sites (`cells.py`).

A cut keeps the line of the pair that made it, although the cells on its two sides may belong to other candidates later. Such an edge
belongs to the owners of both sides. Their keys are equal along the edge, so the neighbour is, of the candidates whose keys are equal to the
owner's there, the one whose key is the least beyond.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teg.numerics.cells import BOX, EPSILON, NO_OWNER, ROUNDING, Form, Point

if TYPE_CHECKING:
    from teg.numerics.arrangement import Arrangement, Cell


def assign_key_edges(arrangement: Arrangement, present: list[tuple[int, list[int]]]) -> None:
    """Gives edges on lines of equal keys the lines of the candidates on their two sides. `present` are regions and their guards' lines.

    Sets `ambiguous` where the keys of more than two candidates are equal along an edge. Regions with a guard on it are passed by.
    """
    for cell in arrangement.cells:
        for i, label in enumerate(cell.labels):
            if label < 2 * BOX or not arrangement.is_key_line(label >> 1) or cell.owner == NO_OWNER:
                continue
            ends = cell.corners[i], cell.corners[(i + 1) % len(cell.corners)]
            owner = cell.owner // arrangement.shape.parts
            pair = {candidate for _, candidate, _ in arrangement.lines[label >> 1].of}
            if owner not in pair:
                pair = set()
            beyond = _neighbour(arrangement, cell, (ends, pair), present)
            if beyond is not None and {owner, beyond} != pair:
                g, _ = arrangement.difference(cell.owner, beyond * arrangement.shape.parts)
                cell.labels[i] = 2 * arrangement.late_line(owner, beyond, g) + 1


def _neighbour(
    arrangement: Arrangement, cell: Cell, edge: tuple[tuple[Point, Point], set[int]], present: list[tuple[int, list[int]]]
) -> int | None:
    """Returns the candidate beyond an edge whose key is equal to the owner's there; None if there is none. The pair that made the edge, if
    the owner is one of it, may be there in several parts."""
    ends, pair = edge
    (x, y), (u, v) = ends
    length = math.hypot(u - x, v - y)
    if length <= EPSILON:
        return None
    outward = (v - y) / length, (x - u) / length  # corners go round anticlockwise
    steepest, nearest = 0.0, None
    for region, guards in present:
        first, last, coincides = _range(arrangement, guards, ends)
        if coincides or (last - first) * length <= EPSILON:
            continue
        g, tolerance = arrangement.difference(cell.owner, region)
        values = [g[0] + g[1] * p + g[2] * q for p, q in ends]
        slope = g[1] * outward[0] + g[2] * outward[1]
        if max(map(abs, values)) > tolerance or slope <= arrangement.flat(cell.owner, region):
            continue
        arrangement.ambiguous |= region // arrangement.shape.parts not in pair and (last - first) * length < length - EPSILON
        if nearest is not None and not arrangement.is_level(cell.owner, region):  # three lines in one point: the pair that is there counts
            arrangement.ambiguous |= abs(slope - steepest) > arrangement.flat(cell.owner, region)
        if slope > steepest + arrangement.flat(cell.owner, region):
            steepest, nearest = slope, region // arrangement.shape.parts
    return nearest


def _range(arrangement: Arrangement, guards: list[int], ends: tuple[Point, Point]) -> tuple[float, float, bool]:
    """Returns the part of a straight line where guards hold, and whether one of them has this line."""
    first, last, coincides = 0.0, 1.0, False
    for guard in guards:
        d, e = (_at(arrangement.lines[guard].unit, end) for end in ends)
        if abs(d) < EPSILON and abs(e) < EPSILON:
            coincides = True
        elif d < EPSILON and e < EPSILON:
            return 1.0, 0.0, False
        else:
            first = max(first, d / (d - e)) if d < 0.0 else first
            last = min(last, d / (d - e)) if e < 0.0 else last
    return first, last, coincides


def _at(form: Form, at: Point) -> float:
    return form[0] + form[1] * at[0] + form[2] * at[1]


def flat(key: Form, other: Form) -> float:
    """Returns the slope below which two keys, equal at an edge, are equal on both sides of it: what rounding may leave."""
    return ROUNDING * sum(map(abs, (*key, *other)))
