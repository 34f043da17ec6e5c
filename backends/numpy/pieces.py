"""Pieces of integrals that are computed side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from teg.backends.numpy.lanes import Array, Run, Value, gather
from teg.backends.shared.bends import Substitution


@dataclass(frozen=True, slots=True)
class Pieces:
    """Pieces in one run: their substitutions, the values that blocks take from outside, each one for all pieces or one a piece, and whether
    they have neighbours at their first and at their last end, for a rule that asks."""

    run: Run
    places: Substitution
    values: Sequence[Value]
    neighbours: tuple[Value, Value] = (False, False)

    def part(self, index: Array) -> Pieces:
        """Returns some of the pieces."""
        first, last = (gather(v, index) for v in self.neighbours)
        return replace(self, places=self.places.part(index), values=[gather(v, index) for v in self.values], neighbours=(first, last))
