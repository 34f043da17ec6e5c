"""Roots without a formula: what the program needs to isolate them at run time, and how many there can be.

A surface g is isolated in x by interval bisection and Newton's method (`teg.program`, Isolate). For that its slope and the enclosures of
both over a box are needed, and a bound on the number of roots, for which places are reserved:

    polynomial in x of degree n                              n
    Σᵢ Pᵢ(x)·exp(aᵢx + bᵢ), Pᵢ of degree nᵢ                  Σ(nᵢ + 1) - 1             (Pólya and Szegő, part V, problem 75)
    kinked: |·| of m functions, otherwise one of the above   (3m + 1) times that: at a kink near 0 a root may be found thrice
    anything else                                            `max_roots` of the compilation: more of them make the result NaN
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

from teg.calculus import slope
from teg.errors import NotDifferentiableError
from teg.expr import Add, Call, Const, Expr, Mul, Pow, Var, Where, add, const, mul, sub
from teg.intervals import Enclosure
from teg.node import postorder
from teg.polynomial import Shadow
from teg.traverse import fresh, replace_node

MAX_ROOTS = 16
MARGIN = 1e-9
BEFORE, BEHIND = 0.0137, 0.0291
"""By how much of its length a range is wider in which places are located."""
_ANY_SLOPE = (const(-math.inf), const(math.inf))
_LARGEST = 20_000
"""Nodes of a surface and its enclosures together: beyond that a box costs more than adaptive integration."""


@dataclass(frozen=True)
class Isolation:
    """g and its slope in `var`; bounds of both for left <= var <= right; how many roots there can be."""

    g: Expr
    var: Var
    slope: Expr
    left: Var
    right: Var
    bounds: tuple[Expr, Expr, Expr, Expr]
    count: int


def isolate(g: Expr, x: Var, limit: int = MAX_ROOTS) -> Isolation | None:
    """What it takes to isolate the roots of g in x; None where that is not possible: an integral over x in g, a step of floor or mod."""
    if x not in g.free or any(isinstance(n, Call) and n.name in ("floor", "mod") and x in n.free for n in postorder([g])):
        return None
    left, right = fresh(x.name + "₋", g.free), fresh(x.name + "₊", g.free)
    try:
        rate = slope(g, x)
        boxed = Enclosure({x: (left, right)})
        bounds = (*boxed.of(g), *boxed.of(rate))
    except NotDifferentiableError:
        return None
    if len(postorder(bounds)) > _LARGEST:
        return None
    return Isolation(g, x, rate, left, right, bounds, max_roots(g, x, limit))


@dataclass(frozen=True)
class Location:
    """f = g = 0 in a rectangle of outer and inner, which runs from low to high: bounds of both over left..right × bottom..top, and of their
    slopes by outer and by inner."""

    f: Expr
    g: Expr
    inner: Var
    low: Expr
    high: Expr
    outer: Var
    corners: tuple[Var, Var, Var, Var]
    bounds: tuple[Expr, ...]


def locate(f: Expr, g: Expr, inner: Var, low: Expr, high: Expr, outer: Var) -> Location | None:
    """What it takes to find where two surfaces meet, as seen from the outer variable; None where that is not possible. Where f and g are 0, so
    are f ± g: the two shortest of the four are looked at, which tells surfaces apart that only approach each other."""
    sums = [e for e in (_combined(f, g, 1.0), _combined(f, g, -1.0)) if e is not None]
    f, g = sorted((f, g, *sums), key=lambda e: len(postorder([e])))[:2] if sums else (f, g)
    if any(isinstance(n, Call) and n.name in ("floor", "mod") and n.free for n in postorder([f, g])):
        return None
    corners = tuple(fresh(v.name + mark, f.free | g.free) for v in (outer, inner) for mark in "₋₊")
    boxed = Enclosure({outer: (corners[0], corners[1]), inner: (corners[2], corners[3])})
    try:
        bounds: tuple[Expr, ...] = (*boxed.of(f), *boxed.of(g))
    except NotDifferentiableError:
        return None
    if len(postorder(bounds)) > _LARGEST:
        return None
    slopes = tuple(b for e in (f, g) for v in (outer, inner) for b in _bounds_of_slope(e, v, boxed))
    if len(postorder((*bounds, *slopes))) > _LARGEST:
        slopes = _ANY_SLOPE * 4
    return Location(f, g, inner, low, high, outer, cast("tuple[Var, Var, Var, Var]", corners), (*bounds, *slopes))


def _combined(f: Expr, g: Expr, sign: float) -> Expr | None:
    """f ± g with like terms collected; None if there are none, or if nothing is left."""
    terms: dict[Expr, float] = {}
    stack: list[tuple[Expr, float]] = [(g, sign), (f, 1.0)]
    count = 0
    while stack:
        e, factor = stack.pop()
        if isinstance(e, Add):
            stack.extend((c, factor) for c in reversed(e.children))
        elif isinstance(e, Mul) and len(e.children) == 2 and isinstance(e.children[0], Const):
            stack.append((e.children[1], factor * e.children[0].data))
        else:
            count += 1
            terms[e] = terms.get(e, 0.0) + factor
    kept = [mul(const(c), e) for e, c in terms.items() if c != 0.0]
    return add(*kept) if kept and len(kept) < count else None


def _bounds_of_slope(e: Expr, x: Var, boxed: Enclosure) -> tuple[Expr, Expr]:
    """Bounds of ∂e/∂x that the mean value theorem may use: infinite ones where e jumps, or has no slope."""
    if any(isinstance(n, Where) or (isinstance(n, Call) and n.name == "atan2") for n in postorder([e]) if n.free & boxed.box.keys()):
        return _ANY_SLOPE
    try:
        return boxed.of(slope(e, x))
    except NotDifferentiableError:
        return _ANY_SLOPE


def widened(lo: Expr, hi: Expr) -> tuple[Expr, Expr]:
    """The range in which roots are looked for: a little beyond the bounds, so that those on a bound are found (and are ties)."""
    if any(isinstance(b, Const) and math.isinf(b.data) for b in (lo, hi)):
        return lo, hi
    margin = mul(const(MARGIN), sub(hi, lo))
    return sub(lo, margin), add(hi, margin)


def off_the_grid(lo: Expr, hi: Expr) -> tuple[Expr, Expr]:
    """A wider range, whose ends, halves and quarters are not where surfaces meet by symmetry: a zero is found the sooner the farther it is
    from the border of a rectangle."""
    extent = sub(hi, lo)
    return sub(lo, mul(const(BEFORE), extent)), add(hi, mul(const(BEHIND), extent))


def max_roots(g: Expr, x: Var, limit: int = MAX_ROOTS) -> int:
    """No more than so many roots in x, as long as they are simple; `limit` where no theorem helps."""
    if isinstance(g, Where) and not g.condition.free:
        return max(max_roots(g.then, x, limit), max_roots(g.otherwise, x, limit))
    kinks = 0
    for node in postorder([g]):
        if x in node.free and (isinstance(node, Where) or (isinstance(node, Call) and node.name == "magnitude")):
            kinks += 1
    smooth = _of_smooth(g, x)
    return limit if smooth is None else min((3 * kinks + 1) * smooth, limit)


def _of_smooth(g: Expr, x: Var) -> int | None:
    exponentials = [n for n in _outermost(g, x) if isinstance(n, Call) and n.name == "exp" and Shadow((x,)).degree(n.children[0]) == 1]
    weights: list[Var] = []
    e = g
    for node in exponentials:
        w = fresh(f"exp{len(weights)}", g.free)
        e = cast(Expr, replace_node(e, node, w))
        weights.append(w)
    poly = Shadow((x, *weights), kinks=True).polynomial(e)
    if poly is None:
        return None
    degrees: dict[tuple[int, ...], int] = {}
    for monomial in poly:
        degrees[monomial[1:]] = max(degrees.get(monomial[1:], 0), monomial[0])
    return max(1, sum(d + 1 for d in degrees.values()) - 1)


def _outermost(g: Expr, x: Var) -> list[Expr]:
    """The functions x runs through that stand in no other one."""
    found: dict[Expr, None] = {}
    stack: list[Expr] = [g]
    seen: set[Expr] = set()
    while stack:
        e = stack.pop()
        if e in seen or x not in e.free:
            continue
        seen.add(e)
        if isinstance(e, Call) and e.name != "magnitude":
            found[e] = None
        elif isinstance(e, Where):
            stack += [e.then, e.otherwise]
        elif isinstance(e, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", e.children))
    return list(found)
