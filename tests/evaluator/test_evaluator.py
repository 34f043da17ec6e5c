"""What `teg.compile` gives: calls, shapes, errors, derivatives, pickling, and what becomes of NaN and infinity."""

from __future__ import annotations

import math
import pickle
import warnings
from typing import Any

import numpy as np
import pytest

import teg
from teg import errors

x, y = teg.vars("x y")
t, a, b = teg.params("t a b")
AREA = teg.integral(teg.bracket(x < t) * (1 + a * x), (x, 0, 1))  # t + ½at²
BACKENDS = ["numpy", "c", "jax"]


@pytest.fixture(scope="module")
def f() -> teg.Evaluator:
    return teg.compile(AREA, [t, a])


@pytest.fixture
def enabled() -> Any:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


def value(t: Any, a: Any) -> Any:
    return t + a * t**2 / 2


# -- calls --------------------------------------------------------------------------------------------------------------


def test_by_name_position_and_dict(f: teg.Evaluator) -> None:
    expected = value(0.5, 2.0)
    assert f.parameters == ("t", "a")
    assert f(t=0.5, a=2.0) == f(0.5, 2.0) == f(0.5, a=2.0) == f({"t": 0.5, "a": 2.0}) == f({t: 0.5, a: 2.0}) == expected
    assert f({"t": 0.5}, a=2.0) == expected


def test_the_order_of_parameters() -> None:
    assert teg.compile(AREA, [a, t]).parameters == ("a", "t")
    assert teg.compile(AREA, [a]).parameters == ("a", "t")
    assert set(teg.compile(AREA).parameters) == {"t", "a"}
    assert teg.compile(AREA, a).parameters == ("a", "t")
    assert set(teg.compile(AREA, [a]).grad(a=1.0, t=0.5)) == {"a"}


def test_a_parameter_that_is_not_in_the_program() -> None:
    g = teg.compile(AREA, [t, a, b])
    assert g.parameters == ("t", "a", "b")
    assert g.grad(t=0.5, a=2.0, b=9.0)["b"] == 0.0


def test_a_parameter_that_simplification_removes_is_still_an_argument() -> None:
    g = teg.compile(teg.integral(x * t + 0 * a, (x, 0, 1)))
    assert set(g.parameters) == {"t", "a"}


def test_a_program_without_parameters() -> None:
    g = teg.compile(teg.integral(x * x, (x, 0, 3)))
    assert g() == g({}) == pytest.approx(9.0, rel=1e-15)
    assert g.value_and_grad()[1] == {}


@pytest.mark.parametrize("backend", BACKENDS)
def test_scalars_give_plain_floats(backend: str, enabled: None) -> None:
    f = teg.compile(teg.tuple(AREA, t), [t, a], backend=backend)
    at = {"t": 0.5, "a": 2}
    v, g = f.value_and_grad(at)
    hessian, along, back = f.hessian(at), f.jvp(at, {"t": np.float64(1)})[1], f.vjp(at, np.float64(2))[1]
    estimates = f.value_and_error(at)
    numbers = [*v, *g["t"], *f.hvp(at, {"t": 1})["a"], *hessian["t", "a"], *along, *back.values(), *estimates[0], *estimates[1]]
    assert {type(number) for number in numbers} == {float}
    k, V = teg.index("k"), teg.array("V")
    total = teg.compile(teg.sum(V[k] ** 2 * t, (k, 0, teg.length(V))), backend=backend)
    at = {"V": [1.0, 2.0], "t": 3.0}
    assert {type(number) for number in (total(at), total.grad(at)["t"], total.jvp(at, {"V": np.ones(2)})[1])} == {float}
    assert str(g) == "{'t': (2.0, 1.0), 'a': (0.125, 0.0)}"


