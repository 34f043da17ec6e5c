"""The programs of a plan, compiled for a backend; their results, and the reports about these."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.settings import Integration, with_more_room
from teg.evaluator.accuracy import has_samples, report_missed, report_not_a_number
from teg.evaluator.arguments import Call, whole_numbers
from teg.evaluator.both_sides import (
    Argument,
    BothSides,
    Rates,
    Ways,
    along_product,
    gradient_is_same,
    only,
    rounding_of,
    settled,
    told,
    without_order,
)
from teg.evaluator.kept import Kept
from teg.evaluator.options import Options
from teg.evaluator.plan import Plan
from teg.evaluator.runs import ListedPlan, RunsKernel
from teg.evaluator.tabled import Tabled
from teg.evaluator.timing import timed
from teg.evaluator.wanted import GRADIENT, GRADIENT_ALONE, HESSIAN, ORDERS, VALUE, Wanted, derivative_of_order, is_second
from teg.ir.expr import Param
from teg.ir.index import ArrayName
from teg.maps.checks import MapChecks
from teg.program import Outcome, Program
from teg.program.arrays import ArrayProgram
from teg.program.tabled import TabledProgram
from teg.report.diagnose import Second

if TYPE_CHECKING:
    import numpy as np


class Kernel(Protocol):
    """A compiled program.

    Without loops it has `outcome(columns, n)`, of columns of shape () or (n,), and, if C made it, `at_point(numbers)`. With loops it has
    `results(columns, arrays, n)`, of arrays of their own shapes or with an axis n in front.
    """

    @property
    def source(self) -> str: ...
    @property
    def program(self) -> Any: ...


class Key(NamedTuple):
    """Identifies a kernel: the wanted derivatives, of all entries or of one; with estimates of errors, or with a count of evaluations."""

    wanted: Wanted
    entry: int | None = None
    errors: bool = False
    counted: bool = False


class Kernels:
    """The programs of a plan, each compiled when it is first needed. Safe to share between threads."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self._tabled = Tabled(plan)
        self._listed = ListedPlan(plan)
        self._kernels: Kept[Key, Kernel] = Kept()
        self._room: Kept[Key, Integration] = Kept()  # for kernels that met more roots than there was room for
        self._sampled: Kept[tuple[Wanted, int | None], bool] = Kept()
        self._checks: Kept[None, MapChecks] = Kept()
        self._ties: Kept[Key, Any] = Kept()
        self._points: dict[Wanted, Callable[[Sequence[float]], Outcome]] = {}

    def kernel(self, key: Key) -> Kernel:
        """Returns the compiled program."""
        return self._kernels.get(key, lambda: self._made(key))

    def prepare(self, wanted: Wanted) -> None:
        """Makes the program of what is wanted, which raises whatever is wrong with it, and the kernel of JAX, which may not take it.
        Others are made when they are first called: where only derivatives are asked for, the value needs no kernel. Raises CompilerError
        if there is no compiler for C."""
        if self.plan.options.backend == "jax":
            self.kernel_of(wanted)
            return
        self._program(Key(wanted))
        if self.plan.options.backend == "c":
            from teg.backends.c.build import find_compiler

            find_compiler()

    def _made(self, key: Key) -> Kernel:
        program = self._program(key)
        dtype = "float64" if key.errors or key.counted else self.plan.options.dtype
        if isinstance(program, ArrayProgram) and key == Key(key.wanted) and self._listed.lists and self.room(key).closed_forms:
            return RunsKernel(self._listed, key.wanted, self.room(key), lambda p: build_kernel(p, self.plan.options, dtype))
        with timed(f"{key.wanted.title} for {self.plan.options.backend}", "compiled"):
            kernel: Kernel = build_kernel(program, self.plan.options, dtype, key.counted)
        return kernel

    def _program(self, key: Key) -> Program | ArrayProgram | TabledProgram:
        """Returns the program of a kernel: with tables, unless errors are estimated or evaluations counted."""
        how = self.room(key)
        tabled = None if key.errors or key.counted else self._tabled.program(key.wanted, key.entry, how)
        return tabled or self.plan.program(key.wanted, key.entry, key.errors, how)

    def room(self, key: Key) -> Integration:
        """Returns the integration of a kernel: that of the options, or with more room for roots."""
        return self._room.peek(key, self.plan.options.integration)

    def kernel_of(self, wanted: Wanted) -> Kernel:
        """Returns the compiled program of all that is wanted."""
        return self.kernel(Key(wanted))

    def room_of(self, wanted: Wanted) -> Integration:
        """Returns the integration of the kernel of what is wanted."""
        return self.room(Key(wanted))

    @property
    def sources(self) -> list[str]:
        """Returns the texts of the existing kernels of value, gradient and Hessian."""
        return [self.kernel(key).source for key in map(Key, (*ORDERS, GRADIENT_ALONE)) if key in self._kernels]

    def has(self, wanted: Wanted) -> bool:
        """Returns whether this kernel exists."""
        return Key(wanted) in self._kernels

    @property
    def has_products(self) -> bool:
        """Returns whether derivatives along directions were asked for before."""
        return any(key.wanted.along for key in self._kernels)

    # -- results -------------------------------------------------------------------------------------------------------

    def at_point(self, wanted: Wanted, numbers: Sequence[float]) -> np.ndarray | None:
        """Returns the results at one point by a kernel of C, (results, 1).

        None if there is anything to report, which `results` does. Only for a program without loops.
        """
        if wanted not in self._points:
            if self._is_sampled(wanted, None):
                return None
            self._points[wanted] = cast(Any, self.kernel(Key(wanted))).at_point
        outcome = self._points[wanted](numbers)
        if outcome.missed or outcome.crowded or (outcome.tied and wanted == HESSIAN) or any(map(math.isnan, outcome.values[:, 0].tolist())):
            return None
        return outcome.values

    def results(
        self, wanted: Wanted, call: Call, titles: Callable[[], Sequence[str]], entry: int | None = None, check_maps: bool = True
    ) -> Sequence[np.ndarray]:
        """Returns the results, (n,) for a number, (n, *shape) for a result shaped like an array; `titles` name them.

        Raises ArrayIndexError for an index out of its range, DiffeomorphismError if a user's map is not one-to-one for these values. If
        a tolerance was missed it warns, or raises AccuracyError, depending on the plan's options.
        """
        options, key = self.plan.options, Key(wanted, entry)
        self.check(key, call, check_maps)
        outcome = self.outcome(key, call)
        if options.inaccurate != "ignore":
            sampled, told = self._is_sampled(wanted, entry), False
            if outcome.missed or sampled:
                both = self.outcome(Key(wanted, entry, errors=True), call).values
                beside = self.outcome(Key(VALUE), call).values if wanted == GRADIENT_ALONE and entry is None else None
                told = report_missed(both, titles(), call, (options.integration.tol, options.inaccurate), sampled, beside)
            if not told:
                report_not_a_number(outcome.values, titles(), call, options.inaccurate, outcome.crowded)
        values: Sequence[np.ndarray] = outcome.values
        return values

    def estimated(
        self, wanted: Wanted, call: Call, titles: Callable[[], Sequence[str]]
    ) -> tuple[Sequence[np.ndarray], Sequence[np.ndarray]]:
        """Returns the results, and the estimates of their errors."""
        key = Key(wanted, errors=True)
        self.check(key, call)
        outcome = self.outcome(key, call)
        half = len(outcome.values) // 2
        if self.plan.options.inaccurate != "ignore":
            report_not_a_number(outcome.values[:half], titles(), call, self.plan.options.inaccurate, outcome.crowded)
        return outcome.values[:half], outcome.values[half:]

    def counted(self, wanted: Wanted, call: Call) -> int:
        """Returns the number of points at which a call evaluates integrands without an inner integral."""
        key = Key(wanted, counted=True)
        self.check(key, call, check_maps=False)
        return int(self.outcome(key, call).evaluations)

    def check(self, key: Key, call: Call, check_maps: bool = True) -> None:
        """Raises an error for an index out of its range, or a user's map that is not one-to-one for these values."""
        options = self.plan.options
        if self.plan.has_loops:
            call.check(self.kernel(key).program)
        if options.maps and options.check_maps and check_maps:
            checks = self._checks.get(None, lambda: MapChecks(write_all_out(self.plan.expression), options.maps))
            arrays = [p for p in self.plan.leaves if isinstance(p, ArrayName)]
            checks.run(dict(zip(call.names, call.columns, strict=True)), dict(zip(arrays, call.arrays, strict=False)), call.n)

    def outcome(self, key: Key, call: Call) -> Any:
        """Returns the outcome of a kernel.

        As long as a condition has more roots than there is room for, and a result is NaN, the kernel is made again with more room.
        """
        import numpy as np

        while True:
            outcome = self._run(key, call)
            if not outcome.crowded or not any(np.isnan(v).any() for v in outcome.values):
                return self._settled(key, call, outcome) if np.any(outcome.tied) and call.n else outcome
            wider = with_more_room(self.room(key))
            if wider is None:
                return outcome
            self._room.put(key, wider)
            self._kernels.drop(key)
            self._points.clear()

    def _settled(self, key: Key, call: Call, outcome: Any) -> Any:
        """Returns an outcome at ties, with second derivatives as the mean of both sides."""
        wanted, plan = key.wanted, self.plan
        if key.counted or plan.options.estimator.name != "exact" or not is_second(wanted):
            return outcome
        return settled(outcome, call, self._sides(key, wanted, len(outcome.values)), self._ways(key))

    def seconds(self, wanted: Wanted, call: Call) -> list[Second]:
        """Returns what is known of the second derivatives of each element."""
        key = Key(wanted)
        values = self.outcome(key, call).values
        sides = self._sides(key, wanted, len(values))
        return told(sides.numbers(values), call, sides, self._ways(key))

    def _ways(self, key: Key) -> Ways:
        """Returns what is asked of a program of second derivatives at ties."""
        wanted, derivation = key.wanted, self.plan.derivation

        def rates(call: Call) -> list[Rates]:
            if not wanted.along:
                return [without_order(call, seed) for seed in (0, 1)]
            (direction,) = derivation.directions(wanted)
            moving = cast("list[tuple[Argument, Argument]]", [*direction.items()])
            return [along_product(moving, derivation.arguments(wanted), call)]

        def rounding(call: Call) -> np.ndarray:
            given = only(call, derivation.arguments(wanted), derivation.arguments(GRADIENT))
            gradient = self._sides(key, GRADIENT).numbers(self._run(Key(GRADIENT), given).values)
            return rounding_of(gradient, call, rates(call)[0])

        return Ways(rates, rounding, partial(self._meets_at_places, key))

    def _sides(self, key: Key, wanted: Wanted, results: int = 0) -> BothSides:
        """Returns the kernel's runs beside a place, and which of so many `results` are what is wanted: the Hessian, the gradient before it,
        or the product."""
        entries = len(self.plan.entries) if key.entry is None else 1
        gradient = slice(entries, entries * (1 + len(self.plan.wrt)))
        count = results // 2 if key.errors else results
        which = gradient if wanted == GRADIENT else slice(gradient.stop if wanted == HESSIAN else 0, count)
        return BothSides(partial(self._run, key), which)

    def _meets_at_places(self, key: Key, call: Call) -> bool:
        """Returns whether the ties of an element are at places, and none along a curve, and leave a gradient that is known the same on
        both sides; False for a program with loops."""
        if self.plan.has_loops:
            return False
        if not key.wanted.along and not gradient_is_same(self._sides(key, GRADIENT), call):
            return False
        program = cast(Program, self.plan.program(key.wanted, key.entry, False, self.room(key)))
        ties = self._ties.get(key, lambda: build_ties(program)).met_ties(call.doubles, 1)
        return all(program.ties[k].at_place for k in ties)

    def _run(self, key: Key, call: Call) -> Any:
        kernel: Any = self.kernel(key)
        if self.plan.has_loops:
            return kernel.results(call.doubles, call.arrays, call.n)
        if self.plan.options.backend != "c" or key.errors or key.counted:
            return kernel.outcome(call.doubles, call.n)
        if call.n == 1 and all(c.ndim == 0 for c in call.columns):
            return kernel.at_point([float(c) for c in call.columns])
        return kernel.outcome(call.columns, call.n)

    def _is_sampled(self, wanted: Wanted, entry: int | None) -> bool:
        """Returns whether integrals are sampled though no sampling rule was chosen: they rarely reach a tolerance."""
        how = self.plan.options.integration
        return how.rule == "auto" and self._sampled.get((wanted, entry), lambda: has_samples(self._program(Key(wanted, entry))))


