"""Borders between two distances and a number: K·(|z - p| - |z - q| + c) in two variables z, with the foci p and q. The axes of the box may
count differently in both distances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

from teg.analysis.calculus import slope
from teg.analysis.distances import bounded_quotient
from teg.analysis.polynomial import Shadow, is_null
from teg.analysis.radicals import radical
from teg.analysis.surfaces import atoms_of
from teg.errors import NotDifferentiableError
from teg.ir.cells import Symbols, replaced
from teg.ir.expr import MINUS_ONE, ONE, ZERO, Cond, Expr, Var, const
from teg.ir.node import Node
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub
from teg.ir.traverse import fresh, substitute

Vector = tuple[Expr, Expr]


class Border(NamedTuple):
    """K·(|z - p| - |z - q| + c): `scale` is K, `focus` p, and `shift` c.

    |z| is √(x² + κy²), the length of Lz = (x, √κ·y). `ratio` is κ, `apart` L(q - p).
    """

    scale: Expr
    focus: Vector
    apart: Vector
    shift: Expr
    ratio: Expr

    @property
    def opened(self) -> Expr:
        """Returns |q - p|² - c², which is positive if neither distance is everywhere the larger one."""
        return sub(_dot(self.apart, self.apart), integer_power(self.shift, 2))

    @property
    def stretch(self) -> Expr:
        """Returns √κ, the determinant of L."""
        return _root(self.ratio)

    def ahead(self, direction: Vector) -> Expr:
        """Returns c + e·L(q - p), which is positive where a ray from p in the direction L⁻¹e meets the border."""
        return add(self.shift, _dot(direction, self.apart))

    def back(self, direction: Vector) -> Vector:
        """Returns L⁻¹e."""
        return direction[0], div(direction[1], self.stretch)

    def about(self, focus: Vector, variables: tuple[Var, Var]) -> Expr:
        """Returns the function of a border whose focus p is written in another way."""
        away = sub(variables[0], focus[0]), sub(variables[1], focus[1])
        further = self.back(self.apart)
        beyond = sub(away[0], further[0]), sub(away[1], further[1])
        return mul(self.scale, add(self._length(away), mul(MINUS_ONE, self._length(beyond)), self.shift))

    def _length(self, z: Vector) -> Expr:
        return call("sqrt", add(integer_power(z[0], 2), mul(self.ratio, integer_power(z[1], 2))))


def borders_of(g: Expr, variables: tuple[Var, Var]) -> tuple[Border, Border] | None:
    """Returns a border about the one focus and about the other one; None for other functions."""
    found = radical(g)
    if found is None or len(found.roots) != 2 or found.rest.free:
        return None
    (k, u), (j, w) = found.roots
    entries, others = _entries(u, variables), _entries(w, variables)
    if entries is None or others is None or not is_null(add(k, j)) or not all(map(is_null, map(sub, entries, others))):
        return None
    p, q = (_centre(under, entries, variables) for under in (u, w))
    if p is None or q is None:
        return None
    lead, last = entries
    ratio = ONE if is_null(sub(lead, last)) else div(last, lead)
    scale = mul(k, call("sqrt", lead))
    apart = sub(q[0], p[0]), mul(_root(ratio), sub(q[1], p[1]))
    back = mul(MINUS_ONE, apart[0]), mul(MINUS_ONE, apart[1])
    shift = bounded_quotient(found.rest, scale)
    return Border(scale, p, apart, shift, ratio), Border(mul(MINUS_ONE, scale), q, back, mul(MINUS_ONE, shift), ratio)


def square_of(g: Expr, variables: tuple[Var, Var]) -> Expr | None:
    """Returns A of a function A·(x² + y²) + (terms of degree 1), which depends on parameters only; None for others."""
    entries = _entries(g, variables)
    return entries[0] if entries is not None and is_null(sub(*entries)) else None


def _entries(g: Expr, variables: tuple[Var, Var]) -> Vector | None:
    """Returns a and c of a function a·x² + c·y² + (terms of degree 1), which depend on parameters only; None for others."""
    degree = Shadow(variables).degree(g)
    if degree is None or degree > 2:
        return None
    x, y = variables
    try:
        a, b, c = (mul(const(0.5), e) for e in (slope(slope(g, x), x), slope(slope(g, x), y), slope(slope(g, y), y)))
    except NotDifferentiableError:
        return None
    return None if a.free | b.free | c.free or not is_null(b) else (a, c)


def _root(ratio: Expr) -> Expr:
    return ONE if ratio is ONE else call("sqrt", ratio)


def _centre(square: Expr, entries: Vector, variables: tuple[Var, Var]) -> Vector | None:
    """Returns the place where a multiple of a squared distance is 0; None for other ellipses."""
    origin = dict.fromkeys(variables, ZERO)
    a, b = (div(cast(Expr, substitute(slope(square, x), origin)), mul(const(-2.0), e)) for x, e in zip(variables, entries, strict=True))
    return (a, b) if is_null(cast(Expr, substitute(square, dict(zip(variables, (a, b), strict=True))))) else None


def with_common_focus(condition: Cond, g: Expr, variables: tuple[Var, Var]) -> tuple[Cond, tuple[Var, Var], Vector] | None:
    """Returns a condition whose borders share a focus with that of g, with variables in the place of this focus; these; and the focus. None
    if g is no such border, or there is no such focus."""
    symbols = Symbols()
    edge, cell = symbols.into([g, cast(Expr, condition)])
    mine = borders_of(edge, variables)
    atoms = {atom: found for atom in atoms_of(cell) if (found := borders_of(atom.g, variables)) is not None}
    for border in mine or ():
        shared = {atom: [b for b in found if _is_same(b, border)] for atom, found in atoms.items()}
        if shared and all(shared.values()):
            first = fresh("focus", variables)
            names = first, fresh("focus", [*variables, first])
            news: dict[Node, Expr] = {}
            for atom, (other, *_) in shared.items():
                moved = positive(other.about(names, variables), atom.strict, atom.resolution, atom.rivals)
                news[atom] = cast(Expr, moved)
            (cell, *focus) = symbols.out_of([*replaced([cell], news), *border.focus])
            return cast(Cond, cell), names, (focus[0], focus[1])
    return None


def _is_same(one: Border, other: Border) -> bool:
    """Returns whether two borders share a focus and a metric."""
    return all(is_null(sub(u, v)) for u, v in zip((*one.focus, one.ratio), (*other.focus, other.ratio), strict=True))


def _dot(a: Sequence[Expr], b: Sequence[Expr]) -> Expr:
    return add(mul(a[0], b[0]), mul(a[1], b[1]))
