"""From a closed expression without δ to the flat program of `teg.program`.

`emit.py` gives every value a name at the outermost level where its inputs exist; here is what an integral becomes: one `Integrate`, or a
sum over roots (`at_roots.py`). Integrals of one level with the same variable, bounds, breaks, rule and guard share one, with several
results. Inside, what is constant on a piece (conditions whose roots are breaks, and what depends on x through them only) goes to its
`flags`, the rest to its `body`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import assert_never, cast

from teg.analysis.breaks import MAX_BENDS, BreakAnalysis, Breaks, Turn
from teg.analysis.calculus import slope
from teg.analysis.guards import GUARD_TERMS, guards, support
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import local_origin
from teg.analysis.settings import Integration
from teg.analysis.sharp import Sharp, numeric_range, sharp_values
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import infinite_ends, is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import (
    FALSE,
    MINUS_ONE,
    ONE,
    TRUE,
    ZERO,
    And,
    Call,
    Compare,
    Cond,
    Expr,
    Or,
    Var,
    add,
    call,
    conjunction,
    const,
    disjunction,
    div,
    mul,
    positive,
    sub,
    where,
)
from teg.ir.integral import Integral, PointMasses, masses_of
from teg.ir.node import Node, postorder
from teg.ir.traverse import substitute
from teg.passes.lower.emit import NAN, Level
from teg.passes.lower.guarded import GuardedEmitter, widest_gap
from teg.passes.lower.refute import certainly_empty
from teg.passes.lower.samples import deciding_integrals
from teg.passes.lower.weights import largest, weights
from teg.program import Adaptive, Arg, Assign, Bend, Called, Gauss, Guard, Integrate, Midpoint, Program, Rational, Rule, Tie
from teg.program.dce import without_dead_code

MAX_GAUSS = 24
TIGHTEST = 1e-14
ORDERS = ((1e-6, 6, 12), (1e-13, 8, 16), (0.0, 10, 18))
"""By tolerance: the nodes of the first look at a piece (OUTER more where an integral stands inside) and of the intervals after it."""
MAX_NUMERATOR, MAX_POWER = 4, 3
"""Of rational integrands: degree of the numerator, power in the denominator."""
OUTER = 2
MAX_SCALES = 4
PLACES = (2.0**-12, 0.2361, 0.7639, 1 - 2.0**-12)
"""Where on a piece a tie of its middle is looked at again, in parts of its length: surfaces approach each other towards an end, or both."""
MAX_NEST = 6
"""Adaptive integrals inside each other; deeper nests are sampled."""
PEAK = 8.5
"""Beyond so many standard deviations nothing of a Gaussian is left: exp(-8.5²/2) = 2e-16."""
FIXED = 16
"""Nodes of the rule \"gauss\", unless told."""
INNER_TIGHTER = 0.1
"""An integral inside another one is computed to a tenth of its tolerance, so that the outer one sees a smooth function."""


def schedule(outputs: Sequence[Expr], parameters: Sequence[str], how: Integration) -> Program:
    """One program for several outputs."""
    return _Scheduler(parameters, how).run(outputs)


