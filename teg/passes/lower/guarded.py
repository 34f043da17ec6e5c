"""The guard of an adaptive integral: bounds of its integrands and of their sharp values over a box, for `Integrate` of `teg.program`.

A feature between all nodes changes no value of the rule. But its node (`teg.analysis.sharp`) has an enclosure over the gap, which is
compared with its values at the nodes beside it. If the node stands in an inner integral, the bound over the gap and the inner range is
compared with those over the nodes and the inner range: both come from one enclosure, so they agree in a gap that is short enough. (The
largest value in the inner integral is no such measure, because brackets may cut the range.) At the ends of the inner range, and at its
breaks, the sharp value is one of the outer variable alone: a ridge that leaves the domain, or meets a slit, has a layer there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import cast

from teg.analysis.beside import beside
from teg.analysis.breaks import BreakAnalysis
from teg.analysis.endless import bound_to_infinity
from teg.analysis.intervals import Enclosure, Interval
from teg.analysis.polynomial import Degrees
from teg.analysis.sharp import LARGEST, Sharp, bounds, numeric_range, range_of, sharp_value, sharp_values, sizes, tame_ones
from teg.analysis.singularities import Keys, factors_of
from teg.analysis.surfaces import binders_inside
from teg.analysis.tails import is_unbounded
from teg.ir.expr import ZERO, Compare, Expr, Pow, Var, Where, const, is_infinite
from teg.ir.integral import Integral, outermost_integrals
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, mul, positive, sub, where
from teg.ir.traverse import fresh, rewrite, substitute
from teg.numerics.quadrature import gauss_legendre
from teg.passes.lower.changes import Changes
from teg.passes.lower.emit import Emitter
from teg.passes.lower.levels import Level
from teg.program import Adaptive, Arg, Guard

CUBIC_RATE = 1.5
"""The factor by which a cubic's place may move faster than on a straight line."""
WIDE_GAP = 0.4
"""The largest fraction of a piece in one gap, for rules that are not known yet."""
_INFINITY = const(math.inf)
MAX_FACES = 16
"""The largest number of ends and breaks of an inner range at which a sharp value is looked at."""


def widest_gap(rule: Adaptive) -> float:
    """Returns the largest fraction of a piece between neighbouring nodes, or beside an end, on a straight line or a cubic."""
    widest = 0.0
    for nodes in {rule.first, rule.order}:
        places = [-1.0, *gauss_legendre(nodes)[0], 1.0]
        widest = max(widest, *(0.5 * (b - a) for a, b in pairwise(places)))
    return widest * (CUBIC_RATE if rule.cubic else 1.0)


@dataclass(frozen=True)
class Peak:
    """A node of an inner integrand, and the integrals around it from the outermost one."""

    node: Expr
    path: tuple[Integral, ...]


@dataclass(frozen=True)
class Bounded:
    """A sharp value: its value at a node, its bounds over the box of the guard, and a bound of what an integrand changes by where it is
    below the upper one; another upper bound of a box that reaches to infinity, NaN where it is not known."""

    seen: Arg
    upper: Expr
    lower: Expr
    change: Expr
    endless: Expr | None = None


