"""From a closed expression without δ to the flat program of `teg.program`.

The parts: `emit` gives every value a name at the outermost level where its inputs exist; `rules` chooses a rule for each integral,
`pieces` its breaks, `guarded` its guard against peaks between nodes; `roots` sums over roots; `samples` integrates without breaks;
intrinsics compute integrals of their shapes. This module joins them: each integral becomes one statement of one of these.

Integrals of one level with the same variable, bounds, breaks, rule and guard share one statement, with several results. Inside, values
that are constant on a piece (conditions whose roots are breaks, and values that depend on x through them only) go to its `flags`, the
others to its `body`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import cast

from teg.analysis.guards import GUARD_TERMS, guards, support
from teg.analysis.remarks import Remarks
from teg.analysis.settings import Integration
from teg.analysis.sharp import Sharp, numeric_range, sharp_values
from teg.analysis.tails import is_unbounded
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, And, Call, Cond, Expr, Mul, Or, Var
from teg.ir.integral import ClosedForm, Integral, masses_of
from teg.ir.node import Node, postorder
from teg.ir.simplify import conjunction, disjunction, mul, positive, where
from teg.passes.lower.apart import with_terms_apart
from teg.passes.lower.emit import Emitter
from teg.passes.lower.guarded import Guards, widest_gap
from teg.passes.lower.intervals import Between, Interval, integrals_over_interval, interval_of
from teg.passes.lower.intrinsic import Intrinsic, Lowering
from teg.passes.lower.levels import Level
from teg.passes.lower.means import Mean, Means, P, Q, mean_of
from teg.passes.lower.pieces import Pieces
from teg.passes.lower.refute import certainly_empty
from teg.passes.lower.roots import Roots
from teg.passes.lower.rules import Rules
from teg.passes.lower.samples import Samples, deciding_integrals
from teg.passes.lower.weights import largest, relative, weights
from teg.program import Adaptive, Arg, Assign, Bend, Called, Gauss, Guard, Integrate, Program, Rule, Tie
from teg.program.dce import without_dead_code

FEW_NODES = 2
"""Nodes of polynomials inside of other integrals that have no pieces if they live on one interval."""
SHAPE, DEEP = "the shape of an intrinsic", "too many adaptive integrals inside each other"
PLACES = (2.0**-12, 0.2361, 0.7639, 1 - 2.0**-12)
"""The places on a piece, as fractions of its length, where a tie of its middle is evaluated again.

