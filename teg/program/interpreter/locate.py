"""The meaning of `Locate`: rectangles are dropped, halved, known to hold one zero, or given up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from teg.program.limits import (
    LOCATE_HALVINGS,
    LOCATE_LOST,
    LOCATE_MOST,
    LOCATE_NARROW,
    LOCATE_SAME,
    LOCATE_STEPS,
    LOCATE_WIDTH,
    LOCATE_ZEROS,
)
from teg.program.operations import divide
from teg.program.statements import Locate

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

Corner = tuple[float, float]
"""The corner (v, u) of a rectangle, in parts of the whole."""


def locate(machine: Machine, stmt: Locate) -> list[float]:
    """Returns the places in ascending order, then +inf; then the part that is lost, if it is asked for."""
    count = len(stmt.results)
    lo, hi, low, high = ends = machine.numbers((stmt.lo, stmt.hi, stmt.low, stmt.high))
    places: list[float] = []
    lost = 0.0
    if all(map(math.isfinite, ends)) and lo != hi and low != high:
        search = _Search(machine, stmt, min(lo, hi), abs(hi - lo), min(low, high), abs(high - low))
        search.run()
        places, lost = search.places()
        if len(places) > count:
            lost = min(1.0, lost + max(0.0, (search.lo + search.extent - places[count - 1]) / search.extent))
    machine.missed |= lost > LOCATE_LOST
    found = (places + [math.inf] * count)[:count]
    return [*found, lost] if stmt.lost is not None else found


@dataclass
class _Search:
    """The rectangles of a level have the width 2^-times[0] and the height 2^-times[1], in parts of the whole."""

    machine: Machine
    stmt: Locate
    lo: float
    extent: float
    low: float
    height: float

    def __post_init__(self) -> None:
        self.times = [0, 0]
        self.last: int | None = None
        self.useless, self.useful = [False, False], [False, False]
        self.zeros: list[float] = []
        self.given_up: list[Corner] = []

    def run(self) -> None:
        """Examine level after level; afterwards `zeros` and `given_up` are known."""
        level: list[Corner] = [(0.0, 0.0)]
        examined = 1
        while level:
            left = [corner for corner in level if self._is_left(corner)]
            if len(self.zeros) > LOCATE_ZEROS:
                return
            examined += 2 * len(left)
            if 2 * len(left) > LOCATE_WIDTH or examined > LOCATE_MOST or self.times == [LOCATE_HALVINGS] * 2:
                self.given_up = left
                return
            if left:
                self._choose(len(left), len(level))
            direction = self.last or 0
            offset = 0.5 ** self.times[direction]
            level = [half for v, u in left for half in ((v, u), (v + offset, u) if direction == 0 else (v, u + offset))]

    def _choose(self, left: int, before: int) -> None:
        """Chooses the next direction. Directions take turns, but one is repeated if halving in it is of use and halving in the other is
        not."""
        if self.last is not None:
            self.useless[self.last] = 50 * left >= 49 * before
            self.useful[self.last] = 20 * left <= 11 * before
        direction = 0 if self.times[0] <= self.times[1] else 1
        if self.useless[1] and self.useful[0]:
            direction = 0
        elif self.useless[0] and self.useful[1]:
            direction = 1
        self.last = direction if self.times[direction] < LOCATE_HALVINGS else 1 - direction
        self.times[self.last] += 1

    def _is_left(self, corner: Corner) -> bool:
        """Returns whether a rectangle is neither dropped nor known to hold one zero, which is then found."""
        wide, tall = 0.5 ** self.times[0], 0.5 ** self.times[1]
        (v, u), stmt = corner, self.stmt
        left, right = self.lo + self.extent * v, self.lo + self.extent * (v + wide)
        bottom, top = self.low + self.height * u, self.low + self.height * (u + tall)
        bounds = self._bounds(left, right, bottom, top)
        f0, f1, g0, g1 = bounds[:4]
        if f0 > 0.0 or f1 < 0.0 or g0 > 0.0 or g1 < 0.0 or (f0 != f0 and f1 != f1) or (g0 != g0 and g1 != g1):
            return False
        if len(stmt.bounds) == 4:
            return True
        middle = 0.5 * (left + right), 0.5 * (bottom + top)
        known = _krawczyk(bounds[4:], self._at(*middle), 0.5 * (right - left), 0.5 * (top - bottom))
        if known == "one":
            self.zeros.append(self._newton(*middle))
        return known == ""

    def _newton(self, v: float, u: float) -> float:
        for _ in range(LOCATE_STEPS):
            f, g, f_v, f_u, g_v, g_u = self._at(v, u)
            det = f_v * g_u - f_u * g_v
            v, u = v - divide(g_u * f - f_u * g, det), u - divide(f_v * g - g_v * f, det)
        return v

    def _at(self, v: float, u: float) -> list[float]:
        """Returns f, g and their slopes at a point: the lower bounds there."""
        return self._bounds(v, v, u, u)[::2]

    def _bounds(self, left: float, right: float, bottom: float, top: float) -> list[float]:
        stmt = self.stmt
        sides = {stmt.left: left, stmt.right: right, stmt.bottom: bottom, stmt.top: top}
        return self.machine.at(stmt.enclosure, stmt.bounds, **sides)

    def places(self) -> tuple[list[float], float]:
        """Returns the places, and the part of the rectangle that is lost."""
        if len(self.zeros) > LOCATE_ZEROS:
            return [], 1.0
        same, wide = LOCATE_SAME * self.extent, 0.5 ** self.times[0]
        intervals = [(v - same, v + same, 0) for v in self.zeros]
        intervals += [(self.lo + self.extent * v, self.lo + self.extent * (v + wide), 1) for v, _ in self.given_up]
        joined: list[tuple[float, float, int]] = []
        for left, right, rectangles in sorted(intervals):
            if joined and left <= joined[-1][1]:
                before = joined.pop()
                left, right, rectangles = before[0], max(before[1], right), before[2] + rectangles
            joined.append((left, right, rectangles))
        places: list[float] = []
        lost = 0
        for left, right, rectangles in joined:
            narrow = right - left <= LOCATE_NARROW * self.extent
            places += [0.5 * (left + right)] if narrow else [left, right]
            lost += 0 if narrow else rectangles
        return places, lost * (wide * 0.5 ** self.times[1])


def _krawczyk(bounds: list[float], at: list[float], h: float, k: float) -> str:
    """Returns the result of Krawczyk's test on a rectangle with half the sides h and k: "none" if it has no common zero, "one" if it has
    exactly one, which Newton's method finds, "" if neither is known. It takes bounds of the slopes over the rectangle, and f and g in its
    middle."""
    f, g = at[:2]
    pairs = list(zip(bounds[::2], bounds[1::2], strict=True))
    sizes = [max(abs(p), abs(q)) if p == p and q == q else math.nan for p, q in pairs]
    if abs(f) > sizes[0] * h + sizes[1] * k or abs(g) > sizes[2] * h + sizes[3] * k:
        return "none"
    middles = [0.5 * (p + q) for p, q in pairs]
    ra, rb, rc, rd = (0.5 * (q - p) for p, q in pairs)
    det = abs(middles[0] * middles[3] - middles[1] * middles[2])
    a, b, c, d = (divide(x, det) for x in middles)
    v, u = abs(d * f - b * g), abs(a * g - c * f)
    across = (abs(d) * ra + abs(b) * rc) * h + (abs(d) * rb + abs(b) * rd) * k
    up = (abs(c) * ra + abs(a) * rc) * h + (abs(c) * rb + abs(a) * rd) * k
    if v > h + across or u > k + up:
        return "none"
    return "one" if across <= 0.25 * h and up <= 0.25 * k and v + across < h and u + up < k else ""
