"""What the printed JAX programs call, as `roots`: roots isolated between bounds, sums over them, common zeros located.

Everything is written for one element, as in `jax_runtime`. The boxes are visited from left to right, one at a
time: a batch costs as many visits as its worst element needs, whatever the room on a level is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from teg.backends.jax_runtime import CROWDED, MISSED, Note, Scalar, union, vector, where
from teg.program import ISOLATE_DEPTH, ISOLATE_STEPS, LOCATE_DEPTH, LOCATE_WIDTH

Block = Callable[..., tuple[tuple[Scalar, ...], Note]]  # variables -> values, note

END = 2**ISOLATE_DEPTH
"""Where a box of the last level begins is counted from 0 to END."""
ROW = 32
"""Rectangles that a walk keeps before they are put aside: what it carries is copied at every step."""


class _Search(NamedTuple):
    """A search that is at the box (p, q), which begins at start/END; level l has seen count[l] boxes.

    Of g and its slope at ends of boxes only the signs are kept: 1 for > 0, -1 for <= 0, 0 for NaN. The box of level l that waits on
    the right of the present one, or of an ancestor, ends at ends[l], with the signs sign_ends[:, l]. The last undecided boxes
    begin at `first` and end at `last`. `found` places are taken.
    """

    start: Any
    level: Any
    p: Any
    q: Any
    signs_p: Any
    signs_q: Any
    ends: Any
    sign_ends: Any
    count: Any
    first: Any
    sign_first: Any
    last: Any
    found: Any
    places: _Places
    note: Any


class _Places(NamedTuple):
    """What was found, one array entry each: a range (p, q), how many roots, whether g changes its sign in it, the sign of g at q, and how
    far a root in its middle may be off.

    A range is a box with one root, which is for Newton's method to find, undecided boxes joined, or a tangency.
    """

    p: Any
    q: Any
    times: Any
    crossing: Any
    sign_q: Any
    error: Any


def isolate(
    lo: Scalar, hi: Scalar, enclosure: Block, point: Block, room: tuple[int, int], tol: float, estimated: bool, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Scalar]:
    """The roots in ascending order, then +inf; behind them, if `estimated`, their errors; and the note. There is `room` for so many roots,
    and so many boxes on a level."""
    results, width = room
    lo, hi = jnp.asarray(lo, jnp.float64), jnp.asarray(hi, jnp.float64)
    finite = jnp.isfinite(lo) & jnp.isfinite(hi)
    active = when & finite & (lo != hi)
    p, q = jnp.minimum(lo, hi), jnp.maximum(lo, hi)
    at_ends, note = jax.vmap(lambda v: vector(point(v)))(jnp.stack([p, q]))
    end = _search(active, p, q, _sign(at_ends[:, :2]), enclosure, point, results + 2, width)
    places = end.places
    there = jnp.arange(results + 2) < end.found
    searched, note_steps = jax.vmap(lambda *box: _crossing(point, 0, *box))(there & places.crossing, places.p, places.q, places.sign_q)
    times = jnp.where(there, places.times, 0)
    root = jnp.where(places.crossing, searched, 0.5 * (places.p + places.q))
    both = [jnp.concatenate([jnp.where(times >= i, v, absent) for i in (1, 2)]) for v, absent in ((root, jnp.inf), (places.error, 0.0))]
    listed, errors = (v[:results] for v in lax.sort(tuple(both), num_keys=1))
    crowded = active & (jnp.any(end.count > width) | (end.found > results + 2) | (jnp.sum(times) > results))
    missed = active & ~crowded & jnp.any(errors > tol * jnp.abs(hi - lo))
    refused = when & (~finite | crowded)
    found = [jnp.where(when, jnp.where(refused, jnp.nan, v), jnp.inf) for v in ((listed, errors) if estimated else (listed,))]
    noted = jnp.where(crowded, jnp.int32(CROWDED), jnp.int32(0)) | jnp.where(missed, jnp.int32(MISSED), jnp.int32(0))
    return tuple(v[i] for v in found for i in range(results)), where(active, union(note)) | end.note | union(note_steps) | noted


def sum_over(points: tuple[Scalar, ...], body: Block, results: int, *, when: Scalar = True) -> tuple[tuple[Scalar, ...], Scalar]:
    """The sums of the body's values over the points that are finite, and the note."""
    if not points:
        return (jnp.float64(0.0),) * results, jnp.int32(0)
    at = jnp.stack([jnp.asarray(point, jnp.float64) for point in points])
    unknown = jnp.any(jnp.isnan(at))
    there = when & ~unknown & jnp.isfinite(at)
    found, note = jax.vmap(lambda x: vector(body(x)))(jnp.where(there, at, jnp.nan))  # at NaN, searches end at once
    sums = jnp.sum(jnp.where(there[:, None], found, 0.0), axis=0)
    sums = jnp.where(when & unknown, jnp.nan, sums)
    return tuple(sums[i] for i in range(results)), union(where(there, note))


