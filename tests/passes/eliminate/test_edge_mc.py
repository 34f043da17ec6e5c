"""Edge sampling, uniform, stratified and by importance: unbiased, and a smaller variance where the docstring says so."""

from __future__ import annotations

import math
from typing import Any

import pytest

import teg
from teg.errors import EstimatorError, OptionError
from teg.ir.expr import Expr
from tests.passes.differentiate.test_estimators import SCENES, Scene, estimate, exact

x, y = teg.vars("x y")
t, a = teg.params("t a")
SAMPLINGS = ("stratified", "importance")
EDGES = 16


def bright_and_dim() -> Expr:
    """One edge of contrast 1 and fifteen of contrast 1/100, in other directions."""
    lines = [(1.0 if i == 0 else 0.01) * teg.bracket(math.cos(i) * x + math.sin(i) * y < t - 0.2 * math.sin(3 * i)) for i in range(EDGES)]
    return teg.integral(sum(lines) * teg.exp(x), (x, -1, 1), (y, -1, 1))


def error_of(scene: Scene, sampling: str, samples: int, **options: Any) -> float:
    """The standard error of the derivative by t."""
    return float(estimate(scene, "edge-mc", samples, estimator={"sampling": sampling, **options})[1]["t"])


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_all_ways_of_sampling_agree_with_the_exact_gradient(sampling: str, name: str) -> None:
    slopes, errors = estimate(SCENES[name], "edge-mc", 2**12, estimator={"sampling": sampling})
    for k, truth in exact(SCENES[name]).items():
        assert abs(slopes[k] - truth) < 4.5 * errors[k] + 1e-9


def test_errors_of_importance_sampling_fall_with_the_root_of_the_samples() -> None:
    scene = SCENES["wedge"]
    found = {n: estimate(scene, "edge-mc", n, estimator={"sampling": "importance"}) for n in (2**8, 2**14)}
    assert all(abs(slopes["t"] - exact(scene)["t"]) < 4.5 * errors["t"] for slopes, errors in found.values())
    assert 6 < found[2**8][1]["t"] / found[2**14][1]["t"] < 10.5  # 8


def test_importance_finds_the_edges_that_matter() -> None:
    scene = Scene(bright_and_dim() + 0 * a, {"t": 0.1, "a": 0.0})
    uniform = error_of(scene, "uniform", 2**10 // EDGES)  # as many points of edges in all
    assert error_of(scene, "importance", 2**10) < uniform / 2


def test_strata_reduce_the_error_of_a_smooth_contribution_by_more_than_their_number() -> None:
    scene = SCENES["half-plane"]
    few, many = (error_of(scene, "stratified", 2**10, parts=n) for n in (1, 8))
    assert error_of(scene, "uniform", 2**10) == pytest.approx(few, rel=0.1)
    assert 14 < few / many < 32  # 8^1.5 = 23


def test_an_edge_without_length_takes_no_samples_and_none_is_no_error() -> None:
    corner = teg.integral(teg.bracket((x < t) & (y < a)), (x, 0, 1), (y, 0, 1))
    for sampling in SAMPLINGS:
        f = teg.compile(corner, [t, a], discontinuities="edge-mc", samples=256, estimator={"sampling": sampling})
        assert f.grad(t=0.5, a=0.25) == pytest.approx({"t": 0.25, "a": 0.5}, abs=1e-12)  # constant along each edge
        assert f.grad(t=2.0, a=-1.0) == {"t": 0.0, "a": 0.0}


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_backends_and_rules_agree(sampling: str) -> None:
    scene = SCENES["wedge"]
    by_numpy, by_c = (estimate(scene, "edge-mc", 500, backend=b, estimator={"sampling": sampling})[0] for b in ("numpy", "c"))
    assert by_numpy == pytest.approx(by_c, rel=1e-9)
    assert estimate(scene, "edge-mc", 2**12, rule="qmc", estimator={"sampling": sampling, "parts": 2})[0] == pytest.approx(
        exact(scene), abs=2e-3
    )


def test_what_does_not_apply_is_an_error() -> None:
    for options in ({"sampling": "random"}, {"parts": 0}, {"parts": 65}, {"edges": 2}):
        with pytest.raises(OptionError):
            teg.compile(bright_and_dim(), [t], discontinuities="edge-mc", estimator=options)
    inside = teg.integral(teg.sin(teg.integral(teg.bracket(y < t * x), (y, 0, 1))), (x, 0, 1))
    with pytest.raises(EstimatorError, match="no integral over a box"):
        teg.compile(inside, [t], discontinuities="edge-mc", estimator={"sampling": "importance"}).grad(t=0.5)
