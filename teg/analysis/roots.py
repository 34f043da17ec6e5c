"""Roots of a surface in one variable, as expressions of everything else.

affine       x* = l - g(l)/g′                                  from the value at a bound l, as the user wrote it
quadratic    q = -½(B + sgn(B)·√D),  x₁ = q/A,  x₂ = C/q       neither cancels; A → 0 sends x₁ to infinity (Press et al., section 5.6)
f(u) = c     u = f⁻¹(c), every branch inside the bounds, then u = … is solved for x in the same way
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

from teg.analysis.calculus import slope
from teg.analysis.distances import equal_distances
from teg.analysis.expanded import shorter_form
from teg.analysis.polynomial import Degrees, Shadow
from teg.analysis.preimages import is_not_zero, preimages
from teg.analysis.squares import discriminant_of_squares
from teg.errors import NotDifferentiableError
from teg.ir import expr as ex
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Add, Call, Cond, Const, Expr, Mul, Param, Pow, Truth, Var, Where, const
from teg.ir.node import Node, nodes_of, postorder
from teg.ir.simplify import add, call, conjunction, disjunction, div, integer_power, mul, negation, positive, sub, where
from teg.ir.traverse import fresh, parameters, replace_node, size, substitute

MAX_DEPTH = 8
COARSE = 1e4
REACH = 2.0**20
"""A vertex that is further away from the origin is not gone to."""
NEAR = 64.0
"""A bound of at most this size is near 0: roots relative to it have an error of 1e-14 at most."""
LEAST = 1e-300
"""Keeps a divisor from 0."""


@dataclass(frozen=True)
class Root:
    """One root: its place, and the condition under which it exists. Elsewhere `point` is NaN or no root. `rate` is |g′| there, where it is
    known better than by g′."""

    point: Expr
    exists: Cond = TRUE
    rate: Expr | None = None


@dataclass(frozen=True)
class Roots:
    """All roots between the bounds. `certain` is False if there may be more of them than there is code for."""

    found: tuple[Root, ...]
    certain: bool = True


def local_origin(lo: Expr, hi: Expr) -> Expr:
    """Returns the origin relative to which roots are computed: 0 if it is between the bounds; else a number near 0 that is a bound, since
    the other bound may be far away and the root near 0; else a finite bound."""
    finite = [b for b in (lo, hi) if not (isinstance(b, Const) and math.isinf(b.data))]
    numbers = sorted((b for b in finite if isinstance(b, Const)), key=lambda b: abs(b.data))
    if len(numbers) == 2 and min(b.data for b in numbers) <= 0.0 <= max(b.data for b in numbers):
        return ZERO
    if numbers and (len(numbers) == len(finite) or abs(numbers[0].data) <= NEAR):
        return numbers[0]
    return next(iter(finite), ZERO)


def far_origin(lo: Expr, hi: Expr) -> Expr:
    """Returns the origin for formulas with more terms.

    The nearer bound if both are numbers that are far from 0 compared with their distance; else 0.
    """
    if isinstance(lo, Const) and isinstance(hi, Const):
        nearer = min(lo, hi, key=lambda b: abs(b.data))
        if math.isfinite(nearer.data) and lo.data * hi.data > 0.0 and abs(nearer.data) > 4.0 * abs(hi.data - lo.data):
            return nearer
    return ZERO


def solve(g: Expr, x: Var, lo: Expr, hi: Expr, depth: int = MAX_DEPTH, degrees: Degrees | None = None) -> Roots | None:
    """Returns the roots of g in x between the bounds if a formula is known, else None. Some may lie outside of the bounds.

    `degrees` holds degrees that are known already, for callers that solve many functions.
    """
    try:
        degree = (degrees or Degrees()).of(g, x)
        if degree == 0:
            return Roots(())
        if degree == 1:
            if depth == MAX_DEPTH:
                return Roots((Root(affine_root(g, x, local_origin(lo, hi))),))
            rate, at_zero = (cast(Expr, substitute(e, {x: ZERO})) for e in (slope(g, x), g))
            return Roots((Root(div(mul(MINUS_ONE, at_zero), rate), is_met([rate], at_zero)),))  # in an inverse function nothing is local
        if degree == 2:
            return Roots(quadratic_roots(g, x, far_origin(lo, hi) if depth == MAX_DEPTH else ZERO))
        if not depth:
            return None
        normal = shorter_form(g)
        if normal is not None and size(normal) < size(g):
            return solve(normal, x, lo, hi, depth - 1)
        distances = equal_distances(g, x)
        if distances is not None:
            return Roots(tuple(Root(*pair) for pair in distances))
        direct = _inverted(g, x, lo, hi, depth) or _rationalised(g, x, lo, hi, depth)
        if direct is not None:
            return direct
        local = shorter_form(g, variables=True)  # differences make it longer
        return None if local is None or local is g else _inverted(local, x, lo, hi, depth) or _rationalised(local, x, lo, hi, depth)
    except NotDifferentiableError:
        return None


def is_met(rates: Sequence[Expr], level: Expr) -> Cond:
    """Returns the condition that an affine function with these slopes is 0 at a finite place; `level` is its value at the origin.

    Where that and all slopes are 0 there is no derivative: it counts as met, so that the result is not a number. That is left out where
    `level` has variables.
    """
    met = disjunction(*(is_not_zero(rate) for rate in rates))
    return met if met is TRUE or level.free else disjunction(met, negation(is_not_zero(level)))


def affine_root(g: Expr, x: Var, origin: Expr) -> Expr:
    """Returns the root of an affine surface: origin - g(origin)/g′."""
    if not (isinstance(origin, Const) and math.isfinite(origin.data)) and isinstance(origin, Const):
        origin = ZERO
    at = cast(Expr, substitute(g, {x: origin}))
    rate = cast(Expr, substitute(slope(g, x), {x: origin}))
    return sub(origin, div(at, rate))


def quadratic_coefficients(g: Expr, x: Var, origin: Expr = ZERO) -> tuple[Expr, Expr, Expr]:
    """Returns A, B, C of g = A·w² + B·w + C, w = x - origin."""
    first = slope(g, x)
    second = slope(first, x)
    parts = mul(const(0.5), second), first, g
    a, b, c = (cast(Expr, substitute(e, {x: origin})) for e in parts)
    return tidy(a), tidy(b), tidy(c)


def tidy(e: Expr, scale: float = 1.0) -> Expr:
    """Returns the shorter of an expression and its exact normal form. Numbers in it were multiplied by a scale."""
    normal = shorter_form(e, variables=True)
    return normal if normal is not None and size(normal) <= size(e) and not _is_coarse(normal, scale) else e


def discriminant(a: Expr, b: Expr, c: Expr) -> Expr:
    """Returns B² - 4AC, from the exact normal form if that is short: for (x - c)² < t it is 4t and not a difference of squares. Where B is
    0 it stays a product, whose factors tell where it is 0."""
    if b is ZERO:
        return mul(const(-4), a, c)
    raw = sub(integer_power(b, 2), mul(const(4), a, c))
    normal = shorter_form(raw, variables=True)
    return normal if normal is not None and not _is_coarse(normal) else raw


def discriminant_of(g: Expr, x: Var, origin: Expr, known: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns the discriminant of a quadratic from its coefficients, or, where these have parameters or large numbers, from its squares."""
    plain = discriminant(*known)
    if known[1] is ZERO or not (parameters(plain) or _is_coarse(plain)):
        return plain
    by_squares = discriminant_of_squares(g, x, origin)
    return plain if by_squares is None or isinstance(plain, Mul) or not by_squares.free <= plain.free else by_squares


