"""What every test shares: the IR is verified between passes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="session")
def verified() -> Iterator[None]:
    """TEG_VERIFY=1 in all tests (for the session, as property tests allow no fixtures of one function)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_VERIFY", "1")
        yield