@pytest.mark.parametrize(
    ("shapes", "shape"),
    [(((3,), ()), (3,)), (((3, 1), (4,)), (3, 4)), (((), (2, 0)), (2, 0)), (((1,), ()), (1,)), (((2, 3, 4), (4,)), (2, 3, 4))],
)
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_batches_broadcast(shapes: tuple[tuple[int, ...], tuple[int, ...]], shape: tuple[int, ...], backend: str) -> None:
    f = teg.compile(AREA, [t, a], backend=backend)
    rng = np.random.default_rng(1)
    ts, as_ = (rng.uniform(0.1, 0.9, s) for s in shapes)
    v, g = f.value_and_grad(t=ts, a=as_)
    assert v.shape == shape
    assert g["t"].shape == g["a"].shape == shape
    assert f.hessian(t=ts, a=as_)["t", "a"].shape == shape
    np.testing.assert_allclose(v, np.broadcast_to(value(ts, as_), shape), rtol=1e-14)
    np.testing.assert_allclose(g["t"], np.broadcast_to(1 + as_ * ts, shape), rtol=1e-14)


def test_batches_of_every_kind_of_number(f: teg.Evaluator) -> None:
    expected = value(np.array([0.0, 1.0]), 1.0)
    for ts in ([0, 1], np.array([0, 1], dtype=np.int32), np.array([False, True]), np.array([0, 1], dtype=np.float32)):
        np.testing.assert_array_equal(f(t=ts, a=1), expected)
    strided = np.linspace(0, 1, 21)[::2]
    np.testing.assert_allclose(f(t=strided, a=1.0), value(strided, 1.0), rtol=1e-14)


@pytest.mark.parametrize("values", [{t: [], a: 2.0}, {t: np.zeros((0, 3)), a: np.ones(3)}], ids=["a list", "two axes"])
def test_a_batch_of_no_elements(f: teg.Evaluator, values: dict[Any, Any]) -> None:
    shape = np.shape(values[t])
    assert f(values).shape == f.value_and_error(values)[1].shape == f.hessian(values)["t", "a"].shape == shape
    assert f.hvp(values, {"t": 1.0})["a"].shape == f.grad(values)["t"].shape == shape
    assert f.diagnose(values) == []


def test_a_batch_of_no_elements_of_empty_arrays() -> None:
    V, k = teg.array("V"), teg.index("k")
    f = teg.compile(teg.sum(V[k] * t, (k, 0, teg.length(V))), backend="numpy")
    value, slopes = f.value_and_grad(t=[], V=np.zeros((0, 0)))
    assert (value.shape, slopes["t"].shape, slopes["V"].shape) == ((0,), (0,), (0, 0))


def test_inputs_are_not_changed(f: teg.Evaluator) -> None:
    ts = np.linspace(0, 1, 5)
    before = ts.copy()
    f.value_and_grad(t=ts, a=1.0)
    np.testing.assert_array_equal(ts, before)


# -- mistakes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "named"),
    [
        ((), {"t": 0.5}),
        ((), {"t": 0.5, "a": 1.0, "b": 2.0}),
        ((0.5, 1.0, 2.0), {}),
        ((0.5,), {"t": 0.5, "a": 1.0}),
        (({"t": 0.5},), {}),
        ((), {"t": "half", "a": 1.0}),
        ((), {"t": 1j, "a": 1.0}),
        ((), {"t": None, "a": 1.0}),
        ((), {"t": [0.1, 0.2], "a": [1.0, 2.0, 3.0]}),
        ((), {"t": [[0.1], [0.2, 0.3]], "a": 1.0}),
        (({"t": 0.5, t: 0.6, "a": 1.0},), {}),
    ],
)
def test_calls_that_are_wrong(f: teg.Evaluator, args: tuple[Any, ...], named: dict[str, Any]) -> None:
    with pytest.raises(errors.ParameterError):
        f(*args, **named)


