"""`teg.jax_function`: a program as a function of JAX, right under all of its transformations."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Mapping, Sequence
from typing import Any, cast

from teg.array_pipeline import outlined, parameters_and_arrays
from teg.array_program import ArrayProgram
from teg.arrays import Array, arrays_of, integer_parameters, integers_of
from teg.bodies import write_all_out
from teg.build import check_program
from teg.cells import check_indices, replace_integers
from teg.errors import ArrayIndexError, BackendError, MissingPackageError, ParameterError
from teg.expr import Expr, Param, Tuple, as_number
from teg.index import ArrayName, IndexArray, Length, index_const, index_leaves
from teg.integration import Integration
from teg.isolation import MAX_ROOTS
from teg.jax_programs import DerivativePrograms
from teg.node import postorder
from teg.options import DEFAULT_TOLS, Options, checked_dtype
from teg.passes.sums import NeedsLengths
from teg.traverse import parameters

Parameter = Param | Array
OLDEST = (0, 8, 0)
"""The first version of JAX with all that this needs: types that say over which axes of a mesh a value varies."""
KEPT = 16
"""Families of programs that are kept for different shapes, integer parameters and index arrays, where they make a difference."""


def jax_function(
    e: object,
    params: Sequence[Parameter] | Parameter | None = None,
    *,
    indices: Mapping[Any, Any] | None = None,
    dtype: object = None,
    tol: float | None = None,
    rule: str = "auto",
    order: int | None = None,
    seed: int = 0,
    discontinuities: str = "sift",
    max_roots: int = MAX_ROOTS,
    maps: Sequence[Any] = (),
) -> JaxFunction:
    """A pure function of JAX: a dict of parameters and arrays by name (a pytree) to the value, or a tuple of values.

        f = teg.jax_function(e)
        jax.jit(jax.value_and_grad(f))({"t": 0.5, "a": 1.0})

    `jit`, `vmap`, `shard_map`, `jvp`, `vjp`, `grad`, `hessian`, `linearize`, `checkpoint` and `scan` work on it in any nesting: derivatives
    of any order are programs made of the symbolic derivative, each when it is first needed, once. Value and gradient come from one program.

    Values broadcast as those of an evaluator do: a number may be an array of the batch's shape, an array has the batch's axes in front.
    `params` are what is differentiated by (default: all real parameters and arrays); the others are constants, as under
    `lax.stop_gradient`. Integer parameters and `teg.indices` may be given at the call, or here by `indices=`; what the number of terms of a
    sum depends on must be known while JAX traces, so not an argument of a jitted function. Other index arrays may be traced, and then
    nothing checks their range: where an index is outside of it, the value is NaN.

    `dtype` is that of numbers, arrays and results: "float32" or "float64", or None for that of the arguments. What is between is computed
    in float64, whatever that is, and also where JAX's 64-bit mode is off. The other options are those of `teg.compile`; `maps` are not
    verified for the values of a call, and no warning tells that a tolerance was missed: an evaluator's `value_and_error` does.

    Raises MissingPackageError without JAX, BackendError for dtype="float64" where the 64-bit mode is off, ParameterError for values that
    are missing, unknown, of wrong shapes or no real numbers, and ArrayIndexError for indices out of range or not known.
    """
    program = e if isinstance(e, Tuple) else as_number(e)
    check_program(program)
    check_indices(program)
    precision = None if dtype is None else checked_dtype(dtype)
    integration = Integration(DEFAULT_TOLS["float64"] if tol is None else tol, rule, order, seed, max_roots)
    options = Options("jax", integration, "ignore", precision or "float64", 1, 2**28, discontinuities, maps, False)
    wrt = None if params is None else parameters_and_arrays(params)
    _import_jax(precision)
    return JaxFunction(program, wrt, options, precision, indices or {})


class JaxFunction:
    """What `teg.jax_function` makes. `parameters` are the names of its arguments; call it with a dict, or by name. It may be shared between
    threads, and pickles."""

    def __init__(self, e: Expr, wrt: Sequence[Parameter] | None, options: Options, dtype: str | None, indices: Mapping[Any, Any]) -> None:
        self.expression = e
        self._given = (e, wrt, options, dtype, dict(indices))
        self._options, self._dtype = options, dtype
        self._program = write_all_out(e)
        counted = dict.fromkeys(integer_parameters(e))
        arrays = arrays_of(e)
        real = [p for p in dict.fromkeys([*parameters(e), *(p for m in options.maps for p in m.parameters)]) if p not in counted]
        every: list[Parameter] = [*real, *(a for a in arrays if isinstance(a, Array))]
        if wrt is not None and (whole := [p for p in wrt if p in counted]):
            raise ParameterError(f"{whole[0].name!r} holds an integer: nothing is differentiable by it", None, "leave it out of the list")
        self.wrt: tuple[Parameter, ...] = tuple(every if wrt is None else wrt)
        self._leaves: tuple[Param | ArrayName, ...] = (
            *self.wrt,
            *(p for p in every if p not in self.wrt),
            *(a for a in arrays if isinstance(a, IndexArray)),
        )
        self._integers: tuple[Param, ...] = tuple(counted)
        self.parameters: tuple[str, ...] = tuple(_name(p) for p in (*self._leaves, *self._integers))
        self._fixed = {_name(k): v for k, v in indices.items()}
        static = {p.name for p in self._integers} | {a.name for a in arrays if isinstance(a, IndexArray)}
        if unknown := [k for k in self._fixed if k not in static]:
            hint = "integer parameters and arrays of indices: " + (", ".join(sorted(static)) or "there are none")
            raise ParameterError(f"indices= names {unknown[0]!r}, which is none", None, hint)
        self._families: dict[object, Any] = {}
        self._plan: DerivativePrograms | None = None
        self._lock = threading.RLock()
        try:
            self._plan = self._made(outlined(self._program))
        except NeedsLengths:
            return  # a plan for the shapes of each call
        self._plan.program(-1)  # what cannot be scheduled is told now

    def __reduce__(self) -> tuple[object, ...]:
        return (JaxFunction, self._given)

    def __repr__(self) -> str:
        return f"<teg.jax_function of {', '.join(self.parameters)}>"

    def __call__(self, values: Mapping[str, Any] | None = None, /, **named: Any) -> Any:
        """The value, an array of the batch's shape; for a tuple expression a tuple."""
        _import_jax(self._dtype)
        from teg.backends.jax_function import derivative

        given = self._values(values, named)
        operands, batch, precision = self._operands(given)
        family = self._family(given, operands, batch)
        found = iter(derivative(family, -1, batch, precision, operands))
        return _nested(self.expression, found)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _values(self, values: Mapping[str, Any] | None, named: Mapping[str, Any]) -> dict[str, Any]:
        if values is not None and not isinstance(values, Mapping):
            raise ParameterError("a JAX function is called with a dict, name -> value", None, f"the parameters are {self._signature}")
        given = {_name(k): v for k, v in (values or {}).items()}
        for source in (named, self._fixed):
            for k, v in source.items():
                if k in given:
                    raise ParameterError(f"the parameter {k!r} is given twice", None, f"the parameters are {self._signature}")
                given[k] = v
        if unknown := [str(k) for k in given if k not in self.parameters]:
            raise ParameterError(
                f"there is no parameter named {', '.join(map(repr, unknown))}", None, f"the parameters are {self._signature}"
            )
        if missing := [k for k in self.parameters if k not in given]:
            raise ParameterError(f"no value for {', '.join(map(repr, missing))}", None, f"the parameters are {self._signature}")
        return given

    @property
    def _signature(self) -> str:
        return ", ".join(self.parameters) or "none"

    def _operands(self, given: Mapping[str, Any]) -> tuple[list[Any], tuple[tuple[int | None, ...], ...], str]:
        """The leaves, without axes of length 1 in front, which leaf has which axes of the batch, and the type of results."""
        import jax.numpy as jnp
        import numpy as np

        leaves: list[Any] = []
        for p in self._leaves:
            value = given[p.name]
            try:
                leaf = jnp.asarray(value)
            except (TypeError, ValueError):
                raise ParameterError(f"the value of {p.name!r} is not a real number or an array of them: {value!r:.80}") from None
            if isinstance(p, IndexArray):
                if leaf.dtype.kind not in "iu":
                    raise ArrayIndexError(f"the entries of {p.name!r} are indices, and {leaf.dtype} was given", None, "use .astype(int)")
            elif not (jnp.issubdtype(leaf.dtype, jnp.floating) or leaf.dtype.kind in "iub"):
                raise ParameterError(f"the value of {p.name!r} is not a real number or an array of them: {leaf.dtype}")
            if leaf.ndim < _dimensions(p):
                raise ParameterError(f"{p.name!r} has {_dimensions(p)} dimensions, and an array of shape {leaf.shape} was given")
            leaves.append(leaf)
        real = [i for i, p in enumerate(self._leaves) if not isinstance(p, IndexArray)]
        dtype = self._dtype or jnp.result_type(float, *(leaves[i] for i in real)).name
        for i in real:
            leaves[i] = leaves[i].astype(dtype)
        front = [leaf.shape[: leaf.ndim - _dimensions(p)] for leaf, p in zip(leaves, self._leaves, strict=True)]
        try:
            shape = np.broadcast_shapes(*front)
        except ValueError:
            text = ", ".join(f"{p.name}: {s}" for p, s in zip(self._leaves, front, strict=True) if s)
            raise ParameterError(f"the shapes of the batch do not broadcast together: {text}") from None
        batch: list[tuple[int | None, ...]] = [
            tuple(0 if len(s) >= level and s[-level] == n else None for s in front)
            for level, n in ((len(shape) - k, n) for k, n in enumerate(shape))
        ]
        for i, s in enumerate(front):
            kept = [n for n, axes in zip(s, batch[len(shape) - len(s) :], strict=True) if axes[i] is not None]
            if len(kept) != len(s):
                leaves[i] = leaves[i].reshape(*kept, *leaves[i].shape[len(s) :])
        return leaves, tuple(batch), dtype

    def _family(self, given: Mapping[str, Any], operands: Sequence[Any], batch: Sequence[Sequence[int | None]]) -> Any:
        """The family of programs for the shapes, integers and index arrays of a call; checks the indices, if they are known."""
        import jax
        import numpy as np

        shapes = [
            tuple(v.shape[sum(axes[i] is not None for axes in batch) :])
            for i, v in enumerate(operands)
            if isinstance(self._leaves[i], ArrayName)
        ]
        integers = tuple(_whole(p.name, given[p.name]) for p in self._integers)
        known: list[Any] = []
        for p in self._leaves:
            if isinstance(p, IndexArray):
                value = given[p.name]
                known.append(None if isinstance(value, jax.core.Tracer) else np.asarray(value))
        arrays = [p for p in self._leaves if isinstance(p, ArrayName)]
        plan = self._specialised(dict(zip(arrays, shapes, strict=True))) if self._plan is None else self._plan
        self._check(plan, integers, arrays, shapes, known)
        first = len(arrays) - len(known)
        needed = [k for k in range(len(known)) if first + k in plan.counting]
        for k in needed:
            if known[k] is None:
                name = arrays[first + k].name
                raise ArrayIndexError(
                    f"how many terms a sum has depends on {name}, which JAX traces",
                    None,
                    f"give it when the function is made: teg.jax_function(e, indices={{{name!r}: …}}), or close over it",
                )
            if known[k].ndim != _dimensions(arrays[first + k]):
                raise ArrayIndexError(f"how many terms a sum has depends on {arrays[first + k].name}, which has axes of a batch")
        digest = tuple(hashlib.sha256(np.ascontiguousarray(known[k], np.int64).tobytes()).digest() for k in needed)
        key = (id(plan), integers, digest, tuple(shapes) if needed else ())
        with self._lock:
            if key not in self._families:
                self._families[key] = plan.family(integers, [v if k in needed else None for k, v in enumerate(known)])
                while len(self._families) > KEPT:
                    del self._families[next(iter(self._families))]
            return self._families[key]

    def _specialised(self, shapes: Mapping[ArrayName, tuple[int, ...]]) -> DerivativePrograms:
        """A plan for the lengths of arrays."""
        key = tuple(sorted((a.name, s) for a, s in shapes.items()))
        with self._lock:
            if key not in self._families:
                nodes = [n for node in postorder([self._program]) for n in index_leaves(integers_of(node)) if isinstance(n, Length)]
                numbers = {n: index_const(shapes[n.array][n.axis]) for n in nodes}
                self._families[key] = self._made(outlined(replace_integers(self._program, numbers)))  # type: ignore[arg-type]
            return cast(DerivativePrograms, self._families[key])

    def _made(self, e: Expr) -> DerivativePrograms:
        return DerivativePrograms(e, self._options, self.wrt, self._leaves, self._integers)

    def _check(
        self,
        plan: DerivativePrograms,
        integers: Sequence[int],
        arrays: Sequence[ArrayName],
        shapes: Sequence[tuple[int, ...]],
        known: Sequence[Any],
    ) -> None:
        """Every index is inside of its array, as far as index arrays are known."""
        import numpy as np

        if not arrays or any(v is None for v in known):
            return
        from teg.backends.array_plan import check_ranges

        program = cast(ArrayProgram, plan.program(-1))
        whole = {len(program.parameters) - len(integers) + k: np.asarray(v) for k, v in enumerate(integers)}
        real = [np.broadcast_to(np.float64(0.0), s) for s in shapes[: len(shapes) - len(known)]]
        for values in _elements(known, arrays[len(real) :]):
            check_ranges(program, whole, [*real, *values], shapes)


