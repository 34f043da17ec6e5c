"""The lines on which the borders of cells lie (`teg.backends.shared.cells`), for NumPy and JAX.

Lines within EPSILON of each other in the square are made one here: they get the same numbers, and `same` says so. What is decided about
one of them later is then decided for all. Nothing is compared with itself computed twice: XLA may round one product in two ways.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from teg.numerics.cells import EPSILON, ROUNDING, SIDES, Layout

PARALLEL = 1e-6
"""The sine of the angle below which lines may be one."""
FLAT = 1e-14
"""The sine of the angle below which lines are parallel: far above its rounding, which may differ from one use of a number to the next."""
SIDE = len(SIDES)


class Setting(NamedTuple):
    """The array module, the layout, and the number of candidates of a lane."""

    xp: Any
    shape: Layout
    candidates: int

    @property
    def regions(self) -> int:
        return self.candidates * self.shape.parts

    @property
    def pairs(self) -> list[tuple[int, int]]:
        return list(combinations(range(self.candidates), 2))

    @property
    def guarded(self) -> np.ndarray[Any, Any]:
        """The region of each guard."""
        return np.repeat(np.arange(self.regions), self.shape.guards)


class Scene(NamedTuple):
    """Guards (n, regions·guards, 3), 1 where they do not cut; regions that may be `seen`, (n, regions); keys (n, K, 3).

    Keys that are equal everywhere are the same here: equal (n, K, K) is 1 for such pairs, else 0. place (n, K): the number of each
    candidate from the front; lost (n,): whether forms are not finite.
    """

    guards: Any
    seen: Any
    keys: Any
    equal: Any
    place: Any
    lost: Any


class Lines(NamedTuple):
    """All lines of a lane: sides, guards, pairs of keys.

    unit (n, N, 3), those of one line the same but for their sign; size (n, N) of the forms; valid (n, N); same (n, N, N): which are one
    line; turned (n, N): ±1 by the sign; on_side (n, N): whether it is a side of the square, of others than these; first and last (n, N)
    along (-b, a).
    """

    unit: Any
    size: Any
    valid: Any
    same: Any
    turned: Any
    on_side: Any
    first: Any
    last: Any


def _length(xp: Any, forms: Any) -> Any:
    """Returns |(a, b)|, whose derivative is 0 where it is 0."""
    squared = forms[..., 1] * forms[..., 1] + forms[..., 2] * forms[..., 2]
    return xp.where(squared > 0.0, xp.sqrt(xp.where(squared > 0.0, squared, 1.0)), xp.where(squared == 0.0, 0.0, np.nan))


def _range(xp: Any, forms: Any) -> tuple[Any, Any]:
    """Returns the least and the largest value of forms on the square."""
    c, a, b = forms[..., 0], forms[..., 1], forms[..., 2]
    return c + xp.minimum(a, 0.0) + xp.minimum(b, 0.0), c + xp.maximum(a, 0.0) + xp.maximum(b, 0.0)


def scene_of(s: Setting, forms: Any, live: Any) -> Scene:
    xp, shape = s.xp, s.shape
    n = len(forms)
    guards = forms[..., :-3].reshape(n, s.regions, shape.guards, 3)
    size = _length(xp, guards)
    least, most = _range(xp, guards)
    absent = ((most < -EPSILON * size) | ((size == 0.0) & (guards[..., 0] < 0.0))).any(axis=2)
    seen = xp.repeat(live, shape.parts, axis=1) & ~absent
    there = seen.reshape(n, s.candidates, shape.parts).any(axis=2)
    lost = (seen & ~xp.isfinite(guards).all(axis=(2, 3))).any(axis=1) | (there & ~xp.isfinite(forms[..., -3:]).all(axis=2)).any(axis=1)
    cutting = seen[..., None] & (least <= EPSILON * size) & (size > 0.0) & ~lost[:, None, None]
    guards = xp.where(cutting[..., None], guards, np.array([1.0, 0.0, 0.0])).reshape(n, -1, 3)
    keys = xp.where((there & ~lost[:, None])[..., None], forms[..., -3:], 0.0)
    least, most = _range(xp, keys[:, :, None] - keys[:, None])
    tolerance = _tolerance(xp, keys)
    equal = (most <= tolerance) & (least >= -tolerance) & there[:, :, None] & there[:, None] | np.eye(s.candidates, dtype=bool)
    first = xp.argmax(equal, axis=2)
    keys = xp.take_along_axis(keys, first[..., None], axis=1)
    middle = keys[..., 0] + 0.5 * keys[..., 1] + 0.5 * keys[..., 2]
    before = (middle[:, None] < middle[:, :, None]) | ((middle[:, None] == middle[:, :, None]) & np.tri(s.candidates, k=-1, dtype=bool))
    return Scene(guards, seen, keys, 1.0 * (first[:, :, None] == first[:, None]), before.sum(axis=2), lost)


def _tolerance(xp: Any, keys: Any) -> Any:
    """Returns the values below which differences of two keys count as 0."""
    scale = xp.abs(keys[..., 0])
    return EPSILON * _length(xp, keys[:, :, None] - keys[:, None]) + ROUNDING * xp.maximum(scale[:, :, None], scale[:, None])


def lines_of(s: Setting, scene: Scene) -> Lines:
    """Returns all lines; those within EPSILON of another one get the numbers of that one."""
    xp, n = s.xp, len(scene.keys)
    one, two = (np.array([p[i] for p in s.pairs], dtype=int) for i in (0, 1))
    difference = scene.keys[:, one] - scene.keys[:, two]
    least, most = _range(xp, difference)
    tolerance = _tolerance(xp, scene.keys)[:, one, two]
    sides = xp.broadcast_to(xp.asarray(np.array(SIDES)), (n, SIDE, 3))
    forms = xp.concatenate([sides, scene.guards, difference], axis=1)
    size = _length(xp, forms)
    there = scene.seen.reshape(n, s.candidates, s.shape.parts).any(axis=2)
    meeting = there[:, one] & there[:, two] & ~((least > tolerance) | (most < -tolerance))
    valid = (size > 0.0) & xp.concatenate([xp.ones((n, SIDE + scene.guards.shape[1]), bool), meeting], axis=1)
    size = xp.where(valid, size, 1.0)
    unit = xp.where(valid[..., None], forms / size[..., None], np.array([1.0, 0.0, 0.0]))
    first, last = _chord(xp, unit, xp.zeros((*unit.shape[:2], SIDE), bool))
    near, dot = _near(xp, unit, valid, (first, last))
    stand = xp.argmin(xp.where(near, ranks_of(s, scene)[:, None, :], np.inf), axis=2)
    for _ in range(2):
        stand = xp.take_along_axis(stand, stand, axis=1)
    turned = xp.where(xp.take_along_axis(dot, stand[..., None], axis=2)[..., 0] < 0.0, -1.0, 1.0)
    unit = turned[..., None] * xp.take_along_axis(unit, stand[..., None], axis=1)
    same = (stand[:, :, None] == stand[:, None, :]) & valid[:, :, None] & valid[:, None, :]
    first, last = _chord(xp, unit, same[..., :SIDE])
    on_side = same[..., :SIDE].any(axis=2) & (np.arange(unit.shape[1]) >= SIDE)
    return Lines(unit, size, valid, same, turned, on_side, first, xp.where(valid, xp.maximum(first, last), first))


def ranks_of(s: Setting, scene: Scene) -> Any:
    """Returns the order of lines in which the first of several that coincide counts: sides, guards from the front to the back, keys."""
    xp, each = s.xp, s.shape.parts * s.shape.guards
    n = len(scene.place)
    guards = SIDE + (scene.place[..., None] * each + np.arange(each)).reshape(n, -1)
    keys = SIDE + s.candidates * each + np.arange(len(s.pairs))
    wide = [xp.broadcast_to(xp.asarray(v), (n, len(v))) for v in (np.arange(SIDE), keys)]
    return 1.0 * xp.concatenate([wide[0], guards, wide[1]], axis=1)


def between(line: Any, other: Any) -> tuple[Any, Any, Any]:
    """Returns forms on lines, α + β·t at the point t·(-b, a) - c·(a, b); and the cosine of their angle. Units are (…, 3)."""
    c, a, b = (line[..., i] for i in range(3))
    d, e, f = (other[..., i] for i in range(3))
    dot = a * e + b * f
    return d - c * dot, a * f - b * e, dot


def _chord(xp: Any, unit: Any, same: Any) -> tuple[Any, Any]:
    """Returns where lines enter and leave the square, whose sides that are the `same` line do not count; last < first outside."""
    start, slope, _ = between(unit[:, :, None], xp.asarray(np.array(SIDES)))
    at = -start / xp.where(xp.abs(slope) <= FLAT, 1.0, slope)
    first = xp.where((slope > FLAT) & ~same, at, -4.0).max(axis=2)
    last = xp.where((slope < -FLAT) & ~same, at, 4.0).min(axis=2)
    outside = ((xp.abs(slope) <= FLAT) & (start < 0.0) & ~same).any(axis=2)
    return first, xp.where(outside, first - 1.0, last)


def _near(xp: Any, unit: Any, valid: Any, chord: tuple[Any, Any]) -> tuple[Any, Any]:
    """Returns which lines are within EPSILON of each other in the square, and the cosines of their angles."""
    start, slope, dot = between(unit[:, :, None], unit[:, None])
    first, last = (v[..., None] for v in chord)
    close = (xp.abs(start + slope * first) <= EPSILON) & (xp.abs(start + slope * last) <= EPSILON) & (xp.abs(slope) <= PARALLEL)
    close = close & valid[:, :, None] & valid[:, None, :]
    is_side = np.arange(unit.shape[1]) < SIDE
    either = is_side[:, None] | is_side[None, :]
    both = xp.where(either, close | xp.swapaxes(close, 1, 2), close & xp.swapaxes(close, 1, 2))
    return (both & ~(is_side[:, None] & is_side[None, :])) | np.eye(len(is_side), dtype=bool), dot
