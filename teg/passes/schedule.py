"""From a closed expression without δ to the flat program of `teg.program`.

Every value is computed once, at the outermost level where its inputs exist. An integral becomes one `Integrate`; integrals of one level
with the same variable, bounds, breaks, rule and guard share one, with several results. Inside, what is constant on a piece (conditions
whose roots are breaks, and what depends on x through them only) goes to its `flags`, the rest to its `body`.

A condition is two booleans, *holds* and *fails*: both are false where it is NaN, and `where` on it is then NaN (Kleene's logic), so NaN
comes out where NaN went in, unless the branch that holds it is not taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from teg.calculus import slope
from teg.errors import NotDifferentiableError
from teg.expr import (
    MINUS_ONE,
    ONE,
    TRUE,
    Add,
    And,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    Mul,
    Not,
    Or,
    Param,
    Pow,
    Truth,
    Tuple,
    Var,
    Where,
    call,
    conjunction,
    const,
    disjunction,
    div,
    positive,
    sub,
)
from teg.integral import Delta, Integral, PointMasses, masses_of
from teg.isolation import MAX_ROOTS, Isolation, Location, isolate, off_the_grid, widened
from teg.node import Node, postorder
from teg.passes.breaks import BreakAnalysis, Breaks
from teg.passes.demand import GUARD_TERMS, guards, support
from teg.program import (
    TIE_EPS,
    Adaptive,
    Arg,
    Assign,
    Gauss,
    Integrate,
    Isolate,
    Locate,
    Program,
    Rule,
    Stmt,
    SumOver,
    Tie,
    without_dead_code,
)
from teg.roots import Root, solve
from teg.surfaces import atoms_of, binders_inside
from teg.traverse import replace_node

MAX_GAUSS = 24
TIGHTEST = 1e-14
INNER_TIGHTER = 0.1
"""An integral inside another one is computed to a tenth of its tolerance, so that the outer one sees a smooth function."""


def schedule(outputs: Sequence[Expr], parameters: Sequence[str], tol: float, rule: str = "auto", max_roots: int = MAX_ROOTS) -> Program:
    """One program for several outputs. `rule`: "auto", or "adaptive" also where a polynomial could be integrated exactly."""
    return _Scheduler(parameters, tol, rule, max_roots).run(outputs)


def rule_for(node: Integral, analysis: BreakAnalysis, tol: float, depth: int) -> Rule:
    """Gauss with as many nodes as a polynomial between known breaks needs; adaptive for anything else, tighter inside."""
    degree = analysis.degree(node)
    if degree is not None and degree // 2 + 1 <= MAX_GAUSS:
        return Gauss(degree // 2 + 1)
    return Adaptive(max(tol * INNER_TIGHTER**depth, TIGHTEST), analysis.of(node).rooted)


def _slope_of(g: Expr, x: Var) -> Expr | None:
    try:
        rate = slope(g, x)
    except NotDifferentiableError:
        return None
    return rate if x in rate.free else None


Truths = tuple[Arg, Arg]  # holds, fails
_NAN = float("nan")
_NOWHERE = float("inf")
_EPSILON = 2.0**-52


@dataclass
class _Level:
    """The inside of one integral (or the outside of all): where statements go, and what has a name already.

    An integral has two: the nodes of a piece, and its `middle`, where everything that is constant on the piece is evaluated.
    """

    var: Var | None
    outer: _Level | None
    depth: int
    breaks: Breaks | None = None
    middle: _Level | None = None
    block: list[Stmt] = field(default_factory=list)
    names: dict[Node, Arg | Truths] = field(default_factory=dict)
    computed: dict[tuple[str, tuple[Arg, ...]], str] = field(default_factory=dict)
    errors: dict[Expr, Arg] = field(default_factory=dict)
    groups: dict[Integral, list[Integral]] = field(default_factory=dict)
    guards: dict[Integral, Cond] = field(default_factory=dict)
    isolated: dict[object, tuple[Arg, ...]] = field(default_factory=dict)
    coincident: dict[Compare, Arg] = field(default_factory=dict)  # of a sum over roots: the conditions that may tie with its surface
    constant: dict[Node, bool] = field(default_factory=dict)  # on a piece

    def is_constant(self, node: Node) -> bool:
        """Does the node depend on this level's variable through conditions that are constant on a piece only?"""
        known, handled = self.constant, cast(Breaks, self.breaks).handled
        stack = [node]
        while stack:
            n = stack[-1]
            if n in known:
                stack.pop()
            elif self.var not in n.free:
                known[n] = True
                stack.pop()
            elif isinstance(n, Var | Integral):
                known[n] = False
                stack.pop()
            elif isinstance(n, Compare):
                known[n] = n.g in handled
                stack.pop()
            elif missing := [c for c in n.children if c not in known]:
                stack.extend(missing)
            else:
                known[n] = all(known[c] for c in n.children)
                stack.pop()
        return known[node]


