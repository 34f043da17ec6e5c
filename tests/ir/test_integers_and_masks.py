"""Integers that 64 bits do not hold, and arrays with masked entries, are refused wherever values are taken."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from teg import bracket, integral, params
from teg.errors import ArrayIndexError, ParameterError

pytestmark = pytest.mark.usefixtures("x64_for_jax")

(x,) = teg.vars("x")
t, n = params("t n")
V, F, G = teg.array("V", 1), teg.indices("F", 1), teg.indices("G", 1)
k = teg.index("k")
BACKENDS = ["numpy", "c", pytest.param("jax", marks=pytest.mark.slow)]
HUGE = 2**62
BEYOND = "64 bits|too large"
TOO_LARGE: dict[str, tuple[Callable[[], teg.Expr], dict[str, Any]]] = {
    "a product": (lambda: teg.sum(V[4 * F[k]], (k, 0, 2)), {"F": np.array([0, HUGE])}),
    "a product of entries": (lambda: teg.sum(V[F[k] * F[k]], (k, 0, 2)), {"F": np.array([1, 2**32])}),
    "a sum": (lambda: teg.sum(V[(F[k] + F[k] + F[k] + F[k]) % 3], (k, 0, 2)), {"F": np.array([0, HUGE])}),
    "a difference": (lambda: teg.sum(V[(0 - F[k] - F[k] - F[k]) % 3], (k, 0, 2)), {"F": np.array([1, HUGE])}),
    "a number": (lambda: teg.sum(V[k] * (F[k] * F[k]), (k, 0, 2)), {"F": np.array([1, 2**40])}),
    "the least one": (lambda: teg.sum(V[(G[k] // F[k]) % 3], (k, 0, 2)), {"F": np.array([1, -1]), "G": np.array([0, -(2**63)])}),
    "a range": (lambda: teg.sum(V[k % 3], (k, 4 * F[0], 4 * F[0] + 1)), {"F": np.array([HUGE, 0])}),
    "its length": (lambda: teg.sum(V[k % 3], (k, F[1], F[0])), {"F": np.array([HUGE * 2 - 1, -(2**63)])}),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", TOO_LARGE)
def test_an_integer_that_has_no_room_is_named(name: str, backend: str) -> None:
    build, at = TOO_LARGE[name]
    f = teg.compile(build() * t, backend=backend)
    values = {"V": np.array([1.0, 2.0, 3.0]), "t": 1.0, **at}
    for call in (f, f.grad):
        with pytest.raises(ArrayIndexError, match=BEYOND):
            call(values)


@pytest.mark.parametrize("backend", BACKENDS)
def test_large_integers_that_have_room_are_right(backend: str) -> None:
    """Intervals say that 4·F[k] may wrap; in every iteration the other factor is 0 where F is large."""
    e = teg.sum(V[(F[k] * G[k]) % 3], (k, 0, 3))
    f = teg.compile(e, backend=backend)
    at = {"V": np.array([1.0, 20.0, 300.0]), "F": np.array([HUGE, 5, -7]), "G": np.array([1, 2**20, 1])}
    assert f(at) == sum([1.0, 20.0, 300.0][(int(a) * int(b)) % 3] for a, b in zip(at["F"], at["G"], strict=True))


@pytest.mark.parametrize("value", [2.0**53 + 2, 1e30, -1e19])
def test_integer_parameters_are_held_exactly(value: float) -> None:
    f = teg.compile(teg.sum(V[k] * t, (k, 0, n)), backend="numpy")
    with pytest.raises(ArrayIndexError, match="exactly"):
        f(V=np.ones(3), t=1.0, n=value)


MASKED = np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])
SCALAR = integral(bracket(x < t), (x, 0, 1))
SUM = teg.sum(V[F[k]] * t, (k, 0, 2))


@pytest.mark.parametrize("value", [MASKED, np.ma.masked, [MASKED, MASKED], (0.5, np.ma.masked)], ids=["array", "number", "list", "entry"])
def test_masked_numbers_are_refused(value: object) -> None:
    f = teg.compile(SCALAR)
    for call in (f, f.grad, f.value_and_grad, f.hessian):
        with pytest.raises(ParameterError, match="masked"):
            call(t=value)


@pytest.mark.parametrize("name", ["V", "F", "t"])
def test_masked_arrays_are_refused(name: str) -> None:
    f = teg.compile(SUM)
    at = {"V": np.ones(3), "F": np.array([0, 2]), "t": 0.5}
    at[name] = np.ma.array(np.arange(3), mask=[0, 1, 0]) if name == "F" else MASKED
    for call in (f, f.grad):
        with pytest.raises(ParameterError, match="masked"):
            call(at)


def test_a_mask_that_hides_nothing_is_no_mask() -> None:
    f = teg.compile(SUM)
    assert f(V=np.ma.array([1.0, 2.0, 3.0], mask=[0, 0, 0]), F=np.ma.array([0, 2]), t=0.5) == 2.0


def test_masked_vectors_are_refused_for_scipy() -> None:
    fun = teg.scipy_function(teg.sum(V[k] * V[k], (k, 0, 3)), [V], shapes={"V": 3})
    for call in (fun.fun, fun.jac):
        with pytest.raises(ParameterError, match="masked"):
            call(MASKED)
    with pytest.raises(ParameterError, match="masked"):
        fun.pack({"V": MASKED})


def test_masked_arrays_are_refused_in_pytorch() -> None:
    pytest.importorskip("torch")
    f = teg.torch_function(SUM)
    with pytest.raises(ParameterError, match="masked"):
        f(V=MASKED, F=np.array([0, 2]), t=0.5)
    with pytest.raises(ArrayIndexError, match="too large"):
        f(V=np.ones(3), F=np.array([0, 2**63], dtype=np.uint64), t=0.5)


def test_masked_arrays_are_refused_in_jax() -> None:
    pytest.importorskip("jax")
    f = teg.jax_function(SUM)
    with pytest.raises(ParameterError, match="masked"):
        f(V=MASKED, F=np.array([0, 2]), t=0.5)


def test_integers_are_not_cut_to_32_bits_in_jax() -> None:
    jax = pytest.importorskip("jax")
    with jax.enable_x64(False) if hasattr(jax, "enable_x64") else jax.experimental.disable_x64():
        f = teg.jax_function(SUM)
        with pytest.raises(ArrayIndexError, match="too large"):
            f(V=np.ones(3), F=np.array([0, 2**32]), t=0.5)
        assert float(f(V=np.ones(3), F=np.array([0, 2]), t=np.int64(2**40))) == 2.0**41


@pytest.mark.parametrize("entry", [3, -1, 2**30, 2**31 - 1])
def test_traced_indices_never_wrap_in_jax(entry: int) -> None:
    """Under jit entries are not known when a program is checked: what is read beyond an array is no number."""
    jax = pytest.importorskip("jax")
    f = teg.jax_function(teg.sum(V[4 * F[k]] * t, (k, 0, 2)))
    g = teg.jax_function(teg.sum(V[F[F[k]] % 3] * t, (k, 0, 2)))
    h = teg.jax_function(teg.sum((F[k] * F[k]) * (F[k] * F[k]) * V[k] * t, (k, 0, 2)))
    traced = [jax.jit(lambda i, f=f: f(V=np.ones(9), F=i, t=0.5)) for f in (f, g, h)]
    assert [float(run(np.array([0, 1]))) for run in traced] == [1.0, 1.0, 0.5]
    beyond = np.array([0, entry])
    assert np.isnan(float(traced[0](beyond)))
    assert np.isnan(float(traced[1](beyond)))
    fourth = float(entry) ** 4
    assert np.isnan(float(traced[2](beyond))) if fourth >= 2.0**63 else float(traced[2](beyond)) == 0.5 * fourth
