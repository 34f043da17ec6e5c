"""Numbers that are entries of one array: `entries` takes an array apart, `stacked` puts numbers together.

Roots are found as an array, named one by one in the printed text, and then needed as an array again: as breaks, as points of a sum, as
columns of rows. XLA makes a kernel of each number that it takes from an array, so numbers are looked up: those that came from one array are
read from it at once. What is known lasts for one run of a printed program (`remembered`). This module imports JAX.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

AT_A_TIME = 8
"""Numbers that XLA joins in the kernel that computes them; more have a kernel each, and one that joins them."""


class Entry(NamedTuple):
    """A place in an array; `number` is a weak reference to what stands there."""

    number: weakref.ref[Any]
    array: Any
    place: int


_ENTRIES: ContextVar[dict[int, Entry] | None] = ContextVar("entries", default=None)
"""By the ids of their numbers, while a printed program runs and as long as a number is there: a tracer must not outlive its trace."""


@contextmanager
def remembered() -> Iterator[None]:
    """Returns a context in which it is known of numbers that they were taken from arrays."""
    token = _ENTRIES.set({})
    try:
        yield
    finally:
        _ENTRIES.reset(token)


def entries(array: Any) -> tuple[Any, ...]:
    """The numbers of an array, (n,)."""
    numbers = tuple(array[i] for i in range(array.shape[0]))
    known = _ENTRIES.get()
    if known is not None:
        for place, number in enumerate(numbers):
            known[id(number)] = Entry(weakref.ref(number, partial(_forget, known, id(number))), array, place)
    return numbers


def _forget(known: dict[int, Entry], key: int, _: weakref.ref[Any]) -> None:
    known.pop(key, None)


def entry(number: Any) -> Entry | None:
    """Where a number stands, if it was taken from an array."""
    known = (_ENTRIES.get() or {}).get(id(number))
    return known if known is not None and known.number() is number else None


def stacked(numbers: Sequence[Any]) -> Any:
    """The array of some numbers, (n,), in double precision."""
    parts: list[Any] = []
    start = 0
    while start < len(numbers):
        first, end = entry(numbers[start]), start + 1
        if first is None:
            while end < len(numbers) and entry(numbers[end]) is None:
                end += 1
            parts.append(array_of([jnp.asarray(v, jnp.float64) for v in numbers[start:end]]))
        else:
            while end < len(numbers) and _follows(first, entry(numbers[end]), end - start):
                end += 1
            whole = end - start == first.array.shape[0]
            part = first.array if whole else lax.slice_in_dim(first.array, first.place, first.place + end - start)
            parts.append(jnp.asarray(part, jnp.float64))
        start = end
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts)


def array_of(numbers: Sequence[Any]) -> Any:
    """The array of some scalars of one type, (n,); so many at a time as XLA computes in one kernel."""
    if len(numbers) <= AT_A_TIME:
        return jnp.stack(numbers)
    filled = [*numbers, *[numbers[-1]] * (-len(numbers) % AT_A_TIME)]
    parts = [jnp.stack(filled[i : i + AT_A_TIME]) for i in range(0, len(filled), AT_A_TIME)]
    return jnp.stack(parts).reshape(-1)[: len(numbers)]


def _follows(first: Entry, other: Entry | None, distance: int) -> bool:
    return other is not None and other.array is first.array and other.place == first.place + distance


def parts(numbers: Sequence[Any]) -> tuple[list[Any], tuple[bool, ...]]:
    """The arrays that some numbers were taken from, as far as they stand together, and the other numbers; and which of these are arrays."""
    found: list[Any] = []
    several: list[bool] = []
    start = 0
    while start < len(numbers):
        first, end = entry(numbers[start]), start + 1
        if first is None:
            found.append(jnp.asarray(numbers[start]))
        else:
            while end < len(numbers) and _follows(first, entry(numbers[end]), end - start):
                end += 1
            found.append(lax.slice_in_dim(first.array, first.place, first.place + end - start))
        several.append(first is not None)
        start = end
    return found, tuple(several)


def of_parts(arrays: Sequence[Any], several: Sequence[bool]) -> tuple[Any, ...]:
    """The numbers of parts."""
    return tuple(v for array, many in zip(arrays, several, strict=True) for v in (entries(array) if many else (array,)))


class Columns(NamedTuple):
    """Columns of numbers: those with these `numbers`, (rows, columns)."""

    numbers: tuple[int, ...]
    rows: Any


def columns(of: Sequence[Sequence[Any]]) -> list[Columns]:
    """The arrays that some columns are made of; those whose numbers all come from one array are read from it together, and others of one
    type are stacked together."""
    together: dict[int, tuple[Any, list[int], list[list[int]]]] = {}
    others: dict[Any, tuple[list[int], list[list[Any]]]] = {}
    for k, column in enumerate(of):
        known = [entry(v) for v in column]
        first = known[0]
        if first is not None and all(e is not None and e.array is first.array for e in known):
            _, numbers, places = together.setdefault(id(first.array), (first.array, [], []))
            numbers.append(k)
            places.append([e.place for e in known if e is not None])
        else:
            kind = jnp.result_type(*(jnp.asarray(v) for v in column))
            numbers, stacks = others.setdefault(kind, ([], []))
            numbers.append(k)
            stacks.append(list(column))
    found = [Columns(tuple(numbers), _table(stacks, kind)) for kind, (numbers, stacks) in others.items()]
    for array, numbers, places in together.values():
        found.append(Columns(tuple(numbers), array.at[np.array(places).T].get(mode="promise_in_bounds")))
    return found


def _table(of: Sequence[Sequence[Any]], kind: Any) -> Any:
    """The array of columns of numbers of one type, (rows, columns). Of few numbers that stand often each is stacked once, and read from
    there: those that are stacked are computed eight by eight, in a kernel each."""
    numbers = [v for row in zip(*of, strict=True) for v in row]
    keys = [repr(v) if isinstance(v, bool | int | float) else id(v) for v in numbers]
    distinct = dict(zip(keys, numbers, strict=True))
    if 2 * len(distinct) > len(numbers):
        return array_of([jnp.asarray(v).astype(kind) for v in numbers]).reshape(-1, len(of))
    literals = np.array([v for k, v in distinct.items() if isinstance(k, str)], kind)
    traced = [(k, jnp.asarray(v).astype(kind)) for k, v in distinct.items() if not isinstance(k, str)]
    values = jnp.concatenate([*([array_of([v for _, v in traced])] if traced else []), literals])
    order = {k: i for i, k in enumerate([*(k for k, _ in traced), *(k for k in distinct if isinstance(k, str))])}
    places = np.array([order[k] for k in keys]).reshape(-1, len(of))
    return places_p.bind(values, places=tuple(map(tuple, places.tolist())))


# -- numbers at places that are known ----------------------------------------------------------------------------------

places_p: Any = Primitive("teg_places")


def _sliced(values: Any, *, places: tuple[tuple[int, ...], ...]) -> Any:
    """The numbers at places of the last axis, (…, rows, columns), by slices: accelerators gather slowly."""
    rows = [jnp.concatenate([lax.slice_in_dim(values, k, k + 1, axis=-1) for k in row], axis=-1) for row in places]
    return jnp.stack(rows, axis=-2)


def _gathered(values: Any, *, places: tuple[tuple[int, ...], ...]) -> Any:
    """The same by a gather, which on CPUs is a load in each kernel that needs it."""
    return values.at[..., np.array(places)].get(mode="promise_in_bounds")


def _mapped(operands: Sequence[Any], axes: Sequence[Any], *, places: tuple[tuple[int, ...], ...]) -> tuple[Any, int]:
    return places_p.bind(jnp.moveaxis(operands[0], axes[0], 0), places=places), 0


places_p.def_impl(_gathered)
places_p.def_abstract_eval(lambda values, places: jax.core.ShapedArray((*values.shape[:-1], *np.shape(places)), values.dtype))
batching.primitive_batchers[places_p] = _mapped
mlir.register_lowering(places_p, mlir.lower_fun(_sliced, multiple_results=False))
mlir.register_lowering(places_p, mlir.lower_fun(_gathered, multiple_results=False), platform="cpu")
