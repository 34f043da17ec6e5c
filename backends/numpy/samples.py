"""Points of `teg.numerics.sobol`, as arrays, and means over them: what the printed NumPy programs call as `sampling`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.runtime import Array, Block, Run, Value, on_lanes, parts
from teg.numerics.sobol import BITS, GAMMA, LOW_BITS, MIX, SCRAMBLE, key, replicated, reversed_directions

Words = npt.NDArray[np.uint64]
Halves = npt.NDArray[np.uint32]

STRETCH = 2**14
"""Points that are made at a time."""
ABREAST = 64
"""Points that a chunk has at least, if there is room for them."""


@lru_cache(maxsize=16)  # every chunk of a batch wants the same ones
def points(kind: str, seed: int, dimensions: int, count: int, first: int, last: int) -> npt.NDArray[np.float64]:
    """The coordinates of points first … last - 1 of a rule, (dimensions, last - first), in (0, 1): replicate after replicate."""
    replicates, each = replicated(kind, count)
    numbers = np.arange(first, last, dtype=np.uint64)
    found = np.empty((dimensions, numbers.size))
    replicate, index = np.divmod(numbers, np.uint64(each))
    for d in range(dimensions):
        keys = np.array([key(seed, r, d) for r in range(replicates)], dtype=np.uint64)[replicate]
        found[d] = random_coordinate(keys, index) if kind == "montecarlo" else sobol_coordinate(keys, index, d)
    found.flags.writeable = False
    return found


def mix(z: Words) -> Words:
    """64 bits well mixed, of each."""
    for shift, factor in MIX:
        z = (z ^ z >> np.uint64(shift)) * np.uint64(factor)
    return z


def random_coordinate(keys: Words, index: Words) -> npt.NDArray[np.float64]:
    """Coordinates of pseudo-random points."""
    return _unit(mix(keys + index * np.uint64(GAMMA)) >> np.uint64(12))


def sobol_coordinate(keys: Words, index: Words, dimension: int) -> npt.NDArray[np.float64]:
    """Coordinates of scrambled Sobol' points."""
    gray = (index ^ index >> np.uint64(1)).astype(np.uint32)
    x = np.zeros(index.shape, np.uint32)
    columns = reversed_directions(dimension)
    for j in range(min(BITS, int(gray.max(initial=0)).bit_length())):
        x ^= (gray >> np.uint32(j) & np.uint32(1)) * np.uint32(columns[j])
    y = _reverse(_scramble(x, keys)).astype(np.uint64)
    low = mix(keys + y * np.uint64(GAMMA)) >> np.uint64(64 - LOW_BITS)
    return _unit(y << np.uint64(LOW_BITS) | low)


def _unit(cell: Words) -> npt.NDArray[np.float64]:
    """The centre of a cell of width 2⁻⁵²."""
    return (2 * cell + 1).astype(np.float64) * 2.0**-53


def _scramble(x: Halves, keys: Words) -> Halves:
    """A nested uniform scramble of reversed bits."""
    before, *after = SCRAMBLE
    x = x ^ x * np.uint32(before)
    x = (x + keys.astype(np.uint32)) * ((keys >> np.uint64(32)).astype(np.uint32) | np.uint32(1))
    for factor in after:
        x = x ^ x * np.uint32(factor)
    return x


def _reverse(x: Halves) -> Halves:
    """32 bits in reverse: halves, then quarters of them, and so on, change places."""
    for shift, mask in ((16, 0x0000FFFF), (8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        x = (x >> np.uint32(shift) & np.uint32(mask)) | (x & np.uint32(mask)) << np.uint32(shift)
    return x


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
        """The results, of the arguments' common shape; `for_body` is what the body takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given, lanes)

        results = self.values + (self.tested if self.estimated else 0)
        return on_lanes(work, for_body, when, results, 0.0, run.chunk(self.width, ABREAST))

    def _lanes(self, run: Run, given: Sequence[Array], lanes: int) -> Array:
        """The results on flat lanes, (results, lanes)."""
        replicates, each = replicated(self.kind, self.count)
        totals = np.zeros((replicates, self.values, lanes))
        shift, squares = np.zeros((2, self.tested, lanes))
        if self.leaf:
            run.evaluations += replicates * each * lanes
        for r in range(replicates):
            for stretch in parts(each, STRETCH):
                first = r * each + stretch.start
                at = points(self.kind, self.seed, self.dimensions, self.count, first, min(first + STRETCH, (r + 1) * each))
                for part in parts(at.shape[1], run.chunk(self.width, lanes)):
                    found = self._values(run, at[:, part], given, lanes)
                    totals[r] += found.sum(axis=1)
                    if self.estimated and self.kind == "montecarlo":
                        if part.start == stretch.start == 0:
                            shift = found[: self.tested, 0]
                        squares += np.square(found[: self.tested] - shift[:, None]).sum(axis=1)
        means = totals / each
        mean: Array = means.mean(axis=0)
        if not self.estimated:
            return mean
        tested = mean[: self.tested]
        if self.kind == "montecarlo":
            variance = np.maximum(squares - each * np.square(tested - shift), 0.0) / (each - 1.0) / each
        else:
            variance = np.square(means[:, : self.tested] - tested).sum(axis=0) / (replicates * (replicates - 1.0))
        return np.concatenate([mean, np.sqrt(variance)])

    def _values(self, run: Run, at: Array, given: Sequence[Array], lanes: int) -> Array:
        """The values at points (dimensions, n), (values, n, lanes)."""
        shape = (at.shape[1], lanes)
        found = np.empty((self.values, *shape))
        for row, value in zip(found, self.body(run, *(np.broadcast_to(u[:, None], shape) for u in at), *given), strict=True):
            row[:] = value
        return found
