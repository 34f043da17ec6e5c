"""A nest of integrals in other coordinates: the image of its bounds under a map.

Exact images. If an old variable is a function of one new variable and of variables outside of it (translations, scalings, shears, every
map of one variable), its bounds are carried over by the inverse:  ∫ₗʰ dx = ∫ du from u(l) to u(h), or back where u decreases.

Enclosures. Elsewhere the image of a box is not a box. The new variables run over a box that contains it: the given bounds, the domain
where it is finite, else interval bounds of the inverse. The old bounds become brackets, [l < x(u) < h], ordinary surfaces that move and
have flux. Interval bounds that depend on parameters are rounded outwards to steps of the size of the box: they are constant almost
everywhere and the integrand vanishes near them, so they contribute nothing to derivatives and never touch the brackets.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.evaluate import folded, values_of
from teg.analysis.intervals import Interval, enclose
from teg.analysis.nest import Binder, Chain
from teg.analysis.roots import tidy
from teg.errors import BoundError, NotDifferentiableError, ScopeError
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Add, Call, Const, Expr, Mul, Pow, Var, Where, const
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, div, mul, sub
from teg.ir.traverse import parameters, rewrite, substitute
from teg.maps.diffeomorphism import INFINITY, MINUS_INFINITY, Diffeomorphism
from teg.maps.identities import simplified
from teg.maps.verification import TRIALS, Constraint

_MARGIN = 2.0**-4
"""The widening of enclosures, relative to their size."""
_NOTHING = 1e-280
"""Keeps the step of an empty box from being 0."""


@dataclass(frozen=True)
class Side:
    """An old integral sign whose bounds have become a bracket: [lo < point < hi]. A bound outside the range of the map is None."""

    binder: Binder
    point: Expr
    lo: Expr | None
    hi: Expr | None


@dataclass(frozen=True)
class Image:
    """A nest in new variables: ∫ over `chain` of F(at)·weight·[sides]·[constraints] is ∫ over the old nest of F."""

    chain: Chain
    at: dict[Var, Expr]
    weight: Expr
    sides: tuple[Side, ...]
    constraints: tuple[Constraint, ...]
    known: dict[Node, Expr]
    """inverse∘forward as an expression, and the new variable that it equals"""


def image_of(chain: Chain, m: Diffeomorphism, exact: bool = False) -> Image:
    """Returns the image of a nest, outermost first, that binds all old variables of the map and none of the new ones.

    `exact` says that the given bounds of the map are the image itself. Raises BoundError if finite bounds cannot be derived.
    """
    if sum(b.var in m.forward for b in chain) != len(m.old):
        raise ScopeError("a map needs integrals over all of its old variables", m, "nest them directly inside each other")
    return _Image(chain, m, exact).run()


class _Image:
    """One nest while it is mapped: the new integral signs, outermost first, and the old ones that remain."""

    def __init__(self, chain: Chain, m: Diffeomorphism, exact: bool) -> None:
        self.m, self.whole, self.exact = m, chain, exact
        self.left = [b for b in chain if b.var in m.forward]
        self.inner = _depending([b for b in chain if b.var not in m.forward], m.old)
        self.done: dict[Var, Expr] = {}
        self.placed: list[Binder] = []
        self.boxed: set[Var] = set()
        self.sides: list[Binder] = []
        self.signs: list[Expr] = []  # signs of the slopes of the bounds carried over
        self.rates: list[Expr] = []  # these slopes, relative to the order of the new bounds

    def run(self) -> Image:
        while self.left:
            if not any(self._carried(b) for b in self.left):
                self._enclosed()
        m, at = self.m, dict(self.m.forward)
        outer = [b for b in self.whole if b.var not in m.forward and b not in self.inner]
        inner = [Binder(b.var, _at(b.lo, at), _at(b.hi, at)) for b in self.inner]
        known = {_at(m.inverse[u], at): cast(Expr, u) for u in m.new}
        return Image(
            chain=(*outer, *self.placed, *inner),
            at=at,
            weight=mul(*self.signs, m.weight()) if self.boxed else mul(*self.rates),
            sides=tuple(self._side(b) for b in self.sides),
            constraints=() if self.exact else tuple(c for c in m.within if c.value.free & self.boxed),
            known={e: u for e, u in known.items() if not isinstance(e, Var)},
        )

    def _side(self, b: Binder) -> Side:
        least, most = self.m.image[b.var]
        lo, hi = (_at(e, dict(self.m.forward)) for e in (b.lo, b.hi))
        below = isinstance(lo, Const) and isinstance(least, Const) and lo.data <= least.data
        above = isinstance(hi, Const) and isinstance(most, Const) and hi.data >= most.data
        return Side(b, self.m.forward[b.var], None if below else lo, None if above else hi)

    def _waiting(self, b: Binder) -> set[Var]:
        """Returns the new variables that an old variable depends on and that have no integral yet."""
        return set(self.m.forward[b.var].free) - {f.var for f in self.placed}

    def _carried(self, b: Binder) -> bool:
        """Carries the bounds of one old variable over, if they determine the bounds of one new variable. Returns whether it did."""
        m, waiting = self.m, self._waiting(b)
        not_yet = {c.var for c in (*self.left, *self.inner)}
        if len(waiting) != 1 or (b.lo.free | b.hi.free) & not_yet:
            return False
        (u,) = waiting
        rate = simplified(slope(m.forward[b.var], u), m.domain)
        sign = m.sign_of(rate)
        if u in m.bounds or sign is None or not m.inverse[u].free <= self.done.keys() | {b.var}:
            return False
        ends = [_at(m.inverse[u], {**self.done, b.var: _at(e, self.done)}) for e in (b.lo, b.hi)]
        for end, bound in zip(ends, (b.lo, b.hi), strict=True):
            if not _may_be_finite(folded(end)):
                raise BoundError(
                    f"the map sends the bound {b.var.name} = {bound} to {u.name} = {end}, which is not finite",
                    m,
                    f"cut the tail off: bounds={{{u.name}: (lower, upper)}}",
                )
        if sign is MINUS_ONE:
            ends.reverse()
            rate = mul(MINUS_ONE, rate)
        elif sign is not ONE:
            self.signs.append(sign)
        self.rates.append(rate)
        self.placed.append(Binder(u, *ends))
        self._finish([b])
        return True

    def _enclosed(self) -> None:
        """Replaces the smallest outer part of the nest that depends on equally many new variables; these run over a box."""
        block: list[Binder] = []
        waiting: set[Var] = set()
        for b in self.left:
            block.append(b)
            waiting |= self._waiting(b)
            if len(waiting) == len(block):
                break
        ranges = _ranges(self.whole)
        for u in reversed(self.m.new):  # the first one is innermost
            if u in waiting:
                self.placed.append(Binder(u, *_enclosure(self.m, u, ranges)))
        self.boxed |= waiting
        if not self.exact:
            self.sides += block
        self._finish(block)

    def _finish(self, binders: Sequence[Binder]) -> None:
        for b in binders:
            self.left.remove(b)
            self.done[b.var] = self.m.forward[b.var]


def _at(e: Expr, at: dict[Var, Expr]) -> Expr:
    return cast(Expr, substitute(e, at))


def _depending(binders: Sequence[Binder], variables: Sequence[Var]) -> list[Binder]:
    """Returns the integral signs whose bounds depend on these variables, or on one another."""
    moved = set(variables)
    depending = []
    for b in binders:
        if (b.lo.free | b.hi.free) & moved:
            moved.add(b.var)
            depending.append(b)
    return depending


def _may_be_finite(e: Expr) -> bool:
    return not isinstance(e, Const) or math.isfinite(e.data)


def _is_finite_somewhere(e: Expr, m: Diffeomorphism) -> bool:
    """Returns whether a bound with an infinite branch is finite at the sample values of its parameters."""
    infinite = any(isinstance(n, Const) and math.isinf(n.data) for n in postorder([e]))
    if not infinite or e.free or e.has_integral:
        return True
    return any(math.isfinite(float(values_of([e], m.sample_values(parameters(e), trial))[0])) for trial in range(TRIALS))


# -- enclosures ----------------------------------------------------------------------------------------------------------


def _ranges(chain: Chain) -> dict[Var, Interval]:
    """Returns, for each variable of a nest, outermost first, bounds that are free of the others."""
    box: dict[Var, Interval] = {}
    for b in chain:
        lo, hi = enclose(b.lo, box), enclose(b.hi, box)
        box[b.var] = _extremum("min", lo[0], hi[0]), _extremum("max", lo[1], hi[1])
    return box


def _extremum(name: str, a: Expr, b: Expr) -> Expr:
    return a if a is b else call(name, a, b)


def _enclosure(m: Diffeomorphism, u: Var, ranges: dict[Var, Interval]) -> Interval:
    """Returns finite bounds of a new variable."""
    if u in m.bounds:
        return m.bounds[u]
    derived = _derived(m, u, ranges)
    ends = list(m.domain[u])
    if all(isinstance(e, Const) and math.isfinite(e.data) for e in derived):
        least, most = (cast(Const, e).data for e in derived)
        margin = _MARGIN * (most - least)
        for i, value, tighter in ((0, least - margin, max), (1, most + margin, min)):
            end = ends[i]
            if isinstance(end, Const):
                ends[i] = const(tighter(end.data, value))
        return ends[0], ends[1]
    unbounded = [not _may_be_finite(e) for e in ends]
    ends = [mine if free else stated for mine, free, stated in zip(derived, unbounded, ends, strict=True)]
    if not all(_may_be_finite(e) and _is_finite_somewhere(e, m) for e in ends):
        endless = not all(_may_be_finite(folded(e)) for ends in ranges.values() for e in ends)
        where = "all places where the integrand is not 0, as an integral reaches to infinity" if endless else "the image"
        raise BoundError(
            f"finite bounds of {u.name} = {m.inverse[u]} cannot be derived from those of the integrals",
            m,
            f"give a box that holds {where}: bounds={{{u.name}: (lower, upper), …}}, or .with_bounds(…) of the map",
        )
    return _rounded(ends[0], ends[1], unbounded) if any(unbounded) else (ends[0], ends[1])


def _derived(m: Diffeomorphism, u: Var, ranges: dict[Var, Interval]) -> Interval:
    try:
        lo, hi = enclose(m.inverse[u], ranges)
    except NotDifferentiableError:
        return MINUS_INFINITY, INFINITY
    return folded(_shorter(lo)), folded(_shorter(hi))


def _shorter(e: Expr) -> Expr:
    """Returns shorter interval bounds: no branch where the value is undefined anyway, no max(0, u) of squares."""

    def visit(old: Node, new: Node) -> Node:
        if isinstance(new, Where) and isinstance(new.otherwise, Const) and math.isnan(new.otherwise.data):
            return new.then
        if isinstance(new, Call) and new.name in ("min", "max") and ZERO in new.children:
            other = new.children[0] if new.children[1] is ZERO else new.children[1]
            if _is_positive(other):
                return other if new.name == "max" else ZERO
        return new

    return cast(Expr, rewrite([e], visit)[e])


def _is_positive(e: Expr) -> bool:
    """Returns whether e >= 0 is evident from its form."""
    if isinstance(e, Const):
        return bool(e.data >= 0.0)
    if isinstance(e, Pow):
        return e.exponent % 2 == 0
    if isinstance(e, Call):
        return e.name in ("sqrt", "root", "magnitude", "exp") or (e.name == "max" and any(_is_positive(c) for c in e.children))
    return isinstance(e, Add | Mul) and all(_is_positive(c) for c in e.children)


def _rounded(lo: Expr, hi: Expr, sides: Sequence[bool]) -> Interval:
    """Returns wider bounds, on the given sides: multiples of a step that is a power of ⁴√e, 1.1 to 1.5 extents."""
    extent = sub(hi, lo)
    if extent.free:  # bounds that vary with outer variables: rounding would make them jump
        margin = mul(const(_MARGIN), extent)
        return (sub(lo, margin) if sides[0] else lo), (add(hi, margin) if sides[1] else hi)
    quarters = mul(const(4.0), call("log", add(tidy(extent), const(_NOTHING))))
    step = call("exp", mul(const(0.25), add(call("floor", add(quarters, const(0.5))), ONE)))
    if lo is ZERO and sides == [False, True]:
        return lo, step
    nearest = call("floor", add(div(mul(const(0.5), tidy(add(lo, hi))), step), const(0.5)))
    return (mul(step, sub(nearest, ONE)) if sides[0] else lo), (mul(step, add(nearest, ONE)) if sides[1] else hi)
