"""JAX in double precision, whatever the process is set to: for kernels whose arguments and results are NumPy's anyway."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
import numpy.typing as npt

from teg.backends.jax.kernel import JaxKernel, compile_jax
from teg.errors import MissingPackageError
from teg.program import Outcome, Program


class InDoublePrecision:
    """A kernel of JAX that is compiled and called with x64 on, which is back to what it was afterwards."""

    def __init__(self, program: Program) -> None:
        self.program = program
        with in_double_precision():
            self._kernel: JaxKernel = compile_jax(program)
        self.source = self._kernel.source

    def __call__(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> npt.NDArray[np.float64]:
        return self.outcome(columns, n).values

    def outcome(self, columns: Sequence[npt.NDArray[np.float64]], n: int) -> Outcome:
        """Returns the outputs of a batch, float64, as of the kernel itself."""
        with in_double_precision():
            return self._kernel.outcome(columns, n)

    def __reduce__(self) -> tuple[object, ...]:
        return (InDoublePrecision, (self.program,))


def in_double_precision() -> AbstractContextManager[object]:
    """Returns a context in which JAX traces and runs in 64 bits; of this thread only."""
    try:
        import jax
    except ImportError:
        raise MissingPackageError("the package jax is not installed", None, "pip install 'teg-compiler[jax]'") from None
    if hasattr(jax, "enable_x64"):
        switch: Any = jax.enable_x64
    else:  # before JAX 0.8
        from jax import experimental

        switch = getattr(experimental, "enable_x64")  # noqa: B009
    turned_on: AbstractContextManager[object] = switch(True)
    return turned_on
