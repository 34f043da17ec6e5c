"""Values on lanes, one a lane, and what is computed with them: entries of tables, integers that may be unknown, the least of segments."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from teg.program.arrays import Arg

NOWHERE = -(2**63)
"""What stands for an integer that is not known: an entry of an index array beyond its ends, and all that is computed from it, or a result
that 64 bits do not hold. An entry there is NaN."""
ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "floordiv": operator.floordiv, "mod": operator.mod,
    "min": jnp.minimum, "max": jnp.maximum,
}  # fmt: skip


class Lanes(NamedTuple):
    """Values on lanes: `size` of them; those that are not `live` (None: all are) repeat another one."""

    values: dict[Arg, Any]
    size: int
    live: Any


class Repeated(NamedTuple):
    """A value that is the same on all lanes of a row; `rows` has one for each row."""

    rows: Any
    width: int

    def spread(self) -> Any:
        return jnp.broadcast_to(self.rows[:, None], (len(self.rows), self.width)).reshape(-1)


def of_lanes(arg: Arg, lanes: Lanes) -> Any:
    if isinstance(arg, int | float):
        return arg
    value = lanes.values[arg]
    return value.spread() if isinstance(value, Repeated) else value


def least_of_segments(candidates: tuple[Any, Any, Any, Any], parent: Any, size: int) -> Any:
    """The index of the least key of each segment; candidates are (key, whether they are eligible, index, whether they are live)."""
    key, present, index, live = candidates
    live = jnp.ones(key.shape, bool) if live is None else live
    unknown = live & (jnp.isnan(present) | ((present != 0) & jnp.isnan(key)))
    eligible = live & (present != 0) & ~unknown
    least = jax.ops.segment_min(jnp.where(eligible, key, jnp.inf), parent, size)
    hit = eligible & (key == least[parent])
    none = -NOWHERE - 1
    winner = jax.ops.segment_min(jnp.where(hit, index, none), parent, size)
    lost = jax.ops.segment_max(unknown.astype(jnp.int32), parent, size) > 0
    return jnp.where(lost, jnp.nan, jnp.where(winner == none, -1.0, winner.astype(jnp.float64)))


def nowhere_or(op: str, a: Any, b: Any) -> Any:
    """An integer operation on lanes; NOWHERE where an argument is, where 64 bits do not hold the result, and where it is divided by 0."""
    lost = (a == NOWHERE) | (b == NOWHERE)
    if op in ("floordiv", "mod"):
        lost = lost | (b == 0)
        b = jnp.where(b == 0, 1, b)
    found = ARITHMETIC[op](a, b)
    if op == "add":
        lost = lost | (((a ^ found) & (b ^ found)) < 0)
    elif op == "sub":
        lost = lost | (((a ^ b) & (a ^ found)) < 0)
    elif op == "mul":
        lost = lost | (jnp.abs(jnp.asarray(a, jnp.float64) * jnp.asarray(b, jnp.float64)) >= 2.0**63)
    return jnp.where(lost, NOWHERE, found)


def row_of(table: Any, rows: Any, column: int) -> Any:
    """The numbers in a column of rows, which may be out of their range: then NaN."""
    inside = (rows >= 0) & (rows < table.shape[0])
    return jnp.where(inside, table.at[jnp.where(inside, rows, 0), column].get(mode="fill"), jnp.nan)


def live_terms(terms: Any, lanes: Lanes) -> Any:
    return terms if lanes.live is None else jnp.where(lanes.live, terms, 0.0)
