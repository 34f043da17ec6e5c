"""The evaluator, the result of `teg.compile`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.settings import Integration
from teg.errors import OptionError
from teg.evaluator.arguments import (
    Call,
    argument_order,
    plain_numbers,
    refuse_uncertain,
    rounded,
    values_by_name,
    with_rounding,
)
from teg.evaluator.both_sides import taken
from teg.evaluator.directions import Directions, generic, shape_of, units
from teg.evaluator.explain import checked_derivatives, explained
from teg.evaluator.kept import Kept
from teg.evaluator.kernels import Kernels, Key, dimensions_of
from teg.evaluator.lengths import KEPT, Lengths
from teg.evaluator.nodes import NodeFinder, moved_by
from teg.evaluator.options import Options
from teg.evaluator.results import along_direction, cotangents_of, in_shape, in_structure, nested, places, stacked, weighted
from teg.evaluator.wanted import GRADIENT, GRADIENT_ALONE, HESSIAN, ORDERS, VALUE, Wanted
from teg.ir.arrays import Array, Gather, arrays_of, has_arrays, integer_parameters
from teg.ir.cells import check_indices
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import ArrayName
from teg.ir.traverse import parameters
from teg.passes.differentiate.through_sums import Parameter, on_cells
from teg.pipeline import flatten, normal_form
from teg.program import Program
from teg.program.arrays import ArrayProgram
from teg.report.diagnose import Diagnosis, Second, Watch, diagnose
from teg.report.explain import Asked
from teg.report.explanation import SHOWN, Explanation, shortened
from teg.report.inventory import text_of
from teg.report.loop_watch import LoopWatch, probes_of
from teg.report.notebook import Card, card_of
from teg.report.number_watch import NumberWatch

if TYPE_CHECKING:
    import numpy as np


class Evaluator:
    """A compiled expression. Call it with parameters and arrays by name, by position (in the order of `parameters`) or as one dict.

        f = teg.compile(e, [t, a])
        f(t=0.5, a=2.0)                           # 0.0625
        f(0.5, 2.0)                               # 0.0625
        f({"t": 0.5, a: 2.0})                     # 0.0625
        f(t=[0.5, 1.0], a=2.0).tolist()           # [0.0625, 0.25]

    `parameters` are those listed in `teg.compile`, then the others in the order in which they were created. Where the others were created
    in more than one order, or read from a file, values by position raise ParameterError.

    Values are scalars or arrays that broadcast together to the batch's shape; results have that shape. Without a batch a result is a
    Python float (in single precision a `numpy.float32`). An array parameter has the shape of its dimensions; axes in front of these are
    a batch, and broadcast with the shape of the scalars. The derivative by an array has the array's shape. A tuple expression gives a
    tuple. Evaluators are immutable to their users, safe to share between threads, and pickle.

    Every call raises ParameterError for a value that is missing, unknown, given twice or of a wrong shape, ArrayIndexError for an index
    out of range, and warns (AccuracyWarning) where a result is not known to be right to the tolerance.
    """

    def __init__(
        self, e: Expr, wrt: Sequence[Parameter] | None, options: Options, order: tuple[Sequence[Param | ArrayName], int] | None = None
    ) -> None:
        self._loops = has_arrays(e) or any(isinstance(p, ArrayName) for p in wrt or ())
        if self._loops:
            check_indices(e)
        self.expression = write_all_out(e) if self._loops else e
        self._options = options
        arrays, counted, found = arrays_of(self.expression), integer_parameters(self.expression), parameters(self.expression)
        scalars = dict.fromkeys([*found, *counted])
        mapped = (p for m in options.maps for p in m.parameters)
        every = cast("list[Param | ArrayName]", [*scalars, *arrays, *mapped])
        leaves, certain = order or argument_order(every, wrt)
        self._leaves: tuple[Param | ArrayName, ...] = tuple(leaves)
        self._certain = certain  # so many parameters may be given by position
        default = [p for p in leaves if isinstance(p, Array) or (isinstance(p, Param) and (p not in set(counted) or p in set(found)))]
        self.wrt: tuple[Parameter, ...] = tuple([p for p in default if p in {*scalars, *arrays}] if wrt is None else wrt)
        self._directions = Directions(self.wrt, self._leaves)
        self.parameters: tuple[str, ...] = tuple(p.name for p in self._leaves)
        self._integers = frozenset(p.name for p in counted)
        self._entries = len(flatten(e))
        self._quick = options.backend == "c" and not self._loops and not (options.maps and options.check_maps)
        self._watches: Kept[Integration, NumberWatch] = Kept(2)  # programs compiled for diagnoses
        self._finders: Kept[Parameter | None, NodeFinder] = Kept(KEPT)
        program = write_all_out(e) if options.functions == "inlined" else self.expression
        self._lengths = Lengths(program, self.wrt, self._leaves, self._integers, options)

    # -- calls ---------------------------------------------------------------------------------------------------------

    def __call__(self, /, *args: Any, **named: Any) -> Any:
        """Returns the value: a float, or an array of the batch's shape; for a tuple expression a tuple of these.

        f(t=0.5, a=2.0)                       # 0.0625
        """
        rows, shape = self._run(VALUE, args, named)
        return nested(self.expression, iter(rows), shape)

    def value_and_grad(self, /, *args: Any, **named: Any) -> tuple[Any, dict[str, Any]]:
        """Returns the value, and a dict name -> derivative: a number for a parameter, an array of its shape for an array (for a tuple
        expression: a tuple of derivatives).

            f.value_and_grad(t=0.5, a=2.0)        # (0.0625, {'t': 0.25, 'a': -0.03125})

        In a batch the axes of the batch come first. The gradient is derived and compiled by the first call. Raises
        NoReparameterisationError or NotDifferentiableError for a derivative that is not known, and the errors of a call.
        """
        found, shape = self._run(GRADIENT, args, named)
        rows = iter(found)
        return nested(self.expression, rows, shape), self._by_name(rows, shape)

    def grad(self, /, *args: Any, **named: Any) -> dict[str, Any]:
        """Returns the dict name -> derivative of `value_and_grad`; the value is not computed. Raises the same errors.

        f.grad(t=0.5, a=2.0)                  # {'t': 0.25, 'a': -0.03125}
        """
        found, shape = self._run(GRADIENT_ALONE, args, named)
        return self._by_name(iter(found), shape)

    def value_and_error(self, /, *args: Any, **named: Any) -> tuple[Any, Any]:
        """Returns the value, and an estimate of its error of the same shape. Raises the errors of a call.

            value, error = f.value_and_error(t=0.5, a=2.0)
            error < 1e-12                         # True

        The estimate is a bound for nearly all programs; with the rules "montecarlo" and "qmc" it is the standard error. The estimates of
        the terms of a sum are added up.
        """
        values, errors, shape = self._estimated(VALUE, args, named)
        return nested(self.expression, iter(values), shape), nested(self.expression, iter(errors), shape)

    def grad_and_error(self, /, *args: Any, **named: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Returns the dict name -> derivative, and the dict of estimates of their errors, of the same shapes. Raises as `value_and_grad`.

        slopes, errors = f.grad_and_error(t=0.5, a=2.0)
        errors["t"] < 1e-12                   # True
        """
        slopes, errors, shape = self._estimated(GRADIENT_ALONE, args, named)
        first, second = (self._by_name(iter(part), shape) for part in (slopes, errors))
        return first, second

    def hessian(self, /, *args: Any, **named: Any) -> dict[tuple[str, str], Any]:
        """Returns second derivatives, a dict (name, name) -> number, with both orders of the names. Raises as `value_and_grad`.

            f.hessian(t=0.5, a=2.0)["t", "a"]     # -0.125

        By an array of shape s and one of shape r it has the shape s + r, behind that of the batch. With arrays it takes one product with
        a direction for each number: `hvp` scales better.
        """
        if self._loops:
            return self._hessian_by_products(self.by_name(args, named))
        found, shape = self._run(HESSIAN, args, named)
        rows = iter(found[self._entries * (1 + len(self.wrt)) :])
        names = [p.name for p in self.wrt]
        blocks = [{(a, b): in_shape(next(rows), shape) for a in names for b in names} for _ in range(self._entries)]
        return {(a, b): in_structure(self.expression, iter([block[a, b] for block in blocks])) for a in names for b in names}

    def hvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the Hessian times a direction (a dict name -> number, or array of the parameter's shape), a dict; no matrix is formed.

            f.hvp({"t": 0.5, "a": 2.0}, {"t": 1.0})["a"]  # -0.125

        Parameters that the direction does not name do not move. Cost: a small multiple of the gradient's, whatever the number of
        parameters. Raises as `value_and_grad`, and ParameterError for a direction along another parameter than those of `wrt`.
        """
        wanted, given = self._directions.moved(self.by_name((values,), {}), direction)
        call, kernels = self._lengths.read(wanted, given)
        rows = self._rounded(kernels.results(wanted, call, partial(self._titles, wanted)))
        return self._by_name(iter(rows), call.shape)

    def jvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> tuple[Any, Any]:
        """Returns the value, and the derivative along a direction (a dict name -> number, or array of the parameter's shape).

            f.jvp({"t": 0.5, "a": 2.0}, {"t": 1.0, "a": 8.0})  # (0.0625, 0.0)

        Raises as `hvp`.
        """
        value, slopes = self.value_and_grad(values)
        moved, dimensions = self._directions.components(self.by_name((values,), {}), direction, self.dtype), self.dimensions
        return value, along_direction(value, [(slopes[k], d, dimensions[k]) for k, d in moved.items()])

    def vjp(self, values: Mapping[str, Any], cotangent: Any = 1.0) -> tuple[Any, dict[str, Any]]:
        """Returns the value, and the dict name -> Σ cotangent · derivative; a tuple expression takes a tuple of cotangents.

            f.vjp({"t": 0.5, "a": 2.0}, 2.0)      # (0.0625, {'t': 0.5, 'a': -0.0625})

        A cotangent is a number, or an array of the batch's shape. Raises as `value_and_grad`.
        """
        value, slopes = self.value_and_grad(values)
        weights, dimensions = cotangents_of(value, cotangent, self.dtype), self.dimensions
        return value, {k: weighted(slope, weights, dimensions[k]) for k, slope in slopes.items()}

    def evaluations(self, /, *args: Any, derivatives: int = 0, **named: Any) -> int:
        """Returns the number of points at which a call evaluates integrands without an inner integral, over all iterations and the whole
        batch.

            f.evaluations(t=0.5, a=2.0)           # 1

        `derivatives`: 0 the value, 1 value and gradient, 2 Hessian too. The decision of a bracket on a whole piece is not an evaluation.
        Raises OptionError for other `derivatives`, and the errors of a call.
        """
        if derivatives not in (0, 1, 2):
            raise OptionError(f"derivatives={derivatives!r} is not known", None, "0: value, 1: and gradient, 2: and Hessian")
        given = self.by_name(args, named)
        wanted = [(ORDERS[min(derivatives, 1) if self._loops else derivatives], given)]
        if self._loops and derivatives == 2:
            wanted += [self._directions.moved(given, {q.name: direction}) for q in self.wrt for direction in units(q, given)]
        return sum(self._counted(*each) for each in wanted)

    def nodes(self, /, *args: Any, by: str | Param | Gather | None = None, **named: Any) -> tuple[np.ndarray, np.ndarray]:
        """Returns the points and weights of the quadrature of this program, for functions that are not known when it is compiled.

            points, weights = f.nodes(t=0.5, a=2.0)
            float(weights.sum())                  # 0.0625

        `points` have the shape (batch, n, variables), the innermost variable first, and `weights` (batch, n), where `batch` is the shape of
        the arguments. Σ weights·g(points) is ∫ integrand·g, for g as smooth as the rule assumes; where the integrand is a bracket, that is
        the integral of g over the region. With `by`, a parameter or its name, or an entry `V[3, 0]` of an array, it is the derivative by
        it: nodes on the boundary, weighted by its velocity, and inside if the integrand depends on it. Elements of a batch with fewer
        nodes are filled up with the last point and the weight 0. A sum over data has the nodes of all its terms, one after the other;
        those by an entry have the nodes of the terms in which it stands.

        The nodes are those of the compiled program without intrinsics, with its `rule`, `order` and `tol`, as if the integrand were not a
        polynomial. The interpreter finds them, in a tenth of a millisecond each, and in a few where it searches for roots. Raises
        OperandError for a program that is no sum of integrals over the same variables, AccuracyError where the tolerance is missed.
        """
        what = moved_by(by, self._leaves)
        finder = self._finders.get(what, lambda: NodeFinder(self.expression, what, self._options, self._leaves))
        return finder.nodes(self.by_name(args, named), self._integers, by)

    def kernel(self, orders: int) -> Any:
        """Returns the compiled program of the value (0), of value and gradient (1), or of value, gradient and Hessian (2), built when first
        needed.

            "def kernel" in f.kernel(0).source    # True

        None for a program that depends on the lengths of its arrays, which is built in the call.
        """
        kernels = self._lengths.any
        return None if kernels is None else kernels.kernel_of(ORDERS[orders])

    # -- programs and reports ------------------------------------------------------------------------------------------

    def outputs(self, orders: int) -> list[Expr]:
        """Returns value, gradient and Hessian (up to the given order) without δ, of a program without arrays: a list of expressions.

        value, gradient = f.outputs(1)
        len(gradient)                         # 2: the derivatives by t and by a
        """
        return self._lengths.required().plan.outputs(ORDERS[orders])

    def program(self, orders: int, errors: bool = False) -> Program | ArrayProgram:
        """Returns the lowered program of the value (0), value and gradient (1), and these with the Hessian (2).

            len(f.program(1).outputs)             # 3

        With arrays, the product of the Hessian and a direction takes the Hessian's place; its parameters stand behind the others, that
        of t is called ∂t. Raises ArrayIndexError if lengths of arrays must be known. With `errors`, estimates of the errors of the
        outputs follow them.
        """
        kernels = self._lengths.required()
        wanted = Wanted(True, 1, (self.wrt,)) if self._loops and orders == 2 else ORDERS[orders]
        return kernels.plan.program(wanted, errors=errors, how=kernels.room_of(wanted))

    def explain(self, derivatives: int = 0) -> Explanation:
        """Returns a report of the compiler's findings: loops, surfaces, reparameterisations, rules and nodes; `derivatives` as in
        `teg.explain`.

            [s["surface"] for s in f.explain().data["surfaces"]]  # ['t - (x + a·y) = 0']

        A program that is compiled for lengths of arrays is explained for those of the first call. Raises OptionError for other
        `derivatives` than 0 and 1.
        """
        options, made = self._options, self._lengths.some
        asked = Asked(options.integration, options.estimator, options.maps, checked_derivatives(derivatives))
        found = explained(self._lengths.program if made is None else made.plan.expression, self.wrt, asked)
        found.data["expression"] = text_of(self._lengths.program)
        return found

    def diagnose(self, /, *args: Any, **named: Any) -> list[Diagnosis]:
        """Returns where and why the expression is not differentiable at these values, and in which iteration of its sums: a list of
        `Diagnosis`, empty if it is differentiable.

            f.diagnose(t=0.5, a=2.0)              # []
            [d.kind for d in f.diagnose(t=1.0, a=0.0)]  # ['tie']

        Raises the errors of a call.
        """
        import numpy as np

        call, kernels = self._lengths.read(GRADIENT, self.by_name(args, named))
        seconds = self._seconds(kernels, call)
        if self._loops:
            return diagnose(self._loop_watch(kernels, call), call, np.empty((0, call.n)), seconds)
        return diagnose(*self._number_watch(kernels, call), seconds)

    def _seconds(self, kernels: Kernels, call: Call) -> list[Second] | None:
        """Returns what is known of the second derivatives of each element, if any were asked for before."""
        if kernels.has(HESSIAN):
            return kernels.seconds(HESSIAN, call)
        if not kernels.has_products:
            return None
        wanted, moved = self._generic_product(call)
        second_call, _ = self._lengths.read(wanted, moved)
        kernels.check(Key(wanted), second_call)
        return kernels.seconds(wanted, second_call)

    def _generic_product(self, call: Call) -> tuple[Wanted, dict[str, Any]]:
        """Returns the product with a direction without an order, and the arguments of its call."""
        names = [*call.names, *(p.name for p in self._leaves if isinstance(p, ArrayName))]
        given = dict(zip(names, [*call.columns, *call.arrays], strict=True))
        return self._directions.moved(given, generic(self.wrt, given))

    def _number_watch(self, kernels: Kernels, call: Call) -> tuple[Watch, Call, np.ndarray]:
        """Returns the watch of a program without loops, compiled once; the call, and the values there."""
        outcome = kernels.outcome(Key(GRADIENT), call)  # with room for all roots
        how, entries = kernels.room_of(GRADIENT), len(self.output_names(0))

        def made() -> NumberWatch:
            return NumberWatch(self.expression, self.outputs(1), self.output_names(1), self.wrt, self.parameters, how)

        return self._watches.get(how, made), call, outcome.values[:entries].reshape(entries, call.n)

    def _loop_watch(self, kernels: Kernels, call: Call) -> Watch:
        """Returns the watch of a program with loops."""
        plan, options = kernels.plan, self._options
        kernels.check(Key(GRADIENT), call)
        kernels.outcome(Key(GRADIENT), call)  # with room for all roots
        program = plan.program(GRADIENT, how=kernels.room_of(GRADIENT))
        values = [on_cells(leaf, partial(normal_form, maps=options.maps)) for leaf in plan.entries]
        probes = plan.derivation.scheduled([probes_of(v) for v in values], VALUE, options.integration)
        call.check(probes)
        places = partial(self._creases, kernels, call) if kernels.has_products else None
        return LoopWatch(self.wrt, cast(ArrayProgram, program), probes, places)

    def _creases(self, kernels: Kernels, call: Call, number: int) -> list[Any]:
        """Returns the ties of second derivatives, in the iterations of an element of the batch where these depend on their order."""
        from teg.backends.numpy.ties import TieWatch

        wanted, moved = self._generic_product(taken(call, [number]))
        second_call, _ = self._lengths.read(wanted, moved)
        program = cast(ArrayProgram, kernels.plan.program(wanted, how=kernels.room_of(wanted)))
        return TieWatch(program).ties(second_call.doubles, second_call.arrays, 1)[1]

    @property
    def dtype(self) -> str:
        """Returns the type of parameter values and results: "float64" or "float32".

        f.dtype                               # 'float64'
        """
        return self._options.dtype

    @property
    def dimensions(self) -> dict[str, int]:
        """Returns the number of dimensions of each parameter, 0 for a number.

        f.dimensions                          # {'t': 0, 'a': 0}
        """
        return {p.name: dimensions_of(p) for p in self._leaves}

    @property
    def integers(self) -> frozenset[str]:
        """Returns the names of the parameters that hold an integer.

        sorted(f.integers)                    # []
        """
        return self._integers

    def output_names(self, derivatives: int = 0) -> list[str]:
        """Returns the title of each output of `program`, in order: "value", "d value / d t", "d2 value / d t d a"; of a tuple "value[0]"
        and so on; with arrays "d2 value / d t d direction".

            f.output_names(1)                     # ['value', 'd value / d t', 'd value / d a']
        """
        entries, names = places(self.expression, "value"), [p.name for p in self.wrt]
        slopes = [f"d {entry} / d {a}" for entry in entries for a in names]
        seconds = ["direction"] if self._loops else names
        second = [f"d2 {entry} / d {a} d {b}" for entry in entries for a in names for b in seconds]
        return [*entries, *(slopes if derivatives > 0 else []), *(second if derivatives > 1 else [])]

    @property
    def source(self) -> str:
        """Returns the generated text: value, and value with gradient.

        "def " in f.source                    # True
        """
        made = self._lengths.some
        if made is None:
            return "nothing yet: this program is compiled for the shapes of its arrays, when it is first called"
        if self._loops:
            return made.kernel_of(GRADIENT).source
        for wanted in (VALUE, GRADIENT):
            made.kernel_of(wanted)
        return "\n".join(made.sources)

    def __repr__(self) -> str:
        return f"<teg.Evaluator({', '.join(self.parameters)}) of {shortened(str(self.expression), SHOWN)} on {self._options.backend}>"

    def _repr_html_(self) -> str:
        return self._card().html()

    def _repr_markdown_(self) -> str:
        return self._card().markdown()

    def _card(self) -> Card:
        return card_of(self.expression, self._leaves, self.wrt, self._options.backend)

    def __reduce__(self) -> tuple[object, ...]:
        return (Evaluator, (self.expression, self.wrt, self._options, (self._leaves, self._certain)))

    # -- inside --------------------------------------------------------------------------------------------------------

    def by_name(self, args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the values of a call by name, as the other methods read their arguments.

            f.by_name((0.5,), {"a": 2.0})         # {'t': 0.5, 'a': 2.0}

        Raises ParameterError if one is missing, unknown or given twice, or given by position where no order of the parameters is known.
        """
        if args and not isinstance(args[0], Mapping):
            refuse_uncertain(self.parameters, self._certain, args, "teg.compile")
        return values_by_name(self.parameters, args, named)

    def _run(self, wanted: Wanted, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[Any, tuple[int, ...]]:
        """Returns the results, and the shape of the batch."""
        if (
            self._quick
            and (len(args) <= self._certain or isinstance(args[0], Mapping))
            and (known := self._lengths.any) is not None
            and (numbers := plain_numbers(self.parameters, args, named)) is not None
        ):
            quick = known.at_point(wanted, numbers)
            if quick is not None:
                return quick, ()
        call, kernels = self._lengths.read(wanted, self.by_name(args, named))
        return self._rounded(kernels.results(wanted, call, partial(self._titles, wanted))), call.shape

    def _rounded(self, found: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        return [rounded(v) for v in found] if self._options.dtype == "float32" else found

    def _estimated(
        self, wanted: Wanted, args: tuple[Any, ...], named: Mapping[str, Any]
    ) -> tuple[Sequence[Any], Sequence[Any], tuple[int, ...]]:
        """Returns results, the estimates of their errors, and the shape of the batch."""
        call, kernels = self._lengths.read(wanted, self.by_name(args, named))
        values, errors = kernels.estimated(wanted, call, partial(self._titles, wanted))
        if self._options.dtype == "float32":
            pairs = [with_rounding(*pair) for pair in zip(values, errors, strict=True)]
            values, errors = [v for v, _ in pairs], [error for _, error in pairs]
        return values, errors, call.shape

    def _counted(self, wanted: Wanted, given: Mapping[str, Any]) -> int:
        call, kernels = self._lengths.read(wanted, given)
        return kernels.counted(wanted, call)

    def _hessian_by_products(self, given: dict[str, Any]) -> dict[tuple[str, str], Any]:
        """Returns the Hessian as products with unit directions."""
        found: dict[tuple[str, str], Any] = {}
        for q in self.wrt:
            columns: dict[str, list[Any]] = {p.name: [] for p in self.wrt}
            for direction in units(q, given):
                for name, product in self.hvp(given, {q.name: direction}).items():
                    columns[name].append(product)
            for p in self.wrt:
                found[p.name, q.name] = stacked(columns[p.name], shape_of(p, given), shape_of(q, given))
        return found

    def _titles(self, wanted: Wanted) -> list[str]:
        """Returns the title of each result, for messages."""
        values = ["the value"] * self._entries if wanted.values else []
        many, slopes = len(self.wrt), "the Hessian times the direction" if wanted.along else "the gradient"
        if self._loops:
            slopes = slopes.replace("the gradient", "the derivative")
            return [*values, *([f"{slopes} by {p.name}" for p in self.wrt] * self._entries if wanted.orders else [])]
        gradient = [slopes] * (many * self._entries) if wanted.orders else []
        return [*values, *gradient, *(["the Hessian"] * (many * many * self._entries) if wanted is HESSIAN else [])]

    def _by_name(self, rows: Iterator[Any], shape: tuple[int, ...]) -> dict[str, Any]:
        if not isinstance(self.expression, Tuple):
            return {p.name: in_shape(row, shape) for p, row in zip(self.wrt, rows, strict=False)}
        parts = [[in_shape(next(rows), shape) for _ in self.wrt] for _ in range(self._entries)]
        return {p.name: in_structure(self.expression, iter([part[i] for part in parts])) for i, p in enumerate(self.wrt)}


ArrayEvaluator = Evaluator
"""The former name of the evaluator of programs with arrays."""