@pytest.mark.parametrize(
    "option",
    [
        {"backend": "fortran"}, {"tol": 0}, {"tol": 2.0}, {"tol": "small"}, {"rule": "simpson"}, {"order": 3}, {"dtype": np.float16},
        {"threads": -1}, {"threads": 1.5}, {"memory": 10}, {"discontinuities": "blur"},
    ],
)  # fmt: skip
def test_options_that_are_wrong(option: dict[str, Any]) -> None:
    with pytest.raises(errors.OptionError) as caught:
        teg.compile(AREA, [t, a], **option)
    assert caught.value.what


def test_options_may_be_integers_of_numpy() -> None:
    f = teg.compile(AREA, [t, a], backend="numpy", threads=np.int64(1), memory=np.int64(2**20), order=np.int64(8))  # type: ignore[arg-type]
    assert f(t=0.5, a=2.0) == pytest.approx(0.75, rel=1e-14)


def test_a_number_of_samples_that_is_wrong_is_told_by_its_own_name() -> None:
    with pytest.raises(errors.OptionError, match="samples=0"):
        teg.compile(AREA, [t, a], discontinuities="warp", samples=0)


def test_unknown_directions(f: teg.Evaluator) -> None:
    at = {"t": 0.5, "a": 2.0}
    with pytest.raises(errors.ParameterError):
        f.jvp(at, {"b": 1.0})
    with pytest.raises(errors.ParameterError):
        f.hvp(at, {"b": 1.0})


def test_what_is_no_expression() -> None:
    with pytest.raises(errors.ConditionError):
        teg.compile(x < t)
    with pytest.raises(errors.OperandError):
        teg.compile("x")


# -- derivatives --------------------------------------------------------------------------------------------------------


def test_gradient_and_hessian(f: teg.Evaluator) -> None:
    at = {"t": 0.5, "a": 2.0}
    assert f.grad(at) == pytest.approx({"t": 2.0, "a": 0.125}, rel=1e-15)
    h = f.hessian(at)
    assert h == pytest.approx({("t", "t"): 2.0, ("t", "a"): 0.5, ("a", "t"): 0.5, ("a", "a"): 0.0}, rel=1e-15, abs=1e-16)


def test_products_with_vectors(f: teg.Evaluator) -> None:
    at, direction = {"t": 0.5, "a": 2.0}, {"t": 3.0, "a": -1.0}
    v, d = f.jvp(at, direction)
    assert v == f(at)
    assert d == pytest.approx(3 * 2.0 - 0.125, rel=1e-15)
    v, g = f.vjp(at, 2.0)
    assert g == pytest.approx({"t": 4.0, "a": 0.25}, rel=1e-15)
    assert f.hvp(at, direction) == pytest.approx({"t": 5.5, "a": 1.5}, rel=1e-15)


def test_products_with_vectors_over_a_batch(f: teg.Evaluator) -> None:
    ts = np.linspace(0.1, 0.9, 7)
    at = {"t": ts, "a": 2.0}
    np.testing.assert_allclose(f.jvp(at, {"t": np.ones(7)})[1], 1 + 2 * ts, rtol=1e-14)
    np.testing.assert_allclose(f.vjp(at, ts)[1]["a"], ts * ts**2 / 2, rtol=1e-14)
    np.testing.assert_allclose(f.hvp(at, {"a": 1.0})["t"], ts, rtol=1e-14)


def test_the_product_of_the_hessian_forms_no_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of fourteen parameters: exact, a program of a size like the gradient's, and second derivatives are never asked for."""
    ts = [teg.param(f"t{i}") for i in range(14)]
    e = teg.integral(teg.bracket(sum(p * x**i for i, p in enumerate(ts)) > 0.5) * teg.exp(x), (x, 0, 1))
    f = teg.compile(e, ts)
    at = {p.name: 0.1 + 0.01 * i for i, p in enumerate(ts)}
    direction = {p.name: (-1.0) ** i for i, p in enumerate(ts)}
    monkeypatch.setattr(teg.Evaluator, "hessian", lambda *_: pytest.fail("the matrix was formed"))
    product = f.hvp(at, direction)
    h = 1e-4
    slopes = [f.grad({k: v + s * h * direction[k] for k, v in at.items()}) for s in (-2, -1, 1, 2)]
    for k, found in product.items():
        difference = (slopes[0][k] - 8 * slopes[1][k] + 8 * slopes[2][k] - slopes[3][k]) / (12 * h)
        assert found == pytest.approx(difference, rel=1e-6, abs=1e-7)
    some = f.hvp({**at, "t3": np.array([0.1, 0.2])}, {"t0": 1.0})
    assert some["t13"].shape == (2,)


