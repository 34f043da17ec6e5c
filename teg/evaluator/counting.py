"""How many candidates a call has: the largest lengths of ranges that are data, where a program must have places for them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from teg.analysis.settings import Integration
from teg.evaluator.arguments import read_call
from teg.evaluator.kernels import Kernels
from teg.evaluator.options import Jumps, Machine, Options
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import VALUE
from teg.ir.arrays import arrays_of, integer_parameters
from teg.ir.cells import indices_apart
from teg.ir.expr import Expr, Param
from teg.ir.index import ArrayName
from teg.ir.simplify import tuple_of
from teg.passes.differentiate.through_sums import outlined
from teg.passes.normalise.padded import longest, ranges_of_data, with_most


class Counting:
    """The ranges of a program whose lengths are data, and the program that finds the largest ones: it has integers only.

    `names` are the integer parameters and arrays that it depends on; of an array of numbers the shape only.
    """

    def __init__(self, program: Expr) -> None:
        self._program = indices_apart(program)
        self._ranges = ranges_of_data(self._program)
        counted = tuple_of(*longest(self._program, self._ranges))
        integers = integer_parameters(counted)
        self._leaves: list[Param | ArrayName] = [*integers, *arrays_of(counted)]
        self._integers = frozenset(p.name for p in integers)
        self.names = tuple(p.name for p in self._leaves)
        options = Options(Machine("numpy"), Integration(), "ignore", "float64", Jumps("exact"))
        self._kernels = Kernels(Plan(outlined(counted), options, (), self._leaves)) if self._ranges else None

    def of(self, given: Mapping[str, Any]) -> tuple[int, ...]:
        """Returns the largest length of each range, over a batch too. Raises ArrayIndexError for a range that ends before it begins, or
        subscripts outside of their arrays."""
        if self._kernels is None:
            return ()
        call = read_call(self._leaves, {name: given[name] for name in self.names}, self._integers)
        return tuple(int(found.max(initial=0)) for found in self._kernels.results(VALUE, call, lambda: ["a length"] * len(self._ranges)))

    def bounded(self, counts: tuple[int, ...]) -> Expr:
        """Returns the program with ranges that are at most so long."""
        return with_most(self._program, dict(zip(self._ranges, counts, strict=True)))


def zeros(shape: tuple[int, ...]) -> Any:
    """Returns an array in the place of one of which the shape counts only."""
    import numpy as np

    return np.broadcast_to(0.0, shape)
