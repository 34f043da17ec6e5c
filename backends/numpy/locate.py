"""Common zeros of two functions, located in a rectangle.

The rectangles of one level, of all lanes, are arrays; a level is one call of the block, or a few where that would take too much memory.
Rectangles without a zero are dropped, so that a level costs what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from teg.backends.numpy.lanes import BOX, Array, Run, Sized, Value, on_lanes
from teg.backends.shared.roots import Halving, excluded, next_halving, plane_step, refuted
from teg.program import LOCATE_HALVINGS, LOCATE_LOST, LOCATE_MOST, LOCATE_NARROW, LOCATE_SAME, LOCATE_STEPS, LOCATE_WIDTH, LOCATE_ZEROS


@dataclass(frozen=True, slots=True)
class Location:
    """The places v where two functions of (v, u) have a common zero: interval bisection of a rectangle.

    `results` is the number of places there is room for; `counts`: the part of the rectangle that was given up is asked for.
    """

    enclosure: Sized
    results: int
    counts: bool = False

    def __call__(
        self,
        run: Run,
        limits: tuple[Value, ...],
        for_enclosure: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the places, of the arguments' common shape, ascending, then the part that was given up; `limits` are those of v, then
        those of u, `for_enclosure` the values that the block takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            found = _Locating(self, run, given[4:]).places(given[:4], lanes)
            run.missed |= bool((found[-1] > LOCATE_LOST).any())
            return found if self.counts else found[:-1]

        given = (*limits, *for_enclosure)
        results = on_lanes(work, given, when, self.results + self.counts, np.inf, run.chunk(len(given) + BOX * LOCATE_WIDTH))
        return (*results[:-1], np.where(np.isinf(results[-1]), 0.0, results[-1])) if self.counts else results


@dataclass(frozen=True, slots=True)
class _Places:
    """Intervals (left, right) of lanes that hold places, of how many rectangles: 1, or 0 for a zero."""

    lane: Array
    left: Array
    right: Array
    rectangles: Array


@dataclass(frozen=True, slots=True)
class _Locating:
    """One search for common zeros on flat lanes, with the values that the block takes from outside."""

    location: Location
    run: Run
    given: Sequence[Array]

    def places(self, limits: Sequence[Array], lanes: int) -> Array:
        """Returns the places, and the part of the rectangle that was given up, (results + 1, lanes)."""
        lo, hi, low, high = (np.broadcast_to(v, (lanes,)) for v in limits)
        lane = np.flatnonzero(np.isfinite([lo, hi, low, high]).all(axis=0) & (lo != hi) & (low != high))
        origin, extent = np.array([np.minimum(lo, hi), np.minimum(low, high)]), np.array([np.abs(hi - lo), np.abs(high - low)])
        found, halved, many = self._rectangles(lane, origin, extent, lanes)
        lane, place, lost = _joined(found, extent[0], 0.5 ** halved[0] * 0.5 ** halved[1])
        lost[many] = 1.0
        return _cut_off(lane, place, self.location.results, lost, origin[0] + extent[0], extent[0])

    def _rectangles(self, lane: Array, origin: Array, extent: Array, lanes: int) -> tuple[_Places, Array, Array]:
        """Returns intervals that hold a place; of each lane how often its rectangles were halved in v and in u, and if it has too many
        zeros."""
        found: list[tuple[Array, Array, Array, Array]] = [(lane[:0], origin[0, :0], origin[0, :0], origin[0, :0])]
        corner, never = np.zeros((2, lane.size)), np.zeros((2, lanes), dtype=np.bool_)
        halving = Halving(np.zeros((2, lanes), dtype=np.int64), np.full(lanes, -1), never, never)
        here = examined = np.bincount(lane, minlength=lanes)
        zeros = np.zeros(lanes, dtype=np.int64)
        while lane.size:
            width = 0.5**halving.times
            near, far = (origin[:, lane] + extent[:, lane] * at for at in (corner, corner + width[:, lane]))
            bounds = self._bounds(lane, near, far)
            kept = np.flatnonzero(~excluded(np, bounds[:4]))
            lane, corner, near, far = lane[kept], corner[:, kept], near[:, kept], far[:, kept]
            if len(bounds) > 4 and lane.size:
                middle = 0.5 * (near + far)
                at = self._bounds(lane, middle, middle)[::2]
                away, single = refuted(np, bounds[:, kept], at, 0.5 * (far - near))
                if single.any():
                    v, same = self._newton(lane[single], middle[:, single], at[:, single]), LOCATE_SAME * extent[0, lane[single]]
                    found.append((lane[single], v - same, v + same, np.zeros(v.size)))
                    zeros += np.bincount(lane[single], minlength=lanes)
                still = ~away & ~single & (zeros[lane] <= LOCATE_ZEROS)
                lane, corner, near, far = lane[still], corner[:, still], near[:, still], far[:, still]
            left = np.bincount(lane, minlength=lanes)
            examined = examined + 2 * left
            ends = (2 * left > LOCATE_WIDTH) | (examined > LOCATE_MOST) | (halving.times == LOCATE_HALVINGS).all(axis=0)
            over = ends[lane]
            found.append((lane[over], near[0, over], far[0, over], np.ones(np.count_nonzero(over))))
            lane, corner = lane[~over], corner[:, ~over]
            halving = next_halving(np, halving, here, left)
            chosen = np.array([halving.last == 0, halving.last == 1]) & (left > 0) & ~ends
            halving = halving._replace(times=halving.times + chosen)
            offset = np.where(chosen, 0.5**halving.times, 0.0)
            lane, corner, here = np.concatenate([lane, lane]), np.concatenate([corner, corner + offset[:, lane]], axis=1), 2 * left
        columns = [np.concatenate(column) for column in zip(*found, strict=True)]
        many = zeros > LOCATE_ZEROS
        few = ~many[columns[0]]
        return _Places(*(column[few] for column in columns)), halving.times, many

    def _newton(self, lane: Array, at: Array, values: Array) -> Array:
        """Returns the v of the zeros near points (v, u), by Newton's method; `values` are f, g and their slopes there."""
        for step in range(LOCATE_STEPS):
            at = at - plane_step(np, values)
            if step < LOCATE_STEPS - 1:
                values = self._bounds(lane, at, at)[::2]
        return cast(Array, at[0])

    def _bounds(self, lane: Array, near: Array, far: Array) -> Array:
        """Returns bounds over rectangles between two corners."""
        sides = near[0], far[0], near[1], far[1]
        return self.location.enclosure.at(self.run, lane, sides, self.given)


