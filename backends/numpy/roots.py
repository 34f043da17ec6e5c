"""What the printed NumPy programs call, as `roots`: roots isolated between bounds, sums over them, common zeros located.

The boxes of one level, of all lanes, are arrays; a level is one call of each block, or a few where that would take
too much memory. Boxes without a root are dropped, so that a level costs what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from teg.backends.numpy.runtime import Array, Block, Run, Value, gather, on_lanes, parts, scatter
from teg.backends.shared.roots import Halving, examined, excluded, newton_step, next_halving, plane_step, refuted, touches
from teg.program import (
    BOX_COST,
    ISOLATE_DEPTH,
    ISOLATE_STEPS,
    LOCATE_HALVINGS,
    LOCATE_LOST,
    LOCATE_MOST,
    LOCATE_NARROW,
    LOCATE_SAME,
    LOCATE_STEPS,
    LOCATE_WIDTH,
    LOCATE_ZEROS,
)

BOX = 20
"""Doubles that a box takes while its level is examined."""


@dataclass(frozen=True, slots=True)
class Isolation:
    """The roots of a function: interval bisection, then Newton's method.

    `enclosure` and `point` are printed blocks, `count` the number of roots there is room for, `tol` and `width` those of the statement;
    the other widths are the doubles that a lane of each block takes. With `estimated` the errors of the roots come behind them.
    """

    enclosure: Block
    point: Block
    count: int
    estimated: bool
    tol: float
    width: int
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
        """Returns the roots, of the arguments' common shape, ascending; `for_…` are what the blocks take from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            first = 2 + len(for_enclosure)
            return _Search(self, run, given[2:first], given[first:]).roots(given[0], given[1], lanes)

        given = (lo, hi, *for_enclosure, *for_point)
        found = on_lanes(work, given, when, 2 * self.count, np.inf, run.chunk(len(given) + BOX * self.width))
        return found if self.estimated else found[: self.count]


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Boxes (p, q) in lanes, in ascending order, with g and its slope at both ends."""

    lane: Array
    p: Array
    q: Array
    at_p: Array
    at_q: Array
    slope_p: Array
    slope_q: Array

    def __getitem__(self, index: Array | slice) -> _Boxes:
        return _Boxes(*(column[index] for column in self.columns))

    @property
    def columns(self) -> tuple[Array, ...]:
        return self.lane, self.p, self.q, self.at_p, self.at_q, self.slope_p, self.slope_q

    @property
    def changes(self) -> Array:
        """Returns for each box whether g changes its sign."""
        changes: Array = ((self.at_p <= 0.0) & (self.at_q > 0.0)) | ((self.at_q <= 0.0) & (self.at_p > 0.0))
        return changes

    @property
    def known(self) -> Array:
        """Returns for each box whether g is a number at both ends."""
        known: Array = ~(np.isnan(self.at_p) | np.isnan(self.at_q))
        return known

    @property
    def turns(self) -> Array:
        """Returns for each box whether the slope changes its sign."""
        turns: Array = (self.slope_p > 0.0) != (self.slope_q > 0.0)
        return turns & ~(np.isnan(self.slope_p) | np.isnan(self.slope_q))

    def halved(self, m: Array, at_m: Array, slope_m: Array) -> _Boxes:
        """Returns the halves, in order; a box whose middle m is rounded to one of its ends stays whole."""
        apart = (self.p < m) & (m < self.q)
        times = np.where(apart, 2, 1)
        left = (np.cumsum(times) - times)[apart]
        halves = self[np.repeat(np.arange(m.size), times)]
        halves.q[left] = halves.p[left + 1] = m[apart]
        halves.at_q[left] = halves.at_p[left + 1] = at_m[apart]
        halves.slope_q[left] = halves.slope_p[left + 1] = slope_m[apart]
        return halves

    def joined(self) -> _Boxes:
        """Returns boxes that share an end as one."""
        first = self[np.lexsort((self.p, self.lane))]
        starts = np.flatnonzero(np.r_[True, (first.lane[1:] != first.lane[:-1]) | (first.p[1:] != first.q[:-1])])
        last = first[np.r_[starts[1:], first.lane.size] - 1]
        first = first[starts]
        return _Boxes(first.lane, first.p, last.q, first.at_p, last.at_q, first.slope_p, last.slope_q)


@dataclass(frozen=True, slots=True)
class _Search:
    """One search for roots on flat lanes, with the values that the blocks take from outside."""

    isolation: Isolation
    run: Run
    for_enclosure: Sequence[Array]
    for_point: Sequence[Array]

    def roots(self, lo: Array, hi: Array, lanes: int) -> Array:
        """Returns the roots in (lo, hi) and then their errors, (2·count, lanes)."""
        lo, hi = (np.broadcast_to(v, (lanes,)) for v in (lo, hi))
        finite = np.isfinite(lo) & np.isfinite(hi)
        lane = np.flatnonzero(finite & (lo != hi))
        p, q = np.minimum(lo, hi)[lane], np.maximum(lo, hi)[lane]
        at_p, at_q = self._at(lane, p), self._at(lane, q)
        whole = _Boxes(lane, p, q, at_p[0], at_q[0], at_p[1], at_q[1])
        crossing, turning, undecided, crowded = self._boxes(whole, lanes)
        once, twice = self._turned(turning)
        found = [self._crossings(crossing), self._crossings(once), twice, self._tangencies(undecided)]
        lane, root, error = (np.concatenate([f[i] for f in found]) for i in range(3))
        count = self.isolation.count
        crowded |= np.bincount(lane, minlength=lanes) > count
        kept = ~crowded[lane]
        self.run.crowded |= bool(crowded.any())
        self.run.missed |= bool((error > self.isolation.tol * np.abs(hi - lo)[lane])[kept].any())
        return _table(lane, (root, error), count, ~finite | crowded, np.nan)

    def _boxes(self, boxes: _Boxes, lanes: int) -> tuple[_Boxes, _Boxes, _Boxes, Array]:
        """Returns the boxes with one root, at which g changes its sign; those that turn, and may have two; the undecided ones; and the
        lanes with too many boxes on a level."""
        crowded = np.zeros(lanes, dtype=np.bool_)
        crossing, turning, lost = [boxes[:0]], [boxes[:0]], [boxes[:0]]
        for level in range(ISOLATE_DEPTH + 1):
            crowded |= np.bincount(boxes.lane, minlength=lanes) > self.isolation.width
            boxes = boxes[~crowded[boxes.lane]]
            if not boxes.lane.size:
                break
            m, h = 0.5 * (boxes.p + boxes.q), 0.5 * (boxes.q - boxes.p)
            bounds = self._enclosed(boxes)
            g, slope, _ = self._at(boxes.lane, m)
            changes, sloped = boxes.changes, ~(np.isnan(boxes.slope_p) | np.isnan(boxes.slope_q))
            monotone, bent, left, blurred = examined(np, bounds, g, slope, h, changes, boxes.known, sloped)
            crossing.append(boxes[(monotone | bent) & changes])
            turning.append(boxes[bent & ~changes & boxes.turns & ((boxes.at_p > 0.0) == (bounds[4] > 0.0))])
            lost.append(boxes[left if level == ISOLATE_DEPTH else left & blurred])
            left = np.flatnonzero(left & ~blurred)
            boxes = boxes[left].halved(m[left], g[left], slope[left])
        parts = [_Boxes(*map(np.concatenate, zip(*(b.columns for b in each), strict=True))) for each in (crossing, turning, lost)]
        kept = [b[~crowded[b.lane]] for b in parts]
        return kept[0], kept[1], kept[2], crowded

    def _turned(self, boxes: _Boxes) -> tuple[_Boxes, tuple[Array, Array, Array]]:
        """Returns, of boxes in which g turns, those with one root on either side of the turning point; and the tangencies, (lane, root,
        error), each twice."""
        if not boxes.lane.size:
            return boxes, (boxes.lane, boxes.p, boxes.p)
        turn = self._newton(boxes.lane, boxes.p, boxes.q, boxes.slope_q > 0.0, 1)
        g, slope, curvature = self._at(boxes.lane, turn)
        noise = self._enclosed(_Boxes(boxes.lane, turn, turn, g, g, slope, slope))[6]
        touch, error = touches(np, g, curvature, noise)
        two = ~touch & ((g > 0.0) != (boxes.at_p > 0.0))
        lane, p, q, at_p, at_q, slope_p, slope_q = (v[two] for v in boxes.columns)
        t, at_t, at_slope = turn[two], g[two], slope[two]
        halves = (lane, lane), (p, t), (t, q), (at_p, at_t), (at_t, at_q), (slope_p, at_slope), (at_slope, slope_q)
        twice = (np.repeat(v[touch], 2) for v in (boxes.lane, turn, error))
        return _Boxes(*map(np.concatenate, halves)), cast("tuple[Array, Array, Array]", tuple(twice))

    def _crossings(self, boxes: _Boxes) -> tuple[Array, Array, Array]:
        """Returns the roots in boxes in which g changes its sign, (lane, root, error)."""
        root = self._newton(boxes.lane, boxes.p, boxes.q, boxes.at_q > 0.0, 0)
        return boxes.lane, root, np.zeros(root.size)

    def _newton(self, lane: Array, p: Array, q: Array, above: Array, order: int) -> Array:
        """Returns the zeros in (p, q) of g (order 0) or of its slope (order 1), which is > 0 at q where `above` says so: Newton's method,
        kept inside by bisection."""
        v = 0.5 * (p + q)
        where, root = np.arange(v.size), v.copy()
        before = last = np.full(v.size, np.inf)
        for _ in range(ISOLATE_STEPS):
            if not v.size:
                break
            g, slope = self._at(lane, v)[order : order + 2]
            v, p, q, size, done = newton_step(np, g, slope, v, p, q, above, before)
            root[where] = v
            going = np.flatnonzero(~done)
            before, last = last[going], size[going]
            where, lane, above = where[going], lane[going], above[going]
            p, q, v = p[going], q[going], v[going]
        return root

    def _tangencies(self, boxes: _Boxes) -> tuple[Array, Array, Array]:
        """Returns the roots of undecided boxes, (lane, root, error): one where g changes its sign in neighbouring boxes together,
        else two."""
        if not boxes.lane.size:
            return boxes.lane, boxes.p, boxes.p
        boxes = boxes.joined()
        times = np.where(boxes.changes, 1, np.where(boxes.known, 2, 0))
        middle, half = 0.5 * (boxes.p + boxes.q), 0.5 * (boxes.q - boxes.p)
        return np.repeat(boxes.lane, times), np.repeat(middle, times), np.repeat(half, times)

    def _at(self, lane: Array, v: Array) -> Array:
        """Returns g, its slope and its curvature, (3, points), at points v of their lanes."""
        self.run.searched += BOX_COST * lane.size
        return _evaluated(self.run, self.isolation.point, self.isolation.point_width, 3, lane, (v,), self.for_point)

    def _enclosed(self, boxes: _Boxes) -> Array:
        """Returns bounds of g, of its slope and of its curvature, and the noise, (7, boxes)."""
        width, ends = self.isolation.enclosure_width, (boxes.p, boxes.q)
        self.run.searched += BOX_COST * boxes.lane.size
        return _evaluated(self.run, self.isolation.enclosure, width, 7, boxes.lane, ends, self.for_enclosure)


@dataclass(frozen=True, slots=True)
class PointSum:
    """The sums of `results` values of a body over points, those that are there; `width` doubles a point."""

    body: Block
    results: int
    width: int

    def __call__(self, run: Run, points: tuple[Value, ...], for_body: tuple[Value, ...], when: Value = True) -> tuple[Value, ...]:
        """Returns the sums, of the arguments' common shape; `for_body` is what the body takes from outside."""

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

    `enclosure` is a printed block that gives `bounds` numbers, `results` the number of places there is room for, `width` the doubles that a
    lane of the block takes; `counts`: the part of the rectangle that was given up is asked for.
    """

    enclosure: Block
    results: int
    width: int
    bounds: int = 4
    counts: bool = False

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
        """Returns the places, of the arguments' common shape, ascending, then the part that was given up; `for_enclosure` is what the block
        takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            found = _Locating(self, run, given[4:]).places(given[:4], lanes)
            run.missed |= bool((found[-1] > LOCATE_LOST).any())
            return found if self.counts else found[:-1]

        given = (lo, hi, low, high, *for_enclosure)
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
        return _evaluated(self.run, self.location.enclosure, self.location.width, self.location.bounds, lane, sides, self.given)


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


