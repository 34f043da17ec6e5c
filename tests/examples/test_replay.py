"""A run of an optimiser that is not ours, killed and resumed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from teg.errors import InputError
from teg.examples import replay
from teg.examples.replay import Replay

PROGRAM = """
import sys, time
from pathlib import Path
import numpy as np
from scipy.optimize import minimize, rosen, rosen_der
from teg.examples import replay
replay.CHECKPOINT_SECONDS = 0.0
kept = replay.Replay(Path(sys.argv[1]), {"task": 1}, "resume" in sys.argv)
def slow(x):
    time.sleep(0.02 * ("slow" in sys.argv))
    print("called", flush=True)
    return np.array(rosen(x))
end = minimize(kept.kept("value", slow), [1.3, 0.7, 0.8, 1.9], jac=kept.kept("slope", rosen_der), method="BFGS")
print("end", end.x.tolist(), kept.computed, kept.replayed)
"""


def test_a_killed_run_loses_nothing(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    words = [sys.executable, "-c", PROGRAM, str(tmp_path / "checkpoint.npz")]
    with subprocess.Popen([*words, "slow"], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        for _ in range(8):
            assert run.stdout.readline() == "called\n"
        run.send_signal(signal.SIGKILL)
    resumed = subprocess.run([*words, "resume"], capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    whole = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    assert resumed.split("]")[0] == whole.split("]")[0]
    computed, replayed = map(int, resumed.split()[-2:])
    assert replayed >= 7
    assert computed + replayed == sum(map(int, whole.split()[-2:]))


def test_results_are_kept_by_name_and_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "CHECKPOINT_SECONDS", 1e9)
    path = tmp_path / "checkpoint.npz"
    first = Replay(path, {"a": 1}, False)
    square, double = first.kept("square", lambda x: x * x), first.kept("double", lambda x: 2 * x)
    assert square(np.array([3.0]))[0] == 9
    assert double(np.array([3.0]))[0] == 6
    assert (first.computed, first.replayed) == (2, 0)
    first.save()
    again = Replay(path, {"a": 1}, True)
    assert again.kept("square", lambda x: x)(np.array([3.0]))[0] == 9
    assert again.kept("square", lambda x: x)(np.array([4.0]))[0] == 4
    assert (again.computed, again.replayed) == (1, 1)
    with pytest.raises(InputError, match="a was 1, is 2"):
        Replay(path, {"a": 2}, True)
