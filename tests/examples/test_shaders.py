"""The window in several lights: right, and only the first one pays for the window."""

from __future__ import annotations

from pathlib import Path

import pytest

from teg.__main__ import main
from teg.evaluator import derivation
from teg.examples.shaders import compare


def test_every_light_is_right_and_the_window_is_derived_once(monkeypatch: pytest.MonkeyPatch) -> None:
    derived: list[object] = []
    real = derivation.compiled_outputs
    monkeypatch.setattr(derivation, "compiled_outputs", lambda *args: (derived.append(args), real(*args))[1])
    rows = compare({"angle": 0.4, "width": 0.7, "contrast": 0.5})
    assert [row.name for row in rows] == ["waves", "lamp", "dawn", "sky"]
    assert max(row.error for row in rows) < 1e-13
    assert len(derived) == 2 * 4 + 2 * 3  # value and gradient: of each written out; of smooth lights, the quadratic one, and the steep lamp


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "shaders", "-o", str(tmp_path)]) == 0
    assert "lamp" in capsys.readouterr().out
