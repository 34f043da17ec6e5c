"""Integrals of the polynomial of the nearest candidate (`teg.numerics.cells`) with static shapes, for NumPy and JAX.

Boxes are lanes, (n, …), with a fixed number of candidates each. No cells are made, because their number is data. All borders of cells lie
on lines whose number is fixed: the sides of the square, the lines of guards, and those where the keys of two candidates are equal.

    each line      is cut where candidates begin or end on it, and where two keys are equal
    each interval  has an owner on either side: the nearest candidate in the middle; what lies on the line itself is decided by its slope
    moments        of an owner: ∫∫ of a monomial of degree d  =  Σ ±c ∫ of it ds/(d + 2) over its border on c + a·u + b·v, |(a, b)| = 1
    derivatives    by a form: Σ ±∫ f_owner·(1, u, v) ds/|(a, b)| over the intervals that the form bounds

Lines within EPSILON of each other are made one before anything is decided, so all decisions about them agree. An interval of such lines
belongs to the first one that bounds its owner there. On a side of the square, derivatives are half of those inside: the mean of moving each
one by itself both ways.

Every owner's border must be closed. Where rounding decides differently on two lines that nearly coincide it is not, and the lane is NaN.
Cost: lines · intervals · candidates in each lane, about K⁵ numbers for K candidates. Source: divergence theorem for homogeneous integrands
(Lasserre 1998), over the arrangement line by line.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from teg.backends.shared.cell_lines import FLAT, SIDE, Lines, Scene, Setting, between, lines_of, ranks_of, scene_of
from teg.numerics.cells import Layout, monomials

CLOSED = 1e-9
"""The most by which the border of an owner may fail to close; the side of the square is 1."""
LINES = 100
"""The most lines of a lane for which this is worth its cost."""


def line_count(shape: Layout, candidates: int) -> int:
    """Returns how many lines a lane has."""
    return SIDE + candidates * shape.parts * shape.guards + candidates * (candidates - 1) // 2


def most_candidates(shape: Layout) -> int:
    """Returns with how many candidates a lane has no more than LINES lines: 11 triangles, 14 cells of a power diagram."""
    return max(k for k in range(LINES) if line_count(shape, k) <= LINES)


class Intervals(NamedTuple):
    """ends (n, N, T + 1) on lines; owners on the positive and on the negative side, 0 or 1 (n, N, T, K + 1), the last one for no owner;
    inside (n, N, T, regions): which regions are on the line there."""

    ends: Any
    positive: Any
    negative: Any
    inside: Any


class Integrated(NamedTuple):
    """Values (n, bodies); tables (n, bodies, K + 1, columns); gaps (n, 3·(K + 1)), 0 where borders are closed; lengths of borders
    (n, lines·(K + 1)); lost (n,): whether forms are not finite."""

    values: Any
    tables: Any
    gaps: Any
    lengths: Any
    lost: Any


def integrals_of_lanes(xp: Any, shape: Layout, rows: Any, live: Any, otherwise: Any) -> tuple[Any, Any]:
    """Returns the integrals (n, bodies), and their derivatives by all numbers of candidates, (n, bodies, K + 1, columns).

    `rows` (n, K, numbers) are the candidates, those that are not `live` (n, K) anything; `otherwise` (n, coefficients of all bodies) what
    counts where there is none. Directions (`shape.order` 1) are no part of it: they are derivatives of `integrated`.
    """
    done = integrated(xp, shape, rows, live, otherwise)
    unknown = (done.lost | ~(xp.abs(done.gaps).max(axis=1) <= CLOSED))[:, None]
    return xp.where(unknown, np.nan, done.values), xp.where(unknown[..., None, None], np.nan, done.tables)


def integrated(xp: Any, shape: Layout, rows: Any, live: Any, otherwise: Any) -> Integrated:
    """Returns the integrals, whether their borders are closed or not."""
    s = Setting(xp, shape, rows.shape[1])
    scene = scene_of(s, rows[..., : shape.forms], live)
    lines = lines_of(s, scene)
    intervals = _intervals(s, scene, lines)
    counted = _counted(s, scene, lines, intervals)
    powers = _powers(xp, intervals.ends, shape.degree + 2)
    sides = intervals.positive, _inside_square(xp, intervals.negative)
    border = [xp.einsum("znt,zntk,zntp->znkp", counted, side, powers) for side in sides]
    border = xp.einsum("mznp,znkp->znkm", _on_lines(xp, lines.unit, shape.degree + 1), border[0] - border[1])
    moments, gaps = _moments(s, lines.unit, xp.where(lines.on_side, 0.0, 1.0)[..., None, None] * border)
    visible = xp.einsum("znt,zntk->zk", counted * (powers[..., 0] > 0.0), sides[0] + sides[1]) > 0.0
    own = xp.concatenate([rows[..., shape.forms :], otherwise[:, None]], axis=1)
    own = xp.where(visible[..., None], own, 0.0).reshape(*own.shape[:2], -1, shape.coefficients)
    values = xp.einsum("zkbm,zkm->zb", own, moments)
    tables = _tables(s, lines, border, (own, moments))
    lengths = border[..., 0].reshape(len(rows), -1)
    return Integrated(values, tables, gaps, lengths, scene.lost)


# -- owners ------------------------------------------------------------------------------------------------------------


def _intervals(s: Setting, scene: Scene, lines: Lines) -> Intervals:
    """Returns the intervals of all lines, and the owners on both sides of each."""
    xp, n = s.xp, len(scene.seen)
    count = lines.unit.shape[1]
    same, turned = lines.same[..., SIDE:], lines.turned[:, :, None] * lines.turned[:, None, SIDE:]
    start, slope, _ = between(lines.unit[:, :, None], lines.unit[:, None, SIDE:])
    at = -start / xp.where(xp.abs(slope) <= FLAT, 1.0, slope)
    first, last = lines.first[..., None], lines.last[..., None]
    split = s.regions * s.shape.guards
    by_region = (n, count, s.regions, s.shape.guards)
    cut = [v[..., :split].reshape(by_region) for v in (at, slope, start, same, turned)]
    begins, ends, sides = _presence(xp, cut, (first, last))
    sides = _alone_on_sides(s, lines, cut[3:], sides)
    crossing = xp.clip(xp.where(same[..., split:], first, at[..., split:]), first, last)
    ends_of_all = xp.sort(xp.concatenate([first, last, begins, ends, crossing], axis=2), axis=2)
    middle = (0.5 * (ends_of_all[..., 1:] + ends_of_all[..., :-1]))[..., None]
    inside = (begins[:, :, None] < middle) & (middle < ends[:, :, None]) & scene.seen[:, None, None]
    tied = _tied(s, same[..., split:]) + scene.equal[:, None]
    positive, negative = (
        _owners(s, scene, lines.unit, (middle, inside & ok[:, :, None], tied), sign) for ok, sign in zip(sides, (1.0, -1.0), strict=True)
    )
    return Intervals(ends_of_all, positive, negative, inside)


def _presence(xp: Any, cut: list[Any], chord: tuple[Any, Any]) -> tuple[Any, Any, tuple[Any, Any]]:
    """Returns where regions begin and end on lines, (n, N, regions), and whether they are on either side of them.

    `cut` are the places where guards are 0, their slopes, values at t = 0, which are on the line, and with which sign.
    """
    at, slope, start, same, turned = cut
    first, last = chord
    far = xp.full((*at.shape[:3], 1), 4.0)  # JAX has no derivative of the maximum of nothing
    begins = xp.concatenate([xp.where((slope > FLAT) & ~same, at, -4.0), -far], axis=3).max(axis=3)
    ends = xp.concatenate([xp.where((slope < -FLAT) & ~same, at, 4.0), far], axis=3).min(axis=3)
    never = ((xp.abs(slope) <= FLAT) & (start < 0.0) & ~same).any(axis=3)
    begins = xp.clip(begins, first, last)
    ends = xp.where(never, begins, xp.clip(ends, begins, last))
    return begins, ends, ((~same | (turned > 0.0)).all(axis=3), (~same | (turned < 0.0)).all(axis=3))


def _alone_on_sides(s: Setting, lines: Lines, cut: list[Any], sides: tuple[Any, Any]) -> tuple[Any, Any]:
    """Returns which regions are on either side of lines, but on a side of the square each region's line moves by itself: others that end
    on the line from within are beyond it too, and others that begin there are not."""
    same, turned = cut
    others = s.guarded[:, None] != np.arange(s.regions)
    others = np.concatenate([np.zeros((SIDE, s.regions), bool), others, np.zeros((len(s.pairs), s.regions), bool)])
    inner, outer = (lines.on_side & (lines.turned * sign > 0.0) for sign in (1.0, -1.0))
    begun = (same & (turned > 0.0)).any(axis=3) & others & outer[..., None]
    return sides[0] & ~begun, sides[1] | (others & inner[..., None])


def _tied(s: Setting, same: Any) -> Any:
    """Returns which pairs of candidates have equal keys on each line, 0 or 1 (n, N, K, K)."""
    xp = s.xp
    which = np.zeros((len(s.pairs), s.candidates, s.candidates))
    for q, (i, j) in enumerate(s.pairs):
        which[q, i, j] = which[q, j, i] = 1.0
    return xp.einsum("znq,qij->znij", 1.0 * same, which)


def _owners(s: Setting, scene: Scene, unit: Any, found: tuple[Any, Any, Any], sign: float) -> Any:
    """Returns the owners of the intervals on one side of their lines."""
    xp = s.xp
    middle, inside, tied = found
    present = inside.reshape(*inside.shape[:-1], s.candidates, s.shape.parts).any(axis=4)
    start, along, across = between(unit[:, :, None], scene.keys[:, None])
    depth = xp.where(present, start[:, :, None] + along[:, :, None] * middle, np.inf)
    everyone = np.arange(s.candidates + 1)
    nearest = 1.0 * (xp.argmin(depth, axis=3)[..., None] == everyone[:-1])
    rivals = present & (xp.einsum("zntk,znkj->zntj", nearest, tied) > 0.0)
    winner = 1.0 * (xp.argmin(xp.where(rivals, sign * across[:, :, None], np.inf), axis=3)[..., None] == everyone[:-1])
    equals = present & (xp.einsum("zntk,zkj->zntj", winner, scene.equal) > 0.0)
    owner = xp.where(present.any(axis=3), xp.argmax(equals, axis=3), s.candidates)
    return 1.0 * (owner[..., None] == everyone)


def _counted(s: Setting, scene: Scene, lines: Lines, intervals: Intervals) -> Any:
    """Returns 1 where an interval counts: of lines that are the same, the first one that bounds an owner there; else 0; (n, N, T)."""
    xp, n = s.xp, len(scene.seen)
    split = SIDE + s.regions * s.shape.guards
    candidate = np.repeat(np.arange(s.candidates), s.shape.parts)
    ranks = ranks_of(s, scene)
    earlier = lines.same[..., SIDE:split] & (ranks[:, None, SIDE:split] < ranks[..., None])
    turned = lines.turned[:, :, None] * lines.turned[:, None, SIDE:split]
    taken: Any = False
    for side, sign in ((intervals.positive, 1.0), (intervals.negative, -1.0)):
        bounding = (earlier & (turned == sign)).reshape(n, ranks.shape[1], s.regions, s.shape.guards).any(axis=3)
        taken = taken | ((side[..., candidate] > 0.0) & intervals.inside & bounding[:, :, None]).any(axis=3)
    own = _picked(xp, intervals.positive[:, SIDE:split], candidate[s.guarded]) * _picked(xp, intervals.inside[:, SIDE:split], s.guarded)
    one, two = (np.array([p[i] for p in s.pairs], dtype=int) for i in (0, 1))
    keys = _picked(xp, intervals.negative[:, split:], one) * _picked(xp, intervals.positive[:, split:], two)
    mine = xp.concatenate([xp.ones_like(intervals.positive[:, :SIDE, :, 0]), own, keys], axis=1)
    return xp.where(taken & (np.arange(mine.shape[1]) >= SIDE)[:, None], 0.0, mine * lines.valid[..., None])


def _picked(xp: Any, values: Any, which: Any) -> Any:
    """Returns one of the last axis for each line: values (n, N, T, m), `which` (N,)."""
    shape = (*values.shape[:3], 1)
    return xp.take_along_axis(values, xp.broadcast_to(xp.asarray(which)[None, :, None, None], shape), axis=3)[..., 0]


# -- integrals ---------------------------------------------------------------------------------------------------------


def _powers(xp: Any, ends: Any, count: int) -> Any:
    """Returns ∫ tᵖ dt over intervals, (n, N, T, count)."""
    wholes = [ends]
    for _ in range(count - 1):
        wholes.append(wholes[-1] * ends)
    return xp.stack([(v[..., 1:] - v[..., :-1]) / (p + 1) for p, v in enumerate(wholes)], axis=3)


def _on_lines(xp: Any, unit: Any, degree: int) -> Any:
    """Returns the coefficients of tᵖ of every monomial uⁱvʲ on lines, (monomials, n, N, degree + 1)."""
    c, a, b = (unit[..., i] for i in range(3))
    one, zero = xp.ones_like(c), xp.zeros_like(c)

    def times(polynomial: list[Any], constant: Any, slope: Any) -> list[Any]:
        return [x * constant + y * slope for x, y in zip([*polynomial, zero], [zero, *polynomial], strict=True)]

    found: dict[tuple[int, int], list[Any]] = {(0, 0): [one]}
    for i, j in monomials(degree)[1:]:
        found[i, j] = times(found[i - 1, j], -c * a, -b) if i else times(found[i, j - 1], -c * b, a)
    return xp.stack([xp.stack([*found[m], *[zero] * (degree - sum(m))], axis=-1) for m in monomials(degree)])


def _inside_square(xp: Any, owners: Any) -> Any:
    """Returns owners on negative sides without those of the sides of the square."""
    is_side = (np.arange(owners.shape[1]) < SIDE)[:, None, None]
    return xp.where(is_side, 0.0, owners)


def _moments(s: Setting, unit: Any, border: Any) -> tuple[Any, Any]:
    """Returns the moments of owners (n, K + 1, coefficients), and by how much their borders fail to close, (n, 3·(K + 1))."""
    xp = s.xp
    exponents = monomials(s.shape.degree)
    factors = np.array([1.0 / (i + j + 2) for i, j in exponents])
    moments = xp.einsum("zn,znkm->zkm", unit[..., 0], border[..., : len(exponents)]) * factors
    gaps = [xp.einsum("zn,znk->zk", unit[..., i], border[..., 0]) for i in (1, 2)]
    gaps.append(xp.einsum("zn,znk->zk", unit[..., 1], border[..., 1]) - xp.einsum("zn,znk->zk", unit[..., 2], border[..., 2]))
    return moments, xp.concatenate(gaps, axis=1)


def _tables(s: Setting, lines: Lines, border: Any, owned: tuple[Any, Any]) -> Any:
    """Returns the derivatives by all numbers, (n, bodies, K + 1, columns); `owned` are coefficients and moments of owners."""
    xp, shape = s.xp, s.shape
    own, moments = owned
    at = {m: k for k, m in enumerate(monomials(shape.degree + 1))}
    by_form = []
    for p, q in ((0, 0), (1, 0), (0, 1)):
        raised = border[..., np.array([at[i + p, j + q] for i, j in monomials(shape.degree)])]
        by_form.append(xp.einsum("znkm,zkbm->zbn", raised, own))
    weight = xp.where(lines.on_side, 0.5, 1.0) / lines.size
    edges = xp.stack(by_form, axis=3) * weight[:, None, :, None]
    n, bodies, split = len(own), own.shape[2], SIDE + s.regions * shape.guards
    guards = edges[:, :, SIDE:split].reshape(n, bodies, s.candidates, shape.forms - 3)
    signs = np.zeros((len(s.pairs), s.candidates))
    for q, (i, j) in enumerate(s.pairs):
        signs[q, i], signs[q, j] = 1.0, -1.0
    keys = xp.einsum("zbqc,qk->zbkc", edges[:, :, split:], signs)
    forms = xp.concatenate([guards, keys], axis=3)
    forms = xp.concatenate([forms, xp.zeros((n, bodies, 1, shape.forms))], axis=2)
    return xp.concatenate([forms, xp.broadcast_to(moments[:, None], (n, bodies, *moments.shape[1:]))], axis=3)
