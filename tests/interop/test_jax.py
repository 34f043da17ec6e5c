"""`teg.jax_function` of scalar programs: every transformation of JAX against the C backend, in double and in single precision."""

from __future__ import annotations

import pickle
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import ArrayIndexError, OperandError
from teg.evaluator.wanted import GRADIENT, VALUE, derivative_of_order

jax = pytest.importorskip("jax")
pytest.importorskip("jax.extend")
jnp = jax.numpy

EXACT = "c" if any(map(shutil.which, ("cc", "gcc", "clang"))) else "numpy"
x, y = teg.vars("x y")
t, a = teg.params("t a")
unit = (x, 0, 1), (y, 0, 1)
STEP = teg.integral(teg.bracket(x < t) * (1 + a * x) ** 2, (x, 0, 1))
"""XLA compiles it in a tenth of the time of an integrand that takes an adaptive rule, as the first case does."""
TRIANGLE = teg.integral(teg.bracket(x + a * y < t), *unit)


@dataclass(frozen=True)
class Case:
    """A program, and a point where it has second derivatives."""

    name: str
    e: Any
    t: float
    a: float
    fast: bool = False


CASES = (
    Case("a step", teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), 0.5, 1.1, fast=True),
    Case("a half-plane", TRIANGLE, 0.5, 1.2, fast=True),
    Case("a bound", teg.integral(teg.bracket(a * x < t) * teg.cos(x * t), (x, 0, t)), 0.8, 1.7),
    Case("a kink", teg.integral(teg.abs(x - t) * teg.maximum(x, a * t), (x, 0, 1)), 0.4, 1.3, fast=True),
    Case("a function of an integral", teg.exp(STEP) * teg.sqrt(t + a) / STEP, 0.5, 1.1),
    Case("a step at an integral", teg.integral(teg.bracket(x < teg.integral((1 + a * y) ** 2, (y, 0, t))) * x, (x, 0, 2)), 0.8, 0.4),
    Case("steps of floor", teg.integral(teg.floor(a * x + t) * x, (x, 0, 1)), 0.3, 2.5),
    Case("a cubic", teg.integral(teg.bracket(x**3 + a * x < t), (x, -1, 1)), 0.3, 0.7),
    Case("a hyperbola", teg.integral(teg.bracket(x * y < t) * (a + x), *unit), 0.3, 0.7),
    Case("two roots", teg.integral(teg.bracket(x * x + a * x < t) * teg.exp(x), (x, -2, 1)), 0.5, 1.1),
)
BY_XLA = {"a half-plane": False, "a kink": True, "a step at an integral": True, "a hyperbola": True}
"""Whether it is slow as a program of XLA."""
EVERY = [pytest.param(c, "c", marks=[] if c.fast else [pytest.mark.slow], id=f"{c.name}-c") for c in CASES]
EVERY += [pytest.param(c, "xla", marks=[pytest.mark.slow] if BY_XLA[c.name] else [], id=f"{c.name}-xla") for c in CASES if c.name in BY_XLA]
x64 = pytest.mark.usefixtures("x64")


def close(found: Any, wanted: Any, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(found, wanted, rtol=tolerance, atol=tolerance)


def transformations(case: Case, tolerance: float, kernel: str = "auto") -> None:
    """Value, gradient, Hessian, and both along a batch, in one compilation."""
    f, exact = teg.jax_function(case.e, [t, a], kernel=kernel), teg.compile(case.e, [t, a], backend=EXACT)
    at, many = {"t": case.t, "a": case.a}, case.t + 0.01 * np.arange(3)

    @jax.jit
    def every(at: Any, many: Any) -> Any:
        one = {"t": jnp.asarray(at["t"], float), "a": jnp.asarray(at["a"], float)}
        mapped = jax.vmap(lambda s: jax.value_and_grad(f)({**one, "t": s}))(many)
        return jax.value_and_grad(f)(one), jax.hessian(f)(one), mapped

    (value, slopes), second, (values, gradients) = every(at, many)
    close(value, exact(at), tolerance)
    for name, slope in exact.grad(at).items():
        close(slopes[name], slope, tolerance)
    for (i, j), entry in exact.hessian(at).items():
        close(second[i][j], entry, tolerance)
    close(values, exact(t=many, a=case.a), tolerance)
    for name, slope in exact.grad(t=many, a=case.a).items():
        close(gradients[name], slope, tolerance)


@x64
@pytest.mark.parametrize(("case", "kernel"), EVERY)
def test_against_c(case: Case, kernel: str) -> None:
    transformations(case, 1e-12, "auto" if kernel == "c" else kernel)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES[1:8:2], ids=lambda c: c.name)
