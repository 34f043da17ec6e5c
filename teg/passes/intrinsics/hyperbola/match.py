"""Polynomials on one side of a bilinear surface over a box, and on the surface itself: moments in closed form.

    ∫∫ P(x, y)·[g(x, y) > 0] dx dy,   ∫∫ P(x, y)·δ(g(x, y)) dx dy        g = g₀ + b·x + c·y + d·xy

On the box scaled to the unit square both are Σ c_jk·M_jk with the coefficients c_jk of P at a corner and the moments M_jk of the region,
or of the curve, which depend on the four values of g at the corners (`teg.numerics.moments`). All integrals that share these values
share the crossings of the curve with the sides and the logarithm of each branch: one statement, `Hyperbola`.

A boundary term stands in an expression as a `Border` of the corner values and the coefficients. It is made only where derivatives end,
because it has no derivative. P has at most degree 3 in each variable (2 in the region), so that no moment costs digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

from teg.analysis.boxes import Coefficients, coefficients, nest_of_two
from teg.analysis.expanded import distance
from teg.analysis.nest import Chain
from teg.analysis.polynomial import Shadow
from teg.analysis.surfaces import atoms_of
from teg.analysis.tails import is_unbounded
from teg.ir.expr import FALSE, TRUE, ZERO, Const, Expr
from teg.ir.integral import ClosedForm, Integral
from teg.ir.show import show
from teg.ir.simplify import mul
from teg.ir.traverse import replace_node, substitute

MAX_BORDER, MAX_INSIDE = 3, 2
Corners = tuple[Expr, Expr, Expr, Expr]
"""The values of g, counterclockwise from the corner of both lower bounds, x being the inner variable."""


class Border(ClosedForm):
    """∫∫ over the unit square of Σ c·uʲvᵏ·δ(g), g affine in u and in v.

    A function of the values of g at the corners, counterclockwise from (0, 0), and of the coefficients. Data are a text for g = 0, one
    for each side, and the powers (j, k). It has no derivative.
    """

    __slots__ = ()

    @property
    def name(self) -> str:
        return "border"

    @property
    def corners(self) -> Corners:
        return cast(Corners, self.children[:4])

    @property
    def coefficients(self) -> Coefficients:
        powers = cast("tuple[tuple[int, int], ...]", self.data[2])
        values = cast("Sequence[Expr]", self.children[4:])
        return {p: c for p, c in zip(powers, values, strict=True) if c is not ZERO}

    @property
    def rivals(self) -> list[tuple[str, str]]:
        """Returns the possible ties: the surface and each side, which begins at the corner of its number."""
        return [(self.data[0], bound) for bound in self.data[1]]


@dataclass(frozen=True)
class Sides:
    """area·∫∫ over the unit square, of one polynomial where g > 0 and another one elsewhere."""

    corners: Corners
    above: Coefficients
    below: Coefficients
    area: Expr


def match_border(g: Expr, coefficient: Expr, chain: Chain) -> Expr | None:
    """Returns ∫∫ coefficient·δ(g) over a chain of two integrals, as a function of the values of g at the corners; None
    for other surfaces."""
    if len(chain) != 2 or not _is_bilinear(g, chain) or any(e.free for b in chain for e in (b.lo, b.hi)):
        return None
    if any(isinstance(e, Const) and abs(e.data) == float("inf") for b in chain for e in (b.lo, b.hi)):
        return None
    found = _coefficients(coefficient, chain, MAX_BORDER)
    if found is None:
        return None
    corners = _corners(g, chain)
    if all(isinstance(e, Const) for e in corners):
        return None
    outer, inner = chain
    sides = ((outer.var, outer.lo), (inner.var, inner.hi), (outer.var, outer.hi), (inner.var, inner.lo))
    bounds = tuple(f"the bound {v.name} = {show(e, 300)}" for v, e in sides)
    border = Border.make((f"{show(g, 300)} = 0", bounds, tuple(found)), (*corners, *found.values()))
    return mul(_area(chain), border)


def match_hyperbola(node: Integral) -> Sides | None:
    """Returns a closed integral over a box of an integrand that is a polynomial on either side of a bilinear surface, or None."""
    if node.free or node.has_delta or is_unbounded(node):
        return None
    found = nest_of_two(node)
    if found is None:
        return None
    chain, terms = found
    if any(e.free for b in chain for e in (b.lo, b.hi)):
        return None
    atoms = dict.fromkeys(a for b in chain for a in atoms_of(terms, b.var))
    if len(atoms) != 1:
        return None
    (atom,) = atoms
    if atom.resolution is not None or not _is_bilinear(atom.g, chain):
        return None
    above, below = (_coefficients(cast(Expr, replace_node(terms, atom, c)), chain, MAX_INSIDE) for c in (TRUE, FALSE))
    corners = _corners(atom.g, chain)
    if above is None or below is None or all(isinstance(e, Const) for e in corners):
        return None
    return Sides(corners, above, below, _area(chain))


def _is_bilinear(g: Expr, chain: Chain) -> bool:
    """Returns whether g is affine in each variable, with a mixed term, and depends on parameters otherwise."""
    variables = tuple(b.var for b in chain)
    if g.has_integral or g.has_delta or not g.free <= set(variables) or any(atoms_of(g, v) for v in variables):
        return False
    poly = Shadow(variables).polynomial(g)
    return poly is not None and (1, 1) in poly and all(max(m) <= 1 for m in poly)


def _corners(g: Expr, chain: Chain) -> Corners:
    outer, inner = chain
    places = ((inner.lo, outer.lo), (inner.hi, outer.lo), (inner.hi, outer.hi), (inner.lo, outer.hi))
    return cast(Corners, tuple(substitute(g, {inner.var: u, outer.var: v}) for u, v in places))


def _area(chain: Chain) -> Expr:
    return mul(*(distance(b.lo, b.hi) for b in chain))


def _coefficients(e: Expr, chain: Chain, most: int) -> Coefficients | None:
    """Returns the coefficients of a polynomial of low degree in each variable; None for others."""
    found = coefficients(e, chain, scaled=True) if e.free <= {b.var for b in chain} else None
    return None if found is None or any(max(powers) > most for powers in found) else found
