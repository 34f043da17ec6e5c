"""Calls of compiled kernels that Ctrl-C can stop: a small library between Python and the kernels, the same for all of them.

A call gives Python's lock away, and runs the kernel in the thread that called. The kernel counts its work, and after some of it asks
`poll` (see `teg_watch` in runtime/calls.h), which looks at a clock. Every 50 ms, if the thread is Python's main one, it takes the lock and
lets Python handle the signals that came in the meantime; if a handler raised an exception, as that of Ctrl-C does, the kernel is told to
stop, and the exception is found pending when the call returns. A call shorter than that costs nothing more than its counting.

Only the main thread can be interrupted, as everywhere in Python; kernels that other threads run at that time go on.
"""

from __future__ import annotations

import ctypes
import os
import threading
from functools import cache
from typing import Any, NamedTuple

from teg.backends.c.build import load_library

MEMORY, STOPPED = -1, -2
"""What a call returns if it failed, instead of a note."""

SOURCE = """\
#ifndef _WIN32
#define _POSIX_C_SOURCE 199309L
#endif
#include <stdlib.h>
#include <time.h>

#ifdef _WIN32
#define TEG_EXPORT __declspec(dllexport)
#else
#define TEG_EXPORT
#endif

typedef int teg_kernel(
    long n, const void *p, const long *stride, const void *a, void *out, long *notes, int threads, long (*poll)(void *), void *data);

/* What Python calls PyEval_SaveThread, PyEval_RestoreThread and PyErr_CheckSignals. */
typedef struct {
    void *(*give)(void);
    void (*take)(void *thread);
    int (*check)(void);
} teg_python;

typedef struct {
    const teg_python *python;
    void *thread;
    double asked, checked;
    long units;
} teg_caller;

static double teg_seconds(void)
{
#ifdef _WIN32
    return (double)clock() / CLOCKS_PER_SEC;
#else
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#endif
}

/* Units of work until the next question, so many that it comes after 1 to 10 ms; 0: an exception is pending. */
static long teg_ask_python(void *data)
{
    teg_caller *const s = data;
    const double now = teg_seconds(), since = now - s->asked;
    if (s->units == 0) s->checked = now, s->units = 16;
    else if (since > 0.01) s->units = s->units > 8 ? s->units / 8 : 1;
    else if (since < 0.001 && s->units < 256) s->units *= 2;
    s->asked = now;
    if (now - s->checked < 0.05) return s->units;
    s->python->take(s->thread);
    const int pending = s->python->check();
    s->thread = s->python->give();
    s->asked = s->checked = teg_seconds();
    return pending ? 0 : s->units;
}

/* Run a kernel on a batch. Called with Python's lock, which it gives away. */
TEG_EXPORT int teg_call(
    const teg_python *python, teg_kernel *kernel, long n, const void *p, const long *stride, const void *a, void *out,
    long *notes, int threads, int watched)
{
    teg_caller s = {python, python->give(), 0.0, 0.0, 0};
    const int status = kernel(n, p, stride, a, out, notes, threads, watched ? teg_ask_python : NULL, &s);
    python->take(s.thread);
    return status;
}

/* Run a kernel without arrays at one point: so many parameters of so many bytes, and then the outputs, in one array. Returns a
   note, or -1 without memory, -2 if it was stopped. */
TEG_EXPORT long teg_call_once(
    const teg_python *python, teg_kernel *kernel, char *values, int inputs, int outputs, int size, int watched)
{
    char *few[64], **const places = inputs + outputs > 64 ? malloc((size_t)(inputs + outputs) * sizeof *places) : few;
    const long shared[64] = {0};
    long note = 0, *const stride = inputs > 64 ? calloc((size_t)inputs, sizeof *stride) : NULL;
    int status = 1;
    if (places && (stride || inputs <= 64)) {
        for (int i = 0; i < inputs + outputs; i++) places[i] = values + (long)i * size;
        status = teg_call(python, kernel, 1, places, stride ? stride : shared, NULL, places + inputs, &note, 1, watched);
    }
    if (places != few) free(places);
    free(stride);
    return status ? -status : note;
}
"""


class _Python(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("give", "take", "check")]


@cache
def _library() -> tuple[ctypes.PyDLL, _Python]:
    """Returns the library, and the functions of Python that it calls. As a PyDLL it is entered with Python's lock, and looks for an
    exception when it returns."""
    loaded = load_library(SOURCE, optimise=("-O2",))
    library = ctypes.PyDLL(loaded._name, handle=loaded._handle)
    of_python = (getattr(ctypes.pythonapi, name) for name in ("PyEval_SaveThread", "PyEval_RestoreThread", "PyErr_CheckSignals"))
    return library, _Python(*(ctypes.cast(function, ctypes.c_void_p).value for function in of_python))


class Addresses(NamedTuple):
    """What a kernel is called with: the addresses of the inputs and their strides, of arrays, of outputs, and of notes for each point."""

    inputs: int
    strides: int
    arrays: int | None
    outputs: int
    notes: int | None


class Caller:
    """The two ways to call a kernel of a library, which exports it as `name`_watched."""

    def __init__(self, library: ctypes.CDLL, name: str = "teg_kernel") -> None:
        callers, python = _library()
        self._kept = library, python  # they stay where they are: threads that start together do not share what is cached
        kernel = ctypes.cast(getattr(library, f"{name}_watched"), ctypes.c_void_p)
        self.address = kernel.value or 0
        address = ctypes.c_void_p(ctypes.addressof(python))
        pointer = ctypes.c_void_p
        batch = ctypes.PYFUNCTYPE(ctypes.c_int, pointer, pointer, ctypes.c_long, *[pointer] * 5, ctypes.c_int, ctypes.c_int)
        once = ctypes.PYFUNCTYPE(ctypes.c_long, *[pointer] * 3, *[ctypes.c_int] * 4)
        self._batch, self._once = batch(("teg_call", callers)), once(("teg_call_once", callers))
        self._given = address, kernel

    def batch(self, n: int, places: Addresses, threads: int) -> int:
        """Run it on a batch of n; returns its status. Raises what a handler of a signal raised."""
        team = 1 if _Teams.lost else threads
        _Teams.used |= team > 1
        status: int = self._batch(*self._given, n, *places, team, _is_main())
        return status

    def once(self, values: ctypes.Array[Any], inputs: int, outputs: int) -> int:
        """Run it at one point, the parameters and places for the outputs in one array; returns the note, MEMORY or STOPPED."""
        note: int = self._once(*self._given, values, inputs, outputs, ctypes.sizeof(values._type_), _is_main())
        return note


class _Teams:
    """Whether this process has used OpenMP's threads; and whether it is a fork of one that had, and was left without them: a team would
    wait for them forever. One thread gives the same bits."""

    used = False
    lost = False


def _after_fork() -> None:
    _Teams.lost |= _Teams.used


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _is_main() -> bool:
    return threading.get_ident() == threading.main_thread().ident
