"""Centres of smooth integrands: places around which an integrand on an infinite range has its features, however far away they are.

    exp u, cosh u, f(u) …    u = a·x + b           the root of u, and the width 1/|a|
                             u quadratic in x      its stationary point v, and the width |u″|^-½
    1/u, √u, log u …         u quadratic in x      v, and the distance |u(v)/(½u″)|^½ of the complex roots

Two narrow centres of an inner integral are seen from outside: where they meet, as functions of an outer variable, or where one meets a
finite bound of an infinite inner range, the outer integrand has a centre. So ∫ dy ∫ f(x - t)·g(y - x) dx has the centre y = t. Where a
Gaussian or a pole meets a bound or a surface of its range that moves, the outer integrand rises from nothing to all of it: ∫ dy ∫
e^(-(x/s)²)·[x < y - t] dx has the centre y = t too; a sum over the roots of such a surface has a peak there. On a curved surface the place
is a root that is looked for. An exponential decays from an edge of its range, a bound or a surface: there is a centre
where two edges meet, 0 = y - t in ∫ dy ∫₀ e^(-x/s)·[x < y - t] dx, and where the middle of a step, 1/(1 + e^(-x/s)), meets an edge;
so does e^(-(x² - m)/s), whose middle may lie beyond the edge. Polynomials in front of functions, sines and cosines have no centres. Linear
in the size of the integrand, but for pairs of at most MAX_CENTRES.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.polynomial import Degrees, is_null
from teg.analysis.roots import Root, quadratic_roots
from teg.analysis.surfaces import atoms_of, binders_inside
from teg.analysis.tails import infinite_ends, is_unbounded
from teg.errors import NotDifferentiableError
from teg.ir.expr import MINUS_ONE, ONE, TRUE, ZERO, Call, Compare, Cond, Const, Expr, Pow, Var, const
from teg.ir.function import Apply
from teg.ir.integral import Integral, masses_of, outermost_integrals
from teg.ir.node import Node
from teg.ir.simplify import add, call, div, mul, positive, sub
from teg.ir.traverse import substitute

MAX_CENTRES = 4
"""The largest number of centres of one integral."""
MAX_MET = 512
"""The largest number of places where those of inner integrals meet something."""
MAX_SEARCHED = 8
"""The same where curved surfaces have these places."""
NARROW = 1 / 64
"""The width, as a part of a finite range, from which nodes see a centre anyway."""
SEEN_AT_AN_EDGE = 2.0**-12
"""The same for a decay from a break, towards which intervals are halved."""
STEEP = 16
"""The largest positive power that has no centre by itself: it is a polynomial in front of what decays."""
BELL = 8.5
"""A Gaussian is 0 to rounding beyond this many standard deviations: exp(-8.5²/2) = 2e-16."""
DECAY = 37.0
"""An exponential that falls off is 0 to rounding beyond so many of its lengths: exp(-37) = 9e-17."""
_REACH = {"bell": BELL, "decay": DECAY}
_WAVES = frozenset(("sin", "cos", "floor", "mod"))
_EXPONENTIAL = frozenset(("exp", "expm1", "cosh", "sinh", "tanh", "erf", "erfc"))


@dataclass(frozen=True)
class Centre:
    """A place, the length on which the integrand changes around it, and its kind: "pole" if there are poles at this distance, "bell" of a
    Gaussian, or its integral up to this place, "decay" of an exponential, or its integral, "edge" of its integral over an infinite range,
    else "". A Gaussian is `high` if it is not known to be at most 1: its tail beyond an edge may count."""

    place: Expr
    width: Expr
    kind: str = ""
    high: bool = False

    @property
    def reach(self) -> float:
        """The number of widths beyond which nothing changes to rounding; 0 if it is not known."""
        return _REACH.get(self.kind, 0.0)

    @property
    def part(self) -> float:
        """The part of a finite range from which nodes see it anyway."""
        return SEEN_AT_AN_EDGE if self.kind == "edge" else NARROW


@dataclass(frozen=True)
class Search:
    """A function of an outer variable that is 0 where the middle of a Gaussian meets a curved surface, by how much it changes within the
    Gaussian's width, and the condition that this is narrow."""

    apart: Expr
    width: Expr
    narrow: Cond


