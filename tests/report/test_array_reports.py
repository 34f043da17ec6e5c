"""What evaluators of programs with arrays say about calls and programs: errors, ties, explanations, checks, other dtypes, printing."""

from __future__ import annotations

import json
import pickle
import shutil
import warnings
from typing import Any

import numpy as np
import pytest

import teg
from teg.passes.program.errors_in_loops import with_array_error_estimates
from teg.program.arrays import Loop, array_size, steps
from teg.report.explanation import WIDTH
from tests.backends.test_arrays import PROGRAMS, VALUES

V, W = teg.array("V", 2), teg.array("W")
F = teg.indices("F", 2)
k, j = teg.index("k"), teg.index("j")
x, y = teg.vars("x y")
t, n = teg.params("t n")
FACES = teg.length(F, 0)
HERE: dict[str, Any] = {
    "V": np.array([[0.1, 0.25], [0.375, 0.5], [0.75, 0.625], [0.875, 0.125]]),
    "F": np.array([[0, 1], [1, 2], [2, 3]]),
    "t": 2.0,
}
CUT = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.exp(x * V[F[k, 1], 1]) * teg.sin(x * t), (x, 0, 1)), (k, 0, FACES))
NESTED = teg.sum(teg.sqrt(teg.sum(V[k, j] ** 2 * (j + 1), (j, 0, 2)) + t), (k, 0, teg.length(V)))
THROUGH = teg.sin(teg.sum(teg.integral(teg.exp(x * V[k, 0] * 2), (x, 0, 1)), (k, 0, 3))) * t
BREAK = teg.integral(teg.bracket(x < teg.sum(teg.integral(teg.cos(3 * y * V[k, 0]), (y, 0, 1)), (k, 0, 3))) * t * (2 - x), (x, 0, 10))
ROOT = teg.integral(
    teg.bracket(teg.exp(x) + x < 1 + teg.sum(teg.integral(teg.cos(3 * y * V[k, 0]), (y, 0, 1)), (k, 0, 3))) * t * (2 - x), (x, 0, 10)
)
SQUARE = teg.integral(teg.sum(teg.bracket(x < V[k, 0]) * x, (k, 0, teg.length(V))) ** 2 * t, (x, 0, 1))
FAST = [
    "numpy",
    pytest.param("c", marks=pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")),
]
BACKENDS = [*FAST, pytest.param("jax", marks=pytest.mark.slow)]


def evaluator(e: teg.Expr, backend: str = "numpy", **options: Any) -> Any:
    """Jax is asked for float32 where x64 is off, which costs nothing here."""
    return teg.compile(e, [V, t], backend=backend, **options)


def given(f: Any) -> dict[str, Any]:
    return {name: HERE[name] for name in f.parameters}


def both(f: Any) -> Any:
    """A batch of two, the second of other vertices."""
    return {**given(f), "V": np.stack([HERE["V"], HERE["V"] * 0.9])}


# -- errors ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", FAST)
@pytest.mark.parametrize("e", [CUT, NESTED, THROUGH, SQUARE], ids=["cut", "nested", "through", "square"])
def test_errors_of_results_that_are_right(e: teg.Expr, backend: str) -> None:
    f = evaluator(e, backend)
    value, error = f.value_and_error(given(f))
    assert 0.0 < error < 1e-10
    assert value == f(given(f))
    slopes, errors = f.grad_and_error(given(f))
    for name, slope in slopes.items():
        assert np.shape(errors[name]) == np.shape(slope)
        assert np.all(errors[name] < 1e-10)
        np.testing.assert_array_equal(slope, f.grad(given(f))[name])


@pytest.mark.parametrize("backend", FAST)
@pytest.mark.parametrize("order", [2, 3, 4, 6])
@pytest.mark.parametrize("e", [CUT, THROUGH, BREAK, ROOT, teg.tuple(THROUGH, t * CUT)], ids=["cut", "through", "break", "root", "tuple"])
def test_an_error_goes_on_through_sums_and_cells(e: teg.Expr, order: int, backend: str) -> None:
    """Too few nodes inside: the errors of the inner integrals reach the result, its gradient and every entry of it."""
    f, exact = evaluator(e, backend, rule="gauss", order=order), evaluator(e, backend, tol=1e-13)
    value, error = f.value_and_error(given(f))
    right, slopes_right = exact.value_and_grad(given(f))
    for v, err, r in zip(np.ravel(_flat(value)), np.ravel(_flat(error)), np.ravel(_flat(right)), strict=True):
        assert abs(v - r) <= err + 1e-13
        assert err < 1e3
    slopes, errors = f.grad_and_error(given(f))
    for name in slopes:
        for s, err, r in zip(_flat(slopes[name]), _flat(errors[name]), _flat(slopes_right[name]), strict=True):
            assert not (np.abs(s - r) > err + 1e-12).any()  # NaN is an error that is not known: a root of two nodes may be one of 0


def _flat(value: Any) -> list[Any]:
    return [leaf for entry in value for leaf in _flat(entry)] if isinstance(value, tuple) else [value]


def test_the_error_of_a_sum_is_the_sum_of_the_errors() -> None:
    term = teg.integral(teg.exp(x * W[k] * 4), (x, 0, 1))
    f = teg.compile(teg.sum(term, (k, 0, 2)), rule="gauss", order=4)
    (one, two) = (teg.compile(teg.integral(teg.exp(x * t * 4), (x, 0, 1)), rule="gauss", order=4).value_and_error(t=v)[1] for v in (1, 2))
    assert f.value_and_error(W=[1.0, 2.0])[1] == pytest.approx(one + two, rel=1e-6)


def test_roundings_of_long_sums() -> None:
    f = teg.compile(teg.sum(W[k], (k, 0, teg.length(W))))
    w = np.random.default_rng(0).normal(size=100_000) * 1e8
    value, error = f.value_and_error(W=w)
    from math import fsum

    assert abs(value - fsum(w)) <= error < 1e-12 * np.abs(w).sum()


def test_estimates_scatter_into_arrays_of_their_own() -> None:
    f = evaluator(CUT)
    program = f.program(1)
    more = with_array_error_estimates(program)
    assert len(more.outputs) == 2 * len(program.outputs)
    assert array_size(more) < 6 * array_size(program) + 40
    names = [r for s in steps(more.body) for r in ([s.index, *s.results] if isinstance(s, Loop) else getattr(s, "results", ()))]
    assert len(names) == len(set(names))


def test_jax_has_the_same_estimates() -> None:
    pytest.importorskip("jax")
    e = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * x * t, (x, 0, 1)), (k, 0, FACES))
    f, g = evaluator(e, "jax", dtype="float32"), evaluator(e, dtype="float32")
    np.testing.assert_allclose(f.value_and_error(given(f)), g.value_and_error(given(f)), rtol=1e-5)


