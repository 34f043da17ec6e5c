"""How many threads a call gets, and that idle ones sleep."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from teg.backends.c import threads

SCRIPT = """
import numpy as np
import teg
x = teg.var("x")
t = teg.param("t")
f = teg.compile(teg.integral(teg.bracket(x < t), (x, 0, 1)), backend="c", threads=2)
print(f(t=np.linspace(0, 1, 5000)).sum(), [name for name in __import__("os").environ if name == "OMP_WAIT_POLICY"])
"""
IDLE = """
import time
import numpy as np
import teg
x, t = teg.var("x"), teg.param("t")
def spent(threads):
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1)), backend="c", threads=threads)
    values = np.linspace(0, 1, 20000)
    f(t=values)
    start = time.process_time()
    for _ in range(50):
        f(t=values)
        time.sleep(0.004)
    return time.process_time() - start
print(spent(1), spent(2))
"""
TEAM = """
import os
import sys
import numpy as np
import teg
if sys.argv[1] == "affinity":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
x, t = teg.var("x"), teg.param("t")
f = teg.compile(teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1)), backend="c", threads=int(sys.argv[2]))
before = len(os.listdir("/proc/self/task"))
f(t=np.linspace(0, 1, 100000))
print(len(os.listdir("/proc/self/task")) - before)
"""
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads what libgomp says")


@pytest.fixture(autouse=True)
def unlimited(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(threads, "CONTROL_GROUPS", tmp_path)
    monkeypatch.setattr(threads, "MEMBERSHIP", tmp_path / "membership")


def test_a_number_of_threads_is_taken_as_it_is() -> None:
    assert threads.team_size(3) == 3


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="no affinity")
def test_processors_that_the_process_may_not_use_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 3, 5})
    assert threads.team_size(0) == 3


@pytest.mark.parametrize(("limit", "expected"), [("150000 100000", 2), ("50000 100000", 1), ("max 100000", 4), ("nonsense", 4)])
def test_the_quota_of_the_control_group_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limit: str, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2, 3}, raising=False)
    (tmp_path / "cpu.max").write_text(limit)
    assert threads.processors() == expected


@pytest.mark.parametrize(("quota", "expected"), [("300000", 3), ("-1", 4)])
def test_the_quota_of_an_older_control_group_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, quota: str, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2, 3}, raising=False)
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu" / "cpu.cfs_quota_us").write_text(quota)
    (tmp_path / "cpu" / "cpu.cfs_period_us").write_text("100000")
    assert threads.processors() == expected


@pytest.mark.parametrize(
    ("limits", "expected"), [({"a": "300000", "a/b": "max"}, 3), ({"a": "300000", "a/b": "200000"}, 2), ({"c": "100000"}, 4)]
)
def test_the_quota_of_every_group_around_the_process_counts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, limits: dict[str, str], expected: int
) -> None:
    """On a machine that is no container the limits are in folders below the root; those of other processes do not count."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2, 3}, raising=False)
    (tmp_path / "membership").write_text("1:name=systemd:/c\n0::/a/b\n")
    for folder, limit in limits.items():
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "cpu.max").write_text(f"{limit} 100000")
    assert threads.processors() == expected


@pytest.mark.parametrize(("asked", "expected"), [("7", 7), ("5,2", 5), ("0", 2), ("many", 2)])
def test_omp_num_threads_counts(monkeypatch: pytest.MonkeyPatch, asked: str, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1}, raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert threads.processors() == expected


@LINUX
@pytest.mark.parametrize(("chosen", "expected"), [({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "active"}, "ACTIVE")])
def test_idle_threads_sleep_unless_the_user_has_chosen(chosen: dict[str, str], expected: str) -> None:
    environment = {**{k: v for k, v in os.environ.items() if k not in threads.CHOSEN}, "OMP_DISPLAY_ENV": "true", **chosen}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True)
    if "OMP_WAIT_POLICY" not in done.stderr:
        pytest.skip("the compiler has no OpenMP")
    assert f"OMP_WAIT_POLICY = '{expected}'" in done.stderr
    assert done.stdout.split(maxsplit=1) == ["2500.0", f"{list(chosen)}\n"]


def _run(script: str, *arguments: str, **environment: str) -> list[str]:
    """Returns the words that a script prints in a process without the user's choices."""
    inherited = {k: v for k, v in os.environ.items() if k not in (*threads.CHOSEN, "OMP_NUM_THREADS")}
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, env={**inherited, **environment}, capture_output=True, text=True, check=True).stdout.split()


@LINUX
def test_a_thread_that_waits_takes_no_processor_time() -> None:
    """Two threads take the processor time of one, and something to wake them; threads that spin between the calls took ten times more."""
    one, two = map(float, _run(IDLE))
    assert two < 3 * one + 0.1


@LINUX
@pytest.mark.parametrize(
    ("how", "asked", "environment", "more"),
    [
        ("all", "2", {}, 1),
        ("all", "0", {"OMP_NUM_THREADS": "1"}, 0),
        ("all", "0", {"OMP_NUM_THREADS": "3"}, 2),
        ("affinity", "0", {}, 0),
    ],
    ids=["two", "one by OMP_NUM_THREADS", "three by OMP_NUM_THREADS", "one by affinity"],
)
def test_a_call_starts_as_many_threads_as_it_may(how: str, asked: str, environment: dict[str, str], more: int) -> None:
    (started,) = _run(TEAM, how, asked, **environment)
    if more and started == "0":
        pytest.skip("the compiler has no OpenMP")
    assert int(started) == more