class Centres:
    """The centres of the integrals of one program. `key` returns equal keys for functions that are proportional by a number."""

    def __init__(self, degrees: Degrees, key: Callable[[Expr], object]) -> None:
        self.degrees, self.key = degrees, key
        self._of: dict[Integral, tuple[Centre, ...]] = {}
        self._met: dict[Integral, tuple[Centre, ...]] = {}
        self._searched: dict[Integral, tuple[Search, ...]] = {}

    def of(self, node: Integral) -> tuple[Centre, ...]:
        """Returns the centres of an integrand. The recursion is as deep as integrals are nested."""
        if node not in self._of:
            found = {self.key(u): (u, around) for u, around in reversed(list(self._arguments(node)))}
            own = [self._centre(u, node.var, around) for u, around in reversed(list(found.values()))]
            self._of[node] = tuple(dict.fromkeys([*own, *self.met(node)]))[:MAX_CENTRES]
        return self._of[node]

    def met(self, node: Integral) -> tuple[Centre, ...]:
        """Returns the places where centres of infinite integrals inside of an integrand meet."""
        if node not in self._met:
            x, outside = node.var, binders_inside(node.body)
            found: dict[object, Centre] = {}
            for inner in outermost_integrals([node.body], x):
                for apart, width, kind in self._meetings(inner):
                    if (apart.free | width.free) & outside or self.degrees.of(apart, x) not in (1, 2):
                        continue
                    for root in quadratic_roots(apart, x) if self.degrees.of(apart, x) == 2 else (Root(self._root(apart, x)),):
                        at = {x: root.point}
                        rate = call("magnitude", cast(Expr, substitute(slope(apart, x), at)))
                        centre = Centre(root.point, div(cast(Expr, substitute(width, at)), rate), kind)
                        found.setdefault((self.key(apart), root.point), centre)
            self._met[node] = tuple(found.values())[:MAX_MET]
        return self._met[node]

    def searched(self, node: Integral) -> tuple[Search, ...]:
        """Returns the functions whose roots, of a degree above 2, are such places."""
        if node not in self._searched:
            x, outside = node.var, binders_inside(node.body)
            searches: dict[object, Search] = {}
            for inner in outermost_integrals([node.body], x):
                size = call("magnitude", sub(inner.hi, inner.lo))
                for c in (c for c in self.of(inner) if c.kind == "bell" and not _is_wide(c, inner)):
                    narrow = TRUE if is_unbounded(inner) else positive(sub(mul(const(NARROW), size), c.width))
                    for apart, width, _ in _at(c, (), _surfaces(inner), inner):
                        if x in apart.free and not (apart.free | width.free) & outside and self.degrees.of(apart, x) not in (1, 2):
                            searches.setdefault(self.key(apart), Search(apart, width, narrow))
            self._searched[node] = tuple(searches.values())[:MAX_SEARCHED]
        return self._searched[node]

    def _meetings(self, inner: Integral) -> Iterator[tuple[Expr, Expr, str]]:
        """Yields functions that are 0 where a centre of an integral meets something, by how much they change within its width, and the kind
        of the place. On a finite range a centre counts that may be narrow."""
        z = inner.var
        centres = [c for c in self.of(inner) if not _is_wide(c, inner)]
        for first, second in combinations(centres, 2):
            yield sub(first.place, second.place), add(first.width, second.width), ""
        bounds = [b for b, end in zip((inner.lo, inner.hi), infinite_ends(inner), strict=True) if not end]
        surfaces = _surfaces(inner)
        for c in centres:
            narrow = c.kind in ("bell", "pole", "decay")
            if narrow or is_unbounded(inner):
                yield from _at(c, bounds, surfaces if narrow else (), inner)
        edges = [*bounds, *(self._root(g, z) for g in surfaces if self.degrees.of(g, z) == 1)]
        for c in centres:
            for edge in edges if c.kind == "decay" else ():
                yield from _at(Centre(edge, c.width, c.kind), bounds, surfaces, inner)
            for edge in edges if c.high else ():
                length = div(mul(c.width, c.width), call("magnitude", sub(edge, c.place)))
                yield from _at(Centre(edge, length, "decay"), bounds, surfaces, inner)

    def _arguments(self, node: Integral) -> Iterator[tuple[Expr, str]]:
        """Yields the largest linear and quadratic arguments of functions in an integrand, and what stands around each."""
        x, inner = node.var, binders_inside(node.body)
        seen: set[tuple[Node, str]] = set()
        stack: list[tuple[Node, str]] = [(node.body, "")]
        while stack:
            e, around = stack.pop()
            if (e, around) in seen or x not in e.free or isinstance(e, Compare):
                continue
            seen.add((e, around))
            degree = self.degrees.of(e, x) if around and isinstance(e, Expr) else None
            if degree in (1, 2):  # a part of a polynomial is no argument
                if not e.free & inner and (degree == 2 or around != "pole"):
                    yield cast(Expr, e), around
                continue
            stack.extend((c, _around(e, around)) for c in reversed(e.children))

    def _centre(self, u: Expr, x: Var, around: str) -> Centre:
        rate = slope(u, x)
        if self.degrees.of(u, x) == 1:
            kind = "decay" if around == "exponential" else ""
            return Centre(self._root(u, x), div(ONE, call("magnitude", self._at_0(rate, x))), kind)
        curvature = self._at_0(slope(rate, x), x)
        middle = self._root(rate, x)
        if around == "exponential":
            return Centre(middle, div(ONE, call("root", curvature)), "bell", is_high(cast(Expr, substitute(u, {x: middle}))))
        lowest = cast(Expr, substitute(u, {x: middle}))
        return Centre(middle, call("root", div(mul(const(2.0), lowest), curvature)), "pole" if around == "pole" else "")

    def _root(self, u: Expr, x: Var) -> Expr:
        """Returns the root of a linear function."""
        return div(mul(MINUS_ONE, self._at_0(u, x)), self._at_0(slope(u, x), x))

    @staticmethod
    def _at_0(e: Expr, x: Var) -> Expr:
        return cast(Expr, substitute(e, {x: ZERO}))


