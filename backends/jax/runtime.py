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

from teg.backends.jax import entries
from teg.backends.jax.arrays import JAX
from teg.backends.jax.while_loops import while_loop
from teg.backends.shared import error_function, rules
from teg.backends.shared.bends import Bends, Substitution, Tail, inside, possible_kinds, substitution
from teg.numerics.quadrature import gauss_legendre
from teg.program import INSIDE, ROUNDING

Scalar = Any  # a traced scalar, float64 or boolean, or a Python literal
Note = Any  # an int32: TIED where a tie was met, MISSED where a tolerance was, CROWDED where a search has too little room
Block = Callable[..., Any]
"""A printed function: the body, from x and flags to values and a note; or the flags, from the middle and the ends of a piece to whether it
is needed, its bends, the flags, and a note. Both take the values that they have in common last, if there are such."""
Rule = Callable[["OnPiece", Bends, Scalar], tuple[Any, Note]]
Run = tuple[Scalar, Scalar]  # the order of ties, and a zero that keeps a product and a sum apart (see `teg.backends.text`)
TIED, MISSED, CROWDED = 1, 2, 4

MANY = 24
"""Breaks of an integral whose pieces are visited one after the other; those of fewer are computed all at once."""
WIDE = 4
"""Numbers that processors compute at once."""
MIDPOINTS = 1024
"""Points of the midpoint rule at a time."""


def powi(x: Scalar, n: int) -> Scalar:
    """x to an integer power."""
    return rules.powi(jnp, x, n)


def quotient(x: Scalar, y: Scalar, zero: Scalar) -> Scalar:
    """x / y, correctly rounded: XLA does not see that y is a root or the same for all elements, nor that the result is a quotient."""
    return x / jnp.where(x == x, y, jnp.nan) + zero


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


def barrier(*values: Scalar) -> Sequence[Any]:
    """The values; XLA moves no operations across."""
    keep: Any = lax.optimization_barrier
    kept: Sequence[Any] = keep(values)
    return kept


def union(notes: Note) -> Note:
    """All that an array of notes says."""
    return jnp.bitwise_or.reduce(jnp.asarray(notes, jnp.int32), axis=None)


def where(condition: Scalar, note: Note) -> Note:
    """A note where it counts."""
    return jnp.where(condition, jnp.asarray(note, jnp.int32), jnp.int32(0))


def weighted(body: Callable[..., tuple[Scalar, ...]], places: Sequence[Sequence[float]], weights: Sequence[Scalar]) -> tuple[Scalar, ...]:
    """Sums over nodes of weight·value, node by node: few. `places` has the coordinates of all nodes, one after the other."""
    sums: list[Scalar] = []
    for weight, *at in zip(weights, *places, strict=True):
        terms = [weight * value for value in body(*at)]
        sums = [total + term for total, term in zip(sums, terms, strict=True)] if sums else terms
    return tuple(sums)


def rows(body: Callable[..., tuple[tuple[Scalar, ...], Note]], columns: Sequence[Sequence[Scalar]]) -> tuple[tuple[Scalar, ...], Note]:
    """The values of a body for each row of the columns, those of a row together, and the note."""
    parts = entries.columns(columns)

    def row(*given: Any) -> tuple[Any, Any]:
        numbers: dict[int, Any] = {}
        for part, values in zip(parts, given, strict=True):
            numbers.update(zip(part.numbers, entries.entries(values), strict=True))
        return vector(body(*(numbers[k] for k in range(len(columns)))))

    found, notes = jax.vmap(row)(*(part.rows for part in parts))
    return entries.entries(found.reshape(-1)), union(notes)


class Pieces(NamedTuple):
    """What an integral has beside its body: `values` of which `tested` count, estimates if `estimated`, kinds of bends, tails, which may be
    slow; an `adaptive` rule asks for neighbours."""

    values: int
    tested: int
    estimated: bool = False
    kinds: tuple[str, ...] = ()
    cubic: bool = False
    infinite: bool = False
    slow: bool = False
    adaptive: bool = False

    @property
    def ways(self) -> tuple[int, ...]:
        return possible_kinds(self.kinds, self.cubic, self.infinite, self.slow)

    @property
    def results(self) -> int:
        return self.values + (self.tested if self.estimated else 0)


