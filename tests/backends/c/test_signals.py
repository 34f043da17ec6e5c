"""Ctrl-C during a compiled call: it ends soon, nothing is broken after it, and other threads' calls go on."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import textwrap
import weakref
from pathlib import Path

import numpy as np
import pytest

from teg.backends.c import signals
from teg.backends.c.kernel import compile_c
from tests.backends.c_checks import in_c
from tests.backends.programs import TWO_VARIABLES, Case, columns, expected

pytestmark = [*in_c, pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")]
ROOT = Path(__file__).resolve().parents[3]
SOON = 0.5
"""Seconds: 50 ms between two looks at the signals, and room for a busy machine."""

BEGIN = """
import os, signal, sys, threading, time
import numpy as np, teg
threads = int(sys.argv[1])
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have started the tests with Ctrl-C ignored
x, y, z, v = teg.vars("x y z v")
t, a = teg.params("t a")
disk = teg.bracket(x*x + y*y < t) * teg.exp(a*x*y)
square = (x, -1, 1), (y, -1, 1)
def signalled(seconds=0.3, number=signal.SIGINT):
    sent = []
    def send():
        time.sleep(seconds)
        sent.append(time.perf_counter())
        os.kill(os.getpid(), number)
    threading.Thread(target=send, daemon=True).start()
    return sent
def stopped(call, kind=KeyboardInterrupt, number=signal.SIGINT):
    sent = signalled(number=number)
    try:
        call()
    except kind:
        print("stopped", time.perf_counter() - sent[0])
    else:
        print("finished")
