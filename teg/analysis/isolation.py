"""Roots without a formula: what the program needs to isolate them at run time, and how many there can be.

A surface g is isolated in x by interval bisection and Newton's method (`teg.program`, Isolate). For that its slope and the enclosures of
both over a box are needed, and a bound on the number of roots, for which places are reserved:

    polynomial in x of degree n                              n
    Σᵢ Pᵢ(x)·exp(aᵢx + bᵢ), Pᵢ of degree nᵢ                  Σ(nᵢ + 1) - 1             (Pólya and Szegő, part V, problem 75)
    kinked: |·| of m functions, otherwise one of the above   (3m + 1) times that: at a kink near 0 a root may be found thrice
    anything else                                            `max_roots` of the compilation: with more of them it is made again
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.intervals import Enclosure
from teg.analysis.polynomial import Shadow
from teg.errors import NotDifferentiableError
from teg.ir.expr import ONE, ZERO, Add, Call, Const, Expr, Mul, Pow, Var, Where, add, call, const, mul, sub
from teg.ir.node import Node, postorder
from teg.ir.traverse import fresh, replace_node

MAX_ROOTS = 16
MAX_PLACES = 64
"""Roots for which places are reserved where a theorem bounds their number."""
MARGIN = 1e-9
BEFORE, BEHIND = 0.0137, 0.0291
"""By how much of its length a range is wider in which places are located."""
_ANY_SLOPE = (const(-math.inf), const(math.inf))
OFTEN = 3
"""A polynomial in which the variable stands so often is enclosed by its Taylor coefficients: interval arithmetic takes them for different
variables."""
_LARGEST = 20_000
"""Nodes of a surface and its enclosures together: beyond that a box costs more than adaptive integration."""


_SMOOTH = frozenset(["sin", "cos", "tan", "exp", "log", "sqrt", "asin", "acos", "atan", "sinh", "cosh", "tanh", "pow", "atan2"])
"""Functions without kinks: between the ends of a box on which their curvature is bounded it is what their slope changes by."""
_NO_NUMBER = const(math.nan)
_ANYTHING: tuple[Expr, Expr] = (const(-math.inf), const(math.inf))


@dataclass(frozen=True)
class Isolation:
    """g, its slope and its curvature in `var`; bounds of g and the slope, and of the curvature, for left <= var <= right; how many roots
    there can be. Where the curvature is not known it is NaN, between infinite bounds."""

    g: Expr
    var: Var
    slope: Expr
    left: Var
    right: Var
    bounds: tuple[Expr, Expr, Expr, Expr]
    count: int
    curvature: Expr = _NO_NUMBER
    curving: tuple[Expr, Expr] = _ANYTHING


def isolate(g: Expr, x: Var, limit: int = MAX_ROOTS) -> Isolation | None:
    """What it takes to isolate the roots of g in x; None where that is not possible: an integral over x in g, a step of floor or mod."""
    if x not in g.free or any(isinstance(n, Call) and n.name in ("floor", "mod") and x in n.free for n in postorder([g])):
        return None
    left, right = fresh(x.name + "₋", g.free), fresh(x.name + "₊", g.free)
    try:
        rate = slope(g, x)
        taylor = _taylor(g, x, mul(const(0.5), add(left, right))) if _occurrences(g, x) >= OFTEN else None
        if taylor is not None:
            bounds, curving = _around(taylor, mul(const(0.5), sub(right, left)))
            if len(postorder(bounds)) <= _LARGEST:
                return Isolation(g, x, rate, left, right, bounds, max_roots(g, x, limit), slope(rate, x), curving)
        boxed = Enclosure({x: (left, right)})
        bounds = (*boxed.of(g), *boxed.of(rate))
    except NotDifferentiableError:
        return None
    if len(postorder(bounds)) > _LARGEST:
        return None
    return Isolation(g, x, rate, left, right, bounds, max_roots(g, x, limit), *_curvature(g, rate, x, boxed))


def _occurrences(g: Expr, x: Var) -> int:
    """How often a variable stands in an expression that is written out."""
    times: dict[Node, int] = {}
    for node in postorder([g]):
        times[node] = 1 if node is x else min(sum(times[c] for c in node.children), _LARGEST)
    return times[g]


def _taylor(g: Expr, x: Var, middle: Expr) -> list[Expr] | None:
    """The coefficients of a polynomial g in powers of x - middle; None if g is written with anything but sums, products and powers of x, or
    its degree is above MAX_PLACES. A bound of such a sum is off by as much as its highest terms, whatever g is written like."""
    series: dict[Node, list[Expr]] = {}
    for node in postorder([g]):
        if x not in node.free:
            continue
        parts = [series[c] if c in series else [cast(Expr, c)] for c in node.children]
        match node:
            case Var():
                found = [middle, ONE]
            case Add():
                found = [add(*(p[k] for p in parts if k < len(p))) for k in range(max(map(len, parts)))]
            case Mul():
                found = parts[0]
                for p in parts[1:]:
                    found = _convolved(found, p)
            case Pow() if 0 < node.exponent <= MAX_PLACES:
                found = parts[0]
                for bit in f"{node.exponent:b}"[1:]:
                    found = _convolved(found, found)
                    found = _convolved(found, parts[0]) if bit == "1" else found
            case _:
                return None
        if len(found) > MAX_PLACES + 1:
            return None
        series[node] = found
    return series[g]


def _convolved(first: list[Expr], second: list[Expr]) -> list[Expr]:
    """The coefficients of a product."""
    terms: list[list[Expr]] = [[] for _ in range(len(first) + len(second) - 1)]
    for i, u in enumerate(first):
        for j, v in enumerate(second):
            terms[i + j].append(mul(u, v))
    return [add(*t) for t in terms]


def _around(taylor: list[Expr], half: Expr) -> tuple[tuple[Expr, Expr, Expr, Expr], tuple[Expr, Expr]]:
    """Bounds of Σ cₖwᵏ, of its slope and of its curvature for |w| <= half: the curvature's by all coefficients, the others by Taylor's
    theorem with the curvature's."""
    value, rate, *rest = [*taylor, ZERO]
    bends = [mul(const(float((k + 1) * (k + 2))), c) for k, c in enumerate(rest)] or [ZERO]
    reach: Expr = ZERO
    for c in reversed(bends[1:]):
        reach = mul(half, add(call("magnitude", c), reach))
    change = mul(half, add(call("magnitude", bends[0]), reach))  # of the slope
    move = mul(half, add(call("magnitude", rate), mul(const(0.5), change)))
    curving = sub(bends[0], reach), add(bends[0], reach)
    return (sub(value, move), add(value, move), sub(rate, change), add(rate, change)), curving


