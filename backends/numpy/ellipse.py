"""Moments of ellipses over lanes, which the printed NumPy programs call as `ellipses`.

    v1, v2 = ellipse_0(run, (1.0, 0.0, 0.0, 1.0), (v0, p1, p2, p3, p4, 0.0), (v5, 1.0))     the matrix; the place; coefficients

Lanes in which the ellipse holds the box, or has nothing of it, are done with; the moments of the others are computed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.runtime import Run, Value, gather, on_lanes
from teg.backends.shared.ellipses import certain, on_crossed_boxes, oriented, whole_boxes
from teg.backends.shared.moments import Kind

Array = npt.NDArray[Any]
WIDTH = 600
"""Doubles that a lane takes, beside its arguments."""


@dataclass(frozen=True, slots=True)
class EllipseMoments:
    """An `Ellipse`: what each result is."""

    kinds: tuple[Kind, ...]

    def __call__(
        self, run: Run, matrix: tuple[Value, ...], place: tuple[Value, ...], coefficients: tuple[Value, ...], when: Value = True
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes([np.broadcast_to(np.asarray(value, dtype=np.float64), (lanes,)) for value in given])

        step = run.chunk(WIDTH + len(coefficients))
        return on_lanes(work, (*matrix, *place, *coefficients), when, len(self.kinds), 0.0, step)

    def _lanes(self, given: Sequence[Array]) -> Array:
        matrix, place, coefficients = oriented(np, given[:4]), given[4:10], given[10:]
        inside, beside = certain(np, matrix, place)
        found = np.zeros((len(self.kinds), inside.size))
        for region, holds in ((inside, True), (beside, False)):
            lanes = np.flatnonzero(region)
            found[:, lanes] = whole_boxes(np, [value[lanes] for value in place], self.kinds, self._by_result(coefficients, lanes), holds)
        lanes = np.flatnonzero(~inside & ~beside)
        if lanes.size:
            axes, numbers = ([gather(value, lanes) for value in part] for part in (matrix, place))
            found[:, lanes] = on_crossed_boxes(np, axes, numbers, self.kinds, self._by_result(coefficients, lanes))
        return found

    def _by_result(self, coefficients: Sequence[Array], lanes: Array) -> list[Sequence[Array]]:
        parts: list[Sequence[Array]] = []
        first = 0
        for _, powers in self.kinds:
            parts.append([value[lanes] for value in coefficients[first : first + len(powers)]])
            first += len(powers)
        return parts
