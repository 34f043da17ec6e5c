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

from teg.backends.jax.entries import entries, stacked
from teg.backends.jax.runtime import CROWDED, MISSED, Note, Scalar, barrier, union, vector, where
from teg.backends.jax.while_loops import while_loop
from teg.backends.shared.roots import Ends, Halving, examined, excluded, newton_step, next_halving, plane_step, refuted, touches
from teg.program import (
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

Block = Callable[..., tuple[tuple[Scalar, ...], Note]]  # variables -> values, note

END = 2**ISOLATE_DEPTH
"""Where a box of the last level begins is counted from 0 to END."""
ROW = 32
"""Rectangles that are examined together: all that a search carries is copied at every step."""


NONE = ISOLATE_DEPTH + 1
"""The number of no level."""
LEFT_END, RIGHT_END, MIDDLE, TURNING, TURNED = range(5)
"""What a turn of a search looks at."""


class _Search(NamedTuple):
    """A search that is at the box (p, q), which begins at start/END; level l has seen count[l] boxes.

    In each turn g is enclosed once and computed once, for what `phase` says: at both ends of the whole, in the middle of a box, at a place
    where g may turn (of `newton`), or where it does. Of g and its slope at ends of boxes only the signs are kept: 1 for > 0, -1 for <= 0,
    0 for NaN. The box of level l that waits on the right of the present one, or of an ancestor, ends at ends[l], with the signs
    sign_ends[:, l]. The last undecided boxes begin at `first` and end at `last`. `found` places are taken.
    """

    phase: Any
    start: Any
    level: Any
    p: Any
    q: Any
    signs_p: Any
    signs_q: Any
    newton: Any
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
    bounds: tuple[Scalar, Scalar], enclosure: Block, point: Block, room: tuple[int, int], errors: tuple[float, bool], *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Scalar]:
    """The roots in ascending order, then +inf; behind them their errors, if they are asked for; and the note. There is `room` for so many
    roots, and so many boxes on a level; `errors`: how large they may be, and whether they are asked for."""
    (results, width), (tol, estimated) = room, errors
    lo, hi = (jnp.asarray(v, jnp.float64) for v in bounds)
    finite = jnp.isfinite(lo) & jnp.isfinite(hi)
    active = when & finite & (lo != hi)
    p, q = jnp.minimum(lo, hi), jnp.maximum(lo, hi)
    end = _search(active, p, q, enclosure, point, (results + 2, width))
    places = end.places
    there = jnp.arange(results + 2) < end.found
    searched, note_steps = jax.vmap(lambda *box: _crossing(point, *box))(there & places.crossing, places.p, places.q, places.sign_q)
    times = jnp.where(there, places.times, 0)
    root = jnp.where(places.crossing, searched, 0.5 * (places.p + places.q))
    both = [jnp.concatenate([jnp.where(times >= i, v, absent) for i in (1, 2)]) for v, absent in ((root, jnp.inf), (places.error, 0.0))]
    listed, off = (v[:results] for v in lax.sort(tuple(both), num_keys=1))
    crowded = active & (jnp.any(end.count > width) | (end.found > results + 2) | (jnp.sum(times) > results))
    missed = active & ~crowded & jnp.any(off > tol * jnp.abs(hi - lo))
    refused = when & (~finite | crowded)
    found = [jnp.where(when, jnp.where(refused, jnp.nan, v), jnp.inf) for v in ((listed, off) if estimated else (listed,))]
    noted = jnp.where(crowded, jnp.int32(CROWDED), jnp.int32(0)) | jnp.where(missed, jnp.int32(MISSED), jnp.int32(0))
    return tuple(n for v in found for n in entries(v)), end.note | union(note_steps) | noted


def sum_over(points: tuple[Scalar, ...], body: Block, results: int, *, when: Scalar = True) -> tuple[tuple[Scalar, ...], Scalar]:
    """The sums of the body's values over the points that are finite, and the note."""
    if not points:
        return (jnp.float64(0.0),) * results, jnp.int32(0)
    at = stacked(points)
    unknown = jnp.any(jnp.isnan(at))
    there = when & ~unknown & jnp.isfinite(at)
    found, note = jax.vmap(lambda x: vector(body(x)))(jnp.where(there, at, jnp.nan))  # at NaN, searches end at once
    sums = jnp.sum(jnp.where(there[:, None], found, 0.0), axis=0)
    sums = jnp.where(when & unknown, jnp.nan, sums)
    return entries(sums), union(where(there, note))