@pytest.mark.parametrize("backend", FAST)
def test_a_missed_tolerance_is_told_with_its_estimate(backend: str) -> None:
    e = t * teg.sum(teg.integral(teg.bracket(x < 0.5) / teg.abs(x - V[k, 0]) ** 0.99, (x, 0, 1)), (k, 1, 2))
    f = evaluator(e, backend)
    with pytest.warns(teg.AccuracyWarning, match=r"the value misses the tolerance 1e-10 at t = 2: .*, error estimate \d"):
        value = f(given(f))
    assert f.value_and_error(given(f))[0] == value
    with pytest.warns(teg.AccuracyWarning, match=r"the derivative by (t|V\[\d, 0\]) misses"):
        f.grad(given(f))
    with pytest.raises(teg.AccuracyError, match="error estimate"):
        evaluator(e, backend, inaccurate="raise")(given(f))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        evaluator(e, backend, inaccurate="ignore")(given(f))
        f({**given(f), "t": np.nan})  # NaN in is NaN out


def test_the_element_that_misses_is_named() -> None:
    e = t * teg.sum(teg.integral(teg.bracket(x < 0.5) / teg.abs(x - W[k]) ** 0.99, (x, 0, 1)), (k, 0, 2))
    f = teg.compile(e, [t])
    with pytest.warns(teg.AccuracyWarning, match="at t = 7"):
        f(W=[[2.0, 3.0], [0.25, 3.0], [np.nan, 2.0]], t=[1.0, 7.0, 3.0])


