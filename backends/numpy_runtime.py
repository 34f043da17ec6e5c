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

from teg.program import ABSOLUTE_FLOOR, INSIDE, MAX_DEPTH, MAX_INTERVALS, PIECE_EPS, ROUNDING, TIE_EPS, WATCH_WIDTH
from teg.quadrature import GAUSS_WEIGHTS, KRONROD_NODES, KRONROD_WEIGHTS, gauss_legendre

Array = npt.NDArray[Any]
Value = Any  # an Array of lanes, or a scalar: numpy.float64, numpy.bool_, float, bool
Block = Callable[..., tuple[Value, ...]]  # (run, variable, *values from outside) -> values

MAX_LANES = 2**15
"""No block runs on more lanes than this at a time: longer arrays only fall out of the cache."""
NODES, WEIGHTS, WEIGHTS_10 = np.array(KRONROD_NODES)[:, None], np.array(KRONROD_WEIGHTS), np.array(GAUSS_WEIGHTS)
"""The Gauss-Kronrod pair: nodes, weights of all 21, weights of the 10 that are Gauss nodes."""


@dataclass(slots=True)
class Run:
    """One run of a program: how ties are decided, the doubles a block may hold, and the ties met so far."""

    order: int
    room: int
    met: set[int] = field(default_factory=set)

    def chunk(self, width: int, lanes: int = 1) -> int:
        """How many items, of `lanes` lanes of `width` doubles each, a block may run on at a time."""
        return max(1, min(self.room // max(1, width), MAX_LANES) // lanes)


def powi(x: Value, n: int) -> Value:
    """x to an integer power, by squaring; 1/powi(x, -n) where n is negative."""
    if n < 0:
        return 1.0 / powi(x, -n)
    power: Value = np.float64(1.0)
    while n:
        if n & 1:
            power = power * x
        n >>= 1
        if n:
            x = x * x
    return power


def tie(run: Run, g: Value, scale: Value, r: Value, k: int) -> Value:
    """g > 0, but where g vanishes to rounding the order of the run decides."""
    near = (np.abs(g) <= TIE_EPS * scale) & np.isfinite(g)
    if not near.any():
        return g > 0.0
    run.met.add(k)
    return np.where(near, r if run.order > 0 else np.logical_not(r), g > 0.0)


def gather(value: Value, index: Array | None) -> Value:
    """The lanes `index` of a value; a scalar, or all lanes, as they are."""
    return value if index is None or not np.ndim(value) else value[index]


def cut(value: Value, part: slice) -> Value:
    """A run of lanes of a value; a scalar as it is."""
    return value[part] if np.ndim(value) else value


def parts(size: int, step: int) -> Iterator[slice]:
    """Slices of at most `step` that cover range(size)."""
    return (slice(start, start + step) for start in range(0, size, step))


def scatter(values: Array, lane: Array, lanes: int) -> Array:
    """Each row of `values` summed into its lanes, (rows, lanes)."""
    return np.array([np.bincount(lane, weights=row, minlength=lanes) for row in values], dtype=np.float64)


def on_lanes(
    work: Callable[[Sequence[Array], int], Array],
    given: Sequence[Value],
    when: Value,
    results: int,
    absent: float,
    step: int,
) -> tuple[Value, ...]:
    """What `work` makes of the lanes of `given`, `results` values of the common shape; `absent` where `when` is false.

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


@dataclass(frozen=True, slots=True)
class Integral:
    """An integral without its rule: lanes into pieces, and the sums of the pieces back into lanes.

    `flags` and `body` are printed blocks, `results` the number of values, `piece_width` and `node_width` the
    doubles that a piece and a node take.
    """

    flags: Block | None
    body: Block
    results: int
    piece_width: int
    node_width: int

    def __call__(
        self,
        run: Run,
        lo: Value,
        hi: Value,
        breaks: tuple[Value, ...],
        for_flags: tuple[Value, ...],
        for_body: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """The results, of the arguments' common shape; `for_…` are what the blocks take from outside."""

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given, len(breaks), len(for_flags), lanes)

        step = run.chunk(self.piece_width, len(breaks) + 1)
        return on_lanes(work, (lo, hi, *breaks, *for_flags, *for_body), when, self.results, 0.0, step)

    def _lanes(self, run: Run, given: Sequence[Array], breaks: int, flags: int, lanes: int) -> Array:
        """The results on flat lanes, (results, lanes); `given`: lo, hi, breaks, for flags, for body."""
        lo, hi = given[0], given[1]
        first, low, high = 2 + breaks, np.minimum(lo, hi), np.maximum(lo, hi)
        points = np.empty((breaks + 2, lanes))
        points[0], points[-1] = low, high
        for i in range(2, first):
            points[i - 1] = np.minimum(np.fmax(given[i], low), high)  # fmax: a break that is NaN is put at low
        if breaks > 1:
            points[1:-1].sort(axis=0)
        p, q = points[:-1].reshape(-1), points[1:].reshape(-1)
        kept = np.flatnonzero(q - p > PIECE_EPS * np.maximum(np.abs(p), np.abs(q)))
        sums = self._pieces(run, p[kept], q[kept], kept % lanes, lanes, given[first : first + flags], given[first + flags :])
        sums *= np.where(lo <= hi, 1.0, -1.0)
        sums[:, np.broadcast_to(np.isnan(lo) | np.isnan(hi), (lanes,))] = np.nan
        return sums

    def _pieces(
        self,
        run: Run,
        p: Array,
        q: Array,
        lane: Array,
        lanes: int,
        for_flags: Sequence[Array],
        for_body: Sequence[Array],
    ) -> Array:
        """The sums over the pieces (p, q) of each lane, (results, lanes)."""
        flagged: list[Value] = []
        if self.flags is not None and p.size:
            need, *flagged = self.flags(run, p + INSIDE * (q - p), *(gather(v, lane) for v in for_flags))
            if not np.all(need):
                kept = np.flatnonzero(np.broadcast_to(need, p.shape))
                p, q, lane, *flagged = (gather(v, kept) for v in (p, q, lane, *flagged))
        if not p.size:
            return np.zeros((self.results, lanes))
        values = [*(gather(v, lane) for v in for_body), *flagged]
        return scatter(self._rule(run, p, q, values), lane, lanes)

    def _rule(self, run: Run, p: Array, q: Array, values: Sequence[Value]) -> Array:
        """The integrals over the pieces (p, q), (results, pieces)."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class GaussIntegral(Integral):
    """Gauss-Legendre on each piece."""

    nodes: int

    def _rule(self, run: Run, p: Array, q: Array, values: Sequence[Value]) -> Array:
        nodes, weights = (np.array(column) for column in gauss_legendre(self.nodes))
        middle, half = 0.5 * (p + q), 0.5 * (q - p)
        sums = np.empty((self.results, p.size))
        for part in parts(p.size, run.chunk(self.node_width, self.nodes)):
            x = middle[part] + half[part] * nodes[:, None]
            for total, value in zip(sums, self.body(run, x, *(cut(v, part) for v in values)), strict=True):
                total[part] = weights @ value if np.ndim(value) == 2 else 2.0 * value
        sums *= half
        return sums


@dataclass(frozen=True, slots=True)
class AdaptiveIntegral(Integral):
    """Gauss-Kronrod (10, 21) with bisection: at a time, all intervals of one depth, over all pieces.

    The last `watched` results of `body` are conditions: an interval on which one changes is halved.
    """

    tol: float
    smooth: bool
    watched: int = 0

    def _rule(self, run: Run, p: Array, q: Array, values: Sequence[Value]) -> Array:
        sums = np.zeros((self.results, p.size))
        piece, left, width = np.arange(p.size), np.zeros(p.size), 1.0
        used = np.zeros(p.size, dtype=np.int64)
        enough = np.empty(0)
        for depth in range(MAX_DEPTH + 1):
            kronrod, gap, size, changed = self._measure(run, p, q, values, piece, left, width)
            if depth == 0:
                enough = self.tol * (size + ABSOLUTE_FLOOR)
            used += np.bincount(piece, minlength=p.size)
            fine = (gap <= np.maximum(enough[:, piece], ROUNDING * size)) | ~np.isfinite(gap)
            accepted = np.where(changed, width <= WATCH_WIDTH, fine.all(axis=0))
            halve = ~accepted & (used[piece] < MAX_INTERVALS) & (depth < MAX_DEPTH)
            sums += scatter(kronrod[:, ~halve], piece[~halve], p.size)
            if not halve.any():
                break
            width *= 0.5
            piece, left = np.repeat(piece[halve], 2), np.repeat(left[halve], 2)
            left[1::2] += width
        return sums

    def _measure(
        self,
        run: Run,
        p: Array,
        q: Array,
        values: Sequence[Value],
        piece: Array,
        left: Array,
        width: float,
    ) -> tuple[Array, Array, Array, Array]:
        """K, |K - G| and A on the intervals (left, left + width) of each `piece`, (results, intervals), and where a watched
        condition changes, (intervals,)."""
        kronrod, gap, size = np.empty((3, self.results, piece.size))
        changed = np.zeros(piece.size, dtype=np.bool_)
        for part in parts(piece.size, run.chunk(self.node_width, NODES.size)):
            index = piece[part]
            length = q[index] - p[index]
            given = [gather(v, index) for v in values]
            u = left[part] + (0.5 * width) * (1.0 + NODES)
            x = p[index] + length * self._place(u)
            weight = 0.5 * width * length * (6.0 * u * (1.0 - u) if self.smooth else 1.0)
            found = self.body(run, x, *given)
            for i, value in enumerate(found[: self.results]):
                weighted = np.broadcast_to(value * weight, x.shape)
                kronrod[i, part] = WEIGHTS @ weighted
                gap[i, part] = np.abs(kronrod[i, part] - WEIGHTS_10 @ weighted[1::2])
                size[i, part] = WEIGHTS @ np.abs(weighted)
            if self.watched:
                aside = Run(run.order, run.room)  # ties at the ends do not count
                ends = p[index] + length * self._place(np.array([left[part], left[part] + width]))
                at_ends = self.body(aside, ends, *given)
                for inner, outer in zip(found[self.results :], at_ends[self.results :], strict=True):
                    both = np.concatenate([np.broadcast_to(inner, x.shape), np.broadcast_to(outer, ends.shape)])
                    changed[part] |= both.any(axis=0) & ~both.all(axis=0)
        return kronrod, gap, size, changed

    def _place(self, u: Array) -> Array:
        """Where on a piece, as a part of its length, the coordinate u is."""
        return u * u * (3.0 - 2.0 * u) if self.smooth else u