def _search(active: Scalar, p: Scalar, q: Scalar, enclosure: Block, point: Block, room: tuple[int, int]) -> _Search:
    """The search of the box (p, q), at its end or where it is known to be hopeless, with places for so many finds and boxes a level.

    No stack is needed to know where the search stands: behind a box that ends at u/END, the next one
    waiting is the largest dyadic one that begins there, whose level is told by the lowest bit of u.
    """

    def step(at: _Search) -> _Search:
        m, turned, going = 0.5 * (at.p + at.q), at.phase == TURNED, at.start < END
        v = jnp.where(at.phase == MIDDLE, m, jnp.where(at.phase >= TURNING, at.newton.v, jnp.where(at.phase == LEFT_END, at.p, at.q)))
        bounds, note_box = vector(enclosure(jnp.where(turned, v, at.p), jnp.where(turned, v, at.q)))
        values, note = vector(point(v))
        turning, box = _judged(at, m, v, bounds, values)
        advances = going & (((at.phase == MIDDLE) & ~turning) | turned)
        moved = _advanced(at, m, values, box, advances, room)
        done, newton = _turning(at, values)
        phase = jnp.where(at.phase == TURNING, jnp.where(done, TURNED, TURNING), jnp.where(turning, TURNING, MIDDLE))
        sign = _sign(values[:2])
        return moved._replace(
            phase=jnp.where(at.phase == LEFT_END, RIGHT_END, phase).astype(jnp.int8),
            signs_p=jnp.where(at.phase == LEFT_END, sign, moved.signs_p),
            signs_q=jnp.where(at.phase == RIGHT_END, sign, moved.signs_q),
            newton=newton,
            note=at.note | where(going, note_box | note),
        )

    kinds = (jnp.float64, jnp.float64, jnp.int8, jnp.bool_, jnp.int8, jnp.float64)
    levels = ISOLATE_DEPTH + 1
    beginning = _Search(
        phase=jnp.int8(LEFT_END),
        start=jnp.where(active, jnp.int64(0), END),
        level=jnp.int8(0),
        p=p,
        q=q,
        signs_p=jnp.zeros(2, jnp.int8),
        signs_q=jnp.zeros(2, jnp.int8),
        newton=_Newton.between(p, q, jnp.bool_(False)),
        ends=jnp.zeros(levels),
        sign_ends=jnp.zeros((2, levels), jnp.int8),
        count=jnp.zeros(levels, jnp.uint8 if room[1] < 255 else jnp.int32),
        first=jnp.float64(0.0),
        sign_first=jnp.int8(0),
        last=jnp.float64(jnp.nan),
        found=jnp.int64(0),
        places=_Places(*(jnp.zeros(room[0], kind) for kind in kinds)),
        note=jnp.int32(0),
    )
    return while_loop(lambda at: at.start < END, step, beginning, rests=True)


def _turning(at: _Search, values: Any) -> tuple[Scalar, _Newton]:
    """Newton's method for the place where g turns, in its box: whether it is at its end, and its next step or its first."""
    stepped = at.newton.stepped(values[1], values[2], at.signs_q[1] > 0)
    first = _Newton.between(at.p, at.q, jnp.bool_(False))
    newton = _Newton(*(jnp.where(at.phase == TURNING, a, b) for a, b in zip(stepped, first, strict=True)))
    return stepped.done | (stepped.steps >= ISOLATE_STEPS), newton


class _Verdict(NamedTuple):
    """What is to be done with a box: it is halved, or `undecided` (so small that it is `whole`), or has a crossing, a tangency at v, or two
    roots beside v; `error` is how far the tangency may be off."""

    left: Any
    whole: Any
    undecided: Any
    crossing: Any
    touch: Any
    two: Any
    v: Any
    error: Any