"""
CALLS = {
    "a batch of exact integrals": """
        f = teg.compile(teg.integral(teg.bracket(x + y < t) * (1 + a*x), (x, 0, 1), (y, 0, 1)), backend="c", threads=threads)
        many = np.linspace(0.3, 0.9, 10**7)
        call = lambda: [f(t=many, a=1.0) for _ in range(20)]""",
    "a batch of adaptive integrals": """
        f = teg.compile(teg.integral(disk, *square), backend="c", threads=threads)
        many = np.linspace(0.3, 0.9, 10**7)
        call = lambda: f(t=many, a=1.0)""",
    "one element that is sampled": """
        f = teg.compile(teg.integral(disk, *square), backend="c", threads=threads, rule="qmc", order=2**33)
        call = lambda: f(t=0.5, a=1.0)""",
    "one element by a uniform rule": """
        f = teg.compile(teg.integral(disk, *square), backend="c", threads=threads, rule="midpoint", order=10**6)
        call = lambda: f(t=0.5, a=1.0)""",
    "one element of four integrals": """
        deep = teg.bracket(x*x + y*y*v + z*z < t) * teg.exp(a*x*y*v)
        f = teg.compile(teg.integral(deep, *square, (z, -1, 1), (v, -1, 1)), backend="c", threads=threads, rule="gauss", order=63)
        call = lambda: f(t=0.5, a=1.0)""",
    "the last element of a batch": """
        half = teg.bracket(x < t) * teg.exp(a*x*y)
        f = teg.compile(teg.integral(half, *square), backend="c", threads=threads, rule="midpoint", order=10**6)
        call = lambda: f(t=np.array([0.5]), a=1.0)""",
}
AFTER = """
stopped(call)
g = teg.compile(teg.integral(teg.bracket(x < t), (x, 0, 1)), backend="c", threads=threads)
assert g(t=0.25) == 0.25 and (g(t=np.array([0.25, 0.5])) == [0.25, 0.5]).all()
stopped(call)
"""


def run(*parts: str, threads: int = 1) -> list[list[str]]:
    script = "\n".join(textwrap.dedent(part) for part in (BEGIN, *parts))
    command = [sys.executable, "-c", script, str(threads)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return [line.split() for line in done.stdout.splitlines()]


FAST = ("a batch of exact integrals", 2), ("one element that is sampled", 1)


@pytest.mark.parametrize(
    ("name", "threads"),
    [pytest.param(name, n, marks=[] if (name, n) in FAST else pytest.mark.slow) for name in CALLS for n in (1, 2)],
)
def test_a_long_call_is_stopped(name: str, threads: int) -> None:
    """Twice, with other calls between: nothing is left over from the first one."""
    for line in run(CALLS[name], AFTER, threads=threads):
        assert line[0] == "stopped"
        assert float(line[1]) < SOON


def test_any_handler_runs_in_the_middle_of_a_call_and_need_not_stop_it() -> None:
    """What a handler raises comes out of the call; one that raises nothing is run while the kernel waits."""
    name = "one element that is sampled"
    raising, quiet, counted = run(
        CALLS[name],
        """
        class Enough(Exception): pass
        def raises(*_): raise Enough
        signal.signal(signal.SIGALRM, raises)
        stopped(call, Enough, signal.SIGALRM)
        seen = []
        signal.signal(signal.SIGUSR1, lambda *_: seen.append(time.perf_counter()))
        sent = signalled(0.1, signal.SIGUSR1)
        stopped(call)
        print("handled", seen[0] - sent[0], len(seen))
        """,
    )
    assert raising[0] == quiet[0] == "stopped"
    assert float(raising[1]) < SOON
    assert counted[0] == "handled"
    assert float(counted[1]) < SOON
    assert counted[2] == "1"


@pytest.mark.slow
def test_a_call_in_another_thread_goes_on() -> None:
    """Only Python's main thread is interrupted; the kernel that another thread runs at that time gives its result. A signal between two
    calls of that thread says nothing, so it is sent again."""
    lines = run(
        """
        many = np.linspace(0.3, 0.9, 2 * 10**4)
        f = teg.compile(teg.integral(disk, *square), backend="c")
        wanted = f(t=many, a=1.0)
        calls, over = [], threading.Event()
        def work():
            while not over.is_set():
                begun = time.perf_counter()
                right = (f(t=many, a=1.0) == wanted).all()
                calls.append((begun, time.perf_counter(), right))
        worker = threading.Thread(target=work)
        g = teg.compile(teg.integral(disk, *square), backend="c", rule="qmc", order=2**33)
        worker.start()
        met = False
        for attempt in range(20):
            try:
                sent = signalled(0.2)
                g(t=0.5, a=1.0)
            except KeyboardInterrupt:
                stopped = time.perf_counter()
            seen = len(calls)
            while worker.is_alive() and len(calls) < seen + 2:  # those that were going on have ended
                time.sleep(0.01)
            met = any(begun < sent[0] < ended for begun, ended, _ in calls)
            if met or not worker.is_alive():
                break
        print("alive", worker.is_alive(), met, stopped > sent[0])
        over.set()
        worker.join()
        print(all(right for *_, right in calls))
        """
    )
    assert lines == [["alive", "True", "True", "True"], ["True"]]


def test_python_runs_in_other_threads_during_a_call() -> None:
    """The lock is given away for all of a call."""
    lines = run(
        """
        f = teg.compile(teg.integral(disk, *square), backend="c", rule="qmc", order=2**20)
        f(t=0.5, a=1.0)
        count, going = [0], [True]
        def work():
            while going[0]:
                count[0] += 1
                time.sleep(0.0005)
        worker = threading.Thread(target=work); worker.start()
        before, start = count[0], time.perf_counter()
        while time.perf_counter() - start < 0.2: f(t=0.5, a=1.0)
        print(count[0] - before); going[0] = False; worker.join()
        """
    )
    assert int(lines[0][0]) > 20


@pytest.mark.parametrize("case", TWO_VARIABLES, ids=lambda case: case.name)
def test_signals_that_stop_nothing_change_nothing(case: Case) -> None:
    """A handler that is run every millisecond."""
    seen: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda *_: seen.append(1))
    many = [np.tile(column, 3000) if column.ndim else column for column in columns(case)]
    kernels = [compile_c(case.program, threads=threads) for threads in (1, 2)]
    signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
    try:
        for kernel in kernels:
            found = kernel(many, 3000 * case.n)
            np.testing.assert_allclose(found, np.tile(expected(case), 3000), rtol=case.tolerance, atol=case.tolerance)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_kernels_made_by_threads_that_start_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may get functions of Python of its own, of which only one is cached: the others live as long as their kernels."""
    shared, own = signals._library(), []

    def uncached() -> tuple[object, object]:
        functions = signals._Python(*(getattr(shared[1], name) for name in ("give", "take", "check")))
        own.append(weakref.ref(functions))
        return shared[0], functions

    monkeypatch.setattr(signals, "_library", uncached)
    kernel = compile_c(TWO_VARIABLES[0].program)
    gc.collect()
    assert own
    assert all(functions() is not None for functions in own)
    del kernel
