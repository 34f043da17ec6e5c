"""A result that is no number, though everything that was given is, is told in the call; one that was given is not."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import AccuracyError
from teg.evaluator.accuracy import AccuracyWarning, report_missed
from teg.evaluator.arguments import Call

x = teg.var("x")
t, a = teg.params("t a")
BACKENDS = ("numpy", "c")

PATHS: dict[str, Callable[[Any, Any], Any]] = {
    "value": lambda f, at: f(at),
    "grad": lambda f, at: f.grad(at),
    "value_and_grad": lambda f, at: f.value_and_grad(at),
    "value_and_error": lambda f, at: f.value_and_error(at),
    "grad_and_error": lambda f, at: f.grad_and_error(at),
    "hessian": lambda f, at: f.hessian(at),
    "jvp": lambda f, at: f.jvp(at, {"t": 1.0}),
    "vjp": lambda f, at: f.vjp(at),
    "hvp": lambda f, at: f.hvp(at, {"t": 1.0}),
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("path", PATHS)
def test_every_call_tells(path: str, backend: str) -> None:
    e = teg.sqrt(t) * a
    f, call = teg.compile(e, [t, a], backend=backend), PATHS[path]
    for at in ({"t": -1.0, "a": 2.0}, {"t": np.array([1.0, -1.0]), "a": 2.0}):
        with pytest.warns(AccuracyWarning, match=r"is not a number at .*t = -1"):
            call(f, at)
    strict = teg.compile(e, [t, a], backend=backend, inaccurate="raise")
    with pytest.raises(AccuracyError, match="is not a number"):
        call(strict, {"t": -1.0, "a": 2.0})
    for quiet in ({"t": np.nan, "a": 2.0}, {"t": np.array([1.0, np.nan]), "a": 2.0}, {"t": 1.0, "a": np.nan}):
        call(f, quiet)  # a warning would be an error
    silent = teg.compile(e, [t, a], backend=backend, inaccurate="ignore")
    call(silent, {"t": -1.0, "a": 2.0})


def test_what_is_no_number_is_named() -> None:
    f = teg.compile(teg.sqrt(t) * a, [t, a])
    with pytest.warns(AccuracyWarning, match="the Hessian times the direction is not a number"):
        f.hvp({"t": -1.0, "a": 2.0}, {"t": 1.0})
    with pytest.warns(AccuracyWarning, match="the gradient is not a number"):
        f.grad({"t": -1.0, "a": 2.0})


@pytest.mark.parametrize("backend", BACKENDS)
def test_programs_with_arrays_tell(backend: str) -> None:
    k, w = teg.index("k"), teg.array("w")
    f = teg.compile(teg.sum(teg.sqrt(w[k]) * t, (k, 0, 3)), [t, w], backend=backend)
    for path in ("value", "grad", "value_and_grad", "value_and_error", "hessian"):
        with pytest.warns(AccuracyWarning, match="is not a number at t = 2"):
            PATHS[path](f, {"t": 2.0, "w": [1.0, -1.0, 2.0]})
        PATHS[path](f, {"t": 2.0, "w": [1.0, np.nan, 2.0]})
        with pytest.warns(AccuracyWarning, match="is not a number"):
            PATHS[path](f, {"t": 2.0, "w": [[1.0, 1.0, 2.0], [1.0, -1.0, 2.0]]})


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_branch_that_is_not_taken_does_not_count(backend: str) -> None:
    f = teg.compile(teg.where(t > 0, teg.sqrt(t), a), [t, a], backend=backend)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert f(t=-1.0, a=2.0) == 2.0
        assert f.grad(t=-1.0, a=2.0) == {"t": 0.0, "a": 1.0}


def test_the_cause_is_no_number_of_roots() -> None:
    """A quartic has four roots at most: nobody is told to make room for more."""
    f = teg.compile(teg.integral(teg.bracket(x**4 + a * x < t) * teg.log(t), (x, -1, 1)), [t])
    with pytest.warns(AccuracyWarning) as told:
        f(t=-0.1, a=1.0)
    assert "roots" not in str(told[0].message).splitlines()[0]


def test_torch_tells() -> None:
    torch = pytest.importorskip("torch")
    f = teg.torch_function(teg.log(t) * a)
    with pytest.warns(AccuracyWarning, match="the value is not a number at t = -1"):
        f(t=torch.tensor(-1.0, dtype=torch.float64), a=torch.tensor(2.0, dtype=torch.float64))


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_infinite_argument_gives_the_limit_or_says_so(backend: str) -> None:
    """The derivative by t at t = ∞ is 0; a disk of infinite radius has no number for its boundary, and the warning has the reason."""
    for surface in (x < t, x + x**5 < t, teg.sin(5 * x) < t):
        f = teg.compile(teg.integral(teg.bracket(surface), (x, 0, 1)), [t], backend=backend)
        assert f.value_and_grad(t=np.inf) == (1.0, {"t": 0.0})
        assert f.grad(t=-np.inf)["t"] == 0.0
    y = teg.var("y")
    disk = teg.compile(teg.integral(teg.bracket(x * x + y * y < t * t), (x, 0, 1), (y, 0, 1)), [t], backend=backend)
    with pytest.warns(AccuracyWarning, match=r"not a number at t = inf, where an argument is infinite"):
        disk.grad(t=np.inf)


def test_an_estimate_that_is_no_number_is_told() -> None:
    """A kernel reports a missed tolerance, and its estimate is not known: the result may be anything."""
    call = Call(["t"], [np.array([0.3, np.inf])], [], 2, (2,), [], {})
    both = np.array([[0.5, 0.5], [np.nan, np.nan]])
    with pytest.warns(AccuracyWarning, match="at t = 0.3: 0.5, error estimate nan"):
        assert report_missed(both, ["the value"], call, (1e-10, "warn"))
    assert not report_missed(both[:, 1:], ["the value"], call._replace(columns=[np.array([np.inf])], n=1, shape=(1,)), (1e-10, "warn"))
