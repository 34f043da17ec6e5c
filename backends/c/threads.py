"""How many threads a call gets, and what they do while they have no work.

Processors that this process may not use are not counted: the affinity mask, the quotas of its control groups, `OMP_NUM_THREADS`. Idle
threads sleep: those of libgomp would otherwise spin after every call, which doubles the processor time of small batches and delays other
programs. `OMP_WAIT_POLICY` and `GOMP_SPINCOUNT` of the user are respected.
"""

from __future__ import annotations

import ctypes
import math
import os
from contextlib import suppress
from functools import cache
from pathlib import Path

CONTROL_GROUPS, MEMBERSHIP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
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
    """Returns the processors' time that the control groups may use in a unit of time; infinity without a limit."""
    return min(map(_limit, _groups(CONTROL_GROUPS, MEMBERSHIP)), default=math.inf)


@cache
def _groups(root: Path, membership: Path) -> tuple[Path, ...]:
    """Returns the folders of this process's control group and of those around it that may have a quota, of both versions.

    In a container they are the root's, on the machine itself those that `membership` names.
    """
    folders = [root, root / "cpu"]
    with suppress(OSError, ValueError):
        for line in membership.read_text().splitlines():
            _, controllers, place = line.split(":", 2)
            if not controllers or "cpu" in controllers.split(","):
                inner = Path(place.lstrip("/"))
                folders += [root / ("cpu" if controllers else "") / folder for folder in (inner, *inner.parents)]
    return tuple(f for f in dict.fromkeys(folders) if (f / "cpu.max").exists() or (f / "cpu.cfs_quota_us").exists())


def _limit(group: Path) -> float:
    """Returns the processors' time that one control group may use in a unit of time."""
    with suppress(OSError, ValueError, ZeroDivisionError):  # version 2
        quota, period = (group / "cpu.max").read_text().split()
        return math.inf if quota == "max" else int(quota) / int(period)
    with suppress(OSError, ValueError, ZeroDivisionError):  # version 1
        amount, span = (int((group / f"cpu.cfs_{name}_us").read_text()) for name in ("quota", "period"))
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
