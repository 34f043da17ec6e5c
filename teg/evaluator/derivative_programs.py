"""The programs of a function of JAX or PyTorch: of values, of values and gradients, and of derivatives of any order along directions.

    order -1        e(p)
    order 0         e(p) and ∂e/∂p
    order k ≥ 1     Dᵏ⁺¹e(p)[u₁, …, uₖ, ·]: the gradient of the k-th directional derivative

Each is the symbolic derivative, made by the passes of `pipeline`, or those of `array_pipeline`: e is differentiated forward along each
direction, whose components are parameters of their own, and then in reverse.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import cast

from teg.analysis.settings import Integration
from teg.evaluator.options import Options
from teg.ir import expr as ex
from teg.ir.arrays import Array
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import ArrayName
from teg.passes.differentiate.through_sums import gradient, on_cells, tangent
from teg.passes.lower.loops import Output, output_of, schedule_arrays
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.pipeline import ESTIMATORS, cell_program, compiled_outputs, flat_program, flatten, jvp, normal_form, program_for
from teg.program import Program
from teg.program.arrays import ArrayProgram

Parameter = Param | Array


class DerivativePrograms:
    """A program, and the programs of its derivatives by `wrt`, scheduled when they are needed. Parameters of a program are the `leaves`,
    of which `wrt` are the first, then the directions, and behind the numbers among them the `integers`."""

    def __init__(
        self,
        e: Expr,
        options: Options,
        wrt: Sequence[Parameter],
        leaves: Sequence[Param | ArrayName],
        integers: Sequence[Param],
    ) -> None:
        self.options = options
        self.wrt, self.leaves, self.integers = tuple(wrt), tuple(leaves), tuple(integers)
        self._programs: dict[tuple[int, int | None, bool, Integration], Program | ArrayProgram] = {}
        self._lock = threading.RLock()
        self._counting: frozenset[int] | None = None
        self.entries = flatten(e)

    @property
    def counting(self) -> frozenset[int]:
        """The numbers of the arrays that numbers of terms depend on."""
        if self._counting is None:
            program, found = self.program(-1), set()
            if isinstance(program, ArrayProgram):
                from teg.backends.jax.loops import counting_arrays

                found = counting_arrays(program)
            self._counting = frozenset(found)
        return self._counting

    def program(self, order: int, entry: int | None = None, errors: bool = False, how: Integration | None = None) -> Program | ArrayProgram:
        """The program of values (-1), values and gradients (0), or the derivative along directions, of all values or of one entry; with
        `errors` an estimate of the error of each output stands behind them; integrated as the options say, or as `how` does."""
        with self._lock:
            how = how or self.options.integration
            key = order, entry, errors, how
            if key not in self._programs:
                entries = self.entries if entry is None else [self.entries[entry]]
                arrays = any(isinstance(p, ArrayName) for p in self.leaves) or bool(self.integers)
                self._programs[key] = (self._of_arrays if arrays else self._of_numbers)(order, entries, errors, how)
            return self._programs[key]

    def _directions(self, order: int) -> list[dict[Parameter, Parameter]]:
        names = {p.name for p in (*self.leaves, *self.integers)}
        found: list[dict[Parameter, Parameter]] = []
        for k in range(order):
            mark = "∂" * (k + 1)
            while any(f"{mark}{p.name}" in names for p in self.wrt):
                mark += "′"
            found.append({p: _renamed(p, f"{mark}{p.name}") for p in self.wrt})
            names |= {q.name for q in found[-1].values()}
        return found

    def _without_deltas(self, e: Expr) -> Expr:
        """A tangent as it is differentiated again: where discontinuities are ignored, without what they contribute."""
        how = self.options.discontinuities
        return e if how == "sift" else on_cells(e, ESTIMATORS[how])

    def _of_numbers(self, order: int, entries: Sequence[Expr], errors: bool, integration: Integration) -> Program:
        directions, wrt = self._directions(order), cast("tuple[Param, ...]", self.wrt)
        how, maps = self.options.discontinuities, self.options.maps
        names = [p.name for p in self.leaves] + [q.name for d in directions for q in d.values()]
        source = entries[0] if len(entries) == 1 else ex.tuple_of(*entries)
        for direction in directions:
            source = self._without_deltas(jvp(source, cast("dict[Param, object]", direction), maps))
        outputs = compiled_outputs(source, wrt, min(order + 1, 1), how, maps, self.options.integration.closed_forms)
        if order > 0:
            outputs = outputs[1:]
        return program_for([leaf for output in outputs for leaf in flatten(output)], names, integration, errors)

    def _of_arrays(self, order: int, entries: Sequence[Expr], errors: bool, integration: Integration) -> ArrayProgram:
        directions = self._directions(order)
        how, maps = self.options.discontinuities, self.options.maps
        along = [q for d in directions for q in d.values()]
        scalars = [p.name for p in (*self.leaves, *along) if isinstance(p, Param)] + [p.name for p in self.integers]
        arrays = [p for p in (*self.leaves, *along) if isinstance(p, ArrayName)]

        def derive(cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
            return flatten(compiled_outputs(cell, wrt, 1, how, maps, self.options.integration.closed_forms)[1])

        outputs: list[Output] = []
        if order <= 0:
            outputs += [output_of(on_cells(leaf, partial(normal_form, maps=maps))) for leaf in entries]
        for source in entries if order >= 0 else ():
            for direction in directions:
                source = self._without_deltas(tangent(source, dict(direction), lambda cell, changes: jvp(cell, changes, maps)))
            for p, slope in zip(self.wrt, gradient(source, self.wrt, derive), strict=True):
                if slope.has_delta:  # a tangent is also a value, as a factor of another derivative
                    slope = on_cells(slope, partial(normal_form, maps=maps))
                outputs.append((p, slope) if isinstance(p, Array) else slope)
        program = schedule_arrays(outputs, scalars, arrays, partial(self._flat, flat_program if errors else cell_program, integration))
        return with_array_error_estimates(program) if errors else program

    def _flat(self, scheduled: Callable[..., Program], how: Integration, cells: Sequence[Expr], names: Sequence[str]) -> Program:
        together = cast(Tuple, canonicalise(ex.tuple_of(*cells)))  # one surface is one expression, so that they share loops
        return scheduled(list(together.children), names, how)


def _renamed(p: Parameter, name: str) -> Parameter:
    return Array.make((name, p.dimensions), ()) if isinstance(p, Array) else Param.make(name, ())
