"""Options of XLA: the same results, in programs of users, in calls outside of `jit`, and none where XLA does not know them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import teg

jax = pytest.importorskip("jax")
pytestmark = pytest.mark.usefixtures("x64")

x, y = teg.vars("x y")
t, a = teg.params("t a")
HALF_PLANE = teg.integral(teg.bracket(x + a * y < t) * teg.exp(a * x), (x, 0, 1), (y, 0, 1))


@pytest.fixture
def unknown(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A version of XLA that does not know the options."""
    from teg.backends.jax import options

    monkeypatch.setattr(options, "FASTER", {"xla_of_another_version": True})
    options.compiler_options.cache_clear()
    yield
    options.compiler_options.cache_clear()


def test_results_have_the_same_bits(as_users_jit: dict[str, bool]) -> None:
    f = teg.jax_function(HALF_PLANE, kernel="xla")
    at: Any = {"t": np.linspace(0.1, 1.9, 7), "a": 0.7}
    value = jax.value_and_grad(lambda p: f(p).sum())
    plain, faster = jax.jit(value, compiler_options=as_users_jit)(at), jax.jit(value, compiler_options=f.compiler_options)(at)
    assert jax.tree.all(jax.tree.map(np.array_equal, plain, faster))
    assert np.array_equal(f(at), jax.jit(f, compiler_options=as_users_jit)(at))  # outside of jit, and inside


def test_a_version_that_does_not_know_them(unknown: None) -> None:
    f = teg.jax_function(HALF_PLANE, kernel="xla")
    assert f.compiler_options == {}
    exact = teg.compile(HALF_PLANE, backend="numpy")(t=0.5, a=0.7)
    np.testing.assert_allclose(f(t=0.5, a=0.7), exact, rtol=1e-14)


def test_options_are_copies() -> None:
    f = teg.jax_function(HALF_PLANE, kernel="xla")
    f.compiler_options.clear()
    assert f.compiler_options == teg.jax_function(HALF_PLANE).compiler_options