def test_single_precision_without_the_flag(case: Case) -> None:
    """x64 is off: arguments and results are single, what is between is not."""
    assert not jax.config.jax_enable_x64
    transformations(case, 2e-6)
    assert teg.jax_function(case.e)({"t": case.t, "a": case.a}).dtype == jnp.float32
    assert not jax.config.jax_enable_x64


@pytest.mark.gpu
@pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)
def test_on_a_gpu(case: Case, x64: None) -> None:
    try:
        device = jax.devices("gpu")[0]
    except RuntimeError:
        pytest.skip("no CUDA device")
    with jax.default_device(device):
        transformations(case, 1e-12)


# -- transformations -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def step() -> Callable[[Any, Any], Any]:
    """∫₀ᵗ (1 + ax)² dx of two positional arguments."""
    f = teg.jax_function(STEP)
    return lambda t, a: f(t=t, a=a)


@x64
@pytest.mark.slow
def test_third_derivatives_by_all_ways(step: Callable[[Any, Any], Any]) -> None:
    ways = {
        "reverse over reverse over reverse": jax.grad(jax.grad(jax.grad(step))),
        "forward over reverse over reverse": lambda t, a: jax.jvp(lambda s: jax.grad(jax.grad(step))(s, a), (t,), (1.0,))[1],
        "forward over forward over forward": jax.jacfwd(jax.jacfwd(jax.jacfwd(step))),
        "reverse over forward over reverse": jax.grad(jax.jacfwd(jax.grad(step))),
    }
    for name, third in ways.items():
        np.testing.assert_allclose(jax.jit(third)(0.5, 1.1), 2 * 1.1**2, rtol=1e-13, err_msg=name)
    mixed = jax.jit(jax.grad(jax.jacfwd(jax.grad(step, 0), 1), 0))
    close(mixed(0.5, 1.1), 2 + 4 * 0.55, 1e-13)


@x64
def test_third_derivatives_of_a_triangle() -> None:
    """Its area is t²/2a."""
    f = teg.jax_function(TRIANGLE)

    def along(p: Any) -> Any:
        return jax.jvp(lambda q: jax.jvp(jax.grad(f), (q,), (direction,))[1], (p,), (direction,))[1]

    direction = {"t": 0.7, "a": -0.4}
    found = jax.jit(along)({"t": 0.5, "a": 1.2})
    s, b, ds, db = 0.5, 1.2, 0.7, -0.4
    ttt, tta, taa, aaa = 0.0, -1 / b**2, 2 * s / b**3, -3 * s * s / b**4
    close(found["t"], ttt * ds**2 + 2 * tta * ds * db + taa * db**2)
    close(found["a"], tta * ds**2 + 2 * taa * ds * db + aaa * db**2)


@x64
def test_linearize_and_vjp(step: Callable[[Any, Any], Any]) -> None:
    exact = teg.compile(STEP, [t, a], backend=EXACT)
    value, slopes = exact.value_and_grad(t=0.5, a=1.1)
    found, linear = jax.linearize(step, 0.5, 1.1)
    close(found, value)
    close(linear(2.0, -1.0), 2 * slopes["t"] - slopes["a"])
    close(jax.linear_transpose(linear, 0.5, 1.1)(3.0), (3 * slopes["t"], 3 * slopes["a"]))
    found, back = jax.vjp(step, 0.5, 1.1)
    close(back(3.0), (3 * slopes["t"], 3 * slopes["a"]))


@x64
@pytest.mark.slow
def test_checkpoint_and_scan(step: Callable[[Any, Any], Any]) -> None:
    close(jax.jit(jax.grad(jax.grad(jax.checkpoint(step))))(0.5, 1.1), 2 * 1.1 * 1.55)

    def descend(start: Any, rate: Any) -> Any:
        def step_down(s: Any, _: Any) -> Any:
            s = s - rate * jax.grad(lambda q: (step(q, 1.1) - 0.3) ** 2)(s)
            return s, step(s, 1.1)

        return jax.lax.scan(step_down, start, None, length=60)

    last, values = jax.jit(descend)(0.7, 0.1)
    close(values[-1], 0.3, 1e-8)
    slope = jax.jit(jax.grad(lambda s: descend(s, 0.1)[0]))(0.7)  # through the second derivatives of every step
    close(slope, (descend(0.7 + 1e-5, 0.1)[0] - descend(0.7 - 1e-5, 0.1)[0]) / 2e-5, 1e-6)
    assert last < 0.7


