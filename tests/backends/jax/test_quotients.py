"""Quotients and square roots that are joined: which, that no bit changes, and that there are fewer kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun  # noqa: E402

from teg.backends.jax import apart, quotients  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")
NUMBERS = tuple(np.random.default_rng(1).uniform(0.5, 2.0, 6))


def joined(function: Any, *operands: Any) -> Any:
    """A traced function, whose results are needed twice, with what is joined in it."""
    traced = jax.make_jaxpr(lambda *v: [w for found in function(*v) for w in (found, 2.0 * found)])(*operands)
    return ClosedJaxpr(quotients.joined(traced.jaxpr, apart._is_copied), traced.consts)


def operations(closed: Any, name: str) -> int:
    return sum(e.primitive.name == name for e in closed.jaxpr.eqns)


def independent(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any) -> list[Any]:
    """Three quotients, one of them of a literal, and two square roots; then two quotients that need them."""
    p, q, r = a / b, 1.0 / c, (d + e) / f
    s, t = jnp.sqrt(a), jnp.sqrt(b + c)
    return [p * q, r - s, t, (p + s) / q, t / r]


def test_what_is_independent_is_one_operation_with_the_same_bits() -> None:
    found = joined(independent, *NUMBERS)
    assert operations(found, "div") == 2
    assert operations(found, "sqrt") == 1
    assert jaxpr_as_fun(found)(*NUMBERS)[::2] == independent(*map(jnp.asarray, NUMBERS))


def test_what_needs_another_one_is_not_joined_with_it() -> None:
    def chain(a: Any, b: Any) -> list[Any]:
        for _ in range(5):
            a = b / (1.0 + a)
        return [a]

    found = joined(chain, *NUMBERS[:2])
    assert operations(found, "div") == 5
    assert operations(found, "concatenate") == 0


def test_what_one_value_alone_needs_is_left() -> None:
    """XLA computes it where it is needed; a select of it that two values need is a kernel of its own."""

    def terms(a: Any, b: Any) -> list[Any]:
        return [jnp.sort(jnp.stack([b * (a / (b + k)) for k in range(4)]))]

    def selected(a: Any, b: Any) -> list[Any]:
        return [jnp.where(a > k, a / (b + k), 0.0) for k in range(4)]

    assert operations(joined(terms, *NUMBERS[:2]), "div") == 4
    assert operations(joined(selected, *NUMBERS[:2]), "div") == 1


def test_many_are_joined_eight_by_eight() -> None:
    found = joined(lambda a, b: [(a + k) / b for k in range(19)], *NUMBERS[:2])
    assert operations(found, "div") == 3


@pytest.mark.parametrize(("shape", "number"), [((4,), 1), ((2, 8), 1), ((quotients.SMALL + 1,), 3)])
def test_arrays_are_joined_if_they_are_small(shape: tuple[int, ...], number: int) -> None:
    values = np.random.default_rng(2).uniform(0.5, 2.0, (2, *shape))
    found = joined(lambda a, b: [a / b, b / a, (a + b) / b], *values)
    assert operations(found, "div") == number
    expected = values[0] / values[1], values[1] / values[0], sum(values) / values[1]
    np.testing.assert_array_equal(jaxpr_as_fun(found)(*values)[::2], expected)


def test_in_single_precision_and_of_several_types_nothing_is_joined() -> None:
    a, b = np.float32(1.5), np.float32(2.5)
    assert operations(joined(lambda a, b: [a / b, b / a], a, b), "div") == 2


def test_the_boundary_of_a_disk_in_a_box_divides_less_often(monkeypatch: pytest.MonkeyPatch, as_users_jit: dict[str, bool]) -> None:
    """Its crossings with the sides are roots of quadratics."""
    import teg

    x, y = teg.vars("x y")
    r, c = teg.params("r c")
    e = teg.integral(teg.bracket((x - c) ** 2 + y * y < r * r), (x, -1, 1), (y, -1, 1))

    def compiled() -> tuple[int, int, list[float]]:
        run = jax.jit(jax.grad(teg.jax_function(e, kernel="xla"))).lower({"r": 0.8, "c": 0.4}).compile(as_users_jit)
        text = str(run.as_text())
        return text.count(" divide("), text.count(" fusion("), jax.tree.leaves(run({"r": 0.8, "c": 0.4}))

    quotients, kernels, found = compiled()
    monkeypatch.setattr(apart, "joined", lambda jaxpr, _: jaxpr)
    others, most, expected = compiled()
    assert quotients < others
    assert kernels <= most
    np.testing.assert_allclose(found, expected, rtol=1e-15)
