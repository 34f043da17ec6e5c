"""Roots without a formula: the data for isolating them at run time, and bounds on their number.

A surface g is isolated in x by interval bisection and Newton's method (statement `Isolate` of `teg.program`). The statement needs the
slope of g, enclosures of both over a box, and a bound on the number of roots, for which places are reserved:

    polynomial in x of degree n                              n
    Σᵢ Pᵢ(x)·exp(aᵢx + bᵢ), Pᵢ of degree nᵢ                  Σ(nᵢ + 1) - 1             (Pólya and Szegő, part V, problem 75)
    one or two √ of quadratic polynomials and a polynomial   the degree of what squares make of it
    kinked: |·| of m functions, otherwise one of the above   (3m + 1) times that: at a kink near 0 a root may be found thrice
    anything else                                            `max_roots` of the compilation: with more of them it is made again
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.intervals import Enclosure
from teg.analysis.kinks import is_extreme
from teg.analysis.polynomial import Shadow
from teg.analysis.radicals import most_zeros
from teg.analysis.roots import outermost
from teg.errors import NotDifferentiableError
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Cond, Const, Expr, Mul, Pow, Var, Where, const, has_cut
from teg.ir.node import Node, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, replace_node

MAX_ROOTS = 16
MAX_PLACES = 64
"""The largest number of places that are reserved for roots where a theorem bounds their number."""
MARGIN = 1e-9
BEFORE, BEHIND = 0.0137, 0.0291
"""The fractions of its length by which a range is widened at each end before places are located in it."""
_ANY_SLOPE = (const(-math.inf), const(math.inf))
OFTEN = 3
"""A polynomial in which the variable occurs at least this often is enclosed by its Taylor coefficients.

