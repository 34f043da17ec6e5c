"""What the printed JAX programs call, as `rt`: powers, ties, and integrals with static shapes.

Everything is written for one element; the kernel maps it over the batch. The pieces and the nodes are mapped
axes here. What need not be evaluated is masked: its value is replaced by 0, never multiplied by it, so that
no NaN comes through. This module imports JAX: only a compiled kernel imports it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from teg.backends.jax.arrays import JAX
from teg.backends.jax.guard import Guard
from teg.backends.shared import error_function, rules
from teg.backends.shared.bends import POWER, Substitution, inside, place, possible_kinds, substitution
from teg.numerics.quadrature import gauss_legendre, null_rules
from teg.program import DEEP, DIVERGENT, INSIDE, MAX_DEPTH, MAX_INTERVALS, ROUNDING, SPENT, WATCH_WIDTH

Scalar = Any  # a traced scalar, float64 or boolean, or a Python literal
Note = Any  # an int32: TIED where a tie was met, MISSED where a tolerance was, CROWDED where a search has too little room
Body = Callable[[Scalar, tuple[Scalar, ...]], tuple[tuple[Scalar, ...], Note]]  # x, flags -> values, note
Flags = Callable[
    [Scalar, Scalar, Scalar], tuple[Scalar, tuple[Scalar, ...], tuple[Scalar, ...], Note]
]  # middle, ends -> need, bends, flags, note
Rule = Callable[[Substitution, Sequence[Any], Scalar, Callable[[Scalar], Any]], tuple[Any, Note]]
TIED, MISSED, CROWDED = 1, 2, 4

MIDPOINTS = 1024
"""Points of the midpoint rule at a time."""
END = 2**MAX_DEPTH
"""The coordinate u in (0, 1) of an adaptive interval is counted in units of 1/END."""


def powi(x: Scalar, n: int) -> Scalar:
    """x to an integer power."""
    return rules.powi(jnp, x, n)


def erf(x: Scalar) -> Scalar:
    """The error function."""
    return error_function.erf(JAX, x)


def erfc(x: Scalar) -> Scalar:
    """1 - erf(x)."""
    return error_function.erfc(JAX, x)


def tie(order: Scalar, g: Scalar, scale: Scalar, r: Scalar) -> tuple[Scalar, Note]:
    """g > 0, but where g vanishes to rounding the order decides; and whether it did."""
    near = rules.ties(jnp, g, scale)
    return rules.resolved(jnp, near, g, r, order), jnp.where(near, jnp.int32(TIED), jnp.int32(0))


def union(notes: Note) -> Note:
    """All that an array of notes says."""
    return jnp.bitwise_or.reduce(jnp.asarray(notes, jnp.int32), axis=None)


def where(condition: Scalar, note: Note) -> Note:
    """A note where it counts."""
    return jnp.where(condition, jnp.asarray(note, jnp.int32), jnp.int32(0))


class Pieces(NamedTuple):
    """What an integral has beside its body: `values` of which `tested` count, estimates if `estimated`, kinds of bends, tails."""

    values: int
    tested: int
    estimated: bool = False
    kinds: tuple[str, ...] = ()
    cubic: bool = False
    infinite: bool = False

    @property
    def ways(self) -> tuple[int, ...]:
        return possible_kinds(self.kinds, self.cubic, self.infinite)


def gauss(pieces: Pieces, nodes: int, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre on each piece; the arguments are those of `integrate`."""
    return integrate(pieces, partial(_gauss, pieces, nodes), *integral, when=when)


