"""Partitions: integrals of the polynomial of the nearest candidate, by the numbers of each candidate.

e ::= … | partition[k: i..i](e, …)      ∫∫ over the unit square; `teg.numerics.cells` says which numbers these are
"""

from __future__ import annotations

from typing import cast

from teg.ir.arrays import Ranged
from teg.ir.expr import Expr
from teg.numerics.cells import Layout


class Partition(Ranged, Expr):
    """∫∫ over the unit square of the polynomial that belongs to the nearest candidate; data are (index, lo, hi, layout).

    Children: the numbers of a candidate (with `order` 1, and their direction), the coefficients that count where there is no candidate
    (and their direction). A candidate is present where all guards of one of its parts are >= 0.
    """

    __slots__ = ()

    @property
    def layout(self) -> Layout:
        return cast(Layout, self.data[3])

    @property
    def candidate(self) -> tuple[Expr, ...]:
        """Returns the numbers of a candidate, and their direction."""
        return cast("tuple[Expr, ...]", self.children[: self.layout.columns * (1 + self.layout.order)])

    @property
    def otherwise(self) -> tuple[Expr, ...]:
        """Returns the coefficients where there is no candidate, and their direction."""
        return cast("tuple[Expr, ...]", self.children[self.layout.columns * (1 + self.layout.order) :])
