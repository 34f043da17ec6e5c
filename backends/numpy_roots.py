"""What the printed NumPy programs call, as `roots`: roots isolated between bounds, sums over them, common zeros located.

The boxes of one level, of all lanes, are arrays; a level is one call of each block, or a few where that would take
too much memory. Boxes without a root are dropped, so that a level costs what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teg.backends.numpy_runtime import Array, Block, Run, Value, gather, on_lanes, parts, scatter
from teg.program import ISOLATE_DEPTH, ISOLATE_STEPS, ISOLATE_WIDTH, LOCATE_DEPTH, LOCATE_WIDTH

BOX = 20
"""Doubles that a box takes while its level is examined."""


@dataclass(frozen=True, slots=True)
class Isolation:
    """The roots of a function: interval bisection, then Newton's method.

    `enclosure` and `point` are printed blocks, `results` the number of roots there is room for, and the widths are
    the doubles that a lane of each block takes.
    """

    enclosure: Block
    point: Block
    results: int
    enclosure_width: int
    point_width: int

    def __call__(
        self,
        run: Run,
        lo: Value,
        hi: Value,
        for_enclosure: tuple[Value, ...],
        for_point: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """The roots, of the arguments' common shape, ascending; `for_…` are what the blocks take from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            first = 2 + len(for_enclosure)
            return _Search(self, run, given[2:first], given[first:]).roots(given[0], given[1], lanes)

        given = (lo, hi, *for_enclosure, *for_point)
        return on_lanes(work, given, when, self.results, np.inf, run.chunk(len(given) + BOX * ISOLATE_WIDTH))


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Boxes (p, q) in lanes, in ascending order, with g at both ends."""

    lane: Array
    p: Array
    q: Array
    at_p: Array
    at_q: Array

    def __getitem__(self, index: Array | slice) -> _Boxes:
        return _Boxes(self.lane[index], self.p[index], self.q[index], self.at_p[index], self.at_q[index])

    @property
    def changes(self) -> Array:
        """Where g changes its sign."""
        changes: Array = ((self.at_p <= 0.0) & (self.at_q > 0.0)) | ((self.at_q <= 0.0) & (self.at_p > 0.0))
        return changes

    @property
    def known(self) -> Array:
        """Where g is a number at both ends."""
        known: Array = ~(np.isnan(self.at_p) | np.isnan(self.at_q))
        return known

    def halved(self, m: Array, at_m: Array) -> _Boxes:
        """The halves, in order; a box whose middle m is rounded to one of its ends stays whole."""
        apart = (self.p < m) & (m < self.q)
        times = np.where(apart, 2, 1)
        left = (np.cumsum(times) - times)[apart]
        halves = self[np.repeat(np.arange(m.size), times)]
        halves.q[left] = halves.p[left + 1] = m[apart]
        halves.at_q[left] = halves.at_p[left + 1] = at_m[apart]
        return halves

    def joined(self) -> _Boxes:
        """Boxes that share an end as one."""
        starts = np.flatnonzero(np.r_[True, (self.lane[1:] != self.lane[:-1]) | (self.p[1:] != self.q[:-1])])
        ends = np.r_[starts[1:], self.lane.size] - 1
        return _Boxes(self.lane[starts], self.p[starts], self.q[ends], self.at_p[starts], self.at_q[ends])


@dataclass(frozen=True, slots=True)
class _Search:
    """One search on flat lanes, with what the blocks take from outside."""

    isolation: Isolation
    run: Run
    for_enclosure: Sequence[Array]
    for_point: Sequence[Array]

    def roots(self, lo: Array, hi: Array, lanes: int) -> Array:
        """The roots in (lo, hi), (results, lanes)."""
        lo, hi = (np.broadcast_to(v, (lanes,)) for v in (lo, hi))
        finite = np.isfinite(lo) & np.isfinite(hi)
        lane = np.flatnonzero(finite & (lo != hi))
        p, q = np.minimum(lo, hi)[lane], np.maximum(lo, hi)[lane]
        whole = _Boxes(lane, p, q, self._at(lane, p)[0], self._at(lane, q)[0])
        monotone, undecided, crowded = self._boxes(whole, lanes)
        found = [self._crossings(monotone), self._tangencies(undecided)]
        lane, root = np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])
        return _table(lane, root, self.isolation.results, ~finite | crowded, np.nan)

    def _boxes(self, boxes: _Boxes, lanes: int) -> tuple[_Boxes, _Boxes, Array]:
        """The monotone boxes in which g changes its sign, the undecided ones, and the lanes with too many."""
        crowded = np.zeros(lanes, dtype=np.bool_)
        found = [boxes[:0]]
        for level in range(ISOLATE_DEPTH + 1):
            crowded |= np.bincount(boxes.lane, minlength=lanes) > ISOLATE_WIDTH
            boxes = boxes[~crowded[boxes.lane]]
            if not boxes.lane.size:
                break
            m, h = 0.5 * (boxes.p + boxes.q), 0.5 * (boxes.q - boxes.p)
            least, most, slowest, fastest = self._enclosed(boxes)
            g, _ = self._at(boxes.lane, m)
            reach = h * np.maximum(np.abs(slowest), np.abs(fastest))
            bounded = np.isfinite(slowest) & np.isfinite(fastest)
            away = (least > 0.0) | (most < 0.0) | (bounded & ((g - reach > 0.0) | (g + reach < 0.0)))
            away |= np.isnan(least) & np.isnan(most) & np.isnan(g)
            steep = ((slowest > 0.0) | (fastest < 0.0)) & boxes.known
            found.append(boxes[steep & boxes.changes])
            flat = (slowest == 0.0) & (fastest == 0.0)
            left = np.flatnonzero((boxes.changes | ~away) & ~steep & ~flat)
            boxes = boxes[left] if level == ISOLATE_DEPTH else boxes[left].halved(m[left], g[left])
        columns = [[b.lane, b.p, b.q, b.at_p, b.at_q] for b in found]
        monotone = _Boxes(*(np.concatenate(column) for column in zip(*columns, strict=True)))
        return monotone[~crowded[monotone.lane]], boxes, crowded

    def _crossings(self, boxes: _Boxes) -> tuple[Array, Array]:
        """The roots in monotone boxes, (lane, root), by Newton's method kept inside by bisection."""
        lane, p, q, above = boxes.lane, boxes.p, boxes.q, boxes.at_q > 0.0
        v = 0.5 * (p + q)
        where, root = np.arange(v.size), v.copy()
        before = last = np.full(v.size, np.inf)
        for _ in range(ISOLATE_STEPS):
            if not v.size:
                break
            g, slope = self._at(lane, v)
            at_right = (g > 0.0) == above
            p, q = np.where(at_right, p, v), np.where(at_right, v, q)
            step, middle = -g / slope, 0.5 * (p + q)
            newton = (v + step >= p) & (v + step <= q) & (step != 0.0) & ~(np.abs(step) > 0.5 * before)
            step = np.where(newton, step, middle - v)
            v = np.where(g == 0.0, v, np.where(newton, v + step, middle))
            root[where] = v
            going = np.flatnonzero((g != 0.0) & ~(np.abs(step) <= 2.0**-52 * np.abs(v)))
            before, last = last[going], np.abs(step)[going]
            where, lane, above = where[going], lane[going], above[going]
            p, q, v = p[going], q[going], v[going]
        return boxes.lane, root

    def _tangencies(self, boxes: _Boxes) -> tuple[Array, Array]:
        """The roots of undecided boxes, (lane, root): one where g changes its sign in neighbouring boxes together, else two."""
        if not boxes.lane.size:
            return boxes.lane, boxes.p
        boxes = boxes.joined()
        times = np.where(boxes.changes, 1, np.where(boxes.known, 2, 0))
        return np.repeat(boxes.lane, times), np.repeat(0.5 * (boxes.p + boxes.q), times)

    def _at(self, lane: Array, v: Array) -> Array:
        """g and its slope, (2, points), at points v of their lanes."""
        return _evaluated(self.run, self.isolation.point, self.isolation.point_width, 2, lane, (v,), self.for_point)

    def _enclosed(self, boxes: _Boxes) -> Array:
        """Bounds of g and of its slope, (4, boxes)."""
        width, ends = self.isolation.enclosure_width, (boxes.p, boxes.q)
        return _evaluated(self.run, self.isolation.enclosure, width, 4, boxes.lane, ends, self.for_enclosure)


