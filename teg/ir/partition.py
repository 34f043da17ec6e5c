"""Partitions: integrals of the polynomial of the nearest candidate, by the numbers of each candidate.

e ::= … | partition[k: i..i](e, …)      ∫∫ over the unit square; `teg.numerics.cells` says which numbers these are
d ::= … | pullback[k: i..i](e, …; e, …) in derivatives: Σ weight·partition, whose weights have no derivative
      | seensum[k: i..i](e; d)          Σ over the candidates that a pullback has derivatives by
"""

from __future__ import annotations

from typing import cast

from teg.ir.arrays import Ranged, Sum
from teg.ir.expr import Expr
from teg.ir.index import Index, IndexVar
from teg.ir.node import Node
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


class Pullback(Ranged, Expr):
    """Σ weight·partition, of which only derivatives are used (`Slope`); data are (index, lo, hi, layout).

    Children: partitions with the same candidates, forms and layout, then a weight for each, which counts as a constant. A slope by a
    form is Σ weight·(slope of the partition). A slope by a coefficient is that of any one partition: the moment of its monomial. So one
    table of derivatives does for all partitions, and cells are not measured for each of them.
    """

    __slots__ = ()

    @property
    def layout(self) -> Layout:
        return cast(Layout, self.data[3])

    @property
    def partitions(self) -> tuple[Partition, ...]:
        return cast("tuple[Partition, ...]", self.children[: len(self.children) // 2])

    @property
    def weights(self) -> tuple[Expr, ...]:
        return cast("tuple[Expr, ...]", self.children[len(self.children) // 2 :])


class SeenSum(Sum):
    """A sum over candidates that is 0 at those by whose numbers a `Pullback` has no derivatives; children are (body, pullback)."""

    __slots__ = ()

    def over(self, children: tuple[Node, ...], k: IndexVar, lo: Index, hi: Index) -> Node:
        return type(self).make((k, lo, hi), cast("tuple[Expr, ...]", children))

    @property
    def pullback(self) -> Pullback:
        return cast(Pullback, self.children[1])
