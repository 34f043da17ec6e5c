"""What the printed NumPy programs call, as `rt`: powers, ties, and integrals over lanes.

A value of a program is an array with one entry a lane, or a scalar (0-d) where no lane differs. In the
outermost block the lanes are the batch, shape (L,). An integral flattens the lanes of the block it stands in,
expands each into its pieces, shape (P,), runs `flags` there, and then `body` at the nodes of each piece,
shape (Q, P): Q nodes in rows. A value from outside has shape () or (P,) and broadcasts, so a leaf integral
copies nothing to its nodes. Lanes that need no work are compressed away: where `when` is false, thin pieces,
pieces that `need` refuses, intervals that have converged.

Whatever is wide is cut into chunks: no block holds more than about `Run.room` doubles at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrays import NUMPY, places_of
from teg.backends.numpy.guard import Guard
from teg.backends.shared import error_function, rules
from teg.backends.shared.bends import POWER, Bend, Substitution, inside, substitution
from teg.backends.shared.rules import null_rule_error, rounding, tolerated
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import DEEP, DIVERGENT, INSIDE, MAX_DEPTH, MAX_INTERVALS, ROUNDING, SPENT, WATCH_WIDTH

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

    def add(self, other: Run) -> None:
        """Note what another run of the program noted, but for its ties."""
        self.missed |= other.missed
        self.crowded |= other.crowded
        self.evaluations += other.evaluations
        self.searched += other.searched
        self.ended |= other.ended

    def chunk(self, width: int, lanes: int = 1) -> int:
        """Returns the number of items, of `lanes` lanes of `width` doubles each, on which a block may run at a time."""
        return max(1, min(self.room // max(1, width), MAX_LANES) // lanes)


def powi(x: Value, n: int) -> Value:
    """Returns x to an integer power."""
    return rules.powi(np, x, n)


def erf(x: Value) -> Value:
    """Returns the error function."""
    return error_function.erf(NUMPY, x)


def erfc(x: Value) -> Value:
    """Returns 1 - erf(x)."""
    return error_function.erfc(NUMPY, x)


def tie(run: Run, g: Value, scale: Value, r: Value, k: int) -> Value:
    """Returns whether g > 0; where g vanishes to rounding, the order of the run decides."""
    near = rules.ties(np, g, scale)
    if not near.any():
        return g > 0.0
    run.met.add(k)
    return rules.resolved(np, near, g, r, run.order)


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


def keep_largest(rows: Array, lane: Array, values: Array) -> None:
    """Raise each row, (lanes,), to the largest of its values in each lane; NaN is left out."""
    for i in range(len(rows)):
        np.fmax.at(rows[i], lane, values[i])


@dataclass(frozen=True, slots=True)
class Integral:
    """An integral without its rule: lanes into pieces, and the sums of the pieces back into lanes.

    `flags` and `body` are printed blocks, `values` the number of values, `piece_width` and `node_width` the doubles that a piece and a
    node take. The first `tested` values count for the error, and have estimates if these are `estimated`. `bends` are the kinds of the
    bends; `flags` returns the need, when each bend counts, and what `body` takes; it asks for the `ends` of a piece too, or does not.
    `leaf`: there is no integral inside.
    """

    flags: Block | None
    body: Block
    values: int
    tested: int
    estimated: bool
    piece_width: int
    node_width: int
    leaf: bool
    infinite: bool = False
    bends: tuple[str, ...] = ()
    ends: bool = False

    @property
    def results(self) -> int:
        """Returns the number of results: one a value, and the estimates."""
        return self.values + (self.tested if self.estimated else 0)

    def __call__(
        self,
        run: Run,
        lo: Value,
        hi: Value,
        breaks: tuple[Value, ...],
        bends: tuple[Value, ...],
        for_flags: tuple[Value, ...],
        for_body: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape; `bends`: base, scale, coefficients; `for_…`: what blocks take from
        outside."""
        counts = (len(breaks), len(bends), len(for_flags))

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given, counts, lanes)

        step = run.chunk(self.piece_width, len(breaks) + 1)
        return on_lanes(work, (lo, hi, *breaks, *bends, *for_flags, *for_body), when, self.results, 0.0, step)

    def _lanes(self, run: Run, given: Sequence[Array], counts: tuple[int, int, int], lanes: int) -> Array:
        """Returns the results on flat lanes, (results, lanes); `given`: lo, hi, breaks, of bends, for flags, for body."""
        lo, hi = given[0], given[1]
        first = 2 + counts[0]
        points = np.empty((counts[0] + 2, lanes))
        for row, values in zip(points, rules.ends_of_pieces(np, lo, hi, given[2:first]), strict=True):
            row[:] = values
        if counts[0] > 1:
            points[1:-1].sort(axis=0)
        p, q = points[:-1].reshape(-1), points[1:].reshape(-1)
        not_a_bound = np.isnan if self.infinite else _not_finite
        broken = np.broadcast_to(not_a_bound(lo) | not_a_bound(hi), (lanes,))
        kept = np.flatnonzero(rules.is_wide(np, p, q) & ~np.tile(broken, counts[0] + 1))
        second, third = first + counts[1], first + counts[1] + counts[2]
        sums = self._pieces(run, p[kept], q[kept], kept % lanes, lanes, given[first:second], given[second:third], given[third:])
        sums[: self.values] *= np.where(lo <= hi, 1.0, -1.0)
        sums[:, broken] = np.nan
        return sums

    def _pieces(
        self,
        run: Run,
        p: Array,
        q: Array,
        lane: Array,
        lanes: int,
        of_bends: Sequence[Array],
        for_flags: Sequence[Array],
        for_body: Sequence[Array],
    ) -> Array:
        """Returns the sums over the pieces (p, q) of each lane, (results, lanes)."""
        flagged: list[Value] = []
        base, scale, *coefficients = (gather(v, lane) for v in of_bends) if of_bends else (0.0, 1.0)
        if self.flags is not None and p.size:
            ends = (p, q) if self.ends else ()
            need, *flagged = self.flags(run, inside(np, p, q, INSIDE, self.infinite, scale), *ends, *(gather(v, lane) for v in for_flags))
            if not np.all(need):
                kept = np.flatnonzero(np.broadcast_to(need, p.shape))
                p, q, lane, base, scale, *coefficients = (gather(v, kept) for v in (p, q, lane, base, scale, *coefficients))
                flagged = [gather(v, kept) for v in flagged]
        if not p.size:
            return np.zeros((self.results, lanes))
        active, flagged = flagged[: len(self.bends)], flagged[len(self.bends) :]
        values = [*(gather(v, lane) for v in for_body), *flagged]
        bends = [(kind, *coefficients[3 * i : 3 * i + 3], active[i]) for i, kind in enumerate(self.bends)]
        return scatter(self._rule(run, self._places(p, q, base, bends, scale), (base, bends), values), lane, lanes)

    @property
    def is_cubic(self) -> bool:
        """Whether pieces without a bend have the substitution with flat ends."""
        return False

    def _places(self, p: Array, q: Array, base: Value, bends: Sequence[Bend], scale: Value) -> Substitution:
        return substitution(NUMPY, p, q, base, bends, self.is_cubic, not np.isfinite(q - p).all(), scale)

    def _rule(self, run: Run, places: Substitution, bends: tuple[Value, Sequence[Bend]], values: Sequence[Value]) -> Array:
        """Returns the integrals over the pieces, and the estimates of their errors, (results, pieces)."""
        raise NotImplementedError

    def _count(self, run: Run, points: int) -> None:
        if self.leaf:
            run.evaluations += points


