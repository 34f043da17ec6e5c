"""Lines on which edges of different regions lie, in many squares at once: each part belongs to the region whose edge lies there.

What `twins` and `_shares` in `teg.numerics.measured` do for one square.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from teg.backends.numpy.arrangement import Arrangements
from teg.numerics.cells import BOX, EPSILON, PLACES, SAME, SIDES

Array = npt.NDArray[Any]


class Shares(NamedTuple):
    """Parts of edges: which edge, where the part begins and ends on it (0 to 1), its line, whether that has the same sides (1 or -1), and
    whether it is the whole edge with its own line."""

    edge: Array
    first: Array
    last: Array
    line: Array
    sign: Array
    whole: Array


class Twins:
    """The guards whose lines are those of guards of other regions too, in groups of one line each. Guards have the numbers of their lines
    without the sides of the square.

    `group` has the group of each guard, -1 for those whose line is theirs alone or on which all edges lie on each other; `members` are the
    guards of all groups, one group after the other, `starts` where each begins and ends; `signs` (guards,) turn guards of a group alike.
    """

    def __init__(self, cells: Arrangements) -> None:
        self.guards, self.cutting = cells.shape.guards, cells.known.cutting
        self.units = cells.lines.units[BOX : BOX + self.cutting.size].reshape(*self.cutting.shape, 3)
        self.group, self.signs = np.full(self.cutting.size, -1), np.ones(self.cutting.size)
        self.members, self.starts = np.arange(0), np.zeros(1, dtype=np.int64)
        order = cells.known.order
        place, guard = np.nonzero(self.cutting[order])
        if len(place):
            self._find(cells.regions.lane, order[place], guard)

    def _find(self, lanes: Array, region: Array, guard: Array) -> None:
        """Finds the groups among guards of regions that are given nearest first, and so are the members of a group."""
        g = self.units[region, guard]
        sign = np.where(np.where(abs(g[:, 1]) > SAME, g[:, 1], g[:, 2]) < 0.0, -1.0, 1.0)
        c, angle = sign * g[:, 0], np.round(sign * g[:, 2] / (1.0 + sign * g[:, 1]), PLACES)
        order = np.lexsort((c, angle, lanes[region]))
        region, guard, c, angle = region[order], guard[order], c[order], angle[order]
        number = region * self.guards + guard
        self.signs[number] = sign[order]
        same = (lanes[region[1:]] == lanes[region[:-1]]) & (angle[1:] == angle[:-1]) & (c[1:] - c[:-1] < SAME)
        group = np.cumsum(np.concatenate([[0], ~same]))
        (beside,) = np.nonzero(same & (region[1:] != region[:-1]))
        apart = np.zeros(group[-1] + 1, dtype=bool)
        one, other = number[beside], number[beside + 1]
        apart[group[beside[self._are_apart(one, other)]]] = True
        (kept,) = np.nonzero(apart[group])
        kept = kept[np.lexsort((order[kept], group[kept]))]
        self.members = number[kept]
        sizes = np.bincount(group[kept], minlength=len(apart))[apart]
        self.starts = np.concatenate([[0], np.cumsum(sizes)])
        self.group[self.members] = np.repeat(np.arange(len(sizes)), sizes)

    def _are_apart(self, one: Array, other: Array) -> Array:
        """Returns for pairs of guards of one line whether their edges do not lie on each other."""
        (low, high), (first, last) = self._edges(one), self._edges(other)
        longer = np.maximum(high - low, last - first)
        apart: Array = (np.minimum(high, last) - np.maximum(low, first) < longer - EPSILON) & (longer > EPSILON)
        return apart

    def _edges(self, number: Array) -> tuple[Array, Array]:
        """Returns where the edges of guards begin and end in the square, from the point of each line that is nearest to 0."""
        region, guard = np.divmod(number, self.guards)
        line = self.signs[number, None] * self.units[region, guard]
        others = np.where(self.cutting[region][..., None], self.units[region], np.array([1.0, 0.0, 0.0]))
        others = np.concatenate([others, np.broadcast_to(np.array(SIDES), (len(region), BOX, 3))], axis=1)
        c, a, b = line.T[..., None]
        at, along = others[..., 0] - c * (a * others[..., 1] + b * others[..., 2]), a * others[..., 2] - b * others[..., 1]
        own = np.arange(others.shape[1]) == guard[:, None]
        crossing = -at / np.where(along == 0.0, 1.0, along)
        low = np.where(~own & (along > 0.0), crossing, -np.inf).max(axis=1, initial=-np.inf)
        high = np.where(~own & (along < 0.0), crossing, np.inf).min(axis=1, initial=np.inf)
        none = (~own & (along == 0.0) & (at < 0.0)).any(axis=1)
        return low, np.where(none, low, np.maximum(low, high))

    def shares(self, line: Array, start: Array, end: Array) -> Shares:
        """Returns the parts of edges on lines, from `start` to `end`, (edges, 2). Where no edge lies the cut keeps what is there."""
        if not self.members.size:
            return _alone(line, np.arange(len(line)))
        number = line - BOX
        group = np.where(number < len(self.group), self.group[np.minimum(number, len(self.group) - 1)], -1)
        (asked,) = np.nonzero(group >= 0)
        first, last = self._ranges(number[asked], start[asked], end[asked])
        asked = asked[(first > EPSILON) | (last < 1.0 - EPSILON)]
        counts = np.diff(self.starts)[group[asked]]
        edge = np.repeat(asked, counts)
        within = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
        member = self.members[self.starts[group[edge]] + within]
        low, high = self._ranges(member, start[edge], end[edge])
        (meet,) = np.nonzero((member // self.guards != number[edge] // self.guards) & (high - low > EPSILON))
        parts = self._divided(number, (start, end), (edge[meet], member[meet], low[meet], high[meet]))
        some = np.zeros(len(line), dtype=bool)
        some[parts.edge] = True
        return Shares(*(np.concatenate(fields) for fields in zip(_alone(line, np.flatnonzero(~some)), parts, strict=True)))

    def _divided(self, number: Array, ends: tuple[Array, Array], met: tuple[Array, Array, Array, Array]) -> Shares:
        """Returns the parts of edges that guards of other regions `met` share, and that do not all belong to the edge's own guard."""
        edge, member, low, high = met
        edges, row = np.unique(edge, return_inverse=True)
        place = 1 + np.arange(len(edge)) - np.searchsorted(edge, edge)
        width = 1 + int(place.max(initial=0))
        lows, highs = np.ones((len(edges), width)), np.zeros((len(edges), width))
        lines = np.repeat(number[edges][:, None], width, axis=1)
        lows[:, 0], highs[:, 0] = self._ranges(number[edges], ends[0][edges], ends[1][edges])
        lows[row, place], highs[row, place], lines[row, place] = low, high, member
        begin, stop = np.zeros((len(edges), 1)), np.ones((len(edges), 1))
        cuts = np.sort(np.concatenate([begin, lows, highs, stop], axis=1), axis=1)
        middles = 0.5 * (cuts[:, 1:] + cuts[:, :-1])[..., None]
        owner = np.argmax((lows[:, None, :] < middles) & (middles < highs[:, None, :]), axis=2)  # 0, the own guard, where there is none
        length = np.hypot(*(ends[1][edges] - ends[0][edges]).T)[:, None]
        long = (cuts[:, 1:] - cuts[:, :-1]) * length > EPSILON
        at, part = np.nonzero(long & (long & (owner > 0)).any(axis=1)[:, None])
        line = lines[at, owner[at, part]]
        sign = np.where(owner[at, part] > 0, self.signs[line] * self.signs[number[edges[at]]], 1.0)
        return Shares(edges[at], cuts[at, part], cuts[at, part + 1], BOX + line, sign, np.zeros(len(at), dtype=bool))

    def _ranges(self, number: Array, start: Array, end: Array) -> tuple[Array, Array]:
        """Returns the parts of straight lines where the other guards of a guard's region hold."""
        region, guard = np.divmod(number, self.guards)
        counted = self.cutting[region] & (np.arange(self.guards) != guard[:, None])
        units = np.where(counted[..., None], self.units[region], np.array([1.0, 0.0, 0.0]))
        d, e = (units[..., 0] + units[..., 1] * at[:, :1] + units[..., 2] * at[:, 1:] for at in (start, end))
        t = d / np.where(d * e < 0.0, d - e, 1.0)
        first = np.where((d < 0.0) & (e >= 0.0), np.where(e > 0.0, t, 1.0), 0.0).max(axis=1, initial=0.0)
        last = np.where((d >= 0.0) & (e < 0.0), t, 1.0).min(axis=1, initial=1.0)
        outside = ((d < 0.0) & (e < 0.0)).any(axis=1)
        return np.where(outside, 1.0, first), np.where(outside, 0.0, last)


def _alone(line: Array, edges: Array) -> Shares:
    """Returns edges as they are."""
    ones = np.ones(len(edges))
    return Shares(edges, 0.0 * ones, ones, line[edges], ones, ones > 0.0)
