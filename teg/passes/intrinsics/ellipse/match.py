"""Polynomials on one side of an ellipse over a box, and on the ellipse itself: moments by its chords and arcs.

    ∫∫ P(x, y)·[g(x, y) > 0] dx dy,   ∫∫ P(x, y)·δ(g(x, y)) dx dy        g = ±(κ - |A(x - c)|²),  A of numbers

Both are Σ c_jk·M_jk with the coefficients c_jk of P at a corner of the box and the moments M_jk of the region, or of the curve, which
depend on the centre c, the radius √κ and the extents of the box: one statement, `Ellipse`, for all integrals that share them. Without it
the outer integral has a break wherever the curve crosses a side, and square roots at the ends, and the curve is cut into four quarters.

A boundary term stands in an expression as an `Arcs`. It is made only where derivatives end, because it has no derivative. An outer
integral of it has a break wherever the curve goes through a corner of the box, or touches a side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.boxes import Coefficients, coefficients, nest_of_two
from teg.analysis.nest import Binder, Chain, nest
from teg.analysis.polynomial import distance
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.ir.expr import FALSE, TRUE, ZERO, Call, Cond, Const, Expr, call, const, integer_power, mul, sub, where
from teg.ir.integral import ClosedForm, Integral
from teg.ir.traverse import replace_node, substitute
from teg.passes.eliminate.conic import Conic, match_conic, place_of

MAX_DEGREE = 6
"""Of the polynomial along the curve; of the one inside it is two less, for the nodes along the arcs are the same."""
MAX_CONDITION = 1e3
"""The largest ratio of the axes: at the corners of a box that is seen by A no side may go straight on."""
Matrix = tuple[float, float, float, float]
Place = tuple[Expr, ...]
"""Both numbers of the centre about the corner of both lower bounds, the radius, the extents, and the least radius of a border."""


class Arcs(ClosedForm):
    """∫∫ over a box of Σ c·uʲvᵏ·δ(g), g = 0 an ellipse.

    A function of its place, of g at the corners of the box, of the least g along each side, and of the coefficients. Data are the matrix
    and the powers (j, k).
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        return "arcs"

    @property
    def matrix(self) -> Matrix:
        return cast(Matrix, self.data[0])

    @property
    def place(self) -> Place:
        return tuple(cast("Sequence[Expr]", self.children[:6]))

    @property
    def coefficients(self) -> Coefficients:
        powers = cast("tuple[tuple[int, int], ...]", self.data[1])
        return dict(zip(powers, self.terms, strict=True))

    @property
    def kinks(self) -> Sequence[Expr]:
        return cast("Sequence[Expr]", self.children[6:10])

    @property
    def births(self) -> Sequence[Expr]:
        return cast("Sequence[Expr]", self.children[10:14])

    @property
    def terms(self) -> Sequence[Expr]:
        return cast("Sequence[Expr]", self.children[14:])


@dataclass(frozen=True)
class Sides:
    """∫∫ over a box, of one polynomial in an ellipse and another one outside."""

    matrix: Matrix
    place: Place
    inside: Coefficients
    outside: Coefficients


