"""Rows in lists of integers: a small library in C, the same for all programs, which reads a list of several columns once.

runs    the first columns are constant in each
rows    parts of runs in which all columns are constant but the last one, which goes up by one
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from teg.backends.c.build import load_library

SOURCE = """\
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define TEG_EXPORT __declspec(dllexport)
#else
#define TEG_EXPORT
#endif
#define BLOCK 4096

static int64_t entry(const char *column, int64_t stride, int64_t i)
{
    return *(const int64_t *)(column + i * stride);
}

/* Of `count` neighbours in a column, those that do not differ by `step` get a bit. */
static void mark(const char *column, int64_t stride, int64_t step, int64_t first, int64_t count, int bit, unsigned char *flags)
{
    const char *at = column + first * stride;
    for (int64_t i = 0; i < count; i++) {
        const int64_t before = entry(at, stride, i), here = entry(at, stride, i + 1);
        flags[i] |= (here >= before) & ((uint64_t)here - (uint64_t)before == (uint64_t)step) ? 0 : bit;
    }
}

/* Writes for each row the values of the columns at its start, and the value of the last one behind its end; and the number of the first
   row of each run. Both arrays have room for as many as there are entries. Runs are no longer than `piece`, a multiple of BLOCK. Returns
   the number of rows, and that of runs in *found; or -1 if the last column has an integer behind which there is none. Strides are in
   bytes. */
TEG_EXPORT int64_t teg_listed_rows(
    int64_t size, int64_t columns, int64_t fixed, const char *const *at, const int64_t *strides, int64_t piece, int64_t *table,
    int64_t *runs, int64_t *found)
{
    int64_t rows = 0, start = 0, known = 0;
    for (int64_t first = 0; first < size; first += BLOCK) {
        const int64_t count = size - first < BLOCK ? size - first : BLOCK, pairs = first + count < size ? count : count - 1;
        unsigned char flags[BLOCK + 8] = {0};
        for (int64_t c = 0; c < columns; c++) mark(at[c], strides[c], c == columns - 1, first, pairs, c < fixed ? 1 : 2, flags);
        if ((first + count) % piece == 0 || first + count == size) flags[count - 1] |= 1;
        if (first == 0) runs[known++] = 0;
        for (int64_t i = 0; i < count; i++) {
            uint64_t eight;
            memcpy(&eight, flags + i, 8);
            if (!eight) {
                i += 7;
                continue;
            }
            if (!flags[i]) continue;
            int64_t *const row = table + rows * (columns + 1);
            for (int64_t c = 0; c < columns; c++) row[c] = entry(at[c], strides[c], start);
            if (row[columns - 1] > INT64_MAX - (first + i + 1 - start)) return -1;
            row[columns] = row[columns - 1] + (first + i + 1 - start);
            start = first + i + 1;
            rows++;
            if (flags[i] & 1) runs[known++] = rows;
        }
    }
    *found = known;
    return rows;
}
"""


@cache
def _library() -> ctypes.CDLL:
    library = load_library(SOURCE)
    number, pointer = ctypes.c_int64, ctypes.c_void_p
    library.teg_listed_rows.argtypes = [number, number, number, pointer, pointer, number, pointer, pointer, pointer]
    library.teg_listed_rows.restype = number
    return library


def listed_rows(columns: Sequence[npt.NDArray[np.int64]], fixed: int, piece: int) -> list[npt.NDArray[np.int64]] | None:
    """Returns the first row of each run, and the number of all rows behind that; and a table with a row for each of them: the columns at
    its start, and the last column's value behind its end. Columns have one length, not 0; the first ones, `fixed` in number, are constant
    on runs, which are no longer than `piece`, a multiple of 4096. None if integers are too large."""
    kept = [np.require(c, np.int64, ["ALIGNED"]) for c in columns]
    size = len(kept[0])
    starts = np.array([c.ctypes.data for c in kept], dtype=np.uintp)
    strides = np.array([c.strides[0] for c in kept], dtype=np.int64)
    table, runs, found = np.empty((size, len(kept) + 1), dtype=np.int64), np.empty(size + 1, dtype=np.int64), ctypes.c_int64()
    given = starts.ctypes.data, strides.ctypes.data, piece, table.ctypes.data, runs.ctypes.data, ctypes.addressof(found)
    rows = _library().teg_listed_rows(size, len(kept), fixed, *given)
    return None if rows < 0 else [runs[: found.value], table[:rows]]
