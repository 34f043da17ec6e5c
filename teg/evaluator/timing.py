"""Log messages, and a line on the terminal: how long derivations and compilations take.

    logger "teg"                     INFO    the derivations and compilations, with their backend and time; steps that take longer than 2 s
                                     DEBUG   derivations that are shared with another program
    logger "teg.backends.c"          DEBUG   libraries found in the cache, and compiled ones

Log messages are shown if the user asks for them: ``logging.basicConfig(level=logging.INFO)``. Otherwise a derivation or compilation that
takes longer than 2 s shows a line with its time, if the standard error is a terminal; the line is removed when it is done.
``logging.getLogger("teg").setLevel(logging.ERROR)`` turns it off.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress

log = logging.getLogger("teg")
SLOW = 2.0
"""Seconds after which something that is still going on is reported."""
PERIOD = 0.5
"""Seconds between two states of the line on a terminal."""


@contextmanager
def timed(what: str, done: str) -> Iterator[None]:
    """Logs the time that a block takes as "`done` `what` in …", and reports while it is slow that it is still going on."""
    start = time.perf_counter()
    with _reminder(what, done) if log.isEnabledFor(logging.INFO) else _line(what, done) if _has_terminal() else nullcontext():
        yield
    log.info("%s %s in %.3g s", done, what, time.perf_counter() - start)


def _has_terminal() -> bool:
    return log.isEnabledFor(logging.WARNING) and sys.stderr is not None and sys.stderr.isatty()


@contextmanager
def _reminder(what: str, done: str) -> Iterator[None]:
    """Logs once that a block is slow."""
    reminder = threading.Timer(SLOW, lambda: log.info("not %s yet after %.3g s: %s", done, SLOW, what))
    reminder.daemon = True
    reminder.start()
    try:
        yield
    finally:
        reminder.cancel()


@contextmanager
def _line(what: str, done: str) -> Iterator[None]:
    """Shows a line with the time of a slow block on the standard error, and removes it at the end, also of an interrupted block."""
    over, start, stream = threading.Event(), time.perf_counter(), sys.stderr

    def show() -> None:
        shown, wait = "", SLOW
        with suppress(OSError, ValueError):  # the stream may be closed meanwhile
            while not over.wait(wait):
                shown, wait = f"teg: {what}, not {done} yet after {time.perf_counter() - start:.0f} s (Ctrl-C stops it)", PERIOD
                stream.write(f"\r{shown}")
                stream.flush()
            stream.write(f"\r{' ' * len(shown)}\r" if shown else "")
            stream.flush()

    thread = threading.Thread(target=show, name="teg progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(PERIOD)
