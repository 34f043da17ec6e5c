"""`uncollected`: a context in which Python's collector of cyclic garbage does not run.

To trace a program of thousands of operations makes some million objects that stay, and the collector looks at all of them again and again,
a tenth of the time. Reference counts free what is done with as before. The collector is one for all threads; it runs again when the last
one has left the context.
"""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class _Inside:
    """How many contexts are open, and whether the collector ran before the first one."""

    lock = threading.Lock()
    count = 0
    ran = False


@contextmanager
def uncollected() -> Iterator[None]:
    """Returns the context, which may be opened inside of another one, and in several threads."""
    with _Inside.lock:
        if not _Inside.count:
            _Inside.ran = gc.isenabled()
            gc.disable()
        _Inside.count += 1
    try:
        yield
    finally:
        with _Inside.lock:
            _Inside.count -= 1
            if not _Inside.count and _Inside.ran:
                gc.enable()
