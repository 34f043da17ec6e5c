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
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads what libgomp says")


@pytest.fixture(autouse=True)
def unlimited(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setattr(threads, "CONTROL_GROUPS", tmp_path)


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
