"""The projection of an inner integral: the functions that it contributes to the breaks of the integral around it.

One step of cylindrical decomposition, for the break functions f, f₁, f₂ of an inner integral ∫ₗʰ dz:

    f|z:=l, f|z:=h                         a root of the inner integral crosses a bound
    a₂·f₁|z:=l - a₁·f₂|z:=l                two roots meet (f = f|z:=l + a·(z - l); a quadratic f₂ is taken at the root of f₁)
    a                                      a root runs away to infinity
    B² - 4AC                               two roots of a quadratic f meet and vanish: √-like from then on
    the border of the condition under which a root of another formula exists, likewise
    h - l                                  the bounds cross

Source: Collins 1975.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from teg.analysis.branches import branches_of
from teg.analysis.break_functions import near, within
from teg.analysis.calculus import slope
from teg.analysis.coincidence import coincide
from teg.analysis.expanded import perfect_power
from teg.analysis.polynomial import Shadow
from teg.analysis.roots import Roots, discriminant, discriminant_of, far_origin, local_origin, tidy
from teg.analysis.surfaces import atoms_of
from teg.errors import NotDifferentiableError
from teg.ir.expr import FALSE, ONE, TRUE, ZERO, Cond, Const, Expr, Mul, Pow, Var, const
from teg.ir.integral import Integral, masses_of
from teg.ir.node import postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import substitute

if TYPE_CHECKING:
    from teg.analysis.breaks import BreakAnalysis

LEVEL = 1e-200
"""A function is the same for all values of a variable if the squares of its derivatives at three of them add up to less."""
MAX_FUNCTIONS = 4000


@dataclass(frozen=True)
class Turn:
    """A function whose zeros are branch points ("root"), poles ("pole") or singular ends ("end") of an integrand; of an outer one ends by
    a function with the same zeros ("flat").

    The function counts on a piece if the condition `when` holds in the middle of the piece.
    """

    kind: str
    function: Expr
    when: Cond = TRUE


Meeting = tuple[Expr, Expr, Var, Expr, Expr]
"""Two functions, the inner variable in which they may have a common root, and its range."""


Origin = frozenset[object]
"""The surfaces that meet where a function is 0; empty for a function that is a surface itself. A surface is named by its key."""


@dataclass(frozen=True)
class _Bound:
    """A bound of a variable as a surface."""

    var: Var
    key: object


@dataclass(frozen=True)
class _Fold:
    """Where a surface turns back, as one more surface."""

    key: object


@dataclass
class Contribution:
    """What inner integrals and the integrand contribute to the breaks of an integral."""

    functions: dict[Expr, Cond] = field(default_factory=dict)
    """The condition, in the outer variable, under which the function's zeros matter."""
    origins: dict[Expr, Origin] = field(default_factory=dict)
    """The origin of each function."""
    rooted: bool = False
    complete: bool = True
    meetings: dict[Meeting, None] = field(default_factory=dict)
    turns: dict[Turn, None] = field(default_factory=dict)

    def add(self, f: Expr, matters: Cond = TRUE, origin: Origin = frozenset()) -> None:
        """Adds a function; one that comes from two origins counts as a surface itself."""
        self.functions[f] = disjunction(self.functions.get(f, FALSE), matters)
        if self.origins.setdefault(f, origin) != origin:
            self.origins[f] = frozenset()