def _at_the_vertex(g: Expr, x: Var, origin: Expr, known: tuple[Expr, Expr, Expr]) -> Expr:
    """Returns the discriminant D, from A, B and D, by the value of g near its vertex where terms of D may cancel.

        B² - 4AC = (2A·w + B)² - 4A·g(o + w)    for every w

    At the vertex w = -B/2A the square is 0, and g(o + w) keeps the digits that the user's formula has there: a chord of a small disk, on a
    line as long as the box, is 0 to the rounding of B² - 4AC. A vertex that is further away than REACH is approached only, or not gone to
    if A is a number: it may be the rounding of terms that cancel, as of a parabola turned by an angle. All this where D depends on
    parameters alone: elsewhere its roots are looked for, in its shortest form.
    """
    a, b, d = known
    if d.free or not isinstance(d, Add) or all(isinstance(t, Param | Const) or _is_scaled(t) for t in d.children):
        return d
    if isinstance(a, Const) and _ordinary_size(b) > REACH * 2.0 * abs(a.data):
        return d
    double = mul(const(2), a)
    slope_there: Expr = ZERO
    if isinstance(a, Const):
        w = div(mul(MINUS_ONE, b), double)
    else:
        square = integer_power(double, 2)
        scale = call("max", call("max", square, mul(const(REACH**-2), integer_power(b, 2))), const(LEAST))
        w = mul(MINUS_ONE, double, b, integer_power(scale, -1))
        slope_there = mul(b, sub(scale, square), integer_power(scale, -1))
    value = cast(Expr, substitute(g, {x: add(origin, w)}))
    return sub(integer_power(slope_there, 2), mul(const(4), a, value))


