"""Options of XLA with which programs compile in less time. This module imports JAX."""

from __future__ import annotations

from functools import lru_cache

import jax

FASTER = {"xla_cpu_use_fusion_emitters": False}
"""On CPUs XLA makes each kernel by a compiler of its own (MLIR), half of the time for programs of hundreds of small ones; without it
kernels are printed as LLVM's code at once. Results are the same but for rounding, and calls take as long
(`tests/bench/jax_references.py`)."""


@lru_cache(maxsize=1)
def compiler_options() -> dict[str, bool]:
    """Returns options for `jax.jit(…, compiler_options=…)`: none where this version of XLA does not know them."""
    try:
        jax.jit(lambda: 0, compiler_options=FASTER).lower().compile()
    except Exception:  # the error differs from version to version
        return {}
    return FASTER
