"""Points of `teg.numerics.sobol`, as arrays, and means over them, which the printed NumPy programs call as `sampling`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.lanes import Array, Block, Run, Value, on_lanes, parts
from teg.backends.shared.samples import Points, coordinate, standard_error
from teg.numerics.sobol import replicated

STRETCH = 2**14
"""Points that are made at a time."""
ABREAST = 64
"""Points that a chunk has at least, if there is room for them."""


@lru_cache(maxsize=16)  # every chunk of a batch wants the same ones
def points(kind: str, seed: int, dimensions: int, count: int, first: int, last: int) -> npt.NDArray[np.float64]:
    """Returns the coordinates of points first … last - 1 of a rule, (dimensions, last - first), in (0, 1): replicate after replicate."""
    _, each = replicated(kind, count)
    numbers = np.arange(first, last, dtype=np.uint64)
    found = np.empty((dimensions, numbers.size))
    replicate, index = np.divmod(numbers, np.uint64(each))
    for d in range(dimensions):
        found[d] = coordinate(np, Points(kind, seed, count), d, replicate, index)
    found.flags.writeable = False
    return found


@dataclass(frozen=True, slots=True)
class Mean:
    """The means of a body over the points of a rule, and the standard errors of the first `tested` of its `values` if `estimated`.

    `width`: the doubles that a point of a lane takes; `leaf`: there is no integral inside.
    """

    body: Block
    kind: str
    seed: int
    dimensions: int
    count: int
    values: int
    tested: int
    estimated: bool
    width: int
    leaf: bool

    def __call__(self, run: Run, for_body: tuple[Value, ...], when: Value = True) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape; `for_body` are the values that the body takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given, lanes)

        results = self.values + (self.tested if self.estimated else 0)
        return on_lanes(work, for_body, when, results, 0.0, run.chunk(self.width, ABREAST))

    def _lanes(self, run: Run, given: Sequence[Array], lanes: int) -> Array:
        """Returns the results on flat lanes, (results, lanes)."""
        replicates, each = replicated(self.kind, self.count)
        totals = np.zeros((replicates, self.values, lanes))
        shift, squares = np.zeros((2, replicates, self.tested, lanes))
        if self.leaf:
            run.evaluations += replicates * each * lanes
        for r in range(replicates):
            for stretch in parts(each, STRETCH):
                first = r * each + stretch.start
                at = points(self.kind, self.seed, self.dimensions, self.count, first, min(first + STRETCH, (r + 1) * each))
                for part in parts(at.shape[1], run.chunk(self.width, lanes)):
                    found = self._values(run, at[:, part], given, lanes)
                    totals[r] += found.sum(axis=1)
                    if self.estimated:
                        if part.start == stretch.start == 0:
                            shift[r] = found[: self.tested, 0]
                        squares[r] += np.square(found[: self.tested] - shift[r][:, None]).sum(axis=1)
        means = totals / each
        mean: Array = means.mean(axis=0)
        if not self.estimated:
            return mean
        return np.concatenate([mean, standard_error(np, each, means[:, : self.tested], shift, squares)])

    def _values(self, run: Run, at: Array, given: Sequence[Array], lanes: int) -> Array:
        """Returns the values at points (dimensions, n), (values, n, lanes)."""
        shape = (at.shape[1], lanes)
        found = np.empty((self.values, *shape))
        for row, value in zip(found, self.body(run, *(np.broadcast_to(u[:, None], shape) for u in at), *given), strict=True):
            row[:] = value
        return found
