"""What every test shares: the IR is verified between passes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

QUICK_IN_JAX = ("test_jax_backend.py", "test_floors.py")
"""Where JAX is tested in the quick run too: XLA takes half a second to some seconds for each program."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is compiled by XLA is slow, but for the tests of the backend itself."""
    for item in items:
        if "jax" in item.nodeid.lower() and not any(name in item.nodeid for name in QUICK_IN_JAX):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True, scope="session")
def verified() -> Iterator[None]:
    """TEG_VERIFY=1 in all tests (for the session, as property tests allow no fixtures of one function)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TEG_VERIFY", "1")
        yield


@pytest.fixture
def x64() -> Iterator[None]:
    """JAX in 64-bit mode during a test; the test is skipped without JAX."""
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)