class Guards:
    """Makes the guards of adaptive integrals. Statements go to `out`."""

    def __init__(self, out: Emitter, analysis: BreakAnalysis) -> None:
        self.out, self.analysis = out, analysis
        self.degrees = Degrees()
        self.peaks: dict[Integral, tuple[Peak, ...]] = {}

    def guard(
        self, group: Sequence[Integral], weight: Expr, known: Sequence[Sharp], level: Level, home: Level, gap: float | None
    ) -> Guard | None:
        """Returns the guard of integrals that share a loop, with these sharp values of their own and those of inner integrals; integrands
        are multiplied by the weight."""
        x, bodies = group[0].var, [mul(weight, i.body) for i in group]
        taken = frozenset[Var]().union(*(b.free for b in bodies), *(s.value.free for s in known))
        left, right = fresh(x.name + "₋", taken), fresh(x.name + "₊", taken)
        boxed = Enclosure({x: (left, right)})
        inside = self._inside(bodies, x, gap)
        faces = self._steep_faces(inside, x, gap)
        own, known = set(known), [*known, *faces]
        on_piece = _OnPiece(self.out, [*bodies, *(s.value for s in known), *(s.argument for s in known)], x, level)
        changes = Changes([on_piece.of(b) for b in bodies], boxed)
        found: list[Bounded] = []
        for sharp in known:
            settled = replace(sharp, value=on_piece.of(sharp.value), argument=on_piece.of(sharp.argument))
            if (b := bounds(settled, boxed)) is not None:
                endless = bound_to_infinity(settled.value, b[1], x, boxed.box) if is_unbounded(group[0]) else None
                owners = [changes.of(on_piece.of(sharp.node), b[0])] if sharp in own else []
                owners += [self._change(changes, on_piece, peak, b[0]) for peak in faces.get(sharp, ())]
                found.append(Bounded(self.out.number(sharp.value, level), *b, add(*owners), endless))
        for peak in inside:
            if (known_bounds := self._bounds_inside(peak, x, boxed)) is not None:
                upper, seen = known_bounds
                change = self._change(changes, on_piece, peak, upper)
                found.append(Bounded(self.out.number(seen, level), upper, upper, change))
        if not found:
            return None
        names = self.out.fresh("x"), self.out.fresh("x")
        levels = on_piece.levels(home)
        at_left = levels[-1].inside(left, names[0])
        at_both = at_left.inside(right, names[1])
        extents = tuple(self.out.number(e, at_both) for e in sizes([on_piece.of(b) for b in bodies], boxed))
        upper_names = tuple(self._least(b, at_both) for b in found)
        lower_names = tuple(self.out.number(b.lower, at_both) for b in found)
        change_names = tuple(self.out.number(b.change, at_both) for b in found)
        block = tuple(s for at in (*levels[1:], at_left, at_both) for s in at.block)
        return Guard(*names, block, extents, upper_names, lower_names, change_names, tuple(b.seen for b in found))

    def _bounds_inside(self, peak: Peak, x: Var, boxed: Enclosure) -> tuple[Expr, Expr] | None:
        """Returns the bound of a peak over a box and over the slice at a node; None if they are not known. An inner singularity is not
        searched for: its bound is 0."""
        sharp = cast(Sharp, sharp_value(peak.node, x, self.degrees, 2))
        slices = [_around(peak, box) for box in (boxed.box, {x: (x, x)})]
        known = [b[0] for box in slices if box is not None and (b := bounds(sharp, Enclosure(box))) is not None]
        if len(known) < 2:
            return None
        upper, seen = (where(positive(sub(const(LARGEST), b)), b, ZERO) for b in known)
        return upper, seen

    def _change(self, changes: Changes, on_piece: _OnPiece, peak: Peak, upper: Expr) -> Expr:
        """Returns a bound of what the integrands change by where a peak is below an upper bound; infinite for one in several integrals."""
        if len(peak.path) != 1:
            return _INFINITY
        return changes.of(on_piece.of(peak.node), upper, cast(Integral, on_piece.of(peak.path[0])))

    def _least(self, found: Bounded, level: Level) -> Arg:
        """Returns the name of the least upper bound."""
        upper = self.out.number(found.upper, level)
        if found.endless is None:
            return upper
        endless = self.out.number(found.endless, level)
        known = self.out.assign(level, "ok", endless)
        return self.out.assign(level, "select", known, self.out.assign(level, "min", upper, endless), upper)

    def not_tame(self, known: Sequence[Sharp], x: Var, gap: float | None) -> list[Sharp]:
        """Returns the sharp values that may change much between neighbouring nodes in x."""
        return [s for s, tame in zip(known, tame_ones(known, self.out.ranges, x, gap), strict=True) if not tame]

    def note_peaks(self, group: Sequence[Integral], home: Level) -> None:
        """Records the nodes of integrals at this level that may be sharp as seen from outer integrals."""
        outside = list(_variables(home))
        if not outside:
            return
        x, bodies = group[0].var, [i.body for i in group]
        own = [s.node for s in sharp_values(bodies, x, self.out.binders(bodies), self.degrees, 2) if not s.wave]
        inside = self._peaks_in(bodies, x)
        sharp = self._sharp_outside([*own, *(p.node for p in inside)], outside)
        for node in group:
            peaks = [Peak(n, (node,)) for n in own] + [Peak(p.node, (node, *p.path)) for p in inside]
            self.peaks[node] = tuple(p for p in peaks if p.node in sharp)

    def _sharp_outside(self, nodes: Sequence[Expr], outside: Sequence[Var]) -> set[Expr]:
        """Returns the nodes that are sharp as seen from one of the outer integrals."""
        found: set[Expr] = set()
        for v in outside:
            seen = [sharp_value(n, v, self.degrees, 2) for n in nodes if v in n.free and n not in found]
            found.update(s.node for s in self.not_tame([s for s in seen if s is not None], v, WIDE_GAP))
        return found

    def _peaks_in(self, bodies: Sequence[Expr], x: Var) -> list[Peak]:
        """Returns the recorded peaks of the integrals in these integrands that depend on x, without those of deeper integrals."""
        return list(dict.fromkeys(peak for i in outermost_integrals(bodies, x) for peak in self.peaks.get(i, ())))

    def _inside(self, bodies: Sequence[Expr], x: Var, gap: float | None) -> list[Peak]:
        """Returns the sharp values of inner integrals that are not tame as seen from x."""
        paths: dict[tuple[Integral, ...], list[tuple[Peak, Sharp]]] = {}
        for peak in self._peaks_in(bodies, x):
            sharp = sharp_value(peak.node, x, self.degrees, 2) if x in peak.node.free else None
            if sharp is not None:
                paths.setdefault(peak.path, []).append((peak, sharp))
        found: list[Peak] = []
        for path, entries in paths.items():
            ranges = dict(self.out.ranges)
            for node in path:
                ranges = numeric_range(node, ranges)
            tame = tame_ones([s for _, s in entries], ranges, x, gap)
            found += [peak for (peak, _), known in zip(entries, tame, strict=True) if not known]
        return found

    def _steep_faces(self, peaks: Sequence[Peak], x: Var, gap: float | None) -> dict[Sharp, list[Peak]]:
        """Returns the values of peaks at the ends and the breaks of inner ranges that may change much between neighbouring nodes in x."""
        found: dict[Sharp, list[Peak]] = {}
        for peak in peaks:
            for sharp in dict.fromkeys(self._faces(peak, x)):
                found.setdefault(sharp, []).append(peak)
        return {sharp: found[sharp] for sharp in self.not_tame(list(found), x, gap)}

    def _faces(self, peak: Peak, x: Var) -> Iterator[Sharp]:
        """Yields a sharp value at both ends of the range of the only integral around it, and at its breaks with a formula that are no poles
        of it."""
        if len(peak.path) != 1:
            return
        (inner,) = peak.path
        known = self.analysis.of(inner)
        surfaces = () if _has_pole_on(peak.node, inner.var, known.handled) else known.points.items()
        faces = [(end, peak.node) for end in (inner.lo, inner.hi)]
        for point, g in surfaces:
            place = _within(point.then if isinstance(point, Where) else point, inner)
            faces += [(place, node) for node in beside(peak.node, inner.var, g)]
        for place, node in faces[:MAX_FACES]:
            if not is_infinite(place):
                at_place = cast(Expr, substitute(node, {inner.var: place}))
                sharp = sharp_value(at_place, x, self.degrees, 2) if x in at_place.free else None
                if sharp is not None and not sharp.wave:
                    yield sharp


