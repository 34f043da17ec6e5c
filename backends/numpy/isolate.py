"""Roots isolated between bounds, and sums over them, for printed NumPy programs.

The boxes of one level, of all lanes, are arrays; a level is one call of each block, or a few where that would take
too much memory. Boxes without a root are dropped, so that a level costs what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from teg.backends.numpy.lanes import BOX, Array, Run, Sized, Value, on_lanes, scatter
from teg.backends.shared.roots import Ends, examined, newton_step, touches
from teg.program import BOX_COST, ISOLATE_DEPTH, ISOLATE_STEPS


@dataclass(frozen=True, slots=True)
class Isolation:
    """The roots of a function: interval bisection, then Newton's method.

    `count` is the number of roots there is room for, `tol` and `width` are those of the statement. With `estimated` the errors of the roots
    come behind them.
    """

    enclosure: Sized
    point: Sized
    count: int
    estimated: bool
    tol: float
    width: int

    def __call__(
        self,
        run: Run,
        ends: tuple[Value, Value],
        for_enclosure: tuple[Value, ...],
        for_point: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the roots, of the arguments' common shape, ascending; `for_…`: what the blocks take from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            first = 2 + len(for_enclosure)
            return _Search(self, run, given[2:first], given[first:]).roots(given[0], given[1], lanes)

        given = (*ends, *for_enclosure, *for_point)
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
            monotone, bent, left, blurred = examined(np, bounds, (g, slope), h, Ends(changes, boxes.known, sloped))
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
            v, p, q, size, done = newton_step(np, (g, slope), v, (p, q), above, before)
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
        return self.isolation.point.at(self.run, lane, (v,), self.for_point)

    def _enclosed(self, boxes: _Boxes) -> Array:
        """Returns bounds of g, of its slope and of its curvature, and the noise, (7, boxes)."""
        self.run.searched += BOX_COST * boxes.lane.size
        return self.isolation.enclosure.at(self.run, boxes.lane, (boxes.p, boxes.q), self.for_enclosure)


@dataclass(frozen=True, slots=True)
class PointSum:
    """The sums of the values of a body over points, those that are there."""

    body: Sized

    def __call__(self, run: Run, points: tuple[Value, ...], for_body: tuple[Value, ...], when: Value = True) -> tuple[Value, ...]:
        """Returns the sums, of the arguments' common shape; `for_body` are the values that the body takes from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            at = np.array([np.broadcast_to(v, (lanes,)) for v in given[: len(points)]]).reshape((-1, lanes))
            unknown = np.isnan(at).any(axis=0)
            there = np.flatnonzero(np.isfinite(at) & ~unknown)
            lane = there % lanes
            values = self.body.at(run, lane, (at.reshape(-1)[there],), given[len(points) :])
            sums = scatter(values, lane, lanes).reshape((results, lanes))
            sums[:, unknown] = np.nan
            return sums

        given, results = (*points, *for_body), self.body.results
        step = run.chunk(len(given) + (2 + results) * len(points), max(1, len(points)))
        return on_lanes(work, given, when, results, 0.0, step)


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
