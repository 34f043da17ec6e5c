"""Clipped polygons and segments over lanes, which the printed NumPy programs call as `polygons`.

    v1, v2 = polygon_0(run, (width, height, a, b, c, …), (v0,), (v0,))      box and half-planes; values for setup, for body
    v3, = segment_1(run, (v0,), (v0,), (v0,))                               values for setup, for scales, for body

A lane is clipped if no half-plane fails on its box, `setup` runs on those lanes only. The corners are rows of an array, of which each lane
has its own number; the triangles of all fans are pieces, and `body` runs at the nodes of each, shape (nodes, pieces). Thin triangles
start from their own vertices, whose barycentric coordinates are carried along.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.lanes import Block, Run, Value, gather, on_lanes, parts, scatter
from teg.backends.shared import polygons as half_planes
from teg.numerics.quadrature import gauss_legendre, triangle_rule
from teg.program import NEARLY, THIN, TIE_EPS

Array = npt.NDArray[Any]


class Nodes(NamedTuple):
    """Nodes on pieces: coordinates, each (nodes, pieces), weights, (nodes,), the size of each piece, and its lane."""

    at: Sequence[Array]
    weights: Array
    lengths: Array
    lane: Array


@dataclass(frozen=True, slots=True)
class Domain:
    """The common part of polyhedra, polygons and segments: printed blocks, `values` results, the doubles that a node takes, and whether
    `body` is without integrals (so that its runs are counted)."""

    setup: Block
    body: Block
    values: int
    width: int

    def _totals(self, run: Run, nodes: Nodes, given: Sequence[Value], lanes: int, once: bool = False) -> Array:
        """Returns the sums of weights·values over the nodes of each piece, times its length, in its lane: (values, lanes); `once`: one node
        counts for a whole lane."""
        lane, weights = nodes.lane, nodes.weights
        sums = np.empty((self.values, lane.size))
        run.evaluations += np.unique(lane).size if once else lane.size * len(weights)
        for part in parts(lane.size, run.chunk(self.width, len(weights))):
            found = self.body(run, *(x[:, part] for x in nodes.at), *(gather(v, lane[part]) for v in given))
            for total, value in zip(sums, found, strict=True):
                total[part] = weights @ value if np.ndim(value) == 2 else weights.sum() * value
        sums *= nodes.lengths
        return scatter(sums, lane, lanes)


@dataclass(frozen=True, slots=True)
class BoxDomain(Domain, ABC):
    """The common part of polyhedra and polygons, whose box is clipped by halves. `closed` says for each whether it is closed. `setup`
    returns the arguments of `body`, then the factors."""

    closed: tuple[bool, ...]
    degree: int

    def __call__(
        self,
        run: Run,
        box: tuple[Value, ...],
        for_setup: tuple[Value, ...],
        for_body: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape; `box`: its extents, then the numbers of the halves."""
        first, second = len(box), len(box) + len(for_setup)

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given[:first], given[first:second], given[second:], lanes)

        step = run.chunk(self._room() + len(for_setup) + len(for_body))
        return on_lanes(work, (*box, *for_setup, *for_body), when, self.values, 0.0, step)

    @abstractmethod
    def _room(self) -> int:
        """Returns the doubles that clipping takes."""

    @abstractmethod
    def _lanes(self, run: Run, box: Sequence[Array], for_setup: Sequence[Array], for_body: Sequence[Array], lanes: int) -> Array:
        """Returns the results of some lanes, (values, lanes)."""


