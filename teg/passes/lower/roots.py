"""Roots as statements of `teg.program`, and sums over them.

`∫ F·δ(g) dx`, with |∂g/∂x| divided out, is the sum of F over the roots of g in x. If all roots have formulas these are written out, one
after the other (`solve`); otherwise an `Isolate` finds them at run time and a `SumOver` sums over them. A `Locate` finds where two
surfaces meet, for the breaks of an outer integral.

A root is not exact: values at a root carry its error, so that conditions on surfaces through the same point tie (`Emitter.tie`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import cast

from teg.analysis.isolation import MAX_ROOTS, Isolation, Location, has_pole, isolate, off_the_grid, widened
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import Root, solve
from teg.analysis.sharp import LARGEST
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import finite_place, is_unbounded
from teg.ir.expr import ONE, TRUE, Compare, Expr, Var, Where, const, has_cut, is_infinite
from teg.ir.integral import Integral, PointMasses
from teg.ir.node import postorder
from teg.ir.simplify import call, positive, sub, where
from teg.ir.traverse import replace_node, substitute
from teg.passes.lower.emit import NAN, Emitter
from teg.passes.lower.levels import Level, Plan, Truths
from teg.passes.lower.rounding import SHORT
from teg.program import ISOLATE_WIDTH, TIE_EPS, Arg, Isolate, Locate, SumOver

_NOWHERE = float("inf")
BOXES = 8
"""The room for boxes of a level, as a multiple of the number of roots."""
_ROOT_ERROR = 4.0
"""The largest error of a root found at run time, in ε of its size."""

_AT_ROOT, _MOVED = 1e-9, 2.0**-40
"""How large g may be at a root, relative to its terms, and how far a root may be off, relative to its size, where g may jump instead."""


class Roots:
    """Finds roots, and sums over them. `when` is the guard of the integral concerned, if it has one."""

    def __init__(self, out: Emitter, plan: Plan, max_roots: int, tol: float) -> None:
        self.out, self.plan = out, plan
        self.max_roots, self.tol = max_roots, tol

    # -- roots ---------------------------------------------------------------------------------------------------------

    def isolated(self, isolation: Isolation, lo: Expr, hi: Expr, home: Level, when: str | None, soft: bool = False) -> tuple[Arg, ...]:
        """Returns the roots of a function between two bounds, found at run time. An integrand is continuous at `soft` ones."""
        search = isolation.g, isolation.region, isolation.var, lo, hi, soft
        return self._found(search, home, when, partial(self._isolate, isolation, lo, hi, home, soft))

    def _found(self, search: object, home: Level, when: str | None, emit: Callable[[str | None], tuple[Arg, ...]]) -> tuple[Arg, ...]:
        """Returns the results of a search, which runs where `when` holds and no earlier one for the same has run."""
        if search not in home.searches:
            home.searches[search] = when, emit(when)
            return home.searches[search][1]
        before, results = home.searches[search]
        if before is None or before == when:
            return results
        again = self.out.assign(home, "not", before)
        others = emit(again if when is None else self.out.assign(home, "and", again, when))
        both = tuple(self.out.assign(home, "select", before, *two) for two in zip(results, others, strict=True))
        home.searches[search] = None if when is None else self.out.assign(home, "or", before, when), both
        return both

    def _isolate(self, isolation: Isolation, lo: Expr, hi: Expr, home: Level, soft: bool, when: str | None) -> tuple[Arg, ...]:
        ends = self.out.number(lo, home), self.out.number(hi, home)
        left, right, var = (self.out.fresh("x") for _ in range(3))
        at_left = home.inside(isolation.left, left)
        at_both = at_left.inside(isolation.right, right)
        bounds = self._bounds(isolation, at_both)
        curving = cast("tuple[Arg, Arg]", tuple(self.out.number(b, at_both) for b in isolation.curving))
        noise = self._noise(isolation, left, right, at_both)
        at_point = home.inside(isolation.var, var)
        slope = _slope_beside_poles(isolation)
        defined = where(isolation.region, isolation.g, const(NAN))
        value, rate, curvature = (self.out.number(e, at_point) for e in (defined, slope, isolation.curvature))
        results = tuple(self.out.fresh("v") for _ in range(isolation.count))
        enclosure, point = (*at_left.block, *at_both.block), tuple(at_point.block)
        width = max(ISOLATE_WIDTH, BOXES * self.max_roots)
        found = Isolate(var, *ends, left, right, enclosure, bounds, point, value, rate, results, when, width=width, soft=soft)
        tol = self.tol ** (2 / 3) if soft else self.tol
        home.block.append(replace(found, curving=curving, noise=noise, curvature=curvature, tol=tol))
        return results

    def _bounds(self, isolation: Isolation, at_both: Level) -> tuple[Arg, Arg, Arg, Arg]:
        """Returns the bounds of g and its slope over a box. Outside of the region of interest those of g are no numbers; across its border
        they are infinite where they are not known, as a box that is no number may be left out."""
        low, high, down, up = (self.out.number(b, at_both) for b in isolation.bounds)
        if isolation.region is TRUE:
            return low, high, down, up
        across, outside = (self.out.truths(c, at_both)[0] for c in (isolation.across, isolation.outside))

        def narrowed(bound: Arg, far: float) -> Arg:
            known = self.out.assign(at_both, "select", self.out.assign(at_both, "ok", bound), bound, far)
            return self.out.assign(at_both, "select", outside, NAN, self.out.assign(at_both, "select", across, known, bound))

        return narrowed(low, -math.inf), narrowed(high, math.inf), down, up

    def _noise(self, isolation: Isolation, left: str, right: str, at_both: Level) -> Arg:
        """Returns a bound of the effect of rounding on g in the middle of a box."""
        middle = self.out.assign(at_both, "mul", 0.5, self.out.assign(at_both, "add", left, right))
        at_middle = at_both.inside(isolation.var, middle)
        at_middle.block = at_both.block
        return self.out.assign(at_middle, "mul", TIE_EPS, self.out.rounding.tie_scale(isolation.g, at_middle))

    def isolated_in(self, node: Integral, isolation: Isolation, home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns the roots of a function within the bounds of an integral, up to infinity if need be."""
        return self._isolated_between((node.lo, node.hi), node, isolation, home, when, False)

    def breaks_in(
        self, node: Integral, ends: tuple[Expr, Expr], isolation: Isolation, home: Level, when: str | None, soft: bool
    ) -> tuple[Arg, ...]:
        """Returns the same between the ends of what counts, and a little beyond. The integrand is continuous at `soft` ones."""
        if is_unbounded(node) and not any(is_infinite(e) for e in ends):
            return self.isolated(isolation, *widened(*ends), home, when, soft)
        bounds = ends if is_unbounded(node) else widened(*ends)
        return self._isolated_between(bounds, node, isolation, home, when, soft)

    def _isolated_between(
        self, bounds: tuple[Expr, Expr], node: Integral, isolation: Isolation, home: Level, when: str | None, soft: bool
    ) -> tuple[Arg, ...]:
        if not is_unbounded(node):
            return self.isolated(isolation, *bounds, home, when, soft)
        s, (start, end), place, _ = finite_place(node, [v for v in isolation.g.free if isinstance(v, Var)])
        bent = isolate(cast(Expr, substitute(isolation.g, {node.var: place})), s, isolation.count)
        if bent is None:
            raise AssertionError(f"the roots of {isolation.g} cannot be isolated")
        found = self.isolated(bent, start, end, home, when, soft)
        places = [self.out.number(place, Level(s, home, home.depth + 1, names={s: root}, block=home.block)) for root in found]
        return tuple(
            self.out.assign(home, "select", self.out.assign(home, "lt0", self.out.assign(home, "sub", root, _NOWHERE)), at, root)
            for root, at in zip(found, places, strict=True)
        )

    def located(self, location: Location, lo: Expr, hi: Expr, home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns where two surfaces meet, seen from the outer variable."""
        search = (location.f, location.g, location.inner, location.outer, location.low, location.high, lo, hi)
        return self._found(search, home, when, partial(self._locate, location, lo, hi, home))

    def _locate(self, location: Location, lo: Expr, hi: Expr, home: Level, when: str | None) -> tuple[Arg, ...]:
        rectangle = (*off_the_grid(lo, hi), *off_the_grid(location.low, location.high))
        first, last, low, high = (self.out.number(e, home) for e in rectangle)
        left, right, bottom, top = (self.out.fresh("x") for _ in location.corners)
        level, blocks = home, []
        for corner, name in zip(location.corners, (left, right, bottom, top), strict=True):
            level = level.inside(corner, name)
            blocks.append(level.block)
        bounds = tuple(self.out.number(b, level) for b in location.bounds)
        enclosure = tuple(s for block in blocks for s in block)
        results = tuple(self.out.fresh("v") for _ in range(max(MAX_ROOTS, self.max_roots)))
        lost = self.out.fresh("v") if location.smooth else None  # for surfaces with kinks many empty rectangles are given up
        home.block.append(Locate(first, last, low, high, left, right, bottom, top, enclosure, bounds, results, when, lost))
        return results

    def point(self, root: Root, home: Level) -> Arg:
        """Returns a root by its formula; +inf where it does not exist."""
        holds, fails = self.out.truths(root.exists, home)
        at = self.out.number(root.point, home)
        known = self.out.assign(home, "select", self.out.assign(home, "ok", at), at, _NOWHERE)  # 0/0: the degree is lower
        absent = _NOWHERE if fails is True else self.out.assign(home, "select", fails, _NOWHERE, NAN)
        return known if holds is True else self.out.assign(home, "select", holds, known, absent)

    def _level_at_roots(self, x: Var, home: Level) -> tuple[str, Level]:
        """Returns the name of a root found at run time, and the inside of the sum over such roots, where x is not exact."""
        var = self.out.fresh("x")
        level = home.inside(x, var)
        level.errors[x] = self.out.assign(level, "mul", _ROOT_ERROR, self.out.size(x, level))
        return var, level

    def _level_at_formula(self, x: Var, root: Root, home: Level) -> Level:
        """Returns the level of a root that has a formula. It has no inside: statements go where those of its home go."""
        level = home.inside(x, self.point(root, home))
        level.block = home.block
        level.errors[x] = self.out.rounding.error(root.point, home)
        return level

    # -- sums over roots -----------------------------------------------------------------------------------------------

    def sum_over_roots(self, group: Sequence[Integral], masses: PointMasses, home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns Σ over the roots of g of the factor of its point masses, for each of the integrals that share them."""
        node = group[0]
        bodies = [cast(Expr, replace_node(i.body, masses, ONE)) for i in group]
        roots = solve(masses.g, node.var, node.lo, node.hi)
        if roots is not None and roots.certain:
            return self._sum_of_branches(masses.g, bodies, node.var, roots.found, home)
        isolation = isolate(masses.g, node.var, self.max_roots)
        if isolation is None:
            raise AssertionError(f"the roots of {masses.g} cannot be isolated")
        points = self.isolated_in(node, isolation, home, when)
        var, level = self._level_at_roots(node.var, home)
        if home.middle is not None:
            level.coincident = self._coincident(node, isolation, bodies, home.middle)
        self.plan(level, bodies)
        values = tuple(self.out.number(b, level) for b in bodies)
        if masses.g.free == {node.var}:
            values = self._where_slope_is_known(isolation.slope, values, level)
        if any(has_cut(n) or isinstance(n, Where) for n in postorder([masses.g]) if node.var in n.free):
            values = self._without_jumps(isolation, values, level)
        results = tuple(self.out.fresh("v") for _ in group)
        home.block.append(SumOver(var, points, tuple(level.block), values, results, when))
        return results

    def _where_slope_is_known(self, slope: Expr, values: Sequence[Arg], level: Level) -> tuple[Arg, ...]:
        """Returns values that are divided by the slope at a root; NaN where rounding alone could have made that slope."""
        size = self.out.size(slope, level)
        noise = self.out.assign(level, "mul", TIE_EPS, self.out.rounding.tie_scale(slope, level))
        small = self.out.assign(level, "ge0", self.out.assign(level, "sub", noise, size))
        unknown = self.out.assign(level, "and", small, self.out.assign(level, "gt0", size))
        return tuple(self.out.assign(level, "select", unknown, NAN, v) for v in values)

    def _without_jumps(self, isolation: Isolation, values: Sequence[Arg], level: Level) -> tuple[Arg, ...]:
        """Returns values; 0 where g is not 0: it jumps there, at the cut of an angle, and a jump that stays has no mass."""
        out, rate, place = self.out, self.out.size(isolation.slope, level), self.out.size(isolation.var, level)
        least = out.assign(level, "mul", _AT_ROOT, out.rounding.tie_scale(isolation.g, level))
        least = out.assign(level, "add", least, out.assign(level, "mul", _MOVED, rate, place))
        jump = out.assign(level, "sub", out.size(isolation.g, level), least)
        jumps = out.assign(level, "gt0", jump)
        return tuple(out.assign(level, "select", jumps, 0.0, v) for v in values)

    def _sum_of_branches(self, g: Expr, bodies: Sequence[Expr], x: Var, roots: Sequence[Root], home: Level) -> tuple[Arg, ...]:
        """Returns the same for roots with formulas, one after the other.

        On a piece between complete breaks the conditions at a root are constant, and are decided in its middle, away from where they
        change.
        """
        inner = self.out.binders(bodies)
        atoms = [c for c in dict.fromkeys(c for b in bodies for c in atoms_of(b, x)) if not c.g.free & inner]
        terms: list[list[Arg]] = [[] for _ in bodies]
        degree = Shadow((x,) if home.var is None else (x, home.var)).degree(g)
        for root in roots:
            level = self._level_at_formula(x, root, home)
            if home.middle is not None and home.breaks is not None and home.breaks.complete:
                middle = self._level_at_formula(x, root, home.middle)
                middle.twisted = degree is None or degree > SHORT
                if home.middle.elsewhere is not None:
                    middle.elsewhere = cache(partial(self._roots_elsewhere, x, root, home.middle.elsewhere))
                for atom in atoms:
                    level.names[atom] = self._decided(atom, middle, level)
            at = cast(Arg, level.names[x])
            finite = self.out.assign(home, "ok", self.out.assign(home, "sub", at, at))
            absent = self.out.assign(home, "select", self.out.assign(home, "ok", at), 0.0, NAN)
            self.plan(level, bodies)
            for body, found in zip(bodies, terms, strict=True):
                found.append(self.out.assign(home, "select", finite, self.out.number(body, level), absent))
        return tuple(found[0] if len(found) == 1 else self.out.assign(home, "add", *found) if found else 0.0 for found in terms)

    def _decided(self, atom: Compare, middle: Level, level: Level) -> Truths:
        """Returns the truths of a condition that is constant on a piece: its sign at the node where that is clear, else the decision for
        the piece.

        Surfaces that approach each other may coincide to rounding in the middle of a long piece, and be apart at its ends.
        """
        holds, fails = self.out.truths(atom, middle)
        if atom.resolution is None or middle.elsewhere is None or atom.g.has_integral or self.out.rounding.is_short(atom.g, middle):
            return holds, fails
        g = self.out.number(atom.g, level)
        room = self.out.assign(level, "mul", TIE_EPS, self.out.rounding.tie_scale(atom.g, level))
        clear = self.out.assign(level, "gt0", self.out.assign(level, "sub", self.out.size(atom.g, level), room))
        above = self.out.assign(level, "gt0", g)
        unclear, below = self.out.assign(level, "not", clear), self.out.assign(level, "not", above)

        def chosen(sign: Arg, verdict: Arg) -> Arg:
            here, piece = self.out.assign(level, "and", clear, sign), self.out.assign(level, "and", unclear, verdict)
            return self.out.assign(level, "or", here, piece)

        return chosen(above, holds), chosen(below, fails)

    def _roots_elsewhere(self, x: Var, root: Root, places: Callable[[], Sequence[Level]]) -> Sequence[Level]:
        """Returns a root of a formula at other places of a piece of the outer integral."""
        return [self._level_at_formula(x, root, place) for place in places()]

    def _coincident(self, node: Integral, isolation: Isolation, bodies: Sequence[Expr], middle: Level) -> dict[Compare, Arg]:
        """Returns the conditions that tie with the surface g in the middle of a piece of the outer integral.

        Only these can tie all along the piece. Two surfaces that touch in a point do not tie.
        """
        inner = self.out.binders(bodies)
        rivals = dict.fromkeys(c for b in bodies for c in atoms_of(b, node.var) if c.resolution is not None and not c.g.free & inner)
        if not rivals:
            return {}
        points = self.isolated_in(node, isolation, middle, None)
        var, level = self._level_at_roots(node.var, middle)
        values = []
        for c in rivals:
            room = self.out.assign(level, "mul", TIE_EPS, self.out.rounding.tie_scale(c.g, level))
            near = self.out.assign(level, "ge0", self.out.assign(level, "sub", room, self.out.size(c.g, level)))
            values.append(self.out.assign(level, "select", near, 1.0, 0.0))
        results = tuple(self.out.fresh("v") for _ in rivals)
        middle.block.append(SumOver(var, points, tuple(level.block), tuple(values), results))
        return {c: self.out.assign(middle, "gt0", r) for c, r in zip(rivals, results, strict=True)}


def _slope_beside_poles(isolation: Isolation) -> Expr:
    """Returns the slope of a function, no number where the function is infinite: c - 1/x² at 0 rises on one side and falls on the
    other, which no sign of an infinity tells."""
    g = isolation.g
    if not has_pole(g, isolation.var):
        return isolation.slope
    return where(positive(sub(const(LARGEST), call("magnitude", g))), isolation.slope, const(NAN))