@pytest.mark.parametrize("backend", FAST)
def test_integrals_that_are_sampled_say_so(backend: str) -> None:
    many = teg.vars("a b c d e f g")
    e = teg.sum(teg.integral(teg.exp(-W[k] * sum(v**4 for v in many)), *((v, 0, 1) for v in many)), (k, 0, 1))
    f = teg.compile(e, backend=backend)
    with pytest.warns(teg.AccuracyWarning, match=r"misses the tolerance(?s:.*)sampled"):
        value = f(W=[0.5])
    found, error = f.value_and_error(W=[0.5])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    exact = (np.exp(-0.5 * (0.5 + nodes / 2) ** 4) @ weights / 2) ** 7
    assert found == value
    assert abs(found - exact) < 4 * error < 1e-2


# -- diagnoses -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", FAST)
def test_ties_inside_iterations(backend: str) -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.bracket(x < V[F[k, 1], 0]) * teg.sin(x * t), (x, 0, 1)), (k, 0, FACES))
    f = evaluator(e, backend)
    assert f.diagnose(given(f)) == []
    vertices = HERE["V"].copy()
    vertices[2] = vertices[1]
    found = f.diagnose({**given(f), "V": np.stack([HERE["V"], vertices]), "F": np.stack([HERE["F"], HERE["F"][::-1]])})
    assert found
    assert {(d.kind, d.index, tuple(d.iteration.items())) for d in found} == {("tie", 1, (("k", 1),))}
    assert {s for d in found for s in d.surfaces} == {"V[F[k, 0], 0] - x = 0", "V[F[k, 1], 0] - x = 0"}
    assert found[0].parameters == {"t": 2.0, "V[F[k, 0], 0]": 0.375, "V[F[k, 1], 0]": 0.375}
    assert found[0].message.startswith("in the iteration k = 1: V[F[k,")
    assert str(found[0]).startswith("In element 1 of the batch, at t = 2, ")
    assert ", in the iteration k = 1: V[F[k," in str(found[0])


def test_a_pair_of_surfaces_is_told_once_and_names_that_programs_use_are_kept() -> None:
    v1 = teg.param("v1")
    e = teg.sum(teg.integral(teg.bracket((x < W[k]) & (x < v1 * v1) & (x < 3 * v1)), (x, 0, 1)), (k, 0, teg.length(W)))
    (found,) = teg.compile(e).diagnose(v1=0.5, W=[0.25, 0.7])
    assert set(found.surfaces) == {"W[k] - x = 0", "v1² - x = 0"}
    assert found.parameters == {"v1": 0.5, "W[k]": 0.25}


def test_a_tie_two_sums_deep_names_both_indices() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[k, 0]) * teg.bracket(x < V[j, 1]), (x, 0, 1)), (j, 0, 4), (k, 0, 4))
    f = teg.compile(e, [V])
    found = f.diagnose(V=[[0.1, 0.2], [0.3, 0.4], [0.5, 0.3], [0.7, 0.8]])
    assert {tuple(d.iteration.items()) for d in found} == {(("k", 1), ("j", 2))}


def test_surfaces_that_merely_cross_are_no_tie() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[k, 0]) * teg.bracket(y < V[k, 1]), (x, 0, 1), (y, 0, 1)), (k, 0, 2))
    f = teg.compile(e, [V])
    assert f.diagnose(V=[[0.5, 0.5], [0.25, 0.25]]) == []


def test_conditions_on_parameters_alone() -> None:
    f = teg.compile(teg.sum(teg.where(V[k, 0] < t, V[k, 1], 2), (k, 0, teg.length(V))), [V, t])
    (found,) = f.diagnose({"V": HERE["V"], "t": 0.375})
    assert (found.kind, found.iteration, found.surfaces) == ("parameter surface", {"k": 1}, ("t - V[k, 0] = 0",))
    f = teg.compile(teg.where(teg.sum(W[k], (k, 0, 2)) < t, t, 2 * t), [W, t])
    (found,) = f.diagnose(W=[0.25, 0.5], t=0.75)
    assert found.surfaces == ("t - (Σ[k: 0..2] W[k]) = 0",)
    assert teg.compile(teg.sum(teg.where(k < 2, W[k], 2), (k, 0, 4)), [W]).diagnose(W=np.ones(4)) == []  # an index is no parameter


