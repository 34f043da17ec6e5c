"""Surfaces that are one surface up to a factor."""

from __future__ import annotations

from teg.analysis.polynomial import Point
from teg.ir.expr import Expr
from teg.numerics.field import divided, sign_of_residue


class Proportional:
    """The functions met so far, of which the first of those that are proportional by a number stands for all."""

    def __init__(self) -> None:
        self.points = (Point("first"), Point("second"))
        self._known: dict[int, Expr] = {}

    def copied(self) -> Proportional:
        """Returns the same functions, to which others are added apart. Both share values of functions."""
        other = Proportional()
        other.points, other._known = self.points, dict(self._known)
        return other

    def representative(self, g: Expr) -> tuple[Expr, bool]:
        """Returns the function that stands for the surface, and whether it has the sign of g."""
        first, second = (p.value(g) for p in self.points)
        if first and second:
            key = divided(second, first)
            known = self._known.setdefault(key, g)
            if known is not g and known.free <= g.free:
                other = self.points[0].value(known)
                sign = sign_of_residue(divided(first, other)) if other else None
                if sign is not None:
                    return known, sign > 0
        return g, True