class Projection:
    """The functions that an inner integral contributes to the breaks of the outer one, sorted by their degree in the inner variable."""

    def __init__(self, analysis: BreakAnalysis, node: Integral) -> None:
        self.analysis, self.functions, self.node = analysis, analysis.functions, node
        self.breaks = analysis.of(node)
        self.out = Contribution(rooted=self.breaks.rooted and not self.breaks.complete, complete=self.breaks.complete)
        self.origin, self.centre = local_origin(node.lo, node.hi), far_origin(node.lo, node.hi)
        self.finite = not any(isinstance(b, Const) and math.isinf(b.data) for b in (node.lo, node.hi))
        masses = masses_of(node.body, node.var)
        self.surface = frozenset(branches_of(masses.g) or ()) if masses is not None else None
        """The surface of point masses. Conditions say which of its points count, and its range is a little wider than these."""
        self.affine: list[tuple[Expr, Expr, Expr]] = []
        self.quadratic: list[Expr] = []
        self.others: list[Expr] = []
        self.origins: dict[Expr, Origin] = {}
        self.known: set[Origin] = set()

    def run(self) -> Contribution:
        """Returns the projection."""
        if any(i.g.free != {self.node.var} for i in self.breaks.isolated):
            self.out.rooted, self.out.complete = True, False  # the births of such roots are not known
        self._put(sub(self.node.hi, self.node.lo))
        for function in self.breaks.functions:
            branches = branches_of(function) or ()
            origin = self.breaks.origins.get(function, frozenset()) if len(branches) == 1 else frozenset()
            for f in branches:
                self.origins[f] = origin or frozenset((self.functions.key(f),))
                self._sort(f)
        self.known.update(self.origins.values())
        self._turns_at_bounds()
        self._affine_meet()
        self._quadratics_meet()
        self._others_meet()
        return self.out

    def _put(self, f: Expr, matters: Cond = TRUE, origin: Origin = frozenset()) -> None:
        if isinstance(f, Pow):
            f = f.base
        if len(self.out.functions) >= MAX_FUNCTIONS:
            self.out.complete = False
        elif f.free and not self.functions.is_zero(f):  # surfaces that coincide meet everywhere
            self.out.add(f, matters, origin)

    def _meet(self, f: Expr, g: Expr) -> bool:
        """Returns whether the surfaces that meet where f is 0 and those that meet where g is 0 may all meet at one place.

        Together they name one surface more than each function then. If they name more, f and g may have a common root, but at two places
        that differ in variables further in. Two bounds of one variable never meet. If one of the surfaces is a bound, pairs of functions
        on that bound find the place, and others need not.
        """
        if self._apart(f, g):
            return False
        a, b, both = self.origins[f], self.origins[g], self._both(f, g)
        if len(both) > max(len(a), len(b)) + 1:
            return False
        bounds = [k for k in both if isinstance(k, _Bound)]
        if len({k.var for k in bounds}) < len(bounds):
            return False
        return not any(sum(both - {k} in self.known for k in both if k != bound) > 1 for bound in bounds if bound not in a & b)

    def _both(self, f: Expr, g: Expr) -> Origin:
        """Returns the surfaces that meet where two functions are 0 at one place."""
        return self.origins[f] | self.origins[g]

    def _apart(self, *fs: Expr) -> bool:
        """Returns whether none of the functions is the surface of the point masses. Away from that surface nothing is summed."""
        return self.surface is not None and self.surface.isdisjoint(fs)

    def _sort(self, f: Expr) -> None:
        """Files a break function by its degree, and adds the functions that it contributes alone."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        degree, apart = self.functions.degrees.of(f, z), self._apart(f)
        if self.surface is None:
            for bound in (lo, hi):
                if not (isinstance(bound, Const) and math.isinf(bound.data)):
                    at_bound = self.origins[f] | {_Bound(z, self.functions.key(sub(z, bound)))}
                    self._put(cast(Expr, substitute(f, {z: bound})), origin=at_bound)
        if degree != 0 and (apart or not self.finite):
            self._level(f)
        if degree == 1:
            at_origin, rate = (cast(Expr, substitute(e, {z: self.origin})) for e in (f, slope(f, z)))
            self.affine.append((f, rate, at_origin))
            if not apart:
                if not self.finite:
                    self._put(rate)
                if rate.free:
                    self.out.turns[Turn("pole", rate, within(sub(self.origin, div(at_origin, rate)), lo, hi))] = None
        elif degree == 2:
            origin = self.functions.origin(f, z, lo, hi)
            a, b, c = self.functions.coefficients(f, z, origin)
            self.quadratic.append(f)
            if not apart:
                if not self.finite:
                    self._put(a)
                border = discriminant_of(f, z, origin, (a, b, c))
                self.functions.note_derived(border, f)
                fold = self.origins[f] | {_Fold(self.functions.key(f))}
                self._put(border, near(add(origin, div(b, mul(const(-2.0), a))), lo, hi), fold)
                self.out.turns[Turn("root", border, self.functions.somewhere(f, z, lo, hi))] = None
        elif degree == 0:
            if apart:  # z may stand in f, as in x + z² - z²
                self._put(cast(Expr, substitute(f, {z: self.origin})))
        else:
            self.others.append(f)
            if not apart:
                self.out.rooted = True
                roots = self.functions.solve(f, z, lo, hi)
                for g in _borders_of_existence(roots, z):
                    self._put(g)
                for root in roots.found if roots is not None else ():
                    for pole in _denominators(root.point):
                        self.out.turns[Turn("pole", pole, conjunction(root.exists, within(root.point, lo, hi)))] = None
                self._flat_roots(f)

    def _flat_roots(self, f: Expr) -> None:
        """Adds where both roots of c·zⁿ + r, n even, vanish together: they go with the power 1/n of r there."""
        z = self.node.var
        terms = self.analysis.shadow((z,)).polynomial(f) if self.surface is None else None
        exponents = sorted(m[0] for m in terms) if terms is not None else []
        if len(exponents) == 2 and exponents[0] == 0 and exponents[1] % 2 == 0:
            self.out.turns[Turn("flat", cast(Expr, substitute(f, {z: ZERO})))] = None

    def _turns_at_bounds(self) -> None:
        """Adds where the integrand turns into another branch at a bound: a root that leaves the range takes a power 3/2 with it."""
        for turn in self.breaks.bends:
            if turn.kind != "root" or self.surface is not None:
                continue
            for bound in (self.node.lo, self.node.hi):
                if not (isinstance(bound, Const) and math.isinf(bound.data)):
                    at = {self.node.var: bound}
                    self.out.turns[Turn("root", cast(Expr, substitute(turn.function, at)), cast(Cond, substitute(turn.when, at)))] = None

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
                if self._meet(f, g):
                    self._put(self._crossing(rate1, at1, rate2, at2), near(crossing, lo, hi), self._both(f, g))
            for g in self.quadratic:
                if self._meet(f, g):
                    h, *_ = self.functions.turned(g, f) or (g,)
                    self._put(cast(Expr, substitute(h, {self.node.var: crossing})), near(crossing, lo, hi), self._both(f, g))

    def _crossing(self, rate1: Expr, at1: Expr, rate2: Expr, at2: Expr) -> Expr:
        """Returns a function that is 0 where the roots of two affine functions meet: with equal or opposite slopes, where both are one."""
        for result in (sub, add):
            if self.functions.is_zero(result(rate1, rate2)):
                return result(at1, at2)
        return sub(mul(rate2, at1), mul(rate1, at2))

    def _quadratics_meet(self) -> None:
        """Adds where roots of quadratic functions meet each other."""
        nearby = {f: self.functions.nearby(f, self.node.var, self.node.lo, self.node.hi) for f in self.quadratic}
        for i, f in enumerate(self.quadratic):
            for g in self.quadratic[:i]:
                matters = conjunction(nearby[f], nearby[g])
                if not self._meet(f, g) or self._met_at_a_turn(f, g, matters):
                    continue
                first, second = self._coefficients(f, g)
                resultant = _resultant(first, second)
                if self.functions.is_zero(resultant):  # a root that they have in common everywhere: the other ones meet
                    (a1, b1, _), (a2, b2, _) = first, second
                    self._put(sub(mul(a1, b2), mul(a2, b1)), matters, self._both(f, g))
                    continue
                self.functions.note_derived(resultant, f)
                self._put(_unless_linear(resultant, first, second), matters, self._both(f, g))
                for turning, other in ((first, second), (second, first)):
                    self.functions.note_turned(resultant, discriminant(*turning), _at_the_turn(turning, other))

    def _coefficients(self, *pair: Expr) -> tuple[tuple[Expr, Expr, Expr], ...]:
        """Returns the coefficients of two quadratics around the vertex of one of them, if that is known; else around one origin."""
        z = self.node.var
        origin = next((v for f in pair if (v := self.functions.vertex(f, z)) is not None), self.centre)
        return tuple(self.functions.coefficients(f, z, origin) for f in pair)

    def _met_at_a_turn(self, f: Expr, g: Expr, matters: Cond = TRUE) -> bool:
        """Adds where two functions meet that are a resultant and a discriminant; returns whether they are."""
        z, pair = self.node.var, self.functions.turned(f, g)
        if pair is None or any(self.functions.degrees.of(h, z) not in (1, 2) for h in pair):
            return False
        first, second = self._coefficients(*pair)
        self._put(_unless_linear(_resultant(first, second), first, second), matters, self._both(f, g))
        return True

    def _others_meet(self) -> None:
        """Adds where roots of functions of higher degree meet any others: by formula, or by a search at run time."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        curved = [*self.others, *self.quadratic]
        for i, f in enumerate(self.others):
            formula = self.functions.solve(f, z, lo, hi)
            if formula is None or not formula.certain:
                self._search(f, curved[i + 1 :])
                continue
            fixed = self._fixed()
            met = [g for g in (*curved[i + 1 :], *(g for g, *_ in self.affine)) if self._meet(f, g) and not coincide(f, g)]
            for g in met:
                if g in fixed:
                    self._put(cast(Expr, substitute(f, {z: fixed[g]})), near(fixed[g], lo, hi), self._both(f, g))
            for root in formula.found:
                for g in met:
                    if g not in fixed and not self._met_at_a_turn(f, g):
                        self._put(cast(Expr, substitute(g, {z: root.point})), origin=self._both(f, g))

    def _fixed(self) -> dict[Expr, Expr]:
        """Returns the roots of affine functions that stay where they are.

        Where the root of f is there, f is 0 there: so tan(-a/y) need not be looked at, which the root of y·atan(z) + a is."""
        crossings = ((g, sub(self.origin, div(at_origin, rate))) for g, rate, at_origin in self.affine)
        return {g: crossing for g, crossing in crossings if not crossing.free}

    def _search(self, f: Expr, curved: Sequence[Expr]) -> None:
        """Adds the searches for births of roots of f, which has no formula, and for its crossings with other functions."""
        z, lo, hi = self.node.var, self.node.lo, self.node.hi
        if not self._apart(f):
            self.out.complete = False
        turning = () if self._apart(f) else _turning(f, z)
        for g in (*turning, *(h for h in curved if self._meet(f, h) and not (coincide(f, h) or self._met_at_a_turn(f, h)))):
            if (f.free | g.free) - {z}:
                self.out.meetings[f, g, z, lo, hi] = None
                self.out.complete = False
        for other, rate, at_origin in self.affine:
            if self._meet(other, f) and not coincide(other, f):
                self._put(cast(Expr, substitute(f, {z: sub(self.origin, at_origin / rate)})), origin=self._both(other, f))


