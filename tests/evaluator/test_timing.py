"""What is logged, and when."""

from __future__ import annotations

import io
import logging
import shutil
import threading
import time

import pytest

import teg
from teg.evaluator import timing
from teg.evaluator.wanted import GRADIENT, HESSIAN, VALUE, Wanted

x, t = teg.var("x"), teg.param("t")


def test_derivations_and_compilations_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "teg"):
        f = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t])
        f.grad(t=0.5)
        f.grad(t=0.25)
    said = [record.getMessage().split(" in ")[0] for record in caplog.records]
    assert said == ["derived value", "derived gradient", "compiled gradient for numpy"]  # the value alone was not asked for
    assert {record.levelno for record in caplog.records} == {logging.INFO}
    assert {record.name for record in caplog.records} == {"teg"}


@pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
def test_a_program_is_derived_once_for_all_evaluators_that_are_there(caplog: pytest.LogCaptureFixture) -> None:
    e = teg.integral(teg.bracket(x < t) * x**5, (x, 0, 1))
    kept = []
    for options, is_new in (({}, True), ({"backend": "c"}, False), ({"backend": "c", "threads": 2}, False), ({"tol": 1e-9}, True)):
        caplog.clear()
        with caplog.at_level(logging.INFO, "teg"):
            kept.append(teg.compile(e, [t], **options))  # type: ignore[arg-type]
            assert kept[-1].grad(t=0.5)["t"] == pytest.approx(0.5**5, rel=1e-13)
        said = {record.getMessage().split()[0] for record in caplog.records}
        assert said == ({"derived", "compiled"} if is_new else {"compiled"}), options


def test_nothing_is_printed_unless_asked_for(capfd: pytest.CaptureFixture[str]) -> None:
    teg.compile(teg.integral(teg.bracket(x < t) * x**3, (x, 0, 1)), [t]).grad(t=0.5)
    assert capfd.readouterr() == ("", "")


def test_the_cache_says_whether_it_had_the_library(
    caplog: pytest.LogCaptureFixture, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TEG_CACHE_DIR", str(tmp_path))
    for expected in ("compiled by", "found in the cache"):
        caplog.clear()
        with caplog.at_level(logging.DEBUG, "teg"):
            teg.compile(teg.integral(x * t, (x, 0, 1)), backend="c")(t=2.0)
        messages = [record.getMessage() for record in caplog.records if record.name == "teg.backends.c"]
        assert messages
        assert all(message.startswith(expected) for message in messages)


def test_a_slow_compilation_says_that_it_goes_on(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SLOW", 0.01)
    with caplog.at_level(logging.INFO, "teg"), timing.timed("value for c", "compiled"):
        time.sleep(0.1)
    assert [record.getMessage().split(" in ")[0] for record in caplog.records] == [
        "not compiled yet after 0.01 s: value for c",
        "compiled value for c",
    ]


def test_what_failed_is_not_logged_as_done(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "teg"), pytest.raises(ValueError, match="no"), timing.timed("value", "derived"):
        raise ValueError("no")
    assert caplog.records == []


def test_titles() -> None:
    assert [wanted.title for wanted in (VALUE, GRADIENT, HESSIAN)] == ["value", "value and gradient", "value, gradient and Hessian"]
    assert Wanted(False, 1, ((t,),)).title == "gradient of the derivative along a direction"


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_line_while_it_is_slow_and_removes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SLOW", 0.01)
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    with timing.timed("value for c", "compiled"):
        time.sleep(0.1)
    first, line, blank, last = terminal.getvalue().split("\r")
    assert (first, last) == ("", "")
    assert line == "teg: value for c, not compiled yet after 0 s (Ctrl-C stops it)"
    assert blank == " " * len(line)


def test_nothing_is_shown_where_it_is_quick_or_not_wanted(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    with timing.timed("value", "derived"):
        pass
    monkeypatch.setattr(timing, "SLOW", 0.001)
    with caplog.at_level(logging.ERROR, "teg"), timing.timed("value", "derived"):
        time.sleep(0.05)
    assert terminal.getvalue() == ""


def test_an_interrupted_compilation_leaves_no_line_and_breaks_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SLOW", 0.0)
    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    f = teg.compile(teg.integral(teg.bracket(x * x * x < t) * teg.exp(t * x), (x, 0, 1)), [t])
    with monkeypatch.context() as patch:
        patch.setattr("teg.evaluator.kernels.build_kernel", interrupted)
        with pytest.raises(KeyboardInterrupt):
            f.grad(t=0.5)
    assert terminal.getvalue().rpartition("\r")[2] == ""
    assert f.grad(t=0.5)["t"] == pytest.approx(1.1990362098)
    assert not [thread for thread in threading.enumerate() if thread.name == "teg progress"]


def interrupted(*_: object) -> None:
    """What Ctrl-C does."""
    time.sleep(0.05)
    raise KeyboardInterrupt
