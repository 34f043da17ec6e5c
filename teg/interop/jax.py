"""`teg.jax_function`: a program as a function of JAX, correct under all of its transformations."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, Literal, cast

from teg.analysis.isolation import MAX_ROOTS
from teg.analysis.settings import Integration, Rule
from teg.errors import ArrayIndexError, BackendError, CompilerError, MissingPackageError, OptionError, ParameterError
from teg.evaluator.accuracy import AccuracyWarning
from teg.evaluator.arguments import argument_order, batch_shape, name_of, refuse_uncertain
from teg.evaluator.framework import (
    KEPT,
    FrameworkFunction,
    Parameter,
    check_entries,
    checked_expression,
    nested,
)
from teg.evaluator.kept import Kept
from teg.evaluator.kernels import dimensions_of
from teg.evaluator.options import DEFAULT_TOLS, Discontinuities, Inaccurate, Jumps, Machine, Options, checked_dtype
from teg.evaluator.plan import Plan
from teg.evaluator.wanted import VALUE, derivative_of_order
from teg.interop.pytrees import is_leaf, values_in_pytree
from teg.ir.expr import Expr, Operand, Param
from teg.ir.index import ArrayName, IndexArray
from teg.passes.differentiate.through_sums import parameters_and_arrays
from teg.program import Program
from teg.program.arrays import ArrayProgram
from teg.report.explanation import SHOWN, shortened

KERNELS = ("auto", "c", "xla")
OLDEST = (0, 8, 0)
"""The first supported version of JAX: its types tell over which axes of a mesh a value varies."""


def jax_function(
    e: Operand,
    params: Sequence[Parameter] | Parameter | None = None,
    *,
    indices: Mapping[Any, Any] | None = None,
    dtype: object = None,
    tol: float | None = None,
    rule: Rule = "auto",
    order: int | None = None,
    seed: int = 0,
    discontinuities: Discontinuities = "exact",
    max_roots: int = MAX_ROOTS,
    maps: Sequence[Any] = (),
    kernel: Literal["auto", "c", "xla"] = "auto",
    inaccurate: Inaccurate = "warn",
    intrinsics: bool = True,
) -> JaxFunction:
    """Returns a pure function of JAX: from parameters and arrays, by name, to the value, or a tuple of values.

        f = teg.jax_function(e)
        value, slopes = jax.jit(jax.value_and_grad(f))({"t": 0.5, "a": 2.0})
        float(value), float(slopes["t"])          # (0.0625, 0.25)

    `jit`, `vmap`, `shard_map`, `jvp`, `vjp`, `grad`, `hessian`, `linearize`, `checkpoint` and `scan` work on it in any nesting.
    Derivatives of any order are programs of the symbolic derivative, each made when it is first needed.

    Its argument is a pytree: a dict, also with dicts, tuples, dataclasses or modules in it. A parameter is found by its path in it
    ("camera_t", "edges_0_t") or by the last key of that ("t"), and gradients have the structure of the argument. Values may also be given
    by keyword, or by position: in the order of `params`, or in that of their creation if there is one.
    Values broadcast as those of an evaluator do: a number may be an array of the batch's shape, an array has the batch's axes in front.
    Derivatives are taken by `params` (default: all real parameters and arrays); the others are constants, as under `lax.stop_gradient`.
    Integer parameters and `teg.indices` may be given at the call, or here by `indices=`. An integer that decides the number of terms of
    a sum must be known while JAX traces, so it cannot be an argument of a jitted function. Other index arrays may be traced, and then
    their range is not checked: an index out of range gives NaN.

    `dtype` is that of numbers, arrays and results: "float32" or "float64", or None for that of the arguments. Intermediate values are
    float64 in all cases, also where JAX's 64-bit mode is off. `tol` is 1e-10, or 1e-6 with dtype="float32". The other options
    are those of `teg.compile`; `maps` are not verified for the values of a call.

    `kernel` says what a program runs as. "c": on CPUs one call of the compiled C kernel, inside of the programs of XLA, with its speed and
    its bits; XLA compiles in milliseconds. "xla": operations of XLA, on every device. "auto": "c" on CPUs where a C compiler is found
    whose code this version of JAX can call (a RuntimeWarning where it cannot), "xla" elsewhere. Index arrays that JAX traces, whose range
    nothing checks before the call, make a program "xla".

    `inaccurate` says what a missed tolerance does in a C kernel: "warn" gives an AccuracyWarning in the main thread, "raise" an error of
    JAX, "ignore" nothing. Programs of XLA say nothing: an evaluator's `value_and_error` does.

    Raises MissingPackageError without JAX, BackendError for dtype="float64" where the 64-bit mode is off, CompilerError for kernel="c"
    without a C compiler, OptionError for other options, ParameterError for values that are missing, unknown, of wrong shapes or no real
    numbers, and ArrayIndexError for indices out of range or not known.
    """
    program = checked_expression(e)
    precision = None if dtype is None else checked_dtype(dtype)
    integration = Integration(DEFAULT_TOLS[precision or "float64"] if tol is None else tol, rule, order, seed, max_roots, intrinsics)
    options = Options(Machine("jax"), integration, inaccurate, precision or "float64", Jumps(discontinuities, maps))
    wrt = None if params is None else parameters_and_arrays(params)
    if kernel not in KERNELS:
        raise OptionError(f"kernel={kernel!r} is not known", None, "one of: " + ", ".join(map(repr, KERNELS)))
    _import_jax(precision)
    return JaxFunction(program, wrt, options, precision, indices or {}, kernel)


class JaxFunction(FrameworkFunction):
    """A function of JAX made by `teg.jax_function`. Call it with a pytree, by name, or by position in the order of `parameters`.

        float(teg.jax_function(e)(t=0.5, a=2.0))  # 0.0625

    It may be shared between threads, and pickles.
    """

    framework = "JAX"

    def __init__(
        self,
        e: Expr,
        wrt: Sequence[Parameter] | None,
        options: Options,
        dtype: str | None,
        indices: Mapping[Any, Any],
        kernel: str = "auto",
    ) -> None:
        super().__init__(e, wrt, options, dtype, indices)
        order, self._certain = argument_order([*self._leaves, *self._integers], wrt)  # so many may be given by position
        self.parameters = tuple(name_of(p) for p in order)
        self._families: Kept[Hashable, Any] = Kept(KEPT)
        self._counting: Kept[Plan, frozenset[int]] = Kept(KEPT)
        self._kernel = "c" if kernel == "c" or (kernel == "auto" and _can_call_c()) else "xla"
        self._given = (*self._given, kernel)  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<teg.jax_function({', '.join(self.parameters)}) of {shortened(str(self.expression), SHOWN)}>"

    @property
    def compiler_options(self) -> dict[str, Any]:
        """Returns options with which XLA compiles programs of `kernel="xla"` in little more than half of the time, for the outermost `jit`.

            f = teg.jax_function(e, kernel="xla")
            slopes = jax.jit(jax.grad(f), compiler_options=f.compiler_options)({"t": 0.5, "a": 2.0})
            float(slopes["t"])  # 0.25

        Results are the same but for rounding, and calls take as long. JAX takes options for a whole program only; calls outside of any
        `jit` have them already. Empty where this version of XLA does not know them.
        """
        from teg.backends.jax.options import compiler_options

        return dict(compiler_options())

    def __call__(self, *values: Any, **named: Any) -> Any:
        """Returns the value, an array of the batch's shape; for a tuple expression a tuple."""
        _import_jax(self._dtype)
        from teg.backends.jax.derivative import derivative

        by_name = self._values(self._by_name(values), named)
        operands, batch, precision = self._operands(by_name)
        family = self._family(by_name, operands, batch)
        results = iter(derivative(family, -1, batch, precision, operands))
        return nested(self.expression, results)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _by_name(self, values: tuple[Any, ...]) -> dict[str, Any]:
        """Returns the values of one pytree, or of numbers and arrays by position, by name."""
        if len(values) == 1 and not is_leaf(values[0]):
            return values_in_pytree(values[0], self.parameters)
        refuse_uncertain(self.parameters, self._certain, values, "teg.jax_function")
        if len(values) > len(self.parameters):
            raise ParameterError(
                f"{len(values)} values for {len(self.parameters)} parameters", None, f"the parameters are {self._signature}"
            )
        if any(not is_leaf(v) for v in values if not isinstance(v, list | tuple)):
            raise ParameterError("several structures are given", None, "one pytree of all parameters, or values by position or by name")
        return dict(zip(self.parameters, values, strict=False))

    def _operands(self, by_name: Mapping[str, Any]) -> tuple[list[Any], tuple[tuple[int | None, ...], ...], str]:
        """Returns the leaves without leading axes of length 1, the batch axes of each leaf, and the type of results."""
        import jax.numpy as jnp

        leaves: list[Any] = []
        for p in self._leaves:
            value = by_name[p.name]
            try:
                leaf = _as_array(p, value)
            except (TypeError, ValueError, OverflowError):
                raise ParameterError(f"the value of {p.name!r} is not a real number or an array of them: {value!r:.80}") from None
            kinds = {"i": jnp.integer, "b": jnp.bool_, "f": jnp.floating}  # keys of random numbers have types of their own
            kind = next((k for k, numbers in kinds.items() if jnp.issubdtype(leaf.dtype, numbers)), "")
            check_entries(p, kind, leaf.dtype, leaf.shape, "use .astype(int)")
            leaves.append(leaf)
        real = [i for i, p in enumerate(self._leaves) if not isinstance(p, IndexArray)]
        dtype = self._dtype or jnp.result_type(float, *(leaves[i] for i in real)).name
        for i in real:
            leaves[i] = leaves[i].astype(dtype)
        front = [leaf.shape[: leaf.ndim - dimensions_of(p)] for leaf, p in zip(leaves, self._leaves, strict=True)]
        shape = batch_shape([p.name for p in self._leaves], front)
        batch: list[tuple[int | None, ...]] = [
            tuple(0 if len(s) >= level and s[-level] == n else None for s in front)
            for level, n in ((len(shape) - k, n) for k, n in enumerate(shape))
        ]
        for i, s in enumerate(front):
            kept = [n for n, axes in zip(s, batch[len(shape) - len(s) :], strict=True) if axes[i] is not None]
            if len(kept) != len(s):
                leaves[i] = leaves[i].reshape(*kept, *leaves[i].shape[len(s) :])
        return leaves, tuple(batch), dtype

    def _family(self, by_name: Mapping[str, Any], operands: Sequence[Any], batch: Sequence[Sequence[int | None]]) -> Any:
        """Returns the family of programs for the shapes, integers and index arrays of a call. Checks the indices, if they are known."""
        import jax
        import numpy as np

        shapes = [
            tuple(v.shape[sum(axes[i] is not None for axes in batch) :])
            for i, v in enumerate(operands)
            if isinstance(self._leaves[i], ArrayName)
        ]
        integers = tuple(_whole(p.name, by_name[p.name]) for p in self._integers)
        known: list[Any] = []
        for p in self._leaves:
            if isinstance(p, IndexArray):
                value = by_name[p.name]
                known.append(None if isinstance(value, jax.core.Tracer) else np.asarray(value))
        arrays = [p for p in self._leaves if isinstance(p, ArrayName)]
        lists = dict(zip([p.name for p in arrays if isinstance(p, IndexArray)], known, strict=True))
        whole = {p.name: k for p, k in zip(self._integers, integers, strict=True)}
        plan = self._plan_for(dict(zip(arrays, shapes, strict=True)), {**lists, **whole})
        self._check(plan, integers, arrays, shapes, known)
        first = len(arrays) - len(known)
        counting = self._counting.get(plan, lambda: _counting(plan))
        needed = [k for k in range(len(known)) if first + k in counting]
        for k in needed:
            if known[k] is None:
                name = arrays[first + k].name
                raise ArrayIndexError(
                    f"how many terms a sum has depends on {name}, which JAX traces",
                    None,
                    f"give it when the function is made: teg.jax_function(e, indices={{{name!r}: …}}), or close over it",
                )
            if known[k].ndim != dimensions_of(arrays[first + k]):
                raise ArrayIndexError(f"how many terms a sum has depends on {arrays[first + k].name}, which has axes of a batch")
        digest = tuple(hashlib.sha256(np.ascontiguousarray(known[k], np.int64).tobytes()).digest() for k in needed)
        native = self._kernel == "c" and all(v is not None for v in known)  # compiled code does not look at the range of indices
        key = (plan, integers, digest, tuple(shapes) if needed else (), native)
        chosen = [v if k in needed else None for k, v in enumerate(known)]
        return self._families.get(key, lambda: _family_of(plan, integers, chosen, native))

    def _check(
        self,
        plan: Plan,
        integers: Sequence[int],
        arrays: Sequence[ArrayName],
        shapes: Sequence[tuple[int, ...]],
        known: Sequence[Any],
    ) -> None:
        """Checks that every index is inside of its array and no range has a negative length, as far as index arrays are known.

        Raises ArrayIndexError.
        """
        import numpy as np

        if not (arrays or integers) or any(v is None for v in known):
            return
        from teg.backends.plan import check_ranges

        program = cast(ArrayProgram, plan.program(VALUE))
        whole = {len(program.parameters) - len(integers) + k: np.asarray(v) for k, v in enumerate(integers)}
        real = [np.broadcast_to(np.float64(0.0), s) for s in shapes[: len(shapes) - len(known)]]
        for values in _elements(known, arrays[len(real) :]):
            check_ranges(program, whole, [*real, *values], shapes)


