"""The C backend: a program as a shared library, compiled when it is first needed.

    compile_c(program)  ->  CKernel: a call with columns of the batch gives (outputs, n)

The text is printed by `c_print`, compiled and kept by `c_build`, called by `c_interrupt`; `c_standalone` writes it for use without Python.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from math import inf
from typing import Any, cast

import numpy as np

from teg.backends.c.build import LIGHT, load_library, load_linked
from teg.backends.c.functions import function_units, kernel_text
from teg.backends.c.routines import needs_context
from teg.backends.c.signals import Addresses, Caller
from teg.backends.c.threads import team_size
from teg.backends.c.unit import print_kernel
from teg.errors import BackendError, OptionError, ParameterError
from teg.program import Outcome, Program

LONG = np.dtype(ctypes.c_long)
REALS = {"float64": ("double", ctypes.c_double), "float32": ("float", ctypes.c_float)}
"""The types of C of parameters and outputs."""
OPTIMISATION = ((280_000, ("-O3",)), (480_000, ("-O1",)), (7_000_000, ("-O1", *LIGHT)), (inf, ("-O0",)))
"""The compiler's flags for texts of up to this length: on long ones gcc 12 needs 8, 4, 3 and 1 seconds a megabyte. Loops, which short
texts are about, run faster after -O3 than after -O1; long straight lines do not. No result depends on the flags."""


class CKernel:
    """A compiled program. `source` is its C text; pickling keeps the program and compiles it again."""

    def __init__(self, program: Program, threads: int = 1, counted: bool = False, dtype: str = "float64") -> None:
        """`threads` share the batch; 0 is one for each processor. Results are the same for any number. A `counted` kernel counts the
        evaluations of integrands. `dtype`, "float64" or "float32", is that of parameters and outputs; what is between them is float64."""
        if threads < 0:
            raise OptionError("threads must be 0 (one for each processor) or positive", threads)
        self.program = program
        self.threads = threads
        self.counted = counted
        self.dtype = dtype
        real, element = REALS[dtype]
        self.source, library = _built(program, counted, real, threads != 1)
        self._call = Caller(library)
        self._noted = needs_context(program.body, counted)
        self._type, self._inputs, self._outputs = np.dtype(dtype), len(program.parameters), len(program.outputs)
        self._values: Any = element * (self._inputs + self._outputs)

    @property
    def address(self) -> int:
        """Returns the address of the kernel that can be watched (`teg_kernel_watched`) in this process."""
        return self._call.address

    def __call__(self, columns: Sequence[np.ndarray], n: int) -> np.ndarray:
        """Returns the outputs on a batch of n, shape (outputs, n), of the kernel's dtype.

        A column is of that dtype, of shape (n,) with any stride, or () for one value shared by the batch.
        """
        return self.outcome(columns, n).values

    def outcome(self, columns: Sequence[np.ndarray], n: int) -> Outcome:
        """Returns the outputs, whether a tolerance was missed, and how many evaluations it took (0 if the kernel does not count)."""
        if len(columns) != self._inputs:
            raise ParameterError(f"{self._inputs} columns are needed, not {len(columns)}")
        kept = [_column(column, n, name, self._type) for column, name in zip(columns, self.program.parameters, strict=True)]
        out = np.empty((self._outputs, n), dtype=self._type)
        if not out.size:
            return Outcome(out, False, 0)
        size = self._type.itemsize
        first, row = _address(out), n * size
        pointers = np.array([*map(_address, kept), *range(first, first + self._outputs * row, row)], dtype=np.uintp)
        inputs = _address(pointers)
        outputs = inputs + self._inputs * pointers.itemsize
        strides = np.array([column.strides[0] // size if column.ndim else 0 for column in kept], dtype=LONG)
        notes = np.empty(n, dtype=LONG) if self._noted else None
        threads = min(team_size(self.threads), n)
        told = None if notes is None else _address(notes)
        if self._call.batch(n, Addresses(inputs, _address(strides), None, outputs, told), threads):
            raise BackendError("there is no memory for the kernel's workspace")
        if notes is None:
            return Outcome(out, False, 0)
        noted = int(np.bitwise_or.reduce(notes))
        evaluations = int((notes >> 3).sum()) if self.counted else 0
        return Outcome(out, bool(noted & 2), evaluations, bool(noted & 4), bool(noted & 1) and notes & 1 != 0)

    def at_point(self, values: Sequence[float]) -> Outcome:
        """Returns the outcome of one point, given as plain numbers in the order of the parameters; quicker than a batch of one."""
        array = self._values(*values)
        note = self._call.once(array, self._inputs, self._outputs)
        if note < 0:
            raise BackendError("there is no memory for the kernel's workspace")
        out = np.frombuffer(array, dtype=self._type)[self._inputs :].reshape(self._outputs, 1)
        return Outcome(out, bool(note & 2), note >> 3, bool(note & 4), bool(note & 1))

    def __reduce__(self) -> tuple[object, ...]:
        return (CKernel, (self.program, self.threads, self.counted, self.dtype))


def compile_c(program: Program, *, threads: int = 1, counted: bool = False, dtype: str = "float64") -> CKernel:
    """Returns the program as a compiled C kernel (from the cache on disk if it was compiled before)."""
    return CKernel(program, threads, counted, dtype)


def _built(program: Program, counted: bool, real: str, openmp: bool) -> tuple[str, ctypes.CDLL]:
    """Returns the text of a program and its library. Functions that it calls are texts of their own."""
    if not program.functions:
        text = print_kernel(program, counted=counted, real=real)
        return text, load_library(text, optimise=optimisation(text), openmp=openmp)
    kernel, called = kernel_text(program, counted, real)
    functions, bound = function_units(program, called)
    library = load_linked(kernel, functions, bound, optimise=optimisation(kernel), openmp=openmp)
    return "\n".join([kernel, *functions, bound]), library


def optimisation(source: str) -> tuple[str, ...]:
    """Returns the flags of `OPTIMISATION` for a text of this length."""
    return next(flags for longest, flags in OPTIMISATION if len(source) <= longest)


def _address(array: np.ndarray) -> int:
    return cast(int, array.__array_interface__["data"][0])


def _column(column: np.ndarray, n: int, name: str, dtype: np.dtype[Any]) -> np.ndarray:
    """Returns the column as the kernel reads it: itself, or a copy if it is not aligned to whole numbers."""
    if column.dtype != dtype or column.shape not in ((), (n,)):
        raise ParameterError(f"a {dtype} array of shape () or ({n},) is needed, not {column.dtype} {column.shape}", name)
    flags = column.flags
    if flags.c_contiguous and flags.aligned and column.dtype.isnative:
        return column
    plain = column.dtype.isnative and flags.aligned and all(stride % dtype.itemsize == 0 for stride in column.strides)
    return column if plain else np.array(column, dtype=dtype)