def _import_jax(dtype: str | None) -> None:
    try:
        import jax
    except ImportError:
        raise MissingPackageError("the package jax is not installed", None, 'pip install "teg[jax]"') from None
    if jax.__version_info__ < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise MissingPackageError(
            f"teg.jax_function needs JAX {oldest} or later, and this is {jax.__version__}", None, "pip install -U jax"
        )
    config: Any = jax.config
    if dtype == "float64" and not config.jax_enable_x64:
        raise BackendError(
            "float64 was asked for, and JAX's 64-bit mode is off",
            hint='jax.config.update("jax_enable_x64", True), before any JAX array is made; or leave dtype= out',
        )


def _name(key: object) -> str:
    return key.name if isinstance(key, Param | ArrayName) else cast(str, key)


def _dimensions(p: Param | ArrayName) -> int:
    return p.dimensions if isinstance(p, ArrayName) else 0


def _whole(name: str, value: Any) -> int:
    """The integer that an integer parameter holds."""
    import jax
    import numpy as np

    if isinstance(value, jax.core.Tracer):
        hint = f"give it when the function is made: teg.jax_function(e, indices={{{name!r}: …}}), or close over it"
        raise ArrayIndexError(f"the integer parameter {name!r} is traced by JAX, and shapes depend on it", None, hint)
    number = np.asarray(value)
    if number.ndim:
        raise ArrayIndexError(f"the integer parameter {name!r} is an array", None, "shapes depend on it: one integer for a whole batch")
    if number.dtype.kind not in "iuf" or not np.isfinite(number) or number != np.floor(number):
        raise ArrayIndexError(f"{name!r} is used as an integer, and its value is {value!r:.80}")
    return int(number)


def _elements(known: Sequence[Any], arrays: Sequence[ArrayName]) -> list[list[Any]]:
    """Index arrays for each element of a batch of them."""
    import numpy as np

    fronts = [v.shape[: v.ndim - a.dimensions] for v, a in zip(known, arrays, strict=True)]
    shape = np.broadcast_shapes(*fronts)
    if not shape:
        return [list(known)]
    every = [np.broadcast_to(v, (*shape, *v.shape[len(front) :])) for v, front in zip(known, fronts, strict=True)]
    return [[v[place] for v in every] for place in np.ndindex(*shape)]


def _nested(e: Expr, found: Any) -> Any:
    """Results in the structure of a tuple expression."""
    return tuple(_nested(entry, found) for entry in e.children) if isinstance(e, Tuple) else next(found)
