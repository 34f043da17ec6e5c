"""`teg.jax_function` of scalar programs: every transformation of JAX against the C backend, in double and in single precision."""

from __future__ import annotations

import os
import pickle
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import teg
from teg.errors import ArrayIndexError, BackendError, MissingPackageError, OperandError, ParameterError
from teg.evaluator.plan import GRADIENT, VALUE, derivative_of_order

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
    exact = teg.compile(STEP, [t, a], backend=EXACT)
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


SHARDED = """
import jax, numpy as np, teg
import jax.numpy as jnp
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P

jax.config.update("jax_enable_x64", True)
assert jax.device_count() == 8
x, (t, a) = teg.var("x"), teg.params("t a")
f = teg.jax_function(teg.integral(teg.bracket(x < t) * teg.exp(teg.sin(a * x)), (x, 0, 1)))
at = {"t": jnp.linspace(-0.1, 1.1, 32), "a": jnp.asarray(1.3)}
loss = lambda p: (f(p) ** 2).sum()
wanted, second = jax.jit(jax.value_and_grad(loss))(at), jax.jit(jax.grad(jax.grad(lambda a: loss({**at, "a": a}))))(at["a"])

def same(found):
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-15)

for kind in (AxisType.Auto, AxisType.Explicit):
    mesh = jax.make_mesh((8,), ("batch",), axis_types=(kind,))
    with jax.set_mesh(mesh):
        split = {"t": jax.device_put(at["t"], NamedSharding(mesh, P("batch"))), "a": jax.device_put(at["a"], NamedSharding(mesh, P()))}
        compiled = jax.jit(jax.value_and_grad(loss)).lower(split).compile()
        same(compiled(split))
        assert "all-gather(" not in compiled.as_text() and "all-to-all(" not in compiled.as_text(), "the batch is moved between devices"
        assert jax.jit(f)(split).sharding.spec == P("batch")
mesh = jax.make_mesh((8,), ("batch",), axis_types=(AxisType.Auto,))
for checked in (True, False):
    parts = jax.shard_map(
        lambda p: jax.lax.psum(loss(p), "batch"), mesh=mesh, in_specs=({"t": P("batch"), "a": P()},), out_specs=P(), check_vma=checked
    )
    same(jax.jit(jax.value_and_grad(parts))(at))
np.testing.assert_allclose(jax.jit(jax.grad(jax.grad(lambda a: parts({**at, "a": a}))))(at["a"]), second, rtol=1e-13)
slopes = jax.shard_map(jax.grad(loss), mesh=mesh, in_specs=({"t": P("batch"), "a": P()},), out_specs={"t": P("batch"), "a": P()})
same((wanted[0], jax.jit(slopes)(at)))
mapped = jax.pmap(jax.vmap(lambda s: jax.grad(lambda s: loss({"t": s, "a": 1.3}))(s)))(at["t"].reshape(8, 4))
same((wanted[0], {"t": mapped.reshape(-1), "a": wanted[1]["a"]}))

k, V, F = teg.index("k"), teg.array("V", 2), teg.indices("F", 2)
term = teg.integral(teg.bracket(x * V[F[k, 0], 0] < V[F[k, 1], 1]) * (x + 1), (x, 0, 1))
g = teg.jax_function(teg.sum(term, (k, 0, teg.length(F, 0))))
random = np.random.default_rng(0)
points, pairs = jnp.asarray(random.uniform(0.2, 1.5, (6, 2))), jnp.asarray(random.integers(0, 6, (24, 2)))
wanted = jax.jit(jax.value_and_grad(lambda v, f: g(V=v, F=f)))(points, pairs)
along = lambda call: jax.jit(jax.grad(lambda v: (jax.grad(call)(v, pairs) * jnp.cos(v)).sum()))(points)
second = along(lambda v, f: g(V=v, F=f))
for checked in (True, False):  # terms are split, points are not
    parts = jax.shard_map(
        lambda v, f: jax.lax.psum(g(V=v, F=f), "batch"), mesh=mesh, in_specs=(P(), P("batch")), out_specs=P(), check_vma=checked
    )
    same(jax.jit(jax.value_and_grad(parts))(points, pairs))
np.testing.assert_allclose(along(parts), second, rtol=1e-12, atol=1e-13)
"""

PROCESSES = """
import sys
import jax, numpy as np, teg
from jax.sharding import AxisType, NamedSharding, PartitionSpec as P

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_cpu_collectives_implementation", "gloo")
jax.distributed.initialize(f"127.0.0.1:{sys.argv[2]}", num_processes=2, process_id=int(sys.argv[1]))
assert jax.device_count() == 4 and jax.local_device_count() == 2
x, (t, a) = teg.var("x"), teg.params("t a")
e = teg.integral(teg.bracket(x < t) * (1 + a * x) ** 2, (x, 0, 1))
f, exact = teg.jax_function(e), teg.compile(e, [t, a])
mesh = jax.make_mesh((4,), ("batch",), axis_types=(AxisType.Auto,))
many = np.linspace(-0.1, 1.1, 16)
split = jax.make_array_from_callback(many.shape, NamedSharding(mesh, P("batch")), lambda i: many[i])
value, slope = jax.jit(jax.value_and_grad(lambda a, s: (f(t=s, a=a) ** 2).sum()))(1.3, split)
values, slopes = exact.value_and_grad(t=many, a=1.3)
np.testing.assert_allclose(value, (values**2).sum(), rtol=1e-13)
np.testing.assert_allclose(slope, (2 * values * slopes["a"]).sum(), rtol=1e-13)
"""


def devices(count: int) -> dict[str, str]:
    """The environment of a process with so many devices."""
    return {**os.environ, "XLA_FLAGS": f"--xla_force_host_platform_device_count={count}", "JAX_PLATFORMS": "cpu"}


@pytest.mark.slow
def test_eight_devices() -> None:
    """jit with automatic and explicit shardings, shard_map, pmap; batches and terms of sums: all is as on one device."""
    subprocess.run([sys.executable, "-c", SHARDED], check=True, env=devices(8))


@pytest.mark.slow
def test_two_processes() -> None:
    """A batch on the devices of two processes, which are joined on the loopback."""
    with socket.socket() as chosen:
        chosen.bind(("127.0.0.1", 0))
        port = str(chosen.getsockname()[1])
    running = [subprocess.Popen([sys.executable, "-c", PROCESSES, str(rank), port], env=devices(2)) for rank in range(2)]
    try:
        assert [process.wait(timeout=120) for process in running] == [0, 0]
    finally:
        for process in running:
            process.kill()
            process.wait()