class DerivativeKernels:
    """The programs of a plan for a function of PyTorch, on NumPy's arrays.

    `operands` of a run are the leaves of the plan, its integers, and then those of each direction, `moving` of them: float64, but for
    arrays of indices; each of its own shape (`dimensions` says of how many axes) where the batch shares it, else with an axis n in front.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.kernels = plan, Kernels(plan)
        self.moving, self.entries = len(plan.wrt), len(plan.entries)
        self.dimensions = tuple(dimensions_of(p) for p in (*plan.leaves, *plan.integers))

    def run(self, order: int, entry: int | None, operands: Sequence[Any], n: int) -> list[Any]:
        """Returns the results of the program of an order (`plan.derivative_of_order`), of all values or of one entry.

        float64, (n,) for a number, (n, *shape) for a result shaped like an array; warns and raises as `Kernels.results` does.
        """
        import numpy as np

        wanted = derivative_of_order(order, self.plan.wrt)
        given = len(self.dimensions)
        leaves, integers, along = operands[: len(self.plan.leaves)], operands[len(self.plan.leaves) : given], operands[given:]
        arguments = self.plan.derivation.arguments(wanted)
        values = dict(zip(arguments, (*leaves, *along, *integers), strict=True))
        scalars = [p for p in arguments if isinstance(p, Param)]
        arrays = [p for p in arguments if isinstance(p, ArrayName)]
        batched = any(v.ndim > dimensions_of(p) for p, v in values.items())
        shapes = [values[a].shape[values[a].ndim - a.dimensions :] for a in arrays]
        whole = {scalars.index(p): whole_numbers(p.name, values[p]) for p in self.plan.integers}
        columns = [values[p] for p in scalars]
        call = Call([p.name for p in scalars], columns, [values[a] for a in arrays], n if batched else 1, (n,), shapes, whole)
        found = list(self.kernels.results(wanted, call, partial(self._titles, order), entry, check_maps=order <= 0))
        return found if call.n == n else [np.repeat(v, n, axis=0) for v in found]

    def _titles(self, order: int) -> list[str]:
        """Returns the title of each result, for messages."""
        if order > 0:
            return [f"the derivative of order {order + 1} by {p.name}" for p in self.plan.wrt]
        values = ["the value"] * self.entries
        return values if order < 0 else [*values, *[f"the derivative by {p.name}" for p in self.plan.wrt] * self.entries]


def build_kernel(program: Program | ArrayProgram | TabledProgram, options: Options, dtype: str = "float64", counted: bool = False) -> Any:
    """Returns a backend's kernel of a program; a `counted` one counts evaluations.

    JAX does not count, nor do loops in C: NumPy's twin does. Only C supports another dtype than float64, and in programs without loops
    only.
    """
    if isinstance(program, TabledProgram):
        if options.backend == "c":
            from teg.backends.c.tabled_kernel import CTabledKernel

            return CTabledKernel(program, options.threads)
        from teg.backends.numpy.tabled import TabledKernel

        return TabledKernel(program, build_kernel(program.program, options))
    from teg.backends.numpy.kernel import compile_numpy
    from teg.backends.numpy.side_by_side import compile_side_by_side

    by_numpy: Callable[..., Any] = compile_numpy if counted else compile_side_by_side
    flat: Callable[[Program], Any] = partial(by_numpy, memory=options.memory)
    if options.backend == "jax" and not counted:
        from teg.backends.jax.kernel import compile_jax
        from teg.backends.jax.precision import InDoublePrecision

        flat = compile_jax if options.dtype == "float64" else InDoublePrecision
    if isinstance(program, Program):
        if options.backend == "c":
            from teg.backends.c.kernel import compile_c

            return compile_c(program, threads=options.threads, counted=counted, dtype=dtype)
        return flat(program)
    if options.backend == "c" and not counted:
        from teg.backends.c.loops import compile_c_arrays

        return compile_c_arrays(program, threads=options.threads)
    from teg.backends.numpy.loops import LaneKernel

    return LaneKernel(program, flat)


def build_ties(program: Program) -> Any:
    """Returns a kernel that tells which ties it meets."""
    from teg.backends.numpy.kernel import compile_numpy

    return compile_numpy(program)


def dimensions_of(p: Param | ArrayName) -> int:
    """Returns the number of dimensions of a parameter's value, 0 for a number."""
    return p.dimensions if isinstance(p, ArrayName) else 0