def _search(active: Scalar, p: Scalar, q: Scalar, signs: Any, enclosure: Block, point: Block, room: int, width: int) -> _Search:
    """The search of the box (p, q), at its end or where it is known to be hopeless, with places for `room` finds and `width` boxes a level.

    No stack is needed to know where the search stands: behind a box that ends at u/END, the next one
    waiting is the largest dyadic one that begins there, whose level is told by the lowest bit of u.
    """
    levels, numbers = jnp.arange(ISOLATE_DEPTH + 1, dtype=jnp.int8), jnp.arange(room)

    def step(at: _Search) -> _Search:
        m, h = 0.5 * (at.p + at.q), 0.5 * (at.q - at.p)
        (least, most, slowest, fastest, bent_down, bent_up, noise), note_box = vector(enclosure(at.p, at.q))
        (g, slope, _), note_middle = vector(point(m))
        reach = h * jnp.maximum(jnp.abs(slowest), jnp.abs(fastest))
        bounded = jnp.isfinite(slowest) & jnp.isfinite(fastest)
        away = (least > 0.0) | (most < 0.0) | (bounded & ((g - reach > 0.0) | (g + reach < 0.0)))
        away |= jnp.isnan(least) & jnp.isnan(most) & jnp.isnan(g)
        changes, turns = at.signs_p * at.signs_q < 0
        known, sloped = at.signs_p * at.signs_q != 0
        flat = (slowest == 0.0) & (fastest == 0.0)
        inside = (changes | ~away) & ~flat
        monotone = inside & ((slowest > 0.0) | (fastest < 0.0)) & known
        bent = inside & ~monotone & ((bent_down > 0.0) | (bent_up < 0.0)) & known & sloped
        turning = bent & ~changes & turns & ((at.signs_p[0] > 0) == (bent_down > 0.0))
        _, touch, two, turn, error, note_turn = _turn(enclosure, point, turning & (at.start < END), at)
        bend = jnp.maximum(jnp.abs(bent_down), jnp.abs(bent_up))
        blurred = (jnp.abs(g) + h * jnp.abs(slope) + 0.5 * h * h * bend <= noise) & jnp.isfinite(noise)
        whole = (m <= at.p) | (m >= at.q)
        left = inside & ~monotone & ~bent
        undecided = left & (whole | (at.level == ISOLATE_DEPTH) | blurred)
        halve = left & ~undecided

        joins = at.last == at.p
        first, sign_first = jnp.where(joins, at.first, at.p), jnp.where(joins, at.sign_first, at.signs_p[0])
        times = jnp.array([1, 0, 2], jnp.int8)[sign_first * at.signs_q[0] + 1]
        crossing = (monotone | bent) & changes
        empty = (at.found > 0) & (at.places.times[jnp.minimum(at.found, room) - 1] == 0)
        place = at.found - (empty | (undecided & joins))
        found = undecided | crossing | touch | two
        begin = jnp.where(undecided, first, jnp.where(touch, turn, at.p))
        end = jnp.where(touch | two, turn, at.q)
        error = jnp.where(undecided, 0.5 * (at.q - first), jnp.where(touch, error, 0.0))
        new = _Places(
            begin,
            end,
            jnp.where(undecided, times, jnp.where(touch, jnp.int8(2), jnp.int8(1))),
            crossing | two,
            jnp.where(two, -at.signs_q[0], at.signs_q[0]),
            error,
        )
        second = _Places(turn, at.q, jnp.int8(1), jnp.bool_(True), at.signs_q[0], jnp.float64(0.0))

        # a box that cannot be halved stays whole on the levels below
        seen = (levels == at.level) | (left & whole & (levels >= at.level))
        count = at.count + seen.astype(at.count.dtype)
        taken = jnp.where(found, place + 1 + two, at.found)
        hopeless = jnp.any(count > width) | (taken > room)
        below = halve & (levels == at.level + 1)
        start = jnp.where(halve, at.start, at.start + (jnp.int64(END) >> at.level.astype(jnp.int64)))
        start = jnp.where(hopeless, END, start)
        level = jnp.where(halve, at.level + 1, (ISOLATE_DEPTH - lax.population_count((start & -start) - 1)).astype(jnp.int8))
        here, after = (numbers == place) & found, (numbers == place + 1) & two
        places = [jnp.where(after, b, jnp.where(here, a, old)) for a, b, old in zip(new, second, at.places, strict=True)]
        return _Search(
            start=start,
            level=level,
            p=jnp.where(halve, at.p, at.q),
            q=jnp.where(halve, m, at.ends[level]),
            signs_p=jnp.where(halve, at.signs_p, at.signs_q),
            signs_q=jnp.where(halve, _sign(jnp.stack([g, slope])), at.sign_ends[:, level]),
            ends=jnp.where(below, at.q, at.ends),
            sign_ends=jnp.where(below, at.signs_q[:, None], at.sign_ends),
            count=count,
            first=jnp.where(undecided, first, at.first),
            sign_first=jnp.where(undecided, sign_first, at.sign_first),
            last=jnp.where(undecided, at.q, at.last),
            found=taken,
            places=_Places(*places),
            note=at.note | note_box | note_middle | note_turn,
        )

    kinds = (jnp.float64, jnp.float64, jnp.int8, jnp.bool_, jnp.int8, jnp.float64)
    beginning = _Search(
        start=jnp.where(active, jnp.int64(0), END),
        level=jnp.int8(0),
        p=p,
        q=q,
        signs_p=signs[0],
        signs_q=signs[1],
        ends=jnp.zeros(ISOLATE_DEPTH + 1),
        sign_ends=jnp.zeros((2, ISOLATE_DEPTH + 1), jnp.int8),
        count=jnp.zeros(ISOLATE_DEPTH + 1, jnp.uint8 if width < 255 else jnp.int32),
        first=jnp.float64(0.0),
        sign_first=jnp.int8(0),
        last=jnp.float64(jnp.nan),
        found=jnp.int64(0),
        places=_Places(*(jnp.zeros(room, kind) for kind in kinds)),
        note=jnp.int32(0),
    )
    return lax.while_loop(lambda at: at.start < END, step, beginning)


