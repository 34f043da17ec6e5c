"""What every test shares: the IR is verified between passes."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def verified(monkeypatch: pytest.MonkeyPatch) -> None:
    """TEG_VERIFY=1 in every test."""
    monkeypatch.setenv("TEG_VERIFY", "1")
