"""Loops of printed programs in JAX: what they give and cost under `vmap`, beside JAX's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy
pytestmark = pytest.mark.usefixtures("x64")


@pytest.fixture
def while_loop() -> Iterator[Callable[..., Any]]:
    from teg.backends.jax.while_loops import while_loop

    return while_loop


def halved(loop: Callable[..., Any], scale: Any, v: Any) -> Any:
    """How often v·scale can be halved until it is below 1, and what is left, in a structure with a literal and a number in 32 bits."""
    end = loop(
        lambda at: at["v"] * scale >= 1.0,
        lambda at: {"v": 0.5 * at["v"], "times": at["times"] + 1, "sum": at["sum"] + scale},
        {"v": v, "times": jnp.int32(0), "sum": 0.0},
    )
    return end["v"], end["times"], end["sum"]


def collatz(loop: Callable[..., Any], n: Any) -> Any:
    """The sum over k < n of the steps of k + 1 to 1: a loop in a loop, whose turns differ from element to element."""

    def steps(m: Any) -> Any:
        return loop(lambda at: at[0] > 1, lambda at: (jnp.where(at[0] % 2 == 0, at[0] // 2, 3 * at[0] + 1), at[1] + 1), (m, jnp.int64(0)))[
            1
        ]

    return loop(lambda at: at[0] < n, lambda at: (at[0] + 1, at[1] + steps(at[0] + 1)), (jnp.int64(0), jnp.int64(0)))[1]


@pytest.mark.parametrize("axes", [(None, None), (0, None), (None, 0), (0, 0), (None, 1)], ids=str)
def test_values_and_types_are_those_of_jax(while_loop: Callable[..., Any], axes: tuple[int | None, int | None]) -> None:
    v = np.array([[0.3, 5.0, 100.0], [7.0, 1.0, np.nan]]) if axes[1] is not None else np.float64(37.0)
    scale = np.array([1.0, 3.0, 0.5]) if axes[0] is not None and axes[1] is None else np.array([1.0, 3.0]) if axes[0] == 0 else 2.0

    def run(loop: Callable[..., Any]) -> Any:
        def f(scale: Any, v: Any) -> Any:
            inner = (lambda w: halved(loop, scale, w)) if jnp.ndim(v) == 0 else jax.vmap(lambda w: halved(loop, scale, w))
            return inner(v)

        return (f if axes == (None, None) else jax.vmap(f, in_axes=axes))(scale, v)

    for found, wanted in zip(run(while_loop), run(jax.lax.while_loop), strict=True):
        assert found.dtype == wanted.dtype
        np.testing.assert_array_equal(found, wanted)
    for found, wanted in zip(jax.jit(lambda: run(while_loop))(), run(jax.lax.while_loop), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_loops_in_loops(while_loop: Callable[..., Any]) -> None:
    ends = np.array([1, 7, 0, 20])
    found = jax.jit(jax.vmap(lambda n: collatz(while_loop, n)))(ends)
    steps = [0, 1, 7, 2, 5, 8, 16, 3, 19, 6, 14, 9, 9, 17, 17, 4, 12, 20, 20, 7]
    assert found.tolist() == [sum(steps[:n]) for n in ends]


def test_a_direction_goes_through_a_loop(while_loop: Callable[..., Any]) -> None:
    value, slope = jax.jvp(lambda v: halved(while_loop, 1.0, v)[0], (5.0,), (1.0,))
    assert (value, slope) == (0.625, 0.125)
    value, slope = jax.jit(lambda v: jax.jvp(lambda s: halved(while_loop, s, v)[2], (2.0,), (1.0,)))(5.0)
    assert (value, slope) == (8.0, 4.0)


def test_a_body_is_traced_once_for_each_level_of_vmap(while_loop: Callable[..., Any]) -> None:
    """JAX's own rule asks it again and again."""
    counts = []
    for loop in (while_loop, jax.lax.while_loop):
        traced = []
        probe = jax.custom_batching.custom_vmap(lambda v: 0.5 * v)

        def rule(size: int, mapped: Any, v: Any, traced: list[int] = traced) -> Any:
            traced.append(size)
            return 0.5 * v, mapped[0]

        probe.def_vmap(rule)

        def turns(v: Any, loop: Any = loop, probe: Any = probe) -> Any:
            return loop(lambda at: at[0] > 1.0, lambda at: (probe(at[0]), at[1] + at[2], at[2] + 1.0), (v, 0.0, 0.0))

        jax.make_jaxpr(jax.vmap(turns))(np.ones(3))
        counts.append(len(traced))
    assert counts[0] == 1 < counts[1]


def selects(function: Callable[..., Any], *operands: Any) -> int:
    """How many selects XLA is given for a function, loops included."""
    return str(jax.jit(function).lower(*operands).as_text()).count("stablehlo.select")


def counted(loop: Callable[..., Any], n: Any, **options: Any) -> Any:
    """The sum over k < n of k: at its end nothing is added, and what is carried beside that is not read."""

    def turn(at: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        k, total, turns = at
        return jnp.minimum(k + 1, n), total + jnp.minimum(k, n) * (k < n), turns + 1

    return loop(lambda at: at[0] < n, turn, (jnp.int64(0), jnp.int64(0), jnp.int64(0)), **options)[1]


@pytest.mark.parametrize("rests", [False, True], ids=["moves on", "rests"])
def test_elements_at_their_end_keep_what_is_read(while_loop: Callable[..., Any], rests: bool) -> None:
    ends = np.array([[3, 0, 5], [1, 9, 2]])
    found = jax.vmap(jax.vmap(lambda n: counted(while_loop, n, rests=rests)))(ends)
    np.testing.assert_array_equal(found, ends * (ends - 1) // 2)


def test_a_second_map_selects_nothing(while_loop: Callable[..., Any]) -> None:
    """The first one selects three carried values, or none if the loop rests."""
    for rests, expected in ((False, 3), (True, 0)):

        def once(n: Any, rests: bool = rests) -> Any:
            return counted(while_loop, n, rests=rests)

        assert selects(jax.vmap(once), np.ones(2, int)) == expected
        assert selects(jax.vmap(jax.vmap(once)), np.ones((2, 3), int)) == expected


def test_a_batch_of_batches_selects_no_more_than_a_batch() -> None:
    """Searches and adaptive integrals rest. Before they did, this program had 158 selects in a batch and 204 in a batch of batches."""
    import teg

    x, t = teg.var("x"), teg.param("t")
    e = teg.integral(teg.bracket(teg.exp(x) * x * x < t) * teg.exp(-x * x * t), (x, -1, 1))
    f = teg.jax_function(e, kernel="xla")
    few = selects(lambda s: f(t=s), np.ones(2))
    assert selects(lambda s: f(t=s), np.ones((3, 2))) == few < 110
