"""Programs with arrays and sums as operations of XLA, against the C backend."""

from __future__ import annotations

import pickle
import shutil
from functools import partial
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import ArrayIndexError, ParameterError

jax = pytest.importorskip("jax")
jnp = jax.numpy

EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"
x, t, n = teg.var("x"), teg.param("t"), teg.param("n")
k, j = teg.index("k"), teg.index("j")
V, C = teg.array("V", 2), teg.array("C", 1)
F, S = teg.indices("F", 2), teg.indices("S", 1)
GATHERED = (
    teg.sum(C[k] * teg.integral(teg.bracket(x * V[F[k, 0], 0] < V[F[k, 1], 1] + t * x) * (x + t), (x, 0, 1)), (k, 0, teg.length(F, 0))) ** 2
)
PART = teg.sum(V[j, 1] * teg.integral(teg.bracket(x * V[j, 0] < C[k] * t), (x, 0, 1)), (j, S[k], S[k + 1]))
RAGGED = teg.sum(PART * PART * C[k], (k, 0, teg.length(C, 0)))
rng = np.random.default_rng(0)
OF_GATHERED = {
    "t": np.float64(0.7),
    "V": rng.uniform(0.2, 1.5, (6, 2)),
    "C": rng.normal(size=9),
    "F": rng.integers(0, 6, (9, 2)),
}
OF_RAGGED = {"t": np.float64(0.6), "V": rng.uniform(0.5, 1.5, (11, 2)), "C": rng.uniform(0.2, 1, 5), "S": np.array([0, 3, 3, 4, 9, 11])}
BOTH = [pytest.param(GATHERED, OF_GATHERED, "F", id="gathered"), pytest.param(RAGGED, OF_RAGGED, "S", id="ragged")]
x64 = pytest.mark.usefixtures("x64")
xla_function = partial(teg.jax_function, kernel="xla")


