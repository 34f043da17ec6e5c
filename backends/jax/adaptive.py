"""Adaptive integrals with static shapes, which the printed JAX programs call as `adaptive`.

The integrand stands once in what XLA compiles: all measurements of all intervals are turns of one loop. In a turn as many nodes are
computed as the first look has; an interval after it takes several turns. This module imports JAX: only a compiled kernel imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from teg.backends.jax.arrays import JAX
from teg.backends.jax.guard import Guard
from teg.backends.jax.runtime import MISSED, Note, OnPiece, Pieces, Scalar, integrate, union, where
from teg.backends.jax.while_loops import while_loop
from teg.backends.shared import rules
from teg.backends.shared.bends import POWER, Bends, place
from teg.numerics.quadrature import decay_power, gauss_legendre, null_rules
from teg.program import DEEP, DIVERGENT, END_INSIDE, MAX_DEPTH, MAX_INTERVALS, ROUNDING, WATCH_WIDTH

END = 2**MAX_DEPTH
"""The coordinate u in (0, 1) of an adaptive interval is counted in units of 1/END."""


def integral(
    pieces: Pieces, rule: tuple[float, float, int, int, bool], watched: int, *integral: Any, when: Scalar = True, guard: Guard | None = None
) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre with bisection on each piece; the arguments are those of `integrate`.

    The `rule` is its tolerance and the floor of that, the nodes of the first look and of later ones, and whether it looks at values at the
    ends of an interval too. Behind the values the body has `watched` signs (an interval on which one changes is halved), and the sharp
    values of a `guard`.
    """
    tol, floor, first, order, closed = rule
    nodes = _Nodes.of((first, order), watched > 0, closed)
    pieces = pieces._replace(adaptive=True)
    how = _How(pieces, (tol, floor), nodes, watched, closed, guard)
    return integrate(pieces, partial(_piece, how), *integral, when=when)


