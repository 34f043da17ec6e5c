"""`rarely`: what is good is kept, and the rest computed, in batches of any size and nesting."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")

from teg.backends.jax.rarely import FEWEST, PART, rarely, rarely_p  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")


def halved(a: Any, b: Any) -> Any:
    """a - b, and which way it was computed."""
    jnp = jax.numpy
    table = jnp.array([1.0, -1.0])
    found = [jnp.where(a > 0.0, a - b, jnp.nan), jnp.int32(1)]
    return rarely(a > 0.0, found, lambda u, v: [table[0] * u + table[1] * v, jnp.int32(2)], a, b)


@pytest.mark.parametrize("n", [1, 5, FEWEST, PART * FEWEST + 3, 1000])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_every_element_of_a_batch_gets_its_own_results(n: int, share: float) -> None:
    random = np.random.default_rng(n)
    a = np.where(random.uniform(size=n) < share, -1.0, 1.0) * random.uniform(0.5, 1.0, n)
    b = random.uniform(size=n)
    value, which = jax.jit(jax.vmap(halved))(a, b)
    assert np.array_equal(value, a - b)
    assert np.array_equal(which, np.where(a > 0.0, 1, 2))
    value, which = jax.jit(jax.vmap(halved, in_axes=(0, None)))(a, 0.25)
    assert np.array_equal(value, a - 0.25)
    assert np.array_equal(which, np.where(a > 0.0, 1, 2))


@pytest.mark.parametrize("axes", [((0, 0), (0, 0)), ((0, None), (0, 0)), ((0, None), (None, 0)), ((1, 0), (0, 0)), ((None, 0), (0, None))])
def test_batches_of_batches(axes: Any) -> None:
    """`axes`: what the outer and the inner map do with both arguments."""
    random = np.random.default_rng(0)
    outer, inner = axes
    m, n = 3, 20
    shapes = [tuple(size for size, level in ((m, outer[k]), (n, inner[k])) if level is not None) for k in range(2)]
    a, b = (random.uniform(-1.0, 1.0, s) for s in shapes)
    full = [v.reshape([size if level is not None else 1 for size, level in ((m, outer[k]), (n, inner[k]))]) for k, v in enumerate((a, b))]
    given = [v.T if outer[k] == 1 else v for k, v in enumerate((a, b))]
    value, which = jax.vmap(jax.vmap(halved, in_axes=inner), in_axes=outer)(*given)
    assert np.array_equal(value, np.broadcast_to(full[0] - full[1], (m, n)))
    assert np.array_equal(which, np.broadcast_to(np.where(full[0] > 0.0, 1, 2), (m, n)))


def test_one_element_is_a_branch_and_derivatives_are_those_of_the_branch() -> None:
    assert [float(halved(a, 2.0)[0]) for a in (1.0, -1.0)] == [-1.0, -3.0]
    for a in (1.0, -1.0):
        assert jax.jvp(lambda u: halved(u, 2.0)[0], (a,), (1.0,))[1] == 1.0
    a = np.array([1.0, -1.0, 2.0])
    assert np.array_equal(jax.vmap(lambda u: jax.jvp(lambda x: halved(x, 2.0)[0], (u,), (1.0,))[1])(a), np.ones(3))


def test_a_map_is_one_primitive() -> None:
    traced = jax.make_jaxpr(jax.vmap(jax.vmap(halved)))(np.ones((2, 3)), np.ones((2, 3)))
    assert sum(e.primitive is rarely_p for e in traced.eqns) == 1