class _Turned(NamedTuple):
    """Whether a box that turns is still to be looked at; whether g touches 0 there or has a root on either side; where, how far a tangency
    may be off, and the note."""

    waits: Any
    touch: Any
    two: Any
    turn: Any
    error: Any
    note: Any


def _turn(enclosure: Block, point: Block, turning: Scalar, at: _Search) -> _Turned:
    """What becomes of a box that turns. It is a loop of one step, which a batch makes only if one of its elements needs it."""

    def look(_: _Turned) -> _Turned:
        turn, note_steps = _crossing(point, 1, turning, at.p, at.q, at.signs_q[1])
        (g, _, curvature), note = vector(point(turn))
        *_, noise = vector(enclosure(turn, turn))[0]
        touch = (jnp.abs(g) <= noise) & jnp.isfinite(noise)
        two = ~touch & ((g > 0.0) != (at.signs_p[0] > 0))
        return _Turned(jnp.bool_(False), touch, two, turn, jnp.sqrt(2.0 * noise / jnp.abs(curvature)), note_steps | note)

    no = jnp.bool_(False)
    return lax.while_loop(lambda found: found.waits, look, _Turned(turning, no, no, at.p, jnp.float64(0.0), jnp.int32(0)))


def _sign(g: Scalar) -> Scalar:
    """1 for g > 0, -1 for g <= 0, 0 for NaN."""
    return jnp.where(g > 0.0, jnp.int8(1), jnp.where(g <= 0.0, jnp.int8(-1), jnp.int8(0)))