def _as_array(p: Param | ArrayName, value: Any) -> Any:
    """Returns a value as an array of JAX. NumPy integers are not cut to the 32 bits that JAX has where its 64-bit mode is off."""
    import jax.numpy as jnp
    import numpy as np

    leaf = jnp.asarray(value)
    if not isinstance(value, np.ndarray | np.generic) or value.dtype.kind not in "iu":
        return leaf
    cut = value.astype(leaf.dtype)  # not from the leaf: a traced leaf has no numbers
    if np.array_equal(cut, value):
        return leaf
    if isinstance(p, IndexArray):
        wrong = np.ravel(value)[np.ravel(cut != value)][0]
        text = f"an entry of {p.name!r} is too large for the {leaf.dtype} of JAX: {wrong}"
        raise ArrayIndexError(text, None, 'jax.config.update("jax_enable_x64", True)')
    return jnp.asarray(value.astype(np.float64))


def _import_jax(dtype: str | None) -> None:
    try:
        import jax
    except ImportError:
        raise MissingPackageError("the package jax is not installed", None, 'pip install "teg-compiler[jax]"') from None
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


def _can_call_c() -> bool:
    """Whether a C compiler is found, and makes what this version of JAX can call; a warning where it does not."""
    from teg.backends.c.build import find_compiler
    from teg.backends.jax.native import what_is_wrong

    try:
        find_compiler()
    except CompilerError:
        return False
    wrong = what_is_wrong(AccuracyWarning)
    if wrong:
        text = f"programs run as operations of XLA, because this version of JAX cannot call compiled kernels: {wrong}"
        warnings.warn(text, RuntimeWarning, stacklevel=4)
    return not wrong


