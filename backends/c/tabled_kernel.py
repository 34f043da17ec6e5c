"""Kernels of programs with tables."""

from __future__ import annotations

import ctypes

import numpy as np

from teg.backends.c.build import load_library
from teg.backends.c.kernel import CKernel, optimisation
from teg.backends.c.loops import print_arrays
from teg.backends.c.signals import Caller
from teg.program.tabled import TabledProgram


class CTabledKernel(CKernel):
    """A compiled program with tables, whose interface is that of a program without arrays."""

    def __init__(self, tabled: TabledProgram, threads: int = 1) -> None:
        self.tabled, self.program = tabled, tabled  # type: ignore[assignment]
        self.threads, self.counted, self.dtype = threads, False, "float64"
        self.source = print_arrays(tabled.program, tabled=tabled)
        self._call = Caller(load_library(self.source, optimise=optimisation(self.source), openmp=threads != 1))
        self._noted = True
        self._type, self._inputs, self._outputs = np.dtype("float64"), len(tabled.parameters), tabled.outputs
        self._values = ctypes.c_double * (self._inputs + self._outputs)

    def __reduce__(self) -> tuple[object, ...]:
        return (CTabledKernel, (self.tabled, self.threads))
