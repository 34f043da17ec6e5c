"""What is logged, and when."""

from __future__ import annotations

import logging
import time

import pytest

import teg
from teg.evaluator import timing
from teg.evaluator.plan import GRADIENT, HESSIAN, VALUE, Wanted

x, t = teg.var("x"), teg.param("t")


def test_derivations_and_compilations_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "teg"):
        f = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t])
        f.grad(t=0.5)
        f.grad(t=0.25)
    said = [record.getMessage().split(" in ")[0] for record in caplog.records]
    assert said == ["derived value", "compiled value for numpy", "derived gradient", "compiled gradient for numpy"]
    assert {record.levelno for record in caplog.records} == {logging.INFO}
    assert {record.name for record in caplog.records} == {"teg"}


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