def _is_scaled(e: Node) -> bool:
    """Returns whether an expression is a number times a parameter."""
    return (
        isinstance(e, Mul) and all(isinstance(f, Const | Param) for f in e.children) and sum(isinstance(f, Param) for f in e.children) == 1
    )


def _is_coarse(normal: Expr, scale: float = 1.0) -> bool:
    """Returns whether a normal form has such large numbers that it loses digits: (x - 1000)², written out."""
    return any(abs(n.data) > COARSE * scale for n in nodes_of(Const, normal))


@lru_cache(maxsize=256)
def quadratic_roots(g: Expr, x: Var, origin: Expr = ZERO) -> tuple[Root, ...]:
    """Returns both roots. If A is a number and m = -B/2A cannot be much larger than a root, they are m ± s, which is
    as exact and smoother."""
    a, b, c = quadratic_coefficients(g, x, origin)
    d = _at_the_vertex(g, x, origin, (a, b, discriminant_of(g, x, origin, (a, b, c))))
    exists = conjunction(positive(d, strict=False), is_not_zero(a))
    root = call("root", d)
    if b is ZERO or (isinstance(a, Const) and not _may_cancel(a, b, d)):
        half = div(root, mul(const(2), ex.const(abs(a.data)) if isinstance(a, Const) else call("magnitude", a)))
        middle = add(origin, tidy(mul(const(-0.5), div(b, a)))) if b is not ZERO else origin
        return (Root(sub(middle, half), exists, root), Root(add(middle, half), exists, root))
    up = positive(b, strict=False)
    q = mul(const(-0.5), add(b, where(up, root, mul(MINUS_ONE, root))))
    larger, smaller = add(origin, div(q, a)), add(origin, div(c, q))  # by size, if the origin is 0
    real, has_larger, has_smaller = positive(d, strict=False), is_not_zero(a), is_not_zero(q)
    if isinstance(up, Truth):
        return (Root(larger, conjunction(real, has_larger), root), Root(smaller, conjunction(real, has_smaller), root))
    down = negation(up)  # the roots keep their names where B changes its sign: m - s and m + s
    first = conjunction(real, disjunction(conjunction(up, has_larger), conjunction(down, has_smaller)))
    second = conjunction(real, disjunction(conjunction(up, has_smaller), conjunction(down, has_larger)))
    return (Root(where(up, larger, smaller), first, root), Root(where(up, smaller, larger), second, root))


def _may_cancel(a: Const, b: Expr, d: Expr) -> bool:
    """Returns whether m and s may nearly cancel, where D holds B²: B has a large parameter, or its numbers make m large."""
    if not b.free and set(parameters(b)) & set(parameters(d)):
        return True
    middle = _ordinary_size(b)
    return middle > COARSE * 2.0 * abs(a.data) and _ordinary_size(d) >= 0.5 * middle**2


def _ordinary_size(e: Expr) -> float:
    """Returns the size of an expression whose parameters, variables and functions have size 1 and whose terms do not cancel."""
    sizes: dict[Node, float] = {}
    with_numbers = (Add, Mul, Pow)
    for node in postorder([e]):
        parts = [sizes[c] for c in node.children] if isinstance(node, with_numbers) else []
        match node:
            case Const():
                sizes[node] = abs(float(node.data))
            case Add():
                sizes[node] = sum(parts)
            case Mul():
                sizes[node] = math.prod(parts)
            case Pow():
                sizes[node] = _power(parts[0], node.exponent)
            case _:
                sizes[node] = 1.0
    return sizes[e]


def _power(base: float, exponent: int) -> float:
    try:
        return base**exponent
    except (OverflowError, ZeroDivisionError):
        return math.inf


def _parts(g: Expr, x: Var) -> tuple[Expr, Expr, Expr] | None:
    """Returns P, Q, D of g = P + Q·√D, where √D is the only square root that depends on x."""
    square_roots = [n for n in _functions(g, x) if isinstance(n, Call) and n.name in ("sqrt", "root")]
    if len(square_roots) != 1:
        return None
    s = fresh("√", g.free)
    affine = cast(Expr, replace_node(g, square_roots[0], s))
    if Shadow((s,)).degree(affine) != 1:
        return None
    at_zero, rate = (cast(Expr, substitute(e, {s: ZERO})) for e in (affine, slope(affine, s)))
    return at_zero, rate, square_roots[0].children[0]


