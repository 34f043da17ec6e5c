"""Log messages: how long derivations and compilations take.

    logger "teg"                     INFO    what was derived or compiled, for which backend, in which time; what takes longer than 2 s
                                     DEBUG   derivations that are shared with another program
    logger "teg.backends.c"          DEBUG   libraries found in the cache, and compiled ones

Nothing is printed unless the user asks for it: ``logging.basicConfig(level=logging.INFO)``.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

log = logging.getLogger("teg")
SLOW = 2.0
"""Seconds after which something that is still going on is logged."""


@contextmanager
def timed(what: str, done: str) -> Iterator[None]:
    """Logs the time that a block takes as "`done` `what` in …", and while it is slow that it is still going on."""
    if not log.isEnabledFor(logging.INFO):
        yield
        return
    start = time.perf_counter()
    reminder = threading.Timer(SLOW, lambda: log.info("not %s yet after %.3g s: %s", done, SLOW, what))
    reminder.daemon = True
    reminder.start()
    try:
        yield
    finally:
        reminder.cancel()
    log.info("%s %s in %.3g s", done, what, time.perf_counter() - start)