Interval arithmetic treats each occurrence as a different variable, and its bounds are too wide.
"""
_LARGEST = 20_000
"""The largest number of nodes of a surface and its enclosures together. Beyond it a box costs more than adaptive integration."""


_SMOOTH = frozenset(
    [
        "sin",
        "cos",
        "tan",
        "exp",
        "expm1",
        "log",
        "log1p",
        "sqrt",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "erf",
        "erfc",
        "erfinv",
        "erfcinv",
        "pow",
        "atan2",
    ]
)
"""Functions without kinks. Between the ends of a box on which their curvature is bounded, the bound limits the change of their slope."""
_NO_NUMBER = const(math.nan)
_ANYTHING: tuple[Expr, Expr] = (const(-math.inf), const(math.inf))


@dataclass(frozen=True)
class Isolation:
    """g, its slope and its curvature in `var`, with bounds for left <= var <= right, and the largest number of roots.

    Bounds of g and the slope come together, then those of the curvature. An unknown curvature is NaN, between infinite bounds. Outside of
    the `region` of var in which roots are looked for, g counts as not defined; a box may be all `outside`, or lie `across` its border.
    """

    g: Expr
    var: Var
    slope: Expr
    left: Var
    right: Var
    bounds: tuple[Expr, Expr, Expr, Expr]
    count: int
    curvature: Expr = _NO_NUMBER
    curving: tuple[Expr, Expr] = _ANYTHING
    region: Cond = TRUE
    outside: Cond = FALSE
    across: Cond = FALSE

    def inside(self, region: Cond) -> Isolation:
        """Returns the isolation in a region only: beside a pole there may be any number of roots, of which no integrand knows."""
        inside, outside = Enclosure({self.var: (self.left, self.right)}).decision(region)
        across = negation(disjunction(inside, outside))  # there, too, g is no number at some places
        low, high, *slopes = self.bounds
        bounds = low, high, *_unless(across, (slopes[0], slopes[1]))
        return replace(self, bounds=bounds, curving=_unless(across, self.curving), region=region, outside=outside, across=across)


def isolate(g: Expr, x: Var, limit: int = MAX_ROOTS) -> Isolation | None:
    """Returns the data for isolating the roots of g in x; None if g holds an integral over x, or a step of floor or mod."""
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
        met = _cuts_met(g, x, boxed)
        bounds = (*boxed.of(g), *_unless(met, boxed.of(rate)))
    except NotDifferentiableError:
        return None
    if len(postorder(bounds)) > _LARGEST:
        return None
    return Isolation(g, x, rate, left, right, bounds, max_roots(g, x, limit), *_curvature(g, rate, x, boxed, met))


def _occurrences(g: Expr, x: Var) -> int:
    """Returns how often a variable occurs in an expression, if that were written out as a tree."""
    times: dict[Node, int] = {}
    for node in postorder([g]):
        times[node] = 1 if node is x else min(sum(times[c] for c in node.children), _LARGEST)
    return times[g]


def _taylor(g: Expr, x: Var, middle: Expr) -> list[Expr] | None:
    """Returns the coefficients of a polynomial g in powers of x - middle.

    The bounds of such a sum are off by its highest terms only, however g is written. None if g is written with anything but sums,
    products and powers of x, or its degree is above MAX_PLACES.
    """
    series: dict[Node, list[Expr]] = {}
    for node in postorder([g]):
        if x not in node.free:
            continue
        parts = [series[c] if c in series else [cast(Expr, c)] for c in node.children]
        match node:
            case Var():
                coefficients = [middle, ONE]
            case Add():
                coefficients = [add(*(p[k] for p in parts if k < len(p))) for k in range(max(map(len, parts)))]
            case Mul():
                coefficients = parts[0]
                for p in parts[1:]:
                    coefficients = _convolved(coefficients, p)
            case Pow() if 0 < node.exponent <= MAX_PLACES:
                coefficients = parts[0]
                for bit in f"{node.exponent:b}"[1:]:
                    coefficients = _convolved(coefficients, coefficients)
                    coefficients = _convolved(coefficients, parts[0]) if bit == "1" else coefficients
            case _:
                return None
        if len(coefficients) > MAX_PLACES + 1:
            return None
        series[node] = coefficients
    return series[g]


def _convolved(first: list[Expr], second: list[Expr]) -> list[Expr]:
    """Returns the coefficients of a product of polynomials."""
    terms: list[list[Expr]] = [[] for _ in range(len(first) + len(second) - 1)]
    for i, u in enumerate(first):
        for j, v in enumerate(second):
            terms[i + j].append(mul(u, v))
    return [add(*t) for t in terms]


def _around(taylor: list[Expr], half: Expr) -> tuple[tuple[Expr, Expr, Expr, Expr], tuple[Expr, Expr]]:
    """Returns bounds of Σ cₖwᵏ, of its slope and of its curvature for |w| <= half.

    The bounds of the curvature come from all coefficients; the others from Taylor's theorem with the bounds of the curvature.
    """
    value, rate, *higher = [*taylor, ZERO]
    bends = [mul(const(float((k + 1) * (k + 2))), c) for k, c in enumerate(higher)] or [ZERO]
    reach: Expr = ZERO
    for c in reversed(bends[1:]):
        reach = mul(half, add(call("magnitude", c), reach))
    change = mul(half, add(call("magnitude", bends[0]), reach))  # of the slope
    move = mul(half, add(call("magnitude", rate), mul(const(0.5), change)))
    curving = sub(bends[0], reach), add(bends[0], reach)
    return (sub(value, move), add(value, move), sub(rate, change), add(rate, change)), curving


def _cuts_met(g: Expr, x: Var, boxed: Enclosure) -> Cond:
    """Returns the condition under which a box may hold the cut of an angle, where slopes say nothing about the change."""
    met: list[Cond] = []
    for angle in postorder([g]):
        if has_cut(angle) and x in angle.free:
            (below, above), (left, _) = (boxed.of(cast(Expr, c)) for c in angle.children)
            touched = positive(above, strict=False), positive(mul(MINUS_ONE, below), strict=False)
            met.append(conjunction(*touched, positive(mul(MINUS_ONE, left))))
    return disjunction(*met)


def _unless(met: Cond, bounds: tuple[Expr, Expr]) -> tuple[Expr, Expr]:
    """Returns bounds that are infinite under a condition."""
    return bounds if met is FALSE else (where(met, _ANYTHING[0], bounds[0]), where(met, _ANYTHING[1], bounds[1]))


def _curvature(g: Expr, rate: Expr, x: Var, boxed: Enclosure, met: Cond) -> tuple[Expr, tuple[Expr, Expr]]:
    """Returns the curvature of g and its bounds, if g has one everywhere and it does not cost much more than g and its slope; else NaN."""
    if not all(_is_smooth(n) for n in postorder([g]) if x in n.free):
        return _NO_NUMBER, _ANYTHING
    try:
        curvature = slope(rate, x)
        curving = _unless(met, boxed.of(curvature))
    except NotDifferentiableError:
        return _NO_NUMBER, _ANYTHING
    if len(postorder(curving)) > _LARGEST:
        return _NO_NUMBER, _ANYTHING
    return curvature, curving


def _is_smooth(node: Node) -> bool:
    return isinstance(node, Var | Add | Mul | Pow) or (isinstance(node, Call) and node.name in _SMOOTH)


@dataclass(frozen=True)
class Location:
    """The data for finding f = g = 0 in a rectangle of an outer variable and an inner one, which runs from low to high.

    Bounds over left..right × bottom..top of f and g, and of their slopes by both variables.
    """

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
        """Returns whether bounds of all slopes are known, so that the search can close in on points."""
        return not any(isinstance(b, Const) and math.isinf(b.data) for b in self.bounds[4:])


def locate(f: Expr, g: Expr, inner: Var, low: Expr, high: Expr, outer: Var) -> Location | None:
    """Returns the data for finding where two surfaces meet, as seen from the outer variable; None if that is not possible.

    Where f and g are 0, so are f ± g. The two shortest of the four are used: they tell surfaces apart that only approach each other.
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
    """Returns f ± g with like terms collected; None if there are no like terms, or the result is 0."""
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
    """Returns bounds of ∂e/∂x for the mean value theorem; infinite bounds if e jumps or has no slope."""
    if any(isinstance(n, Where) or (isinstance(n, Call) and n.name == "atan2") for n in postorder([e]) if n.free & boxed.box.keys()):
        return _ANY_SLOPE
    try:
        return boxed.of(slope(e, x))
    except NotDifferentiableError:
        return _ANY_SLOPE