def _rationalised(g: Expr, x: Var, lo: Expr, hi: Expr, depth: int) -> Roots | None:
    """Returns the roots of P + Q·√D = 0: the roots of P² - Q²·D at which P and Q have opposite signs.

    Where Q is 0 the square P² has each of its roots twice.
    """
    parts = _parts(g, x)
    if parts is None:
        return None
    p, q, d = parts
    square = sub(integer_power(p, 2), mul(integer_power(q, 2), d))
    roots = solve(tidy(square), x, lo, hi, depth - 1)
    if roots is None:
        return None
    kept = []
    for i, r in enumerate(roots.found):
        at = {x: r.point}
        opposite = positive(cast(Expr, substitute(mul(MINUS_ONE, p, q), at)), strict=False)
        counts = is_not_zero(cast(Expr, substitute(q, at)))
        if counts is not TRUE:
            counts = disjunction(counts, _is_new(i, roots.found))
        kept.append(Root(r.point, conjunction(r.exists, opposite, counts)))
    return Roots(tuple(kept), roots.certain)


def _is_new(i: int, roots: Sequence[Root]) -> Cond:
    """Returns the condition that root i of a square is none of those before it. Of two, both are one, whatever rounding makes of them."""
    if len(roots) == 2:
        return FALSE if i else TRUE
    return conjunction(*(is_not_zero(sub(roots[i].point, other.point)) for other in roots[:i]))


# -- f(u) = c ------------------------------------------------------------------------------------------------------------


def outermost(g: Expr, x: Var, is_wanted: Callable[[Expr], bool]) -> list[Expr]:
    """Returns the outermost wanted nodes that depend on x, below sums, products, powers, functions and branches that are not wanted."""
    wanted: dict[Expr, None] = {}
    stack: list[Expr] = [g]
    seen: set[Expr] = set()
    while stack:
        e = stack.pop()
        if e in seen or x not in e.free:
            continue
        seen.add(e)
        if is_wanted(e):
            wanted[e] = None
        elif isinstance(e, Where):
            stack += [e.then, e.otherwise]
        elif isinstance(e, Add | Mul | Pow | Call):
            stack.extend(cast("tuple[Expr, ...]", e.children))
    return list(wanted)


def _functions(g: Expr, x: Var) -> list[Call | Pow]:
    """Returns the outermost functions and higher powers that depend on x."""
    functions = outermost(g, x, lambda e: isinstance(e, Call) or (isinstance(e, Pow) and not 0 < e.exponent <= 2))
    return cast("list[Call | Pow]", functions)


def _inverted(g: Expr, x: Var, lo: Expr, hi: Expr, depth: int) -> Roots | None:
    """Returns the roots of a g that is a polynomial of degree 1 or 2 in one function of x and depends on x in no other way."""
    functions = _functions(g, x)
    harmonic = _harmonic(g, x, functions)
    if harmonic is not None:
        g, functions = harmonic
    if len(functions) != 1:
        return None
    f = functions[0]
    z = fresh("z", g.free)
    outer = cast(Expr, replace_node(g, f, z))
    if x in outer.free:
        return None
    levels = solve(outer, z, ZERO, ONE, depth - 1)
    if levels is None:
        return None
    solutions: list[Root] = []
    certain = levels.certain
    for level in levels.found:
        inner = preimages(f, level.point, x, lo, hi)
        if inner is None:
            return None
        pairs, complete = inner
        certain &= complete
        for argument, exists in pairs:
            deeper = solve(argument, x, lo, hi, depth - 1)
            if deeper is None:
                return None
            certain &= deeper.certain
            for r in deeper.found:
                there = cast(Cond, substitute(exists, {x: r.point}))
                solutions.append(Root(r.point, conjunction(level.exists, there, r.exists)))
    return Roots(tuple(solutions), certain)


def _harmonic(g: Expr, x: Var, functions: list[Call | Pow]) -> tuple[Expr, list[Call | Pow]] | None:
    """Returns A·sin u + B·cos u + C as R·sin(u + φ) + C, with R = √(A² + B²), φ = atan2(B, A)."""
    by_name = {f.name: f for f in functions if isinstance(f, Call)}
    if len(functions) != 2 or by_name.keys() != {"sin", "cos"} or by_name["sin"].children != by_name["cos"].children:
        return None
    s, c = fresh("sin", g.free), fresh("cos", g.free)
    linear = cast(Expr, replace_node(replace_node(g, by_name["sin"], s), by_name["cos"], c))
    if Shadow((s, c)).degree(linear) != 1 or x in linear.free:
        return None
    parts = slope(linear, s), slope(linear, c), linear
    a, b, constant = (cast(Expr, substitute(e, {s: ZERO, c: ZERO})) for e in parts)
    wave = call("sin", add(by_name["sin"].children[0], call("atan2", b, a)))
    radius = call("sqrt", add(integer_power(a, 2), integer_power(b, 2)))
    return add(mul(radius, wave), constant), [cast(Call, wave)]