@dataclass(frozen=True, slots=True)
class GaussIntegral(Integral):
    """Gauss-Legendre on each piece."""

    nodes: int = 1

    def _rule(self, run: Run, places: Substitution, _: tuple[Value, Sequence[Bend]], values: Sequence[Value]) -> Array:
        nodes, weights = (np.array(column) for column in gauss_legendre(self.nodes))
        p, q = places.p, places.q
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        sums = np.empty((self.results, p.size))
        self._count(run, p.size * self.nodes)
        for part in parts(p.size, run.chunk(self.node_width, self.nodes)):
            x = middle[part] + half[part] * nodes[:, None]
            found = self.body(run, x, *(cut(v, part) for v in values))
            for total, value in zip(sums, found, strict=False):
                total[part] = weights @ value if np.ndim(value) == 2 else 2.0 * value
            if self.estimated:
                for total, value in zip(sums[self.values :], found, strict=False):
                    total[part] = rounding(np, p[part], q[part]) * (weights @ np.abs(np.broadcast_to(value, x.shape)))
        sums *= half
        return sums


def _not_finite(x: Array) -> Array:
    return ~np.isfinite(x)


def measure(values: Array, nodes: int, smooth: Array | bool = True) -> tuple[Array, Array, Array]:
    """Returns sum, sum of sizes, and error (see `teg.program`) of the values at Gauss nodes, (nodes, lanes), each (lanes,); where they are
    not known to be `smooth` no decay is counted on."""
    weights = np.array(gauss_legendre(nodes)[1])
    total, size = weights @ values, weights @ np.abs(values)
    return total, size, null_rule_error(np, nodes, np.array(null_rules(nodes)) @ values, size, smooth)


