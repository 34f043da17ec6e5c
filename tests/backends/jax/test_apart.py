"""Values that XLA computes once: which are chosen, that nothing else changes, and that no copies are compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy

from teg.backends.jax import apart  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")
LENGTH, USERS = 60, 8


def chain(x: Any) -> Any:
    """A long chain of cheap operations."""
    for k in range(LENGTH):
        x = x * (k + 0.5) - x * x
        x = jnp.where(x > 2.0, x - 1.0, 0.5 * x)
    return x


def chained(x: Any) -> list[Any]:
    """A chain, and several users that XLA stores."""
    x = chain(x)
    return [jnp.sort(x + k) for k in range(USERS)]


def cuts(function: Any, *operands: Any) -> int:
    """How often values are kept apart, loops included."""
    return jax.jit(apart.once(function)).lower(*operands).as_text().count("call @teg_apart")


def test_what_many_need_is_kept_once() -> None:
    x = np.linspace(-1.0, 1.0, 7)
    assert cuts(chained, x) == 1
    for found, expected in zip(apart.once(chained)(x), chained(x), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_short_chains_and_single_users_are_left_to_xla() -> None:
    x = np.linspace(-1.0, 1.0, 7)
    assert cuts(lambda v: [jnp.sort(chain(v))], x) == 0
    assert cuts(lambda v: [jnp.sort(2.0 * v + k) for k in range(USERS)], x) == 0
    assert cuts(lambda v: [jnp.sort(jnp.exp(v) + k) for k in range(USERS)], x) == 0


def test_what_gains_nothing_beside_others_that_are_kept_is_left_to_xla() -> None:
    """The sum of two chains is chosen first, then both chains; after that it is one operation, which eight kernels may repeat."""

    def function(x: Any) -> list[Any]:
        chains = [x, 0.5 * x]
        for k in range(20):
            chains = [c * c - k for c in chains]
        total = chains[0] + chains[1]
        return [jnp.sort(v + k) for v, users in ((total, USERS), *((c, 4) for c in chains)) for k in range(users)]

    assert cuts(function, np.linspace(-1.0, 1.0, 7)) == 2


def test_inside_of_loops_and_under_maps() -> None:
    def looped(x: Any) -> list[Any]:
        def step(at: Any) -> Any:
            return (at[0] + 1, *(at[1 + k] + v for k, v in enumerate(chained(at[1]))))

        return list(jax.lax.while_loop(lambda at: at[0] < 3, step, (0, *[x] * USERS)))

    x = np.linspace(-1.0, 1.0, 6).reshape(2, 3)
    assert cuts(jax.vmap(looped), x) >= 1
    for found, expected in zip(jax.vmap(lambda v: apart.once(looped)(v))(x), jax.vmap(looped)(x), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_a_call_is_made_on_cpus_only() -> None:
    export = pytest.importorskip("jax.export")
    exported = export.export(jax.jit(apart.once(chained)), platforms=["cuda"])(np.linspace(-1.0, 1.0, 7))
    assert "teg_apart" not in str(exported.mlir_module())


def test_the_values_of_a_search_are_computed_once(monkeypatch: pytest.MonkeyPatch, as_users_jit: dict[str, bool]) -> None:
    """Each turn of a search updates some thirty arrays by the same decisions: 205 products in all, 768 where XLA copies them."""
    import teg
    from teg.backends.jax import derivative

    x, t = teg.var("x"), teg.param("t")
    e = teg.integral(teg.bracket(teg.exp(x) * x * x < t), (x, -1, 1))

    def products() -> int:
        f = teg.jax_function(e, kernel="xla")
        return str(jax.jit(lambda s: f(t=s)).lower(0.5).compile(as_users_jit).as_text()).count(" multiply(")

    kept = products()
    monkeypatch.setattr(derivative, "once", lambda function: function)
    assert 2 * kept < products()


def test_the_cost_of_a_triangle_and_a_pixel() -> None:
    """Value and gradient by six corners, in the graph that XLA made of a batch: 1500 operations, 0.8 kB; most are the straight line's."""
    from tests.bench.jax_kernels import AT, batched, graph, triangle

    operations, moved = graph(triangle(), batched(AT, 256), 256)
    assert operations < 1600
    assert moved < 1000