def close(found: Any, wanted: Any, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(found, wanted, rtol=tolerance, atol=tolerance)


def real(values: dict[str, Any]) -> dict[str, Any]:
    return {name: jnp.asarray(v) for name, v in values.items() if name not in "FSn"}


def compare(e: Any, values: dict[str, Any], index: str, tolerance: float = 1e-12) -> None:
    """Value and gradient, and the product of the Hessian and a direction forward and in reverse."""
    f, exact = xla_function(e, indices={index: values[index]}), teg.compile(e, backend=EXACT)
    at = real(values)
    along = {name: jnp.asarray(np.cos(np.arange(v.size)).reshape(v.shape)) for name, v in at.items()}

    def inner(p: Any) -> Any:
        return sum(jnp.sum(slope * along[name]) for name, slope in jax.grad(f)(p).items())

    every = jax.jit(lambda p: (jax.value_and_grad(f)(p), jax.jvp(jax.grad(f), (p,), (along,))[1], jax.grad(inner)(p)))
    (value, slopes), forward, reverse = every(at)
    close(value, exact(values), tolerance)
    wanted, product = exact.grad(values), exact.hvp(values, {name: np.asarray(v) for name, v in along.items()})
    for name in at:
        assert slopes[name].shape == at[name].shape
        close(slopes[name], wanted[name], tolerance)
        close(forward[name], product[name], tolerance)
        close(reverse[name], product[name], tolerance)


@x64
@pytest.mark.slow
@pytest.mark.parametrize(("e", "values", "index"), BOTH)
def test_against_c(e: Any, values: dict[str, Any], index: str) -> None:
    compare(e, values, index)


@pytest.mark.slow
def test_single_precision_without_the_flag() -> None:
    assert not jax.config.jax_enable_x64
    compare(RAGGED, {name: np.float32(v) if name != "S" else v for name, v in OF_RAGGED.items()}, "S", 2e-6)


@pytest.mark.gpu
@pytest.mark.parametrize(("e", "values", "index"), BOTH)
def test_on_a_gpu(e: Any, values: dict[str, Any], index: str, x64: None) -> None:
    try:
        device = jax.devices("gpu")[0]
    except RuntimeError:
        pytest.skip("no CUDA device")
    with jax.default_device(device):
        compare(e, values, index)


EVEN = teg.sum(PART * C[k], (k, 0, teg.length(C, 0)))
GRID = teg.sum(V[j, 1] * teg.integral(teg.bracket(x * V[j, 0] < C[k] * t), (x, 0, 1)), (j, 0, teg.length(V, 0)))
ROWS = teg.sum(GRID * GRID * C[k], (k, 0, teg.length(C, 0)))
"""Sums whose inner ones have the same range for all terms of the outer one."""


@x64
@pytest.mark.parametrize("block", [3, 25, 2**22])
@pytest.mark.parametrize("e", [pytest.param(e, id=name) for name, e in (("ragged", RAGGED), ("added", EVEN), ("rows", ROWS))])
def test_blocks(e: Any, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Iterations in blocks, whose ends stand inside of inner loops or between them, add up to the same."""
    monkeypatch.setattr("teg.backends.jax.derivative.BLOCK", block)
    monkeypatch.setattr("teg.backends.jax.scatters.FEWEST", 5)
    indices = {} if e is ROWS else {"S": OF_RAGGED["S"]}
    at = {name: v for name, v in OF_RAGGED.items() if e is not ROWS or name != "S"}
    value, slopes = jax.jit(jax.value_and_grad(xla_function(e, indices=indices)))(real(at))
    exact, wanted = teg.compile(e, backend=EXACT).value_and_grad(at)
    close(value, exact)
    for name, slope in slopes.items():
        close(slope, wanted[name])


@x64
def test_batches() -> None:
    exact = teg.compile(GATHERED, backend=EXACT)
    f = xla_function(GATHERED, indices={"F": OF_GATHERED["F"]})
    many = {**OF_GATHERED, "V": rng.uniform(0.2, 1.5, (3, 6, 2)), "t": np.array([0.3, 0.5, 0.7])}
    value, wanted = exact.value_and_grad(many)
    at = real(many)

    @jax.jit
    def both(at: Any) -> Any:
        return jax.value_and_grad(lambda p: f(p).sum())(at), jax.vmap(jax.value_and_grad(f), ({"t": 0, "V": 0, "C": None},))(at)

    (total, slopes), (values, rows) = both(at)
    close(total, value.sum())
    close(values, value)
    for name, axis in (("t", None), ("V", None), ("C", 0)):
        close(slopes[name], wanted[name] if axis is None else wanted[name].sum(axis=axis))
        close(rows[name], wanted[name])


@x64
def test_index_arrays_may_be_traced_where_they_count_nothing() -> None:
    f, exact = xla_function(GATHERED), teg.compile(GATHERED, backend=EXACT)
    call = jax.jit(f)
    close(call(OF_GATHERED), exact(OF_GATHERED))
    other = {**OF_GATHERED, "F": (OF_GATHERED["F"] + 1) % 6}
    close(call(other), exact(other))
    for wrong in (6, -1):
        outside = {**OF_GATHERED, "F": np.where(np.arange(18).reshape(9, 2) == 3, wrong, OF_GATHERED["F"])}
        assert np.isnan(call(outside))
        with pytest.raises(ArrayIndexError, match="out of range"):
            f(outside)
    with pytest.raises(ArrayIndexError) as caught:
        jax.jit(xla_function(RAGGED))(OF_RAGGED)
    assert "indices={'S': …}" in caught.value.hint


@x64
def test_integer_parameters_and_index_arrays_of_two_calls() -> None:
    """Programs for other integers, and for other numbers of terms, are other programs."""
    e = teg.sum(C[k] * t**2, (k, 0, n))
    f = xla_function(e)
    at = {"t": 2.0, "C": jnp.arange(1.0, 5.0)}
    for count, wanted in ((3, 24.0), (4, 40.0), (0, 0.0), (3, 24.0)):
        close(f({**at, "n": count}), wanted)
        close(jax.grad(lambda p, count=count: f({**p, "n": count}))(at)["t"], wanted)
    assert sorted(f.parameters) == ["C", "n", "t"]
    for wrong in (2.5, np.ones(2), 5, -1):
        with pytest.raises(ArrayIndexError):
            f({**at, "n": wrong})
    with pytest.raises(ArrayIndexError) as caught:
        jax.jit(f)({**at, "n": 3})
    assert "traced" in str(caught.value)
    with pytest.raises(ParameterError):
        xla_function(e, [n])
    copy = pickle.loads(pickle.dumps(xla_function(e, indices={n: 2})))
    close(jax.jit(copy)(at), 12.0)
    close(xla_function(e, indices={"n": 4})(t=jnp.array([1.0, 2.0]), C=at["C"]), [10.0, 40.0])


@x64
def test_a_sum_inside_of_an_integral() -> None:
    """It is written out, for the lengths of each call."""
    e = teg.integral(teg.bracket(teg.sum(C[k] * x, (k, 0, teg.length(C, 0))) < t), (x, 0, 1))
    f = xla_function(e)
    for size in (2, 3):
        at = {"t": jnp.float64(0.5), "C": jnp.full(size, 0.7)}
        total = 0.7 * size
        value, slopes = jax.value_and_grad(f)(at)
        close(value, 0.5 / total)
        close(slopes["t"], 1 / total)
        close(slopes["C"], np.full(size, -0.5 / total**2))


@x64
def test_small_sums_and_wrong_shapes() -> None:
    f = xla_function(teg.sum(C[k], (k, 0, teg.length(C, 0))))
    close(f(C=jnp.ones(7)), 7.0)
    close(jax.grad(lambda c: f(C=c))(jnp.ones(7)), np.ones(7))
    assert f(C=jnp.ones((0,))) == 0.0
    with pytest.raises(ParameterError):
        f(C=1.0)
    with pytest.raises(ArrayIndexError):
        xla_function(GATHERED)({**OF_GATHERED, "F": np.ones((9, 2))})