@dataclass(frozen=True, slots=True)
class MidpointIntegral(Integral):
    """The composite midpoint rule on each piece."""

    nodes: int = 1

    def _rule(self, run: Run, places: Substitution, _: tuple[Value, Sequence[Bend]], values: Sequence[Value]) -> Array:
        p, q = places.p, places.q
        sums = np.zeros((self.results, p.size))
        self._count(run, p.size * self.nodes)
        for part in parts(p.size, run.chunk(self.node_width, self.nodes)):
            given = [cut(v, part) for v in values]
            last: Value = None
            for few in parts(self.nodes, run.chunk(self.node_width, p[part].size)):
                u = (np.arange(few.start, min(few.stop, self.nodes)) + 0.5) / self.nodes
                x = p[part] + (q[part] - p[part]) * u[:, None]
                found = np.stack([np.broadcast_to(v, x.shape) for v in self.body(run, x, *given)])
                sums[: self.values, part] += found.sum(axis=1)
                if self.estimated:
                    tested = found[: self.tested]
                    steps = np.abs(np.diff(tested if last is None else np.concatenate([last, tested], axis=1), axis=1))
                    last = tested[:, -1:]
                    sums[self.values :, part] += 0.5 * steps.sum(axis=1) + 0.5 * ROUNDING * np.abs(tested).sum(axis=1)
        sums *= (q - p) / self.nodes
        return sums


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
    watched: int = 0
    guard: Guard | None = None

    @property
    def is_cubic(self) -> bool:
        return self.cubic

    def _rule(self, run: Run, places: Substitution, _: tuple[Value, Sequence[Bend]], values: Sequence[Value]) -> Array:
        pieces = places.p.size
        sums = np.zeros((self.results, pieces))
        piece, left, width = np.arange(pieces), np.zeros(pieces), 1.0
        used = np.zeros(pieces, dtype=np.int64)
        whole = np.empty(0)
        spent = np.zeros((self.tested, pieces))
        above = np.zeros((self.tested, pieces))  # the largest A of what an interval came from
        depth, first = 0, not self.watched
        while True:
            nodes = self.first if first else self.order
            found = self._measure(run, places, values, piece, left, width, nodes)
            total, size, error, changed = found.total, found.size, found.error, found.changed
            if not whole.size:
                whole = size if self.guard is None else size.copy()
            if self.guard is not None:
                above = np.fmax(above, size)
                keep_largest(whole, piece, size)
            largest = whole[:, piece] if self.guard is None else above
            used += np.bincount(piece, minlength=pieces)
            enough = tolerated(np, self.tol, largest, size)
            fine = (error <= enough) | ~np.isfinite(error)
            accepted = np.where(changed, width <= WATCH_WIDTH, fine.all(axis=0))
            if self.guard is not None:
                self._search(run, places, values, piece, (left, left + width), found, accepted, enough, depth)
            late = run.evaluations + run.searched > run.most
            again = ~accepted & ((used[piece] < MAX_INTERVALS) & (depth < MAX_DEPTH) & (not late))
            missed = ~accepted & ~again
            run.ended |= late and bool(missed.any())
            if missed.any():
                run.missed = True
                if depth >= DEEP:
                    endless = missed & ~changed & ~found.hidden & np.isfinite(error) & (size > DIVERGENT * largest)
                    total[: self.tested][endless] = np.copysign(np.inf, total[: self.tested][endless])
            done = np.flatnonzero(~again)
            run.missed |= bool(np.isinf(total[: self.tested, done]).any())
            spent += scatter(np.where(changed, 0.0, error)[:, done], piece[done], pieces)
            sums[: self.values] += scatter(total[:, done], piece[done], pieces)
            if self.estimated:
                estimate = error[:, done] + rounding(np, places.p, places.q)[piece[done]] * size[:, done]
                sums[self.values :] += scatter(estimate, piece[done], pieces)
            if not again.any():
                run.missed |= bool((spent > SPENT * tolerated(np, self.tol, whole, whole)).any())
                return sums
            if first:
                piece, left, above, first = piece[again], left[again], above[:, again], False
                continue
            depth += 1
            width *= 0.5
            piece, left, above = np.repeat(piece[again], 2), np.repeat(left[again], 2), np.repeat(above[:, again], 2, axis=1)
            left[1::2] += width

    def _search(
        self,
        run: Run,
        places: Substitution,
        values: Sequence[Value],
        piece: Array,
        ends: tuple[Array, Array],
        found: Measured,
        accepted: Array,
        enough: Array,
        depth: int,
    ) -> None:
        """Take back that intervals are `accepted` in which something is hidden between the nodes."""
        assert self.guard is not None
        at = np.array(gauss_legendre(found.seen.shape[1])[0])
        sure = np.flatnonzero(accepted & ~found.changed & np.isfinite(found.error).all(axis=0))
        for some in parts(sure.size, run.chunk(self.node_width, at.size)):
            chosen = sure[some]
            left, right = (e[chosen] for e in ends)
            nodes = left + (0.5 * (right - left)) * (1.0 + at[:, None])
            given = [gather(v, piece[chosen]) for v in values]
            part = places.part(piece[chosen])
            accepted[chosen] = ~self.guard.hides(run, part, given, (left, right), nodes, found.seen[:, :, chosen], enough[:, chosen], depth)

    def _measure(
        self,
        run: Run,
        places: Substitution,
        values: Sequence[Value],
        piece: Array,
        left: Array,
        width: float,
        nodes: int,
    ) -> Measured:
        """Returns the measurements of the intervals (left, left + width) of each `piece`."""
        n, tested = piece.size, self.tested
        changed, hidden = np.zeros((2, n), dtype=np.bool_)
        sharp = self.guard.sharp if self.guard is not None else 0
        total, size, error = (np.empty((rows, n)) for rows in (self.values, tested, tested))
        result = Measured(total, size, error, changed, hidden, np.empty((sharp, nodes, n)))
        at, weights = (np.array(column) for column in gauss_legendre(nodes))
        self._count(run, piece.size * (nodes + 2 * (self.watched > 0)))
        for part in parts(piece.size, run.chunk(self.node_width, nodes)):
            index = piece[part]
            given = [gather(v, index) for v in values]
            here = places.part(index)
            x, rate = places_of(here, left[part] + (0.5 * width) * (1.0 + at[:, None]))
            rate *= 0.5 * width
            found = self.body(run, x, *given)
            for i, value in enumerate(found[: self.values]):
                weighted = np.broadcast_to(value * rate, x.shape)
                if i < self.tested:
                    result.total[i, part], result.size[i, part], result.error[i, part] = measure(weighted, nodes, here.kind != POWER)
                else:
                    result.total[i, part] = weights @ weighted
            behind = self.values + self.watched
            for row, value in zip(result.seen, found[behind : behind + sharp], strict=True):
                row[:, part] = value
            if self.watched:
                aside = Run(run.order, run.room)  # ties at the ends do not count
                ends = places_of(here, np.array([left[part], left[part] + width]))[0]
                at_ends = self.body(aside, ends, *given)
                run.evaluations += aside.evaluations
                run.searched += aside.searched
                watched = slice(self.values, behind)
                for inner, outer in zip(found[watched], at_ends[watched], strict=True):
                    both = np.concatenate([np.broadcast_to(inner, x.shape), np.broadcast_to(outer, ends.shape)])
                    changed[part] |= (both > 0.0).any(axis=0) & (both < 0.0).any(axis=0)
                    hidden[part] |= (both == 0.0).any(axis=0)
        return result
