"""`teg.compile`, `teg.evaluate`, and what they give: an Evaluator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

from teg.analysis.bodies import write_all_out
from teg.analysis.isolation import MAX_ROOTS
from teg.analysis.settings import Integration, with_more_room
from teg.errors import OptionError, ParameterError
from teg.evaluator.accuracy import report_missed, report_not_a_number
from teg.evaluator.arguments import as_doubles, batch, plain_numbers, rounded, with_rounding
from teg.evaluator.arguments import values as arguments
from teg.evaluator.array_evaluator import ArrayEvaluator
from teg.evaluator.array_plan import direction_of
from teg.evaluator.derivation import linked
from teg.evaluator.options import DEFAULT_TOLS, Options, checked_dtype
from teg.ir.arrays import Array as ArrayParameter
from teg.ir.arrays import has_arrays
from teg.ir.expr import Expr, Param, Tuple, as_number
from teg.ir.index import ArrayName
from teg.ir.traverse import parameters
from teg.language import check_parameters, check_program
from teg.maps.coverage import MapChecks
from teg.maps.diffeomorphism import Diffeomorphism
from teg.passes.differentiate.through_sums import parameters_and_arrays
from teg.pipeline import compiled_outputs, flatten, jvp
from teg.program import Outcome, Program, Sample, statements
from teg.report.diagnose import Diagnosis, diagnose
from teg.report.explain import Explanation, explain

if TYPE_CHECKING:
    import numpy as np

Array = Any  # a float64 array of the batch's shape, a NumPy scalar where there is no batch


class Kernel(Protocol):
    """What a backend makes of a program: columns of shape () or (n,) in, outputs of shape (number of outputs, n) out."""

    source: str

    def outcome(self, columns: Sequence[np.ndarray], n: int) -> Outcome: ...

    def __call__(self, columns: Sequence[np.ndarray], n: int) -> np.ndarray: ...


def compile(
    e: object,
    parameters: Sequence[Param | ArrayParameter] | Param | ArrayParameter | None = None,
    *,
    backend: str = "numpy",
    tol: float | None = None,
    rule: str = "auto",
    order: int | None = None,
    seed: int = 0,
    inaccurate: str = "warn",
    dtype: object = "float64",
    threads: int = 1,
    memory: int = 256 * 2**20,
    discontinuities: str = "sift",
    max_roots: int = MAX_ROOTS,
    maps: Sequence[Diffeomorphism] = (),
    check_maps: bool = True,
    functions: str = "linked",
    intrinsics: bool = True,
) -> Evaluator:
    """An Evaluator of a closed expression, of its gradient and of its Hessian; of one with arrays an ArrayEvaluator.

    `parameters` are those to differentiate by, arrays among them, in the order of `f.parameters` (default: all that occur in e; others
    that occur are arguments after them). `backend` is "numpy", "c" or "jax". `threads` are the C backend's (0: one for each processor;
    results are the same for any number), `memory` (bytes) bounds the NumPy backend's temporary arrays. `discontinuities` says what
    becomes of the Dirac deltas of a derivative: "sift" (the right thing) or "ignore" (plain automatic differentiation, for comparison).
    `max_roots` is for how many roots of a condition there is room at first, if no theorem bounds their number. A call that meets more of
    them makes the program again with more room, up to 4096.

    `dtype`, "float64" or "float32", is what values of parameters are rounded to when they come in, and results when they go out. All
    between is computed in float64, by JAX too where x64 is off: where surfaces cross and pieces end takes its digits, and single precision
    would save little of a call's time.

    `tol` (1e-10, for float32 1e-6) is the tolerance, absolute and relative to the integral of |integrand| over a piece. `rule`, and what
    `order` means to it:

        "auto"        exact with the fewest nodes where the integrand is a polynomial between its breaks, else "adaptive"
        "adaptive"    Gauss-Legendre between the breaks, halved until the error estimate is below `tol`; order: nodes of the first look
        "gauss"       exact where "auto" is with no more, else `order` (16) nodes a piece and variable, whatever the error
        "midpoint"    `order` (256) points a variable, breaks ignored: the uniform rule of Teg (2021), for comparison
        "montecarlo"  `order` (2¹⁴) independent samples of a whole nest of integrals, from `seed`
        "qmc"         `order` (2¹⁴) points of 8 scrambled Sobol' sequences

    `inaccurate` says what happens where the tolerance is not reached, or an integral diverges: "warn" (AccuracyWarning, with the
    estimate), "raise" (AccuracyError) or "ignore".

    `maps` are changes of variables for the surfaces that move (`teg.Diffeomorphism`, `teg.maps`): where the integrals over all old
    variables of a map stand inside each other, the delta of a surface that depends on one new variable only, or has a formula in the new
    variables and none without, is eliminated in these; or in the old ones, in a program that is written in the new ones. The results are
    those of `teg.change_variables` on the integrals of these deltas. Every call verifies the maps for its parameter values (of a batch:
    at most 64 elements), which `check_maps=False` leaves out, and raises DiffeomorphismError.

    `functions` says how those of `teg.function` are compiled: "linked" each by itself, so that a program with other bodies shares what was
    done for the rest; "inlined" as if they were written out by hand: faster code, and nothing is shared.

    `intrinsics=False` turns off the fast paths of single shapes of programs (`teg.passes.intrinsics`): clipped polygons, moments of
    hyperbolas, weights for poles. The results are the same to the tolerance, by slower and more general means. A `rule` or an `order`
    turns them off too.

    Raises ScopeError for a free variable, NameClashError for one name given to two things, OptionError for an option that is unknown.
    The gradient is derived when it is first asked for; a surface that no family can reduce raises NoReparameterisationError then.
    """
    program = e if isinstance(e, Tuple) else as_number(e)
    check_program(program)
    precision = checked_dtype(dtype)
    integration = Integration(DEFAULT_TOLS[precision] if tol is None else tol, rule, order, seed, max_roots, intrinsics)
    options = Options(backend, integration, inaccurate, precision, threads, memory, discontinuities, maps, check_maps, functions)
    if has_arrays(program):
        arrays = ArrayEvaluator(write_all_out(program), None if parameters is None else parameters_and_arrays(parameters), options)
        return cast(Evaluator, arrays)  # it has all of an Evaluator's methods
    return Evaluator(program, None if parameters is None else check_parameters(parameters), options)


def evaluate(e: object, values: Mapping[Any, Any] | None = None, *, backend: str = "numpy", **options: Any) -> Any:
    """The value of an expression at parameter values (keys are parameters or their names); e may hold deltas and derivatives.

    Values of parameters that e does not have are passed over: a derivative may have lost some.
    """
    f = compile(e, backend=backend, **options)
    names = {(k.name if isinstance(k, Param | ArrayName) else k): v for k, v in (values or {}).items()}
    return f({k: v for k, v in names.items() if k in f.parameters} if values else {})


class Evaluator:
    """A compiled expression. Call it with the parameters by name, by position (in the order of `parameters`) or as one dict.

    Values are scalars or arrays that broadcast together to the batch's shape; results have that shape (a NumPy scalar if there is no
    batch). A tuple expression gives a tuple. Evaluators are immutable to their users, safe to share between threads, and pickle.
    """

    def __init__(self, e: Expr, wrt: Sequence[Param] | None, options: Options) -> None:
        self.expression = e
        found = parameters(e)
        self.wrt: tuple[Param, ...] = tuple(found if wrt is None else wrt)
        every = list(dict.fromkeys([*self.wrt, *found, *(p for m in options.maps for p in m.parameters)]))
        self.parameters: tuple[str, ...] = tuple(p.name for p in every)
        self._options = options
        program = write_all_out(e) if options.functions == "inlined" else e
        self._derived = linked(program, self.wrt, self.parameters, options.integration, options.discontinuities, options.maps)
        self._kernels: dict[int, Kernel] = {}
        self._special: dict[tuple[str, int], Kernel] = {}
        self._room: dict[tuple[str, int], Integration] = {}  # of what met more roots than there was room for
        self._titles: tuple[str, ...] = ("the value", "the gradient", "the Hessian")
        self._watched: dict[tuple[int, Any], Any] = {}  # programs of diagnoses
        self._sampled: dict[int, bool] = {}
        self._products: dict[tuple[Param, ...], Evaluator] = {}
        self._checks = MapChecks(write_all_out(e) if options.maps else e, options.maps if options.check_maps else ())
        self._quick = options.backend == "c" and not self._checks.cases  # one point need not become a batch
        self._rounds = options.dtype == "float32" and options.backend != "c"  # the kernels of C do it themselves
        self.kernel(0)

    # -- programs ------------------------------------------------------------------------------------------------------

    def outputs(self, orders: int) -> list[Expr]:
        """The δ-free expressions of value, gradient, Hessian (as many as asked for)."""
        return self._derived.outputs(orders)

    def program(self, orders: int) -> Program:
        """The scheduled program of value (0), value and gradient (1), value, gradient and Hessian (2)."""
        return self._derived.program(orders, how=self._room.get(("value", orders)))

    def kernel(self, orders: int) -> Kernel:
        """The compiled program, built when it is first needed."""
        if orders not in self._kernels:
            self._kernels[orders] = build_kernel(self.program(orders), self._options, self._options.dtype)
        return self._kernels[orders]

    def _estimating(self, orders: int) -> Kernel:
        """The program with error estimates."""
        key = "errors", orders
        if key not in self._special:
            program = self._derived.program(orders, errors=True, how=self._room.get(key))
            self._special[key] = build_kernel(program, self._options)
        return self._special[key]

    def _counting(self, orders: int) -> Kernel:
        """The program as one that counts evaluations; for JAX, which does not, by NumPy."""
        key = "count", orders
        if key not in self._special:
            program = self._derived.program(orders, how=self._room.get(key))
            self._special[key] = build_kernel(program, self._options, counted=True)
        return self._special[key]

    def _outcome(self, what: str, orders: int, columns: Sequence[np.ndarray], n: int) -> Outcome:
        """The outcome of the program ("value"), of that with estimates ("errors") or of the one that counts evaluations ("count"). As long
        as a condition has more roots than there is room for, and a result is no number, the program is made again with more room."""
        import numpy as np

        make = {"value": self.kernel, "errors": self._estimating, "count": self._counting}[what]
        while True:
            outcome = make(orders).outcome(columns, n)
            if not outcome.crowded or not np.isnan(outcome.values).any():
                return outcome
            wider = with_more_room(self._room.get((what, orders), self._options.integration))
            if wider is None:
                return outcome
            self._room[what, orders] = wider
            if what == "value":
                self._kernels.pop(orders, None)
            else:
                self._special.pop((what, orders), None)

    @property
    def dtype(self) -> str:
        """What values of parameters and results are: "float64" or "float32"."""
        return self._options.dtype

    @property
    def dimensions(self) -> dict[str, int]:
        """How many dimensions each parameter has: 0."""
        return dict.fromkeys(self.parameters, 0)

    @property
    def integers(self) -> frozenset[str]:
        """The parameters that hold an integer: none."""
        return frozenset()

    @property
    def source(self) -> str:
        """The text of everything generated: value, and value with gradient."""
        self.kernel(1)
        return "\n".join(self._kernels[k].source for k in sorted(self._kernels))

    # -- calls ---------------------------------------------------------------------------------------------------------

    def __call__(self, *args: Any, **named: Any) -> Any:
        """The value."""
        rows, shape = self._run(0, args, named)
        return _nested(self.expression, iter(rows), shape)

    def value_and_grad(self, *args: Any, **named: Any) -> tuple[Any, dict[str, Any]]:
        """The value, and a dict parameter name -> derivative (for a tuple expression: a tuple of derivatives)."""
        rows, shape = self._run(1, args, named)
        source = iter(rows)
        value = _nested(self.expression, source, shape)
        return value, self._gradient(source, shape)

    def grad(self, *args: Any, **named: Any) -> dict[str, Any]:
        """The dict parameter name -> derivative."""
        return self.value_and_grad(*args, **named)[1]

    def value_and_error(self, *args: Any, **named: Any) -> tuple[Any, Any]:
        """The value, and an estimate of its error of the same shape: a bound for nearly all programs; with the rules "montecarlo" and "qmc"
        the standard error."""
        rows, shape = self._estimated(0, args, named)
        source = iter(rows)
        return _nested(self.expression, source, shape), _nested(self.expression, source, shape)

    def grad_and_error(self, *args: Any, **named: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """The dict parameter name -> derivative, and the dict of estimates of their errors."""
        rows, shape = self._estimated(1, args, named)
        source = iter(rows)
        found = []
        for _ in range(2):
            _nested(self.expression, source, shape)
            found.append(self._gradient(source, shape))
        return found[0], found[1]

    def evaluations(self, *args: Any, derivatives: int = 0, **named: Any) -> int:
        """At how many points a call (`derivatives`: 0 the value, 1 value and gradient, 2 Hessian too) evaluates integrands that have no
        integral inside, over the whole batch. What a bracket decides about a whole piece is no evaluation."""
        if derivatives not in (0, 1, 2):
            raise OptionError(f"derivatives={derivatives!r} is not known", None, "0: value, 1: and gradient, 2: and Hessian")
        columns, _, n = self._columns(args, named)
        return self._outcome("count", derivatives, as_doubles(columns), n).evaluations

    def hessian(self, *args: Any, **named: Any) -> dict[tuple[str, str], Any]:
        """Second derivatives, a dict (name, name) -> array, with both orders of the names."""
        rows, shape = self._run(2, args, named)
        source = iter(rows)
        _nested(self.expression, source, shape)
        self._gradient(source, shape)
        names = [p.name for p in self.wrt]
        blocks = _nested(self._derived.derivation.outputs(2)[2], source, shape)
        return self._matrix(self.expression, blocks, names)

    def jvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> tuple[Any, Any]:
        """The value, and the derivative along a direction (a dict name -> number or array)."""
        value, gradient = self.value_and_grad(values)
        self._known(direction)
        return value, _combine([(gradient[k], d) for k, d in direction.items()], value)

    def vjp(self, values: Mapping[str, Any], cotangent: Any = 1.0) -> tuple[Any, dict[str, Any]]:
        """The value, and the dict name -> Σ cotangent · derivative; a tuple expression takes a tuple of cotangents."""
        value, gradient = self.value_and_grad(values)
        if not isinstance(value, tuple):
            return value, {k: g * cotangent for k, g in gradient.items()}
        weights = tuple(cotangent) if isinstance(cotangent, tuple | list) else (cotangent,) * len(value)
        return value, {k: sum(w * g for w, g in zip(weights, gs, strict=True)) for k, gs in gradient.items()}

    def hvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> dict[str, Any]:
        """The Hessian times a direction (a dict name -> number or array), a dict; no matrix is formed.

        What the direction does not name does not move. Cost: a small multiple of the gradient's, whatever the number of parameters.
        """
        self._known(direction)
        which = tuple(p for p in self.wrt if p.name in direction)
        product = self._product(which)
        given = arguments(self.parameters, (values,), {})
        given.update((direction_of(p).name, direction[p.name]) for p in which)
        names = [*self.parameters, *(direction_of(p).name for p in which)]
        _, shape, _ = batch(names, (given,), {}, self._options.dtype)
        found = product({name: given[name] for name in product.parameters})
        return _by_parameter(self.expression, _spread(found, shape), [p.name for p in self.wrt])

    def _product(self, which: tuple[Param, ...]) -> Evaluator:
        """The program of the Hessian times a direction along these parameters: the gradient of the derivative along it."""
        if which not in self._products:
            options = self._options
            along = jvp(self.expression, {p: direction_of(p) for p in which}, options.maps)
            slopes = compiled_outputs(along, self.wrt, 1, options.discontinuities, options.maps, options.integration.closed_forms)[1]
            self._products[which] = product = Evaluator(slopes, [], options)
            product._titles = ("the Hessian times the direction",)
        return self._products[which]

    # -- reports -------------------------------------------------------------------------------------------------------

    def explain(self, derivatives: int = 0) -> Explanation:
        """What the compiler found and did: surfaces, reparameterisations, rules and nodes; `derivatives` as of `teg.explain`."""
        options = self._options
        return explain(
            write_all_out(self.expression) if options.functions == "inlined" else self.expression,
            self.wrt,
            options.integration.tol,
            rule=options.integration.rule,
            order=options.integration.order,
            seed=options.integration.seed,
            discontinuities=options.discontinuities,
            derivatives=derivatives,
            maps=options.maps,
            max_roots=options.integration.max_roots,
            intrinsics=options.integration.intrinsics,
        )

    def diagnose(self, *args: Any, **named: Any) -> list[Diagnosis]:
        """Where and why the expression is not differentiable at these values; an empty list where it is."""
        columns, _shape, n = self._columns(args, named)
        self._outcome("value", 2 if 2 in self._kernels else 1, columns, n)  # with room for all roots
        return diagnose(self, as_doubles(columns), n)

    def __repr__(self) -> str:
        return f"<teg.Evaluator({', '.join(self.parameters)}) of {str(self.expression)[:120]} on {self._options.backend}>"

    def __reduce__(self) -> tuple[object, ...]:
        return (Evaluator, (self.expression, self.wrt, self._options))

    # -- inside --------------------------------------------------------------------------------------------------------

    def _known(self, direction: Mapping[str, Any]) -> None:
        names = [p.name for p in self.wrt]
        for k in direction:
            if k not in names:
                raise ParameterError(f"{k!r} is not differentiated by", None, "parameters: " + ", ".join(names))

    def _matrix(self, e: Expr, blocks: Any, names: list[str]) -> dict[tuple[str, str], Any]:
        if isinstance(e, Tuple):
            parts = [self._matrix(entry, block, names) for entry, block in zip(e.children, blocks, strict=True)]
            return {k: tuple(p[k] for p in parts) for k in ((a, b) for a in names for b in names)}
        return {(a, b): blocks[i][j] for i, a in enumerate(names) for j, b in enumerate(names)}

    def _gradient(self, rows: Any, shape: tuple[int, ...]) -> dict[str, Any]:
        blocks = _nested(self._derived.derivation.outputs(1)[1], rows, shape)
        return _by_parameter(self.expression, blocks, [p.name for p in self.wrt])

    def _run(self, orders: int, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[np.ndarray, tuple[int, ...]]:
        shape: tuple[int, ...] = ()
        if self._quick and (numbers := plain_numbers(self.parameters, args, named)) is not None:
            outcome = cast(Any, self.kernel(orders)).at_point(numbers)
            if not (outcome.missed or outcome.crowded or self._is_sampled(orders) or any(map(math.isnan, outcome.values[:, 0].tolist()))):
                return outcome.values, shape
        columns, shape, n = self._columns(args, named)
        self._checks.run(dict(zip(self.parameters, columns, strict=True)))
        outcome = self._outcome("value", orders, columns, n)
        if self._options.inaccurate != "ignore":
            self._report(orders, outcome, columns, n)
        return rounded(outcome.values) if self._rounds else outcome.values, shape

    def _report(self, orders: int, outcome: Outcome, columns: Sequence[np.ndarray], n: int) -> None:
        """Warn, or raise, where a tolerance was missed, or a result is no number though all parameters are."""
        import numpy as np

        options, doubles = self._options, as_doubles(columns)
        given, names = dict(zip(self.parameters, doubles, strict=True)), self._result_names(orders)
        sampled, crowded = self._is_sampled(orders), outcome.crowded
        if outcome.missed or sampled:
            estimated = self._outcome("errors", orders, doubles, n)
            found, results = estimated.values, len(estimated.values) // 2
            if report_missed(found[:results], found[results:], names, options.integration.tol, options.inaccurate, given, sampled):
                return
        if np.isnan(outcome.values).any():
            report_not_a_number(outcome.values, names, options.inaccurate, given, crowded)

    def _is_sampled(self, orders: int) -> bool:
        """Whether samples were taken that nobody asked for: they rarely reach a tolerance."""
        if orders not in self._sampled:
            how = self._options.integration
            self._sampled[orders] = how.rule == "auto" and any(isinstance(s, Sample) for s in statements(self.program(orders).body))
        return self._sampled[orders]

    def _estimated(self, orders: int, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[np.ndarray, tuple[int, ...]]:
        columns, shape, n = self._columns(args, named)
        self._checks.run(dict(zip(self.parameters, columns, strict=True)))
        outcome = self._outcome("errors", orders, as_doubles(columns), n)
        found, results = outcome.values, len(outcome.values) // 2
        if self._options.inaccurate != "ignore":
            given = dict(zip(self.parameters, as_doubles(columns), strict=True))
            report_not_a_number(found[:results], self._result_names(orders), self._options.inaccurate, given, outcome.crowded)
        return with_rounding(found) if self._options.dtype == "float32" else found, shape

    def output_names(self, derivatives: int = 0) -> list[str]:
        """What each output of the program of value, gradient and Hessian is, in order: "value", "d value / d t", "d2 value / d t d a"; of a
        tuple "value[0]" and so on."""
        entries = _places(self.expression, "value")
        names = [p.name for p in self.wrt]
        found = list(entries)
        if derivatives > 0:
            found += [f"d {entry} / d {a}" for entry in entries for a in names]
        if derivatives > 1:
            found += [f"d2 {entry} / d {a} d {b}" for entry in entries for a in names for b in names]
        return found

    def _result_names(self, orders: int) -> list[str]:
        """What each result is, for messages."""
        return [kind for kind, e in zip(self._titles, self.outputs(orders), strict=False) for _ in flatten(e)]

    def _columns(self, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[list[np.ndarray], tuple[int, ...], int]:
        return batch(self.parameters, args, named, self._options.dtype)


def build_kernel(program: Program, options: Options, dtype: str = "float64", counted: bool = False) -> Kernel:
    """A backend's kernel of a program; a `counted` one counts evaluations (JAX does not: its twin is NumPy's). Of the backends C alone has
    use for another dtype than float64."""
    if options.backend == "c":
        from teg.backends.c.kernel import compile_c

        return compile_c(program, threads=options.threads, counted=counted, dtype=dtype)
    if options.backend == "jax" and not counted:
        from teg.backends.jax.kernel import compile_jax
        from teg.backends.jax.precision import InDoublePrecision

        return compile_jax(program) if options.dtype == "float64" else InDoublePrecision(program)
    from teg.backends.numpy.kernel import compile_numpy

    return compile_numpy(program, memory=options.memory)


def _nested(e: Expr, rows: Any, shape: tuple[int, ...]) -> Any:
    """Rows of results in the structure of a tuple expression."""
    if isinstance(e, Tuple):
        return tuple(_nested(entry, rows, shape) for entry in e.children)
    row = next(rows)
    return row.reshape(shape) if shape else row[0]


def _places(e: Expr, name: str) -> list[str]:
    """The name of each entry of a tuple expression, nested ones in order."""
    if not isinstance(e, Tuple):
        return [name]
    return [place for i, entry in enumerate(e.children) for place in _places(entry, f"{name}[{i}]")]


def _by_parameter(e: Expr, blocks: Any, names: list[str]) -> dict[str, Any]:
    if isinstance(e, Tuple):
        parts = [_by_parameter(entry, block, names) for entry, block in zip(e.children, blocks, strict=True)]
        return {k: tuple(p[k] for p in parts) for k in names}
    return dict(zip(names, blocks, strict=True))


def _spread(found: Any, shape: tuple[int, ...]) -> Any:
    """Results of the shape of a batch, some of whose parameters they do not depend on."""
    if isinstance(found, tuple):
        return tuple(_spread(part, shape) for part in found)
    if found.shape == shape:
        return found
    import numpy as np

    return np.broadcast_to(found, shape).copy()


def _combine(pairs: list[tuple[Any, Any]], like: Any) -> Any:
    if isinstance(like, tuple):
        return tuple(_combine([(g[i], d) for g, d in pairs], v) for i, v in enumerate(like))
    return sum((g * d for g, d in pairs[1:]), start=pairs[0][0] * pairs[0][1]) if pairs else 0.0