class _Nodes(NamedTuple):
    """Nodes and weights, by turns. An interval takes `turns` turns of `width` nodes each, (turns, width); the `first` look at a piece, None
    if there is none, takes one. Places that are left over repeat a node, with the weight 0; those at the ends have the weight 0 too.

    With both, `weights` (turns * width,) and `nulls` (6, turns * width) of the first look are those of the last turn.
    """

    width: int
    turns: int
    first: int | None
    order: int
    at: Any
    weights: Any
    nulls: Any

    @classmethod
    def of(cls, orders: tuple[int, int], watched: bool, closed: bool) -> _Nodes:
        """The nodes of the first look and of the intervals after it; `watched` or `closed`: no first look, and the ends of the interval
        too."""
        first, order = (None, orders[1]) if watched or closed else orders
        width = order + 2 if first is None else first
        turns = -(-order // width)
        rows = [_padded(order, turns * width)] if first is None else [_padded(first, turns * width), _padded(order, turns * width)]
        if first is None:
            end = 1.0 - 2.0 * END_INSIDE if closed else 1.0
            rows[0][0][:2] = -end, end
        at, weights, nulls = (np.stack(column) for column in zip(*rows, strict=True))
        return cls(width, turns, first, order, at, weights, nulls)


def _padded(nodes: int, room: int) -> tuple[Any, Any, Any]:
    """Nodes of a rule, their weights, and its null rules, with room for so many; the last places are taken."""
    at, weights = (np.array(column) for column in gauss_legendre(nodes))
    free = room - nodes
    return np.r_[np.repeat(at[0], free), at], np.r_[np.zeros(free), weights], np.pad(np.array(null_rules(nodes)), ((0, 0), (free, 0)))


class _Progress(NamedTuple):
    """Adaptive quadrature of one piece, left to right; it is at the interval (start, start + width)/END, of which `turn` turns were made
    (-1: the first look is next). `seen` are values at its nodes so far, the last ones last. `above` has the largest A of what the interval
    came from, a row a depth, if there is a guard."""

    start: Any
    width: Any
    turn: Any
    used: Any
    whole: Any
    spent: Any
    sums: Any
    note: Any
    above: Any
    seen: Any


class _Measured(NamedTuple):
    """K of every value, A and E of those tested, whether a watched sign changes, and whether one is 0."""

    total: Any
    size: Any
    error: Any
    changed: Any
    hidden: Any


class _How(NamedTuple):
    """How an integral is computed; `watched` signs stand behind the values of its body."""

    pieces: Pieces
    tolerance: tuple[float, float]
    nodes: _Nodes
    watched: int
    closed: bool
    guard: Guard | None

    @property
    def ends(self) -> int:
        """How many of the first nodes are ends of an interval, which count for signs and errors only."""
        return 2 if self.watched or self.closed else 0


def _piece(how: _How, piece: OnPiece, _: Bends, active: Scalar) -> tuple[Any, Note]:
    """The integrals over one piece, and their estimates, (results,), and the note.

    The intervals are visited from left to right. No stack is needed: behind an accepted interval that ends at
    u, the next one waiting is the largest dyadic one that begins at u: its width is the lowest bit of u.
    """
    pieces, nodes, guard = how.pieces, how.nodes, how.guard
    zeros, columns = jnp.zeros(pieces.tested), pieces.values + how.watched + (guard.sharp if guard is not None else 0)
    beginning = _Progress(
        start=jnp.where(active, jnp.int64(0), END),
        width=jnp.int64(END),
        turn=jnp.int32(0 if nodes.first is None else -1),
        used=jnp.int64(0),
        whole=zeros,
        spent=zeros,
        sums=jnp.zeros(pieces.values + (pieces.tested if pieces.estimated else 0)),
        note=jnp.int32(0),
        above=jnp.zeros((MAX_DEPTH + 1 if guard is not None else 0, pieces.tested)),
        seen=jnp.full((nodes.width * nodes.turns, columns), jnp.nan),
    )
    end = while_loop(lambda at: at.start < END, partial(_turned, how, piece), beginning, rests=True)
    overspent = rules.overspent(jnp, how.tolerance, end.spent, end.whole, end.sums[: pieces.tested])
    return end.sums, end.note | where(active & overspent, MISSED)


def _turned(how: _How, piece: OnPiece, at: _Progress) -> _Progress:
    """The next turn. At the end it changes nothing that is read then: neither `start` nor sums, errors and the note."""
    pieces, nodes, places = how.pieces, how.nodes, piece.places
    going, looks, left, width = at.start < END, at.turn < 0, at.start / END, at.width / END
    x, rate = place(JAX, places, pieces.ways, left + 0.5 * width * (1.0 + _of_turn(nodes, at.turn)))
    found, notes = piece.at(x, going)
    weighted = found[:, : pieces.values] * (0.5 * width * rate)[:, None]
    seen = jnp.concatenate([at.seen[nodes.width :], jnp.concatenate([weighted, found[:, pieces.values :]], axis=1)])
    full = going & (looks | (at.turn + 1 == nodes.turns))
    smooth = places.kind != POWER
    if piece.neighbours:
        first, last = piece.neighbours
        smooth &= ~(first & (at.start == 0)) & ~(last & (at.start + at.width == END))
    measured = _measured(how, looks, seen, smooth)
    good, above, reference, whole, hidden = _judged(how, piece, at, measured, (looks, seen))
    changed, deepest = measured.changed, at.width == 1
    done = full & (good | (~looks & (deepest | (at.used + 1 >= MAX_INTERVALS))))
    measured = measured._replace(error=jnp.where(done & ~good, jnp.fmax(measured.error, hidden), measured.error))
    large = jnp.isfinite(measured.error) & (measured.size > DIVERGENT * reference)
    endless = done & (at.width <= END >> DEEP) & ~good & ~changed & ~measured.hidden & large
    tested = measured.total[: pieces.tested]
    tested = jnp.where(endless, jnp.copysign(jnp.inf, tested), tested)
    total = jnp.concatenate([tested, measured.total[pieces.tested :]])
    if pieces.estimated:
        ends = place(JAX, places, pieces.ways, left + width * jnp.asarray([0.0, 0.5, 1.0]))[0]
        first, last = jnp.where(left > 0.0, ends[0], places.p), jnp.where(left + width < 1.0, ends[2], places.q)
        factor = jnp.fmax(rules.rounding(jnp, places.p, places.q), 0.5 * ROUNDING + rules.placed(jnp, first, ends[1], last))
        total = jnp.concatenate([total, measured.error + factor * measured.size])
    start = jnp.where(done, at.start + at.width, at.start)
    halved = jnp.where(full & ~looks, at.width // 2, at.width)
    return _Progress(
        start=start,
        width=jnp.where(done, start & -start, halved),
        turn=jnp.where(full, 0, at.turn + 1),
        used=at.used + full,
        whole=jnp.where(full, whole, at.whole),
        spent=jnp.where(done & ~changed, at.spent + measured.error, at.spent),
        sums=jnp.where(done, at.sums + total, at.sums),
        note=at.note | where(going, union(notes[how.ends :])) | where(done & (~good | jnp.any(jnp.isinf(tested))), MISSED),
        above=jnp.where(full, above, at.above),
        seen=seen,
    )


def _judged(how: _How, piece: OnPiece, at: _Progress, found: _Measured, nodes: tuple[Scalar, Any]) -> tuple[Scalar, Any, Any, Any, Any]:
    """Whether an interval is accepted, `above` with it, the A that its error is compared with, the A of the whole piece, and what its error
    is at least if it is accepted although a guard says no."""
    looks, seen = nodes
    tol, guard, narrow = how.tolerance, how.guard, at.width / END <= WATCH_WIDTH
    whole = jnp.where(at.used == 0, found.size, at.whole)
    if guard is None:
        enough = rules.tolerated(jnp, tol, whole, found.size)
        good = jnp.all((found.error <= enough) | ~jnp.isfinite(found.error))
        return jnp.where(found.changed, narrow, good), at.above, whole, whole, jnp.zeros_like(found.error)
    depth, rows = MAX_DEPTH - lax.population_count(at.width - 1), jnp.arange(MAX_DEPTH + 1)[:, None]
    reference = jnp.fmax(jnp.max(jnp.where(rows == jnp.maximum(depth - 1, 0), at.above, 0.0), axis=0), found.size)
    enough = rules.tolerated(jnp, tol, reference, found.size)
    good = jnp.all((found.error <= enough) | ~jnp.isfinite(found.error))
    asked = ~found.changed & jnp.all(jnp.isfinite(found.error))
    interval = at.start / END, (at.start + at.width) / END
    inner = interval[0] + 0.5 * (at.width / END) * (1.0 + _one_of(looks, how.nodes.at))
    known = _without_gaps(how.nodes, looks, seen[:, how.pieces.values + how.watched :])
    seen_at = inner[how.ends :], known[how.ends :]
    hides, hidden = guard.hides(piece, how.pieces.ways, interval, seen_at, enough, depth)
    hidden = jnp.where(good & asked & hides, hidden, 0.0)
    good &= ~(asked & hides)
    above = jnp.where(rows == depth, reference, at.above)
    return jnp.where(found.changed, narrow, good), above, reference, jnp.fmax(whole, found.size), hidden


def _of_turn(nodes: _Nodes, turn: Scalar) -> Any:
    """The nodes in (-1, 1) of a turn, (width,)."""
    rows = list(nodes.at[-1].reshape(nodes.turns, nodes.width))
    if nodes.first is not None:
        rows = [nodes.at[0][-nodes.width :], *rows]
        turn = turn + 1
    found = jnp.asarray(rows[0])
    for k, row in enumerate(rows[1:], 1):
        found = jnp.where(turn == k, row, found)
    return found


def _measured(how: _How, looks: Scalar, seen: Any, smooth: Scalar) -> _Measured:
    """The measures of an interval (see `teg.program`) by what its nodes gave, (nodes, values); where values are not known to be `smooth` no
    decay is counted on."""
    pieces, nodes, watched = how.pieces, how.nodes, how.watched
    weights = _one_of(looks, nodes.weights)[:, None]
    found = jnp.where(weights != 0.0, seen[:, : pieces.values], 0.0)
    total, size = jnp.sum(weights * found, axis=0), jnp.sum(weights * jnp.abs(found[:, : pieces.tested]), axis=0)
    sums = jnp.sum(_one_of(looks, nodes.nulls)[:, :, None] * found[None, :, : pieces.tested], axis=1)
    tail, decay = rules.null_rule_decay(jnp, sums, smooth)
    powers = [rules.powi(jnp, decay, decay_power(n, how.closed)) for n in (nodes.first, nodes.order) if n is not None]
    error = rules.null_rule_bound(jnp, tail, _one_of(looks, powers), size)
    if how.closed:
        tested = seen[:, : pieces.tested]
        error += rules.unseen_at_ends(jnp, nodes.order, tested[:2], tested[-nodes.order :], sums, size)
    changed = hidden = jnp.bool_(False)
    if watched:
        signs = seen[:, pieces.values : pieces.values + watched]
        changed, hidden = jnp.any(jnp.any(signs > 0.0, axis=0) & jnp.any(signs < 0.0, axis=0)), jnp.any(signs == 0.0)
    return _Measured(total, size, error, changed, hidden)


def _without_gaps(nodes: _Nodes, looks: Scalar, seen: Any) -> Any:
    """Values at nodes, in which the places that are left over have those of the node that they repeat."""
    room = nodes.turns * nodes.width
    first = [seen[room - n] for n in (nodes.first, nodes.order) if n is not None]
    return jnp.where((_one_of(looks, nodes.weights) != 0.0)[:, None], seen, _one_of(looks, first))


def _one_of(looks: Scalar, of_each: Sequence[Any]) -> Any:
    """What is that of the first look, or that of an interval after it."""
    return jnp.asarray(of_each[0]) if len(of_each) == 1 else jnp.where(looks, of_each[0], of_each[1])
