"""Arguments of functions of JAX: numbers by name and by position, trees of them, and what is refused."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import BackendError, MissingPackageError, ParameterError

jax = pytest.importorskip("jax")
pytest.importorskip("jax.extend")
jnp = jax.numpy

x = teg.var("x")
t, a = teg.params("t a")
STEP = teg.integral(teg.bracket(x < t) * (1 + a * x) ** 2, (x, 0, 1))
x64 = pytest.mark.usefixtures("x64")


def close(found: Any, wanted: Any, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(found, wanted, rtol=tolerance, atol=tolerance)


def test_float64_needs_the_flag() -> None:
    assert not jax.config.jax_enable_x64
    with pytest.raises(BackendError) as caught:
        teg.jax_function(STEP, dtype="float64")
    assert 'jax.config.update("jax_enable_x64", True)' in caught.value.hint


@pytest.mark.parametrize(
    "given",
    [
        {"t": 0.5},
        {"t": 0.5, "a": 1.0, "b": 2.0},
        {"t": 0.5, "a": 1j},
        {"t": 0.5, "a": "one"},
        {"t": np.ones(2), "a": np.ones(3)},
        [0.5, 1.0],
    ],
    ids=["missing", "unknown", "complex", "text", "shapes", "a list"],
)
def test_what_is_given_wrongly(given: Any) -> None:
    with pytest.raises(ParameterError):
        teg.jax_function(STEP)(given)


def test_a_key_of_random_numbers_is_no_number() -> None:
    with pytest.raises(ParameterError):
        teg.jax_function(STEP)(t=jax.random.key(0), a=1.0)


def test_given_twice_and_unknown_indices() -> None:
    with pytest.raises(ParameterError):
        teg.jax_function(STEP)({"t": 0.5, "a": 1.0}, a=1.0)
    with pytest.raises(ParameterError):
        teg.jax_function(STEP, indices={"t": 3})


def test_a_missing_jax_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(MissingPackageError) as caught:
        teg.jax_function(STEP)
    assert caught.value.hint == 'pip install "teg-compiler[jax]"'


# -- pytrees, positions --------------------------------------------------------------------------------------------------


@jax.tree_util.register_dataclass
@dataclass
class Pose:
    """A dataclass that JAX knows."""

    t: Any
    rest: tuple[Any, ...]


@x64
@pytest.mark.parametrize(
    "tree",
    [
        {"edge": {"t": 0.5}, "slope": {"a": 1.1}},
        ({"t": 0.5}, [{"a": 1.1}, None]),
        Pose(0.5, ({"a": 1.1},)),
        {"pose": Pose(0.5, ()), "a": 1.1},
    ],
    ids=["dicts", "tuples", "a dataclass", "mixed"],
)
def test_pytrees_in_and_out(tree: Any) -> None:
    f = teg.jax_function(STEP)
    exact = teg.compile(STEP, [t, a], backend="numpy")
    close(f(tree), exact(t=0.5, a=1.1))
    slopes = jax.jit(jax.grad(f))(tree)
    assert jax.tree.structure(slopes) == jax.tree.structure(tree)
    wanted = exact.grad(t=0.5, a=1.1)
    close(sorted(jax.tree.leaves(slopes)), sorted(wanted.values()))


@x64
def test_parameters_have_the_names_of_their_places() -> None:
    left, right = teg.params("edges_0_t edges_1_t")
    f = teg.jax_function(teg.integral(teg.bracket(x > left) * teg.bracket(x < right), (x, 0, 1)))
    slopes = jax.grad(f)({"edges": [{"t": 0.2}, {"t": 0.7}]})
    assert [edge["t"] for edge in slopes["edges"]] == [-1.0, 1.0]


@x64
def test_values_by_position() -> None:
    f = teg.jax_function(STEP, [a, t])
    assert f.parameters == ("a", "t")
    close(f(1.1, 0.5), f(t=0.5, a=1.1))
    close(f(1.1, t=0.5), f(t=0.5, a=1.1))
    close(jax.grad(f, argnums=1)(1.1, 0.5), 1.55**2)
    again, other = teg.params("second_made first_made")[::-1], teg.params("first_made second_made")
    g = teg.jax_function(teg.integral(teg.bracket(x < again[0]) * other[1], (x, 0, 1)))
    for call in (lambda: g(0.5, 1.0), lambda: f(1.0, 2.0, 3.0), lambda: f({"t": 0.5}, {"a": 1.0})):
        with pytest.raises(ParameterError):
            call()
    with pytest.raises(ParameterError) as caught:
        f({"one": {"t": 0.5}, "other": {"t": 0.6}, "a": 1.0})
    assert "other_t" in str(caught.value)


@x64
def test_an_evaluator_reads_arrays_of_jax_where_they_lie() -> None:
    """Nothing is copied that has the right type; a traced value is refused, and what takes it is named."""
    from teg.evaluator.arguments import as_floats

    many = jnp.linspace(0.0, 1.0, 100)
    assert as_floats("t", many).ctypes.data == many.unsafe_buffer_pointer()
    f = teg.compile(STEP, [t, a], backend="numpy")
    close(f(t=many, a=1.1), f(t=np.asarray(many), a=1.1))
    with pytest.raises(ParameterError) as caught:
        jax.jit(lambda s: f(t=s, a=1.1))(0.5)
    assert "jax_function" in caught.value.hint