class _Scheduler:
    def __init__(self, parameters: Sequence[str], tol: float, rule: str, max_roots: int) -> None:
        self.rule = rule
        self.parameters = list(parameters)
        self.parameter_names = {p: f"p{i}" for i, p in enumerate(parameters)}
        self.tol = tol
        self.max_roots = max_roots
        self.analysis = BreakAnalysis(max_roots)
        self.count = 0
        self.ties: dict[tuple[str, str], int] = {}
        self.binders: dict[Node, frozenset[Var]] = {}

    def run(self, outputs: Sequence[Expr]) -> Program:
        top = _Level(None, None, 0)
        self._plan_integrals(top, outputs)
        names = tuple(self._number(e, top) for e in outputs)
        return without_dead_code(Program(tuple(self.parameters), tuple(top.block), names, tuple(Tie(t) for t in self.ties)))

    def _fresh(self, kind: str) -> str:
        self.count += 1
        return f"{kind}{self.count}"

    # -- where things go -----------------------------------------------------------------------------------------------

    def _home(self, node: Node, level: _Level) -> _Level:
        """The outermost level where the inputs of a node exist."""
        while level.var is not None:
            if level.var in node.free:
                return level.middle if level.middle is not None and level.is_constant(node) else level
            level = cast(_Level, level.outer)
        return level

    def _assign(self, home: _Level, kind: str, op: str, *args: Arg) -> str:
        key = (op, args)
        if key not in home.computed:
            home.computed[key] = self._fresh(kind)
            home.block.append(Assign(home.computed[key], op, args))
        return home.computed[key]

    def _number(self, e: Expr, level: _Level) -> Arg:
        self._emit(e, level)
        return cast(Arg, self._home(e, level).names[e])

    def _truths(self, c: Cond, level: _Level) -> Truths:
        self._emit(c, level)
        return cast(Truths, self._home(c, level).names[c])

    def _emit(self, root: Node, level: _Level) -> None:
        """Give the node and everything below it a name, children first, without recursion (but for the nesting of integrals)."""
        stack: list[tuple[Node, _Level]] = [(root, level)]
        while stack:
            node, at = stack[-1]
            home = self._home(node, at)
            if node in home.names:
                stack.pop()
                continue
            children: Sequence[Node] = node.children[1:] if isinstance(node, Integral) else node.children
            missing = [(c, home) for c in children if c not in self._home(c, home).names]
            if missing:
                stack.extend(reversed(missing))
                continue
            if isinstance(node, Integral):
                self._integrate(node, home)
            elif isinstance(node, Cond):
                home.names[node] = self._condition(node, home)
            else:
                home.names[node] = self._value(cast(Expr, node), home)
            stack.pop()

    # -- values and conditions -----------------------------------------------------------------------------------------

    def _value(self, e: Expr, home: _Level) -> Arg:
        def name(child: Expr) -> Arg:
            return cast(Arg, self._home(child, home).names[child])

        match e:
            case Const():
                return cast(float, e.data)
            case Param():
                return self.parameter_names[e.name]
            case Add():
                return self._sum(e, home)
            case Mul():
                return self._product(e, home)
            case Pow():
                if e.exponent == -1:
                    return self._assign(home, "v", "div", 1.0, name(e.base))
                return self._assign(home, "v", "powi", name(e.base), e.exponent)
            case Call():
                if e.name == "root":
                    return self._assign(home, "v", "sqrt", self._assign(home, "v", "abs", name(e.children[0])))
                op = "abs" if e.name == "magnitude" else e.name
                return self._assign(home, "v", op, *(name(c) for c in e.children))
            case Where():
                holds, fails = cast(Truths, self._home(e.condition, home).names[e.condition])
                otherwise: Arg = name(e.otherwise) if fails is not False else _NAN
                if not isinstance(fails, bool):
                    otherwise = self._assign(home, "v", "select", fails, otherwise, _NAN)
                return self._assign(home, "v", "select", holds, name(e.then), otherwise)
            case Tuple() | Delta() | _:
                raise AssertionError(f"{type(e).__name__} cannot be scheduled")

    def _sum(self, e: Add, home: _Level) -> Arg:
        """Terms are added from the left in the order written; a term -u is subtracted."""
        total: list[Arg] = []
        for term in e.children:
            negative = isinstance(term, Mul) and isinstance(term.children[0], Const) and term.children[0].data == -1.0
            if total and negative and len(term.children) == 2:
                left = total[0] if len(total) == 1 else self._assign(home, "v", "add", *total)
                total = [self._assign(home, "v", "sub", left, self._number(cast(Expr, term.children[1]), home))]
            else:
                total.append(self._number(term, home))
        return total[0] if len(total) == 1 else self._assign(home, "v", "add", *total)

    def _product(self, e: Mul, home: _Level) -> Arg:
        above: list[Arg] = []
        below: list[Arg] = []
        sign = False
        for factor in e.children:
            if isinstance(factor, Pow) and factor.exponent == -1:
                below.append(self._number(factor.base, home))
            elif isinstance(factor, Const) and factor.data == -1.0:
                sign = True
            else:
                above.append(self._number(factor, home))
        result: Arg = 1.0 if not above else above[0]
        if len(above) > 1:
            result = self._assign(home, "v", "mul", *above)
        for divisor in below:
            result = self._assign(home, "v", "div", result, divisor)
        return self._assign(home, "v", "neg", result) if sign else result

    def _condition(self, c: Cond, home: _Level) -> Truths:
        def truths(child: Node) -> Truths:
            return cast(Truths, self._home(child, home).names[child])

        match c:
            case Truth():
                return (bool(c.data), not c.data)
            case Not():
                holds, fails = truths(c.operand)
                return (fails, holds)
            case And() | Or():
                parts = [truths(child) for child in c.children]
                both, either = ("and", "or") if isinstance(c, And) else ("or", "and")
                return (
                    self._assign(home, "b", both, *(p[0] for p in parts)),
                    self._assign(home, "b", either, *(p[1] for p in parts)),
                )
            case Compare():
                g = cast(Arg, self._home(c.g, home).names[c.g])
                if c.resolution is not None:
                    return self._tie(c, g, home)
                ops = ("gt0", "le0") if c.strict else ("ge0", "lt0")
                return (self._assign(home, "b", ops[0], g), self._assign(home, "b", ops[1], g))
            case _:
                raise AssertionError(f"unknown condition {type(c).__name__}")

    def _tie(self, c: Compare, g: Arg, home: _Level) -> Truths:
        holds_first = cast(Truths, self._home(cast(Cond, c.resolution), home).names[cast(Cond, c.resolution)])[0]
        scale = self._tie_scale(c.g, home)
        if c in home.coincident:
            scale = self._assign(home, "v", "select", home.coincident[c], scale, 0.0)
        k = self.ties.setdefault(cast("tuple[str, str]", c.rivals), len(self.ties))
        holds = self._assign(home, "b", "tie", g, scale, holds_first, k)
        fails = self._assign(home, "b", "not", holds)
        ok = self._assign(home, "b", "ok", g)
        return (holds, self._assign(home, "b", "and", fails, ok))

    def _tie_scale(self, g: Expr, home: _Level) -> Arg:
        """What, times a few ε, an atom may be off by where it is 0: Σ|terms|, and the rounding errors its terms come with."""
        terms, error = self._terms_size(g, home), self._error(g, home)
        return terms if error == 0.0 else self._assign(home, "v", "add", terms, error)

    def _terms_size(self, g: Expr, home: _Level) -> Arg:
        """Σ|terms|, of the branch that is taken and behind a number in front."""
        if isinstance(g, Where):
            return self._assign(
                home, "v", "select", self._truths(g.condition, home)[0], self._terms_size(g.then, home), self._terms_size(g.otherwise, home)
            )
        if isinstance(g, Mul) and len(g.children) == 2 and isinstance(g.children[0], Const):
            return self._assign(home, "v", "mul", abs(g.children[0].data), self._terms_size(g.children[1], home))
        if not isinstance(g, Add):
            return self._size(self._number(g, home), home)
        return self._assign(home, "v", "add", *(self._size(self._number(t, home), home) for t in g.children))

    def _size(self, value: Arg, home: _Level) -> Arg:
        return abs(value) if isinstance(value, float | int) else self._assign(home, "v", "abs", value)

    def _error(self, root: Expr, level: _Level) -> Arg:
        """A running error bound in units of ε (Wilkinson 1963): parameters and variables are exact, each operation rounds once."""
        stack: list[tuple[Expr, _Level]] = [(root, level)]
        while stack:
            e, at = stack[-1]
            home = self._home(e, at)
            if e in home.errors:
                stack.pop()
                continue
            inside: Sequence[Expr] = ()
            if isinstance(e, Add | Mul | Pow | Call):
                inside = cast("Sequence[Expr]", e.children)
            elif isinstance(e, Where):
                inside = (e.then, e.otherwise)
            missing = [(c, home) for c in inside if c not in self._home(c, home).errors]
            if missing:
                stack.extend(missing)
                continue
            home.errors[e] = self._own_error(e, [self._home(c, home).errors[c] for c in inside], home)
            stack.pop()
        return self._home(root, level).errors[root]

    def _own_error(self, e: Expr, errors: list[Arg], home: _Level) -> Arg:
        def put(op: str, *args: Arg) -> Arg:
            return self._assign(home, "v", op, *args)

        def size(child: Expr) -> Arg:
            return self._size(self._number(child, home), home)

        def scaled(error: Arg, by: Arg) -> Arg:
            return 0.0 if error == 0.0 else by if error == 1.0 else put("mul", error, by)

        def total(*parts: Arg) -> Arg:
            kept = [p for p in parts if p != 0.0]
            return put("add", *kept) if len(kept) > 1 else kept[0] if kept else 0.0

        match e:
            case Const() | Param() | Var():
                return 0.0
            case Add():
                return total(size(e), *errors)
            case Mul():
                if e.children[0] is MINUS_ONE and len(e.children) == 2:
                    return errors[1]
                carried = []
                for i, err in enumerate(errors):
                    if err != 0.0:
                        carried.append(put("mul", err, *(size(f) for j, f in enumerate(e.children) if j != i)))
                return total(size(e), *carried)
            case Pow():
                if errors[0] == 0.0:
                    return size(e)
                return total(size(e), put("mul", float(abs(e.exponent)), errors[0], put("powi", size(e.base), e.exponent - 1)))
            case Where():
                return errors[0] if errors[0] == errors[1] else put("select", self._truths(e.condition, home)[0], *errors)
            case Call() if e.name == "magnitude":
                return errors[0]
            case Call() if e.name in ("sqrt", "root") and errors[0] != 0.0:
                least = put("sqrt", put("mul", _EPSILON, errors[0]))  # √ of a rounding error is the most the root of nothing can be
                return total(size(e), put("div", errors[0], put("add", size(e), least)))
            case Call() if e.name == "log" and errors[0] != 0.0:
                return total(size(e), put("div", errors[0], size(e.children[0])))
            case Call() if e.name == "exp":
                return total(size(e), scaled(errors[0], size(e)))
            case Call():
                return total(size(e), *errors)
            case _:
                return size(e)

    # -- integrals -----------------------------------------------------------------------------------------------------

    def _binders(self, node: Node) -> frozenset[Var]:
        if node not in self.binders:
            self.binders[node] = binders_inside(node)
        return self.binders[node]

    def _plan_integrals(self, level: _Level, roots: Sequence[Expr]) -> None:
        """Find the integrals that belong to this level, when each is needed, and which of them share a loop."""
        order = postorder(roots)
        inner: frozenset[Var] = frozenset().union(*(self._binders(r) for r in roots))
        height: dict[Node, int] = {}
        mine: list[Integral] = []
        for node in order:
            height[node] = max([height[c] for c in node.children], default=0)
            here = not node.free if level.var is None else level.var in node.free and not node.free & inner
            if isinstance(node, Integral) and here:
                height[node] += 1
                mine.append(node)
        if not mine:
            return
        level.guards = guards(roots, order, inner, height, set(mine))
        shared: dict[object, list[Integral]] = {}
        for node in mine:
            masses = masses_of(node.body, node.var)
            rule: object = type(self._rule(node, level)) if masses is None else masses
            key = (
                node.var,
                node.lo,
                node.hi,
                frozenset(self.analysis.of(node).functions),
                rule,
                height[node],
                level.guards[node],
            )
            shared.setdefault(key, []).append(node)
        for group in shared.values():
            for node in group:
                level.groups[node] = group

    def _rule(self, node: Integral, level: _Level) -> Rule:
        rule = rule_for(node, self.analysis, self.tol, level.depth)
        if self.rule == "adaptive" and isinstance(rule, Gauss):
            return Adaptive(max(self.tol * INNER_TIGHTER**level.depth, TIGHTEST), self.analysis.of(node).rooted)
        return rule

    def _isolated(self, isolation: Isolation, lo: Expr, hi: Expr, home: _Level, when: Arg) -> tuple[Arg, ...]:
        """The roots of a function between two bounds, found at run time."""
        key = (isolation.g, isolation.var, lo, hi, when)
        if key not in home.isolated:
            ends = self._number(lo, home), self._number(hi, home)
            left, right, var = (self._fresh("x") for _ in range(3))
            at_left = _Level(isolation.left, home, home.depth + 1, names={isolation.left: left})
            at_both = _Level(isolation.right, at_left, home.depth + 1, names={isolation.right: right})
            bounds = cast("tuple[Arg, Arg, Arg, Arg]", tuple(self._number(b, at_both) for b in isolation.bounds))
            at_point = _Level(isolation.var, home, home.depth + 1, names={isolation.var: var})
            value, rate = self._number(isolation.g, at_point), self._number(isolation.slope, at_point)
            results = tuple(self._fresh("v") for _ in range(isolation.count))
            enclosure = (*at_left.block, *at_both.block)
            guard = when if isinstance(when, str) else None
            home.block.append(Isolate(var, *ends, left, right, enclosure, bounds, tuple(at_point.block), value, rate, results, guard))
            home.isolated[key] = results
        return home.isolated[key]

    def _decisive(self, group: Sequence[Integral], home: _Level) -> set[Expr]:
        """The functions of an integral without whose roots it would be wrong: those of its own conditions; all of them where a rule of
        fixed order, or conditions decided in the middle of pieces, rely on them. The others only help the adaptive rule."""
        functions = set(self.analysis.of(group[0]).functions)
        exact = any(isinstance(self._rule(i, home), Gauss) for i in group)
        if exact or any(isinstance(n, PointMasses) for n in postorder([i.body for i in group])):
            return functions
        inner: frozenset[Var] = frozenset().union(*(self._binders(i.body) for i in group))
        own = {a.g for i in group for a in atoms_of(i.body, i.var) if not a.g.free & inner}
        keys = {self.analysis.key(g) for g in own}
        return {f for f in functions if self.analysis.key(f) in keys}

    def _located(self, location: Location, lo: Expr, hi: Expr, home: _Level, when: Arg) -> tuple[Arg, ...]:
        """Where two surfaces meet, seen from the outer variable."""
        key = (location.f, location.g, location.inner, location.outer, location.low, location.high, lo, hi, when)
        if key not in home.isolated:
            rectangle = (*off_the_grid(lo, hi), *off_the_grid(location.low, location.high))
            first, last, low, high = (self._number(e, home) for e in rectangle)
            left, right, bottom, top = (self._fresh("x") for _ in location.corners)
            level, blocks = home, []
            for corner, name in zip(location.corners, (left, right, bottom, top), strict=True):
                level = _Level(corner, level, home.depth + 1, names={corner: name})
                blocks.append(level.block)
            bounds = cast("tuple[Arg, Arg, Arg, Arg]", tuple(self._number(b, level) for b in location.bounds))
            enclosure = tuple(s for block in blocks for s in block)
            results = tuple(self._fresh("v") for _ in range(MAX_ROOTS))
            guard = when if isinstance(when, str) else None
            home.block.append(Locate(first, last, low, high, left, right, bottom, top, enclosure, bounds, results, guard))
            home.isolated[key] = results
        return home.isolated[key]

    def _formula(self, g: Expr, node: Integral) -> tuple[Root, ...] | None:
        """The roots of g in the variable of an integral, where there is a formula for all of them."""
        roots = solve(g, node.var, node.lo, node.hi)
        return roots.found if roots is not None and roots.certain else None

    def _point(self, root: Root, home: _Level) -> Arg:
        """A root by its formula; +inf where it does not exist."""
        holds, fails = self._truths(root.exists, home)
        at = self._number(root.point, home)
        known = self._assign(home, "v", "select", self._assign(home, "b", "ok", at), at, _NOWHERE)  # 0/0: the degree is lower
        absent = _NOWHERE if fails is True else self._assign(home, "v", "select", fails, _NOWHERE, _NAN)
        return known if holds is True else self._assign(home, "v", "select", holds, known, absent)

    def _sum_over_roots(self, group: list[Integral], masses: PointMasses, home: _Level, when: Arg) -> tuple[Arg, ...]:
        """Σ over the roots of g of what multiplies its point masses."""
        node = group[0]
        bodies = [cast(Expr, replace_node(i.body, masses, ONE)) for i in group]
        formula = self._formula(masses.g, node)
        if formula is not None:
            return self._sum_of_branches(bodies, node.var, formula, home)
        isolation = isolate(masses.g, node.var, self.max_roots)
        if isolation is None:
            raise AssertionError(f"the roots of {masses.g} cannot be isolated")
        points = self._isolated(isolation, node.lo, node.hi, home, when)
        var = self._fresh("x")
        level = _Level(node.var, home, home.depth + 1, names={node.var: var})
        level.errors[node.var] = self._assign(level, "v", "mul", 4.0, self._assign(level, "v", "abs", var))  # a root is not exact
        if home.middle is not None:
            level.coincident = self._coincident(node, isolation, bodies, home.middle)
        self._plan_integrals(level, bodies)
        values = tuple(self._number(b, level) for b in bodies)
        results = tuple(self._fresh("v") for _ in group)
        home.block.append(SumOver(var, points, tuple(level.block), values, results, when if isinstance(when, str) else None))
        return results

    def _sum_of_branches(self, bodies: Sequence[Expr], x: Var, roots: Sequence[Root], home: _Level) -> tuple[Arg, ...]:
        """The same where the roots have formulas: one after the other. On a piece between complete breaks the conditions at a root are
        constant, and are decided in its middle, away from where they change."""
        inner: frozenset[Var] = frozenset().union(*(self._binders(b) for b in bodies))
        terms: list[list[Arg]] = [[] for _ in bodies]
        for root in roots:
            at = self._point(root, home)
            level = _Level(x, home, home.depth + 1, names={x: at}, block=home.block)
            level.errors[x] = self._error(root.point, home)
            if home.middle is not None and cast(Breaks, home.breaks).complete:
                middle = _Level(x, home.middle, home.depth + 1, names={x: self._point(root, home.middle)}, block=home.middle.block)
                middle.errors[x] = self._error(root.point, home.middle)
                for atom in dict.fromkeys(c for b in bodies for c in atoms_of(b, x)):
                    if not atom.g.free & inner:
                        level.names[atom] = self._truths(atom, middle)
            finite = self._assign(home, "b", "ok", self._assign(home, "v", "sub", at, at))
            absent = self._assign(home, "v", "select", self._assign(home, "b", "ok", at), 0.0, _NAN)
            self._plan_integrals(level, bodies)
            for body, found in zip(bodies, terms, strict=True):
                found.append(self._assign(home, "v", "select", finite, self._number(body, level), absent))
        return tuple(found[0] if len(found) == 1 else self._assign(home, "v", "add", *found) if found else 0.0 for found in terms)

    def _coincident(self, node: Integral, isolation: Isolation, bodies: Sequence[Expr], middle: _Level) -> dict[Compare, Arg]:
        """Which conditions tie with the surface g in the middle of a piece of the integral outside: only they can do so all along it. That
        the two touch in a point is no tie."""
        inner: frozenset[Var] = frozenset().union(*(self._binders(b) for b in bodies))
        rivals = [c for b in bodies for c in atoms_of(b, node.var) if c.resolution is not None and not c.g.free & inner]
        if not rivals:
            return {}
        points = self._isolated(isolation, node.lo, node.hi, middle, True)
        var = self._fresh("x")
        level = _Level(node.var, middle, middle.depth + 1, names={node.var: var})
        level.errors[node.var] = self._assign(level, "v", "mul", 4.0, self._assign(level, "v", "abs", var))
        values = []
        for c in dict.fromkeys(rivals):
            room = self._assign(level, "v", "mul", TIE_EPS, self._tie_scale(c.g, level))
            near = self._assign(level, "b", "ge0", self._assign(level, "v", "sub", room, self._size(self._number(c.g, level), level)))
            values.append(self._assign(level, "v", "select", near, 1.0, 0.0))
        results = tuple(self._fresh("v") for _ in values)
        middle.block.append(SumOver(var, points, tuple(level.block), tuple(values), results))
        return {c: self._assign(middle, "b", "gt0", r) for c, r in zip(dict.fromkeys(rivals), results, strict=True)}

    def _integrate(self, node: Integral, home: _Level) -> None:
        group = home.groups.get(node, [node])
        guard = home.guards.get(node, TRUE)
        when: Arg = True
        if guard is not TRUE:
            when = self._truths(guard, home)[0]
        masses = masses_of(node.body, node.var)
        if masses is not None:
            home.names.update(zip(group, self._sum_over_roots(group, masses, home, when), strict=True))
            return
        lo, hi = self._number(node.lo, home), self._number(node.hi, home)
        points = self.analysis.of(node).points
        breaks = tuple(self._number(p, home) for p in points)
        decisive = self._decisive(group, home)
        for isolation in self.analysis.of(node).isolated:
            found = self._isolated(isolation, *widened(node.lo, node.hi), home, when)
            if isolation.g in decisive:  # too many roots: no number
                lo = self._assign(home, "v", "select", self._assign(home, "b", "ok", found[0]), lo, _NAN)
            breaks += found
        if home.var is None:  # inside another integral it would be done for each of its nodes
            for location in self.analysis.of(node).located:
                breaks += self._located(location, node.lo, node.hi, home, when)
        rules = [self._rule(i, home) for i in group]
        rule = max(rules, key=lambda r: r.nodes if isinstance(r, Gauss) else 0)
        if isinstance(rule, Adaptive):
            rule = Adaptive(rule.tol, any(cast(Adaptive, r).smooth for r in rules))
        var = self._fresh("x")
        middle = _Level(node.var, home, home.depth + 1, names={node.var: var})
        level = _Level(node.var, home, home.depth + 1, self.analysis.of(node), middle, names={node.var: var})
        bodies = [i.body for i in group]
        self._plan_integrals(level, bodies)
        need = self._need(bodies, level)
        values = tuple(self._number(b, level) for b in bodies)
        watch = self._watched(bodies, level) if isinstance(rule, Adaptive) else ()
        results = tuple(self._fresh("v") for _ in group)
        home.block.append(
            Integrate(
                var,
                lo,
                hi,
                breaks,
                tuple(middle.block),
                need if isinstance(need, str) else None,
                tuple(level.block),
                values,
                results,
                rule,
                when if isinstance(when, str) else None,
                watch,
            )
        )
        for i, r in zip(group, results, strict=True):
            home.names[i] = r

    def _watched(self, bodies: Sequence[Expr], level: _Level) -> tuple[str, ...]:
        """What may change inside a piece because its roots have no formula: the rule closes in on such places."""
        x, handled = cast(Var, level.var), cast(Breaks, level.breaks).handled
        inner: frozenset[Var] = frozenset().union(*(self._binders(b) for b in bodies))
        conditions: dict[Cond, None] = {}
        for node in postorder(bodies):
            if x not in node.free or node.free & inner:
                continue
            if isinstance(node, Compare) and node.g not in handled:
                conditions[node] = None
                turning = _slope_of(node.g, x)
                if turning is not None:
                    conditions[positive(turning)] = None  # two jumps between neighbouring nodes have a turning point between them
            elif isinstance(node, Call) and node.name in ("floor", "mod"):
                u = node.children[0] if node.name == "floor" else div(*node.children)
                conditions[positive(sub(const(0.5), sub(u, call("floor", u))))] = None  # false before a step, true after it
        names = [self._truths(c, level)[0] for c in conditions]
        return tuple(dict.fromkeys(n for n in names if isinstance(n, str)))

    def _need(self, bodies: Sequence[Expr], level: _Level) -> Arg:
        """A condition, constant on a piece, without which all integrands are 0 there."""
        conditions: list[Cond] = []
        for body in bodies:
            c = support(body)
            parts = c.children if isinstance(c, And) else (c,)
            kept = [p for p in parts if level.is_constant(p)]
            if c is TRUE or not kept:
                return True
            conditions.append(conjunction(*kept))
        total = disjunction(*conditions)
        if total is TRUE or (isinstance(total, Or) and len(total.children) > 2 * GUARD_TERMS):
            return True
        holds, fails = self._truths(total, level)
        if not isinstance(fails, str):
            return True
        home = self._home(total, level)
        if home is level.middle:
            home.names[total] = (holds, False)  # on the pieces that are not skipped: it holds, or is not a number
        name = self._fresh("b")
        cast(_Level, level.middle).block.append(Assign(name, "not", (fails,)))
        return name