def _native(plan: Plan) -> Any:
    """How programs of a plan become compiled kernels that programs of XLA call."""
    from teg.backends.jax.derivative import Native

    def bind(program: Program | ArrayProgram, order: int) -> int:
        from teg.backends.c.kernel import compile_c
        from teg.backends.c.loops import compile_c_arrays
        from teg.backends.jax.native import bind

        what = "a value" if order < 0 else "a value or a gradient" if order == 0 else f"a derivative of order {order + 1}"
        text = f"{what} may miss the tolerance {plan.options.integration.tol:g}, or have met more roots than there is room for"
        hint = "teg.compile(e).value_and_error(…) gives an estimate; a larger tol= or max_roots=, or a smaller region"
        kernel: Any = compile_c_arrays(program) if isinstance(program, ArrayProgram) else compile_c(program)
        return bind(kernel, f"{text}\n  hint: {hint}", AccuracyWarning)

    return Native(bind, plan.options.inaccurate)


def _counting(plan: Plan) -> frozenset[int]:
    """The numbers of the arrays that numbers of terms depend on."""
    if not plan.has_loops:
        return frozenset()
    from teg.backends.jax.lengths import counting_arrays

    return frozenset(counting_arrays(cast(ArrayProgram, plan.program(VALUE))))


def _family_of(plan: Plan, integers: Sequence[int], indices: Sequence[Any], native: bool) -> Any:
    """Returns the programs of a plan as functions of JAX, with these integers and index arrays (None: any); `native`: compiled for CPUs."""
    from teg.backends.jax.derivative import Family

    arrays = [isinstance(p, ArrayName) for p in plan.leaves]
    compiled = _native(plan) if native else None

    def made(entry: int | None, entries: Sequence[Any]) -> Any:
        def program(order: int) -> Program | ArrayProgram:
            return plan.program(derivative_of_order(order, plan.wrt), entry)

        return Family(program, (arrays, len(plan.wrt)), integers, indices, entries, compiled)

    single = [] if len(plan.entries) == 1 else [made(k, ()) for k in range(len(plan.entries))]
    return made(None, single)


def _whole(name: str, value: Any) -> int:
    """Returns the integer that an integer parameter holds."""
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
    """Returns index arrays for each element of a batch of them."""
    import numpy as np

    fronts = [v.shape[: v.ndim - a.dimensions] for v, a in zip(known, arrays, strict=True)]
    shape = np.broadcast_shapes(*fronts)
    if not shape:
        return [list(known)]
    every = [np.broadcast_to(v, (*shape, *v.shape[len(front) :])) for v, front in zip(known, fronts, strict=True)]
    return [[v[place] for v in every] for place in np.ndindex(*shape)]