def _within(point: Expr, inner: Integral) -> Expr:
    """Returns the place in the range of an integral that is nearest to a point: beyond the ends an integrand may grow without bounds."""
    low, high = inner.lo, inner.hi
    if is_infinite(high):
        return point if is_infinite(low) else call("max", point, low)
    if is_infinite(low):
        return call("min", point, high)
    return call("min", call("max", point, call("min", low, high)), call("max", low, high))  # a range may be turned around


class _OnPiece:
    """Expressions in x with new variables in the place of conditions that are constant on a piece: enclosures are those of one side."""

    def __init__(self, out: Emitter, expressions: Sequence[Expr], x: Var, level: Level) -> None:
        taken = frozenset[Var]().union(*(e.free for e in expressions))
        inner = frozenset[Var]().union(*(binders_inside(e) for e in expressions))
        self.truths: dict[Compare, tuple[Var, tuple[Arg, Arg]]] = {}
        for node in postorder(expressions):
            if isinstance(node, Compare) and x in node.free and not node.free & inner and level.is_constant(node):
                side = fresh(f"side{len(self.truths)}", taken)
                self.truths[node] = side, out.truths(node, level)
        self._rewritten: dict[Node, Node] = {}
        if self.truths:
            self._rewritten = rewrite(expressions, self._settled)

    def _settled(self, old: Node, new: Node) -> Node:
        known = self.truths.get(cast(Compare, old))
        return new if known is None else positive(known[0])

    def of(self, e: Expr) -> Expr:
        """Returns an expression with its conditions replaced."""
        return cast(Expr, self._rewritten.get(e, e))

    def levels(self, home: Level) -> list[Level]:
        """Returns the level around a guard's block, and one more for each condition, where its truth has a name."""
        levels = [home]
        for side, truths in self.truths.values():
            inside = levels[-1].inside(side, truths[0])
            inside.names[positive(side)] = truths
            levels.append(inside)
        return levels


def _has_pole_on(e: Expr, x: Var, surfaces: Iterable[Expr]) -> bool:
    """Returns whether a denominator in e is 0 on one of the surfaces, so that e has no value at the breaks there."""
    keys = Keys()
    below = [n.base for n in postorder([e]) if isinstance(n, Pow) and n.exponent < 0 and x in n.base.free]
    poles = {keys.of(factor) for base in below for factor in factors_of(base)}
    return bool(poles) and any(keys.of(g) in poles for g in surfaces)


def _variables(level: Level | None) -> Iterator[Var]:
    """Yields the variables of the outer integrals."""
    while level is not None:
        if level.var is not None:
            yield level.var
        level = level.outer


def _around(peak: Peak, box: Mapping[Var, Interval]) -> dict[Var, Interval] | None:
    """Returns the box with the ranges of the variables of the integrals around a node; None if they are not known."""
    larger = dict(box)
    for node in peak.path:
        low, high = range_of(node, larger)
        if low is None or high is None:
            return None
        larger[node.var] = low, high
    return larger