@x64
@pytest.mark.slow
def test_batches_broadcast() -> None:
    f, exact = teg.jax_function(STEP), teg.compile(STEP, [t, a], backend=EXACT)
    many, rates = np.linspace(0.1, 0.9, 3)[:, None], np.array([[0.3, 0.8, 1.1, 1.6]])
    at = {"t": jnp.asarray(many), "a": jnp.asarray(rates)}
    close(f(at), exact(t=many, a=rates))
    assert f(t=jnp.ones((2, 1)), a=jnp.ones(1)).shape == (2, 1)
    found, slopes = jax.jit(jax.grad(lambda p: f(p).sum()))(at), exact.grad(t=many, a=rates)
    close(found["t"], slopes["t"].sum(axis=1, keepdims=True))
    close(found["a"], slopes["a"].sum(axis=0, keepdims=True))
    second = jax.hessian(lambda s: f(t=s, a=1.1).sum())(jnp.asarray(many[:, 0]))
    close(second, np.diag(2 * 1.1 * (1 + 1.1 * many[:, 0])))
    mapped = jax.vmap(jax.vmap(lambda s, b: f(t=s, a=b), (0, None)), (None, 0))(many[:, 0], rates[0])
    close(mapped, exact(t=many, a=rates).T)
    assert f(t=jnp.zeros((0, 3)), a=1.0).shape == (0, 3)


@x64
@pytest.mark.parametrize("kernel", ["c", "xla"])
def test_batches_of_no_elements(kernel: str) -> None:
    f = teg.jax_function(TRIANGLE, kernel=kernel)
    assert f(t=jnp.zeros((0, 3)), a=jnp.ones(3)).shape == (0, 3)
    slopes = jax.vmap(jax.grad(lambda s, b: f(t=s, a=b), (0, 1)), (0, None))(jnp.zeros(0), 2.0)
    assert [s.shape for s in slopes] == [(0,), (0,)]


@x64
def test_where_a_user_has_turned_jit_off(step: Callable[[Any, Any], Any]) -> None:
    with jax.disable_jit():
        value, slope = jax.value_and_grad(step)(0.5, 1.1)
        mapped = jax.vmap(step, (0, None))(jnp.array([0.5, 1.0]), 1.1)
    close([value, slope], [(1.55**3 - 1) / 3.3, 1.55**2])  # ∫ (1 + ax)² from 0 to t, and the integrand at t
    close(mapped, (np.array([1.55, 2.1]) ** 3 - 1) / 3.3)


@x64
def test_a_range_of_negative_length_without_arrays() -> None:
    k, n = teg.index("k"), teg.param("n")
    f = teg.jax_function(teg.sum(t * k, (k, 0, n)), kernel="xla")
    close(f(t=0.5, n=4), 3.0)
    with pytest.raises(ArrayIndexError, match="negative length"):
        f(t=0.5, n=-1)


@x64
def test_a_tracer_is_no_number_of_a_program() -> None:
    with pytest.raises(OperandError, match=r"teg\.param") as caught:
        jax.jit(lambda s: teg.evaluate(teg.integral(teg.bracket(x < s), (x, 0, 1))))(0.5)
    assert "teg.jax_function" in caught.value.hint


@x64
@pytest.mark.slow
def test_tuples() -> None:
    e = teg.tuple(STEP, teg.tuple(t * a, STEP * STEP))
    f, exact = teg.jax_function(e), teg.compile(e, [t, a], backend=EXACT)
    at = {"t": 0.5, "a": 1.1}
    first, (second, third) = f(at)
    close((first, second, third), (exact(at)[0], *exact(at)[1]))
    found = jax.jit(jax.jacrev(f))(at)
    close(found[1][1]["t"], exact.grad(at)["t"][1][1])
    close(jax.jit(jax.hessian(lambda p: f(p)[1][1]))(at)["t"]["a"], exact.hessian(at)["t", "a"][1][1])


@x64
def test_constants_have_no_derivative() -> None:
    f = teg.jax_function(STEP, [t])
    assert f.parameters == ("t", "a")
    found = jax.grad(f)({"t": 0.5, "a": 1.1})
    close(found["t"], 1.55**2)
    assert found["a"] == 0.0
    assert jax.grad(jax.grad(lambda b: f(t=0.5, a=b)))(1.1) == 0.0


