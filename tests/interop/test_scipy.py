"""`teg.scipy_function`: a program as functions of one vector."""

from __future__ import annotations

import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import OptionError, ParameterError
from teg.interop.scipy import VectorFunction

x = teg.var("x")
t, a, b = teg.params("t a b")
AREA = teg.integral(teg.bracket(x < t) * (1 + a * x) * b, (x, 0, 1))  # (t + ½at²)·b
LOSS = (AREA - 0.7) ** 2 + (a - 1) ** 2
BEST = np.sqrt(1 + 2 * 0.7) - 1  # t + ½t² = 0.7


def counted(f: VectorFunction, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the evaluator is asked for from now on."""
    asked: list[str] = []

    class Counting:
        def __call__(self, values: Any) -> Any:
            asked.append("value")
            return evaluator(values)

        def value_and_grad(self, values: Any) -> Any:
            asked.append("both")
            return evaluator.value_and_grad(values)

    evaluator = f.evaluator
    monkeypatch.setattr(f, "evaluator", Counting())
    return asked


def test_value_and_gradient() -> None:
    fun, jac = teg.scipy_function(AREA, [t, a], fixed={"b": 2.0})
    value, slope = fun([0.5, 1.0]), jac(np.array([0.5, 1.0]))
    assert type(value) is float
    assert value == pytest.approx(1.25)
    assert slope.dtype == np.float64
    assert slope.tolist() == pytest.approx([3.0, 0.25])
    fun, jac = teg.scipy_function(AREA, [a, t], fixed={b: 2})
    assert fun([1.0, 0.5]) == value
    assert jac([1.0, 0.5]).tolist() == slope[::-1].tolist()


@pytest.mark.parametrize("method", ["BFGS", "CG", "L-BFGS-B", "TNC", "SLSQP", "Newton-CG", "trust-krylov", "Nelder-Mead"])
def test_minimize(method: str) -> None:
    optimize = pytest.importorskip("scipy.optimize")
    f = teg.scipy_function(LOSS, [t, a], fixed={"b": 1.0})
    fun, jac = f
    options: dict[str, Any] = {} if method == "Nelder-Mead" else {"jac": jac}
    if method in ("Newton-CG", "trust-krylov"):
        options["hessp"] = f.hessp
    found = optimize.minimize(fun, [0.3, 0.5], method=method, tol=1e-9, **options)
    assert found.x == pytest.approx([BEST, 1.0], abs=1e-4)


def test_least_squares_and_roots() -> None:
    optimize = pytest.importorskip("scipy.optimize")
    fun, jac = teg.scipy_function(teg.tuple(AREA - 0.7, teg.tuple(a - 1, t * b)), [t, a], fixed={"b": 0.0 + 1})
    assert fun([0.5, 1.0]).tolist() == pytest.approx([0.625 - 0.7, 0.0, 0.5])
    assert jac([0.5, 1.0]).tolist() == [pytest.approx([1.5, 0.125]), [0.0, 1.0], [1.0, 0.0]]
    fun, jac = teg.scipy_function(teg.tuple(AREA - 0.7, a - 1), [t, a], fixed={"b": 1.0})
    assert optimize.least_squares(fun, [0.3, 0.5], jac=jac).x == pytest.approx([BEST, 1.0], abs=1e-7)
    assert optimize.root(fun, [0.3, 0.5], jac=jac).x == pytest.approx([BEST, 1.0], abs=1e-7)


def test_the_hessian_times_a_vector() -> None:
    f = teg.scipy_function(AREA, [t, a], fixed={"b": 2.0})
    assert f.hessp([0.5, 1.0], [1.0, 0.0]).tolist() == pytest.approx([2.0, 1.0])
    assert f.hessp([0.5, 1.0], [0.0, 1.0]).tolist() == pytest.approx([1.0, 0.0])
    with pytest.raises(OptionError):
        teg.scipy_function(teg.tuple(t, a), [t, a]).hessp([0.5, 1.0], [1.0, 0.0])


def test_work_is_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without gradients values only; with them both in one call, and nothing twice at one point."""
    f = teg.scipy_function(LOSS, [t, a], fixed={"b": 1.0})
    asked = counted(f, monkeypatch)
    fun, jac = f
    fun([0.1, 0.2])
    fun([0.1, 0.2])
    assert asked == ["value"]
    jac([0.1, 0.2])
    fun([0.1, 0.2])
    assert asked == ["value", "both"]
    fun([0.3, 0.2])
    jac([0.3, 0.2])
    jac(np.array([0.3, 0.2]))
    assert asked == ["value", "both", "both"]


def test_results_belong_to_the_caller() -> None:
    _, jac = teg.scipy_function(LOSS, [t, a], fixed={"b": 1.0})
    point = np.array([0.3, 0.2])
    first = jac(point)
    kept = first.copy()
    first[:] = 7.0
    assert jac(point).tolist() == kept.tolist()
    point += 0.1  # as optimisers do, in place
    assert jac(point).tolist() != kept.tolist()


def test_from_threads_and_pickled() -> None:
    f = teg.scipy_function(LOSS, [t, a], fixed={"b": 1.0})
    points = np.random.default_rng(0).uniform(0.1, 0.9, (200, 2))
    alone = [f.fun(p) for p in points]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(f.fun, points)) == alone
        slopes = list(pool.map(f.jac, points))
    copy = pickle.loads(pickle.dumps(f))
    assert [copy.fun(p) for p in points] == alone
    assert [copy.jac(p).tolist() for p in points] == [s.tolist() for s in slopes]


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_arrays(backend: str) -> None:
    """The entries of an array, row by row, after the parameters before it."""
    v, k = teg.array("V", 2), teg.index("k")
    weights = teg.array("w", 1)
    e = teg.sum(weights[k] * ((v[k, 0] - k) ** 2 + (v[k, 1] - t) ** 2), (k, 0, teg.length(v, 0))) + (t - 3) ** 2
    f = teg.scipy_function(e, [t, v], fixed={"w": np.array([1.0, 2.0])}, shapes={v: (2, 2)}, backend=backend)
    at = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert f.size == 5
    assert f.fun(at) == (4 + 4) + 2 * (9 + 16) + 4
    assert f.jac(at).tolist() == [-2 * 2 - 4 * 4 - 4, 4.0, 4.0, 12.0, 16.0]
    assert f.hessp(at, [0, 0, 1, 0, 0]).tolist() == [-2.0, 0.0, 2.0, 0.0, 0.0]
    values = f.unpack(at)
    assert values["t"] == 1.0
    assert values["V"].tolist() == [[2.0, 3.0], [4.0, 5.0]]
    assert f.pack(values).tolist() == f.pack({t: 1.0, v: [[2, 3], [4, 5]]}).tolist() == at.tolist()