def match_arcs(g: Expr, coefficient: Expr, chain: Chain, data: Conic) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) over a chain of integrals as those of a function of the place of the ellipse; None for other
    coefficients."""
    box = tuple(b for b in chain if b.var in data.variables)
    others = tuple(b for b in chain if b.var not in data.variables)
    inside, outside = set(data.variables), {b.var for b in others}
    if any(e.free & inside for b in chain for e in (b.lo, b.hi)) or any(e.free & outside for b in box for e in (b.lo, b.hi)):
        return None
    if _is_endless(box):
        return None
    found = coefficients(coefficient, box)
    if found is None or any(j + k > MAX_DEGREE for j, k in found):
        return None
    known = _placed(g, box, data)
    if known is None:
        return None
    matrix, place, exists = known
    arcs = Arcs.make((matrix, tuple(found)), (*place, *_corners(g, box), *_touching(matrix, place), *found.values()))
    return nest(where(exists, arcs, ZERO), others)


def _corners(g: Expr, box: Chain) -> list[Expr]:
    """Returns g at the corners of a box."""
    outer, inner = box
    return [cast(Expr, substitute(g, {inner.var: u, outer.var: v})) for u in (inner.lo, inner.hi) for v in (outer.lo, outer.hi)]


def _touching(matrix: Matrix, place: Place) -> list[Expr]:
    """Returns, for each side of the box, a function that is 0 where the ellipse touches its line."""
    (a, b, c, d), (u, v, radius, width, height, _) = matrix, place
    whole = a * d - b * c
    found = []
    for at, extent, (p, q) in ((u, width, (b, d)), (v, height, (a, c))):
        reach = mul(const((p * p + q * q) / (whole * whole)), _squared(radius))
        found += [sub(reach, integer_power(sub(side, at), 2)) for side in (ZERO, extent)]
    return found


def _squared(radius: Expr) -> Expr:
    """Returns κ of √max(κ, 0)."""
    inside = radius.children[0] if isinstance(radius, Call) and radius.name == "sqrt" else None
    return inside.children[0] if isinstance(inside, Call) and inside.name == "max" else integer_power(radius, 2)


def match_ellipse(node: Integral) -> Sides | None:
    """Returns an integral over a box of an integrand that is a polynomial on either side of an ellipse, or None."""
    if node.has_delta or is_unbounded(node) or (found := nest_of_two(node)) is None:
        return None
    chain, integrand = found
    outer, inner = chain
    if outer.var in inner.lo.free | inner.hi.free or _is_endless(chain):
        return None
    atoms = dict.fromkeys(a for b in chain for a in atoms_of(integrand, b.var))
    if len(atoms) != 1:
        return None
    (atom,) = atoms
    data = match_conic(atom.g, (inner.var, outer.var)) if atom.resolution is None else None
    if data is None or any(atoms_of(atom.g, b.var) for b in chain):
        return None
    above, below = (coefficients(cast(Expr, replace_node(integrand, atom, c)), chain) for c in (TRUE, FALSE))
    known = _placed(atom.g, chain, data)
    if above is None or below is None or known is None or any(j + k > MAX_DEGREE - 2 for j, k in (*above, *below)):
        return None
    matrix, place, _ = known
    return Sides(matrix, place, above, below) if data.sign > 0.0 else Sides(matrix, place, below, above)


def _is_endless(chain: Chain) -> bool:
    return any(isinstance(e, Const) and abs(e.data) == float("inf") for b in chain for e in (b.lo, b.hi))


def _placed(g: Expr, chain: Chain, data: Conic) -> tuple[Matrix, Place, Cond] | None:
    """Returns the matrix and the place of an ellipse, and the condition under which there is a curve; None if it is too long."""
    outer, inner = chain
    matrix = _matrix(data, inner)
    place = place_of(g, chain, data) if matrix is not None else None
    if matrix is None or place is None:
        return None
    radius = call("sqrt", call("max", place.square, ZERO))
    numbers = (
        sub(place.centre[inner.var], inner.lo),
        sub(place.centre[outer.var], outer.lo),
        radius,
        distance(inner.lo, inner.hi),
        distance(outer.lo, outer.hi),
        call("sqrt", call("max", place.least, ZERO)),
    )
    return matrix, numbers, place.exists


def _matrix(data: Conic, inner: Binder) -> Matrix | None:
    """Returns A for points (u, v), u along the inner variable, with a positive determinant; None if one axis is much longer."""
    (a, b), (c, d) = data.inverse
    if data.variables[0] is not inner.var:
        (a, b), (c, d) = (c, d), (a, b)
    whole = a * d - b * c
    sizes, product = a * a + b * b + c * c + d * d, abs(whole)
    if not product > 0.0 or not sizes <= MAX_CONDITION * product:
        return None
    turn = 1.0 if whole > 0.0 else -1.0
    return d / whole, -b / whole, -turn * c / whole, turn * a / whole
