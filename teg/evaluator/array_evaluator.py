"""Evaluators of programs with arrays, indices and sums."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from teg.errors import ArrayIndexError, OptionError, ParameterError
from teg.evaluator.arguments import as_doubles, as_floats, rounded, values
from teg.evaluator.array_arguments import Call, as_entries, whole_numbers
from teg.evaluator.array_plan import Compiled, direction_of
from teg.evaluator.array_reports import paired, places, report_arrays, report_missing
from teg.evaluator.options import Options
from teg.ir.arrays import Array, arrays_of, integer_parameters, integers_of
from teg.ir.cells import check_indices, replace_integers
from teg.ir.expr import Expr, Param, Tuple
from teg.ir.index import ArrayName, Length, index_const, index_leaves
from teg.ir.node import postorder
from teg.ir.traverse import parameters
from teg.passes.differentiate.through_sums import Parameter, on_cells, outlined
from teg.passes.lower.loops import schedule_arrays
from teg.passes.normalise.sums import NeedsLengths
from teg.pipeline import flatten, normal_form
from teg.program.arrays import ArrayProgram
from teg.report.diagnose import Diagnosis
from teg.report.explain import Explanation, explain

if TYPE_CHECKING:
    pass

KEPT = 16
"""Programs that are kept for different shapes, where they must be known."""


class ArrayEvaluator:
    """A compiled expression with arrays. Call it with parameters and arrays by name, by position (in the order of `parameters`), or as
    one dict.

    An array has the shape that its dimensions say; axes in front of these are a batch, and broadcast with the shape of the scalars. The
    derivative by an array has the array's shape. Evaluators are immutable to their users, safe to share between threads, and pickle.
    """

    def __init__(self, e: Expr, wrt: Sequence[Parameter] | None, options: Options) -> None:
        check_indices(e)
        self.expression = e
        self._options = options
        arrays = arrays_of(e)
        scalars = list(dict.fromkeys([*parameters(e), *integer_parameters(e)]))
        counted = set(integer_parameters(e))
        default = [p for p in scalars if p not in counted or p in parameters(e)] + [a for a in arrays if isinstance(a, Array)]
        self.wrt: tuple[Parameter, ...] = tuple(default if wrt is None else wrt)
        every = list(dict.fromkeys([*self.wrt, *scalars, *arrays, *(p for m in options.maps for p in m.parameters)]))
        self.parameters: tuple[str, ...] = tuple(p.name for p in every)
        self._scalars = tuple(p.name for p in every if isinstance(p, Param))
        self._arrays = tuple(a for a in every if isinstance(a, ArrayName))
        self._integers = {self._scalars.index(p.name) for p in integer_parameters(e)}
        self._leaves = flatten(e)
        self._made: dict[tuple[int, ...], Compiled] = {}
        self._specialised = False
        try:
            self._made[()] = self._compile(e)
            self._made[()].kernel("value")
        except NeedsLengths:
            self._specialised = True

    # -- calls ---------------------------------------------------------------------------------------------------------

    def __call__(self, *args: Any, **named: Any) -> Any:
        """The value."""
        found, shape = self._run("value", args, named)
        return self._nested(iter(found), shape)

    def value_and_grad(self, *args: Any, **named: Any) -> tuple[Any, dict[str, Any]]:
        """The value, and a dict name -> derivative: a number for a parameter, for an array an array of its shape."""
        found, shape = self._run("gradient", args, named)
        rows = iter(found)
        return self._nested(rows, shape), self._by_name(rows, shape)

    def grad(self, *args: Any, **named: Any) -> dict[str, Any]:
        """The dict name -> derivative."""
        return self.value_and_grad(*args, **named)[1]

    def value_and_error(self, *args: Any, **named: Any) -> tuple[Any, Any]:
        """The value, and an estimate of its error, as `Evaluator.value_and_error` gives it; those of the terms of a sum are added up."""
        values, errors = self._estimated("value", args, named)
        return self._nested(iter(values), ()), self._nested(iter(errors), ())

    def grad_and_error(self, *args: Any, **named: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """The dict name -> derivative, and the dict of estimates of their errors, of the same shapes."""
        first, second = (self._by_name(iter(part[len(self._leaves) :]), ()) for part in self._estimated("gradient", args, named))
        return first, second

    def hvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> dict[str, Any]:
        """The Hessian times a direction (a dict name -> number, or array of the parameter's shape), a dict; no matrix is formed.

        What the direction does not name does not move. Cost: a small multiple of the gradient's.
        """
        given, which = self._moved(values, direction)
        found, shape = self._run("product", (given,), {}, which)
        return self._by_name(iter(found), shape)

    def _moved(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> tuple[dict[str, Any], tuple[Parameter, ...]]:
        """What is given, with the directions of the parameters that move, and these parameters."""
        given = self._given((values,), {})
        moved = {self._name(k): v for k, v in direction.items()}
        if unknown := sorted(moved.keys() - {p.name for p in self.wrt}):
            raise ParameterError(f"{unknown[0]!r} is not differentiated by", None, "parameters: " + ", ".join(p.name for p in self.wrt))
        which = tuple(p for p in self.wrt if p.name in moved)
        return {**given, **{direction_of(p).name: moved[p.name] for p in which}}, which

    def hessian(self, *args: Any, **named: Any) -> dict[tuple[str, str], Any]:
        """Second derivatives, a dict (name, name) -> array; by an array of shape s and one of shape r it has the shape s + r, behind that
        of the batch. One product a number: `hvp` is what scales."""
        given = self._given(args, named)
        found: dict[tuple[str, str], Any] = {}
        for q in self.wrt:
            columns: dict[str, list[Any]] = {p.name: [] for p in self.wrt}
            for direction in self._units(given, q):
                for name, product in self.hvp(given, {q.name: direction}).items():
                    columns[name].append(product)
            for p in self.wrt:
                found[p.name, q.name] = _stacked(columns[p.name], self._shape(given, p), self._shape(given, q))
        return found

    def _shape(self, given: Mapping[str, Any], p: Parameter) -> tuple[int, ...]:
        """The shape of a parameter, without a batch."""
        return as_entries(p, given[p.name], "float64").shape[-p.dimensions :] if isinstance(p, Array) else ()

    def _units(self, given: Mapping[str, Any], q: Parameter) -> Iterator[Any]:
        """A direction for each of the entries of a parameter."""
        import numpy as np

        shape = self._shape(given, q)
        for place in np.ndindex(*shape):
            direction = np.zeros(shape)
            direction[place] = 1.0
            yield direction

    def jvp(self, values: Mapping[str, Any], direction: Mapping[str, Any]) -> tuple[Any, Any]:
        """The value, and the derivative along a direction (a dict name -> number, or array of the parameter's shape)."""
        import numpy as np

        value, slopes = self.value_and_grad(values)
        dimensions = {p.name: p.dimensions if isinstance(p, Array) else 0 for p in self.wrt}

        def along(gradient: Any, name: str, d: Any) -> Any:
            product = np.multiply(gradient, d)
            return product.sum(axis=tuple(range(-dimensions[name], 0))) if dimensions[name] else product

        moved = {self._name(k): v for k, v in direction.items()}
        if unknown := sorted(moved.keys() - dimensions.keys()):
            raise ParameterError(f"{unknown[0]!r} is not differentiated by", None, "parameters: " + ", ".join(dimensions))
        if isinstance(value, tuple):
            return value, tuple(sum(along(slopes[k][i], k, d) for k, d in moved.items()) for i in range(len(value)))
        return value, sum(along(slopes[k], k, d) for k, d in moved.items())

    def vjp(self, values: Mapping[str, Any], cotangent: Any = 1.0) -> tuple[Any, dict[str, Any]]:
        """The value, and the dict name -> Σ cotangent · derivative; a tuple expression takes a tuple of cotangents."""
        import numpy as np

        value, slopes = self.value_and_grad(values)
        dimensions = {p.name: p.dimensions if isinstance(p, Array) else 0 for p in self.wrt}

        def times(slope: Any, w: Any, name: str) -> Any:
            return slope * np.asarray(w).reshape(np.shape(w) + (1,) * dimensions[name])

        if not isinstance(value, tuple):
            return value, {k: times(s, cotangent, k) for k, s in slopes.items()}
        weights = tuple(cotangent) if isinstance(cotangent, tuple | list) else (cotangent,) * len(value)
        return value, {k: sum(times(s, w, k) for s, w in zip(ss, weights, strict=True)) for k, ss in slopes.items()}

    def evaluations(self, *args: Any, derivatives: int = 0, **named: Any) -> int:
        """At how many points a call (`derivatives`: 0 the value, 1 value and gradient, 2 these and `hessian`) evaluates integrands that
        have no integral inside, over all iterations and the whole batch."""
        if derivatives not in (0, 1, 2):
            raise OptionError(f"derivatives={derivatives!r} is not known", None, "0: value, 1: and gradient, 2: and Hessian")
        given = self._given(args, named)
        total = cast(int, self._results(("value", "gradient", "gradient")[derivatives], (given,), {}, (), counted=True)[0].evaluations)
        for q in self.wrt if derivatives == 2 else ():
            for direction in self._units(given, q):
                moved, which = self._moved(given, {q.name: direction})
                total += self._results("product", (moved,), {}, which, counted=True)[0].evaluations
        return total

    def kernel(self, orders: int) -> Any:
        """The compiled program of the value (0), or of value and gradient (1), built when it is first needed; that of a program that
        depends on the shapes of its arrays is built when it is called."""
        return None if self._specialised else self._made[()].kernel(("value", "gradient")[orders])

    # -- reports -------------------------------------------------------------------------------------------------------

    def explain(self, derivatives: int = 0) -> Explanation:
        """What the compiler found and did: loops, and of every cell the surfaces, reparameterisations and rules; `derivatives` as of
        `teg.explain`. A program that is compiled for lengths of arrays is explained for those of the first call."""
        how = self._options.integration
        made = next(iter(self._made.values()), None)
        return explain(
            self.expression if made is None else made.e,
            self.wrt,
            how.tol,
            rule=how.rule,
            order=how.order,
            seed=how.seed,
            discontinuities=self._options.discontinuities,
            derivatives=derivatives,
            maps=self._options.maps,
            max_roots=how.max_roots,
            intrinsics=how.intrinsics,
        )

    def diagnose(self, *args: Any, **named: Any) -> list[Diagnosis]:
        """Where and why the expression is not differentiable at these values, and in which iteration of its sums; an empty list where it
        is."""
        import numpy as np

        from teg.report.array_diagnose import diagnose_arrays, probes_of

        call = self._call(args, named)
        made = call.made
        self._results("gradient", args, named, ())  # with room for all roots
        program = made.program("gradient", (), how=made.room("gradient"))
        values = [on_cells(leaf, partial(normal_form, maps=self._options.maps)) for leaf in flatten(made.e)]
        probes = schedule_arrays([probes_of(v) for v in values], self._scalars, self._arrays, made.flat)
        call.check(program)
        call.check(probes)
        second: Any = None
        if made.has_products:
            given = self._given(args, named)
            moved, which = self._moved(given, {p.name: np.ones(self._shape(given, p)) for p in self.wrt})
            products = self._results("product", (moved,), {}, which)[0].values
            second = np.all([np.isfinite(v).reshape(call.n, -1).all(axis=1) for v in products], axis=0)
        return diagnose_arrays(self.wrt, program, probes, call, second)

    @property
    def dtype(self) -> str:
        """What values of parameters and results are: "float64" or "float32"."""
        return self._options.dtype

    @property
    def dimensions(self) -> dict[str, int]:
        """How many dimensions each parameter has, 0 for a number."""
        found = {**dict.fromkeys(self._scalars, 0), **{a.name: a.dimensions for a in self._arrays}}
        return {name: found[name] for name in self.parameters}

    @property
    def integers(self) -> frozenset[str]:
        """The parameters that hold an integer."""
        return frozenset(self._scalars[k] for k in self._integers)

    def program(self, orders: int) -> ArrayProgram:
        """The scheduled program of the value (0), value and gradient (1), and these with the product of the Hessian and a direction (2),
        whose parameters stand behind the others: that of t is called ∂t. Raises ArrayIndexError where lengths of arrays must be known."""
        if self._specialised:
            hint = "give the sum inside the integral a range of numbers, or write the integral inside the sum"
            raise ArrayIndexError("this program is made for the lengths of its arrays, and these are not known", self.expression, hint)
        return self._made[()].program(("value", "gradient", "both")[orders], self.wrt if orders == 2 else ())

    def output_names(self, derivatives: int = 0) -> list[str]:
        """What each output of `program` is, in order, as `Evaluator.output_names` has them."""
        entries = places(self.expression, "value")
        slopes = [f"d {entry} / d {p.name}" for entry in entries for p in self.wrt]
        products = [f"d2 {entry} / d {p.name} d direction" for entry in entries for p in self.wrt]
        return [*entries, *(slopes if derivatives > 0 else []), *(products if derivatives > 1 else [])]

    @property
    def source(self) -> str:
        """The text of everything generated: value, and value with gradient."""
        made = self._made[()] if not self._specialised else next(iter(self._made.values()), None)
        if made is None:
            return "nothing yet: this program is compiled for the shapes of its arrays, when it is first called"
        return cast(str, made.kernel("gradient").source)

    def __repr__(self) -> str:
        return f"<teg.ArrayEvaluator({', '.join(self.parameters)}) of {str(self.expression)[:120]} on {self._options.backend}>"

    def __reduce__(self) -> tuple[object, ...]:
        return (ArrayEvaluator, (self.expression, self.wrt, self._options))

    # -- inside --------------------------------------------------------------------------------------------------------

    def _name(self, key: object) -> str:
        return key.name if isinstance(key, Param | ArrayName) else cast(str, key)

    def _given(self, args: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
        if len(args) == 1 and isinstance(args[0], Mapping):
            args = ({self._name(k): v for k, v in args[0].items()},)
        return values(self.parameters, args, named)

    def _run(
        self, what: str, args: tuple[Any, ...], named: Mapping[str, Any], which: tuple[Parameter, ...] = ()
    ) -> tuple[list[Any], tuple[int, ...]]:
        results, shape, made = self._results(what, args, named, which)
        if self._options.inaccurate != "ignore":
            given = args[0] if which else self._given(args, named)
            pairs = {k: (given[k], d) for k, d in self.dimensions.items()}
            told, names, sampled = False, self._result_names(what), made.is_sampled(what, which)
            if results.missed or sampled:
                found = self._results(what, args, named, which, errors=True)[0].values
                told = report_arrays(found, names, self._options, pairs, shape, sampled)
            if not told:
                report_missing(results.values, names, self._options, pairs, shape, results.crowded)
        values = [rounded(v) for v in results.values] if self._options.dtype == "float32" else results.values
        return [v.reshape(shape + v.shape[1:]) if shape else v[0] for v in values], shape

    def _estimated(self, what: str, args: tuple[Any, ...], named: Mapping[str, Any]) -> tuple[list[Any], list[Any]]:
        """Results, and the estimates of their errors."""
        results, shape, _ = self._results(what, args, named, (), errors=True)
        if self._options.inaccurate != "ignore":
            given = self._given(args, named)
            numbers = {k: (given[k], d) for k, d in self.dimensions.items()}
            half = results.values[: len(results.values) // 2]
            report_missing(half, self._result_names(what), self._options, numbers, shape, results.crowded)
        pairs = paired(results.values, self._options.dtype)
        found = [[v.reshape(shape + v.shape[1:]) if shape else v[0] for v in half] for half in zip(*pairs, strict=True)]
        return found[0], found[1]

    def _result_names(self, what: str) -> list[str]:
        """What each result is, for messages."""
        slopes = [f"the {'derivative' if what == 'gradient' else 'Hessian times the direction'} by {p.name}" for p in self.wrt]
        return [*(["the value"] * len(self._leaves) if what != "product" else []), *(slopes * len(self._leaves) if what != "value" else [])]

    def _results(
        self,
        what: str,
        args: tuple[Any, ...],
        named: Mapping[str, Any],
        which: tuple[Parameter, ...],
        counted: bool = False,
        errors: bool = False,
    ) -> tuple[Any, tuple[int, ...], Compiled]:
        import numpy as np

        call = self._call(args, named, which)
        kernel = call.made.kernel(what, which, counted, errors)
        call.check(kernel.program)
        if self._options.maps and self._options.check_maps:
            arrays = {a.name: v for a, v in zip(self._arrays, call.arrays, strict=False)}
            call.made.map_checks().run(dict(zip(self._scalars, call.columns, strict=False)), arrays, self.dimensions, call.n)
        results = kernel.results(call.columns, call.arrays, call.n)
        while results.crowded and any(np.isnan(v).any() for v in results.values) and call.made.widen(what, which, counted, errors):
            results = call.made.kernel(what, which, counted, errors).results(call.columns, call.arrays, call.n)
        return results, call.shape, call.made

    def _call(self, args: tuple[Any, ...], named: Mapping[str, Any], which: tuple[Parameter, ...] = ()) -> Call:
        """What a call is given, as kernels take it; with `which`, directions along these parameters too."""
        import numpy as np

        directions = tuple(direction_of(p) for p in which)
        scalars = [*self._scalars, *(d.name for d in directions if isinstance(d, Param))]
        arrays = [*self._arrays, *(d for d in directions if isinstance(d, Array))]
        given = args[0] if directions else self._given(args, named)
        dtype = self._options.dtype
        columns = as_doubles([as_floats(s, given[s], "float64" if k in self._integers else dtype) for k, s in enumerate(scalars)])
        entries = [as_entries(a, given[a.name], dtype) for a in arrays]
        leading = [c.shape for c in columns] + [v.shape[: v.ndim - a.dimensions] for a, v in zip(arrays, entries, strict=True)]
        try:
            shape = np.broadcast_shapes(*leading)
        except ValueError:
            text = ", ".join(f"{k}: {s}" for k, s in zip([*scalars, *(a.name for a in arrays)], leading, strict=True) if s)
            raise ParameterError(f"the shapes of the batch do not broadcast together: {text}") from None
        n = math.prod(shape)
        shapes = [v.shape[v.ndim - a.dimensions :] for a, v in zip(arrays, entries, strict=True)]
        for p, d in zip(which, directions, strict=True):
            if isinstance(p, Array) and shapes[arrays.index(p)] != shapes[arrays.index(cast(Array, d))]:
                what_is = f"{shapes[arrays.index(cast(Array, d))]}, {p.name} has {shapes[arrays.index(p)]}"
                raise ParameterError(f"the direction along {p.name} has the shape {what_is}")
        columns = [c if c.ndim == 0 else np.ascontiguousarray(np.broadcast_to(c, shape)).reshape(n) for c in columns]
        integers = {k: whole_numbers(self._scalars[k], columns[k]) for k in self._integers}
        made = self._compiled(dict(zip(arrays, shapes, strict=True)))
        flat = [
            v if v.ndim == a.dimensions else np.ascontiguousarray(np.broadcast_to(v, (*shape, *s))).reshape(n, *s)
            for a, v, s in zip(arrays, entries, shapes, strict=True)
        ]
        return Call(columns, flat, n, shape, made, integers, shapes)

    def _compiled(self, shapes: Mapping[ArrayName, tuple[int, ...]]) -> Compiled:
        """The program, for these shapes if it depends on them."""
        if not self._specialised:
            return self._made[()]
        key = tuple(n for a in self._arrays for n in shapes[a])
        if key not in self._made:
            lengths = {n for node in postorder([self.expression]) for n in index_leaves(integers_of(node)) if isinstance(n, Length)}
            numbers = {n: index_const(shapes[n.array][n.axis]) for n in lengths}
            try:
                self._made[key] = self._compile(replace_integers(self.expression, numbers))  # type: ignore[arg-type]
            except NeedsLengths as request:  # pragma: no cover: the lengths are numbers now
                raise ArrayIndexError(str(request), request.node) from None
            while len(self._made) > KEPT:
                del self._made[next(iter(self._made))]
        return self._made[key]

    def _compile(self, e: Expr) -> Compiled:
        return Compiled(outlined(e), self.wrt, self._scalars, self._arrays, self._options)

    def _nested(self, rows: Iterator[Any], shape: tuple[int, ...]) -> Any:
        return _nested(self.expression, rows)

    def _by_name(self, rows: Iterator[Any], shape: tuple[int, ...]) -> dict[str, Any]:
        parts = [[next(rows) for _ in self.wrt] for _ in self._leaves]
        return {p.name: _nested(self.expression, iter([part[i] for part in parts])) for i, p in enumerate(self.wrt)}


def _nested(e: Expr, rows: Iterator[Any]) -> Any:
    """Results in the structure of a tuple expression."""
    return tuple(_nested(entry, rows) for entry in e.children) if isinstance(e, Tuple) else next(rows)


def _stacked(columns: Sequence[Any], rows: tuple[int, ...], behind: tuple[int, ...]) -> Any:
    """Products with unit directions as a block of the Hessian, of shape rows + behind (behind a batch)."""
    import numpy as np

    if columns and isinstance(columns[0], tuple):
        return tuple(_stacked([c[i] for c in columns], rows, behind) for i in range(len(columns[0])))
    if not behind:
        return columns[0]
    block = np.stack(columns, axis=-1) if columns else np.zeros((*rows, 0))
    return block.reshape(*block.shape[:-1], *behind)