def _curvature(g: Expr, rate: Expr, x: Var, boxed: Enclosure) -> tuple[Expr, tuple[Expr, Expr]]:
    """The curvature of g and its bounds, where g has one everywhere and it does not cost much more than g and its slope."""
    if not all(_is_smooth(n) for n in postorder([g]) if x in n.free):
        return _NO_NUMBER, _ANYTHING
    try:
        curvature = slope(rate, x)
        curving = boxed.of(curvature)
    except NotDifferentiableError:
        return _NO_NUMBER, _ANYTHING
    if len(postorder(curving)) > _LARGEST:
        return _NO_NUMBER, _ANYTHING
    return curvature, curving


def _is_smooth(node: Node) -> bool:
    return isinstance(node, Var | Add | Mul | Pow) or (isinstance(node, Call) and node.name in _SMOOTH)


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

    @property
    def smooth(self) -> bool:
        """Whether bounds of all slopes are known, so that the search closes in on points."""
        return not any(isinstance(b, Const) and math.isinf(b.data) for b in self.bounds[4:])


def locate(f: Expr, g: Expr, inner: Var, low: Expr, high: Expr, outer: Var) -> Location | None:
    """What it takes to find where two surfaces meet, as seen from the outer variable; None where that is not possible.

    Where f and g are 0, so are f ± g: the two shortest of the four are looked at, which tells surfaces apart that only
    approach each other.
    """
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
    if smooth is None:
        return limit
    return min((3 * kinks + 1) * smooth, max(limit, MAX_PLACES))


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
