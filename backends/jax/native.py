"""Compiled C kernels inside programs of JAX: `teg.jax_function(kernel="c")`.

    bind(kernel)              gives a compiled kernel a number, by which programs of XLA name it
    call(kernel, …)           calls it on operands of JAX, traced or not, on CPUs

A call is one custom call of XLA. Its handler (`native.c`) is the same for all kernels; it finds the kernel by its number in a table of the
process. The number is made of the kernel's text, so that an executable of JAX's cache on disk finds the kernel that it was compiled for.

A sharded batch is computed where its shards lie: a rule for Shardy says that the axes of the batch may be split. XLA's partitioner takes an
operand without an axis of its own for a replicated one, so numbers get an axis of length 1 behind those of the batch.

This module imports JAX.
"""

from __future__ import annotations

import ctypes
import hashlib
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import mlir
from jaxlib import version as jaxlib_version
from jaxlib.mlir import ir

from teg.backends.c.build import load_library
from teg.backends.c.kernel import CKernel
from teg.backends.c.loops import CArrayKernel
from teg.errors import CompilerError

TARGET = "teg_native"
INACCURATE = {"ignore": 0, "warn": 1, "raise": 2}
_LOCK = threading.Lock()


@dataclass(frozen=True)
class Call:
    """A call of a kernel: its number; of each operand how many axes of its own it has behind those of the
    batch, -1 for a number; the shapes of the results of one element; and what a missed tolerance does."""

    number: int
    own: tuple[int, ...]
    results: tuple[tuple[int, ...], ...]
    inaccurate: str


def bind(kernel: CKernel | CArrayKernel, message: str, category: Any) -> int:
    """Returns the number of a kernel. `message` is the warning of class `category` where a tolerance is missed."""
    number = int.from_bytes(hashlib.sha256(kernel.source.encode()).digest()[:8], "little") >> 1
    with _LOCK:
        library = _library(category)
        if library.teg_native_bind(ctypes.c_int64(number), ctypes.c_void_p(kernel.address), message.encode()):
            raise MemoryError
    return number


@cache
def _library(category: Any) -> ctypes.CDLL:
    """Returns the handler, registered as a target of XLA's."""
    text = resources.files("teg.backends.jax").joinpath("native.c").read_text(encoding="ascii")
    text = f"/* for jaxlib {jaxlib_version.__version__} */\n{text}"  # another version has another header
    library = load_library(text, optimise=("-O2", f"-I{jax.ffi.include_dir()}"))
    of_python = [ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p) for name in ("Py_AddPendingCall", "PyErr_WarnEx")]
    library.teg_native_start(*of_python, ctypes.py_object(category))
    library.teg_native_calls.restype = ctypes.c_long
    jax.ffi.register_ffi_target(TARGET, cast(Any, jax.ffi.pycapsule)(library.teg_native), platform="cpu")
    if hasattr(jax.ffi, "register_ffi_target_as_batch_partitionable"):
        jax.ffi.register_ffi_target_as_batch_partitionable(TARGET)
    return library


@cache
def what_is_wrong(category: Any) -> str:
    """Returns why there is no handler; "", if there is one."""
    try:
        with _LOCK:
            _library(category)
    except CompilerError as error:
        return str(error)
    return ""


def calls(category: Any) -> int:
    """Returns how many calls of kernels programs of XLA have made in this process."""
    with _LOCK:
        return int(_library(category).teg_native_calls())


native_p: Any = Primitive("teg_native_kernel")
native_p.multiple_results = True


def call(what: Call, operands: Sequence[Any], batch: tuple[int, ...]) -> list[Any]:
    """Returns the results of a kernel on operands, float64 and int64, each with the axes of the `batch` in front or with none of them."""
    if 0 in batch:
        return [jnp.zeros((*batch, *shape), jnp.float64) for shape in what.results]
    shaped = [v[..., None] if own < 0 and v.ndim else v for v, own in zip(operands, what.own, strict=True)]
    found = native_p.bind(*shaped, call=what, batch=batch)
    return [v[..., 0] if not shape and batch else v for v, shape in zip(found, what.results, strict=True)]


def _abstract(*operands: Any, call: Call, batch: tuple[int, ...]) -> list[Any]:
    shapes = [(*batch, *(shape or (1,) * bool(batch))) for shape in call.results]
    return [jax.core.ShapedArray(shape, np.dtype(np.float64)) for shape in shapes]


def _lower(context: Any, *operands: Any, call: Call, batch: tuple[int, ...]) -> Any:
    results = [len(shape) or int(bool(batch)) for shape in call.results]
    op = jax.ffi.build_ffi_lowering_function(TARGET)(
        context,
        *operands,
        kernel=np.int64(call.number),
        own=np.array([*call.own, *results], np.int64),
        inaccurate=np.int32(INACCURATE[call.inaccurate]),
    )
    shared = any(0 < own == v.ndim for v, own in zip(context.avals_in, call.own, strict=True))  # its axes would be taken for the batch's
    if batch and not shared and all(isinstance(n, int) for n in batch):
        op.attributes["sdy.sharding_rule"] = ir.Attribute.parse(_sharding_rule(context, len(batch)))
        op.attributes["mhlo.frontend_attributes"] = ir.DictAttr.get({"num_batch_dims": ir.StringAttr.get(str(len(batch)))})
    return op.results


def _sharding_rule(context: Any, front: int) -> str:
    """Returns the rule for Shardy: the axes of the batch are shared out, all others are whole on each device."""
    sizes: list[str] = []
    whole: list[str] = []

    def factors(shape: Sequence[int]) -> str:
        names = [_axis(k) for k in range(front)] if len(shape) > 0 else []
        for n in shape[front:]:
            whole.append(_axis(front + len(whole)))
            sizes.append(f"{whole[-1]}={n}")
            names.append(whole[-1])
        return f"[{', '.join(names)}]"

    given = ", ".join(factors(v.shape) for v in context.avals_in)
    made = ", ".join(factors(v.shape) for v in context.avals_out)
    batch = [f"{_axis(k)}={n}" for k, n in enumerate(context.avals_out[0].shape[:front])]
    kept = f" need_replication={{{', '.join(whole)}}}" if whole else ""
    return f"#sdy.op_sharding_rule<({given})->({made}) {{{', '.join([*batch, *sizes])}}}{kept}>"


def _axis(k: int) -> str:
    """Returns the name of an axis in a rule: i, j, …, z, z_1, z_2, …"""
    return chr(ord("i") + k) if k < 18 else f"z_{k - 17}"


native_p.def_abstract_eval(_abstract)
mlir.register_lowering(native_p, _lower, platform="cpu")
