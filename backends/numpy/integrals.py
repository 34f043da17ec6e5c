"""Integrals over lanes by fixed rules.

An integral flattens the lanes of the block it stands in, expands each into its pieces, shape (P,), runs `flags` there, and then `body` at
the nodes of each piece, shape (Q, P): Q nodes in rows. A value from outside has shape () or (P,) and broadcasts, so a leaf integral copies
nothing to its nodes. Lanes that need no work are compressed away: where `when` is false, thin pieces, pieces that `need` refuses,
intervals that have converged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from teg.backends.numpy.arrays import NUMPY
from teg.backends.numpy.lanes import Array, Block, Run, Value, cut, gather, on_lanes, parts, scatter
from teg.backends.numpy.pieces import Pieces
from teg.backends.shared import rules
from teg.backends.shared.bends import Bends, Substitution, Tail, inside, substitution
from teg.backends.shared.rules import rounding
from teg.numerics.quadrature import gauss_legendre
from teg.program import INSIDE, ROUNDING


class _Outside(NamedTuple):
    """What comes from outside of an integral, a value a lane: base, scale, reach and coefficients of bends, what `flags` and `body`
    take."""

    bends: Sequence[Array]
    for_flags: Sequence[Array]
    for_body: Sequence[Array]


@dataclass(frozen=True, slots=True)
class Integral:
    """An integral without its rule: lanes into pieces, and the sums of the pieces back into lanes.

    `flags` and `body` are printed blocks, `values` the number of values, `piece_width` and `node_width` the doubles that a piece and a
    node take. The first `tested` values count for the error, and have estimates if these are `estimated`. `bends` are the kinds of the
    bends; `flags` returns the need, when each bend counts, and what `body` takes; it asks for the `ends` of a piece too, or does not.
    Tails of an `infinite` integral may be `slow`: they have a reach. `leaf`: there is no integral inside.
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
    slow: bool = False
    bends: tuple[str, ...] = ()
    ends: bool = False

    @property
    def results(self) -> int:
        """Returns the number of results: one a value, and the estimates."""
        return self.values + (self.tested if self.estimated else 0)

    def __call__(
        self,
        run: Run,
        ends: tuple[Value, ...],
        bends: tuple[Value, ...],
        for_flags: tuple[Value, ...],
        for_body: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape; `ends`: the bounds, then breaks; `bends`: base, scale, reach if slow,
        coefficients; `for_…`: what blocks take from outside."""
        first, second = len(ends) + len(bends), len(ends) + len(bends) + len(for_flags)

        def work(given: Sequence[Array], lanes: int) -> Array:
            outside = _Outside(given[len(ends) : first], given[first:second], given[second:])
            return self._lanes(run, given[: len(ends)], outside, lanes)

        step = run.chunk(self.piece_width, len(ends) - 1)
        return on_lanes(work, (*ends, *bends, *for_flags, *for_body), when, self.results, 0.0, step)

    def _lanes(self, run: Run, ends: Sequence[Array], outside: _Outside, lanes: int) -> Array:
        """Returns the results on flat lanes, (results, lanes)."""
        lo, hi, *breaks = ends
        points = np.empty((len(ends), lanes))
        for row, values in zip(points, rules.ends_of_pieces(np, lo, hi, breaks), strict=True):
            row[:] = values
        if len(breaks) > 1:
            points[1:-1].sort(axis=0)
        p, q = points[:-1].reshape(-1), points[1:].reshape(-1)
        not_a_bound = np.isnan if self.infinite else _not_finite
        broken = np.broadcast_to(not_a_bound(lo) | not_a_bound(hi), (lanes,))
        kept = np.flatnonzero(rules.is_wide(np, p, q) & ~np.tile(broken, len(breaks) + 1))
        neighbours: tuple[Value, Value] = (False, False)
        if self.is_adaptive and breaks:
            first, last = rules.neighbours(NUMPY, points, np.array(np.broadcast_arrays(*breaks, points[0])[:-1]))
            neighbours = first.reshape(-1)[kept], last.reshape(-1)[kept]
        sums = self._pieces(run, (p[kept], q[kept], *neighbours), kept % lanes, outside, lanes)
        sums[: self.values] *= np.where(lo <= hi, 1.0, -1.0)
        sums[:, broken] = np.nan
        return sums

    def _pieces(self, run: Run, ends: tuple[Array, Array, Value, Value], lane: Array, outside: _Outside, lanes: int) -> Array:
        """Returns the sums over the pieces of each lane, (results, lanes), from their `ends`, and whether there are neighbours."""
        (p, q, *neighbours), (of_bends, for_flags, for_body) = ends, outside
        flagged: list[Value] = []
        base, *numbers = (gather(v, lane) for v in of_bends) if of_bends else (0.0, 1.0)
        if self.flags is not None and p.size:
            asked = (p, q) if self.ends else ()
            need, *flagged = self.flags(
                run, inside(np, p, q, INSIDE, self.infinite, numbers[0]), *asked, *(gather(v, lane) for v in for_flags)
            )
            if not np.all(need):
                kept = np.flatnonzero(np.broadcast_to(need, p.shape))
                p, q, lane, base, *numbers = (gather(v, kept) for v in (p, q, lane, base, *numbers))
                neighbours = [gather(v, kept) for v in neighbours]
                flagged = [gather(v, kept) for v in flagged]
        if not p.size:
            return np.zeros((self.results, lanes))
        active, flagged = flagged[: len(self.bends)], flagged[len(self.bends) :]
        values = [*(gather(v, lane) for v in for_body), *flagged]
        tail, coefficients = Tail(*numbers[: 1 + self.slow]), numbers[1 + self.slow :]
        bends = Bends(base, [(kind, *coefficients[3 * i : 3 * i + 3], active[i]) for i, kind in enumerate(self.bends)])
        pieces = Pieces(run, self._places(p, q, bends, tail), values, (neighbours[0], neighbours[1]))
        return scatter(self._rule(pieces, bends), lane, lanes)

    @property
    def is_adaptive(self) -> bool:
        """Whether the rule asks for neighbours."""
        return False

    @property
    def is_cubic(self) -> bool:
        """Whether pieces without a bend have the substitution with flat ends."""
        return False

    def _places(self, p: Array, q: Array, bends: Bends, tail: Tail) -> Substitution:
        return substitution(NUMPY, (p, q), bends, self.is_cubic, None if np.isfinite(q - p).all() else tail)

    def _rule(self, pieces: Pieces, bends: Bends) -> Array:
        """Returns the integrals over the pieces, and the estimates of their errors, (results, pieces)."""
        raise NotImplementedError

    def _count(self, run: Run, points: int) -> None:
        if self.leaf:
            run.evaluations += points


@dataclass(frozen=True, slots=True)
class GaussIntegral(Integral):
    """Gauss-Legendre on each piece."""

    nodes: int = 1

    def _rule(self, pieces: Pieces, bends: Bends) -> Array:
        run, places, values = pieces.run, pieces.places, pieces.values
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


@dataclass(frozen=True, slots=True)
class MidpointIntegral(Integral):
    """The composite midpoint rule on each piece."""

    nodes: int = 1

    def _rule(self, pieces: Pieces, bends: Bends) -> Array:
        run, places, values = pieces.run, pieces.places, pieces.values
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
