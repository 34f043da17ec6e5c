"""What is made of an outlined program with arrays: its outputs, scheduled programs and kernels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

from teg.analysis.settings import Integration, with_more_room
from teg.evaluator.array_reports import has_samples
from teg.evaluator.options import Options
from teg.ir import expr as ex
from teg.ir.arrays import Array
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import ArrayName
from teg.passes.differentiate.through_sums import Parameter, gradient, on_cells, tangent
from teg.passes.lower.loops import Output, output_of, schedule_arrays
from teg.passes.normalise.canonicalise import canonicalise
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.pipeline import cell_program, compiled_outputs, flat_program, flatten, jvp, normal_form
from teg.program import Program
from teg.program.arrays import ArrayProgram


class Compiled:
    """An outlined program, and the kernels made of it."""

    def __init__(
        self, e: Expr, wrt: tuple[Parameter, ...], scalars: tuple[str, ...], arrays: tuple[ArrayName, ...], options: Options
    ) -> None:
        self.e, self.wrt, self.options = e, wrt, options
        self.scalars, self.arrays = scalars, arrays
        self._kernels: dict[object, Any] = {}
        self._sampled: dict[object, bool] = {}
        self._room: dict[object, Integration] = {}  # of what met more roots than there was room for
        self._checks: Any = None

    def kernel(self, what: str, which: tuple[Parameter, ...] = (), counted: bool = False, errors: bool = False) -> Any:
        """The kernel of the value, of value and gradient, or of a product of the Hessian with a direction along these parameters
        ("product", or "both" of the latter); with `errors` one whose outputs have error estimates behind them."""
        key = what, which, counted, errors
        if key not in self._kernels:
            program = self.program(what, which, unfinished=errors, how=self._room.get(key))
            program = with_array_error_estimates(program) if errors else program
            self._kernels[key] = build_arrays(program, self.options, counted)
        return self._kernels[key]

    def room(self, what: str, which: tuple[Parameter, ...] = ()) -> Integration | None:
        """How a kernel integrates, if it was given more room than the options say."""
        return self._room.get((what, which, False, False))

    def widen(self, what: str, which: tuple[Parameter, ...], counted: bool, errors: bool) -> bool:
        """Give a kernel more room for roots when it is made again; False where it has as much as there can be."""
        key = what, which, counted, errors
        wider = with_more_room(self._room.get(key, self.options.integration))
        if wider is None:
            return False
        self._room[key] = wider
        self._kernels.pop(key, None)
        return True

    def program(self, what: str, which: tuple[Parameter, ...], unfinished: bool = False, how: Integration | None = None) -> ArrayProgram:
        """The scheduled program; an `unfinished` one lacks the last passes over flat programs."""
        directions = tuple(direction_of(p) for p in which)
        scalars = [*self.scalars, *(d.name for d in directions if isinstance(d, Param))]
        arrays = [*self.arrays, *(d for d in directions if isinstance(d, Array))]
        return schedule_arrays(self.outputs(what, which), scalars, arrays, partial(self.flat, unfinished=unfinished, how=how))

    def outputs(self, what: str, which: tuple[Parameter, ...]) -> list[Output]:
        """The numbers and arrays that are computed, without δ."""
        leaves = flatten(self.e)
        maps, estimator = self.options.maps, self.options.discontinuities
        closed = self.options.integration.closed_forms
        found: list[Output] = []
        if what != "product":
            found += [output_of(on_cells(leaf, partial(normal_form, maps=maps))) for leaf in leaves]
        if what == "value":
            return found

        def derive(cell: Expr, wrt: Sequence[Param]) -> list[Expr]:
            return flatten(compiled_outputs(cell, wrt, 1, estimator, maps, closed)[1])

        sources = list(leaves) if what != "product" else []
        sources += [self._tangent(leaf, which) for leaf in leaves] if what in ("product", "both") else []
        for source in sources:
            for p, slope in zip(self.wrt, gradient(source, self.wrt, derive), strict=True):
                if slope.has_delta:  # a tangent is also a value, as a factor of another derivative
                    slope = on_cells(slope, partial(normal_form, maps=maps))
                found.append((p, slope) if isinstance(p, Array) else slope)
        return found

    def _tangent(self, leaf: Expr, which: tuple[Parameter, ...]) -> Expr:
        maps = self.options.maps
        directions: dict[Parameter, object] = {p: direction_of(p) for p in which}
        return tangent(leaf, directions, lambda cell, along: jvp(cell, along, maps))

    def flat(self, cells: Sequence[Expr], names: Sequence[str], unfinished: bool = False, how: Integration | None = None) -> Program:
        """The flat program of some cells."""
        together = cast(Tuple, canonicalise(ex.tuple_of(*cells)))  # one surface is one expression, so that they share loops
        return (flat_program if unfinished else cell_program)(list(together.children), names, how or self.options.integration)

    def map_checks(self) -> Any:
        """The checks of the user's maps at a call."""
        if self._checks is None:
            from teg.evaluator.array_coverage import ArrayMapChecks

            self._checks = ArrayMapChecks(self.e, self.options.maps)
        return self._checks

    def is_sampled(self, what: str, which: tuple[Parameter, ...]) -> bool:
        """Whether samples are taken that nobody asked for: they rarely reach a tolerance."""
        if (what, which) not in self._sampled:
            self._sampled[what, which] = self.options.integration.rule == "auto" and has_samples(self.kernel(what, which).program)
        return self._sampled[what, which]

    @property
    def has_products(self) -> bool:
        """Whether second derivatives have been asked for."""
        return any(isinstance(key, tuple) and key[0] == "product" for key in self._kernels)


def build_arrays(program: ArrayProgram, options: Options, counted: bool = False) -> Any:
    """A backend's kernel of a program with arrays."""
    from teg.backends.numpy.kernel import compile_numpy
    from teg.backends.numpy.loops import LaneKernel

    by_numpy: Callable[[Program], Any] = partial(compile_numpy, memory=options.memory)
    if options.backend == "numpy" or counted:
        return LaneKernel(program, by_numpy)
    if options.backend == "jax":
        from teg.backends.jax.kernel import compile_jax
        from teg.backends.jax.precision import InDoublePrecision

        return LaneKernel(program, compile_jax if options.dtype == "float64" else InDoublePrecision)
    from teg.backends.c.loops import compile_c_arrays

    return compile_c_arrays(program, threads=options.threads)


def direction_of(p: Parameter) -> Parameter:
    """What the change of a parameter is called."""
    name = f"∂{p.name}"
    return Array.make((name, p.dimensions), ()) if isinstance(p, Array) else Param.make(name, ())
