"""The JAX backend: exact values, agreement with NumPy, purity, and what it refuses."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from teg.backends.jax.kernel import compile_jax
from teg.backends.numpy.kernel import compile_numpy
from teg.errors import BackendError, MissingPackageError
from tests.backends.programs import (
    ADAPTIVE,
    CASES,
    ONE_VARIABLE,
    TIES,
    TWO_VARIABLES,
    WATCHED,
    Case,
    columns,
    expected,
)

LONG = (ADAPTIVE[4], WATCHED[3], WATCHED[4])
"""Integrals in integrals, adaptive both: two or three seconds of compilation each."""


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("case", [pytest.param(c, marks=[pytest.mark.slow] * (c in LONG)) for c in CASES], ids=lambda case: case.name)
def test_value_and_agreement_with_numpy(case: Case) -> None:
    found = compile_jax(case.program).outcome(columns(case), case.n)
    reference = compile_numpy(case.program)(columns(case), case.n)
    np.testing.assert_allclose(found.values, expected(case), rtol=case.tolerance, atol=case.tolerance)
    np.testing.assert_allclose(found.values, reference, rtol=1e-14, atol=1e-15)
    assert found.missed == case.missed


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("case", [*TWO_VARIABLES, ADAPTIVE[1], TIES[0], TIES[3]], ids=lambda case: case.name)
def test_function_is_pure(case: Case) -> None:
    """jit and vmap over `function` give the batch."""
    import jax

    kernel = compile_jax(case.program)
    axes = tuple(0 if column.ndim else None for column in columns(case))
    if any(axis == 0 for axis in axes):
        batched = jax.vmap(lambda *scalars: kernel.function(scalars), in_axes=axes, out_axes=1)
        found = jax.jit(batched)(*columns(case))
    else:
        found = jax.jit(lambda *scalars: kernel.function(scalars))(*columns(case))[:, None]
    np.testing.assert_allclose(found, expected(case), rtol=case.tolerance, atol=case.tolerance)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("n", [1, 3, 1000])
def test_a_batch_of_any_length(n: int) -> None:
    case = TWO_VARIABLES[1]
    many = [np.linspace(-0.5, 2.5, n)]
    kernel = compile_jax(case.program)
    kernel._step = 256
    np.testing.assert_allclose(kernel(many, n), compile_numpy(case.program)(many, n), rtol=1e-14, atol=1e-15)


@pytest.mark.usefixtures("x64")
def test_an_empty_batch() -> None:
    assert compile_jax(ONE_VARIABLE[0].program)([np.empty(0), np.empty(0)], 0).shape == (1, 0)


@pytest.mark.usefixtures("x64")
def test_pickles() -> None:
    case = TWO_VARIABLES[0]
    kernel = pickle.loads(pickle.dumps(compile_jax(case.program)))
    np.testing.assert_allclose(kernel(columns(case), case.n), expected(case), rtol=1e-14)


def test_32_bit_mode_is_refused(x64: None) -> None:
    import jax

    kernel = compile_jax(ONE_VARIABLE[0].program)
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(BackendError) as caught:
        compile_jax(ONE_VARIABLE[0].program)
    assert 'jax.config.update("jax_enable_x64", True)' in caught.value.hint
    with pytest.raises(BackendError):
        kernel([np.zeros(1), np.ones(1)], 1)


def test_a_missing_jax_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingPackageError) as caught:
        compile_jax(ONE_VARIABLE[0].program)
    assert caught.value.hint == 'pip install "teg-compiler[jax]"'


def test_importing_the_backend_does_not_import_jax() -> None:
    code = "import sys, teg.backends.jax.kernel; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.usefixtures("x64")
def test_a_body_stands_once_in_the_graph() -> None:
    """The first look at a piece and all intervals after it are one loop; so are the boxes of a search, its ends and its turning points."""
    import jax

    import teg

    x, y, t = teg.var("x"), teg.var("y"), teg.param("t")
    adaptive = teg.integral(teg.exp(teg.sin(t * x)) * teg.bracket(x < t), (x, 0, 1))
    nested = teg.integral(teg.exp(teg.sin(x * y)), (x, 0, t), (y, 0, 1))
    search = teg.integral(teg.bracket(teg.exp(x) * x * x < t), (x, -1, 1))
    for e, twice in ((adaptive, 0), (nested, 0), (search, 1)):  # Newton's method for roots is a loop of its own
        kernel = compile_jax(teg.compile(e, [t], backend="numpy").program(0))
        text = jax.jit(lambda p, kernel=kernel: kernel.function([p])).lower(0.5).as_text()
        assert text.count("stablehlo.exponential") == kernel.source.count("jnp.exp(") + twice
        assert text.count("stablehlo.sine") == kernel.source.count("jnp.sin(")


@pytest.mark.usefixtures("x64")
def test_many_pieces_are_visited_one_after_the_other() -> None:
    import teg
    from teg.backends.jax.runtime import MANY
    from teg.program import Integrate

    x, t = teg.var("x"), teg.param("t")
    steps = sum((teg.bracket(x < k * t) for k in range(2, MANY + 2)), start=teg.bracket(x < t))
    program = teg.compile(teg.integral(teg.exp(teg.sin(x * steps)), (x, 0, 1)), [t], backend="numpy").program(0)
    assert any(isinstance(s, Integrate) and len(s.breaks) >= MANY for s in program.body)
    at = [np.array([0.02, 0.1, 3.0, np.nan])]
    kernel = compile_jax(program)
    np.testing.assert_allclose(kernel(at, 4), compile_numpy(program)(at, 4), rtol=1e-13)


@pytest.mark.usefixtures("x64")
def test_pieces_at_their_end_are_looked_at_nowhere() -> None:
    """Of two pieces of which one takes more turns; loops inside end at once at NaN, and would search at other places."""
    import jax
    import jax.numpy as jnp

    from teg.backends.jax import adaptive, runtime

    seen: list[float] = []

    def body(x: Any, _: Any) -> Any:
        jax.debug.callback(lambda v: seen.append(float(v)), x)
        return (jnp.where(x < 0.5, jnp.sqrt(x), x),), 0

    (found,), _ = adaptive.integral(runtime.Pieces(1, 1), (1e-9, 1e-9, 10, 16, False), 0, (0.0, 1.0, 0.5), (), (None, body))
    jax.effects_barrier()
    assert float(found) == pytest.approx(2 / 3 * 0.5**1.5 + 0.375, rel=1e-8)
    second = [x for x in seen if x > 0.5]
    assert len(second) == 10
    assert max(second) < 1.0
    assert len([x for x in seen if x < 0.5]) > 10


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("level", [0, 3])
def test_quotients_are_rounded_once(level: int, as_users_jit: dict[str, bool]) -> None:
    """XLA multiplies by reciprocals and joins quotients: x/3.28, x/√y and (x/y)/w differ in the last bit for a third of all numbers."""
    x, y, w = np.random.default_rng(0).random((3, 4096))
    zero = np.float64(-0.0)
    import jax

    from teg.backends.jax.runtime import quotient

    def several(x: Any, y: Any, w: Any, zero: Any) -> list[Any]:
        one = quotient(x, 3.28, zero)
        return [one, one + y, quotient(x, jax.numpy.sqrt(y), zero), quotient(quotient(x, y, zero), w, zero)]

    options = {"xla_backend_optimization_level": level, "xla_llvm_disable_expensive_passes": level == 0, **as_users_jit}
    found = jax.jit(several, compiler_options=options)(x, y, w, zero)
    for one, exact in zip(found, [x / 3.28, x / 3.28 + y, x / np.sqrt(y), x / y / w], strict=True):
        np.testing.assert_array_equal(one, exact)
    assert np.isnan(quotient(np.float64(np.nan), 2.0, zero))
    assert quotient(np.float64(np.inf), 2.0, zero) == np.inf
