"""Values that XLA computes once on CPUs: `once` finds them in a traced function, `apart` keeps them.

XLA's fusion copies cheap operations into every kernel that needs them, however many there are: a search that carries thirty arrays decided
each step thirty times over, and compiled that as often. Nothing is fused across a call, and on CPUs XLA keeps a call that is marked as not
to be inlined. So some values go through a call of the identity. Other platforms get the values as they are.

    kernels of a value    those into which XLA would copy it: what is stored in memory, and reached without a value stored on the way
    its cone              the operations that each of them repeats for it
    gain                  |cone|·(kernels - 1); values of which it is more than GAIN are kept, the largest first, then all is counted again

This module imports JAX.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Primitive, Var, jaxpr_as_fun
from jax.interpreters import batching, mlir
from jaxlib.mlir import ir
from jaxlib.mlir.dialects import func

from teg.backends.jax.quotients import joined

GAIN = 80
"""Operations that keeping a value must save: a kernel costs XLA about as much time as 10 to 30 of them, or 50 to 100 without the options of
`options.py`."""
ROUNDS = 12
"""How often gains are counted."""
CHEAP = frozenset({
    "abs", "add", "and", "bitcast_convert_type", "broadcast_in_dim", "clamp", "concatenate", "convert_element_type", "copy", "eq",
    "expand_dims", "floor", "ceil", "round", "gather", "ge", "gt", "integer_pow", "iota", "is_finite", "le", "lt", "max", "min",
    "mul", "ne", "neg", "nextafter", "not", "or", "pad", "population_count", "rem", "reshape", "rev", "select_n", "shift_left",
    "shift_right_arithmetic", "shift_right_logical", "sign", "slice", "dynamic_slice", "split", "square", "squeeze", "stack",
    "stop_gradient", "sub", "teg_places", "transpose", "unstack", "xor",
})  # fmt: skip
"""What is copied into every kernel that needs it."""
COSTLY = frozenset({
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "div", "erf", "erfc", "exp", "exp2",
    "expm1", "log", "log1p", "logistic", "pow", "rsqrt", "sin", "sinh", "sqrt", "tan", "tanh",
})  # fmt: skip
"""What is fused with its only user, and else computed once."""
NESTED = frozenset(("teg_while", "while", "scan", "cond", "jit", "pjit", "custom_vmap_call"))
"""Whose bodies are looked at too."""


def once(function: Callable[..., Sequence[Any]]) -> Callable[..., list[Any]]:
    """Returns a function of arrays in which values are kept apart where that spares XLA copies."""

    def spared(*operands: Any) -> list[Any]:
        traced = jax.make_jaxpr(lambda *v: list(function(*v)))(*operands)
        found: list[Any] = jaxpr_as_fun(_Cuts().inside(traced))(*operands)
        return found

    return spared


class _Cuts:
    """The cuts of one function; a body that stands twice is cut once."""

    def __init__(self) -> None:
        self.done: dict[int, tuple[Any, Any]] = {}

    def inside(self, closed: Any) -> Any:
        """Returns a traced function with the values of its own level, and of its loops, kept apart."""
        if id(closed) not in self.done:
            jaxpr = closed.jaxpr
            bodies = [e.replace(params=self._parameters(e)) if e.primitive.name in NESTED else e for e in jaxpr.eqns]
            self.done[id(closed)] = closed, ClosedJaxpr(_cut(joined(jaxpr.replace(eqns=bodies), _is_copied)), closed.consts)
        return self.done[id(closed)][1]

    def _parameters(self, equation: Any) -> dict[str, Any]:
        def new(value: Any) -> Any:
            if isinstance(value, ClosedJaxpr):
                return self.inside(value)
            return tuple(map(new, value)) if isinstance(value, tuple) and value and isinstance(value[0], ClosedJaxpr) else value

        return {name: new(value) for name, value in equation.params.items()}


def _is_copied(equation: Any) -> bool:
    """Whether XLA copies an operation into the kernels of its users."""
    name = equation.primitive.name
    if name in ("jit", "pjit"):
        return all(_is_copied(e) for e in equation.params["jaxpr"].jaxpr.eqns)
    return name in CHEAP


def _stored(jaxpr: Any) -> set[Any]:
    """Returns the variables that XLA stores in memory: results, and what operations that are not fused read or give."""
    users: dict[Any, int] = {}
    stored: set[Any] = {v for v in jaxpr.outvars if isinstance(v, Var)}
    for e in jaxpr.eqns:
        fused = _is_copied(e) or e.primitive.name in COSTLY or e.primitive.name.startswith("reduce_")
        for v in {v for v in e.invars if isinstance(v, Var)}:
            users[v] = users.get(v, 0) + 1
            if not fused:
                stored.add(v)
    for e in jaxpr.eqns:
        if not _is_copied(e) and (e.primitive.name not in COSTLY or users.get(e.outvars[0], 0) > 1):
            stored.update(e.outvars)
    return stored


def _chosen(equations: Sequence[Any], stored: set[Any]) -> set[Any]:
    """Returns the variables to be kept apart: those that have a gain where all of them are kept."""
    chosen: set[Any] = set()
    for _ in range(ROUNDS):
        added = _round(equations, stored | chosen)
        if not added:
            break
        chosen |= added
    while useless := _useless(equations, stored | chosen, chosen):
        chosen -= useless
    return chosen


class _Counts(NamedTuple):
    """Sets of bits: the cone of each result of an equation, the kernels that need a variable if it is not kept itself, and the kernel that
    computes one that is stored."""

    cones: dict[Any, int]
    needed: dict[Any, int]
    kernel: dict[Any, int]

    def gain(self, v: Any) -> int:
        return self.cones[v].bit_count() * (self.needed.get(v, 0).bit_count() - 1)


def _counted(equations: Sequence[Any], stored: set[Any]) -> _Counts:
    cones: dict[Any, int] = {}
    for i, e in enumerate(equations):
        cone = 1 << i
        for v in e.invars:
            if isinstance(v, Var) and v not in stored:
                cone |= cones.get(v, 0)
        cones.update(dict.fromkeys(e.outvars, cone))
    kernel: dict[Any, int] = {v: 1 << k for k, v in enumerate(stored)}
    needed: dict[Any, int] = {}
    for e in reversed(equations):
        reached = 0
        for v in e.outvars:
            reached |= kernel[v] if v in stored else needed.get(v, 0)
        for v in e.invars:
            if isinstance(v, Var):
                needed[v] = needed.get(v, 0) | reached
    return _Counts(cones, needed, kernel)


def _useless(equations: Sequence[Any], stored: set[Any], chosen: set[Any]) -> set[Any]:
    """Returns chosen variables that have no gain any more, because what they are computed from was kept later; none of which needs another
    one."""
    counts = _counted(equations, stored)
    own = [(counts.gain(v), i, v) for i, e in enumerate(equations) for v in e.outvars if v in chosen]
    found, removed, users = set(), 0, 0
    for gain, _, v in sorted(own, key=lambda g: g[:2]):
        if gain <= GAIN and not counts.needed.get(v, 0) & removed and not counts.kernel[v] & users:
            found.add(v)
            removed |= counts.kernel[v]
            users |= counts.needed.get(v, 0)
    return found


def _round(equations: Sequence[Any], stored: set[Any]) -> set[Any]:
    """Returns variables with a gain, none of which another one is computed from."""
    counts = _counted(equations, stored)
    cones = counts.cones
    all_ = [(counts.gain(v), i, v) for i, e in enumerate(equations) for v in e.outvars if v not in stored]
    gains = [entry for entry in all_ if entry[0] > GAIN]
    taken, above, chosen = 0, 0, set()
    for _, i, v in sorted(gains, key=lambda g: (-g[0], -g[1])):
        if not (above >> i) & 1 and not cones[v] & taken:
            chosen.add(v)
            taken |= 1 << i
            above |= cones[v]
    return chosen


def _cut(jaxpr: Any) -> Any:
    """Returns a level of a function with some of its values kept apart, which later equations read."""
    chosen = _chosen(jaxpr.eqns, _stored(jaxpr))
    if not chosen:
        return jaxpr
    names: dict[Any, Any] = {}
    equations = []
    for e in jaxpr.eqns:
        equations.append(e.replace(invars=[names.get(v, v) if isinstance(v, Var) else v for v in e.invars]))
        if kept := [v for v in e.outvars if v in chosen]:
            kinds = [np.empty(v.aval.shape, v.aval.dtype) for v in kept]
            (call,) = jax.make_jaxpr(lambda *values: apart(*values))(*kinds).eqns  # a function of its own has variables of its own
            names.update(zip(kept, call.outvars, strict=True))
            equations.append(call.replace(invars=kept))
    return jaxpr.replace(eqns=equations)


# -- the call ----------------------------------------------------------------------------------------------------------

apart_p: Any = Primitive("teg_apart")
apart_p.multiple_results = True


def apart(*values: Any) -> list[Any]:
    """Returns the values."""
    found: list[Any] = apart_p.bind(*values)
    return found


def _on_cpu(context: Any, *values: Any) -> Any:
    """A call of the identity that is not to be inlined."""
    types = [v.type for v in values]
    module = context.module_context
    dialect: Any = func
    identity = dialect.FuncOp("teg_apart", (types, types), visibility="private", ip=ir.InsertionPoint.at_block_begin(module.module.body))
    block = identity.add_entry_block()
    name = module.symbol_table.insert(identity)
    with ir.InsertionPoint(block):
        dialect.ReturnOp(list(block.arguments))
    call = dialect.CallOp(types, ir.FlatSymbolRefAttr.get(name.value), list(values))
    call.attributes["mhlo.frontend_attributes"] = ir.DictAttr.get({"inlineable": ir.StringAttr.get("false")})
    return call.results


apart_p.def_impl(lambda *values: list(values))
apart_p.def_abstract_eval(lambda *kinds: list(kinds))
batching.primitive_batchers[apart_p] = lambda values, axes: (apart_p.bind(*values), axes)
mlir.register_lowering(apart_p, lambda context, *values: values)
mlir.register_lowering(apart_p, _on_cpu, platform="cpu")
