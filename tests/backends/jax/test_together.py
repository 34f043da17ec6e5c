"""`together`: the bits of the plain function, in few kernels, in batches of any shape."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

jax = pytest.importorskip("jax")
jnp = jax.numpy

from teg.backends.jax import together as of_together  # noqa: E402
from teg.backends.jax.together import MOST, together, together_p  # noqa: E402

pytestmark = pytest.mark.usefixtures("x64")
LENGTH, RESULTS = 40, 9
SPECIAL = (0.0, -0.0, math.nan, math.inf, -math.inf, 1e-300, 1.5)


def chained(a: Any, b: Any) -> list[Any]:
    """A long chain that all results need. No product is added to, so that there is one rounding for each operation."""
    for _ in range(LENGTH):
        a = jnp.where(a > 2.0, 0.5 * a, jnp.maximum(a + b, -a))
    return [a * (k + 0.5) for k in range(RESULTS)]


def costly(a: Any, b: Any) -> list[Any]:
    """Quotients and roots, of each other too; truth values, an argument, and a number."""
    first, second = 1.0 / a, jnp.sqrt(jnp.abs(b))
    third = second / jnp.abs(first)
    return [first * b, a > b, third, jnp.exp(jnp.minimum(third, 3.0)), a, jnp.float64(2.0), third > 1.0, first * b]


def many(a: Any, b: Any) -> list[Any]:
    """More results than one kernel has."""
    return [part for k in range(2 * MOST) for part in (jnp.abs(a) + (k + b), a < k)]


FUNCTIONS = {"chained": chained, "costly": costly, "many": many}


def with_kernels(a: Any, b: Any, name: str) -> list[Any]:
    return together(FUNCTIONS[name], a, b)


def arguments(*shape: int) -> list[Any]:
    random = np.random.default_rng(1)
    return [random.uniform(-2.0, 2.0, shape) for _ in range(2)]


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 5)])
def test_bits_are_those_of_the_function(name: str, shape: tuple[int, ...]) -> None:
    run, plain = (lambda a, b: with_kernels(a, b, name)), FUNCTIONS[name]
    for _ in shape:
        run, plain = jax.vmap(run), jax.vmap(plain)
    for found, expected in zip(jax.jit(run)(*arguments(*shape)), jax.jit(plain)(*arguments(*shape)), strict=True):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("axes", [(0, None), (None, 0), (1, 0)])
def test_an_axis_that_an_argument_does_not_have(axes: Any) -> None:
    shapes = {None: (), 0: (6,), 1: (6, 6)}
    a, b = (arguments(*shapes[k])[i] for i, k in enumerate(axes))
    inner = jax.vmap(lambda u, v: with_kernels(u, v, "costly"), in_axes=(0 if axes[0] == 1 else None, None)) if axes[0] == 1 else None
    run = jax.vmap(inner or (lambda u, v: with_kernels(u, v, "costly")), in_axes=axes)
    u, v = np.broadcast_arrays(a.T, b[:, None]) if axes[0] == 1 else np.broadcast_arrays(a, b)
    for found, expected in zip(jax.jit(run)(a, b), costly(u, v), strict=True):
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))


def test_zeros_have_their_signs_and_nan_stays() -> None:
    a = np.array(SPECIAL)
    found = jax.jit(jax.vmap(lambda u: together(lambda v: [jnp.where(v == 2.0, 1.0, v), -v, 1.0 / v], u)))(a)
    with np.errstate(divide="ignore"):
        for values, expected in zip(found, (a, -a, 1.0 / a), strict=True):
            np.testing.assert_array_equal(values, expected)
            numbers = ~np.isnan(expected)
            np.testing.assert_array_equal(np.signbit(values)[numbers], np.signbit(expected)[numbers])


def test_no_operation_is_repeated(as_users_jit: dict[str, bool]) -> None:
    a, b = arguments(64)
    found = jax.jit(jax.vmap(lambda u, v: with_kernels(u, v, "chained"))).lower(a, b).compile(as_users_jit).as_text()
    plain = jax.jit(jax.vmap(chained)).lower(a, b).compile(as_users_jit).as_text()
    assert len(re.findall(r" maximum\(", found)) == LENGTH
    assert len(re.findall(r" maximum\(", plain)) == LENGTH * RESULTS
    assert len(re.findall(r"kind=kLoop", found)) == 1


def test_quotients_are_results_of_one_kernel_in_front(as_users_jit: dict[str, bool]) -> None:
    def function(a: Any, b: Any) -> list[Any]:
        inverse = [1.0 / (a + k) for k in range(5)]
        return [b * v + w for v in inverse for w in inverse[:3]]

    found = jax.jit(jax.vmap(lambda u, v: together(function, u, v))).lower(*arguments(64)).compile(as_users_jit).as_text()
    assert len(re.findall(r" divide\(", found)) == 5
    assert len(re.findall(r"kind=kLoop", found)) == 2


def test_other_platforms_get_the_function_as_it_is() -> None:
    export = pytest.importorskip("jax.export")
    run = jax.jit(jax.vmap(lambda u, v: with_kernels(u, v, "costly")))
    exported = export.export(run, platforms=["cuda"])(*arguments(7))
    assert "stablehlo.reduce" not in str(exported.mlir_module())


@pytest.mark.parametrize("shape", [(), (8,), (9,), (2, 4), (3, 3)])
def test_kernels_with_several_results_have_an_odd_length(shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """As they are on other platforms; an axis that an argument does not have stays one."""
    monkeypatch.setattr(of_together, "EVEN", 4)
    opened = jax.make_jaxpr(lambda a, b: costly(a, b))(1.0, 1.0)
    a, _ = arguments(*shape)
    b = arguments(*shape[:-1], *(1 for _ in shape[-1:]))[1]
    run = jax.jit(lambda a, b: of_together._in_one_kernel(a, b, function=opened))
    for found, expected in zip(run(a, b), jax.jit(costly)(a, b + 0 * a), strict=True):
        np.testing.assert_allclose(found, jnp.broadcast_to(expected, shape), rtol=1e-15)
        assert found.shape == shape
    text = run.lower(a, b).as_text()
    sizes = {int(n) for n in re.findall(r"divide [^\n]*tensor<(\d+)xf64>", text)}
    assert sizes == ({9} if shape else set())


def test_derivatives_are_those_of_the_function() -> None:
    run = jax.vmap(lambda u: jax.jvp(lambda x: together(lambda a: [a * a, 1.0 / a], x), (u,), (1.0,))[1])
    a = np.array([0.5, -2.0])
    np.testing.assert_array_equal(run(a), [2.0 * a, -1.0 / a**2])


def test_a_map_is_one_primitive() -> None:
    traced = jax.make_jaxpr(jax.vmap(jax.vmap(lambda u, v: with_kernels(u, v, "costly"))))(*arguments(2, 3))
    assert sum(e.primitive is together_p for e in traced.eqns) == 1


def test_a_function_without_arguments() -> None:
    found = jax.jit(lambda: together(lambda: [jnp.sqrt(jnp.float64(2.0)), jnp.bool_(True)]))()
    assert float(found[0]) == math.sqrt(2.0)
    assert bool(found[1])
