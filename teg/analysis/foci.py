"""Borders between two distances and a number: K·(|z - p| - |z - q| + c) in two variables z, with the foci p and q."""

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
from teg.ir.expr import MINUS_ONE, ZERO, Cond, Expr, Var, const
from teg.ir.node import Node
from teg.ir.simplify import add, call, div, integer_power, mul, positive, sub
from teg.ir.traverse import fresh, substitute

Vector = tuple[Expr, Expr]


class Border(NamedTuple):
    """K·(|z - p| - |z - q| + c): `scale` is K, `focus` p, `apart` q - p, and `shift` c."""

    scale: Expr
    focus: Vector
    apart: Vector
    shift: Expr

    @property
    def opened(self) -> Expr:
        """Returns |q - p|² - c², which is positive if neither distance is everywhere the larger one."""
        return sub(_dot(self.apart, self.apart), integer_power(self.shift, 2))

    def ahead(self, direction: Vector) -> Expr:
        """Returns c + e·(q - p), which is positive where a ray from p in the direction e meets the border."""
        return add(self.shift, _dot(direction, self.apart))

    def about(self, focus: Vector, variables: tuple[Var, Var]) -> Expr:
        """Returns the function of a border whose focus p is written in another way."""
        foci = focus, cast(Vector, tuple(map(add, self.focus, self.apart)))
        near, far = (call("sqrt", add(*(integer_power(sub(x, e), 2) for x, e in zip(variables, at, strict=True)))) for at in foci)
        return mul(self.scale, add(near, mul(MINUS_ONE, far), self.shift))


def borders_of(g: Expr, variables: tuple[Var, Var]) -> tuple[Border, Border] | None:
    """Returns a border about the one focus and about the other one; None for other functions."""
    found = radical(g)
    if found is None or len(found.roots) != 2 or found.rest.free:
        return None
    (k, u), (j, w) = found.roots
    lead, other = square_of(u, variables), square_of(w, variables)
    if lead is None or other is None or not (is_null(add(k, j)) and is_null(sub(lead, other))):
        return None
    p, q = (_centre(under, lead, variables) for under in (u, w))
    if p is None or q is None:
        return None
    scale = mul(k, call("sqrt", lead))
    apart = sub(q[0], p[0]), sub(q[1], p[1])
    back = mul(MINUS_ONE, apart[0]), mul(MINUS_ONE, apart[1])
    shift = bounded_quotient(found.rest, scale)
    return Border(scale, p, apart, shift), Border(mul(MINUS_ONE, scale), q, back, mul(MINUS_ONE, shift))


def square_of(g: Expr, variables: tuple[Var, Var]) -> Expr | None:
    """Returns A of a function A·(x² + y²) + (terms of degree 1), which depends on parameters only; None for others."""
    degree = Shadow(variables).degree(g)
    if degree is None or degree > 2:
        return None
    x, y = variables
    try:
        a, b, c = slope(slope(g, x), x), slope(slope(g, x), y), slope(slope(g, y), y)
    except NotDifferentiableError:
        return None
    round_ = not (a.free | b.free | c.free) and is_null(b) and is_null(sub(a, c))
    return mul(const(0.5), a) if round_ else None


def _centre(square: Expr, lead: Expr, variables: tuple[Var, Var]) -> Vector | None:
    """Returns the place where a multiple of a squared distance is 0; None for other circles."""
    origin = dict.fromkeys(variables, ZERO)
    a, b = (div(cast(Expr, substitute(slope(square, x), origin)), mul(const(-2.0), lead)) for x in variables)
    return (a, b) if is_null(cast(Expr, substitute(square, dict(zip(variables, (a, b), strict=True))))) else None


def with_common_focus(condition: Cond, g: Expr, variables: tuple[Var, Var]) -> tuple[Cond, tuple[Var, Var], Vector] | None:
    """Returns a condition whose borders share a focus with that of g, with variables in the place of this focus; these; and the focus. None
    if g is no such border, or there is no such focus."""
    symbols = Symbols()
    edge, cell = symbols.into([g, cast(Expr, condition)])
    mine = borders_of(edge, variables)
    atoms = {atom: found for atom in atoms_of(cell) if (found := borders_of(atom.g, variables)) is not None}
    for border in mine or ():
        shared = {atom: [b for b in found if b.focus == border.focus] for atom, found in atoms.items()}
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


def _dot(a: Sequence[Expr], b: Sequence[Expr]) -> Expr:
    return add(mul(a[0], b[0]), mul(a[1], b[1]))
