"""The programs of a function and of its derivatives of any order, compiled for the C or the NumPy backend, on arrays of NumPy."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

from teg.analysis.settings import Integration, with_more_room
from teg.evaluator.accuracy import has_samples, report_missed, report_not_a_number
from teg.evaluator.arguments import Call, whole_numbers
from teg.evaluator.array_plan import build_arrays
from teg.evaluator.compile import build_kernel
from teg.evaluator.derivative_programs import DerivativePrograms
from teg.evaluator.framework import dimensions_of
from teg.ir import expr as ex
from teg.ir.expr import Param
from teg.ir.index import ArrayName
from teg.maps.checks import MapChecks
from teg.program import Program
from teg.program.arrays import ArrayProgram

if TYPE_CHECKING:
    import numpy as np


class DerivativeKernels:
    """The programs of a plan as functions of NumPy arrays, each compiled when it is first needed. Safe to share between threads.

    `operands` of a run are the leaves of the plan, its integers, and then those of each direction, `moving` of them: float64, but for
    arrays of indices; each of its own shape (`dimensions` says of how many axes) where the batch shares it, else with an axis n in front.
    """

    def __init__(self, plan: DerivativePrograms) -> None:
        self.plan = plan
        self.moving, self.entries = len(plan.wrt), len(plan.entries)
        self.dimensions = tuple(dimensions_of(p) for p in (*plan.leaves, *plan.integers))
        self._kernels: dict[tuple[int, int | None, bool], Any] = {}
        self._sampled: dict[tuple[int, int | None], bool] = {}
        self._room: dict[tuple[int, int | None, bool], Integration] = {}  # of what met more roots than there was room for
        self._checks: Any = None
        self._lock = threading.RLock()

    def run(self, order: int, entry: int | None, operands: Sequence[Any], n: int) -> list[Any]:
        """The results of the program of an order, of all values or of one entry (`DerivativePrograms.program`): float64, (n,) for a number,
        (n, *shape) for what is shaped like an array.

        Raises ArrayIndexError where an index is out of its range, DiffeomorphismError where a map of the user's is none for these values.
        Where a tolerance was missed it warns, or raises AccuracyError, as the plan's options say.
        """
        import numpy as np

        leaves, integers = self.plan.leaves, self.plan.integers
        given = len(leaves) + len(integers)
        names: list[Param | ArrayName] = [*leaves, *self.plan.wrt * max(order, 0)]
        values = [*operands[: len(leaves)], *operands[given:]]
        columns = [v for p, v in zip(names, values, strict=True) if isinstance(p, Param)] + list(operands[len(leaves) : given])
        arrays = [v for p, v in zip(names, values, strict=True) if isinstance(p, ArrayName)]
        batched = any(
            v.ndim > dimensions_of(p) for p, v in zip((*names, *integers), (*values, *operands[len(leaves) : given]), strict=True)
        )
        elements = n if batched else 1
        found = self._results(order, entry, columns, arrays, elements)
        return found if elements == n else [np.repeat(v, n, axis=0) for v in found]

    def _results(self, order: int, entry: int | None, columns: Sequence[Any], arrays: Sequence[Any], n: int) -> list[Any]:
        options = self.plan.options
        kernel = self._kernel(order, entry)
        program = kernel.program
        if isinstance(program, ArrayProgram):
            self._check_ranges(program, columns, arrays)
        if order <= 0 and options.maps and options.check_maps:
            self._check_maps(columns, arrays, n)
        missed, crowded, found = self._outcome((order, entry, False), columns, arrays, n)
        if options.inaccurate != "ignore":
            sampled, told, names = self._is_sampled(order, entry, program), False, self._names(order, entry)
            shapes = [v.shape[v.ndim - a.dimensions :] for a, v in zip(getattr(program, "arrays", ()), arrays, strict=True)]
            call = Call(list(program.parameters), list(columns), list(arrays), n, (n,), shapes, {})
            if missed or sampled:
                both = self._outcome((order, entry, True), columns, arrays, n)[2]
                half, how = len(both) // 2, (options.integration.tol, options.inaccurate)
                told = report_missed(both[:half], both[half:], names, call, how, sampled)
            if not told:
                report_not_a_number(found, names, call, options.inaccurate, crowded)
        return found

    def _outcome(
        self, key: tuple[int, int | None, bool], columns: Sequence[Any], arrays: Sequence[Any], n: int
    ) -> tuple[bool, bool, list[np.ndarray]]:
        """Whether a tolerance was missed, whether there was too little room for roots, and the results; as long as one is no number for the
        latter, the program is made again with more room."""
        import numpy as np

        while True:
            missed, crowded, found = _outcome(self._kernel(*key), columns, arrays, n)
            if not crowded or not any(np.isnan(v).any() for v in found):
                return missed, crowded, found
            with self._lock:
                wider = with_more_room(self._room.get(key, self.plan.options.integration))
                if wider is None:
                    return missed, crowded, found
                self._room[key] = wider
                self._kernels.pop(key, None)

    def _kernel(self, order: int, entry: int | None, errors: bool = False) -> Any:
        with self._lock:
            key = order, entry, errors
            if key not in self._kernels:
                program = self.plan.program(order, entry, errors, self._room.get(key))
                build = build_arrays if isinstance(program, ArrayProgram) else build_kernel
                self._kernels[key] = cast(Any, build)(program, self.plan.options)
            return self._kernels[key]

    def _check_ranges(self, program: ArrayProgram, columns: Sequence[Any], arrays: Sequence[Any]) -> None:
        from teg.backends.plan import check_ranges

        count = len(self.plan.integers)
        first = len(columns) - count
        integers = {first + k: whole_numbers(p.name, columns[first + k]) for k, p in enumerate(self.plan.integers)}
        shapes = [v.shape[v.ndim - a.dimensions :] for v, a in zip(arrays, program.arrays, strict=True)]
        check_ranges(program, integers, arrays, shapes)

    def _check_maps(self, columns: Sequence[Any], arrays: Sequence[Any], n: int) -> None:
        """The maps of the user's are verified for these values of parameters and arrays."""
        plan = self.plan
        scalars = [p.name for p in (*plan.leaves, *plan.integers) if isinstance(p, Param)]
        named = [p for p in plan.leaves if isinstance(p, ArrayName)]
        e = plan.entries[0] if self.entries == 1 else ex.tuple_of(*plan.entries)
        with self._lock:
            if self._checks is None:
                self._checks = MapChecks(e, plan.options.maps)
        self._checks.run(dict(zip(scalars, columns, strict=True)), dict(zip(named, arrays, strict=True)), n)

    # -- reports -------------------------------------------------------------------------------------------------------

    def _is_sampled(self, order: int, entry: int | None, program: Program | ArrayProgram) -> bool:
        """Whether samples are taken that nobody asked for: they rarely reach a tolerance."""
        key = order, entry
        if key not in self._sampled:
            self._sampled[key] = self.plan.options.integration.rule == "auto" and has_samples(program)
        return self._sampled[key]

    def _names(self, order: int, entry: int | None) -> list[str]:
        """What each result is, for messages."""
        if order > 0:
            return [f"the derivative of order {order + 1} by {p.name}" for p in self.plan.wrt]
        values = ["the value"] * self.entries
        return values if order < 0 else [*values, *[f"the derivative by {p.name}" for p in self.plan.wrt] * self.entries]


def _outcome(kernel: Any, columns: Sequence[Any], arrays: Sequence[Any], n: int) -> tuple[bool, bool, list[np.ndarray]]:
    """Whether a tolerance was missed, whether there was too little room for roots, and the results."""
    if isinstance(kernel.program, ArrayProgram):
        outcome = kernel.results(columns, arrays, n)
    elif n == 1 and hasattr(kernel, "at_point") and all(c.ndim == 0 for c in columns):
        outcome = kernel.at_point([float(c) for c in columns])
    else:
        outcome = kernel.outcome(columns, n)
    return outcome.missed, outcome.crowded, list(outcome.values)
