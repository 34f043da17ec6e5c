"""What the backend tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def one_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One empty cache of compiled C for the tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_CACHE_DIR", str(tmp_path_factory.mktemp("teg")))
        yield