def _may_vanish(rate: Expr) -> bool:
    """Returns whether a derivative may be 0 everywhere for some values of parameters: all of its coefficients change with these."""
    if not rate.free:
        return not isinstance(rate, Const)
    one, other = (Shadow(tuple(sorted(rate.free, key=lambda v: v.name)), salt=salt).polynomial(rate) for salt in ("one", "other"))
    if one is None or other is None:
        return any(not factor.free and not isinstance(factor, Const) for factor in (rate.children if isinstance(rate, Mul) else ()))
    return all(one[m] != c for m, c in other.items() if m in one)


def _turning(f: Expr, z: Var) -> list[Expr]:
    """Returns the slope of f, which is 0 where two of its roots meet; an empty list if f has steps."""
    try:
        return [slope(f, z)]
    except NotDifferentiableError:
        return []


def _resultant(first: tuple[Expr, Expr, Expr], second: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns an expression that is 0 where two quadratics have a common root: (A₁C₂ - A₂C₁)² - (A₁B₂ - A₂B₁)·(B₁C₂ - B₂C₁).

    Where that is the square of a polynomial, as for curves that meet on a side of the box, it is that polynomial: only half of a double
    root's digits can be found.
    """
    (a1, b1, c1), (a2, b2, c2) = first, second
    linear = sub(mul(b1, c2), mul(b2, c1))
    result = sub(integer_power(tidy(sub(mul(a1, c2), mul(a2, c1))), 2), mul(sub(mul(a1, b2), mul(a2, b1)), linear))
    power = perfect_power(result, exact=False)
    return result if power is None else power[1]


def _unless_linear(resultant: Expr, first: tuple[Expr, Expr, Expr], second: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns the resultant of two quadratics, of which parameters may make linear functions."""
    (a1, b1, c1), (a2, b2, c2) = first, second
    if a1.free or a2.free or isinstance(a1, Const) or isinstance(a2, Const):
        return resultant
    return where(positive(add(call("magnitude", a1), call("magnitude", a2))), resultant, sub(mul(b1, c2), mul(b2, c1)))


def _at_the_turn(first: tuple[Expr, Expr, Expr], second: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns 4A₁² times the second of two quadratics at -B₁/2A₁: where the discriminant of the first one is 0 their resultant is
    its square, over 16A₁²."""
    (a1, b1, _), (a2, b2, c2) = first, second
    return add(mul(a2, integer_power(b1, 2)), mul(const(-2.0), a1, b1, b2), mul(const(4.0), integer_power(a1, 2), c2))


def _denominators(point: Expr) -> list[Expr]:
    """Returns the functions of outer variables by which a root is divided."""
    return [n.base for n in postorder([point]) if isinstance(n, Pow) and n.exponent < 0 and n.base.free]


def _borders_of_existence(roots: Roots | None, z: Var) -> list[Expr]:
    """Returns the functions whose zeros are where roots with a formula appear and vanish."""
    if roots is None:
        return []
    return [a.g for r in roots.found for a in atoms_of(r.exists) if z not in a.g.free]
