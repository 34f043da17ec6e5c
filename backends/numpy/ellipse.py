"""Moments of ellipses over lanes, which the printed NumPy programs call as `ellipses`.

    v1, v2 = ellipse_0(run, (1.0, 0.0, 0.0, 1.0), (v0, p1, p2, p3, p4, 0.0), (v5, 1.0), ())     the matrix; place; coefficients; planes

Lanes in which the ellipse holds the box, or has nothing of it, are done with; the moments of the others are computed side by side, with
as many corners of the polygon as the lane that has most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.lanes import Run, Value, gather, on_lanes
from teg.backends.numpy.polygon import clipped, meets
from teg.backends.shared.ellipses import Domain, Kind, box_domain, certain, corners_of_box, on_crossed, on_one_side, polygon_domain

Array = npt.NDArray[Any]
WIDTH = 600
"""Doubles that a lane takes, beside its arguments."""


@dataclass(frozen=True, slots=True)
class EllipseMoments:
    """An `Ellipse`: what each result is, and of each half-plane whether it is closed."""

    kinds: tuple[Kind, ...]
    closed: tuple[bool, ...] = ()

    def __call__(
        self,
        run: Run,
        matrix: tuple[Value, ...],
        place: tuple[Value, ...],
        coefficients: tuple[Value, ...],
        planes: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes([np.broadcast_to(np.asarray(value, dtype=np.float64), (lanes,)) for value in given])

        step = run.chunk(WIDTH * (4 + len(self.closed)) // 4 + len(coefficients))
        return on_lanes(work, (*matrix, *place, *planes, *coefficients), when, len(self.kinds), 0.0, step)

    def _lanes(self, given: Sequence[Array]) -> Array:
        """Returns (results, lanes), of the lanes in which the half-planes meet the box."""
        planes, (width, height) = given[10 : 10 + 3 * len(self.closed)], given[7:9]
        if not self.closed:
            return self._on(given, None)
        fails, known, least, _ = meets(planes, self.closed, width, height)
        found = np.where(fails & (abs(_determinant(given)) > 0.0), 0.0, np.nan) * np.ones((len(self.kinds), 1))
        active = np.flatnonzero(~fails & known)
        if active.size:
            part = [value[active] for value in given]
            places, left = clipped_boxes(part[7], part[8], [value[active] for value in planes], [value[active] for value in least])
            found[:, active] = np.where(left, self._on(part, places), 0.0)
        return found

    def _on(self, given: Sequence[Array], corners: Array | None) -> Array:
        """Returns (results, lanes), on boxes or on polygons with corners (2, rows, lanes)."""
        first = 10 + 3 * len(self.closed)
        matrix, place, planes, coefficients = given[:4], given[4:10], given[10:first], given[first:]
        inside, beside = certain(np, matrix, place)
        found = np.zeros((len(self.kinds), inside.size))

        def domain(lanes: Array) -> Domain:
            numbers = [value[lanes] for value in place]
            if corners is None:
                return box_domain(np, numbers, self.kinds)
            lines = [(planes[i][lanes], planes[i + 1][lanes], planes[i + 2][lanes]) for i in range(0, len(planes), 3)]
            u, v = corners[..., lanes]
            return polygon_domain(np, numbers, self.kinds, (u, v), lines)

        for region, holds in ((inside, True), (beside, False)):
            lanes = np.flatnonzero(region)
            factors = self._by_result(coefficients, lanes)
            found[:, lanes] = on_one_side(np, domain(lanes).whole, self.kinds, factors, holds, place[3][lanes]) if lanes.size else 0.0
        lanes = np.flatnonzero(~inside & ~beside)
        if lanes.size:
            axes, numbers = ([gather(value, lanes) for value in part] for part in (matrix, place))
            found[:, lanes] = on_crossed(np, axes, numbers, self.kinds, self._by_result(coefficients, lanes), domain(lanes))
        return found

    def _by_result(self, coefficients: Sequence[Array], lanes: Array) -> list[Sequence[Array]]:
        parts: list[Sequence[Array]] = []
        first = 0
        for _, powers, _ in self.kinds:
            parts.append([value[lanes] for value in coefficients[first : first + len(powers)]])
            first += len(powers)
        return parts


def _determinant(given: Sequence[Array]) -> Array:
    whole: Array = given[0] * given[3] - given[1] * given[2]
    return whole


def clipped_boxes(width: Array, height: Array, planes: Sequence[Array], least: Sequence[Array]) -> tuple[Array, Array]:
    """Returns the corners of boxes that half-planes with these least values clip, counterclockwise, (2, rows, lanes), the first one again
    for those that a lane has not; and whether anything is left."""
    places, corners = np.stack(corners_of_box(np, width, height)), np.full(width.size, 4)
    for i, low in enumerate(least):
        places, corners = clipped(places, corners, low < 0.0, planes[3 * i : 3 * i + 3])
    return np.where(np.arange(places.shape[1])[:, None] < corners, places, places[:, :1]), corners > 2
