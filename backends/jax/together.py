"""`together`: a function of numbers whose results XLA computes in one kernel on CPUs, each operation once.

There XLA gives a kernel one result, and an operation that several results need is repeated in the kernel of each. But a reduction may have
several results, and its kernel computes what it reduces. So each result becomes a sum of two rows, the second of which is nothing:

    r, s = f(x)        →        r, s = sum(row 0: f(x), row 1: -0.0)        all results in one reduction

r + -0.0 has the bits of r (but below 2⁻¹⁰²² it is 0, as after all arithmetic of XLA on CPUs). XLA does not move operations across the
rows, because a choice between them stands there; LLVM takes f out of the loop over the two. Two numbers are the parts of a complex one on
their way to the rows: XLA refuses kernels in which a value is used in more than MOST such ways.

XLA fuses no quotient or root with what repeats it. So they are the results of kernels in front, whose arguments have the rows. Other
platforms, which have kernels with several results, get the function as it is. This module imports JAX.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import ClosedJaxpr, Literal, Primitive, Var, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from teg.backends.jax.apart import COSTLY

EVEN = 2**17
"""Elements of a batch from which on its length must be odd."""
MOST = 14
"""Complex numbers and truth values of one kernel: XLA allows 15 ways from a value to the results."""


def together(function: Callable[..., Sequence[Any]], *arguments: Any) -> list[Any]:
    """Returns the results of a function of numbers without loops: numbers in double precision, and truth values."""
    arguments = tuple(map(jnp.asarray, arguments))
    traced = jax.make_jaxpr(lambda *v: list(function(*v)))(*arguments)
    assert all(kind.dtype in (np.float64, np.bool_) for kind in traced.out_avals)
    opened = ClosedJaxpr(traced.jaxpr.replace(constvars=[], invars=[*traced.jaxpr.constvars, *traced.jaxpr.invars]), ())
    results: list[Any] = together_p.bind(*traced.consts, *arguments, function=opened)
    return results


together_p: Any = Primitive("teg_together")
together_p.multiple_results = True


def _plain(*operands: Any, function: Any) -> list[Any]:
    """The results by the operations of the function. Operands have as many axes as the batch; some axes have the length 1."""
    shape, flat = _flat(operands)
    run = jaxpr_as_fun(function)
    return [v.reshape(shape) for v in (jax.vmap(run) if shape else run)(*flat)]


def _flat(operands: Sequence[Any]) -> tuple[tuple[int, ...], list[Any]]:
    """The shape of the batch, and the operands with at most one axis."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in operands))
    return shape, [jnp.broadcast_to(v, shape).reshape(-1) if shape else v for v in operands]


def _abstract(*operands: Any, function: Any) -> list[Any]:
    shape = np.broadcast_shapes(*(v.shape for v in operands))
    return [kind.update(shape=shape) for kind in function.out_avals]