def _joined(found: _Places, extent: Array, area: Array) -> tuple[Array, Array, Array]:
    """Returns places, (lane, place), after intervals that overlap or touch were joined: the middle of a narrow interval, or both ends of a
    wide one, in which so many rectangles of that `area` are lost. Both ends are sorted by themselves: an interval begins a new place if as
    many intervals ended before it as began."""
    if not found.lane.size:
        return found.lane, found.left, np.zeros(extent.size)
    order = np.lexsort((found.left, found.lane))
    lane, left, rectangles = found.lane[order], found.left[order], found.rectangles[order]
    right = found.right[np.lexsort((found.right, found.lane))]
    starts = np.flatnonzero(np.r_[True, (lane[1:] != lane[:-1]) | (left[1:] > right[:-1])])
    rectangles = np.add.reduceat(rectangles, starts)
    lane, left, right = lane[starts], left[starts], right[np.r_[starts[1:], lane.size] - 1]
    wide = right - left > LOCATE_NARROW * extent[lane]
    lost = np.bincount(lane[wide], weights=rectangles[wide], minlength=extent.size) * area
    places = np.where(wide, left, 0.5 * (left + right))
    return np.concatenate([lane, lane[wide]]), np.concatenate([places, right[wide]]), lost


def _cut_off(lane: Array, place: Array, results: int, lost: Array, end: Array, extent: Array) -> Array:
    """Returns the first places of each lane in ascending order, then +inf, and the part that is lost, which includes places beyond the last
    one."""
    order = np.lexsort((place, lane))
    lane, place = lane[order], place[order]
    count = np.bincount(lane, minlength=lost.size)
    rank = np.arange(lane.size) - (np.cumsum(count) - count)[lane]
    table = np.full((results + 1, lost.size), np.inf)
    table[rank[rank < results], lane[rank < results]] = place[rank < results]
    table[-1] = lost
    more = count > results
    table[-1, more] = np.minimum(1.0, table[-1, more] + np.maximum(0.0, (end - table[results - 1])[more] / extent[more]))
    return table
