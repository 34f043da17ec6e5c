"""`teg.compile`, `teg.evaluate`, and what they give: an Evaluator."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from numbers import Real
from typing import TYPE_CHECKING, Any, Protocol, cast

from teg.accuracy import report_missed
from teg.build import check_parameters, check_program
from teg.coverage import MapChecks
from teg.diagnose import Diagnosis, diagnose
from teg.diffeomorphism import Diffeomorphism, checked_maps
from teg.errors import OptionError, ParameterError
from teg.explain import Explanation, explain
from teg.expr import Expr, Param, Tuple, as_number
from teg.integration import DEFAULT_TOL, Integration
from teg.isolation import MAX_ROOTS
from teg.pipeline import ESTIMATORS, compiled_outputs, flatten, program_for
from teg.program import Outcome, Program, Sample, statements
from teg.traverse import parameters

if TYPE_CHECKING:
    import numpy as np

Array = Any  # a float64 array of the batch's shape, a NumPy scalar where there is no batch
BACKENDS = ("numpy", "c", "jax")


class Kernel(Protocol):
    """What a backend makes of a program: columns of shape () or (n,) in, outputs of shape (number of outputs, n) out."""

    source: str

    def outcome(self, columns: Sequence[np.ndarray], n: int) -> Outcome: ...

    def __call__(self, columns: Sequence[np.ndarray], n: int) -> np.ndarray: ...


def compile(
    e: object,
    parameters: Sequence[Param] | Param | None = None,
    *,
    backend: str = "numpy",
    tol: float = DEFAULT_TOL,
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
) -> Evaluator:
    """An evaluator of a closed expression, of its gradient and of its Hessian.

    `parameters` are those to differentiate by, in the order of `f.parameters` (default: all that occur in e; others that occur are
    arguments after them). `backend` is "numpy", "c" or "jax". `threads` are the C backend's, `memory` (bytes) bounds the NumPy backend's
    temporary arrays. `discontinuities` says what becomes of the Dirac deltas of a derivative: "sift" (the right thing) or "ignore" (plain
    automatic differentiation, for comparison). `max_roots` is how many roots a condition may have whose number no theorem bounds; with
    more of them the result is NaN, and `diagnose` says so.

    `tol` is the tolerance, absolute and relative to the integral of |integrand| over a piece. `rule`, and what `order` means to it:

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

    Raises ScopeError for a free variable, NameClashError for one name given to two things, OptionError for an option that is unknown.
    The gradient is derived when it is first asked for; a surface that no family can reduce raises NoReparameterisationError then.
    """
    program = e if isinstance(e, Tuple) else as_number(e)
    check_program(program)
    wrt = None if parameters is None else check_parameters(parameters)
    return Evaluator(
        program,
        wrt,
        _Options(
            backend, Integration(tol, rule, order, seed, max_roots), inaccurate, dtype, threads, memory, discontinuities, maps, check_maps
        ),
    )


def evaluate(e: object, values: Mapping[Any, Any] | None = None, *, backend: str = "numpy", **options: Any) -> Any:
    """The value of an expression at parameter values (keys are parameters or their names); e may hold deltas and derivatives.

    Values of parameters that e does not have are passed over: a derivative may have lost some.
    """
    f = compile(e, backend=backend, **options)
    names = {(k.name if isinstance(k, Param) else k): v for k, v in (values or {}).items()}
    return f({k: v for k, v in names.items() if k in f.parameters} if values else {})


class _Options:
    """Checked options of a compilation."""

    def __init__(
        self,
        backend: str,
        integration: Integration,
        inaccurate: str,
        dtype: object,
        threads: int,
        memory: int,
        discontinuities: str,
        maps: Sequence[Diffeomorphism],
        check_maps: bool,
    ) -> None:
        if backend not in BACKENDS:
            raise OptionError(f"backend={backend!r} is not known", None, "one of: " + ", ".join(BACKENDS))
        if inaccurate not in ("warn", "raise", "ignore"):
            raise OptionError(f"inaccurate={inaccurate!r} is not known", None, 'one of: "warn", "raise", "ignore"')
        if not _is_float64(dtype):
            raise OptionError(f"dtype={dtype!r} is not available", None, "only float64 is")
        if not isinstance(threads, int) or threads < 1:
            raise OptionError(f"threads={threads!r} is not a number of threads", None, "1, 2, …")
        if not isinstance(memory, int) or memory < 2**16:
            raise OptionError(f"memory={memory!r} is not a number of bytes of at least 65536")
        if discontinuities not in ESTIMATORS:
            raise OptionError(f"discontinuities={discontinuities!r} is not known", None, "one of: " + ", ".join(ESTIMATORS))
        self.backend, self.threads, self.memory = backend, threads, memory
        self.integration, self.inaccurate, self.discontinuities = integration, inaccurate, discontinuities
        self.maps, self.check_maps = checked_maps(maps), bool(check_maps)


def _is_float64(dtype: object) -> bool:
    import numpy as np

    try:
        return dtype == "float64" or np.dtype(cast(Any, dtype)) == np.float64
    except TypeError:
        return False


class Evaluator:
    """A compiled expression. Call it with the parameters by name, by position (in the order of `parameters`) or as one dict.

    Values are scalars or arrays that broadcast together to the batch's shape; results have that shape (a NumPy scalar if there is no
    batch). A tuple expression gives a tuple. Evaluators are immutable to their users, safe to share between threads, and pickle.
    """

    def __init__(self, e: Expr, wrt: Sequence[Param] | None, options: _Options) -> None:
        self.expression = e
        found = parameters(e)
        self.wrt: tuple[Param, ...] = tuple(found if wrt is None else wrt)
        every = list(dict.fromkeys([*self.wrt, *found, *(p for m in options.maps for p in m.parameters)]))
        self.parameters: tuple[str, ...] = tuple(p.name for p in every)
        self._options = options
        self._outputs: dict[int, list[Expr]] = {}
        self._kernels: dict[int, Kernel] = {}
        self._special: dict[tuple[str, int], Kernel] = {}
        self._sampled: dict[int, bool] = {}
        self._checks = MapChecks(e, options.maps if options.check_maps else ())
        self.kernel(0)

    # -- programs ------------------------------------------------------------------------------------------------------

    def outputs(self, orders: int) -> list[Expr]:
        """The δ-free expressions of value, gradient, Hessian (as many as asked for)."""
        if orders not in self._outputs:
            self._outputs[orders] = compiled_outputs(self.expression, self.wrt, orders, self._options.discontinuities, self._options.maps)
        return self._outputs[orders]

    def program(self, orders: int) -> Program:
        """The scheduled program of value (0), value and gradient (1), value, gradient and Hessian (2)."""
        return program_for(self._flat(orders), self.parameters, self._options.integration)

    def _flat(self, orders: int) -> list[Expr]:
        return [leaf for e in self.outputs(orders) for leaf in flatten(e)]

    def kernel(self, orders: int) -> Kernel:
        """The compiled program, built when it is first needed."""
        if orders not in self._kernels:
            self._kernels[orders] = _build(self.program(orders), self._options)
        return self._kernels[orders]

    def _estimating(self, orders: int) -> Kernel:
        """The program with error estimates."""
        key = "errors", orders
        if key not in self._special:
            program = program_for(self._flat(orders), self.parameters, self._options.integration, errors=True)
            self._special[key] = _build(program, self._options)
        return self._special[key]

    def _counting(self, orders: int) -> Kernel:
        """The program as one that counts evaluations; for JAX, which does not, by NumPy."""
        key = "count", orders
        if key not in self._special:
            self._special[key] = _build(self.program(orders), self._options, counted=True)
        return self._special[key]

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
        return self._counting(derivatives).outcome(columns, n).evaluations

    def hessian(self, *args: Any, **named: Any) -> dict[tuple[str, str], Any]:
        """Second derivatives, a dict (name, name) -> array, with both orders of the names."""
        rows, shape = self._run(2, args, named)
        source = iter(rows)
        _nested(self.expression, source, shape)
        self._gradient(source, shape)
        names = [p.name for p in self.wrt]
        blocks = _nested(self.outputs(2)[2], source, shape)
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
        """The Hessian times a direction (a dict name -> number or array), a dict."""
        matrix = self.hessian(values)
        self._known(direction)
        return {p.name: _combine([(matrix[p.name, k], d) for k, d in direction.items()], None) for p in self.wrt}

    # -- reports -------------------------------------------------------------------------------------------------------

    def explain(self, derivatives: int = 0) -> Explanation:
        """What the compiler found and did: surfaces, reparameterisations, rules and nodes; `derivatives` as of `teg.explain`."""
        options = self._options
        return explain(
            self.expression,
            self.wrt,
            options.integration.tol,
            rule=options.integration.rule,
            order=options.integration.order,
            seed=options.integration.seed,
            discontinuities=options.discontinuities,
            derivatives=derivatives,
            maps=options.maps,
            max_roots=options.integration.max_roots,
        )

    def diagnose(self, *args: Any, **named: Any) -> list[Diagnosis]:
        """Where and why the expression is not differentiable at these values; an empty list where it is."""
        columns, _shape, n = self._columns(args, named)
        return diagnose(self, columns, n)

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
        blocks = _nested(self.outputs(1)[1], rows, shape)
        return _by_parameter(self.expression, blocks, [p.name for p in self.wrt])

    def _run(self, orders: int, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[np.ndarray, tuple[int, ...]]:
        columns, shape, n = self._columns(args, named)
        self._checks.run(dict(zip(self.parameters, columns, strict=True)))
        outcome = self.kernel(orders).outcome(columns, n)
        if (outcome.missed or self._is_sampled(orders)) and self._options.inaccurate != "ignore":
            found = self._estimating(orders).outcome(columns, n).values
            results = len(found) // 2
            given = dict(zip(self.parameters, columns, strict=True))
            names = self._result_names(orders)
            options = self._options.integration.tol, self._options.inaccurate
            report_missed(found[:results], found[results:], names, *options, given, self._is_sampled(orders))
        return outcome.values, shape

    def _is_sampled(self, orders: int) -> bool:
        """Whether samples were taken that nobody asked for: they rarely reach a tolerance."""
        if orders not in self._sampled:
            how = self._options.integration
            self._sampled[orders] = how.rule == "auto" and any(isinstance(s, Sample) for s in statements(self.program(orders).body))
        return self._sampled[orders]

    def _estimated(self, orders: int, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[np.ndarray, tuple[int, ...]]:
        columns, shape, n = self._columns(args, named)
        self._checks.run(dict(zip(self.parameters, columns, strict=True)))
        return self._estimating(orders).outcome(columns, n).values, shape

    def _result_names(self, orders: int) -> list[str]:
        """What each result is, for messages."""
        kinds = ("the value", "the gradient", "the Hessian")
        return [kind for kind, e in zip(kinds, self.outputs(orders), strict=False) for _ in flatten(e)]

    def _columns(self, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[list[np.ndarray], tuple[int, ...], int]:
        import numpy as np  # when it is needed: `import teg` stays fast

        values = self._values(args, named)
        arrays = [_as_float(name, values[name]) for name in self.parameters]
        try:
            shape = np.broadcast_shapes(*(a.shape for a in arrays))
        except ValueError:
            shapes = ", ".join(f"{k}: {a.shape}" for k, a in zip(self.parameters, arrays, strict=True))
            raise ParameterError(f"the shapes of the parameters do not broadcast together: {shapes}") from None
        n = math.prod(shape)
        columns = [a if a.ndim == 0 else np.ascontiguousarray(np.broadcast_to(a, shape)).reshape(n) for a in arrays]
        return columns, shape, n

    def _values(self, args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
        given: dict[str, Any] = {}
        if len(args) == 1 and isinstance(args[0], Mapping):
            given = {(k.name if isinstance(k, Param) else k): v for k, v in args[0].items()}
        elif len(args) > len(self.parameters):
            raise ParameterError(f"{len(args)} values for {len(self.parameters)} parameters", None, self._signature())
        else:
            given = dict(zip(self.parameters, args, strict=False))
        for k, v in named.items():
            if k in given:
                raise ParameterError(f"the parameter {k!r} is given twice", None, self._signature())
            given[k] = v
        if unknown := [str(k) for k in given.keys() - set(self.parameters)]:
            raise ParameterError(f"there is no parameter named {', '.join(map(repr, unknown))}", None, self._signature())
        if missing := [k for k in self.parameters if k not in given]:
            raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, self._signature())
        return given

    def _signature(self) -> str:
        return "the parameters are " + (", ".join(self.parameters) or "none")


def _build(program: Program, options: _Options, counted: bool = False) -> Kernel:
    """A backend's kernel of a program; a `counted` one counts evaluations (JAX does not: its twin is NumPy's)."""
    if options.backend == "c":
        from teg.backends.c_backend import compile_c

        return compile_c(program, threads=options.threads, counted=counted)
    if options.backend == "jax" and not counted:
        from teg.backends.jax_backend import compile_jax

        return compile_jax(program)
    from teg.backends.numpy_backend import compile_numpy

    return compile_numpy(program, memory=options.memory)


def _as_float(name: str, value: Any) -> np.ndarray:
    import numpy as np

    if isinstance(value, Real | Decimal):
        return np.asarray(float(value))
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"the value of {name!r} is not a real number or an array of them: {value!r:.80}") from None


def _nested(e: Expr, rows: Any, shape: tuple[int, ...]) -> Any:
    """Rows of results in the structure of a tuple expression."""
    if isinstance(e, Tuple):
        return tuple(_nested(entry, rows, shape) for entry in e.children)
    row = next(rows)
    return row.reshape(shape) if shape else row[0]


def _by_parameter(e: Expr, blocks: Any, names: list[str]) -> dict[str, Any]:
    if isinstance(e, Tuple):
        parts = [_by_parameter(entry, block, names) for entry, block in zip(e.children, blocks, strict=True)]
        return {k: tuple(p[k] for p in parts) for k in names}
    return dict(zip(names, blocks, strict=True))


def _combine(pairs: list[tuple[Any, Any]], like: Any) -> Any:
    if isinstance(like, tuple):
        return tuple(_combine([(g[i], d) for g, d in pairs], v) for i, v in enumerate(like))
    return sum((g * d for g, d in pairs[1:]), start=pairs[0][0] * pairs[0][1]) if pairs else 0.0