def _mapped(operands: Sequence[Any], axes: Sequence[Any], *, function: Any) -> tuple[list[Any], list[int]]:
    moved = [jnp.expand_dims(v, 0) if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(operands, axes, strict=True)]
    results = together_p.bind(*moved, function=function)
    return results, [0] * len(results)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], *, function: Any) -> tuple[Any, Any]:
    return jax.jvp(partial(_plain, function=function), tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


def _in_one_kernel(*operands: Any, function: Any) -> list[Any]:
    """The same where kernels have several results. No sum over the batch is fused with them, and the batch has an odd length: of an even
    one each thread of a GPU computes two or four elements at a time, for which it has too few registers. Either makes a long kernel
    three times as slow."""
    shape, flat = _flat(operands)
    size = math.prod(shape)
    more = int(size >= EVEN and size % 2 == 0)
    flat = [jnp.pad(v, (0, more)) if more else v for v in flat]
    run = jaxpr_as_fun(function)
    apart: Any = lax.optimization_barrier
    results = apart((jax.vmap(run) if shape else run)(*flat))
    return [v[:size].reshape(shape) if shape else v for v in results]


# -- on CPUs -----------------------------------------------------------------------------------------------------------


def _in_kernels(*operands: Any, function: Any) -> list[Any]:
    """The results: first what is costly, level by level, then everything else."""
    if not operands:
        return _plain(function=function)
    shape, flat = _flat(operands)
    jaxpr = function.jaxpr
    known = dict(zip(jaxpr.invars, flat, strict=True))
    for costly in _levels(jaxpr):
        values = _part(jaxpr, costly, known, _in_rows)
        known.update(zip(costly, _summed(list(map(_first_row, values))), strict=True))
    for part in _parts([v for v in jaxpr.outvars if isinstance(v, Var) and v not in known]):
        known.update(zip(part, _one_kernel(_part(jaxpr, part, known)), strict=True))
    return [jnp.broadcast_to(_read(known, v), flat[0].shape).reshape(shape) if shape else _read(known, v) for v in jaxpr.outvars]


def _levels(jaxpr: Any) -> list[list[Any]]:
    """The results of costly operations. The level of a value is the number of costly operations on the longest way to it."""
    depth: dict[Any, int] = {}
    levels: dict[int, list[Any]] = {}
    for e in jaxpr.eqns:
        level = max((depth.get(v, 0) for v in e.invars if isinstance(v, Var)), default=0)
        if e.primitive.name in COSTLY:
            level += 1
            levels.setdefault(level, []).extend(e.outvars)
        depth.update(dict.fromkeys(e.outvars, level))
    return [levels[level] for level in sorted(levels)]


def _parts(results: Sequence[Any]) -> Iterator[list[Any]]:
    """Yields results that are computed in one kernel."""
    part: list[Any] = []
    ways = 0
    for v in dict.fromkeys(results):
        kind: Any = v.aval
        way = 2 if kind.dtype == np.bool_ else 1
        if ways + way > 2 * MOST:
            yield part
            part, ways = [], 0
        part.append(v)
        ways += way
    if part:
        yield part


def _part(jaxpr: Any, wanted: Sequence[Any], known: dict[Any, Any], prepared: Callable[[Any], Any] = lambda v: v) -> list[Any]:
    """The values of variables, computed from `prepared` arguments and what else is known."""
    live, equations = set(wanted), []
    read: set[Any] = set()
    for e in reversed(jaxpr.eqns):
        if not live.isdisjoint(e.outvars) and not known.keys() >= set(e.outvars):
            equations.append(e)
            read |= {v for v in e.invars if isinstance(v, Var)}
            live |= read - known.keys()
    inputs = [v for v in known if v in read or v in live] or list(known)[:1]  # a map needs an argument

    def run(*values: Any) -> list[Any]:
        own = dict(zip(inputs, values, strict=True))
        for e in reversed(equations):
            results = e.primitive.bind(*(_read(own, v) for v in e.invars), **e.params)
            own.update(zip(e.outvars, results if e.primitive.multiple_results else [results], strict=True))
        return [own[v] for v in wanted]

    arguments = [prepared(known[v]) for v in inputs]
    for _ in range(arguments[0].ndim):
        run = jax.vmap(run)
    return run(*arguments)


def _read(known: dict[Any, Any], v: Any) -> Any:
    if not isinstance(v, Literal):
        return known[v]
    kind: Any = v.aval
    return jnp.asarray(v.val, kind.dtype)


def _twice(v: Any) -> Any:
    """A value in both rows."""
    return jnp.broadcast_to(jnp.expand_dims(v, -1), (*v.shape, 2))


def _row(v: Any) -> Any:
    return lax.broadcasted_iota(jnp.int32, v.shape, v.ndim - 1)


def _in_rows(v: Any) -> Any:
    """A value in both rows, which XLA does not know to be the same."""
    rows = _twice(v)
    return jnp.where(_row(rows) < 2, rows, jnp.zeros((), v.dtype))


def _first_row(rows: Any) -> Any:
    """The first row, and nothing in the second one."""
    return jnp.where(_row(rows) == 0, rows, _nothing(rows.dtype))


def _nothing(dtype: Any) -> Any:
    """What changes nothing in a sum."""
    if dtype == np.bool_:
        return jnp.bool_(False)
    return jnp.asarray(complex(-0.0, -0.0) if dtype == np.complex128 else -0.0, dtype)


def _one_kernel(values: Sequence[Any]) -> list[Any]:
    """The values, computed in one kernel."""
    rows: dict[int, Any] = {}
    numbers = [k for k, v in enumerate(values) if v.dtype != np.bool_]
    for one, other in zip(numbers[::2], numbers[1::2], strict=False):
        both = _first_row(_twice(lax.complex(values[one], values[other])))
        rows |= {one: lax.real(both), other: lax.imag(both)}
    return _summed([rows[k] if k in rows else _first_row(_twice(v)) for k, v in enumerate(values)])


def _summed(rows: Sequence[Any]) -> list[Any]:
    """The sums of both rows; of truth values, whether one holds."""

    def both(one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
        return [a | b if a.dtype == np.bool_ else a + b for a, b in zip(one, other, strict=True)]

    return list(lax.reduce(list(rows), [_nothing(v.dtype) for v in rows], both, (rows[0].ndim - 1,)))


together_p.def_impl(_plain)
together_p.def_abstract_eval(_abstract)
batching.primitive_batchers[together_p] = _mapped
ad.primitive_jvps[together_p] = _jvp
mlir.register_lowering(together_p, mlir.lower_fun(_in_one_kernel, multiple_results=True))
mlir.register_lowering(together_p, mlir.lower_fun(_in_kernels, multiple_results=True), platform="cpu")
