"""Bars of evaluations: on a terminal they count, in a pipe there is none."""

from __future__ import annotations

import io
import sys

import numpy as np
import pytest

pytest.importorskip("tqdm")

from teg.examples.harness import evaluations_shown
from teg.examples.replay import not_kept


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("stream", [Terminal, io.StringIO])
def test_evaluations_are_counted_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO]) -> None:
    written = stream()
    monkeypatch.setattr(sys, "stderr", written)
    with evaluations_shown(True, not_kept, "descent") as keep:
        double = keep("loss", lambda point: 2 * point)
        for number in range(3):
            assert double(np.array([number, 1.0])).tolist() == [2 * number, 2]
    text = written.getvalue()
    assert ("descent: 3 evaluations" in text) == (stream is Terminal)
    assert ("loss 4" in text) == (stream is Terminal)
    assert bool(text) == (stream is Terminal)