def test_infinite_and_missing_derivatives_name_the_entry() -> None:
    f = teg.compile(teg.sum(teg.integral(teg.bracket(x * x < W[k]), (x, -1, 1)), (k, 0, 3)), [W])
    (found,) = f.diagnose(W=[0.5, 0.0, 0.25])
    assert found.kind == "infinite derivative"
    assert "by W[1]" in found.message
    (found,) = teg.compile(teg.sum(teg.log(W[k]), (k, 0, 3)), [W]).diagnose(W=[0.5, 0.25, -1.0])
    assert found.kind == "not a number"


@pytest.mark.slow
def test_a_one_sided_derivative() -> None:
    y = teg.var("y")
    bump = teg.integral(teg.bracket(x**4 - x * x + y * y < W[k]), (x, -2, 2), (y, -1, 1))
    f = teg.compile(teg.sum(bump, (k, 0, 2)), [W])
    assert f.diagnose(W=[0.25, -0.125]) == []
    (found,) = f.diagnose(W=[[0.25, -0.125], [0.5, -0.25]])  # two regions are born at ±√½
    assert (found.kind, found.index) == ("one-sided", 1)
    assert "the derivative by W[1] goes from" in found.message


def _below(points: teg.Expr) -> teg.Expr:
    return teg.integral(teg.bracket(points), (x, 0, 1))


@pytest.mark.parametrize(
    ("e", "places"),
    [
        (_below(teg.all(x < W[k], (k, 0, teg.length(W)))), [0.5, 0.5, 0.75]),
        (_below(teg.any(x < W[k], (k, 0, teg.length(W)))), [0.25, 0.5, 0.5, 0.25]),
        (teg.integral(teg.nearest(W[k], (x - W[k]) ** 2, (k, 0, teg.length(W))), (x, 0, 1)), [0.25, 0.75, 0.75]),
        (teg.minimum_of(W[k], (k, 0, teg.length(W))), [0.5, 0.5, 0.75]),
    ],
    ids=["all", "any", "nearest", "minimum_of"],
)
def test_equal_candidates_have_one_sided_derivatives(e: teg.Expr, places: list[float]) -> None:
    """Each of them alone moves the value to one side only."""
    f = teg.compile(e, [W])
    (found,) = f.diagnose(W=places)
    assert found.kind == "one-sided"
    apart = [v + 2.0**-10 * i for i, v in enumerate(places)]
    assert f.diagnose(W=apart) == []


def test_a_gradient_that_is_0_is_no_jump() -> None:
    """Sites in the middles of their cells: the least step changes the gradient, by as much as a smooth function's changes."""
    y, sites = teg.var("y"), teg.array("sites", 2)
    distance = (x - sites[k, 0]) ** 2 + (y - sites[k, 1]) ** 2
    f = teg.compile(teg.integral(teg.minimum_of(distance, (k, 0, teg.length(sites))), (x, 0, 1), (y, 0, 1)), [sites])
    assert f.diagnose(sites=[[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]]) == []


def test_a_count_does_not_move() -> None:
    f = teg.compile(teg.sum(W[k] ** 2, (k, 0, n)) / n, [W, n])
    assert f.diagnose(W=[2.0, 0.5, 0.25], n=3) == []


# -- explanations, checks --------------------------------------------------------------------------------------------------


