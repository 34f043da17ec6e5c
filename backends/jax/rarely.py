"""`rarely`: results that are known for most elements of a batch, and computed by a longer program for the others.

    rarely(good, found, exact, *arguments)  ->  `found` where `good`, else exact(*arguments)

For one element that is a branch. The elements of a batch that are not good are found by a sort, gathered, computed PART of the batch at a
time, and scattered to their places: a batch in which all are good does nothing of that. This module imports JAX.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from teg.backends.jax.apart import once

PART, FEWEST = 32, 8
"""Elements that are computed at a time: one part in so many of the batch, and at least so many."""


def rarely(good: Any, found: Sequence[Any], exact: Callable[..., Sequence[Any]], *arguments: Any) -> list[Any]:
    """Returns the results `found` where they are `good`, else those of a function of the arguments."""
    good, *arguments = (jnp.asarray(v) for v in (good, *arguments))  # type: ignore[assignment]
    traced = jax.make_jaxpr(lambda *v: list(exact(*v)))(*arguments)
    assert [(v.shape, v.dtype) for v in traced.out_avals] == [(v.shape, v.dtype) for v in map(jax.typeof, found)]
    constants = len(traced.consts)
    opened = ClosedJaxpr(traced.jaxpr.replace(constvars=[], invars=[*traced.jaxpr.constvars, *traced.jaxpr.invars]), ())
    axes = ((),) * (constants + len(arguments))
    results: list[Any] = rarely_p.bind(good, *found, *traced.consts, *arguments, exact=opened, axes=axes)
    return results


rarely_p: Any = Primitive("teg_rarely")
rarely_p.multiple_results = True


def _parts(operands: Sequence[Any], exact: Any) -> tuple[Any, Sequence[Any], Sequence[Any]]:
    """The condition, what was found, and the arguments."""
    count = 1 + len(exact.out_avals)
    return operands[0], operands[1:count], operands[count:]


def _plain(*operands: Any, exact: Any, axes: Sequence[Sequence[bool]]) -> list[Any]:
    """The results by operations of JAX. `axes` says which axes of the batch, the outermost first, an argument has."""
    good, found, arguments = _parts(operands, exact)
    run = jaxpr_as_fun(exact)
    shape = good.shape
    if not shape:
        results: list[Any] = lax.cond(good, lambda: list(found), lambda: run(*arguments))
        return results
    size = math.prod(shape)
    part = min(size, max(size // PART, FEWEST))
    parts = jax.vmap(run, in_axes=[0 if any(own) else None for own in axes], axis_size=part)

    def others() -> list[Any]:
        number = jnp.arange(size, dtype=jnp.int32)
        places = lax.sort(jnp.where(good.reshape(-1), jnp.int32(size), number))
        places = jnp.concatenate([places, jnp.full(part, size, jnp.int32)])

        def turn(at: tuple[Any, list[Any]]) -> tuple[Any, list[Any]]:
            start, results = at
            chosen = lax.dynamic_slice(places, (start,), (part,))
            numbers = _numbers(chosen, shape)
            own = [_chosen(v, [n for n, has in zip(numbers, flags, strict=True) if has]) for v, flags in zip(arguments, axes, strict=True)]
            exactly = parts(*own)
            return start + part, [old.at[chosen].set(new, mode="drop") for old, new in zip(results, exactly, strict=True)]

        def is_left(at: tuple[Any, list[Any]]) -> Any:
            return lax.dynamic_index_in_dim(places, at[0], keepdims=False) < size

        _, results = lax.while_loop(is_left, turn, (jnp.int32(0), [v.reshape(-1) for v in found]))
        return [v.reshape(shape) for v in results]

    rest: list[Any] = lax.cond(jnp.all(good), lambda: list(found), others)
    return rest


def _numbers(flat: Any, shape: Sequence[int]) -> list[Any]:
    """The numbers on all axes of elements that are numbered through. The first one may be beyond the end."""
    numbers = []
    for length in reversed(shape[1:]):
        flat, number = flat // length, flat % length
        numbers.append(number)
    return [flat, *reversed(numbers)]


def _chosen(v: Any, numbers: Sequence[Any]) -> Any:
    return v.at[tuple(numbers)].get(mode="clip") if numbers else v


def _abstract(*operands: Any, exact: Any, axes: Sequence[Sequence[bool]]) -> list[Any]:
    return list(_parts(operands, exact)[1])


def _mapped(operands: Sequence[Any], mapped: Sequence[Any], *, exact: Any, axes: Sequence[Sequence[bool]]) -> tuple[list[Any], list[int]]:
    """A batch of batches has one more axis; arguments keep those that they have."""
    size = next(v.shape[k] for v, k in zip(operands, mapped, strict=True) if k is not None)
    moved = [v if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(operands, mapped, strict=True)]
    count = 1 + len(exact.out_avals)
    whole = [jnp.broadcast_to(v, (size, *v.shape)) if k is None else v for v, k in zip(moved[:count], mapped, strict=False)]
    further = tuple((k is not None, *own) for k, own in zip(mapped[count:], axes, strict=True))
    found = rarely_p.bind(*whole, *moved[count:], exact=exact, axes=further)
    return found, [0] * len(found)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **parameters: Any) -> tuple[Any, Any]:
    return jax.jvp(partial(_plain, **parameters), tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


def _compiled(*operands: Any, **parameters: Any) -> list[Any]:
    return once(partial(_plain, **parameters))(*operands)


rarely_p.def_impl(_plain)
rarely_p.def_abstract_eval(_abstract)
batching.primitive_batchers[rarely_p] = _mapped
ad.primitive_jvps[rarely_p] = _jvp
mlir.register_lowering(rarely_p, mlir.lower_fun(_compiled, multiple_results=True))
