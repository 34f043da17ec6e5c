"""Where the pieces of each integral begin and end.

The integrand of ∫ dx is smooth between its *breaks*. Breaks are the roots in x of

- the atoms in x, wherever they stand in the integrand, its inner integrals and their bounds; arguments of |·| and √;
- the projection of each inner integral ∫ₗʰ dz (one step of cylindrical decomposition), for its own break functions f, f₁, f₂:
      f|z:=l, f|z:=h                         a root of the inner integral crosses a bound
      a₂·f₁|z:=l - a₁·f₂|z:=l                two roots meet (f = f|z:=l + a·(z - l); a quadratic f₂ is taken at the root of f₁)
      a                                      a root runs away to infinity
      B² - 4AC                               two roots of a quadratic f meet and vanish: √-like from then on
      the border of the condition under which a root of another formula exists, likewise
      h - l                                  the bounds cross

A function with branches contributes the breaks of each branch: too many breaks cost time, never accuracy. Functions whose roots have no
formula leave the integral *incomplete*: it is then integrated adaptively.
Source: Collins 1975 (projection); Saye 2022, for quadrature on such pieces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.coincidence import coincide
from teg.analysis.isolation import MARGIN, MAX_ROOTS, Isolation, Location, isolate, locate
from teg.analysis.polynomial import Degrees, Point, Poly, Ratio, Shadow, divided, residue
from teg.analysis.roots import Roots, discriminant, far_origin, local_origin, quadratic_coefficients, solve
from teg.analysis.surfaces import atoms_of, binders_inside
from teg.errors import NotDifferentiableError
from teg.ir.expr import (
    FALSE,
    ONE,
    TRUE,
    ZERO,
    Add,
    Call,
    Compare,
    Cond,
    Const,
    Expr,
    Mul,
    Or,
    Pow,
    Var,
    Where,
    add,
    call,
    conjunction,
    const,
    disjunction,
    div,
    integer_power,
    mul,
    negation,
    positive,
    sub,
    where,
)
from teg.ir.integral import ClosedForm, Integral, masses_of
from teg.ir.node import Node, digest, postorder
from teg.ir.traverse import replace_node, substitute

LEVEL = 1e-200
"""A function is the same for all values of a variable if the squares of its derivatives at three of them add up to less."""
MAX_BRANCHES = 16
MAX_FUNCTIONS = 4000
MAX_LOCATED = 12
MAX_BENDS = 8
MAX_PLACES = 8
MAX_ISOLATED = 12
"""The largest number of functions of one integral whose roots are isolated at run time. With more of them adaptive
integration costs less."""


@dataclass(frozen=True)
class Turn:
    """A function whose zeros are branch points ("root"), poles ("pole") or singular ends ("end") of an integrand.

    The function counts on a piece if the condition `when` holds in the middle of the piece.
    """

    kind: str
    function: Expr
    when: Cond = TRUE


@dataclass(frozen=True)
class Breaks:
    """The breaks of one integral.

    `functions` are the break functions, `points` their roots in closed form. `matters` maps a function whose roots are found at run time
    to a condition: evaluated at a root, it says whether the root is a break inside the inner bounds. `isolated` are the functions whose
    roots are found at run time; `located` are the pairs of them whose common zeros are found at run time, where no better break is
    known. `handled` are the surfaces g whose sign is constant on every piece. `complete` says that the integrand is smooth on every
    piece. `bends` are the points where the integrand turns into another branch, also outside of a piece. `rooted` says that the
    integrand may behave like a square root at the end of a piece for other reasons.
    """

    functions: tuple[Expr, ...]
    points: tuple[Expr, ...]
    isolated: tuple[Isolation, ...]
    located: tuple[Location, ...]
    handled: frozenset[Expr]
    complete: bool
    rooted: bool
    bends: tuple[Turn, ...] = ()
    matters: Mapping[Expr, Cond] = field(default_factory=dict)


Meeting = tuple[Expr, Expr, Var, Expr, Expr]
"""Two functions, the inner variable in which they may have a common root, and its range."""


@dataclass
class _Found:
    functions: dict[Expr, Cond]  # the condition, in the outer variable, under which the function's zeros matter
    rooted: bool = False
    complete: bool = True
    meetings: dict[Meeting, None] = field(default_factory=dict)
    turns: dict[Turn, None] = field(default_factory=dict)


class BreakAnalysis:
    """Breaks and degrees of the integrals of a program, each computed once."""

    def __init__(self, max_roots: int = MAX_ROOTS) -> None:
        self.max_roots = max_roots
        self._breaks: dict[Integral, Breaks] = {}
        self._projections: dict[Integral, _Found] = {}
        self._shadows: dict[tuple[Var, ...], Shadow] = {}
        self.degrees = Degrees()
        self._formulas: dict[tuple[Expr, Var, Expr, Expr], Roots | None] = {}
        self._points = (Point("first"), Point("second"))
        self._keys: dict[Expr, object] = {}

    # -- breaks --------------------------------------------------------------------------------------------------------

    def of(self, node: Integral) -> Breaks:
        """Returns the breaks of an integral; the breaks of its inner integrals are computed first."""
        if node not in self._breaks:
            for inner in postorder([node]) if any(c.has_integral for c in node.children) else [node]:
                if isinstance(inner, Integral) and inner not in self._breaks:
                    self._breaks[inner] = self._find(inner)
        return self._breaks[node]

    def _find(self, node: Integral) -> Breaks:
        x, body = node.var, node.body
        inner = binders_inside(body)
        masses = masses_of(body, x)
        if masses is not None:  # no breaks of its own; its roots and its conditions contribute to outer integrals
            atoms = [a.g for a in atoms_of(body, x) if not a.g.free & inner]
            formula = self.solve(masses.g, x, node.lo, node.hi)
            complete = formula is not None and formula.certain
            return Breaks(tuple(dict.fromkeys((masses.g, *atoms))), (), (), (), frozenset(), complete, False)
        projection = _Found({})
        direct = [a.g for a in atoms_of(body, x) if not a.g.free & inner]
        for g in direct:
            projection.functions[g] = TRUE
        self._collect(body, x, inner, projection)
        points: dict[Expr, None] = {}
        isolated: dict[Expr, Isolation | None] = {}
        handled: set[Expr] = set()
        complete = projection.complete
        functions, matters = self._distinct(projection.functions)
        for f, representative in functions.items():
            if self.is_zero(representative):  # a surface that coincides with the surface of these point masses
                handled.add(f)
                continue
            roots = self._roots(representative, x, node.lo, node.hi)
            if roots is not None and roots[1]:
                handled.add(f)
            else:
                if roots is None and representative not in isolated and len(isolated) < MAX_ISOLATED:
                    isolated[representative] = isolate(representative, x, self.max_roots)
                if isolated.get(representative) is not None:
                    handled.add(f)
                    continue
                complete = False
            for r in roots[0] if roots is not None else ():
                kept = _kept(r, matters[representative], x)
                if not _outside(r, node.lo, node.hi) and not (isinstance(kept, Const) and math.isnan(kept.data)):
                    points[kept] = None
        distinct = tuple(dict.fromkeys(functions.values()))
        at_run_time = tuple(i for i in isolated.values() if i is not None)
        located = [locate(f, g, z, low, high, x) for f, g, z, low, high in list(projection.meetings)[:MAX_LOCATED]]
        together = tuple(m for m in located if m is not None)
        bends = self._bends(projection, x)
        return Breaks(distinct, tuple(points), at_run_time, together, frozenset(handled), complete, projection.rooted, bends, matters)

    def _bends(self, projection: _Found, x: Var) -> tuple[Turn, ...]:
        """Returns the distinct turns that are quadratic in the variable. Other turns only set `rooted`: the integrand may be a root at a
        piece's end."""
        bends: dict[object, Turn] = {}
        for turn in projection.turns:
            degree = self.degrees.of(turn.function, x)
            if degree == 0:
                continue
            key = turn.kind, self.key(turn.function)
            known = bends.get(key)
            if known is not None:
                bends[key] = replace(known, when=disjunction(known.when, turn.when))
            elif degree in (1, 2) and len(bends) < MAX_BENDS:
                bends[key] = turn
            elif turn.kind != "pole":
                projection.rooted = True
        return tuple(bends.values())

    def _collect(self, body: Expr, x: Var, inner: frozenset[Var], collected: _Found) -> None:
        """Collects functions that are not atoms: arguments of |·| and √, and the projections of inner integrals."""
        seen: set[tuple[Node, bool]] = set()
        stack: list[tuple[Node, bool]] = [(body, True)]
        while stack:
            node, counts = stack.pop()
            if (node, counts) in seen or x not in node.free:
                continue
            seen.add((node, counts))
            if isinstance(node, ClosedForm):
                stack.extend((c, counts) for c in node.terms)
                for f in (*node.kinks, *node.births) if counts and not node.free & inner else ():
                    collected.functions[f] = TRUE
                collected.turns.update((Turn("root", f), None) for f in node.births if counts and not node.free & inner)
                continue
            if isinstance(node, Compare):  # only the roots of its own atoms matter, not where these atoms are smooth
                stack.append((node.g, counts and bool(node.g.free & inner)))
            else:
                stack.extend((c, counts) for c in node.children)
            if isinstance(node, Call) and not counts and node.name in _PARTIAL and not node.free & inner and not _is_sum_of_squares(node):
                collected.functions[node.children[0]] = TRUE  # the border of the set on which the condition is a number
            if isinstance(node, Call) and not node.free & inner:
                if node.name == "magnitude":
                    if counts:
                        collected.functions[node.children[0]] = TRUE
                elif node.name in ("sqrt", "root", "pow"):
                    for factor in _factors(node.children[0], x) if counts else ():
                        collected.functions[factor] = TRUE
                        collected.turns[Turn("end" if node.name == "pow" else "root", factor)] = None
                elif node.name == "log":
                    for factor in _factors(node.children[0], x) if counts else ():
                        collected.turns[Turn("end", factor)] = None
                elif node.name in ("floor", "mod"):
                    collected.complete = False
            elif isinstance(node, Pow) and node.exponent < 0 and counts and not node.free & inner:
                base = _with_the_same_zeros(node.base)
                if self.degrees.of(base, x) in (1, 2):
                    collected.functions[base] = TRUE
                    collected.turns[Turn("pole", base)] = None
            elif isinstance(node, Integral):
                projection = self._projection(node)
                collected.complete &= projection.complete
                collected.rooted |= projection.rooted
                for f, condition in projection.functions.items():
                    if x in f.free and not f.free & inner:
                        condition = TRUE if condition.free & inner else condition
                        collected.functions[f] = disjunction(collected.functions.get(f, FALSE), condition)
                for turn in projection.turns:
                    if x in turn.function.free and not (turn.function.free | turn.when.free) & inner:
                        collected.turns[turn] = None
                for meeting in projection.meetings:
                    first, second, z, low, high = meeting
                    free = (first.free | second.free) - {z} | low.free | high.free
                    if x in free and x not in low.free | high.free and not free & inner:
                        collected.meetings[meeting] = None

    def _distinct(self, functions: dict[Expr, Cond]) -> tuple[dict[Expr, Expr], dict[Expr, Cond]]:
        """Returns the first proportional function for each function, and for each first function the condition under which its zeros
        matter."""
        first: dict[object, Expr] = {}
        distinct = {f: first.setdefault(self.key(f), f) for f in functions} if len(functions) > 1 else {f: f for f in functions}
        matters: dict[Expr, Cond] = {}
        for f, representative in distinct.items():
            condition = disjunction(matters.get(representative, FALSE), functions[f])
            matters[representative] = TRUE if isinstance(condition, Or) and len(condition.children) > MAX_PLACES else condition
        return distinct, matters

    def key(self, f: Expr) -> object:
        """Returns a key that is equal for functions that are proportional by a number."""
        if f not in self._keys:
            u, v = (p.value(f) for p in self._points)
            self._keys[f] = divided(v, u) if u and v else f
        return self._keys[f]

    def solve(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> Roots | None:
        """Returns the roots of a function by formula, cached: integrals that share surfaces and bounds ask for the same roots."""
        problem = (f, x, lo, hi)
        if problem not in self._formulas:
            self._formulas[problem] = solve(f, x, lo, hi, degrees=self.degrees)
        return self._formulas[problem]

    def _roots(self, f: Expr, x: Var, lo: Expr, hi: Expr) -> tuple[list[Expr], bool] | None:
        """Returns the roots of a function over all its branches, and whether these are certainly all; else the rule searches for others.

        None if no formula is known.
        """
        points: list[Expr] = []
        certain = True
        branches = _branches(f)
        if branches is None:
            return None
        for branch in branches:
            roots = self.solve(branch, x, lo, hi)
            if roots is None:
                return None
            points.extend(r.point if r.exists is TRUE else where(r.exists, r.point, const(math.nan)) for r in roots.found)
            certain &= roots.certain
        return points, certain

    def _projection(self, node: Integral) -> _Found:
        if node not in self._projections:
            self._projections[node] = _Projection(self, node).run()
        return self._projections[node]

    def is_zero(self, f: Expr) -> bool:
        """Returns whether a function is 0 everywhere, although it is not written as 0."""
        return all(p.value(f) == 0 for p in self._points)

    def somewhere(self, f: Expr, z: Var, lo: Expr, hi: Expr) -> Cond:
        """Returns the condition that a root of f, known by formula, lies between the bounds."""
        roots = self.solve(f, z, lo, hi)
        if roots is None:
            return TRUE
        return disjunction(*(conjunction(r.exists, _within(r.point, lo, hi)) for r in roots.found))

    def nearby(self, f: Expr, z: Var, lo: Expr, hi: Expr) -> Cond:
        """Returns the condition that a root of a quadratic lies between the bounds or near them. Near a double root the root need not
        exist."""
        roots = self.solve(f, z, lo, hi)
        return TRUE if roots is None else disjunction(*(_near(r.point, lo, hi) for r in roots.found))

    # -- degrees -------------------------------------------------------------------------------------------------------

    def degree(self, node: Integral) -> int | None:
        """Returns the degree of the integrand in the variable on each piece; None if it is not known to be a polynomial."""
        if not self.of(node).complete:
            return None
        return self.shadow((node.var,)).degree(node.body)

    def shadow(self, variables: tuple[Var, ...]) -> Shadow:
        """Returns normal forms of integrands as polynomials in variables; integrals inside them are written out."""
        if variables not in self._shadows:
            self._shadows[variables] = Shadow(variables, integral=lambda inner: self._integral_shadow(inner, variables), kinks=True)
        return self._shadows[variables]

    def _integral_shadow(self, node: Integral, variables: tuple[Var, ...]) -> Ratio | None:
        """Returns an integral as a polynomial of outer variables: a random combination of its antiderivative at its bounds and breaks."""
        breaks = self.of(node)
        if not breaks.complete or node.var in variables or any(v in i.g.free for i in breaks.isolated for v in variables):
            return None
        inner = self.shadow((node.var, *variables)).polynomial(node.body)
        if inner is None:
            return None
        shadow = self.shadow(variables)
        ends = [shadow.of(e) for e in (node.lo, node.hi, *breaks.points)]
        if any(e is None for e in ends):
            return None
        total: Ratio | None = shadow.constant(0)
        for k, end in enumerate(cast("list[Ratio]", ends)):
            at_end = _antiderivative_at(shadow, inner, end)
            if at_end is None or total is None:
                return None
            total = shadow._sum([total, shadow._scale(at_end, residue("end", digest(node), k))])
        return total


class _Projection:
    """The functions that an inner integral contributes to the breaks of the outer one, sorted by their degree in the inner variable."""

    def __init__(self, analysis: BreakAnalysis, node: Integral) -> None:
        self.analysis, self.node = analysis, node
        self.breaks = analysis.of(node)
        self.out = _Found({}, self.breaks.rooted and not self.breaks.complete, self.breaks.complete)
        self.origin, self.centre = local_origin(node.lo, node.hi), far_origin(node.lo, node.hi)
        self.finite = not any(isinstance(b, Const) and math.isinf(b.data) for b in (node.lo, node.hi))
        masses = masses_of(node.body, node.var)
        self.surface = frozenset(_branches(masses.g) or ()) if masses is not None else None
        self.affine: list[tuple[Expr, Expr, Expr]] = []
        self.quadratic: list[tuple[Expr, tuple[Expr, Expr, Expr]]] = []
        self.others: list[Expr] = []

    def run(self) -> _Found:
        """Returns the projection."""
        if any(i.g.free != {self.node.var} for i in self.breaks.isolated):
            self.out.rooted, self.out.complete = True, False  # the births of such roots are not known
        self._put(sub(self.node.hi, self.node.lo))
        for function in self.breaks.functions:
            for f in _branches(function) or ():
                self._sort(f)
        self._affine_meet()
        self._quadratics_meet()
        self._others_meet()
        return self.out

    def _put(self, f: Expr, matters: Cond = TRUE) -> None:
        if isinstance(f, Pow):
            f = f.base
        if len(self.out.functions) >= MAX_FUNCTIONS:
            self.out.complete = False
        elif f.free and not self.analysis.is_zero(f):  # surfaces that coincide meet everywhere
            self.out.functions[f] = disjunction(self.out.functions.get(f, FALSE), matters)

    def _apart(self, *fs: Expr) -> bool:
        """Returns whether none of the functions is the surface of the point masses. Away from that surface nothing is summed."""
        return self.surface is not None and self.surface.isdisjoint(fs)

    def _sort(self, f: Expr) -> None:
        """Files a break function by its degree, and adds the functions that it contributes alone."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        degree, apart = self.analysis.degrees.of(f, z), self._apart(f)
        if not apart:
            for bound in (lo, hi):
                if not (isinstance(bound, Const) and math.isinf(bound.data)):
                    self._put(cast(Expr, substitute(f, {z: bound})))
        if degree != 0 and (apart or not self.finite):
            self._level(f)
        if degree == 1:
            at_origin, rate = (cast(Expr, substitute(e, {z: self.origin})) for e in (f, slope(f, z)))
            self.affine.append((f, rate, at_origin))
            if not apart:
                if not self.finite:
                    self._put(rate)
                if rate.free:
                    self.out.turns[Turn("pole", rate, _within(sub(self.origin, div(at_origin, rate)), lo, hi))] = None
        elif degree == 2:
            a, b, c = quadratic_coefficients(f, z, self.centre)
            self.quadratic.append((f, (a, b, c)))
            if not apart:
                if not self.finite:
                    self._put(a)
                self._put(discriminant(a, b, c), _near(add(self.centre, div(b, mul(const(-2.0), a))), lo, hi))
                self.out.turns[Turn("root", discriminant(a, b, c), self.analysis.somewhere(f, z, lo, hi))] = None
        elif degree == 0:
            if apart:
                self._put(f)
        else:
            self.others.append(f)
            if not apart:
                self.out.rooted = True
                for g in _borders_of_existence(self.analysis.solve(f, z, lo, hi), z):
                    self._put(g)

    def _level(self, f: Expr) -> None:
        """Adds where a function vanishes that is the same for all values of the inner variable at some parameters: c·x + d·z with d = 0
        has no root in z, so it meets nothing there."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        try:
            rate = slope(f, z)
        except NotDifferentiableError:
            return
        if not _may_vanish(rate):
            return
        others = (sub(hi, self.origin), mul(const(0.5), sub(hi, lo))) if self.finite else (ONE, const(0.5))
        rates = [cast(Expr, substitute(rate, {z: add(self.origin, step)})) for step in (ZERO, *others)]
        total = add(*(integer_power(r, 2) for r in rates))
        self._put(cast(Expr, substitute(f, {z: self.origin})), negation(positive(sub(total, const(LEVEL)))))

    def _affine_meet(self) -> None:
        """Adds where roots of affine functions meet each other, and those of quadratic ones."""
        lo, hi = self.node.lo, self.node.hi
        for i, (f, rate1, at1) in enumerate(self.affine):
            crossing = sub(self.origin, div(at1, rate1))
            for g, rate2, at2 in self.affine[:i]:
                if not self._apart(f, g):
                    self._put(sub(mul(rate2, at1), mul(rate1, at2)), _near(crossing, lo, hi))
            for g, _ in self.quadratic:
                if not self._apart(f, g):
                    self._put(cast(Expr, substitute(g, {self.node.var: crossing})), _near(crossing, lo, hi))

    def _quadratics_meet(self) -> None:
        """Adds where roots of quadratic functions meet each other."""
        nearby = {f: self.analysis.nearby(f, self.node.var, self.node.lo, self.node.hi) for f, _ in self.quadratic}
        for i, (f, first) in enumerate(self.quadratic):
            for g, second in self.quadratic[:i]:
                if not self._apart(f, g):
                    self._put(_resultant(first, second), conjunction(nearby[f], nearby[g]))

    def _others_meet(self) -> None:
        """Adds where roots of functions of higher degree meet any others: by formula, or by a search at run time."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        curved = [*self.others, *(f for f, *_ in self.quadratic)]
        for i, f in enumerate(self.others):
            formula = self.analysis.solve(f, z, lo, hi)
            if formula is None or not formula.certain:
                self._search(f, curved[i + 1 :])
                continue
            for root in formula.found:
                for g in (*curved[i + 1 :], *(f for f, *_ in self.affine)):
                    if not (coincide(f, g) or self._apart(f, g)):
                        self._put(cast(Expr, substitute(g, {z: root.point})))

    def _search(self, f: Expr, curved: Sequence[Expr]) -> None:
        """Adds the searches for births of roots of f, which has no formula, and for its crossings with other functions."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        if not self._apart(f):
            self.out.complete = False
        turning = () if self._apart(f) else _turning(f, z)
        for g in (*turning, *(h for h in curved if not (coincide(f, h) or self._apart(f, h)))):
            if (f.free | g.free) - {z}:
                self.out.meetings[f, g, z, lo, hi] = None
                self.out.complete = False
        for other, rate, at_origin in self.affine:
            if not (coincide(other, f) or self._apart(other, f)):
                self._put(cast(Expr, substitute(f, {z: sub(self.origin, at_origin / rate)})))


def _antiderivative_at(shadow: Shadow, inner: Poly, end: Ratio) -> Ratio | None:
    """∫ inner dz at z = end: monomials c·zⁱ·rest become c/(i+1)·endⁱ⁺¹·rest."""
    one = shadow.constant(1)
    powers: list[Ratio] = [one]
    total: Ratio | None = shadow.constant(0)
    for i in range(max((m[0] for m in inner), default=0) + 1):
        step = shadow._product(powers[-1], end)
        if step is None:
            return None
        powers.append(step)
        coefficient: Poly = {m[1:]: divided(c, i + 1) for m, c in inner.items() if m[0] == i}
        if coefficient:
            total = shadow._sum([total, shadow._product((coefficient, one[1]), step)])
            if total is None:
                return None
    return total


def _may_vanish(rate: Expr) -> bool:
    """Returns whether a derivative may be 0 everywhere for some values of parameters: all of its coefficients change with these."""
    if not rate.free:
        return not isinstance(rate, Const)
    one, other = (Shadow(tuple(sorted(rate.free, key=lambda v: v.name)), salt=salt).polynomial(rate) for salt in ("one", "other"))
    if one is None or other is None:
        return any(not factor.free and not isinstance(factor, Const) for factor in (rate.children if isinstance(rate, Mul) else ()))
    return all(one[m] != c for m, c in other.items() if m in one)


def _within(point: Expr, lo: Expr, hi: Expr) -> Cond:
    """Returns the condition that a point lies strictly between two bounds, in either order."""
    return positive(mul(sub(point, lo), sub(hi, point)))


def _near(point: Expr, lo: Expr, hi: Expr) -> Cond:
    """Returns the condition that a point lies between two bounds, or a little outside."""
    margin = mul(const(MARGIN), sub(hi, lo))
    return positive(mul(add(sub(point, lo), margin), add(sub(hi, point), margin)))


def _kept(root: Expr, matters: Cond, x: Var) -> Expr:
    """Returns the root where it matters, NaN elsewhere."""
    if matters is TRUE:
        return root
    return where(cast(Cond, substitute(matters, {x: root})), root, const(math.nan))


_PARTIAL = frozenset(("sqrt", "log", "pow"))


def _is_sum_of_squares(node: Call) -> bool:
    """Returns whether the argument of a function is a sum of even powers with non-negative coefficients."""
    terms = node.children[0].children if isinstance(node.children[0], Add) else node.children[:1]
    for term in terms:
        for factor in term.children if isinstance(term, Mul) else (term,):
            even = isinstance(factor, Pow) and factor.exponent % 2 == 0
            if not even and not (isinstance(factor, Const) and factor.data >= 0):
                return False
    return True


def _with_the_same_zeros(f: Expr) -> Expr:
    """Returns a function with the same zeros, without enclosing powers and |·|."""
    while isinstance(f, Pow) or (isinstance(f, Call) and f.name == "magnitude"):
        f = f.base if isinstance(f, Pow) else f.children[0]
    return f


def _factors(e: Expr, x: Var) -> list[Expr]:
    """Returns the factors of a product that depend on x, each of which keeps its own zeros: multiplied out they would be rounded."""
    if isinstance(e, Mul):
        return [c.base if isinstance(c, Pow) and c.exponent > 0 else c for c in e.children if x in c.free]
    return [e]


def _turning(f: Expr, z: Var) -> list[Expr]:
    """Returns the slope of f, which is 0 where two of its roots meet; an empty list if f has steps."""
    try:
        return [slope(f, z)]
    except NotDifferentiableError:
        return []


def _resultant(first: tuple[Expr, Expr, Expr], second: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns an expression that is 0 where two quadratics have a common root.

    (A₁C₂ - A₂C₁)² - (A₁B₂ - A₂B₁)·(B₁C₂ - B₂C₁); if both are linear, the last factor.
    """
    (a1, b1, c1), (a2, b2, c2) = first, second
    linear = sub(mul(b1, c2), mul(b2, c1))
    result = sub(integer_power(sub(mul(a1, c2), mul(a2, c1)), 2), mul(sub(mul(a1, b2), mul(a2, b1)), linear))
    if a1.free or a2.free or isinstance(a1, Const) or isinstance(a2, Const):
        return result
    return where(positive(add(call("magnitude", a1), call("magnitude", a2))), result, linear)


def _borders_of_existence(roots: Roots | None, z: Var) -> list[Expr]:
    """Returns the functions whose zeros are where roots with a formula appear and vanish."""
    if roots is None:
        return []
    return [a.g for r in roots.found for a in atoms_of(r.exists) if z not in a.g.free]


def _outside(r: Expr, lo: Expr, hi: Expr) -> bool:
    """Returns whether a root is known by its number to lie outside of (lo, hi), or on its border."""
    if not (isinstance(r, Const) and isinstance(lo, Const) and isinstance(hi, Const)):
        return False
    return not min(lo.data, hi.data) < r.data < max(lo.data, hi.data)


def _branches(f: Expr) -> list[Expr] | None:
    """Returns f with every `where` on variables replaced by either branch; None if there are too many combinations."""
    result = [f]
    done: list[Expr] = []
    while result:
        e = result.pop()
        outer = _variable_where(e)
        if outer is None:
            done.append(e)
        elif len(result) + len(done) >= MAX_BRANCHES:
            return None
        else:
            for branch in (outer.then, outer.otherwise):
                result.append(cast(Expr, replace_node(e, outer, branch)))
    return done


def _variable_where(e: Expr) -> Where | None:
    stack: list[Expr] = [e]
    seen: set[Expr] = set()
    while stack:
        node = stack.pop()
        if node in seen or not node.free:
            continue
        seen.add(node)
        if isinstance(node, Where) and node.condition.free:
            return node
        if isinstance(node, Where):
            stack += [node.then, node.otherwise]
        elif isinstance(node, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", node.children))
    return None