def _judged(at: _Search, m: Scalar, v: Scalar, bounds: Any, values: Any) -> tuple[Scalar, _Verdict]:
    """Whether g may turn in the box, by the bounds and the values in its middle m; and the verdict, if it does not, or if these are those
    at the place v where it turns."""
    (g, slope, curvature), middle = values, at.phase == MIDDLE
    changes, turns = at.signs_p * at.signs_q < 0
    ends = Ends(changes, *(at.signs_p * at.signs_q != 0))
    monotone, bent, left, blurred = examined(jnp, bounds, (g, slope), 0.5 * (at.q - at.p), ends)
    turning = middle & bent & ~changes & turns & ((at.signs_p[0] > 0) == (bounds[4] > 0.0))
    touch, error = touches(jnp, g, curvature, bounds[-1])
    touch = touch & ~middle
    two = ~middle & ~touch & ((g > 0.0) != (at.signs_p[0] > 0))
    whole = (m <= at.p) | (m >= at.q)
    undecided = middle & left & (whole | (at.level == ISOLATE_DEPTH) | blurred)
    return turning, _Verdict(middle & left, whole, undecided, middle & (monotone | bent) & changes, touch, two, v, error)


def _advanced(at: _Search, m: Scalar, values: Any, box: _Verdict, advances: Scalar, room: tuple[int, int]) -> _Search:
    """The search behind a box, if it `advances`: at its left half, or at the next box that waits. Entries of arrays are chosen by their
    numbers, of which none is NONE: a select by a condition for the whole array would be compiled as two loops."""
    levels = jnp.arange(ISOLATE_DEPTH + 1, dtype=jnp.int8)
    at = _listed(at, box, advances, room[0])
    halve = box.left & ~box.undecided
    # a box that cannot be halved stays whole on the levels below
    lowest = jnp.where(box.left & box.whole, jnp.int8(ISOLATE_DEPTH), at.level)
    count = at.count + ((levels >= jnp.where(advances, at.level, NONE)) & (levels <= lowest)).astype(at.count.dtype)
    hopeless = jnp.any(count > room[1]) | (at.found > room[0])
    below = levels == jnp.where(advances & halve, at.level + 1, NONE)
    start = jnp.where(halve, at.start, at.start + (jnp.int64(END) >> at.level.astype(jnp.int64)))
    start = jnp.where(hopeless, END, start)
    level = jnp.where(halve, at.level + 1, (ISOLATE_DEPTH - lax.population_count((start & -start) - 1)).astype(jnp.int8))
    waiting = levels == level
    q = jnp.where(halve, m, jnp.sum(jnp.where(waiting, at.ends, 0.0)))
    signs_q = jnp.where(halve, _sign(values[:2]), jnp.sum(jnp.where(waiting, at.sign_ends, 0), axis=1, dtype=jnp.int8))
    return at._replace(
        start=jnp.where(advances, start, at.start),
        level=jnp.where(advances, level, at.level),
        p=jnp.where(advances & ~halve, at.q, at.p),
        q=jnp.where(advances, q, at.q),
        signs_p=jnp.where(advances & ~halve, at.signs_q, at.signs_p),
        signs_q=jnp.where(advances, signs_q, at.signs_q),
        ends=jnp.where(below, at.q, at.ends),
        sign_ends=jnp.where(below, at.signs_q[:, None], at.sign_ends),
        count=count,
    )