def test_the_explanation_has_cells_and_loops() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]) * teg.sum(V[j, 1] * t, (j, 0, k + 1)), (x, 0, 1)), (k, 0, FACES))
    for report in (teg.explain(e), evaluator(e).explain(derivatives=1)):
        data = json.loads(json.dumps(report.data))
        assert [c["sums"] for c in data["cells"]] == [[], ["k: 0 .. length(F, 0)"], ["k: 0 .. length(F, 0)", "j: 0 .. k + 1"]]
        (surface,) = data["surfaces"]
        assert (surface["surface"], surface["owner"], surface["cell"]) == ("V[F[k, 0], 0] - x = 0", "∫ dx", 1)
        assert surface["family"]
        assert data["integrals"][0]["rule"] == "Gauss, exact"
        loops = data["loops"]["value and gradient"]
        assert [(r["index"], r["lower"], r["upper"], r["depth"]) for r in loops if r["depth"]] == [
            ("k", "0", "length(F, 0)", 1),
            ("j", "0", "k + 1", 2),
        ]
        assert all(r["scatters"] == ["V"] for r in loops if r["depth"])
        assert data["gradient_statements"] > data["value_statements"] > 0
        text = str(report)
        assert "surfaces that move in Σ k: 0 .. length(F, 0)" in text
        assert max(map(len, text.splitlines())) <= WIDTH
        assert "<table" in report._repr_html_()


def test_the_options_count_in_an_explanation() -> None:
    report = evaluator(CUT, rule="gauss", order=5, discontinuities="ignore").explain()
    assert report.data["integrals"][0]["rule"] == "Gauss, 5 nodes"
    assert report.data["surfaces"][0]["status"] == "ignored"


def test_an_explanation_for_lengths() -> None:
    assert "for lengths of 2." in " ".join(str(teg.explain(SQUARE)).split())
    f = evaluator(SQUARE)
    f(given(f))
    assert len(f.explain().data["surfaces"]) == 4
    assert "lengths of" not in str(f.explain())


def test_what_cannot_be_differentiated_is_said() -> None:
    moved = teg.sum(teg.integral(teg.bracket(teg.integral(teg.exp(x * y), (y, 0, 1)) < W[k]), (x, 0, 1)), (k, 0, 2))
    report = teg.explain(moved)
    assert report.data["gradient_error"]
    assert "No gradient" in str(report)


@pytest.mark.parametrize("backend", FAST)
@pytest.mark.parametrize("e", [CUT, NESTED, THROUGH, SQUARE, teg.tuple(CUT, SQUARE)], ids=["cut", "nested", "through", "square", "tuple"])
def test_check_gradient(e: teg.Expr, backend: str) -> None:
    f = evaluator(e, backend)
    report = teg.check_gradient(f, given(f))
    assert report
    assert {"t", "V, direction 1", "V, direction 2", "V, direction 3"} <= set(report.rows)
    assert sum(row.startswith("V[") for row in report.rows) >= 3
    wrong = teg.check_gradient(evaluator(e, backend, discontinuities="ignore"), given(f))
    assert wrong.ok == (e in (NESTED, THROUGH))


def test_check_gradient_of_what_it_cannot_check() -> None:
    f = evaluator(CUT)
    with pytest.raises(teg.TegError, match="give an array of 2 dimensions"):
        teg.check_gradient(f, both(f))
    with pytest.raises(teg.TegError, match="float64"):
        teg.check_gradient(evaluator(CUT, dtype="float32"), given(f))
    f = teg.compile(teg.sum(W[k] ** 2, (k, 0, n)) / n, [W, n])
    assert set(teg.check_gradient(f, W=[2.0], n=1).rows) == {"W[0]"}


# -- float32, batches, the rest ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_float32(backend: str) -> None:
    if backend == "jax":
        pytest.importorskip("jax")
    f, double = evaluator(CUT, backend, dtype="float32"), evaluator(CUT)
    value, slopes = f.value_and_grad(given(f))
    right, slopes_right = double.value_and_grad(given(f))
    assert f.dtype == "float32"
    assert (value.dtype, slopes["V"].dtype, slopes["t"].dtype) == ("float32",) * 3
    assert value == pytest.approx(right, rel=1e-6)
    np.testing.assert_allclose(slopes["V"], slopes_right["V"], rtol=1e-5, atol=1e-6)
    found, error = f.value_and_error(given(f))
    assert (found.dtype, error.dtype) == ("float32", "float32")
    assert abs(float(found) - right) <= error
    assert f.hvp(given(f), {"t": 1.0})["V"].dtype == "float32"
    assert f.value_and_grad(both(f))[1]["V"].shape == (2, 4, 2)


