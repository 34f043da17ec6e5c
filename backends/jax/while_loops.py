"""`while_loop`: JAX's, with a rule for `jax.vmap` that traces the body once.

JAX's own rule asks first which carried values depend on the mapped axis, and traces the body again until the answer stays the same; loops
in loops multiply that. Loops of printed programs end at different times for different elements, so that everything they carry depends on
the axis.

Elements of a batch that are at their end stay as they are while others go on: each carried value is selected, which is a kernel that grows
with every predicate. A loop says that it `rests` if its turn changes nothing at its end that is read afterwards; then nothing is selected.
A loop of a batch rests, whatever that of an element does, so a second map selects nothing. This module imports JAX.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun, primitives
from jax.interpreters import ad, batching, mlir

Carried = TypeVar("Carried")


def while_loop(
    goes_on: Callable[[Carried], Any], turn: Callable[[Carried], Carried], beginning: Carried, *, rests: bool = False
) -> Carried:
    """Returns what is carried (a pytree, `beginning` at first) after turns of a loop that are made while it `goes_on`; it `rests` if more
    turns after that would change neither whether it goes on nor what is read of the result."""
    structure: Any
    leaves, structure = jax.tree.flatten(beginning)
    first = _alike(leaves, leaves)
    conditions = jax.make_jaxpr(lambda *carried: [goes_on(structure.unflatten(carried))])(*first)
    turns = jax.make_jaxpr(lambda *carried: _alike(jax.tree.leaves(turn(structure.unflatten(carried))), first))(*first)
    constants = len(conditions.consts), len(turns.consts)
    operands = [*conditions.consts, *turns.consts, *first]
    last: Carried = structure.unflatten(
        while_p.bind(*operands, goes_on=_open(conditions), turn=_open(turns), constants=constants, rests=rests)
    )
    return last


def _alike(values: Sequence[Any], as_: Sequence[Any]) -> list[Any]:
    """The values in the types of other ones, none of which is weak."""
    return [lax.convert_element_type(v, jnp.result_type(old)) for v, old in zip(values, as_, strict=True)]


def _open(closed: Any) -> Any:
    """A traced function with its constants as its first operands."""
    return ClosedJaxpr(closed.jaxpr.replace(constvars=[], invars=[*closed.jaxpr.constvars, *closed.jaxpr.invars]), ())


while_p: Any = Primitive("teg_while")
while_p.multiple_results = True
Constants = tuple[int, int]
"""How many operands are constants of the condition, and of the turn behind them; those that follow are carried."""


def _parts(operands: Sequence[Any], constants: Constants) -> tuple[list[Any], list[Any], list[Any]]:
    """The constants of the condition, those of the turn, and the carried values."""
    both = sum(constants)
    return list(operands[: constants[0]]), list(operands[constants[0] : both]), list(operands[both:])


def _plain(*operands: Any, goes_on: Any, turn: Any, constants: Constants, rests: bool) -> list[Any]:
    """The loop as JAX's own primitive."""
    own, others = constants
    plain: Any = primitives.while_p
    found: list[Any] = plain.bind(*operands, cond_nconsts=own, cond_jaxpr=goes_on, body_nconsts=others, body_jaxpr=turn)
    return found


def _abstract(*operands: Any, goes_on: Any, turn: Any, constants: Constants, rests: bool) -> list[Any]:
    return list(operands[sum(constants) :])


def _mapped(
    operands: Sequence[Any], axes: Sequence[Any], *, goes_on: Any, turn: Any, constants: Constants, rests: bool
) -> tuple[list[Any], list[int]]:
    """The loop of a batch goes on while one of its elements does; those that are at their end stay as they are."""
    size = next(v.shape[k] for v, k in zip(operands, axes, strict=True) if k is not None)
    moved = [v if k is None else jnp.moveaxis(v, k, 0) for v, k in zip(operands, axes, strict=True)]
    of_condition, of_turn, first = _parts(moved, constants)
    is_mapped = [None if k is None else 0 for k in axes]
    in_condition, in_turn, carries = _parts(is_mapped, constants)
    first = [jnp.broadcast_to(v, (size, *jnp.shape(v))) if k is None else v for v, k in zip(first, carries, strict=True)]
    every = [0] * len(first)
    conditions: Any = jax.vmap(lambda *v: jaxpr_as_fun(goes_on)(*v)[0], in_axes=(*in_condition, *every), axis_size=size)
    turns: Any = jax.vmap(jaxpr_as_fun(turn), in_axes=(*in_turn, *every), axis_size=size)

    def turned(*values: Any) -> list[Any]:
        own, others, carried = _parts(values, constants)
        found = turns(*others, *carried)
        if rests:
            return list(found)
        going = conditions(*own, *carried)
        which = [lax.broadcast_in_dim(going, old.shape, (0,)) for old in carried]
        return [lax.select(*three) for three in zip(which, found, carried, strict=True)]

    batch_goes_on = jax.make_jaxpr(lambda *v: [jnp.any(conditions(*v))])(*of_condition, *first)
    batch_turn = jax.make_jaxpr(turned)(*of_condition, *of_turn, *first)
    parts = (len(of_condition), len(of_condition) + len(of_turn))
    found = while_p.bind(
        *of_condition, *of_condition, *of_turn, *first, goes_on=batch_goes_on, turn=batch_turn, constants=parts, rests=True
    )
    return found, [0] * len(found)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **parameters: Any) -> tuple[Any, Any]:
    return jax.jvp(partial(_plain, **parameters), tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


while_p.def_impl(_plain)
while_p.def_abstract_eval(_abstract)
batching.primitive_batchers[while_p] = _mapped
ad.primitive_jvps[while_p] = _jvp
mlir.register_lowering(while_p, mlir.lower_fun(_plain, multiple_results=True))
