"""Short animations in the tests of demonstrations."""

from __future__ import annotations

import pytest

from teg.examples import animation


@pytest.fixture(autouse=True)
def _short_animations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "FRAMES", 4)