@dataclass(frozen=True, slots=True)
class PolygonIntegral(BoxDomain):
    """A `Polygon`. `triangle` says whether three corners and the value across come after the half-planes."""

    triangle: bool = False

    def _room(self) -> int:
        return 8 * (4 + len(self.closed))

    def _lanes(self, run: Run, box: Sequence[Array], for_setup: Sequence[Array], for_body: Sequence[Array], lanes: int) -> Array:
        width, height, *planes = (np.broadcast_to(v, (lanes,)) for v in box)
        known_points = planes[3 * len(self.closed) :]
        fails, known, least, swings = meets(planes, self.closed, width, height)
        if self.triangle:
            across = known_points[-1]
            known &= np.isfinite(across)
            fails |= known & (across <= 0.0)
        sums = np.where(fails | known, 0.0, np.nan) * np.ones((self.values, 1))
        active = np.flatnonzero(~fails & known)
        if not active.size:
            return sums
        width, height, planes, least = width[active], height[active], [p[active] for p in planes], [p[active] for p in least]
        nothing = np.zeros(active.size)
        places = np.array([[nothing, width, width, nothing], [nothing, nothing, height, height]])
        corners = np.full(active.size, 4)
        thin = np.zeros(active.size, bool)
        if self.triangle:
            swing = np.maximum.reduce(swings[:3])[active]
            at, across = np.array([p[active] for p in known_points[:6]]).reshape(3, 2, -1), known_points[6][active]
            thin = across < THIN * swing
        for i in range(len(self.closed)):
            places, corners = clipped(places, corners, ~thin & (least[i] < 0.0), planes[3 * i : 3 * i + 3])
        if self.triangle:
            carried = [(planes[3 * k + 2] + planes[3 * k] * places[0] + planes[3 * k + 1] * places[1]) * (1.0 / across) for k in (1, 2)]
            places = np.stack([*places, *carried])
        if thin.any():
            cut, left = _thin(at[..., thin], width[thin], height[thin], [p[thin] for p in planes[9 : 3 * len(self.closed)]])
            rows = max(len(places[0]), len(cut[0]))
            places, cut = (np.concatenate([p, np.zeros((4, rows - p.shape[1], p.shape[2]))], axis=1) for p in (places, cut))
            places[..., thin], corners[thin] = cut, left
        px, py = places[:2]
        after = self.setup(run, *(gather(v, active) for v in for_setup))
        ends = len(after) - self.values
        piece = np.flatnonzero(np.arange(1, len(px) - 1)[:, None] + 1 < corners) if len(px) > 2 else np.empty(0, int)
        k, lane = piece // active.size + 1, piece % active.size
        x, y = px[0][lane], py[0][lane]
        ux, uy, vx, vy = px[k, lane] - x, py[k, lane] - y, px[k + 1, lane] - x, py[k + 1, lane] - y
        r, s, w = (np.array(column)[:, None] for column in zip(*triangle_rule(self.degree), strict=True))
        nodes = [x + r * ux + s * vx, y + r * uy + s * vy]
        nodes += [p[0][lane] + r * (p[k, lane] - p[0][lane]) + s * (p[k + 1, lane] - p[0][lane]) for p in places[2:]]
        given = [*(gather(v, active) for v in for_body), *after[:ends]]
        found = self._totals(run, Nodes(nodes, w[:, 0], 0.5 * (ux * vy - vx * uy), lane), given, active.size, self.degree == 0)
        sums[:, active] = times(after[ends:], found)
        return sums


def meets(planes: Sequence[Array], closed: Sequence[bool], width: Array, height: Array) -> tuple[Array, Array, list[Array], list[Array]]:
    """Returns whether a half-plane fails on the box, whether all is finite, the least value of each half-plane, and its swing."""
    fails, known = np.zeros(width.size, bool), np.isfinite(width) & np.isfinite(height)
    least: list[Array] = []
    swings: list[Array] = []
    for i, is_closed in enumerate(closed):
        low, most = half_planes.least_and_most(np, planes[3 * i : 3 * i + 3], (width, height))
        fails |= half_planes.fails(np, low, most, is_closed)
        known &= np.isfinite(most - low)
        least.append(low)
        swings.append(most - low)
    return fails, known, least, swings


def clipped(places: Array, corners: Array, cuts: Array, plane: Sequence[Array], exact: Array | None = None) -> tuple[Array, Array]:
    """Polygons, corners in rows, cut by a half-plane (a, b, c) each where it `cuts`: (coordinates, rows, lanes), and how many corners there
    are. The first two coordinates are places; where the border is along an axis, `exact` is where."""
    a, b, c = plane
    _, rows, lanes = places.shape
    number, lane = np.arange(rows)[:, None], np.arange(lanes)
    there = number < corners
    d = np.where(cuts, c + a * places[0] + b * places[1], 1.0)
    before = np.where(number == 0, np.maximum(corners, 1) - 1, number - 1)
    dp = d[before, lane]
    enters, leaves = there & (dp < 0.0) & (d > 0.0), there & (dp > 0.0) & (d < 0.0)
    t = np.where(enters, d / (d - dp), dp / (dp - d))
    taken = np.stack([enters | leaves, there & (d >= 0.0)], axis=1).reshape(2 * rows, lanes)
    place = np.cumsum(taken, axis=0) - 1
    total = np.where(there.any(axis=0), place[-1] + 1, 0)
    where, column = np.nonzero(taken)
    out = np.zeros((len(places), max(2, int(total.max(initial=0))), lanes))
    for axis, (result, corner) in enumerate(zip(out, places, strict=True)):
        last = corner[before, lane]
        cross = np.where(enters, corner + t * (last - corner), last + t * (corner - last))
        if exact is not None and axis == (0 if np.any(a) else 1):
            cross = np.broadcast_to(exact, cross.shape)
        both = np.stack([cross, corner], axis=1).reshape(2 * rows, lanes)
        result[place[where, column], column] = both[where, column]
    return out, total


def _thin(at: Array, width: Array, height: Array, planes: Sequence[Array]) -> tuple[Array, Array]:
    """Triangles, corners (3, 2, lanes), cut by boxes and more half-planes: places and barycentric coordinates."""
    nothing = np.zeros(width.size)
    su, sv = np.where(width < 0.0, -1.0, 1.0), np.where(height < 0.0, -1.0, 1.0)
    (ux, uy), (vx, vy) = at[1] - at[0], at[2] - at[0]
    turns = (ux * vy - vx * uy) * su * sv < 0.0
    one, two = np.where(turns, 0.0, 1.0), np.where(turns, 1.0, 0.0)
    second, third = np.where(turns, at[2], at[1]), np.where(turns, at[1], at[2])
    places = np.array([[at[0][j], second[j], third[j]] for j in (0, 1)] + [[nothing, one, two], [nothing, two, one]])
    corners = np.full(width.size, 3)
    every = np.ones(width.size, bool)
    for *plane, exact in ((su, nothing, nothing, nothing), (-su, nothing, su * width, width)):
        places, corners = clipped(places, corners, every, plane, exact)
    for *plane, exact in ((nothing, sv, nothing, nothing), (nothing, -sv, sv * height, height)):
        places, corners = clipped(places, corners, every, plane, exact)
    for i in range(0, len(planes), 3):
        places, corners = clipped(places, corners, every, planes[i : i + 3])
    return places, corners