def test_tuples() -> None:
    e = teg.tuple(AREA, (AREA**2, t), 3)
    f = teg.compile(e, [t, a])
    at = {"t": 0.5, "a": 2.0}
    v = value(0.5, 2.0)
    assert f(at) == (v, (v**2, 0.5), 3.0)
    value_, gradient = f.value_and_grad(at)
    assert value_ == f(at)
    assert gradient["t"] == (2.0, (2 * v * 2.0, 1.0), 0.0)
    flat = teg.compile(teg.tuple(AREA, t * a), [t, a])
    assert flat.jvp(at, {"t": 1.0})[1] == (2.0, 2.0)
    assert flat.vjp(at, (1.0, 10.0))[1] == pytest.approx({"t": 22.0, "a": 5.125}, rel=1e-15)
    assert flat.hessian(at)["t", "a"] == (0.5, 1.0)
    batch = flat.value_and_grad(t=np.full(3, 0.5), a=2.0)
    assert [row.shape for row in batch[0]] == [(3,), (3,)]
    assert [row.shape for row in batch[1]["a"]] == [(3,), (3,)]


def test_forward_reverse_and_symbolic_agree(f: teg.Evaluator) -> None:
    at = {t: 0.3, a: 1.7}
    by_name = {p.name: v for p, v in at.items()}
    for p in (t, a):
        forward = teg.evaluate(teg.diff(AREA, p), at)
        assert forward == pytest.approx(f.grad(by_name)[p.name], rel=1e-15)
        assert teg.evaluate(teg.jvp(AREA, {p: 1}), at) == forward
    assert teg.evaluate(teg.grad(AREA, [t, a])[1], at) == pytest.approx(f.grad(by_name)["a"], rel=1e-15)
    assert teg.evaluate(teg.hessian(AREA, [t, a])[0][1], at) == pytest.approx(0.3, rel=1e-14)
    assert teg.evaluate(teg.diff(teg.diff(teg.diff(AREA, t), t), a), at) == pytest.approx(1.0, rel=1e-14)


def test_plain_automatic_differentiation_for_comparison() -> None:
    f = teg.compile(AREA, [t, a], discontinuities="ignore")
    assert f(t=0.5, a=2.0) == value(0.5, 2.0)
    assert f.grad(t=0.5, a=2.0) == pytest.approx({"t": 0.0, "a": 0.125})


def test_an_adaptive_rule_agrees() -> None:
    exact, adaptive = teg.compile(AREA, [t, a]), teg.compile(AREA, [t, a], rule="adaptive", tol=1e-9)
    assert adaptive(t=0.4, a=3.0) == pytest.approx(exact(t=0.4, a=3.0), rel=1e-9)


# -- pickling and reports -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_evaluators_pickle(backend: str) -> None:
    f = teg.compile(AREA, [t, a], backend=backend, tol=1e-7)
    again = pickle.loads(pickle.dumps(f))
    assert again.parameters == f.parameters
    assert again.value_and_grad(t=0.5, a=2.0) == f.value_and_grad(t=0.5, a=2.0)


def test_source_and_explanation(f: teg.Evaluator) -> None:
    assert f.source.strip()
    report = f.explain()
    assert str(report)
    assert report.data["surfaces"]
    assert "Evaluator" in repr(f)


