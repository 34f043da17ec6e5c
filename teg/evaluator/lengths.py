"""The kernels of one program: those for any lengths of its arrays, or, where lengths must be known, those for the lengths of each call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from teg.errors import ArrayIndexError, ParameterError
from teg.evaluator.arguments import Call, read_call
from teg.evaluator.counting import Counting
from teg.evaluator.kept import Kept
from teg.evaluator.kernels import Kernels
from teg.evaluator.options import Options
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import VALUE, Wanted, directions_of
from teg.ir.arrays import Array, has_arrays
from teg.ir.cells import with_lengths
from teg.ir.expr import Expr, Param
from teg.ir.index import ArrayName
from teg.passes.differentiate.through_sums import Parameter, outlined
from teg.passes.normalise.sums import NeedsLengths

KEPT = 16
"""The number of plans kept for different lengths of arrays, if lengths must be known."""


class Lengths:
    """Finds the kernels of a program for the arrays of a call. `leaves` are its parameters and arrays, `integers` the names of those that
    count."""

    def __init__(
        self, program: Expr, wrt: tuple[Parameter, ...], leaves: Sequence[Param | ArrayName], integers: frozenset[str], options: Options
    ) -> None:
        self.program, self._wrt, self._options = program, wrt, options
        self._leaves, self._integers = tuple(leaves), integers
        self._made: Kept[tuple[tuple[int, ...], tuple[int, ...]], Kernels] = Kept(KEPT)
        self._counting: Kept[None, Counting] = Kept(1)
        self.any: Kernels | None = None  # for any lengths
        try:
            self.any = self._compiled(program)
            self.any.prepare(VALUE)
        except NeedsLengths:
            self.any = None

    @property
    def some(self) -> Kernels | None:
        """The kernels for any lengths, or else those for the lengths of the first call; None before there are any."""
        return self.any or self._made.first()

    def required(self) -> Kernels:
        """Returns the kernels for any lengths of arrays. Raises ArrayIndexError if there are none."""
        if self.any is None:
            hint = "give the sum inside the integral a range of numbers, or write the integral inside the sum"
            raise ArrayIndexError("this program is made for the lengths of its arrays, and these are not known", self.program, hint)
        return self.any

    def read(self, wanted: Wanted, given: Mapping[str, Any]) -> tuple[Call, Kernels]:
        """Returns the call with these values, and the kernels for its lengths."""
        if not wanted.along and self.any is not None:
            return read_call(self._leaves, given, self._integers, self._options.dtype), self.any
        along = {p: q for direction in directions_of(wanted, self._leaves) for p, q in direction.items()}
        every = [*self._leaves, *along.values()]
        call = read_call(every, given, self._integers, self._options.dtype)
        shapes = dict(zip([p for p in every if isinstance(p, ArrayName)], call.shapes, strict=True))
        for p, d in along.items():
            if isinstance(p, Array) and isinstance(d, Array) and shapes[p] != shapes[d]:
                raise ParameterError(f"the direction along {p.name} has the shape {shapes[d]}, {p.name} has {shapes[p]}")
        if self.any is None or self.any.plan.needs_lengths(wanted):
            return call, self._for_lengths(shapes, given)
        return call, self.any

    def _for_lengths(self, shapes: Mapping[ArrayName, tuple[int, ...]], given: Mapping[str, Any]) -> Kernels:
        """Returns the kernels for these lengths of arrays, and for so many candidates as are given."""
        counting = self._counting.get(None, lambda: Counting(self.program))
        counts = counting.of(given)

        def made() -> Kernels:
            try:
                return self._compiled(with_lengths(counting.bounded(counts), shapes))
            except NeedsLengths as request:  # pragma: no cover: the lengths are numbers now
                raise ArrayIndexError(str(request), request.node) from None

        lengths = tuple(n for a, shape in shapes.items() if a in self._leaves for n in shape)
        return self._made.get((lengths, counts), made)

    def _compiled(self, e: Expr) -> Kernels:
        source = self._options.estimator.source_of(e)
        edges = self._options.estimator.name == "exact"
        if not has_arrays(self.program):
            return Kernels(Plan(e, self._options, self._wrt, self._leaves))
        return Kernels(Plan(outlined(e, edges), self._options, self._wrt, self._leaves, (), None if source is None else outlined(source)))