def gauss(pieces: Pieces, nodes: int, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """Gauss-Legendre on each piece; the arguments are those of `integrate`."""
    return integrate(pieces, partial(_gauss, pieces, nodes), *integral, when=when)


def midpoint(pieces: Pieces, points: int, zero: Scalar, *integral: Any, when: Scalar = True) -> tuple[tuple[Scalar, ...], Note]:
    """The midpoint rule on each piece; `zero` keeps a product and a sum apart (see `python_text`), the rest are for `integrate`."""
    return integrate(pieces, partial(_midpoint, pieces, points, zero), *integral, when=when)


def integrate(
    pieces: Pieces,
    rule: Rule,
    ends: Sequence[Scalar],
    bends: tuple[Scalar, ...],
    blocks: tuple[Any, ...],
    *,
    when: Scalar,
) -> tuple[tuple[Scalar, ...], Note]:
    """The results, and the note; `ends`: the bounds, then breaks; `bends`: base, scale, reach of slow tails, and three coefficients a bend,
    or nothing; `blocks`: the flags or None, the body, and what they have in common and what that needs (`in_common`) if there are such."""
    (lo, hi), breaks, (flags, body, *common) = (jnp.asarray(v, jnp.float64) for v in ends[:2]), ends[2:], blocks
    bounds = jnp.stack([lo, hi])
    broken = jnp.any(jnp.isnan(bounds) if pieces.infinite else ~jnp.isfinite(bounds))
    inner = rules.ends_of_pieces(jnp, lo, hi, [entries.stacked(breaks)] if breaks else [])
    points = jnp.concatenate([jnp.atleast_1d(v) for v in inner])
    if len(breaks) > 1:
        points = jnp.sort(points)
    near: tuple[Any, ...] = ()
    if pieces.adaptive and breaks:
        near = rules.neighbours(JAX, points, entries.stacked(breaks))
    base, scale, *coefficients = bends or (0.0, 1.0)
    reach, *coefficients = coefficients if pieces.slow else (None, *coefficients)
    tail = Tail(scale, reach) if pieces.infinite else None

    def piece(p: Scalar, q: Scalar, *neighbours: Scalar) -> tuple[Any, Note]:
        active = when & ~broken & rules.is_wide(jnp, p, q)
        need, counts, flagged, note, late = True, (), (), jnp.int32(0), None
        middle = inside(jnp, p, q, INSIDE, pieces.infinite, scale), p, q
        if common:
            shared, *early = common
            known = [v for function in early for v in function(*middle)[0]]
            late = Late(lambda x: shared(x, *known), flags, middle)
        elif flags is not None:
            need, counts, flagged, note = flags(*middle)
        bent = [(kind, *coefficients[3 * i : 3 * i + 3], counts[i]) for i, kind in enumerate(pieces.kinds)]
        of_bends = Bends(base, bent)
        places = substitution(JAX, (p, q), of_bends, pieces.cubic, tail)
        sums, note_body = rule(OnPiece(places, body, flagged, neighbours, late), of_bends, active & need)
        return sums, where(active, note) | note_body

    if len(breaks) < MANY:
        sums, notes = jax.vmap(piece)(points[:-1], points[1:], *near)
        total, note = jnp.sum(sums, axis=0), union(notes)
    else:
        total, note = _one_by_one(piece, (points[:-1], points[1:], *near), when & ~broken, pieces)
    sign = jnp.where(lo <= hi, 1.0, -1.0)
    total = jnp.concatenate([sign * total[: pieces.values], total[pieces.values :]])
    total = jnp.where(broken, jnp.nan, total)
    total = jnp.where(when, total, 0.0)
    return entries.entries(total), note


def _one_by_one(piece: Callable[..., tuple[Any, Note]], ends: tuple[Any, ...], active: Scalar, pieces: Pieces) -> tuple[Any, Note]:
    """The sums over pieces by their ends and neighbours, and the note; those that have no length, which are nearly all of many, are left
    out."""
    is_wide = active & rules.is_wide(jnp, *ends[:2])
    columns = lax.sort((~is_wide, *ends), num_keys=1, is_stable=True)[1:]
    count = jnp.sum(is_wide)

    def step(at: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        k, sums, note = at
        going, (p, q, *near) = k < count, (column[k] for column in columns)
        more, noted = piece(*(jnp.where(going, v, jnp.nan) for v in (p, q)), *near)  # at NaN, loops end at once
        return jnp.where(going, k + 1, k), sums + jnp.where(going, more, 0.0), note | where(going, noted)

    beginning = jnp.int64(0), jnp.zeros(pieces.results), jnp.int32(0)
    _, sums, note = while_loop(lambda at: at[0] < count, step, beginning, rests=True)
    return sums, note


class Late(NamedTuple):
    """Flags of a piece that are computed with the values at nodes: what they have in `common` with the body, the flags, and where they are
    computed, the middle of the piece and its ends."""

    common: Callable[[Scalar], tuple[tuple[Scalar, ...], Note]]
    flags: Block
    at: tuple[Scalar, Scalar, Scalar]


class OnPiece(NamedTuple):
    """One piece of an integral, by its substitution: the body gives the values at a place, (results,), and the note; the flags of the
    piece; whether it has neighbours at its first and at its last end, if it may have any; flags that are computed late."""

    places: Substitution
    body: Block
    flagged: tuple[Scalar, ...]
    neighbours: tuple[Scalar, ...] = ()
    late: Late | None = None

    def at(self, x: Any, active: Scalar = True) -> tuple[Any, Any]:
        """The values at places, (places, results), and the notes, (places,); at NaN, where loops end at once, if they are not asked for."""
        late = self.late
        if late is None:
            found: tuple[Any, Any] = jax.vmap(lambda v: vector(self.body(v, self.flagged)))(_where_active(active, x))
            return found
        middle, *ends = late.at
        count = x.shape[0]  # the middle stands behind the nodes, so often that loops of LLVM leave nothing over
        places = _where_active(active, jnp.concatenate([x, jnp.repeat(middle[None], WIDE - count % WIDE)]))
        several: tuple[bool, ...] = ()

        def common(v: Any) -> tuple[list[Any], Any]:
            nonlocal several
            values, note = late.common(v)
            arrays, several = entries.parts(values)
            return arrays, jnp.asarray(note, jnp.int32)

        arrays, notes = jax.vmap(common)(places)
        *_, flagged, note = late.flags(places[-1], *ends, entries.of_parts([v[-1] for v in arrays], several))

        def body(v: Any, *own: Any) -> tuple[Any, Any]:
            return vector(self.body(v, flagged, entries.of_parts(own, several)))

        values, noted = jax.vmap(body)(places[:count], *(v[:count] for v in arrays))
        return values, noted | notes[:count] | notes[-1] | jnp.asarray(note, jnp.int32)


def _where_active(active: Scalar, x: Any) -> Any:
    return x if active is True else jnp.where(active, x, jnp.nan)


def vector(block: tuple[tuple[Scalar, ...], Note]) -> tuple[Any, Any]:
    """The values of a body as one vector, (results,)."""
    values, note = block
    return entries.stacked(values), jnp.asarray(note, jnp.int32)


def _gauss(pieces: Pieces, nodes: int, piece: OnPiece, _: Bends, active: Scalar) -> tuple[Any, Note]:
    """The integrals over one piece and their estimates, (results,), and the note."""
    places, (at, weights) = piece.places, map(jnp.float64, gauss_legendre(nodes))
    half = 0.5 * (places.q - places.p)
    found, notes = piece.at(0.5 * (places.p + places.q) + half * at)
    sums = half * jnp.sum(weights[:, None] * found, axis=0)
    if pieces.estimated:
        size = half * jnp.sum(weights[:, None] * jnp.abs(found[:, : pieces.tested]), axis=0)
        sums = jnp.concatenate([sums, rules.rounding(jnp, places.p, places.q) * size])
    return jnp.where(active, sums, 0.0), where(active, union(notes))


def _midpoint(pieces: Pieces, points: int, zero: Scalar, piece: OnPiece, _: Bends, active: Scalar) -> tuple[Any, Note]:
    """The integrals over one piece and their estimates, (results,), and the note; so many points at a time."""
    p, q, chunk = piece.places.p, piece.places.q, min(points, MIDPOINTS)
    tested = pieces.tested if pieces.estimated else 0

    def stretch(carried: Any, start: Any) -> tuple[Any, None]:
        sums, errors, last, note = carried
        k = start + jnp.arange(chunk)
        there = active & (k < points)
        found, notes = piece.at(p + ((q - p) * ((jnp.minimum(k, points - 1) + 0.5) / points) + zero))
        steps = jnp.abs(found[:, :tested] - jnp.concatenate([last[None], found[:-1, :tested]]))
        steps = jnp.where((k > 0)[:, None], steps, 0.0) + ROUNDING * jnp.abs(found[:, :tested])
        total, error = (jnp.sum(jnp.where(there[:, None], v, 0.0), axis=0) for v in (found, steps))
        return (sums + total, errors + 0.5 * error, found[-1, :tested], note | union(where(there, notes))), None

    nothing = jnp.zeros(pieces.values), jnp.zeros(tested), jnp.zeros(tested), jnp.int32(0)
    found = lax.scan(stretch, nothing, jnp.arange(0, points, chunk))[0]
    sums, errors, note = found[0], found[1], found[3]
    return jnp.where(active, jnp.concatenate([sums, errors]) * ((q - p) / points), 0.0), note
