"""Quotients and square roots of single numbers, several in one kernel of XLA: `joined` rewrites a traced function.

    a = p / q;  b = r / s        →        c = [p, r] / [q, s];  a = c[0];  b = c[1]

On CPUs XLA computes a quotient or a square root once, in a kernel of its own, where several operations need it; and a kernel costs it as
much time as 40 to 100 operations. The roots of a few quadratics are a hundred kernels. So those that do not depend on each other are
computed as one array, with the same bits. Arrays of more than SMALL numbers are left as they are. This module imports JAX.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jax import lax
from jax.extend.core import Literal, Var

from teg.backends.jax.entries import AT_A_TIME

COSTLY = frozenset(("div", "sqrt"))
SMALL = 16
"""Numbers in an array that is joined with others."""


def joined(jaxpr: Any, is_copied: Callable[[Any], bool]) -> Any:
    """Returns one level of a traced function in which quotients and square roots that do not depend on each other are joined, of those for
    which XLA makes a kernel. `is_copied` says of which equations XLA makes none, whatever their users.

    The depth of a value is the number of them on the longest way to it, so those of one depth are independent. Equations are sorted by
    depth: those that are joined stand before the others.
    """
    needed = _needed_by_several(jaxpr, is_copied)
    depth: dict[Any, int] = {}
    together: dict[Any, list[Any]] = {}
    others: dict[int, list[Any]] = {}
    for e in jaxpr.eqns:
        level = max((depth.get(v, 0) for v in e.invars if isinstance(v, Var)), default=0)
        if not needed.isdisjoint(e.outvars) and _is_small(e):
            level += 1
            together.setdefault((level, e.primitive.name, e.outvars[0].aval.shape), []).append(e)
        else:
            others.setdefault(level, []).append(e)
        depth.update(dict.fromkeys(e.outvars, level))
    equations: list[Any] = []
    for level in range(max(depth.values(), default=0) + 1):
        for (own, _, _), group in together.items():
            if own == level:
                for k in range(0, len(group), AT_A_TIME):
                    equations += _as_one(group[k : k + AT_A_TIME])
        equations += others.get(level, [])
    return jaxpr.replace(eqns=equations)


def _needed_by_several(jaxpr: Any, is_copied: Callable[[Any], bool]) -> set[Any]:
    """Returns the variables that several equations need, themselves or by a value that XLA would have to copy with them."""
    users = Counter(v for e in jaxpr.eqns for v in {v for v in e.invars if isinstance(v, Var)})
    users.update(v for v in jaxpr.outvars if isinstance(v, Var))
    found: set[Any] = {v for v, number in users.items() if number > 1}
    for e in reversed(jaxpr.eqns):
        if is_copied(e) and not found.isdisjoint(e.outvars):
            found.update(v for v in e.invars if isinstance(v, Var))
    return found


def _is_small(equation: Any) -> bool:
    """Whether an equation is a quotient or a square root of few numbers."""
    if equation.primitive.name not in COSTLY:
        return False
    kinds: list[Any] = [v.aval for v in (*equation.invars, *equation.outvars)]
    return kinds[-1].size <= SMALL and all(k.dtype == np.float64 and k.shape == kinds[-1].shape for k in kinds)


def _as_one(group: Sequence[Any]) -> Iterator[Any]:
    """Yields the equations of some of the same operation, joined."""
    if len(group) == 1:
        yield from group
        return
    primitive, parameters, n = group[0].primitive, group[0].params, len(group[0].invars)
    operands: list[Any] = [v for e in group for v in e.invars]
    variables: list[Any] = [v for v in operands if isinstance(v, Var)]

    def one(*values: Any) -> list[Any]:
        given = iter(values)
        own = [np.asarray(v.val, np.float64) if isinstance(v, Literal) else next(given) for v in operands]
        columns = [lax.concatenate([lax.expand_dims(v, (0,)) for v in own[k::n]], 0) for k in range(n)]
        results = primitive.bind(*columns, **parameters)
        return [lax.index_in_dim(results, k, keepdims=False) for k in range(len(group))]

    traced = jax.make_jaxpr(one)(*(np.empty(v.aval.shape, v.aval.dtype) for v in variables)).jaxpr
    names = dict(zip(traced.invars, variables, strict=True)) | dict(zip(traced.outvars, (e.outvars[0] for e in group), strict=True))
    for e in traced.eqns:
        yield e.replace(
            invars=[names.get(v, v) if isinstance(v, Var) else v for v in e.invars], outvars=[names.get(v, v) for v in e.outvars]
        )