def _table(lane: Array, columns: Sequence[Array], results: int, refused: Array, instead: float) -> Array:
    """Returns a table of (columns·results, lanes): the first column in each lane in ascending order, then +inf; then the other columns in
    the same order, then 0. A lane with more than `results` rows is refused, and holds `instead`."""
    lanes = refused.size
    order = np.lexsort((columns[0], lane))
    lane = lane[order]
    count = np.bincount(lane, minlength=lanes)
    rank = np.arange(lane.size) - (np.cumsum(count) - count)[lane]
    there = rank < results
    table = np.full((len(columns), results, lanes), np.inf)
    table[1:] = 0.0
    for rows, column in zip(table, columns, strict=True):
        rows[rank[there], lane[there]] = column[order][there]
    table[:, :, refused] = instead
    return table.reshape((len(columns) * results, lanes))


def _evaluated(
    run: Run,
    block: Block,
    width: int,
    results: int,
    lane: Array,
    at: Sequence[Array],
    given: Sequence[Array],
) -> Array:
    """Returns the results of a block, (results, places), at places in lanes; `given` has a value a lane."""
    found = np.empty((results, lane.size))
    for part in parts(lane.size, run.chunk(width)):
        index = lane[part]
        for row, value in zip(found, block(run, *(a[part] for a in at), *(gather(v, index) for v in given)), strict=True):
            row[part] = value
    return found
