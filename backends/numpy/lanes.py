"""Lanes: one run of a printed program, and values that are gathered, cut and scattered.

A value of a program is an array with one entry a lane, or a scalar (0-d) where no lane differs. In the outermost block the lanes are the
batch, shape (L,). Whatever is wide is cut into chunks: no block holds more than about `Run.room` doubles at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Value = Any  # an Array of lanes, or a scalar: numpy.float64, numpy.bool_, float, bool
Block = Callable[..., tuple[Value, ...]]  # (run, variable, *values from outside) -> values

MAX_LANES = 2**15
"""No block runs on more lanes than this at a time: longer arrays only fall out of the cache."""


@dataclass(slots=True)
class Run:
    """One run of a program: how it decides ties, and how many doubles a block may hold. It notes the ties that were met, whether
    a tolerance was missed, at how many points integrands without integrals inside were evaluated, and whether a search has too
    little room."""

    order: int
    room: int
    met: set[int] = field(default_factory=set)
    missed: bool = False
    evaluations: int = 0
    crowded: bool = False
    most: float = np.inf  # evaluations, beyond which every interval is accepted
    searched: int = 0  # boxes and places of isolations, which count as evaluations
    ended: bool = False  # intervals were accepted for that reason
    tied: bool = False  # of all runs of a call: a tie was met that matters, if the program weighs them

    @property
    def is_of_surfaces(self) -> bool:
        """Returns whether ties are decided by an order of the surfaces, not all in one way."""
        return abs(self.order) == 1

    def add(self, other: Run) -> None:
        """Adds the notes of another run of the program, but for its ties."""
        self.missed |= other.missed
        self.crowded |= other.crowded
        self.evaluations += other.evaluations
        self.searched += other.searched
        self.ended |= other.ended

    def chunk(self, width: int, lanes: int = 1) -> int:
        """Returns the number of items, of `lanes` lanes of `width` doubles each, on which a block may run at a time."""
        return max(1, min(self.room // max(1, width), MAX_LANES) // lanes)


def gather(value: Value, index: Array | None) -> Value:
    """Returns the lanes `index` of a value; a scalar, or all lanes, as they are."""
    return value if index is None or not np.ndim(value) else value[index]


def cut(value: Value, part: slice) -> Value:
    """Returns a run of lanes of a value; a scalar as it is."""
    return value[part] if np.ndim(value) else value


def parts(size: int, step: int) -> Iterator[slice]:
    """Returns slices of at most `step` that cover range(size)."""
    return (slice(start, start + step) for start in range(0, size, step))


def scatter(values: Array, lane: Array, lanes: int) -> Array:
    """Returns each row of `values` summed into its lanes, (rows, lanes)."""
    return np.array([np.bincount(lane, weights=row, minlength=lanes) for row in values], dtype=np.float64)


def on_lanes(
    work: Callable[[Sequence[Array], int], Array],
    given: Sequence[Value],
    when: Value,
    results: int,
    absent: float,
    step: int,
) -> tuple[Value, ...]:
    """Returns `results` values of the common shape: those that `work` computes from the lanes of `given`, and `absent` where `when` is
    false.

    `work` takes at most `step` lanes at a time, flat, and how many they are; it returns (results, lanes).
    """
    if not np.any(when):
        return (np.float64(absent),) * results
    given = [np.asarray(v) for v in (when, *given)]
    shape: tuple[int, ...] = max((v.shape for v in given), key=len)
    if not shape:
        return tuple(work(given[1:], 1)[:, 0])
    given = [np.broadcast_to(v, shape).reshape(-1) if v.ndim else v for v in given]
    active = None if given[0].all() else np.flatnonzero(given[0])
    given = [gather(v, active) for v in given[1:]]
    lanes = int(np.prod(shape)) if active is None else active.size
    found = np.empty((results, lanes))
    for part in parts(lanes, step):
        found[:, part] = work([cut(v, part) for v in given], min(part.stop, lanes) - part.start)
    if active is not None:
        everywhere = np.full((results, int(np.prod(shape))), absent)
        everywhere[:, active] = found
        found = everywhere
    return tuple(found.reshape((results, *shape)))


BOX = 20
"""Doubles that a box takes while its level is examined."""


@dataclass(frozen=True, slots=True)
class Sized:
    """A printed block, how many results it has, and the doubles that a lane of it takes."""

    block: Block
    results: int
    width: int

    def at(self, run: Run, lane: Array, places: Sequence[Array], given: Sequence[Array]) -> Array:
        """Returns the results, (results, places), at places in lanes; `given` has a value a lane."""
        found = np.empty((self.results, lane.size))
        for part in parts(lane.size, run.chunk(self.width)):
            index = lane[part]
            values = self.block(run, *(a[part] for a in places), *(gather(v, index) for v in given))
            for row, value in zip(found, values, strict=True):
                row[part] = value
        return found