def has_pole(g: Expr, x: Var) -> bool:
    """Returns whether a function may be infinite, or oscillate without end, where x is finite."""
    return any(_is_infinite_somewhere(n) and x in n.free for n in postorder([g]))


def _is_infinite_somewhere(n: Node) -> bool:
    return (isinstance(n, Pow) and n.exponent < 0) or (isinstance(n, Call) and n.name in ("log", "pow", "tan"))


def widened(lo: Expr, hi: Expr) -> tuple[Expr, Expr]:
    """Returns the range in which roots are searched: a little beyond the bounds, so that roots on a bound are found (and are ties)."""
    if any(isinstance(b, Const) and math.isinf(b.data) for b in (lo, hi)):
        return lo, hi
    margin = mul(const(MARGIN), sub(hi, lo))
    return sub(lo, margin), add(hi, margin)


def off_the_grid(lo: Expr, hi: Expr) -> tuple[Expr, Expr]:
    """Returns a wider range whose ends, halves and quarters are not where surfaces meet by symmetry.

    A zero is found the sooner the farther it is from the border of a rectangle.
    """
    extent = sub(hi, lo)
    return sub(lo, mul(const(BEFORE), extent)), add(hi, mul(const(BEHIND), extent))


def max_roots(g: Expr, x: Var, limit: int = MAX_ROOTS) -> int:
    """Returns an upper bound of the number of simple roots in x; `limit` if no theorem applies."""
    if isinstance(g, Where) and not g.condition.free:
        return max(max_roots(g.then, x, limit), max_roots(g.otherwise, x, limit))
    kinks = 0
    for node in postorder([g]):
        if x in node.free and (isinstance(node, Where) or is_extreme(node)):
            kinks += 1
    smooth = _of_smooth(g, x)
    if smooth is None:
        return limit
    return min((3 * kinks + 1) * smooth, max(limit, MAX_PLACES))


def _of_smooth(g: Expr, x: Var) -> int | None:
    exponentials = [n for n in _functions(g, x) if isinstance(n, Call) and n.name == "exp" and Shadow((x,)).degree(n.children[0]) == 1]
    weights: list[Var] = []
    e = g
    for node in exponentials:
        w = fresh(f"exp{len(weights)}", g.free)
        e = cast(Expr, replace_node(e, node, w))
        weights.append(w)
    poly = Shadow((x, *weights), kinks=True).polynomial(e)
    if poly is None:
        zeros = most_zeros(g, x) if g.free == {x} else None
        return None if zeros is None else max(1, zeros)
    degrees: dict[tuple[int, ...], int] = {}
    for monomial in poly:
        degrees[monomial[1:]] = max(degrees.get(monomial[1:], 0), monomial[0])
    return max(1, sum(d + 1 for d in degrees.values()) - 1)


def _functions(g: Expr, x: Var) -> list[Expr]:
    """Returns the outermost functions that depend on x."""
    return outermost(g, x, lambda e: isinstance(e, Call) and not is_extreme(e))