class _Newton(NamedTuple):
    """Newton's method at v in (p, q), with the sizes of its last two steps."""

    v: Any
    p: Any
    q: Any
    before: Any
    last: Any
    steps: Any
    done: Any
    note: Any


def _crossing(point: Block, order: int, active: Scalar, p: Scalar, q: Scalar, sign_q: Scalar) -> tuple[Scalar, Scalar]:
    """The zero of g (order 0) or of its slope (order 1) in a box, by Newton's method kept inside by bisection, and the note."""

    def step(at: _Newton) -> _Newton:
        values, note = vector(point(at.v))
        g, slope = values[order], values[order + 1]
        at_right = (g > 0.0) == (sign_q > 0)
        p, q = jnp.where(at_right, at.p, at.v), jnp.where(at_right, at.v, at.q)
        step, middle = -g / slope, 0.5 * (p + q)
        newton = (at.v + step >= p) & (at.v + step <= q) & (step != 0.0) & ~(jnp.abs(step) > 0.5 * at.before)
        v = jnp.where(g == 0.0, at.v, jnp.where(newton, at.v + step, middle))
        size = jnp.abs(jnp.where(newton, step, middle - at.v))
        done = (g == 0.0) | (size <= 2.0**-52 * jnp.abs(v))
        return _Newton(v, p, q, at.last, size, at.steps + 1, done, at.note | note)

    infinite = jnp.float64(jnp.inf)
    beginning = _Newton(0.5 * (p + q), p, q, infinite, infinite, jnp.int64(0), ~active, jnp.int32(0))
    end = lax.while_loop(lambda at: ~at.done & (at.steps < ISOLATE_STEPS), step, beginning)
    return end.v, end.note


class _Walk(NamedTuple):
    """A walk that is at the rectangle (left, right) × (bottom, top) of a level; -1 behind the last one.

    Level l has seen count[l] rectangles. On the level `waiting` (-1: on none) an upper half is still to come, then on
    waits[waiting] and so on up. When one of level l comes, the present rectangle ends where it begins; it has begin[l] as its
    beginning in the direction that was not halved, end[l] as its end in the other. `kept` has the intervals (left, right) of
    `found` rectangles of the last level, (ROW, 2), then +inf.
    """

    level: Any
    left: Any
    right: Any
    bottom: Any
    top: Any
    waiting: Any
    waits: Any
    begin: Any
    end: Any
    count: Any
    crowded: Any
    kept: Any
    found: Any
    note: Any


def locate(
    lo: Scalar, hi: Scalar, low: Scalar, high: Scalar, enclosure: Block, results: int, *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Scalar]:
    """The places v of common zeros in ascending order, then +inf; and the note."""
    lo, hi, low, high = (jnp.asarray(v, jnp.float64) for v in (lo, hi, low, high))
    active = when & jnp.all(jnp.isfinite(jnp.stack([lo, hi, low, high]))) & (lo != hi) & (low != high)
    whole = jnp.stack([jnp.minimum(lo, hi), jnp.maximum(lo, hi), jnp.minimum(low, high), jnp.maximum(low, high)])
    kept, crowded, note = _walk(active, whole, enclosure)
    # intervals of one level of bisection: in the order of their left ends their right ends ascend too
    left, right = lax.sort((kept[:, 0], kept[:, 1]), num_keys=2)
    begins = jnp.concatenate([jnp.array([True]), left[1:] > right[:-1]])  # the entries behind the last one, +inf, are one interval
    begin = jnp.searchsorted(jnp.cumsum(begins), jnp.arange(1, results + 2))
    ends = jnp.minimum(begin, left.size - 1)
    places = 0.5 * (left[ends[:-1]] + right[begin[1:] - 1])
    refused = ~active | crowded | jnp.isfinite(left[ends[results]])
    places = jnp.where(refused, jnp.inf, places)
    return tuple(places[i] for i in range(results)), note


