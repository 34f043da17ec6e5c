"""Polynomials on one side of an ellipse over a box, and on the ellipse itself: moments by its chords and arcs.

    ∫∫ P(x, y)·[g(x, y) > 0]·Π[hᵢ(x, y) > 0] dx dy,   ∫∫ P(x, y)·δ(g(x, y))·Π[hᵢ(x, y) > 0] dx dy        g = ±(κ - |A(x - c)|²), hᵢ affine

Both are Σ c_jk·M_jk with the coefficients c_jk of P at a corner of the box and the moments M_jk of the region, or of the curve, which
depend on A, the centre c, the radius √κ, the extents of the box and the half-planes: one statement, `Ellipse`, for all integrals that
share them. Without it the outer integral has a break wherever the curve crosses a side or a line, and square roots at the ends, and the
curve is cut into quarters.

g is an ellipse whatever its parameters are if it is written with two squares of affine functions, or if its quadratic part is definite and
consists of numbers. A boundary term stands in an expression as an `Arcs`. It is made only where derivatives end, because it has no
derivative. An outer integral of it has a break wherever the curve goes through a corner of the box, or touches a side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import cast

from teg.analysis.boxes import Coefficients, coefficients, coefficients_along, nest_of_two
from teg.analysis.calculus import slope
from teg.analysis.evaluate import values_of
from teg.analysis.expanded import distance
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.errors import NotDifferentiableError, OperandError
from teg.ir.expr import FALSE, MINUS_ONE, ONE, TRUE, ZERO, Compare, Cond, Const, Expr, Param, Var, const
from teg.ir.integral import ClosedForm, Integral
from teg.ir.node import digest, postorder
from teg.ir.simplify import add, call, div, integer_power, mul, sub, where
from teg.ir.traverse import replace_node, substitute
from teg.passes.eliminate.conic import Conic, born, match_conic, place_of, squares_of
from teg.program import MAX_CUTS

MAX_DEGREE = 6
"""Of the polynomial along the curve; of the one inside it is two less, for the nodes along the arcs are the same."""
LONG = 4.0
"""Sum of the squares of a matrix of numbers, relative to its determinant, from which on an ellipse is long; 2 is that of a circle."""
FLAT = 2.0**-40
"""The determinant of a matrix of numbers, relative to the sum of their squares, below which roundings may have made it."""
Powers = tuple[int, int]
Line = tuple[Expr, Expr, Expr]
"""a, b and c of c + a·u + b·v = 0, about the corner of both lower bounds."""
Matrix = tuple[Expr, ...]
"""A by rows: two numbers each, for the inner variable and the outer one."""
Place = tuple[Expr, ...]
"""Both numbers of the centre about the corner of both lower bounds, the radius, the extents, and the least radius of a border."""


@dataclass(frozen=True)
class Cut:
    """c + a·u + b·v > 0, or >= 0 if it is closed."""

    line: Line
    closed: bool


@dataclass(frozen=True)
class Curve:
    """An ellipse on a box that half-planes clip."""

    matrix: Matrix
    place: Place
    cuts: tuple[Cut, ...]


class Arcs(ClosedForm):
    """∫∫ over a clipped box of Σ c·uʲvᵏpᵐqⁿ·δ(g), g = 0 an ellipse, (p, q) = A·((u, v) - centre).

    A function of the matrix, the place and the half-planes, of g at the corners of the box and where lines meet, of how far each line is
    from touching the ellipse, and of the coefficients. Data are whether each half-plane is closed, the powers (j, k, m, n), the number of
    intersections and that of lines, 0 for both if nothing but the coefficients depends on an outer variable.
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        return "arcs"

    @property
    def curve(self) -> Curve:
        """The ellipse and its domain."""
        (matrix, place, lines, *_), closed = self._parts, cast("tuple[bool, ...]", self.data[0])
        cuts = map(Cut, zip(lines[::3], lines[1::3], lines[2::3], strict=True), closed)
        return Curve(tuple(matrix), tuple(place), tuple(cuts))

    @property
    def coefficients(self) -> dict[Powers, Coefficients]:
        """The coefficients of uʲvᵏ by the powers of p and q."""
        found: dict[Powers, Coefficients] = {}
        for (j, k, *axes), c in zip(cast("tuple[tuple[int, ...], ...]", self.data[1]), self.terms, strict=True):
            found.setdefault((axes[0], axes[1]), {})[j, k] = c
        return found

    @property
    def kinks(self) -> Sequence[Expr]:
        return self._parts[3]

    @property
    def births(self) -> Sequence[Expr]:
        return self._parts[4]

    @property
    def terms(self) -> Sequence[Expr]:
        return self._parts[5]

    @property
    def _parts(self) -> list[Sequence[Expr]]:
        children, parts = cast("Sequence[Expr]", self.children), []
        for count in (4, 6, 3 * len(cast("tuple[bool, ...]", self.data[0])), self.data[2], self.data[3], len(children)):
            part, children = children[: cast(int, count)], children[cast(int, count) :]
            parts.append(part)
        return parts


