"""The meaning of `Isolate`: boxes are dropped, halved, or known to hold one root, which Newton's method finds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from teg.program.limits import ISOLATE_DEPTH, ISOLATE_STEPS
from teg.program.operations import divide, largest
from teg.program.statements import Isolate

if TYPE_CHECKING:
    from teg.program.interpreter.machine import Machine

Root = tuple[float, float]
"""A root, and how far it may be off."""


def isolate(machine: Machine, stmt: Isolate) -> list[float]:
    """Returns the roots in ascending order, then +inf; behind them their errors, if the statement has them."""
    count, errors = len(stmt.results), len(stmt.errors)
    lo, hi = machine.numbers((stmt.lo, stmt.hi))
    if not (math.isfinite(lo) and math.isfinite(hi)):
        return [math.nan] * (count + errors)
    roots = _Search(machine, stmt).roots(min(lo, hi), max(lo, hi)) if lo != hi else []
    if roots is None or len(roots) > count:
        machine.crowded = True
        return [math.nan] * (count + errors)
    machine.missed |= any(error > stmt.tol * abs(hi - lo) for _, error in roots)
    absent = count - len(roots)
    found = [root for root, _ in roots] + [math.inf] * absent
    return found + ([error for _, error in roots] + [0.0] * absent if errors else [])


@dataclass(frozen=True, slots=True)
class _Box:
    """A box (p, q), and g and g′ at its ends."""

    p: float
    q: float
    at_p: float
    at_q: float
    slope_p: float
    slope_q: float

    @property
    def changes(self) -> bool:
        """Returns whether g changes its sign."""
        return self.at_p <= 0.0 < self.at_q or self.at_q <= 0.0 < self.at_p

    @property
    def known(self) -> bool:
        """Returns whether g is a number at both ends."""
        return self.at_p == self.at_p and self.at_q == self.at_q

    @property
    def known_slopes(self) -> bool:
        """Returns whether g′ is."""
        return self.slope_p == self.slope_p and self.slope_q == self.slope_q


class _Search:
    def __init__(self, machine: Machine, stmt: Isolate) -> None:
        self.machine, self.stmt = machine, stmt
        self.found: list[Root] = []
        self.undecided: list[_Box] = []

    def roots(self, lo: float, hi: float) -> list[Root] | None:
        """Returns the roots in ascending order; None if there are too many boxes on a level."""
        (at_lo, slope_lo, _), (at_hi, slope_hi, _) = self._at(lo), self._at(hi)
        level = [_Box(lo, hi, at_lo, at_hi, slope_lo, slope_hi)]
        for depth in range(ISOLATE_DEPTH + 1):
            if len(level) > self.stmt.width:
                return None
            level = [half for box in level for half in self._judged(box, depth == ISOLATE_DEPTH)]
        for box in _joined(sorted(self.undecided, key=lambda box: box.p)):
            times = 1 if box.changes else 2 if box.known else 0
            self.found += [(0.5 * (box.p + box.q), 0.5 * (box.q - box.p))] * times
        return sorted(self.found)

    def _judged(self, box: _Box, last: bool) -> list[_Box]:
        """Returns the halves of a box, if it is to be halved."""
        m, h = 0.5 * (box.p + box.q), 0.5 * (box.q - box.p)
        least, most, slowest, fastest, bent_down, bent_up, noise = self._enclosed(box.p, box.q)
        g, slope, _ = self._at(m)
        if slowest == fastest == 0.0 or least == most == 0.0:  # the slope may be unknown where g is 0: 0·∞ at an infinite end
            return []
        reach = h * max(abs(slowest), abs(fastest)) if math.isfinite(slowest) and math.isfinite(fastest) else math.inf
        if not box.changes:
            if least > 0.0 or most < 0.0 or abs(g) - reach > (noise if math.isfinite(noise) else 0.0):
                return []
            if math.isnan(least) and math.isnan(most) and math.isnan(g):
                return []
        ends, steep = (least == -math.inf, most == math.inf), (slowest == -math.inf, fastest == math.inf)
        if (slowest > 0.0 or fastest < 0.0) and box.known and not (all(ends) and any(steep)):
            self.found += [(self._newton(box, 0), 0.0)] if box.changes else []
            return []
        if (bent_down > 0.0 or bent_up < 0.0) and box.known and box.known_slopes and not (any(ends) and all(steep)):
            if box.changes:
                self.found.append((self._newton(box, 0), 0.0))
            elif (box.slope_p > 0.0) != (box.slope_q > 0.0) and (box.at_p > 0.0) == (bent_down > 0.0):
                self._turned(box)
            return []
        bend = largest(abs(bent_down), abs(bent_up))
        blurred = abs(g) + h * abs(slope) + 0.5 * h * h * bend <= noise or (not box.changes and abs(g) + reach <= noise)
        if last or (blurred and math.isfinite(noise)):
            self.undecided.append(box)
            return []
        if not box.p < m < box.q:
            return [box]
        return [replace(box, q=m, at_q=g, slope_q=slope), replace(box, p=m, at_p=g, slope_p=slope)]

    def _turned(self, box: _Box) -> None:
        """The roots of a box in which g turns towards 0: a tangency, two, or none."""
        t = self._newton(box, 1)
        g, slope, curvature = self._at(t)
        noise = self._enclosed(t, t)[6]
        if abs(g) <= noise < math.inf:
            self.found += [(t, math.sqrt(divide(2.0 * noise, abs(curvature))))] * 2
        elif (g > 0.0) != (box.at_p > 0.0):
            halves = replace(box, q=t, at_q=g, slope_q=slope), replace(box, p=t, at_p=g, slope_p=slope)
            self.found += [(self._newton(half, 0), 0.0) for half in halves]

    def _newton(self, box: _Box, order: int) -> float:
        """Returns the zero in a box of g (order 0) or of g′ (order 1) by Newton's method, kept inside by bisection."""
        p, q, above = box.p, box.q, (box.at_q, box.slope_q)[order] > 0.0
        v = 0.5 * (p + q)
        before = last = math.inf
        for _ in range(ISOLATE_STEPS):
            value, slope = self._at(v)[order : order + 2]
            if value == 0.0:
                break
            p, q = (p, v) if (value > 0.0) == above else (v, q)
            step = -divide(value, slope)
            if p <= v + step <= q and step != 0.0 and not abs(step) > 0.5 * before:
                v = v + step
            else:
                step = 0.5 * (p + q) - v
                v = 0.5 * (p + q)
            before, last = last, abs(step)
            if last <= 2.0**-52 * abs(v):
                break
        return v

    def _at(self, v: float) -> list[float]:
        """Returns g, g′ and g″ at a point."""
        stmt = self.stmt
        return self.machine.at(stmt.point, (stmt.value, stmt.slope, stmt.curvature), **{stmt.var: v})

    def _enclosed(self, left: float, right: float) -> list[float]:
        """Returns bounds of g, g′ and g″ over a box, and the noise."""
        stmt = self.stmt
        return self.machine.at(stmt.enclosure, (*stmt.bounds, *stmt.curving, stmt.noise), **{stmt.left: left, stmt.right: right})


def _joined(boxes: list[_Box]) -> list[_Box]:
    """Returns boxes that share an end as one."""
    joined: list[_Box] = []
    for box in boxes:
        if joined and joined[-1].q == box.p:
            joined[-1] = replace(joined[-1], q=box.q, at_q=box.at_q, slope_q=box.slope_q)
        else:
            joined.append(box)
    return joined