def _walk(active: Scalar, whole: Any, enclosure: Block) -> tuple[Any, Scalar, Scalar]:
    """What of a rectangle is kept, intervals of v and +inf, (·, 2); whether a level has too many, and the note.

    Depth first, like `_search`: behind a rectangle that is not halved comes the one that waits on the deepest level.
    """
    levels, numbers = jnp.arange(LOCATE_DEPTH + 1, dtype=jnp.int8), jnp.arange(ROW)
    nothing = jnp.full((ROW, 2), jnp.inf)

    def step(at: _Walk) -> _Walk:
        left, right, bottom, top = at.left, at.right, at.bottom, at.top
        (f_least, f_most, g_least, g_most), note = vector(enclosure(left, right, bottom, top))
        away = (f_least > 0.0) | (f_most < 0.0) | (g_least > 0.0) | (g_most < 0.0)
        away |= (jnp.isnan(f_least) & jnp.isnan(f_most)) | (jnp.isnan(g_least) & jnp.isnan(g_most))
        keep = ~away & (at.level == LOCATE_DEPTH)
        halve = ~away & ~keep
        count = at.count + (levels == at.level).astype(jnp.int16)
        crowded = at.count[at.level] >= LOCATE_WIDTH
        level = jnp.where(halve, at.level + 1, at.waiting)
        across, was_across = at.level % 2 == 0, level % 2 == 1
        begin, end = at.begin[level], at.end[level]
        below = halve & (levels == at.level + 1)
        here = keep & (numbers == at.found)
        return _Walk(
            level=jnp.where(crowded, jnp.int8(-1), level),
            left=jnp.where(halve, left, jnp.where(was_across, right, begin)),
            right=jnp.where(halve, jnp.where(across, 0.5 * (left + right), right), jnp.where(was_across, end, right)),
            bottom=jnp.where(halve, bottom, jnp.where(was_across, begin, top)),
            top=jnp.where(halve, jnp.where(across, top, 0.5 * (bottom + top)), jnp.where(was_across, top, end)),
            waiting=jnp.where(halve, level, at.waits[level]),
            waits=jnp.where(below, at.waiting, at.waits),
            begin=jnp.where(below, jnp.where(across, bottom, left), at.begin),
            end=jnp.where(below, jnp.where(across, right, top), at.end),
            count=count,
            crowded=crowded,
            kept=jnp.where(here[:, None], jnp.stack([left, right]), at.kept),
            found=at.found + keep,
            note=at.note | note,
        )

    def fill(at: tuple[_Walk, Any, Any]) -> tuple[_Walk, Any, Any]:
        walk, rows, row = at
        walk = walk._replace(kept=nothing, found=jnp.int64(0))
        walk = lax.while_loop(lambda at: (at.level >= 0) & (at.found < ROW), step, walk)
        return walk, lax.dynamic_update_index_in_dim(rows, walk.kept, row, 0), row + 1

    beginning = _Walk(
        level=jnp.where(active, jnp.int8(0), jnp.int8(-1)),
        left=whole[0],
        right=whole[1],
        bottom=whole[2],
        top=whole[3],
        waiting=jnp.int8(-1),
        waits=jnp.zeros(LOCATE_DEPTH + 1, jnp.int8),
        begin=jnp.zeros(LOCATE_DEPTH + 1),
        end=jnp.zeros(LOCATE_DEPTH + 1),
        count=jnp.zeros(LOCATE_DEPTH + 1, jnp.int16),
        crowded=jnp.bool_(False),
        kept=nothing,
        found=jnp.int64(0),
        note=jnp.int32(0),
    )
    rows = jnp.full((LOCATE_WIDTH // ROW + 1, ROW, 2), jnp.inf)  # one more: some of the last one's entries are +inf
    end, rows, _ = lax.while_loop(lambda at: at[0].level >= 0, fill, (beginning, rows, jnp.int64(0)))
    return rows.reshape((-1, 2)), end.crowded, end.note
