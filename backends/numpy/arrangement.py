"""The cells of many squares at once (`teg.numerics.cells` says what they are): every square inserts its next candidate in the same step.

Cells of all squares stand one below the other, as polygons with as many places for corners as the largest has; places that are not used
repeat the first corner. A clip by a line computes both halves of every cell that it cuts, and packs the corners to the left.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.key_edges import late_edges
from teg.numerics.cells import BESIDE, BOX, EPSILON, NO_OWNER, NUDGE, ROUNDING, SIDES, Layout, apart

Array = npt.NDArray[Any]
UNIT = np.array([[0.0, 1.0], [0.0, 1.0]])


class Polygons(NamedTuple):
    """Convex polygons: corners (n, places, 2), the label of the edge behind each corner (n, places), the number of corners (n,)."""

    corners: Array
    labels: Array
    sizes: Array

    def take(self, which: Array) -> Polygons:
        return Polygons(self.corners[which], self.labels[which], self.sizes[which])

    def following(self) -> Array:
        """Returns the place of the next corner, (n, places)."""
        places = np.arange(1, self.labels.shape[1] + 1)[None, :]
        return np.where(places < self.sizes[:, None], places, 0)

    def used(self) -> Array:
        """Returns which places have a corner, (n, places)."""
        return np.arange(self.labels.shape[1])[None, :] < self.sizes[:, None]


def joined(parts: Sequence[Polygons]) -> Polygons:
    """Returns all polygons one below the other."""
    places = max(p.labels.shape[1] for p in parts)
    wide = [_widened(p, places) for p in parts]
    return Polygons(*(np.concatenate(columns) for columns in zip(*wide, strict=True)))


def _widened(p: Polygons, places: int) -> Polygons:
    missing = places - p.labels.shape[1]
    if not missing:
        return p
    corners = np.concatenate([p.corners, np.repeat(p.corners[:, :1], missing, axis=1)], axis=1)
    return Polygons(corners, np.pad(p.labels, ((0, 0), (0, missing))), p.sizes)


class Halves(NamedTuple):
    """Which polygons are on the positive side, which are cut, both parts of these, and which edges of the others are on the line,
    (n, places)."""

    inside: Array
    cut: Array
    positive: Polygons
    negative: Polygons
    on: Array


def split(p: Polygons, lines: Array, units: Array) -> Halves:
    """Cuts each polygon by its own line, whose form (c, a, b) has |(a, b)| = 1."""
    d = units[:, :1] + units[:, 1:2] * p.corners[..., 0] + units[:, 2:] * p.corners[..., 1]
    d = np.where(np.abs(d) < EPSILON, 0.0, d)
    most, least = d.max(axis=1), d.min(axis=1)
    whole = (most <= 0.0) | (least >= 0.0)
    behind = np.take_along_axis(d, p.following(), axis=1)
    on = whole[:, None] & p.used() & (d == 0.0) & (behind == 0.0)
    cut = np.flatnonzero(~whole)
    q, d, behind = p.take(cut), d[cut], behind[cut]
    positive = _half(q, d, behind, 2 * lines[cut], 1.0)
    return Halves(most > 0.0, ~whole, positive, _half(q, d, behind, 2 * lines[cut] + 1, -1.0), on)


def _half(p: Polygons, d: Array, behind: Array, label: Array, side: float) -> Polygons:
    n, places = d.shape
    following = p.following()
    used = p.used()
    mine, next_one = side * d, side * behind
    crossing = used & (d * behind < 0.0)
    t = np.where(crossing, d, 0.0) / np.where(crossing, d - behind, 1.0)
    ahead = np.take_along_axis(p.corners, following[..., None], axis=1)
    at = p.corners + t[..., None] * (ahead - p.corners)
    new = np.broadcast_to(label[:, None], (n, places))
    keep = np.stack([used & (mine >= 0.0), crossing], axis=2).reshape(n, 2 * places)
    corners = np.stack([p.corners, at], axis=2).reshape(n, 2 * places, 2)
    labels = np.stack([np.where((mine == 0.0) & (next_one < 0.0), new, p.labels), np.where(mine > 0.0, new, p.labels)], axis=2).reshape(
        n, 2 * places
    )
    sizes = keep.sum(axis=1)
    order = np.argsort(~keep, axis=1, kind="stable")[:, : int(sizes.max(initial=3))]
    order = np.where(np.arange(order.shape[1])[None, :] < sizes[:, None], order, order[:, :1])
    return Polygons(np.take_along_axis(corners, order[..., None], axis=1), np.take_along_axis(labels, order, axis=1), sizes)


class Lines(NamedTuple):
    """Lines of forms divided by |(a, b)|: units (n, 3), sizes (n,), and the rows and columns of the form's one or two parts, (n, 2); the
    second part counts negatively, a row of -1 is none. How the ends of edges move that had another line before (`late`) is not known."""

    units: Array
    sizes: Array
    rows: Array
    columns: Array
    late: Array


class Regions(NamedTuple):
    """The parts of the candidates of all squares: square, row, number among its parts, forms of guards (n, guards, 3) and key (n, 3)."""

    lane: Array
    row: Array
    part: Array
    guards: Array
    key: Array

    def take(self, which: Array) -> Regions:
        return Regions(*(field[which] for field in self))


class Moved(NamedTuple):
    """How squares are moved, and the keys of their candidates taken apart: by `nudge`, in units of NUDGE of the largest key of each
    square."""

    shift: tuple[float, float] = (0.0, 0.0)
    nudge: Array | None = None


UNMOVED = Moved()


def regions_of(shape: Layout, rows: Array, counts: Array, moved: Moved = UNMOVED) -> Regions:
    """Returns the regions of squares; `rows` are the candidates of all squares, `counts` of each."""
    lane = np.repeat(np.repeat(np.arange(len(counts)), counts), shape.parts)
    row = np.repeat(np.arange(len(rows)), shape.parts)
    part = np.arange(len(row)) % shape.parts
    forms = rows[:, : shape.forms].reshape(len(rows), shape.forms // 3, 3)
    if moved.shift != (0.0, 0.0):
        forms = forms.copy()
        forms[..., 0] += forms[..., 1] * moved.shift[0] + forms[..., 2] * moved.shift[1]
    if moved.nudge is not None:
        forms = forms.copy()
        of = np.repeat(np.arange(len(counts)), counts)
        largest = np.zeros(len(counts))
        np.maximum.at(largest, of, np.abs(forms[:, -1]).sum(axis=1))
        number = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        forms[:, -1, 0] += (NUDGE * moved.nudge * largest)[of] * [apart(k) for k in number.tolist()]
    guards = forms[:, :-1].reshape(len(row), shape.guards, 3)
    return Regions(lane, row, part, guards, forms[row, -1])


class Inserted(NamedTuple):
    """What is known of the regions of squares before any is cut.

    lost: whether a region is there whose numbers are not finite; base: the region that covers each square in front of other such ones, -1
    for none; cutting: which guards may cut, (regions, guards); order: the regions that may be seen in front of it.
    """

    lost: Array
    base: Array
    cutting: Array
    order: Array


def classified(r: Regions, lanes: int, boxes: Array = UNIT) -> Inserted:
    """Returns which regions are seen, by their least and largest values on the square, or on a tile of it: `boxes` (lanes, 2, 2)."""
    region = np.arange(len(r.lane))
    box = np.broadcast_to(boxes, (lanes, 2, 2))[r.lane]
    with np.errstate(all="ignore"):
        size = np.hypot(r.guards[..., 1], r.guards[..., 2])
        most, least = ranges(r.guards, box[:, None])
        absent = ((most < -EPSILON * size) | ((size == 0.0) & (r.guards[..., 0] < 0.0))).any(axis=1)
        lost = ~absent & ~(np.isfinite(r.guards).all(axis=(1, 2)) & np.isfinite(r.key).all(axis=1))
        cutting = (least <= EPSILON * size) & (size > 0.0) & (size < np.inf)
        covering = np.flatnonzero(~absent & ~cutting.any(axis=1) & ~lost)
        covering = covering[np.lexsort((covering, ranges(r.key[covering], box[covering])[0], r.lane[covering]))]
        covered, first = np.unique(r.lane[covering], return_index=True)
        base = np.full(lanes, NO_OWNER)
        base[covered] = covering[first]
        behind = r.key[base[r.lane]] if len(r.key) else r.key
        difference = r.key - behind
        hidden = (base[r.lane] >= 0) & (ranges(difference, box)[1] > tolerances(difference, r.key, behind))
    seen = np.flatnonzero(~absent & ~hidden & ~lost & (region != base[r.lane]))
    middle = r.key[seen, 0] + (r.key[seen, 1:] * box[seen].mean(axis=2)).sum(axis=1)
    return Inserted(lost, base, cutting, seen[np.lexsort((seen, middle, r.lane[seen]))])


def ranges(forms: Array, box: Array) -> tuple[Array, Array]:
    """Returns the largest and the least value of forms on boxes, (…, 2, 2)."""
    ends = forms[..., 1:, None] * box
    return forms[..., 0] + ends.max(axis=-1).sum(axis=-1), forms[..., 0] + ends.min(axis=-1).sum(axis=-1)


def tolerances(difference: Array, key: Array, other: Array) -> Array:
    """Returns the values below which differences of keys count as 0."""
    scale = np.maximum(np.abs(key[..., 0]), np.abs(other[..., 0]))
    return EPSILON * np.hypot(difference[..., 1], difference[..., 2]) + ROUNDING * scale


def _sides_at(at: Array) -> Array:
    """Returns on how many sides of the square places, (…, 2), lie."""
    found: Array = (np.abs(np.concatenate([at, 1.0 - at], axis=-1)) <= EPSILON).sum(axis=-1)
    return found


class Arrangements:
    """The cells of squares: `polygons`, the `owner` region of each (NO_OWNER for none) and its square `lane`; `lines` of all their edges.

    `touching` are the squares with a line on a side, `ambiguous` those with an edge of equal keys that has no derivative, `concurrent`
    those where more keys are equal at one place than have a second derivative there: 1, 2 if it has no two sides.
    `boxes` are tiles of squares in their place; `guarded` says where guards have lines in the square.
    """

    def __init__(self, shape: Layout, regions: Regions, known: Inserted, boxes: Array, guarded: Array) -> None:
        self.shape, self.regions, self.known, self._guarded = shape, regions, known, guarded
        lanes = len(known.base)
        sides = np.broadcast_to(boxes, (lanes, 2, 2))
        corners = np.stack([sides[:, 0, [0, 1, 1, 0]], sides[:, 1, [0, 0, 1, 1]]], axis=2)
        self.polygons = Polygons(corners, np.broadcast_to(np.array([4, 2, 6, 0]), (lanes, 4)), np.full(lanes, 4))
        self.owner, self.lane = known.base.copy(), np.arange(lanes)
        self.touching, self.ambiguous = np.zeros((2, lanes), dtype=bool)
        self.concurrent = np.zeros(lanes, dtype=int)
        self._tied = np.zeros(lanes, dtype=bool)  # something else has the line of an edge on which two keys are equal
        self._count = BOX + known.cutting.size
        self._keys: list[Lines] = []
        self.key_lanes: list[Array] = []  # the squares of these
        with np.errstate(all="ignore"):
            self.units = regions.guards / np.hypot(regions.guards[..., 1], regions.guards[..., 2])[..., None]
        in_lane = regions.lane[known.order]
        starts = np.searchsorted(in_lane, np.arange(lanes))
        numbers = np.bincount(in_lane, minlength=lanes)
        for turn in range(int(numbers.max(initial=0))):
            chosen = np.where(numbers > turn, known.order[np.minimum(starts + turn, len(known.order) - 1)], NO_OWNER)
            self._insert(chosen)
        if self._tied.any():
            self._assign_key_edges()
        self.lines = self._all_lines()

    def _insert(self, chosen: Array) -> None:
        """Inserts a region into each square, NO_OWNER for none."""
        region = chosen[self.lane]
        at = np.flatnonzero((region != NO_OWNER) & (self._candidate(self.owner) != self._candidate(region)))
        if not at.size:
            return
        owner, region, cells = self.owner[at], region[at], self.polygons.take(at)
        difference, on, kept, needed = self._compared(owner, region, cells)
        self._note(cells, (at, np.arange(len(at))), on, region)
        alive = np.flatnonzero(~kept)
        at, region, needed = at[alive], region[alive], needed[alive]
        lines = np.full(len(at), -1)
        lines[needed] = self._key_lines(owner[alive[needed]], region[needed], difference[alive[needed]])
        units = difference[alive]
        with np.errstate(all="ignore"):
            units = units / np.hypot(units[:, 1], units[:, 2])[:, None]
        self._clip(at, region, (lines, units))

    def _candidate(self, region: Array) -> Array:
        """Returns the candidate of regions; the one of NO_OWNER is like no other."""
        return np.where(region == NO_OWNER, NO_OWNER, self.regions.row[region])

    def _compared(self, owner: Array, region: Array, cells: Polygons) -> tuple[Array, Array, Array, Array]:
        """Returns the differences of the keys, edges where they are 0, which cells stay as they are, and which the line cuts."""
        key, other = self.regions.key[owner], self.regions.key[region]
        difference = key - other
        tolerance = tolerances(difference, key, other)[:, None]
        d = difference[:, :1] + difference[:, 1:2] * cells.corners[..., 0] + difference[:, 2:] * cells.corners[..., 1]
        above, below = (d > tolerance).any(axis=1), (d < -tolerance).any(axis=1)
        owned = owner != NO_OWNER
        on = (np.abs(d) <= tolerance) & cells.used()
        if self.shape.order:
            self._note_concurrent(owner, cells, on & ((above | below) & owned & ~self._guarded[self.regions.lane[region]])[:, None])
        on &= np.take_along_axis(on, cells.following(), axis=1)
        on &= (owned & (above != below))[:, None]
        return difference, on, owned & ~above & (below | (region > owner)), owned & above & below

    def _note_concurrent(self, owners: Array, cells: Polygons, on: Array) -> None:
        """Notes squares where a further key is equal to the owner's at corners of a cell, those that are `on` its line; not along a side of
        the square."""
        following = cells.following()
        along = on & np.take_along_axis(on, following, axis=1) & (cells.labels < 2 * BOX)
        ends = np.zeros_like(on)
        some, place = np.nonzero(along)
        ends[some, following[some, place]] = True
        some, place = np.nonzero(on & ~along & ~ends)
        if not some.size:
            return
        owner, at = owners[some], cells.corners[some, place]
        lane = self.regions.lane[owner]
        seen = np.zeros(len(self.regions.lane), dtype=bool)
        seen[self.known.order], seen[self.known.base[self.known.base >= 0]] = True, True
        first, last = (np.searchsorted(self.regions.lane, lane, side) for side in ("left", "right"))
        corner = np.repeat(np.arange(len(at)), last - first)
        other = np.arange(len(corner)) - np.repeat(np.cumsum(last - first) - last, last - first)
        key, behind = self.regions.key[owner[corner]], self.regions.key[other]
        difference = key - behind
        values = difference[:, 0] + (difference[:, 1:] * at[corner]).sum(axis=1)
        equal = np.bincount(corner, seen[other] & (np.abs(values) <= tolerances(difference, key, behind)), len(at))
        np.maximum.at(self.concurrent, lane, np.where(equal + _sides_at(at) > 4, 2, 1))

    def _note(self, cells: Polygons, which: tuple[Array, Array], on: Array, region: Array) -> None:
        """Notes squares where regions have lines on edges: on sides, or where two keys are equal. `which` cells of all and of these."""
        at, some = which
        labels = cells.labels[some]
        touched = self._are_at(cells, some, on & (labels < 2 * BOX), region)
        self.touching[self.lane[at[touched]]] = True
        tied = (on & (labels >= 2 * (BOX + self.known.cutting.size))).any(axis=1)
        self._tied[self.lane[at[some[tied]]]] = True

    def _assign_key_edges(self) -> None:
        """Gives edges on lines of equal keys the lines of the owners of their two sides."""
        rows = np.concatenate([lines.rows for lines in self._keys]) if self._keys else np.zeros((0, 2), dtype=np.int64)
        late = late_edges(self, rows, self._tied)
        self.ambiguous[late.ambiguous] = True
        if late.cell.size:
            difference = self.regions.key[late.owner] - self.regions.key[late.beyond]
            labels = self.polygons.labels.copy()
            labels[late.cell, late.place] = 2 * self._key_lines(late.owner, late.beyond, difference) + 1
            self._keys[-1] = self._keys[-1]._replace(late=np.ones(len(late.cell), dtype=bool))
            self.polygons = self.polygons._replace(labels=labels)

    def _are_at(self, cells: Polygons, which: Array, edges: Array, region: Array) -> Array:
        """Returns those of some cells, given by their numbers, whose region is at one of these edges, (some, places)."""
        some, place = np.nonzero(edges)
        cell = which[some]
        guards, cutting = self.units[region[cell]], self.known.cutting[region[cell]]
        if not cell.size:
            return np.arange(0)
        ends = cells.corners[cell, place], cells.corners[cell, cells.following()[cell, place]]
        d, e = (guards[..., 0] + BESIDE + guards[..., 1] * at[:, :1] + guards[..., 2] * at[:, 1:] for at in ends)
        d, e = np.where(cutting, d, 1.0), np.where(cutting, e, 1.0)
        t = d / np.where(d * e < 0.0, d - e, 1.0)
        first = np.where((d < 0.0) & (e >= 0.0), t, 0.0).max(axis=1, initial=0.0)
        last = np.where((d >= 0.0) & (e < 0.0), t, 1.0).min(axis=1, initial=1.0)
        found: Array = cell[(first <= last) & ~((d < 0.0) & (e < 0.0)).any(axis=1)]
        return found

    def _key_lines(self, owner: Array, region: Array, difference: Array) -> Array:
        """Returns the labels of new lines on which the keys of two regions are equal."""
        size = np.hypot(difference[:, 1], difference[:, 2])
        rows = np.stack([self.regions.row[owner], self.regions.row[region]], axis=1)
        self._keys.append(
            Lines(difference / size[:, None], size, rows, np.full(rows.shape, self.shape.forms - 3), np.zeros(len(rows), dtype=bool))
        )
        self.key_lanes.append(self.regions.lane[owner])
        self._count += len(owner)
        return np.arange(self._count - len(owner), self._count)

    def _clip(self, at: Array, region: Array, last: tuple[Array, Array]) -> None:
        """Gives each region its part of the cells `at`, by its guards and then by the line of equal keys, -1 for none."""
        inner = self.polygons.take(at)
        alive = np.ones(len(at), dtype=bool)
        pieces: list[tuple[Array, Polygons]] = []
        for turn in range(self.shape.guards + 1):
            if turn < self.shape.guards:
                asked = alive & self.known.cutting[region, turn]
                lines, units = BOX + region * self.shape.guards + turn, self.units[region, turn]
            else:
                (lines, units), asked = last, alive & (last[0] >= 0)
            which = np.flatnonzero(asked)
            if not which.size:
                continue
            halves = split(inner.take(which), lines[which], units[which])
            self._note(inner, (at, which), halves.on, region)
            alive[which[~halves.inside]] = False
            cut = which[halves.cut]
            pieces.append((cut, halves.negative))
            inner = _replaced(inner, cut, halves.positive)
        self._store(at, region, (alive, inner, pieces))

    def _store(self, at: Array, region: Array, result: tuple[Array, Polygons, list[tuple[Array, Polygons]]]) -> None:
        alive, inner, pieces = result
        whole, owners, lanes = [self.polygons], [self.owner], [self.lane]
        for cut, rest in pieces:
            left = alive[cut]
            whole.append(rest.take(left))
            owners.append(self.owner[at[cut[left]]])
            lanes.append(self.lane[at[cut[left]]])
        first = _replaced(self.polygons, at[alive], inner.take(alive))
        self.polygons = joined([first, *whole[1:]])
        self.owner, self.lane = np.concatenate(owners), np.concatenate(lanes)
        self.owner[at[alive]] = region[alive]

    def _all_lines(self) -> Lines:
        guards, r = self.shape.guards, self.regions
        n = len(r.row) * guards
        columns = (3 * (r.part[:, None] * guards + np.arange(guards)[None, :])).reshape(n)
        none, sides = np.full(n, -1), np.full((BOX, 2), -1)
        sizes = np.where(self.known.cutting, np.hypot(r.guards[..., 1], r.guards[..., 2]), 1.0).reshape(n)
        known = [
            Lines(np.array(SIDES), np.ones(BOX), sides, sides, np.zeros(BOX, dtype=bool)),
            Lines(
                self.units.reshape(n, 3),
                sizes,
                np.stack([np.repeat(r.row, guards), none], axis=1),
                np.stack([columns, none], axis=1),
                np.zeros(n, dtype=bool),
            ),
            *self._keys,
        ]
        return Lines(*(np.concatenate(fields) for fields in zip(*known, strict=True)))


def _replaced(p: Polygons, which: Array, by: Polygons) -> Polygons:
    """Returns the polygons, some of them replaced."""
    places = max(p.labels.shape[1], by.labels.shape[1])
    p, by = _widened(p, places), _widened(by, places)
    corners, labels, sizes = p.corners.copy(), p.labels.copy(), p.sizes.copy()
    corners[which], labels[which], sizes[which] = by.corners, by.labels, by.sizes
    return Polygons(corners, labels, sizes)
