"""The edges of a box."""

from __future__ import annotations

import numpy as np

from teg.numerics.polyhedra import CORNERS, SIDES, box_edges


def test_faces_are_closed_and_counterclockwise() -> None:
    """Around each face the edges are a closed way, whose vector area points outwards and is 1."""
    sides = [np.zeros(3) for _ in range(SIDES)]
    ends: list[list[tuple[int, int]]] = [[] for _ in range(SIDES)]
    for face, other, start, stop in box_edges():
        for f, p, q in ((face, start, stop), (other, stop, start)):
            sides[f] += 0.5 * np.cross(CORNERS[p], CORNERS[q])
            ends[f].append((p, q))
    for f, (area, around) in enumerate(zip(sides, ends, strict=True)):
        assert sorted(p for p, _ in around) == sorted(q for _, q in around)
        assert len(around) == 4
        outwards = np.eye(3)[f // 2] * (1 if f % 2 else -1)
        np.testing.assert_array_equal(area, outwards)
