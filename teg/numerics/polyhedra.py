"""The edges of a box: what a clipped polyhedron begins with."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import NamedTuple

SIDES = 6
"""Faces of a box: 2m and 2m + 1 are the near and the far one in variable m."""
CORNERS = tuple(product((0, 1), repeat=3))
"""Corner 4i + 2j + k is at the far end in the three variables if i, j and k are 1."""


class Edge(NamedTuple):
    """An edge between two faces, around the first of them, counterclockwise from outside, from `start` to `stop`; corners by their
    numbers."""

    face: int
    other: int
    start: int
    stop: int


@cache
def box_edges() -> tuple[Edge, ...]:
    """Returns the twelve edges of a box."""
    edges: list[Edge] = []
    for face, other in product(range(SIDES), repeat=2):
        m, n = face // 2, other // 2
        if m < n:
            start = (face % 2) * (4 >> m) + (other % 2) * (4 >> n)
            stop = start + (4 >> (3 - m - n))
            is_forward = (face % 2 == other % 2) == (n - m == 1)
            edges.append(Edge(face, other, start, stop) if is_forward else Edge(face, other, stop, start))
    return tuple(edges)