def _listed(at: _Search, box: _Verdict, advances: Scalar, room: int) -> _Search:
    """The search with what was found in a box in its places, if it `advances`."""
    numbers, undecided = jnp.arange(room), advances & box.undecided
    joins = at.last == at.p
    first, sign_first = jnp.where(joins, at.first, at.p), jnp.where(joins, at.sign_first, at.signs_p[0])
    times = (2 - (sign_first * at.signs_q[0] + 2) % 3).astype(jnp.int8)  # 1, 0, 2 for -1, 0, 1
    empty = (at.found > 0) & jnp.any((numbers == jnp.minimum(at.found, room) - 1) & (at.places.times == 0))
    place = at.found - (empty | (undecided & joins))
    found = advances & (box.undecided | box.crossing | box.touch | box.two)
    new = _Places(
        jnp.where(undecided, first, jnp.where(box.touch, box.v, at.p)),
        jnp.where(box.touch | box.two, box.v, at.q),
        jnp.where(undecided, times, jnp.where(box.touch, jnp.int8(2), jnp.int8(1))),
        box.crossing | box.two,
        jnp.where(box.two, -at.signs_q[0], at.signs_q[0]),
        jnp.where(undecided, 0.5 * (at.q - first), jnp.where(box.touch, box.error, 0.0)),
    )
    second = _Places(box.v, at.q, jnp.int8(1), jnp.bool_(True), at.signs_q[0], jnp.float64(0.0))
    here, after = numbers == jnp.where(found, place, room), numbers == jnp.where(found & box.two, place + 1, room)
    places = [jnp.where(after, b, jnp.where(here, a, old)) for a, b, old in zip(new, second, at.places, strict=True)]
    return at._replace(
        first=jnp.where(undecided, first, at.first),
        sign_first=jnp.where(undecided, sign_first, at.sign_first),
        last=jnp.where(undecided, at.q, at.last),
        found=jnp.where(found, place + 1 + box.two, at.found),
        places=_Places(*places),
    )


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

    @classmethod
    def between(cls, p: Scalar, q: Scalar, done: Scalar) -> _Newton:
        """Its beginning."""
        infinite = jnp.float64(jnp.inf)
        return cls(0.5 * (p + q), p, q, infinite, infinite, jnp.int64(0), done)

    def stepped(self, g: Scalar, slope: Scalar, above: Scalar) -> _Newton:
        """After a step, kept inside by bisection; g > 0 at q if `above`."""
        v, p, q, size, done = newton_step(jnp, (g, slope), self.v, (self.p, self.q), above, self.before)
        return _Newton(v, p, q, self.last, size, self.steps + 1, done)


def _crossing(point: Block, active: Scalar, p: Scalar, q: Scalar, sign_q: Scalar) -> tuple[Scalar, Scalar]:
    """The zero of g in a box, by Newton's method, and the note."""

    def goes_on(carried: tuple[_Newton, Any]) -> Any:
        return ~carried[0].done & (carried[0].steps < ISOLATE_STEPS)

    def step(carried: tuple[_Newton, Any]) -> tuple[_Newton, Any]:
        at, noted = carried
        values, note = vector(point(at.v))
        going, new = goes_on(carried), at.stepped(values[0], values[1], sign_q > 0)
        return new._replace(v=jnp.where(going, new.v, at.v), done=at.done | new.done), noted | where(going, note)

    end, note = while_loop(goes_on, step, (_Newton.between(p, q, ~active), jnp.int32(0)), rests=True)
    return end.v, note


class _Level(NamedTuple):
    """A search that is at the rectangle number `taken` of `number` on a level: halves of those that were left of the level before.

    What is left of a level and of the next one are two rows of `corners`, in parts of the whole, (2, LOCATE_WIDTH + ROW, 2), by turns.
    `zeros` are the middles of rectangles that hold one zero, `found` of them.
    """

    level: Any
    halving: Any
    number: Any
    taken: Any
    left: Any
    examined: Any
    found: Any
    corners: Any
    zeros: Any
    note: Any


