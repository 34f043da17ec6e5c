"""Programs in which one wrong sign, branch, factor or missing term shows, each with its answer on paper."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

import teg
from tests.bench.scenes import triangle_pixel

BACKENDS = ("numpy", *(("c",) if any(map(shutil.which, ("cc", "gcc", "clang"))) else ()))
x, y = teg.vars("x y")
t, a, p, s, w = teg.params("t a p s w")


UNSURE = pytest.mark.filterwarnings("ignore::teg.evaluator.accuracy.AccuracyWarning")
"""Values are checked; that the estimate of their errors is infinite, or that they are not numbers, is warned of."""


@UNSURE
@pytest.mark.parametrize("backend", BACKENDS)
def test_an_integral_from_infinity_with_a_slanted_surface_that_moves(backend: str) -> None:
    """-∫₀¹ (1 - e^(ay - t)) dy."""
    e = teg.integral(teg.bracket(x + a * y < t) * teg.exp(-x), (x, math.inf, 0), (y, 0, 1))
    f = teg.compile(e, [t], backend=backend)
    slope = -math.exp(-0.9) * (math.exp(0.4) - 1) / 0.4
    assert f(t=0.9, a=0.4) == pytest.approx(-1 - slope, rel=1e-11)
    assert f.grad(t=0.9, a=0.4)["t"] == pytest.approx(slope, rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_both_branches_around_sums_in_an_integral(backend: str) -> None:
    """Σ Aₖ t²/2 + Σ Aₖ² (1 - t³)/3."""
    k, A = teg.index("k"), teg.array("A", 1)
    total, squares = (teg.sum(u, (k, 0, teg.length(A, 0))) for u in (A[k] * x, (A[k] * x) ** 2))
    f = teg.compile(teg.integral(teg.where(x < t, total, squares), (x, 0, 1)), [t], backend=backend)
    value, gradient = f.value_and_grad(t=0.4, A=[0.5, 2.0])
    assert value == pytest.approx(2.5 * 0.16 / 2 + 4.25 * (1 - 0.064) / 3, rel=1e-13)
    assert gradient["t"] == pytest.approx(2.5 * 0.4 - 4.25 * 0.16, rel=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_sums_beside_factors_and_in_functions_in_an_integral(backend: str) -> None:
    """Σ Aₖ (t²/2 + t), and ∫₀¹ √(Σ Aₖ x) dx = 2/3 √Σ Aₖ."""
    k, A = teg.index("k"), teg.array("A", 1)
    parts = teg.sum(A[k] * teg.bracket(x < t), (k, 0, teg.length(A, 0)))
    f = teg.compile(teg.integral((x + 1) * parts, (x, 0, 1)), [t], backend=backend)
    assert f(t=0.4, A=[0.5, 2.0]) == pytest.approx(2.5 * (0.08 + 0.4), rel=1e-13)
    assert f.grad(t=0.4, A=[0.5, 2.0])["t"] == pytest.approx(2.5 * 1.4, rel=1e-13)
    g = teg.compile(teg.integral(teg.sqrt(teg.sum(A[k] * x, (k, 0, teg.length(A, 0)))), (x, 0, 1)), [A], backend=backend)
    value, gradient = g.value_and_grad(A=[0.5, 2.0])
    assert value == pytest.approx(2 / 3 * math.sqrt(2.5), rel=1e-9)
    np.testing.assert_allclose(gradient["A"], [1 / 3 / math.sqrt(2.5)] * 2, rtol=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_surface_in_both_branches(backend: str) -> None:
    """t(a + a²/2) + (1 - a)(t + t²/2)."""
    inner = teg.integral(teg.bracket(x < t), (x, 0, 1))
    weighted = teg.integral(teg.bracket(x < t) * (1 + x), (x, 0, 1))
    f = teg.compile(teg.integral(teg.where(y < a, inner * (1 + y), weighted), (y, 0, 1)), [t, a], backend=backend)
    gradient = f.grad(t=0.4, a=0.3)
    assert gradient["t"] == pytest.approx(0.3 + 0.045 + 0.7 * 1.4, rel=1e-12)
    assert gradient["a"] == pytest.approx(0.4 * 1.3 - (0.4 + 0.08), rel=1e-12)


@UNSURE
def test_a_moving_condition_on_steps_that_are_too_many() -> None:
    """The steps do not move, but the condition on them does: beyond the steps written out there is no derivative, and none is given."""
    e = teg.integral(teg.bracket(teg.floor(p * x) / p + x < t), (x, 0, 1))
    f = teg.compile(e, [t], backend="numpy")
    assert f.grad(t=0.9, p=3.0)["t"] == pytest.approx(1.0, rel=1e-12)
    assert math.isnan(f.grad(t=0.9, p=1e6)["t"])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_tie_within_the_rounding_errors_of_a_product(backend: str) -> None:
    """(√(10⁸ + p) - 10⁴)·s loses eight digits in its first factor, so w is equal to it as far as can be known."""
    e = teg.integral(teg.bracket(x < (teg.sqrt(1e8 + p) - 1e4) * s) * teg.bracket(x < w), (x, 0, 1))
    f = teg.compile(e, [s, w], backend=backend)
    exact = 1 / (math.sqrt(1e8 + 1) + 1e4) * 0.7
    assert f.grad(p=1.0, s=0.7, w=exact)["w"] == 0.5
    assert f.grad(p=1.0, s=0.7, w=exact * 1.01)["w"] == 0.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_not_a_number_ties_with_nothing(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x < t) * teg.bracket(x < a), (x, 0, 1)), [t, a], backend=backend)
    assert f.diagnose(t=math.nan, a=0.5) == [] or all(d.kind != "tie" for d in f.diagnose(t=math.nan, a=0.5))
    for at in ({"t": math.nan, "a": 0.5}, {"t": 0.5, "a": math.nan}):
        assert all(map(math.isnan, f.grad(at).values()))
    found = f.grad(t=np.array([0.5, math.nan, 0.2]), a=0.5)
    np.testing.assert_array_equal(found["t"], [0.5, math.nan, 1.0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_second_derivatives_over_a_surface_with_a_kink(backend: str) -> None:
    """The area below x = t - a|y - p| is t - a(p² + (1 - p)²)/2."""
    e = teg.integral(teg.bracket(x + a * teg.abs(y - p) < t), (x, 0, 1), (y, 0, 1))
    at = {"t": 0.8, "a": 0.5, "p": 0.3}
    found = teg.compile(e, [t, a, p], backend=backend).hessian(at)
    exact = {("p", "p"): -2 * 0.5, ("a", "p"): 1 - 2 * 0.3, ("a", "a"): 0.0, ("t", "p"): 0.0, ("t", "a"): 0.0, ("t", "t"): 0.0}
    for pair, value in exact.items():
        assert found[pair] == pytest.approx(value, abs=1e-12), pair


@pytest.mark.skipif(len(BACKENDS) == 1, reason="needs a C compiler")
@pytest.mark.parametrize("n", [7, 8, 9, 67])
def test_values_alone_of_a_batch_in_c(n: int) -> None:
    """Without derivatives: inside, outside, across an edge, and at ties, eight points side by side and those left over."""
    e, wrt = triangle_pixel(0)
    f, g = (teg.compile(e, wrt, backend=b) for b in ("c", "numpy"))
    rng = np.random.default_rng(n)
    at = {k: np.round(rng.uniform(-1.5, 2.0, n), 1) for k in f.parameters}
    found = f(at)
    np.testing.assert_allclose(found, g(at), rtol=1e-12, atol=1e-14)
    for i in range(n):
        assert f({k: v[i] for k, v in at.items()}) == found[i]