@dataclass(frozen=True, slots=True)
class PointSum:
    """The sums of `results` values of a body over points, those that are there; `width` doubles a point."""

    body: Block
    results: int
    width: int

    def __call__(self, run: Run, points: tuple[Value, ...], for_body: tuple[Value, ...], when: Value = True) -> tuple[Value, ...]:
        """The sums, of the arguments' common shape; `for_body` is what the body takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            at = np.array([np.broadcast_to(v, (lanes,)) for v in given[: len(points)]]).reshape((-1, lanes))
            unknown = np.isnan(at).any(axis=0)
            there = np.flatnonzero(np.isfinite(at) & ~unknown)
            lane = there % lanes
            values = _evaluated(run, self.body, self.width, self.results, lane, (at.reshape(-1)[there],), given[len(points) :])
            sums = scatter(values, lane, lanes).reshape((self.results, lanes))
            sums[:, unknown] = np.nan
            return sums

        given = (*points, *for_body)
        step = run.chunk(len(given) + (2 + self.results) * len(points), max(1, len(points)))
        return on_lanes(work, given, when, self.results, 0.0, step)


@dataclass(frozen=True, slots=True)
class Location:
    """The places v where two functions of (v, u) have a common zero: interval bisection of a rectangle.

    `enclosure` is a printed block, `results` the number of places there is room for, `width` the doubles that a
    lane of the block takes.
    """

    enclosure: Block
    results: int
    width: int

    def __call__(
        self,
        run: Run,
        lo: Value,
        hi: Value,
        low: Value,
        high: Value,
        for_enclosure: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """The places, of the arguments' common shape, ascending; `for_enclosure` is what the block takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            lane, left, right, crowded = self._rectangles(run, given[:4], given[4:], lanes)
            lane, place = _middles(lane, left, right)
            return _table(lane, place, self.results, crowded, np.inf)

        given = (lo, hi, low, high, *for_enclosure)
        return on_lanes(work, given, when, self.results, np.inf, run.chunk(len(given) + BOX * LOCATE_WIDTH))

    def _rectangles(
        self,
        run: Run,
        limits: Sequence[Array],
        given: Sequence[Array],
        lanes: int,
    ) -> tuple[Array, Array, Array, Array]:
        """The rectangles that are kept, as (lane, left, right), and the lanes with too many on a level."""
        lo, hi, low, high = (np.broadcast_to(v, (lanes,)) for v in limits)
        lane = np.flatnonzero(np.isfinite([lo, hi, low, high]).all(axis=0) & (lo != hi) & (low != high))
        corners = np.minimum(lo, hi), np.maximum(lo, hi), np.minimum(low, high), np.maximum(low, high)
        sides = np.array([side[lane] for side in corners])
        crowded = np.zeros(lanes, dtype=np.bool_)
        for level in range(LOCATE_DEPTH + 1):
            if not lane.size:
                break
            f_least, f_most, g_least, g_most = _evaluated(run, self.enclosure, self.width, 4, lane, tuple(sides), given)
            away = (f_least > 0.0) | (f_most < 0.0) | (g_least > 0.0) | (g_most < 0.0)
            away |= (np.isnan(f_least) & np.isnan(f_most)) | (np.isnan(g_least) & np.isnan(g_most))
            kept = np.flatnonzero(~away)
            if level < LOCATE_DEPTH:  # lanes that are about to have too many are left out before they take the memory
                crowded |= 2 * np.bincount(lane[kept], minlength=lanes) > LOCATE_WIDTH
                kept = kept[~crowded[lane[kept]]]
            lane, sides = lane[kept], sides[:, kept]
            if level < LOCATE_DEPTH:
                lane, sides = np.concatenate([lane, lane]), _halved(sides, 0 if level % 2 == 0 else 2)
        return lane, sides[0], sides[1], crowded