def midpoint(pieces: Pieces, points: int, zero: Scalar, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """The midpoint rule on each piece; `zero` keeps a product and a sum apart (see `python_text`), the rest are for `integrate`."""
    return integrate(pieces, partial(_midpoint, pieces, points, zero), *integral, when=when)


def adaptive(
    pieces: Pieces, tol: float, orders: tuple[int, int], watched: int, *integral: Any, when: Scalar = True, guard: Guard | None = None
) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre with bisection on each piece; the arguments are those of `integrate`.

    Behind the values the body has `watched` conditions (an interval on which one changes is halved), and the sharp values of a `guard`.
    """
    return integrate(pieces, partial(_adaptive, pieces, tol, orders, watched, guard), *integral, when=when)


def integrate(
    pieces: Pieces,
    rule: Rule,
    lo: Scalar,
    hi: Scalar,
    breaks: tuple[Scalar, ...],
    bends: tuple[Scalar, ...],
    flags: Flags | None,
    body: Body,
    *,
    when: Scalar,
) -> tuple[tuple[Scalar, ...], Note]:
    """The results, and the note; `bends`: base, scale, and three coefficients a bend, or nothing."""
    lo, hi = jnp.asarray(lo, jnp.float64), jnp.asarray(hi, jnp.float64)
    ends = jnp.stack([lo, hi])
    broken = jnp.any(jnp.isnan(ends) if pieces.infinite else ~jnp.isfinite(ends))
    points = jnp.stack(rules.ends_of_pieces(jnp, lo, hi, breaks))
    if len(breaks) > 1:
        points = jnp.sort(points)
    base, scale, *coefficients = bends or (0.0, 1.0)

    def piece(p: Scalar, q: Scalar) -> tuple[Any, Note]:
        active = when & ~broken & rules.is_wide(jnp, p, q)
        need, counts, flagged, note = True, (), (), jnp.int32(0)
        if flags is not None:
            need, counts, flagged, note = flags(inside(jnp, p, q, INSIDE, pieces.infinite, scale), p, q)
        bent = [(kind, *coefficients[3 * i : 3 * i + 3], counts[i]) for i, kind in enumerate(pieces.kinds)]
        places = substitution(JAX, p, q, base, bent, pieces.cubic, pieces.infinite, scale)
        sums, note_body = rule(places, (base, bent), active & need, lambda x: vector(body(x, flagged)))
        return sums, where(active, note) | note_body

    sums, notes = jax.vmap(piece)(points[:-1], points[1:])
    total = jnp.sum(sums, axis=0)
    sign = jnp.where(lo <= hi, 1.0, -1.0)
    total = jnp.concatenate([sign * total[: pieces.values], total[pieces.values :]])
    total = jnp.where(broken, jnp.nan, total)
    total = jnp.where(when, total, 0.0)
    return tuple(total[i] for i in range(pieces.values + (pieces.tested if pieces.estimated else 0))), union(notes)


def vector(block: tuple[tuple[Scalar, ...], Note]) -> tuple[Any, Any]:
    """The values of a body as one vector, (results,)."""
    values, note = block
    return jnp.stack([jnp.asarray(v, jnp.float64) for v in values]), jnp.asarray(note, jnp.int32)


def _measure(nodes: int, tested: int, found: Any, smooth: Scalar) -> tuple[Any, Any, Any]:
    """K of every value, A and E of those tested (see `teg.program`), of values at Gauss nodes by dv/du, (nodes, values); where they
    are not known to be `smooth` no decay is counted on."""
    weights = jnp.array(gauss_legendre(nodes)[1], jnp.float64)[:, None]
    total, size = jnp.sum(weights * found, axis=0), jnp.sum(weights * jnp.abs(found[:, :tested]), axis=0)
    sums = jnp.sum(jnp.array(null_rules(nodes), jnp.float64)[:, :, None] * found[None, :, :tested], axis=1)
    return total, size, rules.null_rule_error(jnp, nodes, sums, size, smooth)


def _gauss(
    pieces: Pieces, nodes: int, places: Substitution, _: Sequence[Any], active: Scalar, values: Callable[[Scalar], Any]
) -> tuple[Any, Note]:
    """The integrals over one piece and their estimates, (results,), and the note."""
    at, weights = map(jnp.float64, gauss_legendre(nodes))
    half = 0.5 * (places.q - places.p)
    found, notes = jax.vmap(values)(0.5 * (places.p + places.q) + half * at)
    sums = half * jnp.sum(weights[:, None] * found, axis=0)
    if pieces.estimated:
        size = half * jnp.sum(weights[:, None] * jnp.abs(found[:, : pieces.tested]), axis=0)
        sums = jnp.concatenate([sums, rules.rounding(jnp, places.p, places.q) * size])
    return jnp.where(active, sums, 0.0), where(active, union(notes))


def _midpoint(
    pieces: Pieces,
    points: int,
    zero: Scalar,
    places: Substitution,
    _: Sequence[Any],
    active: Scalar,
    values: Callable[[Scalar], Any],
) -> tuple[Any, Note]:
    """The integrals over one piece and their estimates, (results,), and the note; so many points at a time."""
    p, q, chunk = places.p, places.q, min(points, MIDPOINTS)
    tested = pieces.tested if pieces.estimated else 0

    def stretch(carried: Any, start: Any) -> tuple[Any, None]:
        sums, errors, last, note = carried
        k = start + jnp.arange(chunk)
        there = active & (k < points)
        found, notes = jax.vmap(values)(p + ((q - p) * ((jnp.minimum(k, points - 1) + 0.5) / points) + zero))
        steps = jnp.abs(found[:, :tested] - jnp.concatenate([last[None], found[:-1, :tested]]))
        steps = jnp.where((k > 0)[:, None], steps, 0.0) + ROUNDING * jnp.abs(found[:, :tested])
        total, error = (jnp.sum(jnp.where(there[:, None], v, 0.0), axis=0) for v in (found, steps))
        return (sums + total, errors + 0.5 * error, found[-1, :tested], note | union(where(there, notes))), None

    nothing = jnp.zeros(pieces.values), jnp.zeros(tested), jnp.zeros(tested), jnp.int32(0)
    found = lax.scan(stretch, nothing, jnp.arange(0, points, chunk))[0]
    sums, errors, note = found[0], found[1], found[3]
    return jnp.where(active, jnp.concatenate([sums, errors]) * ((q - p) / points), 0.0), note


class _Progress(NamedTuple):
    """Adaptive quadrature of one piece, left to right; it is at the interval (start, start + width)/END. `above` has the largest A of what
    the interval came from, a row a depth, if there is a guard."""

    start: Any
    width: Any
    used: Any
    whole: Any
    spent: Any
    sums: Any
    note: Any
    above: Any


class _Measured(NamedTuple):
    """K of every value, A and E of those tested, whether a watched condition changes, a note; nodes in u, sharp values there."""

    total: Any
    size: Any
    error: Any
    changed: Any
    note: Any
    at: Any
    seen: Any


def _adaptive(
    pieces: Pieces,
    tol: float,
    orders: tuple[int, int],
    watched: int,
    guard: Guard | None,
    places: Substitution,
    _: Sequence[Any],
    active: Scalar,
    values: Callable[[Scalar], Any],
) -> tuple[Any, Note]:
    """The integrals over one piece, and their estimates, (results,), and the note.

    The intervals are visited from left to right. No stack is needed: behind an accepted interval that ends at
    u, the next one waiting is the largest dyadic one that begins at u: its width is the lowest bit of u.
    """
    possible = pieces.ways
    behind = pieces.values + watched
    sharp = guard.sharp if guard is not None else 0

    def measured(nodes: int, left: Scalar, width: Scalar) -> _Measured:
        at = jnp.array(gauss_legendre(nodes)[0], jnp.float64)
        inner = left + 0.5 * width * (1.0 + at)
        if watched:
            at = jnp.concatenate([at, jnp.array([-1.0, 1.0])])
        x, rate = place(JAX, places, possible, left + 0.5 * width * (1.0 + at))
        found, notes = jax.vmap(values)(x)
        changed = jnp.bool_(False)
        if watched:  # at the ends, the last two rows, only the conditions count
            conditions = found[:, pieces.values : behind] > 0.0
            changed = jnp.any(jnp.any(conditions, axis=0) & ~jnp.all(conditions, axis=0))
            found, notes, rate = found[:-2], notes[:-2], rate[:-2]
        weighted = found[:, : pieces.values] * (0.5 * width * rate)[:, None]
        total, size, error = _measure(nodes, pieces.tested, weighted, places.kind != POWER)
        return _Measured(total, size, error, changed, union(notes), inner, found[:, behind : behind + sharp])

    def listed(total: Any, size: Any, error: Any) -> Any:
        return jnp.concatenate([total, error + rules.rounding(jnp, places.p, places.q) * size]) if pieces.estimated else total

    def is_fine(error: Any, enough: Any) -> Scalar:
        return jnp.all((error <= enough) | ~jnp.isfinite(error))

    def hidden(found: _Measured, left: Scalar, width: Scalar, enough: Any, depth: Scalar) -> Scalar:
        assert guard is not None
        asked = ~found.changed & jnp.all(jnp.isfinite(found.error))
        return asked & guard.hides(places, possible, (left, left + width), found.at, found.seen, enough, depth)

    def step(at: _Progress) -> _Progress:
        width = at.width / END
        found = measured(orders[1], at.start / END, width)
        total, size, error, changed = found.total, found.size, found.error, found.changed
        whole = jnp.where(at.used == 0, size, at.whole)
        reference, above = whole, at.above
        if guard is not None:
            depth = MAX_DEPTH - lax.population_count(at.width - 1)
            row = jnp.maximum(depth - 1, 0)
            reference = jnp.fmax(above[row], size)
            above = above.at[depth].set(reference)
            whole = jnp.fmax(whole, size)
        enough = rules.tolerated(jnp, tol, reference, size)
        good = is_fine(error, enough)
        if guard is not None:
            good &= ~hidden(found, at.start / END, width, enough, depth)
        good = jnp.where(changed, width <= WATCH_WIDTH, good)
        deepest = at.width == 1
        done = good | deepest | (at.used + 1 >= MAX_INTERVALS)
        endless = done & (at.width <= END >> DEEP) & ~good & ~changed & jnp.isfinite(error) & (size > DIVERGENT * reference)
        tested = jnp.where(endless, jnp.copysign(jnp.inf, total[: pieces.tested]), total[: pieces.tested])
        total = jnp.concatenate([tested, total[pieces.tested :]])
        start = jnp.where(done, at.start + at.width, at.start)
        return _Progress(
            start=start,
            width=jnp.where(done, start & -start, at.width // 2),
            used=at.used + 1,
            whole=whole,
            spent=jnp.where(done & ~changed, at.spent + error, at.spent),
            sums=jnp.where(done, at.sums + listed(total, size, error), at.sums),
            note=at.note | found.note | where(done & (~good | jnp.any(jnp.isinf(tested))), MISSED),
            above=above,
        )

    zeros = jnp.zeros(pieces.tested)
    beginning = _Progress(
        start=jnp.where(active, jnp.int64(0), END),
        width=jnp.int64(END),
        used=jnp.int64(0),
        whole=zeros,
        spent=zeros,
        sums=jnp.zeros(pieces.values + (pieces.tested if pieces.estimated else 0)),
        note=jnp.int32(0),
        above=jnp.zeros((MAX_DEPTH + 1 if guard is not None else 0, pieces.tested)),
    )
    if not watched:
        found = measured(orders[0], 0.0, 1.0)
        total, size, error = found.total, found.size, found.error
        enough = rules.tolerated(jnp, tol, size, size)
        done = active & is_fine(error, enough)
        if guard is not None:
            done &= ~hidden(found, jnp.float64(0.0), 1.0, enough, 0)
        beginning = beginning._replace(
            start=jnp.where(done, END, beginning.start),
            used=jnp.int64(1),
            whole=size,
            spent=jnp.where(done, error, 0.0),
            sums=jnp.where(done, listed(total, size, error), 0.0),
            note=where(active, found.note) | where(done & jnp.any(jnp.isinf(total[: pieces.tested])), MISSED),
            above=beginning.above.at[0].set(size) if guard is not None else beginning.above,
        )
    end = lax.while_loop(lambda at: at.start < END, step, beginning)
    overspent = jnp.any(end.spent > SPENT * rules.tolerated(jnp, tol, end.whole, end.whole))
    return end.sums, end.note | where(active & overspent, MISSED)