def _at(centre: Centre, bounds: Sequence[Expr], surfaces: Sequence[Expr], node: Integral) -> Iterator[tuple[Expr, Expr, str]]:
    """Yields functions that are 0 where a centre of an integral meets bounds and surfaces, by how much they change within its width, and
    the kind of the place."""
    kind = {"pole": "", "decay": "edge" if is_unbounded(node) else "decay"}.get(centre.kind, centre.kind)
    for bound in bounds:
        yield sub(centre.place, bound), centre.width, kind
    for g in surfaces:
        with suppress(NotDifferentiableError):
            value, rate = (cast(Expr, substitute(e, {node.var: centre.place})) for e in (g, slope(g, node.var)))
            yield value, mul(centre.width, call("magnitude", rate)), kind


def _surfaces(node: Integral) -> list[Expr]:
    """Returns the functions at whose zeros an integrand jumps or has its mass."""
    masses = masses_of(node.body, node.var)
    return [atom.g for atom in dict.fromkeys(atoms_of(node.body, node.var))] + ([] if masses is None else [masses.g])


def is_high(exponent: Expr) -> bool:
    """Returns whether the exponent in the middle of a Gaussian may be positive."""
    return not (is_null(exponent) or (isinstance(exponent, Const) and exponent.data <= 0.0))


def _is_wide(centre: Centre, node: Integral) -> bool:
    """Returns whether a centre is known to be wider than a part NARROW of a finite range: nodes see it."""
    width, size = centre.width, sub(node.hi, node.lo)
    known = isinstance(width, Const) and isinstance(size, Const) and math.isfinite(size.data)
    return known and width.data >= NARROW * abs(size.data)


def _around(e: Node, around: str) -> str:
    """Returns what stands around the children of a node: "exponential", "pole", "function", or "" for nothing but arithmetic."""
    match e:
        case Call():
            return "" if e.name in _WAVES else "exponential" if e.name in _EXPONENTIAL else "function"
        case Apply():
            return "function"
        case Pow() if e.exponent < 0:
            return "pole"
        case Pow() if around or e.exponent > STEEP:
            return "function"
        case Integral():
            return ""
        case _:
            return "function" if around == "pole" else around