@x64
@pytest.mark.slow
def test_no_nan_out_of_a_branch_that_is_not_taken() -> None:
    e = teg.where(t > 0, teg.sqrt(t), a) * teg.integral(teg.where(x < a, teg.log(a - x + t * 0), x * a), (x, 2, 3))
    f = teg.jax_function(e)
    at = {"t": -1.0, "a": 1.0}  # ∫₂³ a·ax dx = 5a²/2
    second = jax.jit(lambda p, v: jax.jvp(jax.grad(f), (p,), (v,))[1])(at, {"t": 1.0, "a": 1.0})
    close([second["t"], second["a"]], [0.0, 5.0])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(f)))({"t": jnp.array([-1.0, 4.0]), "a": jnp.array([1.0, 1.0])})
    close(values, [2.5, 5.0])
    close(slopes["t"], [0.0, 0.625])
    close(slopes["a"][0], 5.0)


@x64
def test_ties_are_those_of_the_evaluators() -> None:
    """Two steps at one place: each counts half, in a batch for the elements that meet a tie only."""
    e = teg.integral(teg.bracket(x < t) * teg.bracket(x < a), (x, 0, 1))
    f, exact = teg.jax_function(e), teg.compile(e, [t, a], backend=EXACT)
    many = np.array([0.2, 0.5, 0.7])
    found, slopes = jax.jit(jax.vmap(jax.grad(lambda s, b: f(t=s, a=b), (0, 1)), (0, None)))(many, 0.5), exact.grad(t=many, a=0.5)
    close(found, (slopes["t"], slopes["a"]))
    close(found[0], [1.0, 0.5, 0.0])


@x64
@pytest.mark.slow
def test_discontinuities_ignored() -> None:
    f = teg.jax_function(STEP, discontinuities="ignore")
    exact = teg.compile(STEP, [t, a], backend=EXACT, discontinuities="ignore")
    found = jax.hessian(f)({"t": 0.5, "a": 1.1})
    assert found["t"]["t"] == found["t"]["a"] == found["a"]["t"] == 0.0
    close(found["a"]["a"], exact.hessian(t=0.5, a=1.1)["a", "a"])


def count(f: Any, *arguments: Any) -> list[int]:
    """The orders of the programs that a function runs."""
    found: list[int] = []

    def walk(jaxpr: Any) -> None:
        for equation in jaxpr.eqns:
            if equation.primitive.name == "teg_derivative":
                found.append(equation.params["order"])
            for inner in jax.extend.core.jaxprs_in_params(equation.params):
                walk(inner)

    walk(jax.make_jaxpr(f)(*arguments).jaxpr)
    return found


@x64
def test_value_and_gradient_are_one_program() -> None:
    f = teg.jax_function(2.0 * STEP)  # what is derived of one expression is shared
    at = {"t": 0.5, "a": 1.1}
    assert count(f, at) == [-1]
    assert count(jax.value_and_grad(f), at) == [0]
    assert count(lambda p: jax.jvp(f, (p,), (p,)), at) == [0]
    assert sorted(count(lambda p: jax.jvp(jax.grad(f), (p,), (p,)), at)) == [0, 1]
    plan = f._plan
    assert plan is not None
    jax.value_and_grad(f)(at)
    once = plan.program(GRADIENT)
    jax.grad(lambda p: f(p).sum())({"t": jnp.ones(3), "a": 1.0})
    assert plan.program(GRADIENT) is once
    assert {wanted for wanted, *_ in plan.derivation._programs} <= {VALUE, GRADIENT, derivative_of_order(1, (t, a))}


@x64
def test_threads_share_one_function() -> None:
    f = teg.jax_function(STEP)
    found: list[Any] = []
    threads = [threading.Thread(target=lambda: found.append(jax.grad(f)({"t": 0.5, "a": 1.1})["t"])) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    close(found, [1.55**2] * 4)


@x64
def test_pickles() -> None:
    f = pickle.loads(pickle.dumps(teg.jax_function(STEP, [t], tol=1e-8)))
    close(jax.grad(f)({"t": 0.5, "a": 1.1})["t"], 1.55**2)
    assert "t, a" in repr(f)


# -- types, errors, sharding ---------------------------------------------------------------------------------------------


@x64
@pytest.mark.slow
def test_types_follow_the_arguments() -> None:
    f = teg.jax_function(STEP)
    single = {"t": jnp.float32(0.5), "a": jnp.float32(1.1)}
    assert f(single).dtype == jax.grad(f)(single)["a"].dtype == jnp.float32
    assert f({**single, "a": jnp.float64(1.1)}).dtype == jnp.float64
    assert f(t=0.5, a=1).dtype == jnp.float64
    assert teg.jax_function(STEP, dtype="float32")(t=0.5, a=1.0).dtype == jnp.float32
    assert teg.jax_function(STEP, dtype=np.float64)(single).dtype == jnp.float64
    close(teg.jax_function(teg.integral(x * x, (x, 0, 3)))({}), 9.0)
