"""The C backend: a program as a shared library, compiled when it is first needed.

    compile_c(program)           ->  CKernel: a call with columns of the batch gives (outputs, n)
    standalone_c(program, name)  ->  a pair of files, for use without Python

The text is printed by `c_print`, compiled and kept by `c_build`.
"""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Sequence
from typing import cast

import numpy as np

from teg.backends.c_build import load_library
from teg.backends.c_print import print_kernel, title
from teg.errors import BackendError, OptionError, ParameterError
from teg.program import Outcome, Program

RESERVED = re.compile(
    "auto|break|case|char|class|const|continue|default|do|double|element|else|enum|extern|float|for|free|goto|if|"
    "inline|int|integral_.*|long|main|malloc|places_\\d.*|register|restrict|return|roots_\\d.*|short|signed|sizeof|static|struct|"
    "sum_\\d.*|switch|teg_.*|typedef|union|unsigned|void|volatile|while"
)


LONG = np.dtype(ctypes.c_long)


class CKernel:
    """A compiled program. `source` is its C text; pickling keeps the program and compiles it again."""

    def __init__(self, program: Program, threads: int = 1, counted: bool = False) -> None:
        """`threads` share the batch; 0 is one for each processor. Results are the same for any number. A `counted` kernel counts the
        evaluations of integrands."""
        if threads < 0:
            raise OptionError("threads must be 0 (one for each processor) or positive", threads)
        self.program = program
        self.threads = threads
        self.counted = counted
        self.source = print_kernel(program, counted=counted)
        library = load_library(self.source, optimise=_optimisation(self.source), openmp=threads != 1)
        self._function = library.teg_kernel
        self._function.restype = ctypes.c_int
        self._function.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * 4, ctypes.c_int]

    def __call__(self, columns: Sequence[np.ndarray], n: int) -> np.ndarray:
        """The outputs on a batch of n, shape (outputs, n), float64.

        A column is float64, of shape (n,) with any stride, or () for one value shared by the batch.
        """
        return self.outcome(columns, n).values

    def outcome(self, columns: Sequence[np.ndarray], n: int) -> Outcome:
        """The outputs, whether a tolerance was missed, and how many evaluations it took (0 if the kernel does not count)."""
        parameters = self.program.parameters
        if len(columns) != len(parameters):
            raise ParameterError(f"{len(parameters)} columns are needed, not {len(columns)}")
        kept = [_column(column, n, name) for column, name in zip(columns, parameters, strict=True)]
        pointers = np.array([_address(column) for column in kept], dtype=np.uintp)
        strides = np.array([column.strides[0] // 8 if column.ndim else 0 for column in kept], dtype=LONG)
        out = np.empty((len(self.program.outputs), n))
        notes = np.empty(n, dtype=LONG)
        threads = min(self.threads or os.cpu_count() or 1, max(n, 1))
        given = (_address(pointers), _address(strides), _address(out), _address(notes))
        if out.size and self._function(n, *given, threads):
            raise BackendError("there is no memory for the kernel's workspace")
        if not out.size:
            return Outcome(out, False, 0)
        if n == 1:
            note = int(notes[0])
            return Outcome(out, bool(note & 2), note >> 2)
        return Outcome(out, bool(np.bitwise_or.reduce(notes) & 2), int((notes >> 2).sum()) if self.counted else 0)

    def __reduce__(self) -> tuple[object, ...]:
        return (CKernel, (self.program, self.threads, self.counted))


def compile_c(program: Program, *, threads: int = 1, counted: bool = False) -> CKernel:
    """The program as a compiled C kernel (from the cache on disk if it was compiled before)."""
    return CKernel(program, threads, counted)


def standalone_c(program: Program, name: str) -> tuple[str, str]:
    """The texts of `name`.c and `name`.h, for use without Python: `cc -std=c99 -O2 name.c … -lm`."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,62}", name) or RESERVED.fullmatch(name):
        raise OptionError("not usable as the name of a C function", name, "letters, digits and _, no C keyword, not teg_…")
    header = f"""\
{title(program)}

#ifndef {name.upper()}_H
#define {name.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

/* Evaluate the program at n points. Parameter i at point k is p[i][k * stride[i]]; stride 0 shares one value.
   Output j at point k is written to out[j * n + k]. Compiled with OpenMP, `threads` threads share the points.
   `notes` may be NULL; else notes[k] is 2 if a tolerance was missed at point k, plus 1 if surfaces coincide there.
   Returns 0, or 1 if there was no memory for the workspace, and then `out` is not complete.
   Nothing is kept between calls: several threads may call at once. */
int {name}(long n, const double *const *p, const long *stride, double *out, long *notes, int threads);

#ifdef __cplusplus
}}
#endif

#endif
"""
    return print_kernel(program, name), header


def _optimisation(source: str) -> str:
    """How hard the compiler should try, so that no size takes it minutes: gcc 12 needs 8, 3, 1½ seconds a megabyte."""
    return "-O3" if len(source) <= 500_000 else "-O1" if len(source) <= 7_000_000 else "-O0"


def _address(array: np.ndarray) -> int:
    return cast(int, array.__array_interface__["data"][0])


def _column(column: np.ndarray, n: int, name: str) -> np.ndarray:
    """The column as the kernel reads it: itself, or a copy if it is not aligned to whole doubles."""
    if column.dtype != np.float64 or column.shape not in ((), (n,)):
        raise ParameterError(f"a float64 array of shape () or ({n},) is needed, not {column.dtype} {column.shape}", name)
    plain = column.dtype.isnative and column.flags.aligned and all(stride % 8 == 0 for stride in column.strides)
    return column if plain else np.array(column, dtype=np.float64)