def _halved(sides: Array, first: int) -> Array:
    """All lower halves of rectangles, then all upper ones, (4, 2·rectangles), cut between the sides `first` and `first` + 1."""
    lower, upper = sides.copy(), sides.copy()
    lower[first + 1] = upper[first] = 0.5 * (sides[first] + sides[first + 1])
    return np.concatenate([lower, upper], axis=1)


def _middles(lane: Array, left: Array, right: Array) -> tuple[Array, Array]:
    """The middles, as (lane, place), of intervals (left, right), those that overlap or touch being joined.

    The intervals are of one level of bisection: in the order of their left ends their right ends ascend too.
    """
    if not lane.size:
        return lane, left
    order = np.lexsort((right, left, lane))
    lane, left, right = lane[order], left[order], right[order]
    starts = np.flatnonzero(np.r_[True, (lane[1:] != lane[:-1]) | (left[1:] > right[:-1])])
    ends = np.r_[starts[1:], lane.size] - 1
    return lane[starts], 0.5 * (left[starts] + right[ends])


def _table(lane: Array, found: Array, results: int, refused: Array, instead: float) -> Array:
    """What was found in each lane in ascending order, then +inf, (results, lanes); `instead` where refused or too many."""
    lanes = refused.size
    order = np.lexsort((found, lane))
    lane, found = lane[order], found[order]
    count = np.bincount(lane, minlength=lanes)
    rank = np.arange(lane.size) - (np.cumsum(count) - count)[lane]
    table = np.full((results, lanes), np.inf)
    table[rank[rank < results], lane[rank < results]] = found[rank < results]
    table[:, refused | (count > results)] = instead
    return table


def _evaluated(
    run: Run,
    block: Block,
    width: int,
    results: int,
    lane: Array,
    at: Sequence[Array],
    given: Sequence[Array],
) -> Array:
    """The results of a block, (results, places), at places in lanes; `given` has a value a lane."""
    found = np.empty((results, lane.size))
    for part in parts(lane.size, run.chunk(width)):
        index = lane[part]
        for row, value in zip(found, block(run, *(a[part] for a in at), *(gather(v, index) for v in given)), strict=True):
            row[part] = value
    return found
