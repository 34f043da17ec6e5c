"""Segments that are sides of a polygon: the same lines, which the polygon has cut already.

    side_of(polygon, segment, points)  ->  Side        the line of the polygon, and where the segment's ends are in the box

A segment is given by its half-lines, which know nothing of the box. It lies on a line of the polygon, and what the half-lines leave of it
is what the box and the other half-planes leave of that line, if this holds of the functions, with u and v the offsets in the box:

    four half-lines           are u > 0, width - u > 0, v > 0, height - v > 0
    at both ends              one of the polygon's functions is 0
    of every other one        either it is one of the other half-lines, or it is 0 at one end of the segment, and positive at the other: it
                              holds on the whole segment, and ends there
    the segment's ends        are two such zeros

These are equations between rational functions of the inputs, decided in a finite field at several random points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import NamedTuple

from teg.program import Arg, Polygon, Segment
from teg.program.residues import P, Residues


class Side(NamedTuple):
    """The number of the half-plane, u and v at both ends of the segment, and the sign of their difference, which is ±(b, -a) of the
    half-plane; 0 if it is another multiple. `ahead` has two half-planes, by their numbers, with the end, 0 or 1, where they must be
    positive."""

    line: int
    u: tuple[Arg, Arg]
    v: tuple[Arg, Arg]
    sign: int
    ahead: tuple[tuple[int, int], ...]


Ends = tuple[int, int]
"""A function on the segment: its residues at both ends."""


def side_of(polygon: Polygon, segment: Segment, points: Sequence[Residues]) -> Side | None:
    """Returns the side of a polygon that a segment is; None if it is none, or that is not known."""
    found = _found(polygon, segment, points[0])
    return found if found and all(_found(polygon, segment, r) == found for r in points[1:]) else None


def _found(polygon: Polygon, segment: Segment, residues: Residues) -> Side | None:
    of = residues.of
    extents = [e for e in map(of, (polygon.width, polygon.height)) if e is not None]
    ends = [(a, b) for g in segment.half_lines if (a := of(g.first)) is not None and (b := of(g.last)) is not None]
    planes = [
        (a, b, c) for g in polygon.half_planes if (a := of(g.a)) is not None and (b := of(g.b)) is not None and (c := of(g.c)) is not None
    ]
    if len(extents) < 2 or len(ends) < len(segment.half_lines) or len(planes) < len(polygon.half_planes):
        return None
    for (i, u), (k, v), rest in _in_the_box(ends, *extents):
        values = [((a * u[0] + b * v[0] + c) % P, (a * u[1] + b * v[1] + c) % P) for a, b, c in planes]
        if (0, 0) not in values:
            continue
        line = values.index((0, 0))
        if (ahead := _cut_alike(values, line, rest)) is None:
            continue
        a, b, _ = planes[line]
        step = (u[1] - u[0]) % P, (v[1] - v[0]) % P
        sign = 1 if step == (b, -a % P) else -1 if step == (-b % P, a) else 0
        first, second = segment.half_lines[i], segment.half_lines[k]
        return Side(line, (first.first, first.last), (second.first, second.last), sign, ahead)
    return None


def _in_the_box(ends: Sequence[Ends], width: int, height: int) -> Iterator[tuple[tuple[int, Ends], tuple[int, Ends], list[Ends]]]:
    """Yields the half-lines that may be u and v, by their numbers, with those that are no sides of the box."""

    def opposite(of: Ends, extent: int) -> Ends:
        return (extent - of[0]) % P, (extent - of[1]) % P

    for i, j in permutations(range(len(ends)), 2):
        if ends[j] != opposite(ends[i], width):
            continue
        for k, m in permutations([n for n in range(len(ends)) if n not in (i, j)], 2):
            if ends[m] == opposite(ends[k], height):
                yield (i, ends[i]), (k, ends[k]), [g for n, g in enumerate(ends) if n not in (i, j, k, m)]


def _cut_alike(values: Sequence[Ends], line: int, half_lines: Sequence[Ends]) -> tuple[tuple[int, int], ...] | None:
    """Returns which half-planes end a segment, with the end where they must be positive; None if the other half-planes cut it elsewhere
    than the half-lines do."""
    left = list(half_lines)
    ahead: dict[int, int] = {}  # by the end where a half-plane is positive
    for number, g in enumerate(values):
        if number == line:
            continue
        if g in left:
            left.remove(g)
        elif (g[0] == 0) == (g[1] == 0) or (g[0] == 0) in ahead:
            return None
        else:
            ahead[int(g[0] == 0)] = number
    return tuple((number, end) for end, number in sorted(ahead.items())) if len(ahead) == 2 and not left else None