def locate(
    limits: tuple[Scalar, ...], enclosure: Block, counts: tuple[int, int], *, when: Scalar = True
) -> tuple[tuple[Scalar, ...], Scalar]:
    """The places v of common zeros in ascending order, then +inf; the part of the rectangle that was given up; and the note. `limits`: of
    v, then of u; `counts`: of results, and of bounds that the enclosure gives."""
    results, sloped = counts[0], counts[1] > 4
    lo, hi, low, high = (jnp.asarray(v, jnp.float64) for v in limits)
    active = when & jnp.all(jnp.isfinite(jnp.stack([lo, hi, low, high]))) & (lo != hi) & (low != high)
    origin = jnp.stack([jnp.minimum(lo, hi), jnp.minimum(low, high)])
    extent = jnp.stack([jnp.abs(hi - lo), jnp.abs(high - low)])
    each: Any = jax.vmap(lambda v, w, u, z: vector(enclosure(v, w, u, z)))

    def bounds(near: Any, far: Any) -> tuple[Any, Note]:
        # without a barrier XLA moves reshapes to and fro
        found: tuple[Any, Note] = each(*barrier(near[:, 0], far[:, 0], near[:, 1], far[:, 1]))
        return found

    end = _levels(active, origin, extent, bounds, sloped)
    zeros, note = _settled(end.zeros, end.found, bounds) if sloped else (end.zeros[:, 0], jnp.int32(0))
    width = _widths(end.halving.times)
    waiting = jnp.arange(LOCATE_WIDTH) < end.left
    across = jnp.where(waiting, end.corners[(end.level % 2).astype(jnp.int32), :LOCATE_WIDTH, 0], jnp.inf)
    same = LOCATE_SAME * extent[0]
    lefts = jnp.concatenate([zeros - same, origin[0] + extent[0] * across])
    rights = jnp.concatenate([zeros + same, origin[0] + extent[0] * (across + width[0])])
    many = end.found > LOCATE_ZEROS
    rectangles = jnp.concatenate([jnp.zeros(zeros.size), jnp.ones(across.size)])
    listed, inside = _joined(jnp.where(many, jnp.inf, lefts), jnp.where(many, jnp.inf, rights), rectangles, extent[0], results)
    behind = jnp.where(jnp.isfinite(listed[results]), jnp.maximum(0.0, (origin[0] + extent[0] - listed[results - 1]) / extent[0]), 0.0)
    lost = jnp.where(many, 1.0, jnp.minimum(1.0, inside * (width[0] * width[1]) + behind))
    lost = jnp.where(active, lost, 0.0)
    places = jnp.where(active, listed[:results], jnp.inf)
    note = where(active, end.note | note) | where(lost > LOCATE_LOST, MISSED)
    return (*entries(places), lost), note


def _widths(times: Any) -> Any:
    """The sides of rectangles that were halved so often, in parts of the whole."""
    return jnp.asarray([0.5**i for i in range(LOCATE_HALVINGS + 1)])[times]  # `exp2` is not exact


