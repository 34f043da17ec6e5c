"""Programs with arrays and sums in every backend: values by hand, derivatives against differences, batches, threads."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import teg

V, W, F = teg.array("V", 2), teg.array("W"), teg.indices("F", 2)
k, j = teg.index("k"), teg.index("j")
x, y = teg.vars("x y")
t, n = teg.params("t n")
ROWS, FACES = (k, 0, teg.length(V, 0)), (k, 0, teg.length(F, 0))
MEAN = teg.sum(V[j, 0], (j, 0, teg.length(V, 0))) / teg.length(V, 0)

PROGRAMS: dict[str, Any] = {
    "a gather": teg.sum(V[F[k, 0], 1] ** 2 * t + V[F[k, 1], 0], FACES),
    "an integral a face": teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.sin(x * t), (x, 0, 1)), FACES),
    "a function of an inner sum": teg.sum(teg.sqrt(teg.sum(V[k, j] ** 2 * (j + 1), (j, 0, 2)) + t), ROWS),
    "all pairs": teg.sum(teg.exp(-((V[k, 0] - V[j, 1]) ** 2)) * t, ROWS, (j, 0, teg.length(V, 0))),
    "a sum in a sum that does not depend on it": teg.sum((V[k, 0] - MEAN) ** 2, ROWS) * t,
    "a sum in an integral": teg.integral(teg.sum(teg.bracket(x < V[k, 0]) * x * t, ROWS), (x, 0, 1)),
    "a function of a sum in an integral": teg.integral(teg.sum(teg.bracket(x < V[k, 0]) * x * t, ROWS) ** 2, (x, 0, 1)),
    "a condition on a sum in an integral": teg.integral(teg.bracket(teg.sum((x - V[j, 0]) ** 2, (j, 0, 3)) < t) * x, (x, -1, 2)),
    "a sum in a bound": teg.integral(teg.bracket(x > t * x * x) * teg.exp(x), (x, 0, teg.sum(V[k, 1] ** 2, ROWS))),
    "entries at fixed places": V[0, 0] * t + teg.integral(teg.bracket(x < V[1, 1]) * V[2, 0], (x, 0, 1)),
    "an integral in two variables": teg.sum(
        teg.integral(teg.bracket(V[k, 0] * x + V[k, 1] * y < t), (x, 0, 1), (y, 0, 1)) * V[k, 0], (k, 1, teg.length(V, 0))
    ),
    "a function of the whole": teg.log(1 + teg.sum(teg.integral(teg.bracket(x * x < V[k, 0]), (x, 0, 1)), ROWS)) * t,
    "three sums inside each other": teg.sum(
        V[k, 0] * V[j, 1] * V[teg.index("i"), 0], (k, 0, j + 1), (j, 0, teg.index("i")), (teg.index("i"), 1, 4)
    ),
    "a triangular range": teg.sum(teg.integral(teg.bracket(x < V[k, 0] * V[j, 1]), (x, 0, 1)), (k, 0, j), (j, 1, teg.length(V, 0))),
}
RANDOM = np.random.default_rng(3)
VALUES = {"V": RANDOM.uniform(0.2, 0.9, (5, 2)), "F": RANDOM.integers(0, 5, (7, 2)), "t": 0.8}
ALONG = {"V": np.cos(np.arange(10.0)).reshape(5, 2), "t": 0.5}


def given(f: Any, values: dict[str, Any] = VALUES) -> dict[str, Any]:
    return {name: values[name] for name in f.parameters}


def moved(values: dict[str, Any], step: float) -> dict[str, Any]:
    return {name: v + step * ALONG[name] if name in ALONG else v for name, v in values.items()}


def along(slopes: dict[str, Any]) -> float:
    return float(sum(np.sum(slopes[name] * d) for name, d in ALONG.items() if name in slopes))


@pytest.mark.parametrize("name", PROGRAMS)
def test_derivatives_are_those_of_the_value(name: str) -> None:
    """Against differences of fourth order: value, gradient, and the product of the Hessian with a direction."""
    f = teg.compile(PROGRAMS[name], [V, t], backend="c")
    values = given(f)
    h = 1e-3
    steps = {s: f.value_and_grad(moved(values, s * h)) for s in (-2, -1, 1, 2)}
    slope = (8 * (steps[1][0] - steps[-1][0]) - (steps[2][0] - steps[-2][0])) / (12 * h)
    value, slopes = f.value_and_grad(values)
    assert f(values) == pytest.approx(value, rel=1e-13)
    assert along(slopes) == pytest.approx(slope, rel=1e-8, abs=1e-9)
    product = f.hvp(values, ALONG)
    for p in ("V", "t"):
        change = (8 * (steps[1][1][p] - steps[-1][1][p]) - (steps[2][1][p] - steps[-2][1][p])) / (12 * h)
        np.testing.assert_allclose(product[p], change, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("jax", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PROGRAMS)
def test_backends_agree(name: str, backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "jax":
        request.getfixturevalue("x64")
    reference, f = (teg.compile(PROGRAMS[name], [V, t], backend=b) for b in ("c", backend))
    values = given(f)
    (a, at), (b, bt) = reference.value_and_grad(values), f.value_and_grad(values)
    assert b == pytest.approx(a, rel=1e-12)
    for p in at:
        np.testing.assert_allclose(bt[p], at[p], rtol=1e-12, atol=1e-13)
    if backend == "numpy":
        for p, product in f.hvp(values, ALONG).items():
            np.testing.assert_allclose(product, reference.hvp(values, ALONG)[p], rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_values_by_hand(backend: str) -> None:
    v, f = VALUES["V"], VALUES["F"]
    found = teg.evaluate(PROGRAMS["a gather"], VALUES, backend=backend)
    assert found == pytest.approx(np.sum(v[f[:, 0], 1] ** 2 * 0.8 + v[f[:, 1], 0]), rel=1e-14)
    found = teg.evaluate(PROGRAMS["an integral a face"], VALUES, backend=backend)
    assert found == pytest.approx(np.sum((1 - np.cos(0.8 * v[f[:, 0], 0])) / 0.8), rel=1e-13)
    values = {"V": v, "t": 0.8}
    product = v[:, :1] * v[:, 1]
    expected = sum(min(product[a, b], 1.0) for b in range(5) for a in range(b))
    assert teg.evaluate(PROGRAMS["a triangular range"], values, backend=backend) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_batch_adds_axes_in_front(backend: str) -> None:
    f = teg.compile(PROGRAMS["an integral a face"], [V, t], backend=backend)
    rng = np.random.default_rng(1)
    v, tt = rng.uniform(0.2, 0.9, (2, 3, 5, 2)), np.array([0.5, 0.7, 1.1])
    value, slopes = f.value_and_grad(V=v, t=tt, F=VALUES["F"])
    assert value.shape == (2, 3)
    assert slopes["V"].shape == (2, 3, 5, 2)
    assert slopes["t"].shape == (2, 3)
    one, alone = f.value_and_grad(V=v[1, 2], t=1.1, F=VALUES["F"])
    assert value[1, 2] == pytest.approx(one, rel=1e-14)
    np.testing.assert_allclose(slopes["V"][1, 2], alone["V"], rtol=1e-13)
    faces = rng.integers(0, 5, (3, 7, 2))
    many = f(V=v[0, 0], t=0.5, F=faces)
    assert many.shape == (3,)
    assert many[1] == pytest.approx(f(V=v[0, 0], t=0.5, F=faces[1]), rel=1e-14)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_tuple_of_programs(backend: str) -> None:
    e = teg.tuple(teg.sum(V[k, 0] ** 2, ROWS), teg.sum(V[k, 0] * V[k, 1], ROWS))
    f = teg.compile(e, [V], backend=backend)
    v = VALUES["V"]
    (a, b), slopes = f.value_and_grad(V=v)
    assert a == pytest.approx(np.sum(v[:, 0] ** 2))
    assert b == pytest.approx(np.sum(v[:, 0] * v[:, 1]))
    np.testing.assert_allclose(slopes["V"][0][:, 0], 2 * v[:, 0], rtol=1e-14)
    np.testing.assert_allclose(slopes["V"][1], v[:, ::-1], rtol=1e-14)
    assert f.vjp({"V": v}, (1.0, 2.0))[1]["V"] == pytest.approx(slopes["V"][0] + 2 * slopes["V"][1])
    value, tangent = f.jvp({"V": v}, {"V": ALONG["V"]})
    assert tangent[1] == pytest.approx(np.sum(v[:, ::-1] * ALONG["V"]))
    assert value[0] == pytest.approx(a)


def test_the_hessian_of_a_small_program() -> None:
    f = teg.compile(teg.sum(W[k] ** 2 * W[(k + 1) % 3], (k, 0, 3)) * t, [W, t], backend="c")
    w = np.array([0.3, 0.5, 0.9])
    h = f.hessian(W=w, t=2.0)
    assert h["W", "W"].shape == (3, 3)
    np.testing.assert_allclose(h["W", "W"], h["W", "W"].T, atol=1e-15)
    np.testing.assert_allclose(np.diag(h["W", "W"]), 4 * np.roll(w, -1), rtol=1e-14)
    np.testing.assert_allclose(h["W", "t"], f.grad(W=w, t=1.0)["W"], rtol=1e-14)
    np.testing.assert_allclose(h["t", "W"], h["W", "t"], rtol=1e-14)
    assert h["t", "t"] == 0.0


def test_symbolic_derivatives_are_programs_too() -> None:
    e = PROGRAMS["an integral a face"]
    f = teg.compile(e, [V, t])
    values = given(f)
    g = teg.compile(teg.grad(e, [V, t]), backend="c")
    by_v, by_t = g(values)
    np.testing.assert_allclose(by_v, f.grad(values)["V"], rtol=1e-12)
    assert by_t == pytest.approx(f.grad(values)["t"], rel=1e-12)
    moving = teg.array("dV", 2)
    d = teg.evaluate(teg.jvp(e, {V: moving, t: 0.5}), {**values, "dV": ALONG["V"]})
    assert d == pytest.approx(along(f.grad(values)), rel=1e-12)


def test_threads_do_not_change_a_bit() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.exp(x * t), (x, 0, 1)) * V[F[k, 1], 1], FACES)
    rng = np.random.default_rng(5)
    values = {"V": rng.random((50, 2)), "F": rng.integers(0, 50, (20_000, 2)), "t": 0.3}
    found = []
    for threads in (1, 2, 3):
        f = pickle.loads(pickle.dumps(teg.compile(e, [V, t], backend="c", threads=threads)))
        found.append(f.value_and_grad(values))
    for value, slopes in found[1:]:
        assert value == found[0][0]
        assert all(np.array_equal(slopes[p], found[0][1][p]) for p in slopes)
    value, slopes = teg.compile(e, [V, t]).value_and_grad(values)
    assert value == pytest.approx(found[0][0], rel=1e-12)
    np.testing.assert_allclose(slopes["V"], found[0][1]["V"], rtol=1e-11)


def test_an_inner_sum_that_is_the_same_for_all_is_computed_once() -> None:
    """The variance: linear, not quadratic, in the number of entries; its gradient too."""
    f = teg.compile(PROGRAMS["a sum in a sum that does not depend on it"], [V], backend="numpy")
    for orders in (0, 1):
        depth = [0]

        def visit(block: Any, level: int, depth: list[int] = depth) -> None:
            for step in block:
                if hasattr(step, "body"):
                    depth[0] = max(depth[0], level + 1)
                    visit(step.body, level + 1)

        visit(f.program(orders).body, 0)
        assert depth[0] == 1


def test_shapes_that_decide_the_program_are_kept_apart() -> None:
    f = teg.compile(PROGRAMS["a function of a sum in an integral"], [V, t], backend="c")
    for rows in (2, 5, 2, 0):
        v = np.full((rows, 2), 0.5)
        assert f(V=v, t=2.0) == pytest.approx(rows**2 * 4 * 0.5**3 / 3, rel=1e-13)
        assert f.grad(V=v, t=2.0)["V"].shape == (rows, 2)


def test_ties_are_resolved_iteration_by_iteration() -> None:
    """Three squares touch an edge: the mean of the one-sided derivatives in each, the same in every backend."""
    square = teg.integral(teg.bracket(x < W[0]), (x, k, k + 1))
    found = [teg.compile(teg.sum(square, (k, 0, 3)), [W], backend=b).value_and_grad(W=[2.0]) for b in ("numpy", "c")]
    for value, slopes in found:
        assert value == 2.0
        assert slopes["W"][0] == 1.0
    f = teg.compile(teg.sum(teg.integral(teg.bracket(x < W[k]), (x, 0, 1)), (k, 0, 3)), [W], backend="c")
    np.testing.assert_array_equal(f.grad(W=[0.5, 1.0, 2.0])["W"], [1.0, 0.5, 0.0])
