"""Surfaces that are one surface up to a factor."""

from __future__ import annotations

from typing import cast

from teg.analysis.polynomial import Point
from teg.ir.expr import MINUS_ONE, Expr
from teg.ir.simplify import mul
from teg.numerics.field import P, divided, sign_of_residue


class Proportional:
    """The functions met so far, of which the first of those that are proportional by a number stands for all."""

    def __init__(self) -> None:
        self.points = (Point("first"), Point("second"))
        self._known: dict[int, Expr] = {}

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

    def equal(self, g: Expr) -> Expr:
        """Returns a function met before that is equal to g or -g, times 1 or -1; g if there is none."""
        first, second = (p.value(g) for p in self.points)
        known = self._known.get(divided(second, first), g) if first and second else g
        if known is g or known.free != g.free:
            return g
        other = self.points[0].value(known)
        if other == first:
            return known
        return mul(MINUS_ONE, known) if other == -cast(int, first) % P else g