def rule_for(node: Integral, analysis: BreakAnalysis, how: Integration, depth: int) -> Rule:
    """Gauss with as many nodes as a polynomial between known breaks needs, or one over a power of a linear function; adaptive for anything
    else, tighter inside, with the fewer nodes to begin with the less is asked for. A fixed order is an adaptive rule that accepts
    everything."""
    degree = None if how.rule == "adaptive" else analysis.degree(node)
    most = (how.order or FIXED) if how.rule == "gauss" else MAX_GAUSS
    if degree is not None and degree // 2 + 1 <= most and not is_unbounded(node):
        return Gauss(degree // 2 + 1)
    pole = analysis.pole(node) if how.rule == "auto" and how.order is None and not is_unbounded(node) else None
    if pole is not None and pole.degree <= MAX_NUMERATOR and pole.power <= MAX_POWER:
        return Rational(pole.degree + 1, pole.power)
    cubic = analysis.of(node).rooted
    if how.rule == "gauss":
        return Adaptive(math.inf, most, most, cubic)
    tol = max(how.tol * INNER_TIGHTER**depth, TIGHTEST)
    if how.order is not None:
        return Adaptive(tol, how.order, how.order + 8, cubic)
    _, first, order = next(row for row in ORDERS if tol >= row[0])
    inside = postorder([node.body]) if node.body.has_integral else []
    outer = any(isinstance(n, Integral) and masses_of(n.body, n.var) is None for n in inside)
    return Adaptive(tol, first + OUTER * outer, order, cubic)


def _common(rules: Sequence[Rule]) -> Rule:
    """A rule for all integrals of a loop; their rules are of one kind."""
    first = rules[0]
    match first:
        case Rational():
            rational = cast("Sequence[Rational]", rules)
            power = max(r.power for r in rational)
            return Rational(max(r.nodes + power - r.power for r in rational), power)  # P/D is P·D over D²
        case Adaptive():
            return replace(first, cubic=any(cast(Adaptive, r).cubic for r in rules))
        case Gauss() | Midpoint():
            return max(rules, key=lambda r: cast(Gauss, r).nodes)
        case _:
            assert_never(first)


def _slope_of(g: Expr, x: Var) -> Expr | None:
    try:
        rate = slope(g, x)
    except NotDifferentiableError:
        return None
    return rate if x in rate.free else None


class _Scheduler(GuardedEmitter):
    def __init__(self, parameters: Sequence[str], how: Integration) -> None:
        super().__init__(parameters, how)
        self.parameters = tuple(parameters)
        self.analysis = BreakAnalysis(how.max_roots)
        self._rules: dict[tuple[Integral, int], Rule] = {}

    def run(self, outputs: Sequence[Expr]) -> Program:
        top = Level(None, None, 0)
        self.deciding = deciding_integrals(outputs)
        self.plan_integrals(top, outputs)
        names = tuple(self.number(e, top) for e in outputs)
        functions = tuple(Called(*f) for f in self.functions)
        return without_dead_code(Program(self.parameters, tuple(top.block), names, tuple(Tie(t) for t in self.ties), functions))

    def plan_integrals(self, level: Level, roots: Sequence[Expr]) -> None:
        """Find the integrals that belong to this level, when each is needed, and which of them share a loop."""
        order = postorder(roots)
        closed = self.plan_moments(level, order)
        inner = self.binders(roots)
        height: dict[Node, int] = {}
        mine: list[Integral] = []
        for node in order:
            height[node] = max([height[c] for c in node.children], default=0)
            here = not node.free if level.var is None else level.var in node.free and not node.free & inner
            if isinstance(node, Integral) and here:
                height[node] += 1
                if node not in closed:
                    mine.append(node)
        if not mine:
            return
        level.guards = guards(roots, order, inner, height, set(mine))
        level.weights = weights(roots, order)
        shared: dict[object, list[Integral]] = {}
        for node in mine:
            masses = masses_of(node.body, node.var)
            key: tuple[object, ...] = (node.var, node.lo, node.hi, masses)
            if level.coordinates is not None and node in level.coordinates:
                continue
            if masses is None and self.is_sampled(node, level):
                key = ()
            elif (clipped := self.clipped(node, level)) is not None:
                key = (clipped.key,)
            elif not self.is_unbroken(node, level):
                key = (*key, self._kind(node, level, masses), frozenset(self.analysis.of(node).functions))
            shared.setdefault((*key, height[node], level.guards[node]), []).append(node)
        for group in shared.values():
            for node in group:
                level.groups[node] = group

    def is_too_deep(self, node: Integral) -> bool:
        """More than MAX_NEST adaptive integrals inside each other: their nodes multiply."""
        if not any(c.has_integral for c in node.children):
            return False
        nodes = postorder([node])
        if sum(isinstance(n, Integral) for n in nodes) <= MAX_NEST:
            return False
        depth: dict[Node, int] = {}
        for n in nodes:
            most = max((depth[c] for c in n.children), default=0)
            if (
                isinstance(n, Integral)
                and masses_of(n.body, n.var) is None
                and isinstance(rule_for(n, self.analysis, self.how, 0), Adaptive)
            ):
                most += 1
            depth[n] = most
        return depth[node] > MAX_NEST

    def _rule(self, node: Integral, level: Level) -> Rule:
        key = node, level.depth
        if key not in self._rules:
            self._rules[key] = rule_for(node, self.analysis, self.how, level.depth)
        return self._rules[key]

    def _kind(self, node: Integral, level: Level, masses: object) -> object:
        """Integrals of one kind can share a loop if the rest agrees."""
        if masses is not None:
            return None
        rule = self._rule(node, level)
        pole = self.analysis.pole(node) if isinstance(rule, Rational) else None
        return type(rule) if pole is None else (Rational, self.analysis.key(pole.turn.function), pole.turn.when)

    def _decisive(self, group: Sequence[Integral], home: Level) -> set[Expr]:
        """The functions of an integral without whose roots it would be wrong: those of its own conditions; all of them where a rule of
        fixed order, or conditions decided in the middle of pieces, rely on them. The others only help the adaptive rule."""
        functions, bodies = set(self.analysis.of(group[0]).functions), [i.body for i in group]
        exact = any(isinstance(self._rule(i, home), Gauss | Rational) for i in group)
        if exact or any(isinstance(n, PointMasses) for n in postorder(bodies)):
            return functions
        inner = self.binders(bodies)
        own = {a.g for i in group for a in atoms_of(i.body, i.var) if not a.g.free & inner}
        keys = {self.analysis.key(g) for g in own}
        return {f for f in functions if self.analysis.key(f) in keys}

    def integrate(self, node: Integral, home: Level) -> None:
        """Give an integral, and those that share its loop, a name: one `Integrate`, one `Sample`, or a sum over roots."""
        if home.coordinates is not None and node in home.coordinates:
            self.sample_inside(node, home)
            return
        if self.has_moments(node):
            super().integrate(node, home)
            return
        group = home.groups.get(node, [node])
        guard = home.guards.get(node, TRUE)
        needed = True if guard is TRUE else self.truths(guard, home)[0]
        clipped = [self.clipped(i, home) for i in group]
        if home.var is None and clipped[0] is None:
            needed = self._unless_empty(group, needed, home)
        if needed is False:
            home.names.update(dict.fromkeys(group, 0.0))
            return
        when = needed if isinstance(needed, str) else None
        if clipped[0] is not None:
            home.names.update(zip(group, self.clip([c for c in clipped if c is not None], home, when), strict=True))
            return
        masses = masses_of(node.body, node.var)
        if masses is not None:
            home.names.update(zip(group, self.sum_over_roots(group, masses, home, when), strict=True))
            return
        if self.is_unbroken(node, home):
            emit = self.sample if self.is_sampled(node, home) else self.midpoint
            home.names.update(zip(group, emit(group, home, when), strict=True))
            return
        lo, hi, breaks = self._pieces(group, home, when)
        rules = [self._rule(i, home) for i in group]
        rule = _common(rules)
        var = self.fresh("x")
        around, self.ranges = self.ranges, numeric_range(node, self.ranges)
        level = home.inside(node.var, var)
        level.breaks, level.middle = self.analysis.of(node), home.inside(node.var, var)
        weight = largest([home.weights.get(i, ONE) for i in group]) if isinstance(rule, Adaptive) else ONE
        ends = () if is_unbounded(node) else (self.fresh("x"), self.fresh("x"))
        if ends:
            level.middle.elsewhere = cache(partial(self._elsewhere, level.middle, ends))
        bodies = [mul(weight, i.body) for i in group]
        self.plan_integrals(level, bodies)
        need = self._need(bodies, level)
        values = tuple(self.number(b, level) for b in bodies)
        watch = self._watched(bodies, level) if isinstance(rule, Adaptive) and rule.tol < math.inf else ()
        base, bends = self._bends(group, level, home, rule) if isinstance(rule, Adaptive | Rational) else (0.0, ())
        search = self._guard(group, weight, level, home, rule, bends)
        self.note_peaks(group, level)
        results = tuple(self.fresh("v") for _ in group)
        flags, inside = tuple(level.middle.block), tuple(level.block)
        infinite = is_unbounded(node)
        scale = self._scale(group, home) if infinite else 1.0
        used = {a for s in level.middle.block if isinstance(s, Assign) for a in s.args} if ends else set()
        rest = (rule, when, watch, bends, base, infinite, scale)
        mine = ends if used & {*ends} else ()
        integral = Integrate(var, lo, hi, breaks, flags, need, inside, values, results, *rest)
        home.block.append(replace(integral, guard=search, ends=mine))
        if weight is not ONE:
            by = self.number(weight, home)
            results = tuple(self.assign(home, "v", "div", r, by) for r in results)
        home.names.update(zip(group, results, strict=True))
        self.ranges = around

    def _guard(self, group: Sequence[Integral], weight: Expr, level: Level, home: Level, rule: Rule, bends: Sequence[Bend]) -> Guard | None:
        """What finds features of the integrands between all nodes; None where there can be none."""
        if not isinstance(rule, Adaptive) or rule.tol == math.inf:
            return None
        x, bodies = group[0].var, [i.body for i in group]
        poles = sum(b.kind == "pole" for b in bends)
        gap = None if bends or is_unbounded(group[0]) else widest_gap(rule)
        known = self._without_peaks(group, sharp_values(bodies, x, self.binders(bodies), self.degrees, poles))
        return self.guard([mul(weight, b) for b in bodies], x, self.not_tame(known, x, gap), level, home, gap)

    def _without_peaks(self, group: Sequence[Integral], known: Sequence[Sharp]) -> list[Sharp]:
        """The sharp values without narrow Gaussians, which are breaks: an exponential of a quadratic that opens downwards."""
        x, inner = group[0].var, self.binders([i.body for i in group])
        quadratic = self._exponentials(group)[1]
        rest = []
        for s in known:
            value = s.value
            if isinstance(value, Call) and value.name == "exp" and self.degrees.of(value.children[0], x) == 2:
                pair = self._quadratic(value, x, inner)
                if pair is not None and pair in quadratic:
                    value = where(positive(mul(MINUS_ONE, pair[1])), ONE, value)
            if x in value.free or s.wave:
                rest.append(replace(s, value=value))
        return rest

    def _elsewhere(self, middle: Level, ends: tuple[str, str]) -> Sequence[Level]:
        """Other places of a piece than its middle, whose statements are the middle's."""
        x, (p, q) = cast(Var, middle.var), ends
        length = self.assign(middle, "v", "sub", q, p)
        levels = []
        for part in PLACES:
            place = self.assign(middle, "v", "add", p, self.assign(middle, "v", "mul", part, length))
            level = cast(Level, middle.outer).inside(x, place)
            level.block = middle.block
            levels.append(level)
        return levels

    def _unless_empty(self, group: Sequence[Integral], needed: Arg, home: Level) -> Arg:
        """Whether an outermost integral is needed, which it is not where intervals show that its integrand is 0 on the whole domain."""
        empty: list[Cond] = []
        for node in group:
            found = certainly_empty(node)
            if found is FALSE:
                return needed
            empty.append(found)
        nothing = self.truths(conjunction(*empty), home)[0]
        if isinstance(nothing, bool):
            return False if nothing else needed
        occupied = self.assign(home, "b", "not", nothing)
        return occupied if needed is True else self.assign(home, "b", "and", needed, occupied)

    def _pieces(self, group: Sequence[Integral], home: Level, when: str | None) -> tuple[Arg, Arg, tuple[Arg, ...]]:
        """Lower bound, upper bound, and the breaks between them."""
        node = group[0]
        analysis = self.analysis.of(node)
        lo, hi = self.number(node.lo, home), self.number(node.hi, home)
        breaks = tuple(self.number(p, home) for p in analysis.points)
        if all(infinite_ends(node)):
            breaks += (0.0,)
        breaks += self._peaks(group, home)
        ends = [turn for turn in analysis.bends if turn.kind == "end"]
        if not is_unbounded(node) and (len(ends) > 1 or any(Shadow((node.var,)).degree(turn.function) == 2 for turn in ends)):
            breaks += (self.number(mul(const(0.5), add(node.lo, node.hi)), home),)  # no piece is singular at both ends
        decisive = self._decisive(group, home)
        for isolation in analysis.isolated:
            found = self.isolated_in(node, isolation, home, when, wide=True)
            if isolation.g in decisive:  # too many roots: no number
                lo = self.assign(home, "v", "select", self.assign(home, "b", "ok", found[0]), lo, NAN)
            breaks += self._mattering(found, analysis.matters[isolation.g], node.var, home)
        for location in analysis.located:
            breaks += self.located(location, node.lo, node.hi, home, when)
        return lo, hi, breaks

    def _exponentials(self, group: Sequence[Integral]) -> tuple[list[Expr], list[tuple[Expr, Expr]]]:
        """Of exponentials of polynomials in the integrands: rates of the linear ones, slope at 0 and curvature of the quadratic ones."""
        x, bodies = group[0].var, [i.body for i in group]
        inner = self.binders(bodies)
        linear: dict[Expr, None] = {}
        quadratic: dict[tuple[Expr, Expr], None] = {}
        for node in postorder(bodies):
            if not isinstance(node, Call) or node.name != "exp" or x not in node.free:
                continue
            pair = self._quadratic(node, x, inner)
            if pair is None:
                continue
            if pair[1] is ZERO:
                linear[pair[0]] = None
            else:
                quadratic[pair] = None
        return list(linear)[:MAX_SCALES], list(quadratic)[:MAX_SCALES]

    def _quadratic(self, node: Call, x: Var, inner: frozenset[Var]) -> tuple[Expr, Expr] | None:
        """Of an exponential of a linear or quadratic polynomial: its exponent's slope at 0 and curvature, ZERO for a linear one."""
        exponent = self._at_ridge(node.children[0], inner)
        degree = Shadow((x,)).degree(exponent)
        if degree not in (1, 2):
            return None
        rate = slope(exponent, x)
        at_0, curvature = (cast(Expr, substitute(e, {x: ZERO})) for e in (rate, slope(rate, x)))
        if (at_0.free | curvature.free) & inner:
            return None
        return at_0, ZERO if degree == 1 else curvature

    def _at_ridge(self, exponent: Expr, inner: frozenset[Var]) -> Expr:
        """An exponent that is quadratic in variables of the integrals inside, at its stationary point in these."""
        for v in [v for v in inner if v in exponent.free]:
            if Shadow((v,)).degree(exponent) != 2:
                return exponent
            rate = slope(exponent, v)
            at_0, curvature = (cast(Expr, substitute(e, {v: ZERO})) for e in (rate, slope(rate, v)))
            exponent = cast(Expr, substitute(exponent, {v: div(mul(MINUS_ONE, at_0), curvature)}))
        return exponent

    def _peaks(self, group: Sequence[Integral], home: Level) -> tuple[Arg, ...]:
        """Where a narrow Gaussian stands in an integrand: its middle and where it ends. Nodes of the whole range would pass it by."""
        node = group[0]
        if all(isinstance(self._rule(i, home), Gauss | Rational) for i in group):
            return ()
        places: list[Arg] = []
        for rate, curvature in self._exponentials(group)[1]:
            width = div(const(PEAK), call("root", curvature))
            middle = div(mul(MINUS_ONE, rate), curvature)
            narrow: Cond = positive(mul(MINUS_ONE, curvature))
            if not is_unbounded(node):
                narrow = conjunction(narrow, positive(sub(call("magnitude", sub(node.hi, node.lo)), mul(const(4.0), width))))
            for place in (sub(middle, width), middle, add(middle, width)):
                places.append(self.number(where(narrow, place, const(math.nan)), home))
        return tuple(places)

    def _scale(self, group: Sequence[Integral], home: Level) -> Arg:
        """The length of tails: on which an exponential in the integrands falls off, 1 if there is none."""
        linear, quadratic = self._exponentials(group)
        scales = [div(ONE, call("magnitude", rate)) for rate in linear] + [div(ONE, call("root", c)) for _, c in quadratic]
        smallest = [self.number(s, home) for s in dict.fromkeys(scales)]
        least: Arg = 1.0
        for i, s in enumerate(smallest):
            usable = self.assign(
                home, "b", "and", self.assign(home, "b", "ok", s), self.assign(home, "b", "gt0", self.assign(home, "v", "div", 1.0, s))
            )
            s = self.assign(home, "v", "select", usable, s, 1.0)
            least = s if i == 0 else self.assign(home, "v", "min", least, s)
        return least

    def _mattering(self, roots: Sequence[Arg], matters: Cond, x: Var, home: Level) -> tuple[Arg, ...]:
        """Roots where they matter, NaN elsewhere."""
        if matters is TRUE:
            return tuple(roots)
        kept = []
        for root in roots:
            at_root = Level(x, home, home.depth + 1, names={x: root}, block=home.block)
            kept.append(self.assign(home, "v", "select", self.truths(matters, at_root)[0], root, NAN))
        return tuple(kept)

    def _bends(self, group: Sequence[Integral], level: Level, home: Level, rule: Rule) -> tuple[Arg, tuple[Bend, ...]]:
        """Where the integrands bend: coefficients are numbers from outside, whether a bend counts is decided in the middle of a piece. Of a
        rational integrand it is the pole, whether it is known to count or not."""
        x, lo = group[0].var, group[0].lo
        turns: dict[object, Turn] = {}
        for node in group:
            for turn in self.analysis.of(node).bends:
                if isinstance(rule, Rational) and turn.kind != "pole":
                    continue
                turns.setdefault((turn.kind, self.analysis.key(turn.function)), turn)
        base = local_origin(lo, group[0].hi)
        bends = []
        for turn in list(turns.values())[:MAX_BENDS]:
            first = slope(turn.function, x)
            coefficients = turn.function, first, mul(const(0.5), slope(first, x))
            numbers = tuple(self.number(cast(Expr, substitute(c, {x: base})), home) for c in coefficients)
            holds = self.truths(turn.when, cast(Level, level.middle))[0]
            if holds is not False or isinstance(rule, Rational):
                bends.append(Bend(turn.kind, cast("tuple[Arg, Arg, Arg]", numbers), holds))
        return self.number(base, home) if bends else 0.0, tuple(bends)

    def _watched(self, bodies: Sequence[Expr], level: Level) -> tuple[str, ...]:
        """What may change inside a piece because its roots have no formula: the rule closes in on such places."""
        x, handled = cast(Var, level.var), cast(Breaks, level.breaks).handled
        inner = self.binders(bodies)
        conditions: dict[Cond, None] = {}
        atoms = {c for b in bodies for c in atoms_of(b, x)}  # not what only decides a tie
        for node in postorder(bodies):
            if x not in node.free or node.free & inner:
                continue
            if isinstance(node, Compare) and node.g not in handled and node in atoms:
                conditions[node] = None
                turning = _slope_of(node.g, x)
                if turning is not None:
                    conditions[positive(turning)] = None  # two jumps between neighbouring nodes have a turning point between them
            elif isinstance(node, Call) and node.name in ("floor", "mod"):
                u = node.children[0] if node.name == "floor" else div(*node.children)
                conditions[positive(sub(const(0.5), sub(u, call("floor", u))))] = None  # false before a step, true after it
        names = [self.truths(c, level)[0] for c in conditions]
        return tuple(dict.fromkeys(n for n in names if isinstance(n, str)))

    def _need(self, bodies: Sequence[Expr], level: Level) -> str | None:
        """A condition, constant on a piece, without which all integrands are 0 there."""
        conditions: list[Cond] = []
        for body in bodies:
            c = support(body)
            parts = c.children if isinstance(c, And) else (c,)
            kept = [p for p in parts if level.is_constant(p)]
            if c is TRUE or not kept:
                return None
            conditions.append(conjunction(*kept))
        total = disjunction(*conditions)
        if total is TRUE or (isinstance(total, Or) and len(total.children) > 2 * GUARD_TERMS):
            return None
        holds, fails = self.truths(total, level)
        if not isinstance(fails, str):
            return None
        home = self.home_of(total, level)
        if home is level.middle:
            home.names[total] = (holds, False)  # on the pieces that are not skipped: it holds, or is not a number
        name = self.fresh("b")
        cast(Level, level.middle).block.append(Assign(name, "not", (fails,)))
        return name
