"""How many threads a call gets, and what they do while they have no work.

Processors that this process may not use are not counted: the affinity mask, the quota of the control group, `OMP_NUM_THREADS`. Idle threads
sleep: those of libgomp would otherwise spin after every call, which doubles the processor time of small batches and delays other
programs. `OMP_WAIT_POLICY` and `GOMP_SPINCOUNT` of the user are respected.
"""

from __future__ import annotations

import ctypes
import math
import os
from contextlib import suppress
from pathlib import Path

CONTROL_GROUPS = Path("/sys/fs/cgroup")
POLICY, PASSIVE = "OMP_WAIT_POLICY", "passive"
CHOSEN = (POLICY, "GOMP_SPINCOUNT", "KMP_BLOCKTIME")
"""Variables by which users choose what idle threads do."""


def team_size(threads: int) -> int:
    """Returns the number of threads for `threads=`, where 0 stands for all processors."""
    return threads or processors()


def processors() -> int:
    """Returns the number of processors that this process may use, at least 1."""
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    if asked.isdecimal() and int(asked) > 0:
        return int(asked)
    affinity = getattr(os, "sched_getaffinity", None)  # Linux has it
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, math.ceil(min(count, _quota())))


def _quota() -> float:
    """Returns the processors' time that the control group may use in a unit of time; infinity without a limit."""
    with suppress(OSError, ValueError, ZeroDivisionError):  # version 2
        quota, period = (CONTROL_GROUPS / "cpu.max").read_text().split()
        return math.inf if quota == "max" else int(quota) / int(period)
    with suppress(OSError, ValueError, ZeroDivisionError):  # version 1
        amount, span = (int((CONTROL_GROUPS / "cpu" / f"cpu.cfs_{name}_us").read_text()) for name in ("quota", "period"))
        return amount / span if amount > 0 else math.inf
    return math.inf


def library_at(path: Path) -> ctypes.CDLL:
    """Returns the library; if it brings OpenMP, its idle threads sleep. Raises OSError if it cannot be loaded."""
    if any(name in os.environ for name in CHOSEN):
        return ctypes.CDLL(str(path))
    os.environ[POLICY] = PASSIVE  # read when OpenMP is loaded, and only then
    try:
        return ctypes.CDLL(str(path))
    finally:
        os.environ.pop(POLICY, None)  # another thread may have loaded a library meanwhile
