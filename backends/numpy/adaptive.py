"""Adaptive integrals over lanes: Gauss-Legendre with bisection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from teg.backends.numpy.arrays import places_of
from teg.backends.numpy.guard import Guard
from teg.backends.numpy.integrals import Integral
from teg.backends.numpy.lanes import Array, Run, parts, scatter
from teg.backends.numpy.pieces import Pieces
from teg.backends.shared.bends import POWER, Bends
from teg.backends.shared.rules import null_rule_error, overspent, placed, rounding, tolerated, unseen_at_ends
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import ABSOLUTE_FLOOR, DEEP, DIVERGENT, END_INSIDE, MAX_DEPTH, MAX_INTERVALS, ROUNDING, WATCH_WIDTH


def keep_largest(rows: Array, lane: Array, values: Array) -> None:
    """Raise each row, (lanes,), to the largest of its values in each lane; NaN is left out."""
    for i in range(len(rows)):
        np.fmax.at(rows[i], lane, values[i])


def measure(values: Array, nodes: int, smooth: Array | bool = True, ends: Array | None = None) -> tuple[Array, Array, Array]:
    """Returns sum, sum of sizes, and error (see `teg.program`) of the values at Gauss nodes, (nodes, lanes), each (lanes,); where they are
    not known to be `smooth` no decay is counted on. A closed rule has values at the `ends` too, (2, lanes)."""
    weights = np.array(gauss_legendre(nodes)[1])
    total, size = weights @ values, weights @ np.abs(values)
    sums = np.array(null_rules(nodes)) @ values
    error = null_rule_error(np, nodes, sums, size, smooth, ends is not None)
    return total, size, error if ends is None else error + unseen_at_ends(np, nodes, ends, values, sums, size)


@dataclass(slots=True)
class Measured:
    """K of every value, (values, intervals), A and E of those tested, (tested, intervals); where a watched sign changes, and where one
    is 0, (intervals,); sharp values at the nodes, (sharp, nodes, intervals)."""

    total: Array
    size: Array
    error: Array
    changed: Array
    hidden: Array
    seen: Array


class _Intervals(NamedTuple):
    """Intervals (left, left + width) in the coordinate of each `piece`, in (0, 1)."""

    piece: Array
    left: Array
    width: float


@dataclass(frozen=True, slots=True)
class AdaptiveIntegral(Integral):
    """Gauss-Legendre with bisection: at a time, all intervals of one depth, over all pieces.

    Behind the values, `body` returns `watched` signs (an interval on which one changes is halved), and the sharp values of the
    `guard`.
    """

    tol: float = 0.0
    first: int = 10
    order: int = 18
    cubic: bool = False
    closed: bool = False
    floor: float = ABSOLUTE_FLOOR
    watched: int = 0
    guard: Guard | None = None

    @property
    def is_adaptive(self) -> bool:
        return True

    @property
    def is_cubic(self) -> bool:
        return self.cubic

    def _rule(self, pieces: Pieces, bends: Bends) -> Array:
        run, places = pieces.run, pieces.places
        count = places.p.size
        sums = np.zeros((self.results, count))
        piece, left, width = np.arange(count), np.zeros(count), 1.0
        used = np.zeros(count, dtype=np.int64)
        whole = np.empty(0)
        spent = np.zeros((self.tested, count))
        above = np.zeros((self.tested, count))  # the largest A of what an interval came from
        depth, first = 0, not (self.watched or self.closed)
        while True:
            nodes = self.first if first else self.order
            intervals = _Intervals(piece, left, width)
            found = self._measure(pieces, intervals, nodes)
            total, size, error, changed = found.total, found.size, found.error, found.changed
            if not whole.size:
                whole = size if self.guard is None else size.copy()
            if self.guard is not None:
                above = np.fmax(above, size)
                keep_largest(whole, piece, size)
            largest = whole[:, piece] if self.guard is None else above
            used += np.bincount(piece, minlength=count)
            enough = tolerated(np, (self.tol, self.floor), largest, size)
            fine = (error <= enough) | ~np.isfinite(error)
            accepted = np.where(changed, width <= WATCH_WIDTH, fine.all(axis=0))
            if self.guard is not None:
                self._search(pieces, intervals, found, accepted, enough, depth)
            late = run.evaluations + run.searched > run.most
            again = ~accepted & ((used[piece] < MAX_INTERVALS) & (depth < MAX_DEPTH) & (not late))
            missed = ~accepted & ~again
            run.ended |= late and bool(missed.any())
            if missed.any():
                run.missed = True
                if self.guard is not None and (lost := np.flatnonzero(missed & fine.all(axis=0) & ~changed)).size:
                    hidden = self.guard.hidden(pieces.part(piece[lost]), (left[lost], left[lost] + width), self.tested)
                    error[:, lost] = np.fmax(error[:, lost], hidden)
                if depth >= DEEP:
                    endless = missed & ~changed & ~found.hidden & np.isfinite(error) & (size > DIVERGENT * largest)
                    total[: self.tested][endless] = np.copysign(np.inf, total[: self.tested][endless])
            done = np.flatnonzero(~again)
            run.missed |= bool(np.isinf(total[: self.tested, done]).any())
            spent += scatter(np.where(changed, 0.0, error)[:, done], piece[done], count)
            sums[: self.values] += scatter(total[:, done], piece[done], count)
            if self.estimated:
                estimate = error[:, done] + self._rounding(pieces, intervals, done) * size[:, done]
                sums[self.values :] += scatter(estimate, piece[done], count)
            if not again.any():
                run.missed |= bool(overspent(np, (self.tol, self.floor), spent, whole, sums[: self.tested]))
                return sums
            if first:
                piece, left, above, first = piece[again], left[again], above[:, again], False
                continue
            depth += 1
            width *= 0.5
            piece, left, above = np.repeat(piece[again], 2), np.repeat(left[again], 2), np.repeat(above[:, again], 2, axis=1)
            left[1::2] += width

    def _rounding(self, pieces: Pieces, intervals: _Intervals, chosen: Array) -> Array:
        """Returns the effect of rounding on some of the intervals, relative to the integral of |values|, (intervals,)."""
        if not chosen.size:
            return np.empty(0)
        part, left, width = pieces.part(intervals.piece[chosen]).places, intervals.left[chosen], intervals.width
        first, middle, last = places_of(part, np.array([left, left + 0.5 * width, left + width]))[0]
        first, last = np.where(left > 0.0, first, part.p), np.where(left + width < 1.0, last, part.q)
        return np.asarray(np.fmax(rounding(np, part.p, part.q), 0.5 * ROUNDING + placed(np, first, middle, last)))

    def _search(
        self,
        pieces: Pieces,
        intervals: _Intervals,
        found: Measured,
        accepted: Array,
        enough: Array,
        depth: int,
    ) -> None:
        """Take back that intervals are `accepted` in which something is hidden between the nodes."""
        assert self.guard is not None
        at = np.array(gauss_legendre(found.seen.shape[1])[0])
        sure = np.flatnonzero(accepted & ~found.changed & np.isfinite(found.error).all(axis=0))
        for some in parts(sure.size, pieces.run.chunk(self.node_width, at.size)):
            chosen = sure[some]
            left, right = intervals.left[chosen], intervals.left[chosen] + intervals.width
            nodes = left + (0.5 * (right - left)) * (1.0 + at[:, None])
            part = pieces.part(intervals.piece[chosen])
            accepted[chosen] = ~self.guard.hides(part, (left, right), nodes, found.seen[:, :, chosen], enough[:, chosen], depth)

    def _measure(self, pieces: Pieces, intervals: _Intervals, nodes: int) -> Measured:
        """Returns the measurements of intervals at so many `nodes`."""
        run, (piece, left, width) = pieces.run, intervals
        n, tested = piece.size, self.tested
        changed, hidden = np.zeros((2, n), dtype=np.bool_)
        sharp = self.guard.sharp if self.guard is not None else 0
        total, size, error = (np.empty((rows, n)) for rows in (self.values, tested, tested))
        result = Measured(total, size, error, changed, hidden, np.empty((sharp, nodes, n)))
        at, weights = (np.array(column) for column in gauss_legendre(nodes))
        self._count(run, piece.size * (nodes + 2 * (self.watched > 0 or self.closed)))
        for part in parts(piece.size, run.chunk(self.node_width, nodes)):
            here, given = (some := pieces.part(piece[part])).places, some.values
            first, last = some.neighbours
            smooth = (here.kind != POWER) & ~(first & (left[part] == 0.0)) & ~(last & (left[part] + width == 1.0))
            x, rate = places_of(here, left[part] + (0.5 * width) * (1.0 + at[:, None]))
            rate *= 0.5 * width
            found = self.body(run, x, *given)
            at_ends, weighted_ends = self._at_ends(run, some, left[part], width) if self.watched or self.closed else ((), ())
            for i, value in enumerate(found[: self.values]):
                weighted = np.broadcast_to(value * rate, x.shape)
                if i < self.tested:
                    ends = weighted_ends[i] if self.closed else None
                    result.total[i, part], result.size[i, part], result.error[i, part] = measure(weighted, nodes, smooth, ends)
                else:
                    result.total[i, part] = weights @ weighted
            behind = self.values + self.watched
            for row, value in zip(result.seen, found[behind : behind + sharp], strict=True):
                row[:, part] = value
            watched = slice(self.values, behind)
            for inner, outer in zip(found[watched], at_ends[watched], strict=True):
                both = np.concatenate([np.broadcast_to(inner, x.shape), outer])
                changed[part] |= (both > 0.0).any(axis=0) & (both < 0.0).any(axis=0)
                hidden[part] |= (both == 0.0).any(axis=0)
        return result

    def _at_ends(self, run: Run, pieces: Pieces, left: Array, width: float) -> tuple[list[Array], list[Array]]:
        """Returns what the body has at the two ends of intervals, (2, intervals) each, and the tested values there by the rate of the
        coordinate; ties there do not count."""
        aside = Run(run.order, run.room)
        inside = END_INSIDE * width if self.closed else 0.0
        ends, rate = places_of(pieces.places, np.array([left + inside, left + (width - inside)]))
        found = [np.broadcast_to(value, ends.shape) for value in self.body(aside, ends, *pieces.values)]
        run.evaluations += aside.evaluations
        run.searched += aside.searched
        return found, [value * (0.5 * width * rate) for value in found[: self.tested]] if self.closed else []