def test_float32_does_not_round_counts() -> None:
    f = teg.compile(teg.sum(1, (k, t, n)), [], dtype="float32")
    assert f(t=2**24, n=2**24 + 1) == 1.0


@pytest.mark.parametrize("backend", FAST)
def test_a_batch(backend: str) -> None:
    f = evaluator(CUT, backend)
    batch = both(f)
    one = {**batch, "V": batch["V"][1]}
    value, error = f.value_and_error(batch)
    assert value.shape == error.shape == (2,)
    assert (value[1], error[1]) == f.value_and_error(one)
    slopes, errors = f.grad_and_error(batch)
    assert slopes["V"].shape == errors["V"].shape == (2, 4, 2)
    np.testing.assert_allclose(slopes["V"][1], f.grad(one)["V"], rtol=1e-14)  # NumPy's sums over lanes round by their number
    hessian, second = f.hessian(batch), f.hessian(one)
    assert hessian["V", "V"].shape == (2, 4, 2, 4, 2)
    for pair in (("V", "V"), ("t", "V")):
        np.testing.assert_allclose(hessian[pair][1], second[pair], rtol=1e-14)


@pytest.mark.parametrize("backend", FAST)
def test_evaluations(backend: str) -> None:
    body = teg.bracket(x < V[F[k, 0], 0]) * teg.exp(x * x * V[F[k, 1], 1]) * teg.sin(x * t)  # no closed form
    f = evaluator(teg.sum(teg.integral(body, (x, 0, 1)), (k, 0, FACES)), backend)
    value, gradient, hessian = (f.evaluations(given(f), derivatives=d) for d in (0, 1, 2))
    assert 0 < value <= gradient < hessian
    assert f.evaluations(both(f)) > value
    with pytest.raises(teg.TegError, match="derivatives=3"):
        f.evaluations(given(f), derivatives=3)


@pytest.mark.parametrize("backend", FAST)
def test_the_rest(backend: str) -> None:
    f = evaluator(CUT, backend)
    copy = pickle.loads(pickle.dumps(f))
    assert copy(given(f)) == f(given(f)) == teg.evaluate(CUT, {V: HERE["V"], F: HERE["F"], t: 2.0}, backend=backend)
    assert repr(f).startswith("<teg.Evaluator(V, t, F) of Σ[k: 0..length(F, 0)]")
    assert len(f.source) > 500
    assert f.dimensions == {"V": 2, "t": 0, "F": 2}


def test_indices_keep_their_names_and_capture_nothing() -> None:
    """However they are called: the compiler's own names are made of the user's."""
    v = np.arange(6.0).reshape(3, 2)
    wanted = v[:, 0].sum() + sum(v[p, q] * (q + 1) * (p + 2) for p in range(3) for q in range(2))
    for outer, inner in (("k", "j"), ("k1", "k2"), ("k2", "k1"), ("k", "k′"), ("a", "k1")):
        a, b = teg.index(outer), teg.index(inner)
        e = teg.sum(V[a, 0], (a, 0, 3)) + teg.sum(V[a, b] * (b + 1) * (a + 2), (b, 0, 2), (a, 0, 3))
        f = teg.compile(e, [V])
        assert f(V=v) == wanted
        np.testing.assert_array_equal(f.grad(V=v)["V"], [[3, 4], [4, 6], [5, 8]])
    assert str(teg.grad(teg.sum(W[j], (j, 0, 3)), [W])) == "(Σ[j: 0..3] 1[W; j],)"