@dataclass(frozen=True, slots=True)
class SegmentIntegral(Domain):
    """A `Segment`; of each half-line whether it is closed, and its number if it may tie. `setup` returns what `scales` takes from it, then
    what `body` does, then first, last, resolution and size of each half-line, then the factors; `scales` the scales of those that tie."""

    scales: Block | None
    lines: tuple[tuple[bool, int | None], ...]
    nodes: int
    passed: int

    def __call__(
        self,
        run: Run,
        for_setup: tuple[Value, ...],
        for_scales: tuple[Value, ...],
        for_body: tuple[Value, ...],
        when: Value = True,
    ) -> tuple[Value, ...]:
        """Returns the results, of the arguments' common shape."""
        first, second = len(for_setup), len(for_setup) + len(for_scales)

        def work(given: Sequence[Array], lanes: int) -> Array:
            return self._lanes(run, given[:first], given[first:second], given[second:], lanes)

        step = run.chunk(8 * len(self.lines) + len(for_setup) + len(for_scales) + len(for_body))
        return on_lanes(work, (*for_setup, *for_scales, *for_body), when, self.values, 0.0, step)

    def _lanes(self, run: Run, for_setup: Sequence[Array], for_scales: Sequence[Array], for_body: Sequence[Array], lanes: int) -> Array:
        after = self.setup(run, *for_setup)
        ends = len(after) - self.values - 4 * len(self.lines)
        to_scales, to_body, lines = after[: self.passed], after[self.passed : ends], after[ends : ends + 4 * len(self.lines)]
        start, stop = np.zeros(lanes), np.ones(lanes)
        outside, undefined = np.zeros(lanes, bool), np.zeros(lanes, bool)
        tied = self._ties(run, lines, lambda: self.scales(run, *for_scales, *to_scales) if self.scales is not None else ())
        for i, (closed, _) in enumerate(self.lines):
            first, last = lines[4 * i], lines[4 * i + 1]
            ties, holds = tied[i]
            outside |= np.where(ties, ~np.asarray(holds, bool), half_planes.misses(np, first, last, closed))
            undefined |= ~np.isfinite(first - last) & ~np.asarray(ties)
            start, stop = half_planes.cut(np, start, stop, first, last, ties)
        sums = np.where(undefined & ~outside, np.nan, 0.0) * np.ones((self.values, 1))
        active = np.flatnonzero(~outside & ~undefined & (start < stop))
        if not active.size:
            return sums
        nodes, weights = (0.5 * np.array(column) for column in gauss_legendre(self.nodes))
        start, length = start[active], (stop - start)[active]
        t = start + length * (0.5 + nodes[:, None])
        given = [gather(v, active) for v in (*for_body, *to_body)]
        found = self._totals(run, Nodes((t,), weights, length, np.arange(active.size)), given, active.size)
        sums[:, active] = times([gather(v, active) for v in after[ends + 4 * len(self.lines) :]], found)
        return sums

    def _ties(self, run: Run, lines: Sequence[Value], scales: Callable[[], Sequence[Value]]) -> list[tuple[Value, Value]]:
        """Returns, for each half-line, the lanes in which it ties, and whether it holds there."""
        found: list[tuple[Value, Value]] = [(False, False)] * len(self.lines)
        near = {}
        for i, (_, k) in enumerate(self.lines):
            if k is not None:
                first, last, _, size = lines[4 * i : 4 * i + 4]
                here = (np.abs(first) <= NEARLY * size) & (np.abs(last) <= NEARLY * size) & np.isfinite(first - last)
                if np.any(here):
                    near[i] = here
        if not near:
            return found
        tying = [i for i, (_, k) in enumerate(self.lines) if k is not None]
        for i, scale in zip(tying, scales(), strict=True):
            if i in near:
                first, last, resolution, _ = lines[4 * i : 4 * i + 4]
                ties = near[i] & (np.abs(first) <= TIE_EPS * scale) & (np.abs(last) <= TIE_EPS * scale)
                if np.any(ties):
                    run.met.add(self.lines[i][1])  # type: ignore[arg-type]
                    resolution = resolution if run.is_of_surfaces else True
                    found[i] = ties, resolution if run.order > 0 else np.logical_not(resolution)
        return found


def times(factors: Sequence[Value], sums: Array) -> Array:
    """Returns each row times its factor."""
    return np.array([factor * row for factor, row in zip(factors, sums, strict=True)]).reshape(sums.shape)