@dataclass(frozen=True)
class Sides:
    """∫∫ over a clipped box, of one polynomial in an ellipse and another one outside."""

    curve: Curve
    inside: Coefficients
    outside: Coefficients


def match_arcs(g: Expr, coefficient: Expr, chain: Chain, variables: Sequence[Var]) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) over a chain of integrals as those of a function of the place of an ellipse in two variables; None for
    other surfaces and coefficients."""
    box = tuple(b for b in chain if b.var in variables)
    others = tuple(b for b in chain if b.var not in variables)
    inside, outside = set(variables), {b.var for b in others}
    if any(e.free & inside for b in chain for e in (b.lo, b.hi)) or any(e.free & outside for b in box for e in (b.lo, b.hi)):
        return None
    if _is_endless(box):
        return None
    split = _cuts(coefficient, [a for b in box for a in atoms_of(coefficient, b.var)], box)
    if split is None:
        return None
    cuts, coefficient = split
    curve = _surface(g, box)
    if curve is None:
        return None
    found = _coefficients(coefficient, box, curve)
    if found is None or any(sum(powers) > MAX_DEGREE for powers in found):
        return None
    numbers = (*curve.matrix, *curve.place, *(e for cut in cuts for e in cut.line))
    kinks: list[Expr] = []
    births: list[Expr] = []
    if any(e.free for e in (*numbers, curve.square)):
        kinks, births = [*_corners(g, box), *_intersections(curve, cuts)], _touching(curve, cuts)
    data = tuple(cut.closed for cut in cuts), tuple(found), len(kinks), len(births)
    arcs = Arcs.make(data, (*numbers, *kinks, *births, *found.values()))
    return nest(where(curve.exists, arcs, ZERO), others)


def _coefficients(e: Expr, box: Chain, curve: _Surface) -> dict[tuple[int, int, int, int], Expr] | None:
    """Returns the coefficients of a polynomial along an ellipse by the powers of u, v, p and q; of u and v alone unless it may be long.

    Along a thin ellipse the square of a base that its short axis divides is of size 1, while that of each of its terms is 1/b².
    """
    if curve.bases and _is_long(curve.matrix):
        return coefficients_along(e, box, curve.bases)
    found = coefficients(e, box)
    return None if found is None else {(j, k, 0, 0): c for (j, k), c in found.items()}


def _is_long(matrix: Matrix) -> bool:
    """Returns whether an ellipse is long, or may be with some parameters."""
    a, b, c, d = matrix
    numbers = [float(e.data) for e in matrix if isinstance(e, Const)]
    if len(numbers) == 4:
        p, q, r, s = numbers
        return p * p + q * q + r * r + s * s > LONG * abs(p * s - q * r)
    return not (a is d and b is c is ZERO)


def _is_flat(matrix: Matrix) -> bool:
    """Returns whether the curve of a matrix may be two parallel lines that roundings of numbers have bent, whatever its parameters are."""
    import numpy as np

    symbols = [n for n in postorder(matrix) if isinstance(n, Param)]
    if any(e.free for e in matrix):
        return False
    random = np.random.default_rng(1)
    try:
        p, q, r, s = values_of(matrix, {symbol: random.uniform(0.05, 0.95, 4) for symbol in symbols})
    except OperandError:
        return False
    return bool(np.all(np.abs(p * s - q * r) <= FLAT * (p * p + q * q + r * r + s * s)))


def _cuts(integrand: Expr, atoms: Sequence[Compare], box: Chain) -> tuple[tuple[Cut, ...], Expr] | None:
    """Returns the half-planes of these conditions, outside of which an integrand is 0, in an order of their own, and the integrand in all
    of them; None if it is not 0 outside, or a condition is no half-plane."""
    outer, inner = box
    corner: dict[Var, Expr] = {inner.var: inner.lo, outer.var: outer.lo}
    cuts: dict[Cut, int] = {}
    for atom in dict.fromkeys(atoms):
        g, closed = atom.g, not atom.strict
        if atom.resolution is not None or any(atoms_of(g, v) for v in corner) or Shadow((inner.var, outer.var)).degree(g) not in (0, 1):
            return None
        inside, outside = (cast(Expr, replace_node(integrand, atom, truth)) for truth in (TRUE, FALSE))
        if inside is ZERO:
            inside, outside, g, closed = outside, inside, mul(MINUS_ONE, g), atom.strict
        if outside is not ZERO:
            return None
        try:
            a, b, c = (cast(Expr, substitute(e, corner)) for e in (slope(g, inner.var), slope(g, outer.var), g))
        except NotDifferentiableError:
            return None
        integrand = inside
        cuts[Cut((a, b, c), closed)] = digest(atom)
    return (tuple(sorted(cuts, key=lambda cut: cuts[cut])), integrand) if len(cuts) <= MAX_CUTS else None


def _corners(g: Expr, box: Chain) -> list[Expr]:
    """Returns g at the corners of a box."""
    outer, inner = box
    return [cast(Expr, substitute(g, {inner.var: u, outer.var: v})) for u in (inner.lo, inner.hi) for v in (outer.lo, outer.hi)]


def _sides(curve: _Surface) -> list[Line]:
    """Returns the lines of the sides of the box."""
    _, _, _, width, height, _ = curve.place
    return [(*axis, mul(MINUS_ONE, at)) for axis, extent in (((ONE, ZERO), width), ((ZERO, ONE), height)) for at in (ZERO, extent)]


def _intersections(curve: _Surface, cuts: Sequence[Cut]) -> list[Expr]:
    """Returns, for each half-plane with each side of the box and each other half-plane, a function that is 0 where the ellipse goes through
    the point in which their lines meet."""
    (a, b, c, d), (u, v, *_) = curve.matrix, curve.place
    lines = [cut.line for cut in cuts]
    found = []
    for (p, q, r), (s, t, w) in (*product(lines, _sides(curve)), *combinations(lines, 2)):
        turn = sub(mul(p, t), mul(q, s))
        x, y = sub(sub(mul(q, w), mul(r, t)), mul(turn, u)), sub(sub(mul(r, s), mul(p, w)), mul(turn, v))
        squares = (integer_power(add(mul(e, x), mul(f, y)), 2) for e, f in ((a, b), (c, d)))
        found.append(sub(mul(integer_power(turn, 2), curve.square), add(*squares)))
    return found


def _touching(curve: _Surface, cuts: Sequence[Cut]) -> list[Expr]:
    """Returns, for each line, a function that is 0 where the ellipse touches it."""
    (a, b, c, d), (u, v, *_) = curve.matrix, curve.place
    whole = sub(mul(a, d), mul(b, c))
    found = []
    for p, q, r in (*_sides(curve), *(cut.line for cut in cuts)):
        reach = mul(add(*(integer_power(sub(mul(e, p), mul(f, q)), 2) for e, f in ((d, c), (b, a)))), curve.square)
        found.append(sub(reach, integer_power(mul(whole, add(mul(p, u), mul(q, v), r)), 2)))
    return found


def match_ellipse(node: Integral) -> Sides | None:
    """Returns an integral over a box of an integrand that is a polynomial on either side of an ellipse, or None."""
    if node.has_delta or is_unbounded(node) or (found := nest_of_two(node, guarded=True)) is None:
        return None
    chain, integrand = found
    outer, inner = chain
    if outer.var in inner.lo.free | inner.hi.free or _is_endless(chain):
        return None
    atoms = list(dict.fromkeys(a for b in chain for a in atoms_of(integrand, b.var)))
    curved = [a for a in atoms if Shadow((inner.var, outer.var)).degree(a.g) == 2]
    if len(curved) != 1:
        return None
    (atom,) = curved
    if atom.resolution is not None or any(atoms_of(atom.g, b.var) for b in chain):
        return None
    split = _cuts(integrand, [a for a in atoms if a is not atom], chain)
    if split is None:
        return None
    cuts, integrand = split
    above, below = (coefficients(cast(Expr, replace_node(integrand, atom, c)), chain) for c in (TRUE, FALSE))
    if above is None or below is None or any(j + k > MAX_DEGREE - 2 for j, k in (*above, *below)):
        return None
    curve = _surface(atom.g, chain)
    if curve is None:
        return None
    return Sides(Curve(curve.matrix, curve.place, cuts), *((above, below) if curve.sign > 0.0 else (below, above)))


def _is_endless(chain: Chain) -> bool:
    return any(isinstance(e, Const) and abs(e.data) == float("inf") for b in chain for e in (b.lo, b.hi))


@dataclass(frozen=True)
class _Surface:
    """An ellipse on a box, the κ of its radius, the sign of g inside, whether there is a curve, with a tie at κ = 0, and both numbers of
    A·(x - c) as they are written, if g is written with their squares."""

    matrix: Matrix
    place: Place
    square: Expr
    sign: float
    exists: Cond
    bases: tuple[Expr, ...]


def _surface(g: Expr, box: Chain) -> _Surface | None:
    """Returns the ellipse of a surface on a box; None for other surfaces."""
    outer, inner = box
    variables = inner.var, outer.var
    if Shadow(variables).degree(g) != 2:
        return None
    squares = squares_of(g, variables)
    bases: tuple[Expr, ...] = ()
    if squares is not None:
        if squares.numbers is None and all(isinstance(e, Const) for row in squares.rows for e in row):
            return None
        (a, b), (c, d) = squares.rows
        p, q = (cast(Expr, substitute(base, {inner.var: inner.lo, outer.var: outer.lo})) for base in squares.bases)
        whole = sub(mul(a, d), mul(b, c))
        centre = div(sub(mul(b, q), mul(d, p)), whole), div(sub(mul(c, p), mul(a, q)), whole)
        sign, place, bases = squares.sign, born(g, squares.top, squares.sign), squares.bases
    else:
        data = match_conic(g, variables)
        known = None if data is None else place_of(g, box, data)
        if data is None or known is None:
            return None
        (a, b), (c, d) = _inverse(data, inner)
        whole = sub(mul(a, d), mul(b, c))
        centre = sub(known.centre[inner.var], inner.lo), sub(known.centre[outer.var], outer.lo)
        sign, place = data.sign, known
    if is_null(whole) or _is_flat((a, b, c, d)):  # parallel lines, however they are written
        return None
    extents = distance(inner.lo, inner.hi), distance(outer.lo, outer.hi)
    radius, least = (call("sqrt", call("max", square, ZERO)) for square in (place.square, place.least))
    return _Surface((a, b, c, d), (*centre, radius, *extents, least), place.square, sign, place.exists, bases)


def _inverse(data: Conic, inner: Binder) -> tuple[tuple[Expr, Expr], tuple[Expr, Expr]]:
    """Returns A of an ellipse of numbers, for points (u, v), u along the inner variable."""
    (a, b), (c, d) = [[float(cast(Const, e).data) for e in row] for row in data.inverse]
    if data.variables[0] is not inner.var:
        (a, b), (c, d) = (c, d), (a, b)
    whole = a * d - b * c
    return (const(d / whole), const(-b / whole)), (const(-c / whole), const(a / whole))