def test_latex() -> None:
    e = teg.sum(teg.integral(teg.bracket(x < V[F[k, 0], 0]), (x, 0, 1)) * (k + 1) ** 2, (k, 0, FACES))
    begin = r"\sum_{k = 0}^{\operatorname{length}_{0} F - 1} "
    bracket = r"\int_{0}^{1} \left[\,x < V_{F_{k, 0}, 0}\,\right] \,\mathrm{d}x"
    assert teg.latex(e) == begin + bracket + r" \, \left(k + 1\right)^{2}"
    assert e._repr_latex_() == f"${teg.latex(e)}$"
    assert teg.latex(teg.grad(teg.sum(W[k] ** 2, (k, 0, 3)), [W])[0]) == (r"\sum_{k = 0}^{2} 2 \, W_{k} \, \mathbf{1}^{W}_{k}")
    assert teg.latex(teg.sum(W[2 * k % 3 - (k // 2)], (k, 0, j + 1))) == (
        r"\sum_{k = 0}^{j} W_{\left(\left(2 \, k\right) \bmod 3\right) - \left\lfloor \frac{k}{2} \right\rfloor}"
    )
    assert teg.latex(teg.sum(W[k], (k, 0, n)) * t) == r"\left(\sum_{k = 0}^{n - 1} W_{k}\right) \, t"
    assert (k + 1)._repr_latex_() == "$k + 1$"


def test_dump_and_sympy() -> None:
    e = teg.sum(W[k] * t, (k, 0, n))
    assert teg.dump(e) == "%0 = mul(W[k], t)\n%1 = sum[k: 0..n](%0)\nresult %1"
    pytest.importorskip("sympy")
    for part, said in ((e, "entry of an array"), (teg.sum(t, (k, 0, 3)), "a sum over an index")):
        with pytest.raises(teg.TegError, match=said):
            teg.to_sympy(part)


# -- maps --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", FAST)
def test_maps_are_verified_in_iterations(backend: str) -> None:
    r, p = teg.vars("r p")
    polar = teg.Diffeomorphism(
        {x: r * teg.cos(p), y: r * teg.sin(p)},
        inverse={r: teg.sqrt(x * x + y * y), p: teg.atan2(y, x)},
        domain={r: (0, 3), p: (-np.pi, np.pi)},
    )
    disk = (teg.bracket(x * x + y * y < W[F[k, 0]]) + 0.125) * teg.exp(x * t)
    e = teg.sum(teg.integral(disk, (x, -W[k], W[k]), (y, -2, 2)), (k, 0, FACES))
    f = teg.compile(e, [W, t], backend=backend, maps=[polar])
    arguments: dict[str, Any] = {"W": [0.5, 1.0, 2.0], "F": HERE["F"], "t": 0.25}
    value, slopes = f.value_and_grad(arguments)
    plain, plain_slopes = teg.compile(e, [W, t], backend=backend).value_and_grad(arguments)
    assert value == pytest.approx(plain, rel=1e-12)
    np.testing.assert_allclose(slopes["W"], plain_slopes["W"], rtol=1e-9)
    far = {**arguments, "W": [[0.5, 1.0, 2.0], [0.5, 1.0, 5.0]]}
    with pytest.raises(teg.DiffeomorphismError, match=r"W\[k\] = 5, .* is beyond its domain"):
        f(far)
    teg.compile(e, [W, t], backend=backend, maps=[polar], check_maps=False)(far)


# -- every program ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_program(name: str) -> None:
    """Too few nodes: the estimates hold; right ones: they are small, as are those that nothing but roundings is in."""
    e = PROGRAMS[name]
    f, few = (teg.compile(e, [V, t], **o) for o in ({}, {"rule": "gauss", "order": 3}))
    values = {p: VALUES[p] for p in f.parameters}
    right, slopes_right = f.value_and_grad(values)
    for g, most in ((f, 1e-9), (few, np.inf)):
        value, error = g.value_and_error(values)
        slopes, errors = g.grad_and_error(values)
        assert abs(value - right) <= error + 1e-13
        assert error <= most
        for p in slopes:
            assert (np.abs(slopes[p] - slopes_right[p]) <= errors[p] + 1e-12).all()
            assert np.all(errors[p] <= most)
    assert teg.check_gradient(f, values)
    assert f.diagnose(values) == []
    report = f.explain(derivatives=1)
    assert report.data["gradient_error"] == ""
    assert max(map(len, str(report).splitlines())) <= WIDTH
    assert len(teg.latex(e)) > 10