def _levels(active: Scalar, origin: Any, extent: Any, bounds: Callable[[Any, Any], tuple[Any, Note]], sloped: bool) -> _Level:
    """The search, at its end: ROW rectangles at a time, level by level. With `sloped`, bounds have those of slopes."""
    lanes, nothing = jnp.arange(ROW, dtype=jnp.int32), jnp.int32(0)

    def step(at: _Level) -> _Level:
        width, now = _widths(at.halving.times), at.level % 2
        parents = lax.dynamic_slice(at.corners, (1 - now, at.taken // 2, nothing), (1, ROW // 2, 2))[0]
        half = jnp.where(jnp.arange(2) == at.halving.last, width, 0.0)
        corner = jnp.repeat(parents, 2, axis=0) + jnp.where(lanes[:, None] % 2 == 1, half, 0.0)
        there = at.taken + lanes < at.number
        near, far = origin + extent * corner, origin + extent * (corner + width)
        middle, single = 0.5 * (near + far), jnp.zeros(ROW, jnp.bool_)
        if sloped:
            found, notes = bounds(jnp.concatenate([near, middle]), jnp.concatenate([far, middle]))
            over, values, note, more = found[:ROW], found[ROW:], notes[:ROW], notes[ROW:]
        else:
            over, note = bounds(near, far)
        kept = there & ~excluded(jnp, over.T[:4])
        if sloped:
            away, single = refuted(jnp, over.T, values[:, ::2].T, 0.5 * (far - near).T)
            note, kept, single = jnp.where(kept, note | more, note), kept & ~away & ~single, kept & single
        packed = corner[jnp.argsort(~kept, stable=True)]
        zeros = jnp.where(jnp.arange(ROW)[:, None] < jnp.sum(single), middle[jnp.argsort(~single, stable=True)], jnp.inf)
        left, found = (count + jnp.sum(new, dtype=jnp.int32) for count, new in ((at.left, kept), (at.found, single)))
        last = at.taken + ROW >= at.number
        twice = 2 * left
        full = (twice > LOCATE_WIDTH) | (at.examined + twice > LOCATE_MOST) | (found > LOCATE_ZEROS)
        goes_on = last & (twice > 0) & ~full & jnp.any(at.halving.times < LOCATE_HALVINGS)
        halving = next_halving(jnp, at.halving, at.number, left)
        halving = halving._replace(times=at.halving.times + (jnp.arange(2) == halving.last))
        return _Level(
            level=jnp.where(goes_on, at.level + 1, at.level),
            halving=Halving(*(jnp.where(goes_on, new, old) for new, old in zip(halving, at.halving, strict=True))),
            number=jnp.where(goes_on, twice, jnp.where(last, 0, at.number)),
            taken=jnp.where(last, 0, at.taken + ROW),
            left=jnp.where(goes_on, 0, left),
            examined=jnp.where(goes_on, at.examined + twice, at.examined),
            found=found,
            corners=lax.dynamic_update_slice(at.corners, packed[None], (now, at.left, nothing)),
            zeros=lax.dynamic_update_slice(at.zeros, zeros, (jnp.minimum(at.found, LOCATE_ZEROS), nothing)),
            note=at.note | union(where(there, note)),
        )

    beginning = _Level(
        level=nothing,
        halving=Halving(jnp.zeros(2, jnp.int32), jnp.int32(-1), jnp.zeros(2, jnp.bool_), jnp.zeros(2, jnp.bool_)),
        number=jnp.where(active, jnp.int32(1), nothing),
        taken=nothing,
        left=nothing,
        examined=jnp.int32(1),
        found=nothing,
        corners=jnp.zeros((2, LOCATE_WIDTH + ROW, 2)),
        zeros=jnp.full((LOCATE_ZEROS + ROW, 2), jnp.inf),
        note=jnp.int32(0),
    )
    return while_loop(lambda at: at.number > 0, step, beginning, rests=True)  # nothing more is left, and what is not is not read


def _settled(zeros: Any, found: Scalar, bounds: Callable[[Any, Any], tuple[Any, Note]]) -> tuple[Any, Note]:
    """The v of zeros near points (v, u), by Newton's method, ROW at a time, +inf for those that are not there; and the note."""

    def block(at: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        row, placed, note = at
        near = lax.dynamic_slice(zeros, (row, jnp.int32(0)), (ROW, 2))
        there = jnp.isfinite(near[:, 0])

        def step(_: Any, carried: tuple[Any, Any]) -> tuple[Any, Any]:
            near, note = carried
            values, more = bounds(near, near)
            return near - plane_step(jnp, values[:, ::2].T).T, note | union(where(there, more))

        near, note = lax.fori_loop(0, LOCATE_STEPS, step, (near, note))
        return row + ROW, lax.dynamic_update_slice(placed, jnp.where(there, near[:, 0], jnp.inf), (row,)), note

    _, placed, note = while_loop(lambda at: at[0] < found, block, (jnp.int32(0), zeros[:, 0], jnp.int32(0)), rests=True)
    return placed, note


def _joined(left: Any, right: Any, rectangles: Any, extent: Scalar, results: int) -> tuple[Any, Scalar]:
    """The first results + 1 places, ascending, of intervals of which those are joined that overlap or touch: the middle of a narrow one,
    both ends of another; and how many rectangles are in these. Both ends are sorted by themselves: an interval begins a new place where as
    many intervals ended before it as began; the entries behind the last one, +inf, are one interval."""
    left, rectangles = lax.sort((left, rectangles), num_keys=1)
    right = jnp.sort(right)
    begins = jnp.concatenate([jnp.array([True]), left[1:] > right[:-1]])
    begin = jnp.searchsorted(jnp.cumsum(begins), jnp.arange(1, results + 3))
    before = jnp.concatenate([jnp.zeros(1), jnp.cumsum(rectangles)])
    from_, to = left[jnp.minimum(begin[:-1], left.size - 1)], right[begin[1:] - 1]
    absent = (begin[:-1] >= left.size) | jnp.isinf(from_)
    wide = ~absent & (to - from_ > LOCATE_NARROW * extent)
    first = jnp.where(absent, jnp.inf, jnp.where(wide, from_, 0.5 * (from_ + to)))
    inside = jnp.sum(jnp.where(wide, before[begin[1:]] - before[begin[:-1]], 0.0))
    return jnp.sort(jnp.concatenate([first, jnp.where(wide, to, jnp.inf)])), inside