def test_diagnosis_of_a_batch_tells_the_element(f: teg.Evaluator) -> None:
    found = f.diagnose(t=np.array([0.5, 1.0, 0.25, 0.0]), a=1.0)
    assert [(d.kind, d.index) for d in found] == [("tie", 1), ("tie", 3)]
    assert found[0].parameters == {"t": 1.0, "a": 1.0}
    assert f.diagnose(t=0.5, a=1.0) == []


# -- NaN and infinity ---------------------------------------------------------------------------------------------------

PROGRAMS = {
    "step": AREA,
    "half-plane": teg.integral(teg.bracket(a * x + y < t), (x, 0, 1), (y, 0, 1)),
    "smooth": teg.integral(teg.exp(a * x) * teg.sin(t + x), (x, 0, 1)),
    "bounds": teg.integral(teg.cos(x), (x, a, t)),
    "quadratic": teg.integral(teg.bracket(x**2 + a * x < t) * teg.exp(x), (x, -1, 1)),
}


UNTOUCHED = {("step", "a", "a"), ("bounds", "t", "a"), ("bounds", "a", "t")}
"""(program, parameter, derivative): derivatives that do not depend on the parameter."""


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("program", PROGRAMS)
def test_not_a_number_comes_out_where_it_went_in(program: str, backend: str, enabled: None) -> None:
    f = teg.compile(PROGRAMS[program], [t, a], backend=backend)
    for at in ({"t": math.nan, "a": 0.5}, {"t": 0.5, "a": math.nan}, {"t": math.nan, "a": math.nan}):
        v, g = f.value_and_grad(at)
        assert math.isnan(v), at
        for k, d in g.items():
            reached = any(math.isnan(at[p]) and (program, p, k) not in UNTOUCHED for p in at)
            assert math.isnan(d) == reached, (at, k, d)
    mixed = f(t=np.array([0.5, math.nan, 0.25]), a=0.5)
    assert np.isnan(mixed).tolist() == [False, True, False]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("program", PROGRAMS)
def test_infinite_parameters_never_hang(program: str, backend: str, enabled: None) -> None:
    f = teg.compile(PROGRAMS[program], [t, a], backend=backend)
    for at in ({"t": math.inf, "a": 0.5}, {"t": -math.inf, "a": 0.5}, {"t": 0.5, "a": math.inf}, {"t": math.inf, "a": math.inf}):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            v, g = f.value_and_grad(at)
        assert set(g) == {"t", "a"}
        assert bool(said) or not any(math.isnan(number) for number in (v, *g.values()))


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_infinite_threshold_is_full_or_empty(backend: str, enabled: None) -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * x, (x, 0, 1)), [t], backend=backend)
    assert f.value_and_grad(t=math.inf) == (0.5, {"t": 0.0})
    assert f.value_and_grad(t=-math.inf) == (0.0, {"t": 0.0})


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_branch_that_is_not_taken_does_not_leak(backend: str, enabled: None) -> None:
    e = teg.where(t > 0, t**2, teg.sqrt(t) / t) + teg.integral(teg.where(x < t, x, teg.log(x - 2)) * teg.bracket(x < t), (x, 0, 1))
    v, g = teg.compile(e, [t], backend=backend).value_and_grad(t=0.5)
    assert v == pytest.approx(0.375, rel=1e-14)
    assert g["t"] == pytest.approx(1.5, rel=1e-14)


def test_jax_without_64_bits_says_which_flag() -> None:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(errors.BackendError) as caught:
            teg.compile(AREA, [t, a], backend="jax")(t=0.5, a=1.0)
        assert "x64" in str(caught.value)
    finally:
        jax.config.update("jax_enable_x64", before)


def test_a_parameter_may_be_called_self() -> None:
    f = teg.compile(teg.integral(teg.param("self") * teg.var("x"), (teg.var("x"), 0, 1)), backend="numpy")
    assert f.value_and_grad(self=3.0) == (1.5, {"self": 0.5})
