"""The places between which an integral is computed: its bounds, its breaks, and the data of its rule about them.

bends      where the integrand turns into another branch, or has a pole: coordinates follow them
watched    signs of conditions that may change where no break is known
peaks      narrow Gaussians, which the nodes of the whole range would miss
centres    around which an integrand on an infinite range has its features
scale      the length on which tails fall off
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from itertools import combinations
from typing import cast

from teg.analysis.breaks import MAX_BENDS, Breaks
from teg.analysis.calculus import slope
from teg.analysis.centres import BELL, DECAY, Centre, Search
from teg.analysis.decay import steepest_of_slow
from teg.analysis.isolation import isolate
from teg.analysis.projection import Turn
from teg.analysis.roots import local_origin, solve
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import infinite_ends, is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Call, Compare, Cond, Expr, Var, called, calls_of, const, has_cut
from teg.ir.integral import Integral, PointMasses
from teg.ir.node import postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, mul, positive, sub, where
from teg.ir.traverse import substitute
from teg.passes.lower.emit import NAN, Emitter
from teg.passes.lower.features import Features
from teg.passes.lower.levels import Level
from teg.passes.lower.means import Mean, without_tails
from teg.passes.lower.roots import Roots
from teg.passes.lower.rules import Rules
from teg.program import INFINITE, TIE_EPS, Adaptive, Arg, Bend, Rule

RESOLVED = 64 * 2.0**-52
"""A feature that is narrower, relative to its place, is lost in the rounding of places."""
NEAR = 8.0
"""A centre that is nearer than so many of its widths to a bound, or to another centre, is seen by the nodes around that."""
REACH = 650.0
"""The logarithm of the largest number that is computed at the nodes of a slow tail. Half of it is enough for x^-1.1 to fall to 1e-14."""


class Pieces:
    """Pieces of the integrals of one program. Statements go to `out`."""

    def __init__(self, out: Emitter, rules: Rules, roots: Roots) -> None:
        self.out, self.rules, self.roots = out, rules, roots
        self.analysis = rules.analysis
        self.features = Features(rules, out.binders)
        self.centres = self.features.centres

    def of(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[Arg, Arg, tuple[Arg, ...]]:
        """Returns the lower bound, the upper bound, and the breaks between them."""
        node = group[0]
        analysis = self.analysis.of(node)
        ends = self._ends(group, home)
        lo, hi = (self.out.number(end, home) for end in ends)
        breaks = surfaces = tuple(self.out.number(p, home) for p in analysis.points)
        breaks += self._peaks(group, home) + self._centres(group, home) + self._curved_centres(group, home, when)
        if self.features.ends_at_both(node):
            breaks += (self.out.number(mul(const(0.5), add(node.lo, node.hi)), home),)  # no piece is singular at both ends
        decisive = self._decisive(group, home)
        for place in self.features.singular_places(node):
            at, apart = self.out.number(place, home), self.scale(group, home)
            breaks += tuple(self.out.assign(home, op, at, apart) for op in ("sub", "add"))  # no tail begins where it is singular
        bounded = not any(turn.kind in ("pole", "end") for turn in analysis.bends)
        for isolation in analysis.isolated:
            found = self.roots.breaks_in(node, ends, isolation, home, when, soft=bounded and isolation.g not in decisive)
            if isolation.g in decisive:  # too many roots: NaN
                lo = self.out.assign(home, "select", self.out.assign(home, "ok", found[0]), lo, NAN)
            mattering = self._mattering(found, analysis.matters[isolation.g], node.var, home)
            breaks, surfaces = (*breaks, *mattering), (*surfaces, *mattering)
        if not all(self.rules.is_exact(i, home.depth) for i in group):
            breaks += self._tails(group, (lo, hi, *surfaces), home)
        for location in analysis.located:
            breaks += self.roots.located(location, node.lo, node.hi, home, when)
        return lo, hi, breaks

    def _ends(self, group: Sequence[Integral], home: Level) -> tuple[Expr, Expr]:
        """Returns the bounds of integrals; of Gaussians in closed form, the places beyond which they are 0. Far away a condition may be no
        number, as exp(a·x) > exp(b·x) is where both sides are infinite."""
        is_bell = is_unbounded(group[0]) and isinstance(self.rules.shared(group, home.depth), Mean)
        return without_tails(group) if is_bell else (group[0].lo, group[0].hi)

    def _decisive(self, group: Sequence[Integral], home: Level) -> set[Expr]:
        """Returns the functions without whose roots an integral would be wrong.

        They are those of its own conditions and cuts; all of them if a rule of fixed order, or conditions decided in the middle of
        pieces, rely on them. The others only help the adaptive rule.
        """
        functions, bodies = set(self.analysis.of(group[0]).functions), [i.body for i in group]
        exact = any(self.rules.is_exact(i, home.depth) for i in group)
        if exact or any(b.kinds & PointMasses.bit for b in bodies):
            return functions
        inner = self.out.binders(bodies)
        own = {a.g for i in group for a in atoms_of(i.body, i.var) if not a.g.free & inner}
        own |= {n.children[0] for n in calls_of(called("atan2"), *bodies) if has_cut(n) and not n.free & inner}
        keys = {self.analysis.functions.key(g) for g in own}
        return {f for f in functions if self.analysis.functions.key(f) in keys}

    def _mattering(self, roots: Sequence[Arg], matters: Cond, x: Var, home: Level) -> tuple[Arg, ...]:
        """Returns roots where they matter, NaN elsewhere."""
        if matters is TRUE:
            return tuple(roots)
        kept = []
        for root in roots:
            at_root = Level(x, home, home.depth + 1, names={x: root}, block=home.block)
            kept.append(self.out.assign(home, "select", self.out.truths(matters, at_root)[0], root, NAN))
        return tuple(kept)

    def _peaks(self, group: Sequence[Integral], home: Level) -> tuple[Arg, ...]:
        """Returns the middle and the ends of each narrow Gaussian in an integrand. Nodes of the whole range would miss it."""
        node = group[0]
        if all(self.rules.is_exact(i, home.depth) for i in group):
            return ()
        places: list[Arg] = []
        for rate, curvature in self.features.exponentials(group)[1]:
            width = div(const(BELL), call("root", curvature))
            middle = div(mul(MINUS_ONE, rate), curvature)
            narrow: Cond = positive(mul(MINUS_ONE, curvature))
            if not is_unbounded(node):
                narrow = conjunction(narrow, positive(sub(call("magnitude", sub(node.hi, node.lo)), mul(const(4.0), width))))
            for place in (sub(middle, width), middle, add(middle, width)):
                places.append(self.out.number(where(narrow, place, const(math.nan)), home))
        return tuple(places)

    def _tails(self, group: Sequence[Integral], edges: Sequence[Arg], home: Level) -> tuple[Arg, ...]:
        """Returns where the narrow tails of Gaussians end whose middle lies beyond an end of the range, or beyond a break: near there they
        fall off like exponentials."""
        node = group[0]
        found: list[Arg] = []
        for rate, curvature in self.features.tails(group):
            for edge in dict.fromkeys(e for e in edges if e not in (math.inf, -math.inf)):
                at_edge = Level(node.var, home, home.depth + 1, names={node.var: edge}, block=home.block)
                slope_there = add(rate, mul(curvature, node.var))
                steepness = call("magnitude", slope_there)
                narrow: Cond = positive(sub(steepness, mul(const(BELL), call("root", curvature))))
                if not is_unbounded(node):
                    length = call("magnitude", sub(node.hi, node.lo))
                    narrow = conjunction(narrow, positive(sub(mul(length, steepness), const(4.0 * DECAY))))
                falls = conjunction(narrow, positive(mul(MINUS_ONE, curvature)))
                end = where(falls, sub(node.var, div(const(DECAY), slope_there)), const(math.nan))
                found.append(self.out.number(end, at_edge))
        return tuple(found)

    def _centres(self, group: Sequence[Integral], home: Level) -> tuple[Arg, ...]:
        """Returns the centres of integrands on an infinite range, without those that are near a bound or another centre, so that nodes see
        them anyway. A range that is infinite on both sides has at least one break, 0 if no centre is a number.

        On a finite range the centres of integrals inside count where they are narrow.
        """
        node, out = group[0], self.out
        if all(self.rules.is_exact(i, home.depth) for i in group):
            return (0.0,) if all(infinite_ends(node)) else ()
        if not is_unbounded(node):
            return self._narrow_centres(group, home)
        known: list[Arg] = [out.number(b, home) for b, end in zip((node.lo, node.hi), infinite_ends(node), strict=True) if not end]
        places: list[Arg] = []
        for centre in dict.fromkeys(c for i in group for c in self.centres.of(i)):
            place, width = self._finite(centre.place, home), out.number(centre.width, home)
            if not known:
                place = out.assign(home, "select", out.assign(home, "ok", place), place, 0.0)
            near = out.assign(home, "mul", NEAR, width)
            for other in known:
                far = out.assign(home, "gt0", out.assign(home, "sub", out.assign(home, "abs", out.assign(home, "sub", place, other)), near))
                place = out.assign(home, "select", far, place, NAN)
            known.append(place)
            places.append(place)
        if any(self.centres.met(i) for i in group):
            places += self._between(known, home)
        return tuple(places) if known else (0.0,)

    def _narrow_centres(self, group: Sequence[Integral], home: Level) -> tuple[Arg, ...]:
        """Returns the places where centres of inner integrals meet, those that are narrow, and the ends of integrals
        of Gaussians and exponentials."""
        places: list[Arg] = []
        ends: list[Arg] = []
        for centre in dict.fromkeys(c for i in group for c in self.centres.met(i)):
            width, narrow = mul(const(centre.reach), centre.width), self._is_narrow(centre, group[0])
            around = [centre.place, *([sub(centre.place, width), add(centre.place, width)] if centre.reach else [])]
            middle, *others = (self._finite(where(narrow, place, const(math.nan)), home) for place in around)
            (ends if centre.reach else places).append(middle)
            ends += others
        return (*places, *ends, *self._between(places, home))

    def _curved_centres(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[Arg, ...]:
        """Returns the middles and ends of layers on a finite range where narrow Gaussians of inner integrals meet curved surfaces."""
        node = group[0]
        if is_unbounded(node) or all(self.rules.is_exact(i, home.depth) for i in group):
            return ()
        places: list[Arg] = []
        inner = self.out.binders([i.body for i in group])
        for search in dict.fromkeys(s for i in group for s in self.centres.searched(i)):
            if (search.apart.free | search.width.free | search.narrow.free) & inner:
                continue
            rate = _slope_of(search.apart, node.var)
            if rate is None:
                continue
            centre = Centre(node.var, div(search.width, call("magnitude", rate)), "bell")
            width, narrow = mul(const(BELL), centre.width), conjunction(search.narrow, self._is_narrow(centre, node))
            for root in self._roots_of(search, node, home, when):
                at_root = Level(node.var, home, home.depth + 1, names={node.var: root}, block=home.block)
                for place in (node.var, sub(node.var, width), add(node.var, width)):
                    places.append(self._finite(where(narrow, place, const(math.nan)), at_root))
        return tuple(places)

    def _roots_of(self, search: Search, node: Integral, home: Level, when: str | None) -> Sequence[Arg]:
        """Returns the roots of a search, by formula or found at run time."""
        known = solve(search.apart, node.var, node.lo, node.hi)
        if known is not None:
            return [self.roots.point(root, home) for root in known.found]
        isolation = isolate(search.apart, node.var)
        if isolation is None:
            return ()
        narrow = self.out.truths(TRUE if node.var in search.narrow.free else search.narrow, home)[0]
        if isinstance(narrow, str):
            when = narrow if when is None else self.out.assign(home, "and", when, narrow)
        return () if narrow is False else self.roots.breaks_in(node, (node.lo, node.hi), isolation, home, when, soft=True)

    def _finite(self, place: Expr, home: Level) -> Arg:
        """Returns a place, NaN where it is infinite: surfaces that are level in a variable have a centre nowhere."""
        at = self.out.number(place, home)
        if not isinstance(at, str):
            return at if math.isfinite(at) else NAN
        return self.out.assign(home, "select", self.out.assign(home, "ok", self.out.assign(home, "sub", at, at)), at, NAN)

    @staticmethod
    def _is_narrow(centre: Centre, node: Integral) -> Cond:
        """Returns the condition that a centre is too narrow for the nodes of a finite range."""
        return positive(sub(mul(const(centre.part), call("magnitude", sub(node.hi, node.lo))), centre.width))

    def _between(self, places: Sequence[Arg], home: Level) -> list[Arg]:
        """Returns the middle of each pair of places: a piece has one bend, so it ends at one centre only."""
        pairs = combinations(places, 2)
        return [self.out.assign(home, "mul", 0.5, self.out.assign(home, "add", one, other)) for one, other in pairs]

    def lost(self, group: Sequence[Integral], bends: Sequence[Bend], home: Level) -> Arg:
        """Returns whether numbers cannot tell where an integrand has its features: a narrow Gaussian, or a pole beside an infinite range,
        whose width is less than RESOLVED of its place, or a function with bends whose coefficients are no numbers."""
        node, out = group[0], self.out
        found: list[Cond] = []
        for rate, curvature in self.features.exponentials(group)[1]:
            middle, width = div(mul(MINUS_ONE, rate), curvature), div(ONE, call("root", mul(const(-1.0), curvature)))
            bounds = zip((1.0, -1.0), (node.lo, node.hi), infinite_ends(node), strict=True)
            inside = [positive(mul(const(sign), sub(middle, bound))) for sign, bound, end in bounds if not end]
            found.append(conjunction(positive(mul(MINUS_ONE, curvature)), _is_unresolved(middle, width), *inside))
        if is_unbounded(node):
            poles = dict.fromkeys(c for i in group for c in self.centres.of(i) if c.kind == "pole")
            found += [conjunction(positive(c.width), _is_unresolved(c.place, c.width)) for c in poles]
        flag = out.truths(disjunction(*found), home)[0]
        for number in [c for b in bends if b.when is True for c in b.coefficients if isinstance(c, str)]:
            large = out.assign(home, "gt0", out.assign(home, "sub", out.assign(home, "abs", number), INFINITE))
            flag = large if flag is False else out.assign(home, "or", flag, large)
        return flag

    def scale(self, group: Sequence[Integral], home: Level) -> Arg:
        """Returns the length of tails, on which an exponential in the integrands falls off; else the least width of a centre; 1 if there is
        none."""
        linear, quadratic = self.features.exponentials(group)
        scales = [div(ONE, call("magnitude", rate)) for rate in linear] + [div(ONE, call("root", c)) for _, c in quadratic]
        # the width of a double root is 0, or what rounding made of it
        scales = scales or [where(_is_unresolved(c.place, c.width), ZERO, c.width) for i in group for c in self.centres.of(i)]
        smallest = [self.out.number(s, home) for s in dict.fromkeys(scales)]
        least: Arg = 1.0
        for i, s in enumerate(smallest):
            positive_ones = [self.out.assign(home, "gt0", v) for v in (s, self.out.assign(home, "div", 1.0, s))]
            usable = self.out.assign(home, "and", self.out.assign(home, "ok", s), *positive_ones)  # a double root has the width 0
            s = self.out.assign(home, "select", usable, s, 1.0)
            least = s if i == 0 else self.out.assign(home, "min", least, s)
        return least

    def reach(self, group: Sequence[Integral], home: Level) -> Arg:
        """Returns the reach of tails, so that no part of the integrands overflows there; 0 if none of these is slow."""
        degrees = [d for i in group if (d := steepest_of_slow(i)) is not None]
        if not degrees:
            return 0.0
        return self.out.number(div(const(REACH), reduce(lambda a, b: call("max", a, b), degrees)), home)

    def bends(self, group: Sequence[Integral], level: Level, home: Level, rule: Rule) -> tuple[Arg, tuple[Bend, ...]]:
        """Returns where the integrands bend. Coefficients are numbers from outside; the middle of a piece decides whether a bend counts.

        The operands of an intrinsic's rule are included whether they are known to count or not.
        """
        x, lo = group[0].var, group[0].lo
        turns: dict[object, Turn] = {}
        operand = self.rules.bend_of(rule)
        for node in group:
            for turn in self.analysis.of(node).bends:
                if operand not in (None, turn.kind):
                    continue
                turns.setdefault((turn.kind, self.analysis.functions.key(turn.function)), turn)
        base = local_origin(lo, group[0].hi)
        bends = []
        for turn in list(turns.values())[:MAX_BENDS]:
            first = slope(turn.function, x)
            coefficients = turn.function, first, mul(const(0.5), slope(first, x))
            numbers = tuple(self.out.number(cast(Expr, substitute(c, {x: base})), home) for c in coefficients)
            holds = self.out.truths(turn.when, cast(Level, level.middle))[0]
            if holds is not False or operand is not None:
                bends.append(Bend(turn.kind, cast("tuple[Arg, Arg, Arg]", numbers), holds))
        met = [c for i in group for c in self.centres.met(i) if not c.reach or is_unbounded(i)] if isinstance(rule, Adaptive) else []
        for centre in list(dict.fromkeys(met))[: MAX_BENDS - len(bends)]:  # as narrow as if there were poles beside it
            counts = is_unbounded(group[0]) or self.out.truths(self._is_narrow(centre, group[0]), home)[0]
            for side in (sub(centre.place, centre.width), add(centre.place, centre.width)):
                bends.append(Bend("pole", (self._finite(sub(base, side), home), 1.0, 0.0), counts))
        return self.out.number(base, home) if bends else 0.0, tuple(bends)

    def watched(self, bodies: Sequence[Expr], level: Level) -> tuple[str, ...]:
        """Returns signs of conditions that may change inside a piece because their roots have no formula: the rule bisects towards such
        places. A sign that rounding alone could have made is 0, which says nothing."""
        x, handled = cast(Var, level.var), cast(Breaks, level.breaks).handled
        inner = self.out.binders(bodies)
        signs: dict[Cond, None] = {}
        atoms = {c for b in bodies for c in atoms_of(b, x)}  # without atoms that only decide a tie
        for node in postorder(bodies):
            if x not in node.free or node.free & inner:
                continue
            if isinstance(node, Compare) and node.g not in handled and node in atoms:
                signs[node] = None
                turning = _slope_of(node.g, x)
                if turning is not None:
                    signs[positive(turning)] = None  # two jumps between neighbouring nodes have a turning point between them
            elif isinstance(node, Call) and node.name in ("floor", "mod"):
                u = node.children[0] if node.name == "floor" else div(*node.children)
                signs[positive(sub(const(0.5), sub(u, call("floor", u))))] = None  # false before a step, true after it
        return tuple(dict.fromkeys(s for s in (self._sign(c, level) for c in signs) if isinstance(s, str)))

    def _sign(self, c: Cond, level: Level) -> Arg:
        """Returns 1 where a condition holds and -1 where it does not, or 0 where g of g > 0 is less than its rounding error."""
        out, holds = self.out, self.out.truths(c, level)[0]
        if not isinstance(holds, str):
            return 0.0
        sign = out.assign(level, "select", holds, 1.0, -1.0)
        if not isinstance(c, Compare):
            return sign
        noise = out.assign(level, "mul", TIE_EPS, out.rounding.tie_scale(c.g, level))
        larger = out.assign(level, "gt0", out.assign(level, "sub", noise, out.size(c.g, level)))
        finite = out.assign(level, "le0", out.assign(level, "sub", noise, noise))
        lost = out.assign(level, "and", larger, finite)
        return out.assign(level, "select", lost, 0.0, sign)


def _is_unresolved(place: Expr, width: Expr) -> Cond:
    return positive(sub(mul(const(RESOLVED), call("magnitude", place)), width))


def _slope_of(g: Expr, x: Var) -> Expr | None:
    try:
        rate = slope(g, x)
    except NotDifferentiableError:
        return None
    return rate if x in rate.free else None