@pytest.mark.parametrize(
    ("vector", "word"),
    [
        ([0.5], "shape (2,)"), ([0.5, 1.0, 2.0], "shape (2,)"),
        (np.array([0.5, 1j]), "real numbers"), ([[0.5, 1.0]], "shape (2,)"), (0.5, "shape (2,)"), ([0.5, np.nan], "entry 1"),
        ([np.inf, 1.0], "entry 0"), (["a", 1.0], "real numbers"), (None, "real numbers"), ([0.5, 1j], "real numbers"),
    ],
)  # fmt: skip
def test_vectors_that_do_not_fit(vector: Any, word: str) -> None:
    fun, jac = teg.scipy_function(LOSS, [t, a], fixed={"b": 1.0})
    for function in (fun, jac):
        with pytest.raises(ParameterError) as error:
            function(vector)
        assert word in str(error.value)


@pytest.mark.parametrize(
    "options",
    [
        {}, {"fixed": {"b": 1.0, "c": 2.0}}, {"fixed": {"b": 1.0, "t": 2.0}}, {"fixed": {"b": 1.0}, "shapes": {"t": (2,)}},
        {"fixed": {"b": 1.0}, "shapes": {"V": (2,)}}, {"fixed": {"b": 1.0}, "dtype": "float32"},
        {"fixed": {"b": 1.0}, "backend": "fortran"},
    ],
)  # fmt: skip
def test_descriptions_that_do_not_fit(options: dict[str, Any]) -> None:
    with pytest.raises(teg.TegError):
        teg.scipy_function(LOSS, [t, a], **options)
    with pytest.raises(ParameterError):
        teg.scipy_function(LOSS, [], fixed={"b": 1.0})


@pytest.mark.parametrize("shapes", [None, {"V": (2,)}, {"V": (2, -1)}, {"V": 4}, {"V": (2.0, 2)}])
def test_shapes_that_do_not_fit(shapes: Any) -> None:
    v = teg.array("V", 2)
    with pytest.raises(ParameterError):
        teg.scipy_function(v[0, 1] ** 2, v, shapes=shapes)


def test_values_that_are_not_finite_are_given() -> None:
    fun, jac = teg.scipy_function(1 / t, t)
    assert fun([0.0]) == np.inf
    assert fun(2.0) == 0.5
    assert jac([2.0]).tolist() == [-0.25]


def test_it_needs_no_scipy() -> None:
    script = (
        "import sys, teg; t = teg.param('t'); f, g = teg.scipy_function((t - 1)**2, [t]);"
        "f([2.0]); g([2.0]); print([m for m in ('scipy', 'jax', 'sympy') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip() == "[]"
