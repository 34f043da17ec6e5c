"""`rarely`: results that are known for most elements of a batch, and computed by a longer program for the others.

    rarely(good, found, exact, *arguments)  ->  `found` where `good`, else exact(*arguments)

For one element that is a branch. The elements of a batch that are not good are found by a sort, gathered, computed PART of the batch at a
time, and scattered to their places: a batch in which all are good does nothing of that. This module imports JAX.
"""

from __future__ import annotations

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
    mapped = (False,) * (constants + len(arguments))
    results: list[Any] = rarely_p.bind(good, *found, *traced.consts, *arguments, exact=opened, mapped=mapped)
    return results


rarely_p: Any = Primitive("teg_rarely")
rarely_p.multiple_results = True


def _parts(operands: Sequence[Any], exact: Any) -> tuple[Any, Sequence[Any], Sequence[Any]]:
    """The condition, what was found, and the arguments."""
    count = 1 + len(exact.out_avals)
    return operands[0], operands[1:count], operands[count:]


def _plain(*operands: Any, exact: Any, mapped: Sequence[bool]) -> list[Any]:
    """The results by operations of JAX. A batch has one axis, which the `mapped` arguments have."""
    good, found, arguments = _parts(operands, exact)
    run = jaxpr_as_fun(exact)
    if not good.ndim:
        results: list[Any] = lax.cond(good, lambda: list(found), lambda: run(*arguments))
        return results
    size = good.shape[0]
    part = min(size, max(size // PART, FEWEST))
    parts = jax.vmap(run, in_axes=[0 if m else None for m in mapped], axis_size=part)

    def others() -> list[Any]:
        number = jnp.arange(size, dtype=jnp.int32)
        places = lax.sort(jnp.where(good, jnp.int32(size), number))
        places = jnp.concatenate([places, jnp.full(part, size, jnp.int32)])

        def turn(at: tuple[Any, list[Any]]) -> tuple[Any, list[Any]]:
            start, results = at
            chosen = lax.dynamic_slice(places, (start,), (part,))
            own = [v.at[chosen].get(mode="clip") if m else v for v, m in zip(arguments, mapped, strict=True)]
            exactly = parts(*own)
            return start + part, [old.at[chosen].set(new, mode="drop") for old, new in zip(results, exactly, strict=True)]

        def is_left(at: tuple[Any, list[Any]]) -> Any:
            return lax.dynamic_index_in_dim(places, at[0], keepdims=False) < size

        _, results = lax.while_loop(is_left, turn, (jnp.int32(0), list(found)))
        return results

    rest: list[Any] = lax.cond(jnp.all(good), lambda: list(found), others)
    return rest


def _abstract(*operands: Any, exact: Any, mapped: Sequence[bool]) -> list[Any]:
    return list(_parts(operands, exact)[1])


def _mapped(operands: Sequence[Any], axes: Sequence[Any], *, exact: Any, mapped: Sequence[bool]) -> tuple[list[Any], list[int]]:
    """A batch of batches is one batch."""
    size = next(v.shape[k] for v, k in zip(operands, axes, strict=True) if k is not None)
    moved = [v if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(operands, axes, strict=True)]
    inner = moved[0].shape[axes[0] is not None :]

    def whole(v: Any, is_mapped: bool, has_inner: bool) -> Any:
        own = v.shape[is_mapped + has_inner * len(inner) :]
        v = v.reshape(size if is_mapped else 1, *(inner if has_inner else (1,) * len(inner)), *own)
        return jnp.broadcast_to(v, (size, *inner, *own)).reshape(-1, *own)

    count = 1 + len(exact.out_avals)
    flags = [True] * count + [m or k is not None for m, k in zip(mapped, axes[count:], strict=True)]
    before = [True] * count + list(mapped)
    flat = [whole(v, k is not None, b) if f else v for v, k, b, f in zip(moved, axes, before, flags, strict=True)]
    found = rarely_p.bind(*flat, exact=exact, mapped=tuple(flags[count:]))
    return [v.reshape(size, *inner) for v in found], [0] * len(found)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **parameters: Any) -> tuple[Any, Any]:
    return jax.jvp(partial(_plain, **parameters), tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


def _compiled(*operands: Any, **parameters: Any) -> list[Any]:
    return once(partial(_plain, **parameters))(*operands)


rarely_p.def_impl(_plain)
rarely_p.def_abstract_eval(_abstract)
batching.primitive_batchers[rarely_p] = _mapped
ad.primitive_jvps[rarely_p] = _jvp
mlir.register_lowering(rarely_p, mlir.lower_fun(_compiled, multiple_results=True))