Surfaces approach each other towards one end, or both.
"""


@dataclass(frozen=True)
class About:
    """What is known of outputs: whether closed forms of them may lie on `intervals`, without pieces, whose ends an estimate of errors
    needs; the `differentiated` expressions whose derivatives they are, of which they may take the breaks; whether all their digits count,
    however small they are (`relative`)."""

    intervals: bool = False
    differentiated: Sequence[Expr] = ()
    relative: bool = False


ABOUT_NOTHING = About()


def schedule(
    outputs: Sequence[Expr],
    parameters: Sequence[str],
    how: Integration,
    intrinsics: Sequence[Intrinsic],
    remarks: Remarks | None = None,
    about: About = ABOUT_NOTHING,
) -> Program:
    """Returns one program for several outputs. `intrinsics` may compute integrals of their shapes; decisions are added to `remarks`."""
    made = _Integrals(parameters, how, intrinsics, Remarks() if remarks is None else remarks, about)
    return made.run(outputs)


class _Integrals:
    """The integrals of one program."""

    def __init__(
        self,
        parameters: Sequence[str],
        how: Integration,
        intrinsics: Sequence[Intrinsic],
        remarks: Remarks,
        about: About,
    ) -> None:
        self.parameters, self.how, self.remarks = tuple(parameters), how, remarks
        self.out = Emitter(parameters, self.integrate, self.closed_form)
        self.rules = Rules(how, [i.rule for i in intrinsics if i.rule is not None], about.differentiated)
        self.roots = Roots(self.out, self.plan, how.max_roots, how.tol)
        self.samples = Samples(self.out, self.plan, how, self.rules.is_too_deep)
        self.guards = Guards(self.out, self.rules.analysis)
        self.pieces = Pieces(self.out, self.rules, self.roots)
        self.lowerings: list[Lowering] = [i.lowering(self.out) for i in intrinsics if i.lowering is not None]
        self._claimed: dict[Node, Lowering] = {}
        self.has_intervals, self.is_relative = about.intervals, about.relative

    def run(self, outputs: Sequence[Expr]) -> Program:
        """Returns the program of the outputs."""
        top = Level(None, None, 0, is_relative=self.is_relative)
        if self.has_intervals and self.how.closed_forms and self.how.rule == "auto":
            outputs = with_terms_apart(outputs, self.rules.analysis)
        self.samples.deciding = deciding_integrals(outputs)
        self.plan(top, outputs)
        names = tuple(self.out.number(e, top) for e in outputs)
        functions = tuple(Called(*f) for f in self.out.functions)
        return without_dead_code(Program(self.parameters, tuple(top.block), names, tuple(Tie(*t) for t in self.out.ties), functions))

    def plan(self, level: Level, roots: Sequence[Expr]) -> None:
        """Finds the integrals of this level, their guards, and the groups that share a loop."""
        order = postorder(roots)
        claimed = self._claimed_at(level, order)
        inner = self.out.binders(roots)
        height: dict[Node, int] = {}
        mine: list[Integral] = []
        for node in order:
            height[node] = max([height[c] for c in node.children], default=0)
            here = not node.free if level.var is None else level.var in node.free and not node.free & inner
            if isinstance(node, Integral) and here:
                height[node] += 1
                if node not in claimed:
                    mine.append(node)
        if not mine:
            return
        level.guards = guards(roots, order, inner, height, set(mine))
        level.weights = weights(roots, order)
        level.relative = relative(order, roots if level.is_relative else ())
        shared: dict[object, list[Integral]] = {}
        for node in mine:
            masses = masses_of(node.body, node.var)
            key: tuple[object, ...] = (node.var, node.lo, node.hi, masses)
            if level.coordinates is not None and node in level.coordinates:
                continue
            if masses is None and self.samples.is_sampled(node, level):
                key = ()
            elif (shape := self._shape(node, level)) is not None:
                key = (shape.key(node, level),)
            elif not self.samples.is_unbroken(node, level):
                kind = None if masses is not None else self.rules.kind(node, level.depth)
                key = (*key, kind, frozenset(self.rules.analysis.of(node).functions))
            shared.setdefault((*key, height[node], level.guards[node]), []).append(node)
        for group in shared.values():
            for node in group:
                level.groups[node] = group

    def _claimed_at(self, level: Level, order: Sequence[Node]) -> dict[Node, Lowering]:
        """Returns the integrals that are computed alone, with the lowering that computes each."""
        for lowering in self.lowerings:
            self._claimed.update(dict.fromkeys(lowering.claim(level, order), lowering))
        return self._claimed

    def _shape(self, node: Integral, level: Level) -> Lowering | None:
        """Returns the intrinsic that computes an integral of this level."""
        return next((lowering for lowering in self.lowerings if lowering.key(node, level) is not None), None)

    def integrate(self, node: Integral, home: Level) -> None:
        """Gives an integral, and those that share its statement, a name."""
        if home.coordinates is not None and node in home.coordinates:
            self.samples.sample_inside(node, home)
            return
        if node in self._claimed:
            self._claimed[node].emit_claimed(node, home)
            self._note([node], self._claimed[node].name, SHAPE)
            return
        group = home.groups.get(node, [node])
        guard = home.guards.get(node, TRUE)
        needed = True if guard is TRUE else self.out.truths(guard, home)[0]
        shape = self._shape(node, home)
        interval = None if shape is not None else self._interval(group, home)
        if home.var is None and shape is None and interval is None:
            needed = self._unless_empty(group, needed, home)
        if needed is False:
            home.names.update(dict.fromkeys(group, 0.0))
            return
        when = needed if isinstance(needed, str) else None
        masses = masses_of(node.body, node.var)
        results: Sequence[Arg]
        if shape is not None:
            results = shape.emit(group, home, when)
            self._note(group, shape.name, SHAPE)
        elif masses is not None:
            results = self.roots.sum_over_roots(group, masses, home, when)
            self._note(group, "sum over roots", "what is left of a δ")
        elif self.samples.is_unbroken(node, home):
            sampled = self.samples.is_sampled(node, home)
            results = (self.samples.sample if sampled else self.samples.midpoint)(group, home, when)
            self._note(group, "samples" if sampled else "midpoint", DEEP if self.how.rule == "auto" else "asked for")
        else:
            interval_results = None if interval is None else integrals_over_interval(self.out, group, interval, home, when)
            if isinstance(self.rules.shared(group, home.depth), Mean):
                self.guards.note_peaks(group, home)
            results = interval_results or self._by_pieces(group, home, when)
            for i in group:
                self._note([i], self.rules.title(self.rules.of(i, home.depth)), self.rules.reason(i, home.depth))
        home.names.update(zip(group, results, strict=True))

    def _interval(self, group: Sequence[Integral], home: Level) -> Interval | None:
        """Returns the interval of integrals of closed form, or inside of others of short polynomials, that live on one interval."""
        if not self.has_intervals or masses_of(group[0].body, group[0].var) is not None or self.samples.is_unbroken(group[0], home):
            return None
        breaks = self.rules.analysis.of(group[0])
        match self.rules.shared(group, home.depth):
            case Mean():
                return interval_of(group, breaks)
            case Gauss(nodes) if self.how.closed_forms and nodes <= FEW_NODES and not is_unbounded(group[0]):
                return interval_of(group, breaks, nodes)
        return None

    def _note(self, group: Sequence[Integral], choice: str, reason: str) -> None:
        """Records the choice for a group of integrals."""
        for node in group:
            self.remarks.add("lower", node, choice, reason)

    def _by_pieces(self, group: Sequence[Integral], home: Level, when: str | None) -> Sequence[Arg]:
        """Returns the results of integrals that share a loop over pieces: one `Integrate`."""
        node, infinite = group[0], is_unbounded(group[0])
        rule, is_relative = self.rules.shared(group, home.depth), not home.relative.isdisjoint(group)
        lo, hi, breaks = self.pieces.of(group, home, when)
        if isinstance(rule, Mean):
            return self._by_means(group, home, when, (lo, hi, breaks))
        if isinstance(rule, Adaptive) and is_relative:
            rule = replace(rule, floor=0.0)
        var = self.out.fresh("x")
        around, self.out.ranges = self.out.ranges, numeric_range(node, self.out.ranges)
        level = home.inside(node.var, var)
        level.breaks, level.middle, level.is_relative = self.rules.analysis.of(node), home.inside(node.var, var), is_relative
        weight = largest([home.weights.get(i, ONE) for i in group]) if isinstance(rule, Adaptive) else ONE
        ends = () if infinite else (self.out.fresh("x"), self.out.fresh("x"))
        if ends:
            level.middle.elsewhere = cache(partial(self._elsewhere, level.middle, ends))
        bodies = [mul(weight, i.body) for i in group]
        self.plan(level, bodies)
        need = self._need(bodies, level)
        values = tuple(self.out.number(b, level) for b in bodies)
        watch = self.pieces.watched(bodies, level) if isinstance(rule, Adaptive) and rule.tol < math.inf else ()
        base, bends = self.pieces.bends(group, level, home, rule) if not isinstance(rule, Gauss) else (0.0, ())
        if isinstance(rule, Adaptive) and rule.tol < math.inf and (lost := self.pieces.lost(group, bends, home)) is not False:
            lo = self.out.assign(home, "select", lost, math.nan, lo)
        guard = self._guard(group, weight, level, home, rule, bends)
        self.guards.note_peaks(group, home)
        results = tuple(self.out.fresh("v") for _ in group)
        flags, body = tuple(level.middle.block), tuple(level.block)
        scale, reach = (self.pieces.scale(group, home), self.pieces.reach(group, home)) if infinite else (1.0, 0.0)
        used = {a for s in flags if isinstance(s, Assign) for a in s.args}
        integral = Integrate(var, lo, hi, breaks, flags, need, body, values, results, rule, when, watch, bends, base, infinite, scale)
        home.block.append(replace(integral, guard=guard, ends=ends if used.intersection(ends) else (), reach=reach))
        self.out.ranges = around
        if weight is ONE:
            return results
        by = self.out.number(weight, home)
        return tuple(self.out.assign(home, "div", r, by) for r in results)

    def _by_means(
        self, group: Sequence[Integral], home: Level, when: str | None, places: tuple[Arg, Arg, tuple[Arg, ...]]
    ) -> Sequence[Arg]:
        """Returns the results of integrals of closed form: an `Integrate` with one node, whose values are means over the piece."""
        node, var, ends = group[0], self.out.fresh("x"), (self.out.fresh("x"), self.out.fresh("x"))
        between = home.inside(P, ends[0]).inside(Q, ends[1])
        level = between.inside(node.var, var)
        level.breaks, level.middle = self.rules.analysis.of(node), between.inside(node.var, var)
        flags = cast(Level, between.outer).block
        for inner in (between, level, level.middle):
            inner.block = flags
        level.middle.elsewhere = cache(partial(self._elsewhere, level.middle, ends))
        means = [cast(Means, mean_of(i.body, i.var)).mean for i in group]
        self.plan(level, means)
        need = self._need([i.body for i in group], level)
        values = tuple(self.out.number(m, level) for m in means)
        results = tuple(self.out.fresh("v") for _ in group)
        home.block.append(Integrate(var, *places, tuple(flags), need, (), values, results, Gauss(1), when, ends=ends))
        return results

    def closed_form(self, e: ClosedForm, home: Level) -> Arg:
        """Returns the name of a number that an intrinsic computes."""
        for lowering in self.lowerings:
            if (name := lowering.closed_form(e, home)) is not None:
                return name
        raise AssertionError(f"{e.name} was made by an intrinsic that is off")

    def _guard(self, group: Sequence[Integral], weight: Expr, level: Level, home: Level, rule: Rule, bends: Sequence[Bend]) -> Guard | None:
        """Returns the guard against features of the integrands between all nodes; None if there can be none."""
        if not isinstance(rule, Adaptive) or rule.tol == math.inf:
            return None
        x, bodies = group[0].var, [i.body for i in group]
        poles = sum(b.kind == "pole" for b in bends)
        gap = None if bends or is_unbounded(group[0]) else widest_gap(rule)
        known = self._without_peaks(group, sharp_values(bodies, x, self.out.binders(bodies), self.guards.degrees, poles))
        return self.guards.guard(group, weight, self.guards.not_tame(known, x, gap), level, home, gap)

    def _without_peaks(self, group: Sequence[Integral], known: Sequence[Sharp]) -> list[Sharp]:
        """Returns the sharp values without narrow Gaussians (exponentials of quadratics that open downwards), which are breaks."""
        x, inner = group[0].var, self.out.binders([i.body for i in group])
        quadratic = self.pieces.features.exponentials(group)[1]
        rest = []
        for s in known:
            value = s.value
            if isinstance(value, Call) and value.name == "exp" and self.guards.degrees.of(value.children[0], x) == 2:
                pair = self.pieces.features.quadratic(value, x, inner)
                if pair is not None and pair in quadratic:
                    value = where(positive(mul(MINUS_ONE, pair[1])), ONE, value)
            if x in value.free or s.wave:
                rest.append(replace(s, value=value))
        return rest

    def _elsewhere(self, middle: Level, ends: tuple[str, str]) -> Sequence[Level]:
        """Returns other places of a piece than its middle, whose statements are the middle's."""
        x, (p, q) = cast(Var, middle.var), ends
        length = self.out.assign(middle, "sub", q, p)
        levels = []
        for part in PLACES:
            place = self.out.assign(middle, "add", p, self.out.assign(middle, "mul", part, length))
            level = cast(Level, middle.outer).inside(x, place)
            level.block = middle.block
            levels.append(level)
        return levels

    def _unless_empty(self, group: Sequence[Integral], needed: Arg, home: Level) -> Arg:
        """Returns whether an outermost integral is needed: not if intervals show that its integrand is 0 on the whole domain."""
        empty: list[Cond] = []
        for node in group:
            found = certainly_empty(node)
            if found is FALSE:
                return needed
            empty.append(found)
        nothing = self.out.truths(conjunction(*empty), home)[0]
        if isinstance(nothing, bool):
            return False if nothing else needed
        occupied = self.out.assign(home, "not", nothing)
        return occupied if needed is True else self.out.assign(home, "and", needed, occupied)

    def _roots_inside(self, body: Expr, level: Level) -> list[Cond]:
        """Returns the conditions that the roots exist between which integrals inside of an integrand are not 0, if these are factors of
        it."""
        factors = body.children if isinstance(body, Mul) else (body,)
        intervals = [self._interval([f], level) for f in factors if isinstance(f, Integral)]
        sides = [side for interval in intervals if interval is not None for side in interval.sides if isinstance(side, Between)]
        return [root.exists for side in sides for root in side.roots]

    def _need(self, bodies: Sequence[Expr], level: Level) -> str | None:
        """Returns a condition, constant on a piece, without which all integrands are 0 there."""
        conditions: list[Cond] = []
        for body in bodies:
            c = conjunction(support(body), *self._roots_inside(body, level))
            parts = c.children if isinstance(c, And) else (c,)
            kept = [p for p in parts if level.is_constant(p)]
            if c is TRUE or not kept:
                return None
            conditions.append(conjunction(*kept))
        total = disjunction(*conditions)
        if total is TRUE or (isinstance(total, Or) and len(total.children) > 2 * GUARD_TERMS):
            return None
        holds, fails = self.out.truths(total, level)
        if not isinstance(fails, str):
            return None
        home = self.out.home_of(total, level)
        if home is level.middle:
            home.names[total] = (holds, False)  # on the pieces that are not skipped it holds, or is NaN
        name = self.out.fresh("b")
        cast(Level, level.middle).block.append(Assign(name, "not", (fails,)))
        return name
