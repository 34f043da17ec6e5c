"""Programs and all their derivatives as one JAX primitive.

    D(p; u₁, …, uₖ)       bound with a family of programs and the order k

    k = -1    the values e(p)
    k = 0     the values and the gradients ∂e/∂p, by one program: they share their loops
    k ≥ 1     Dᵏ⁺¹e(p)[u₁, …, uₖ, ·], of the structure of p; of a single e

Its rules are closed under differentiation:

    d e           = ⟨∂e, dp⟩
    d ∂e          = D(p; dp)
    d D(p; u…)    = D(p; u…, dp) + Σᵢ D(p; …, duᵢ, …)
    the transpose of uᵢ ↦ D(p; …, uᵢ, …) at c is D(p; …, c, …), for Dᵏ⁺¹e is symmetric

so derivatives of any order, forward and reverse in any mixture, are programs that the compiler made of symbolic derivatives; each is made
when it is first needed, once. The primitive is lowered as the kernel that a program prints, traced in double precision whatever the
process is set to: parameters and results are float32 or float64, what is between is float64.

Operands are the leaves of p, then those of each u. Under vmap an operand that is not mapped stays as it is: `batch` says of each mapped
axis, the outermost first, which operands have it, in front of their own. This module imports JAX.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from teg.backends.jax.apart import once
from teg.backends.jax.kernel import JaxKernel, compile_jax
from teg.backends.jax.loops import BLOCK, WIDE_BLOCK, ArrayFunction
from teg.backends.jax.options import compiler_options
from teg.backends.jax.precision import in_double_precision
from teg.program import Program
from teg.program.arrays import ArrayProgram

Operands = Sequence[Any]
Axes = tuple[int | None, ...]
Batch = tuple[Axes, ...]


class Family:
    """A program and its derivatives, compiled when they are needed; compared by identity.

    `programs(k)` gives the program of order k. Its parameters are the leaves of p, `moving` of which are differentiated by, and then those
    of each u, `moving` of them; numbers and arrays apart, both in this order (`leaves`: which of them are arrays, and `moving`), and behind
    the numbers `integers`, which are constants. `entries` are the families of the single values, if there are several. With `native` a
    program is a compiled C kernel on CPUs, and a program of XLA elsewhere.
    """

    def __init__(
        self,
        programs: Callable[[int], Program | ArrayProgram],
        leaves: tuple[Sequence[bool], int],
        integers: Sequence[int] = (),
        indices: Sequence[Any] = (),
        entries: Sequence[Family] = (),
        native: Native | None = None,
    ) -> None:
        self.programs, self.arrays, self.moving = programs, tuple(leaves[0]), leaves[1]
        self.integers, self.indices = tuple(integers), tuple(indices)
        self.entries: tuple[Family, ...] = tuple(entries) or (self,)
        self.native = native
        self._kernels: dict[tuple[int, int], Callable[..., Any]] = {}
        self._numbers: dict[int, int] = {}
        self._eager: dict[tuple[int, Batch, str], Callable[..., list[Any]]] = {}
        self._functions: dict[tuple[int, Batch, str, int], Callable[..., tuple[Any, ...]]] = {}
        self._lock = threading.RLock()

    def __repr__(self) -> str:
        return f"<derivatives of {len(self.entries)} by {self.moving}>"

    def kernel(self, order: int, room: int) -> Callable[[Operands], list[Any]]:
        """The function of the operands of one element of a batch: the values, gradients, or the leaves of the derivative. Of the
        iterations of a sum `room` may run at a time."""
        with self._lock:
            if (order, room) not in self._kernels:
                program = self.programs(order)
                with in_double_precision():
                    made = self._arrays(program, order, room) if isinstance(program, ArrayProgram) else _numbers(program)
                self._kernels[order, room] = made
            return self._kernels[order, room]

    def _are_arrays(self, order: int) -> list[bool]:
        """Which operands of the program of an order are arrays."""
        return [*self.arrays, *self.arrays[: self.moving] * max(order, 0)]

    def _arrays(self, program: ArrayProgram, order: int, room: int) -> Callable[[Operands], list[Any]]:
        run = ArrayFunction(program, compile_jax, room)
        flags = self._are_arrays(order)

        def kernel(operands: Operands) -> list[Any]:
            scalars = [v for v, array in zip(operands, flags, strict=True) if not array]
            arrays = [v for v, array in zip(operands, flags, strict=True) if array]
            return run([*scalars, *self.integers], arrays, self.indices)[0]

        return kernel

    def function(self, order: int, batch: Batch, dtype: str, room: int) -> Callable[..., tuple[Any, ...]]:
        """What the primitive computes, jitted: nested maps of the kernel."""
        key = order, batch, dtype, room
        with self._lock:
            if key not in self._functions:
                self._functions[key] = self._function(*key)
            return self._functions[key]

    def _function(self, order: int, batch: Batch, dtype: str, room: int) -> Callable[..., tuple[Any, ...]]:
        kernel = self.kernel(order, room)

        def one(*operands: Any) -> tuple[Any, ...]:
            found = kernel([v.astype(jnp.float64) if jnp.issubdtype(v.dtype, jnp.floating) else v for v in operands])
            return tuple(jnp.asarray(v).astype(dtype) for v in found)

        mapped = one
        for axes in reversed(batch):
            mapped = jax.vmap(mapped, in_axes=axes, out_axes=0)
        spared = once(mapped)

        def function(*operands: Any) -> Sequence[Any]:
            lengths = _lengths(batch, operands)
            if 0 in lengths:  # a batch of no elements
                return tuple(jnp.zeros((*lengths, *own), dtype) for own in _own_shapes(self, order, batch, operands))
            return spared(*operands)

        return cast("Callable[..., tuple[Any, ...]]", jax.jit(function))

    # -- compiled kernels ----------------------------------------------------------------------------------------------

    def eager(self, order: int, batch: Batch, dtype: str) -> Callable[..., list[Any]]:
        """The primitive, jitted by itself: what it is lowered to depends on where its operands lie."""
        key = order, batch, dtype
        with self._lock:
            if key not in self._eager:
                run = partial(derivative_p.bind, family=self, order=order, batch=batch, dtype=dtype)
                self._eager[key] = jax.jit(run, compiler_options=compiler_options())
            return self._eager[key]

    def native_function(self, order: int, batch: Batch, dtype: str) -> Callable[..., tuple[Any, ...]]:
        """What the primitive computes on CPUs with `native`: one call of the compiled kernel for the whole batch."""
        assert self.native is not None
        from teg.backends.jax.native import Call, call

        program = self.programs(order)
        with self._lock:
            if order not in self._numbers:
                self._numbers[order] = self.native.bind(program, order)
            number = self._numbers[order]
        inaccurate = self.native.inaccurate

        def function(*operands: Any) -> tuple[Any, ...]:
            lengths = _lengths(batch, operands)
            own = [v.ndim - _front(batch, i) for i, v in enumerate(operands)]
            columns = [_column(v, [axes[i] is not None for axes in batch], lengths) for i, v in enumerate(operands)]
            kinds = [n if flag else -1 for n, flag in zip(own, self._are_arrays(order), strict=True)]
            columns += [jnp.asarray(float(k)) for k in self.integers]
            kinds += [-1] * len(self.integers)
            results = tuple(_own_shapes(self, order, batch, operands))
            found = call(Call(number, tuple(kinds), results, inaccurate), columns, lengths)
            return tuple(v.astype(dtype) for v in found)

        return function


@dataclass(frozen=True)
class Native:
    """How programs become compiled kernels: `bind` compiles one of an order and gives its number; `inaccurate` is what a missed tolerance
    does, "ignore", "warn" or "raise"."""

    bind: Callable[[Program | ArrayProgram, int], int]
    inaccurate: str


def _mapped_axes(batch: Batch, operands: Operands) -> list[tuple[Any, int]]:
    """For each axis of the batch an operand that has it, and which one of its axes it is."""
    return [next((v, _front(batch, i, k)) for i, v in enumerate(operands) if level[i] is not None) for k, level in enumerate(batch)]


def _lengths(batch: Batch, operands: Operands) -> tuple[int, ...]:
    """The shape of the batch."""
    return tuple(v.shape[k] for v, k in _mapped_axes(batch, operands))


def _column(v: Any, has: Sequence[bool], lengths: Sequence[int]) -> Any:
    """An operand as a compiled kernel reads it: double precision or 64-bit integers, with all axes of the batch or none."""
    v = v.astype(jnp.float64 if jnp.issubdtype(v.dtype, jnp.floating) else jnp.int64)
    if all(has) or not any(has):
        return v
    own = v.shape[sum(has) :]
    front = iter(v.shape)
    return jnp.broadcast_to(v.reshape(*(next(front) if h else 1 for h in has), *own), (*lengths, *own))


def _own_shapes(family: Family, order: int, batch: Batch, operands: Operands) -> list[tuple[int, ...]]:
    """The shapes of the results for one element of the batch."""
    leaves = [tuple(v.shape[_front(batch, i) :]) for i, v in enumerate(operands[: family.moving])]
    own: list[tuple[int, ...]] = [()] * len(family.entries) if order <= 0 else []
    if order >= 0:
        own += leaves * (len(family.entries) if order == 0 else 1)
    return own


def _numbers(program: Program) -> Callable[[Operands], list[Any]]:
    kernel: JaxKernel = compile_jax(program)
    return lambda operands: list(kernel.run(*operands)[0])


NOWHERE = jax.sharding.AbstractMesh((), ())
derivative_p: Any = Primitive("teg_derivative")
derivative_p.multiple_results = True


def derivative(family: Family, order: int, batch: Batch, dtype: str, operands: Operands) -> list[Any]:
    """The primitive on operands, those that are differentiated by of the type `dtype`, which results have too."""
    operands = _varying(operands)
    return cast("list[Any]", derivative_p.bind(*operands, family=family, order=order, batch=batch, dtype=dtype))


def _varying(operands: Operands) -> list[Any]:
    """Operands that vary over the same axes of a mesh (inside of `shard_map`), as a primitive of several operands wants them."""
    axes = [_axes(jax.typeof(v)) for v in operands]
    every = frozenset(name for a in axes for name in a)
    if not every:
        return list(operands)
    cast_to: Any = partial(lax.pcast, to="varying") if hasattr(lax, "pcast") else getattr(lax, "pvary", None)  # the name before JAX 0.9
    return [cast_to(v, tuple(every - a)) if every - a else v for v, a in zip(operands, axes, strict=True)]


def _axes(kind: Any) -> frozenset[str]:
    """The axes of a mesh over which what has this type varies. Without them gradients would be wrong, so there is no default."""
    return cast(
        "frozenset[str]", kind.manual_axis_type.varying if hasattr(kind, "manual_axis_type") else kind.vma
    )  # the latter before 0.10


def _run(*operands: Any, family: Family, order: int, batch: Batch, dtype: str) -> list[Any]:
    with in_double_precision(), jax.disable_jit(False):  # also where a user has turned jit off, which would end up here again
        return list(family.eager(order, batch, dtype)(*operands))


def _abstract(*operands: Any, family: Family, order: int, batch: Batch, dtype: str) -> list[Any]:
    own = _own_shapes(family, order, batch, operands)
    if not operands:
        return [jax.core.ShapedArray(shape, np.dtype(dtype)) for shape in own]
    lengths = _lengths(batch, operands)
    kind = {"dtype": np.dtype(dtype), "weak_type": False}
    mesh = getattr(getattr(operands[0], "sharding", None), "mesh", None)
    if mesh is None or mesh.empty:
        return [operands[0].update(shape=(*lengths, *shape), **kind) for shape in own]
    partition: Any = jax.sharding.PartitionSpec
    places = [v.sharding.spec[k] for v, k in _mapped_axes(batch, operands)]  # an axis of the batch lies where it does in the operands
    found = []
    for shape in own:
        spec = partition(*places, *(None,) * len(shape))
        sharding = jax.sharding.NamedSharding(mesh, spec)
        found.append(operands[0].update(shape=(*lengths, *shape), sharding=sharding, **kind))
    return found


def _front(batch: Batch, i: int, level: int | None = None) -> int:
    """How many mapped axes operand i has: of all levels, or of those outside of one."""
    return sum(axes[i] is not None for axes in (batch if level is None else batch[:level]))


def _lower(context: Any, *operands: Any, family: Family, order: int, batch: Batch, dtype: str, room: int = WIDE_BLOCK) -> Any:
    """The kernel, traced as if there were no mesh: it is a function of each element, wherever that lies."""
    plain = [jax.core.ShapedArray(v.shape, v.dtype) for v in context.avals_in]
    with in_double_precision(), jax.sharding.use_abstract_mesh(NOWHERE):
        function = family.function(order, batch, dtype, room)
        return mlir.lower_fun(function, multiple_results=True)(context.replace(avals_in=plain), *operands)


def _lower_for_cpu(context: Any, *operands: Any, family: Family, order: int, batch: Batch, dtype: str) -> Any:
    """A call of the compiled kernel, for families that have one."""
    if family.native is None or not operands:
        return _lower(context, *operands, family=family, order=order, batch=batch, dtype=dtype, room=BLOCK)
    with in_double_precision():
        return mlir.lower_fun(family.native_function(order, batch, dtype), multiple_results=True)(context, *operands)


def _jvp(primals: Operands, tangents: Operands, *, family: Family, order: int, batch: Batch, dtype: str) -> tuple[list[Any], list[Any]]:
    count, given = family.moving, len(family.arrays)
    if order < 0:  # the gradient comes with the value
        found = derivative(family, 0, batch, dtype, primals)
        values, slopes = found[: len(family.entries)], found[len(family.entries) :]
        return values, _inner(values, slopes, tangents[:count], batch)
    found = derivative(family, order, batch, dtype, primals)
    moved = _instantiated(primals[:count], tangents[:count])
    slots = [slice(given + i * count, given + (i + 1) * count) for i in range(order)]
    if order == 0:
        values, slopes = found[: len(family.entries)], found[len(family.entries) :]
        changes = _inner(values, slopes, tangents[:count], batch)
        further = tuple((*axes, *axes[:count]) for axes in batch)
        for entry in family.entries:
            changes += (
                derivative(entry, 1, further, dtype, [*primals, *moved]) if moved else [ad.Zero(jax.typeof(v)) for v in slopes[:count]]
            )
        return found, changes
    terms = []
    if moved:
        further = tuple((*axes, *axes[:count]) for axes in batch)
        terms.append(derivative(family, order + 1, further, dtype, [*primals, *moved]))
    for slot in slots:
        if change := _instantiated(primals[slot], tangents[slot]):
            terms.append(derivative(family, order, batch, dtype, [*primals[: slot.start], *change, *primals[slot.stop :]]))
    if not terms:
        return found, [ad.Zero(jax.typeof(v)) for v in found]
    return found, [sum(parts[1:], start=parts[0]) for parts in zip(*terms, strict=True)]


def _instantiated(primals: Operands, tangents: Operands) -> list[Any]:
    """Tangents with their zeros written out; none where all are 0."""
    if all(isinstance(t, ad.Zero) for t in tangents):
        return []
    return [jnp.zeros_like(p) if isinstance(t, ad.Zero) else t for p, t in zip(primals, tangents, strict=True)]


def _written_out(cotangent: Any) -> Any:
    """A cotangent, an array also where it is 0."""
    if not isinstance(cotangent, ad.Zero):
        return cotangent
    kind: Any = cotangent.aval
    return jnp.zeros(kind.shape, kind.dtype)


def _inner(values: Operands, slopes: Operands, tangents: Operands, batch: Batch) -> list[Any]:
    """⟨∂e, dp⟩ of each value: its gradients have all axes of the batch, a tangent those of its leaf."""
    found: list[Any] = []
    count = len(tangents)
    for k, value in enumerate(values):
        terms = []
        for i, tangent in enumerate(tangents):
            if not isinstance(tangent, ad.Zero):
                product = _mapped(jnp.multiply, [(0, axes[i]) for axes in batch])(slopes[k * count + i], tangent)
                terms.append(jnp.sum(product, axis=tuple(range(len(batch), product.ndim))))
        found.append(sum(terms[1:], start=terms[0]) if terms else ad.Zero(jax.typeof(value)))
    return found


def _mapped(function: Callable[..., Any], batch: Sequence[Axes]) -> Callable[..., Any]:
    for axes in reversed(batch):
        function = jax.vmap(function, in_axes=axes)
    return function


def _transpose(cotangents: Operands, *operands: Any, family: Family, order: int, batch: Batch, dtype: str) -> list[Any]:
    count, given = family.moving, len(family.arrays)
    unknown = [i for i, v in enumerate(operands) if isinstance(v, ad.UndefinedPrimal)]
    found: list[Any] = [None] * len(operands)
    if all(isinstance(c, ad.Zero) for c in cotangents):
        for i in unknown:
            found[i] = ad.Zero(operands[i].aval)
        return found
    first = given + (unknown[0] - given) // count * count
    slot = range(first, first + count)
    assert order > 0, "values are not linear"
    assert all(i in slot for i in unknown), "a derivative is linear in one direction at a time"
    inserted = [_written_out(c) for c in cotangents]  # with all axes of the batch
    full = tuple((*axes[:first], *(0,) * count, *axes[first + count :]) for axes in batch)
    slopes = derivative(family, order, full, dtype, [*operands[:first], *inserted, *operands[first + count :]])
    for i in unknown:
        shared = tuple(level for level, axes in enumerate(batch) if axes[i] is None)
        found[i] = jnp.sum(slopes[i - first], axis=shared) if shared else slopes[i - first]
    return found


def _batch(operands: Operands, dims: Sequence[Any], *, family: Family, order: int, batch: Batch, dtype: str) -> tuple[list[Any], list[int]]:
    axes = tuple(0 if isinstance(d, int) else None for d in dims)
    moved = [jnp.moveaxis(v, d, 0) if isinstance(d, int) else v for v, d in zip(operands, dims, strict=True)]
    found = derivative(family, order, (axes, *batch), dtype, moved)
    return found, [0] * len(found)


derivative_p.def_impl(_run)
derivative_p.def_abstract_eval(_abstract)
mlir.register_lowering(derivative_p, _lower)
mlir.register_lowering(derivative_p, _lower_for_cpu, platform="cpu")
ad.primitive_jvps[derivative_p] = _jvp
ad.primitive_transposes[derivative_p] = _transpose
batching.primitive_batchers[derivative_p] = _batch
