"""Numbers that came from one array are read from it at once, also inside of maps and loops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy

from teg.backends.jax import entries, runtime  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")
NUMBERS = np.array([2.0, 3.0, 5.0, 7.0, 11.0])


@pytest.fixture(autouse=True)
def remembered() -> Iterator[None]:
    """As in the run of a printed program."""
    with entries.remembered():
        yield


def operations(function: Any, *operands: Any) -> list[str]:
    return [e.primitive.name for e in jax.make_jaxpr(function)(*operands).eqns]


def test_all_numbers_of_an_array_are_the_array() -> None:
    def again(array: Any) -> Any:
        return entries.stacked(entries.entries(array))

    np.testing.assert_array_equal(again(jnp.asarray(NUMBERS)), NUMBERS)
    traced = jax.make_jaxpr(again)(NUMBERS).jaxpr
    assert traced.outvars == traced.invars


def test_neighbours_are_a_slice_and_others_stand_between() -> None:
    def mixed(array: Any, other: Any) -> Any:
        a = entries.entries(array)
        return entries.stacked((a[1], a[2], other, 4.0, a[4], a[3]))

    np.testing.assert_array_equal(mixed(jnp.asarray(NUMBERS), jnp.asarray(1.5)), [3.0, 5.0, 1.5, 4.0, 11.0, 7.0])
    many = jax.vmap(mixed)(jnp.stack([NUMBERS, -NUMBERS]), jnp.asarray([1.5, 2.5]))
    np.testing.assert_array_equal(many, [[3.0, 5.0, 1.5, 4.0, 11.0, 7.0], [-3.0, -5.0, 2.5, 4.0, -11.0, -7.0]])


def test_numbers_that_stand_together_are_parts_of_arrays() -> None:
    def again(array: Any, other: Any) -> Any:
        a = entries.entries(array)
        arrays, several = entries.parts((a[1], a[2], other, a[0], True))
        assert several == (True, False, True, False)
        numbers = entries.of_parts(arrays, several)
        assert entries.entry(numbers[1]).place == 1  # type: ignore[union-attr]
        return jnp.stack([jnp.asarray(v, float) for v in numbers])

    np.testing.assert_array_equal(again(jnp.asarray(NUMBERS), jnp.asarray(1.5)), [3.0, 5.0, 1.5, 2.0, 1.0])


def test_columns_from_one_array_are_read_together() -> None:
    def function(array: Any, other: Any) -> Any:
        a = entries.entries(array)
        found, _ = runtime.rows(
            lambda p, q, flag, r: ((jnp.where(flag, p, q), p - q + r), 0), ((a[0], a[3]), (a[1], a[4]), (True, False), (other, a[2]))
        )
        return entries.stacked(found)

    expected = [2.0, 2.0 - 3.0 + 1.5, 11.0, 7.0 - 11.0 + 5.0]
    np.testing.assert_array_equal(function(jnp.asarray(NUMBERS), jnp.asarray(1.5)), expected)
    assert operations(function, NUMBERS, 1.5).count("gather") == 1


def test_numbers_are_forgotten_after_a_run() -> None:
    with entries.remembered():
        numbers = entries.entries(jnp.asarray(NUMBERS))
        assert entries.entry(numbers[2]).place == 2  # type: ignore[union-attr]
        assert entries.entry(jnp.asarray(2.0)) is None
    assert entries.entry(numbers[2]) is None


def test_a_trace_in_a_run_leaves_nothing_behind() -> None:
    with jax.checking_leaks():
        np.testing.assert_array_equal(jax.jit(lambda a: entries.stacked(entries.entries(a)[1:3]))(NUMBERS), [3.0, 5.0])


def test_few_numbers_that_stand_often_are_stacked_once() -> None:
    def table(a: Any, b: Any, c: Any) -> Any:
        (columns,) = entries.columns([(a, b, 2.0), (b, -0.0, 0.0), (c, c, b), (2.0, a, b)])
        assert columns.numbers == (0, 1, 2, 3)
        return columns.rows

    def expected(a: float, b: float, c: float) -> list[list[float]]:
        return [[a, b, c, 2.0], [b, -0.0, c, a], [2.0, 0.0, b, b]]

    for function in (table, jax.jit(table)):
        found = np.asarray(function(*map(jnp.float64, (1.5, 3.0, 7.0))))
        np.testing.assert_array_equal(found, expected(1.5, 3.0, 7.0))
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected(1.5, 3.0, 7.0)))
    many = jax.jit(jax.vmap(table, in_axes=(0, None, 0)))(jnp.array([1.0, 2.0]), jnp.float64(3.0), jnp.array([4.0, 5.0]))
    np.testing.assert_array_equal(many, [expected(1.0, 3.0, 4.0), expected(2.0, 3.0, 5.0)])


@pytest.mark.parametrize(("platform", "gathers"), [("cpu", True), ("cuda", False)])
@pytest.mark.parametrize("batch", [(), (5,)], ids=["one", "batch"])
def test_accelerators_gather_no_numbers_of_tables(platform: str, gathers: bool, batch: tuple[int, ...]) -> None:
    def table(a: Any, b: Any) -> Any:
        return entries.columns([(a, b, a), (b, a, a), (True, a, b)])[0].rows

    function = jax.vmap(table) if batch else table
    operands = [jax.ShapeDtypeStruct(batch, np.dtype(bool))] * 2
    text = jax.jit(function).trace(*operands).lower(lowering_platforms=(platform,)).as_text()
    assert ("gather" in text) is gathers
