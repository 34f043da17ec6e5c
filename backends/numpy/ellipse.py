"""Moments of ellipses over lanes, which the printed NumPy programs call as `ellipses`.

    v1, v2 = ellipse_0(run, (v0, p1, p2, p3, p4, 0.0), (v5, 1.0))       the place; coefficients

Lanes in which the ellipse holds the box, or has nothing of it, are done with; the moments of the others are computed side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.runtime import Run, Value, gather, on_lanes
from teg.backends.shared.ellipses import Kind, certain, totals, whole_boxes

Array = npt.NDArray[Any]
WIDTH = 600
"""Doubles that a lane takes, beside its arguments."""


@dataclass(frozen=True, slots=True)
class EllipseMoments:
    """An `Ellipse`: its matrix, and what each result is."""

    matrix: tuple[float, ...]
    kinds: tuple[Kind, ...]

    def __call__(self, run: Run, place: tuple[Value, ...], coefficients: tuple[Value, ...], when: Value = True) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes([np.broadcast_to(np.asarray(value, dtype=np.float64), (lanes,)) for value in given])

        step = run.chunk(WIDTH + len(coefficients))
        return on_lanes(work, (*place, *coefficients), when, len(self.kinds), 0.0, step)

    def _lanes(self, given: Sequence[Array]) -> Array:
        inside, beside = certain(np, self.matrix, given[:6])
        found = np.zeros((len(self.kinds), inside.size))
        for region, holds in ((inside, True), (beside, False)):
            lanes = np.flatnonzero(region)
            found[:, lanes] = whole_boxes(np, [value[lanes] for value in given[:6]], self.kinds, self._by_result(given[6:], lanes), holds)
        lanes = np.flatnonzero(~inside & ~beside)
        if lanes.size:
            place = [gather(value, lanes) for value in given[:6]]
            found[:, lanes] = totals(np, self.matrix, place, self.kinds, self._by_result(given[6:], lanes))
        return found

    def _by_result(self, coefficients: Sequence[Array], lanes: Array) -> list[Sequence[Array]]:
        parts: list[Sequence[Array]] = []
        first = 0
        for _, powers in self.kinds:
            parts.append([value[lanes] for value in coefficients[first : first + len(powers)]])
            first += len(powers)
        return parts
