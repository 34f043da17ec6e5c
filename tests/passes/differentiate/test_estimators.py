"""Estimators of discontinuous derivatives: each has the bias, the rate and the limits that its docstring states."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import pytest

import teg
from teg.errors import EstimatorError, OptionError
from teg.ir.expr import Expr, Param, Var
from teg.ir.integral import Integral
from teg.ir.traverse import substitute
from teg.passes.differentiate.estimators.nests import Cube, cubes_of
from teg.passes.differentiate.estimators.warp import known_field, velocity
from teg.pipeline import ESTIMATORS, normal_form

x, y, z = teg.vars("x y z")
t, a = teg.params("t a")
SAMPLES = 2**14


class Scene(NamedTuple):
    program: Expr
    values: dict[str, float]


UNIT = (0, 1)
SCENES = {
    "one variable": Scene(teg.integral(teg.bracket(x < t) * teg.exp(a * x), (x, 0, 1)), {"t": 0.4, "a": 0.7}),
    "half-plane": Scene(teg.integral(teg.bracket(x + a * y < t) * teg.exp(x), (x, 0, 1), (y, 0, 1)), {"t": 0.9, "a": 0.7}),
    "disk": Scene(teg.integral(teg.bracket((x - a) ** 2 + y * y < t * t) * teg.exp(x), (x, -1, 1), (y, -1, 1)), {"t": 0.6, "a": 0.1}),
    "wedge": Scene(teg.integral(teg.bracket((x < t * y) & (x + y > a)) * (1 + x), (x, 0, 1), (y, 0, 1)), {"t": 0.8, "a": 0.5}),
    "parabola": Scene(teg.integral(teg.bracket(y < t + a * x * x), (y, 0, 1), (x, -1, 1)), {"t": 0.3, "a": 0.4}),
    "moving bounds": Scene(teg.integral(teg.bracket(x > a) * x, (x, 0, t * y), (y, 0, 1)), {"t": 0.9, "a": 0.2}),
    "plane": Scene(teg.integral(teg.bracket(x + y + a * z < t), (x, 0, 1), (y, 0, 1), (z, 0, 1)), {"t": 1.2, "a": 0.6}),
    "a function of it": Scene(teg.exp(teg.integral(teg.bracket(x * x < t) * a, (x, 0, 1))) * t, {"t": 0.4, "a": 0.7}),
}
UNBIASED = ("edge-mc", "warp")


def exact(scene: Scene) -> dict[str, float]:
    return _exact(scene.program, tuple(scene.values.items()))


@functools.cache
def _exact(program: Expr, values: tuple[tuple[str, float], ...]) -> dict[str, float]:
    return teg.compile(program, [t, a]).grad(dict(values))  # type: ignore[no-any-return]


def estimate(scene: Scene, name: str, samples: int | None = SAMPLES, **options: Any) -> tuple[dict[str, float], dict[str, float]]:
    """The gradient of a scene by an estimator, and its standard errors."""
    f = teg.compile(scene.program, [t, a], discontinuities=name, samples=samples, **options)
    return f.grad_and_error(**scene.values)


def worst(scene: Scene, name: str, **options: Any) -> float:
    """The largest error of a gradient, in standard errors."""
    slopes, errors = estimate(scene, name, **options)
    return max(abs(slopes[k] - truth) / max(errors[k], 1e-12) for k, truth in exact(scene).items())


# -- unbiased ones -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("name", UNBIASED)
def test_unbiased_estimators_agree_with_the_exact_gradient_within_their_standard_error(name: str, scene: Scene) -> None:
    assert worst(scene, name) < 4.5
    _, errors = estimate(scene, name)
    assert all(e < 0.25 * max(abs(v) for v in exact(scene).values()) for e in errors.values())  # not just a large error


@pytest.mark.parametrize("name", UNBIASED)
def test_the_error_of_an_unbiased_estimator_falls_with_the_root_of_the_samples(name: str) -> None:
    scene = SCENES["wedge"]
    slopes = {n: [estimate(scene, name, n, seed=s)[0]["t"] for s in range(8)] for n in (2**8, 2**14)}
    spread = {n: math.sqrt(sum((v - exact(scene)["t"]) ** 2 for v in found) / 8) for n, found in slopes.items()}
    assert 3 < spread[2**8] / spread[2**14] < 20  # 8 in the limit, of 8 seeds


def test_quasi_random_points_make_edge_sampling_converge_faster() -> None:
    scene = SCENES["disk"]
    truth = exact(scene)
    slopes, errors = estimate(scene, "edge-mc", rule="qmc")
    _, plain = estimate(scene, "edge-mc")
    assert all(errors[k] < plain[k] / 20 for k in truth)
    assert all(abs(slopes[k] - truth[k]) < 6 * errors[k] for k in truth)


@pytest.mark.parametrize("name", ["differences", "spsa", "edge-mc", "warp", "warp-blur", "smooth"])
@pytest.mark.parametrize("scene", [SCENES["disk"], SCENES["plane"]], ids=["disk", "plane"])
def test_backends_agree(scene: Scene, name: str) -> None:
    by_numpy, by_c = (estimate(scene, name, 1000, backend=b) for b in ("numpy", "c"))
    for mine, other in zip(by_numpy, by_c, strict=True):
        assert all(math.isclose(mine[k], other[k], rel_tol=1e-8, abs_tol=1e-10) for k in mine)


@pytest.mark.parametrize("scale", [1e-100, 1e100])
def test_edge_sampling_works_at_any_scale(scale: float) -> None:
    disk = teg.integral(teg.bracket(x * x + y * y < t * t), (x, -2 * scale, 2 * scale), (y, -2 * scale, 2 * scale))
    slopes, errors = teg.compile(disk, [t], discontinuities="edge-mc", rule="qmc", samples=2**12).grad_and_error(t=scale)
    assert abs(slopes["t"] - 2 * math.pi * scale) < 6 * errors["t"] < 0.02 * scale


# -- coincident edges --------------------------------------------------------------------------------------------------

SHARED = {
    "one surface in other words": teg.bracket(x > t) * teg.bracket(teg.log(x) > teg.log(t)),
    "both sides of one edge": teg.bracket(x + y < 2 * t) + 3 * teg.bracket(x + y >= 2 * t),
    "edges that only cross": teg.bracket((x < t) & (y < a)) + teg.bracket((x >= t) & (y < a)) * 2,
    "edges that coincide at this parameter": teg.bracket(x + y < 2 * t) * teg.bracket(x + y < 2 * a),
}


@pytest.mark.parametrize("body", SHARED.values(), ids=SHARED)
def test_edge_sampling_counts_coincident_edges_rightly(body: Expr) -> None:
    scene = Scene(teg.integral(body * (1 + y), (x, 0, 1), (y, 0, 1)), {"t": 0.375, "a": 0.375})
    slopes, errors = estimate(scene, "edge-mc", rule="qmc")
    for k, truth in exact(scene).items():
        assert abs(slopes[k] - truth) < 5 * errors[k] + 1e-9


# -- biased ones -------------------------------------------------------------------------------------------------------


def test_ignoring_loses_the_whole_derivative_of_an_area() -> None:
    slopes, errors = estimate(Scene(teg.integral(teg.bracket(x < t) + a * x, (x, 0, 1)), {"t": 0.4, "a": 0.5}), "ignore")
    assert slopes["t"] == 0.0
    assert abs(slopes["a"] - 0.5) < 4.5 * errors["a"]


@pytest.mark.parametrize(("power", "step", "bias"), [(3, 0.1, 0.1**2), (5, 0.1, 10 * 0.5**2 * 0.1**2 + 0.1**4)])
def test_central_differences_have_their_bias(power: int, step: float, bias: float) -> None:
    program = teg.integral(teg.bracket(x < t) * power * x ** (power - 1), (x, 0, 1))  # t^power
    f = teg.compile(program, [t], discontinuities="differences", rule="adaptive", estimator={"step": step})
    assert f.grad(t=0.5)["t"] == pytest.approx(power * 0.5 ** (power - 1) + bias, rel=1e-9)


def test_extrapolation_leaves_the_fourth_order() -> None:
    program = teg.integral(teg.bracket(x < t) * 5 * x**4, (x, 0, 1))
    options: Any = {"step": 0.1, "richardson": True}
    f = teg.compile(program, [t], discontinuities="differences", rule="adaptive", estimator=options)
    assert f.grad(t=0.5)["t"] == pytest.approx(5 * 0.5**4 - 4 * 0.1**4, rel=1e-9)  # t⁵: -h⁴·120/30


def test_the_step_of_differences_follows_the_samples_and_the_tolerance() -> None:
    def step(**options: Any) -> float:
        f = teg.compile(SCENES["disk"].program, [t], discontinuities="differences", **options)
        return f._options.estimator.step  # type: ignore[attr-defined, no-any-return]

    assert step(samples=2**10) == pytest.approx(0.25)
    assert step(rule="adaptive", tol=1e-9) == pytest.approx(1e-3)
    assert step(rule="adaptive", tol=1e-10, estimator={"richardson": True}) == pytest.approx(1e-2)
    assert step(samples=100, estimator={"step": 0.02}) == 0.02


def test_differences_of_samples_are_right_but_for_their_bias() -> None:
    scene = SCENES["half-plane"]
    assert worst(scene, "differences", estimator={"step": 0.02}) < 4.5
    errors = [estimate(scene, "differences", estimator={"step": h})[1]["t"] for h in (0.08, 0.02)]
    assert 1.6 < errors[1] / errors[0] < 2.5  # 2: the variance goes with 1/h


def test_random_signs_have_the_bias_of_mixed_derivatives() -> None:
    program = teg.integral((x + t) * (x + a) ** 2, (x, 0, 1))
    f = teg.compile(program, [t, a], discontinuities="spsa", rule="adaptive", estimator={"step": 0.125})
    assert f.grad(t=0.3, a=0.5)["t"] == pytest.approx((1.5**3 - 0.5**3) / 3 + 0.125**2, rel=1e-12)  # 3·I_taa·h²/6 = h²
    assert worst(SCENES["half-plane"], "spsa", estimator={"step": 0.02}) < 4.5


def test_softened_conditions_converge_as_their_width_does() -> None:
    program = teg.integral(teg.bracket(x < t) * teg.exp(x), (x, 0, 1))
    errors = []
    for sigma in (0.04, 0.02, 0.01):
        f = teg.compile(program, [t], discontinuities="smooth", sigma=sigma, rule="adaptive")
        errors.append(f.grad(t=0.5)["t"] - math.exp(0.5))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)  # σ²
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)
    assert errors[2] == pytest.approx(math.exp(0.5) * math.pi**2 / 6 * 0.01**2, rel=0.01)  # half the variance of the logistic density


def test_softened_conditions_with_samples_converge_to_the_softened_integral() -> None:
    scene = SCENES["wedge"]
    assert worst(scene, "smooth", samples=2**18, sigma=0.004) < 5


def test_softened_conditions_vanish_below_the_spacing_of_the_samples() -> None:
    f = teg.compile(SCENES["disk"].program, [t], discontinuities="smooth", samples=64, sigma=1e-7)
    assert abs(f.grad(**SCENES["disk"].values)["t"]) < 1e-12


def test_the_value_is_not_softened() -> None:
    scene = SCENES["one variable"]
    f = teg.compile(scene.program, [t, a], discontinuities="smooth", sigma=0.2, rule="adaptive")
    assert f(**scene.values) == pytest.approx(teg.compile(scene.program)(**scene.values), rel=1e-12)


def test_kinks_are_not_softened() -> None:
    f = teg.compile(teg.integral(teg.abs(x - t), (x, 0, 1)), [t], discontinuities="smooth", sigma=0.3, rule="adaptive")
    assert f.grad(t=0.3)["t"] == pytest.approx(2 * 0.3 - 1, abs=1e-12)


def test_blurred_velocities_are_biased_by_their_width() -> None:
    scene = SCENES["half-plane"]
    truth, bias = exact(scene)["t"], []
    for sigma in (0.2, 0.05):
        slopes, errors = estimate(scene, "warp-blur", 2**17, sigma=sigma)
        bias.append(truth - slopes["t"])
        assert bias[-1] > 5 * errors["t"]
    assert bias[1] < bias[0] / 2


def test_blurring_a_translation_far_from_the_sides_has_no_bias() -> None:
    scene = Scene(teg.integral(teg.bracket(x < t) * (1 + a * x), (x, 0, 1)), {"t": 0.5, "a": 1.0})
    assert worst(scene, "warp-blur", samples=2**17, sigma=0.03) < 4.5


def test_auxiliary_points_are_biased_by_their_number() -> None:
    scene = SCENES["half-plane"]
    truth = exact(scene)["t"]
    bias = {m: truth - estimate(scene, "warp", estimator={"auxiliary": m})[0]["t"] for m in (2, 8)}
    assert bias[2] > 0.3  # of 1.77
    assert 2.4 < bias[2] / bias[8] < 6.5  # 4: the bias of a quotient of means


def test_random_truncation_has_the_bias_of_its_last_term_only() -> None:
    scene = SCENES["one variable"]
    many, _ = estimate(scene, "warp", 2**16, estimator={"auxiliary": 8})
    truncated, errors = estimate(scene, "warp", 2**16, estimator={"levels": 3})
    assert abs(truncated["t"] - many["t"]) < 4.5 * errors["t"]


# -- velocity fields ---------------------------------------------------------------------------------------------------


def cube_of(scene: Scene) -> Cube:
    normal = normal_form(scene.program)
    assert isinstance(normal, Integral)
    (cube,) = cubes_of(normal)
    return cube


def at(e: Expr, point: dict[Var, float], values: dict[str, float]) -> float:
    number = substitute(e, {v: teg.ir.expr.const(c) for v, c in point.items()})  # type: ignore[attr-defined]
    return float(teg.evaluate(number, values))


@pytest.mark.parametrize("angle", [0.3, 1.9, 4.4])
def test_the_field_of_a_warp_has_the_velocity_of_the_boundary(angle: float) -> None:
    scene = SCENES["disk"]
    cube = cube_of(scene)
    (g,) = cube.surfaces
    u, v = cube.variables
    centre, radius = scene.values["a"], scene.values["t"] + 1e-5  # just outside of the disk
    where = {"x": centre + radius * math.cos(angle), "y": radius * math.sin(angle)}
    outer, inner = ("y", "x")  # the outermost variable first
    point = {u: (where[outer] + 1) / 2, v: (where[inner] + 1) / 2}
    for p in (t, a):
        field = [at(c, point, scene.values) for c in known_field(cube, p, 2)]
        wanted = [at(c, point, scene.values) for c in velocity(g, p, cube.variables)]
        assert field == pytest.approx(wanted, abs=1e-6)
    assert [2 * c for c in [at(c, point, scene.values) for c in velocity(g, t, cube.variables)]] == pytest.approx(
        [math.sin(angle), math.cos(angle)], abs=1e-4
    )


def test_the_field_of_a_warp_vanishes_on_the_sides() -> None:
    scene = SCENES["half-plane"]
    cube = cube_of(scene)
    u, v = cube.variables
    for point, i in (({u: 1e-6, v: 0.3}, 0), ({u: 1 - 1e-6, v: 0.8}, 0), ({u: 0.6, v: 1e-6}, 1)):
        assert abs(at(known_field(cube, t, 2)[i], point, scene.values)) < 1e-9


# -- programs ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in ESTIMATORS if n not in ("ignore", "warp-blur")])
def test_integrals_to_infinity_and_tuples(name: str) -> None:
    tail = teg.integral(teg.bracket(x > t) * teg.exp(-x), (x, 0, math.inf))
    f = teg.compile(teg.tuple(tail, t * tail), [t], discontinuities=name, **({} if name == "exact" else {"samples": 2**14}))  # type: ignore[arg-type]
    slopes, errors = f.grad_and_error(t=0.7)
    for slope, error, truth in zip(slopes["t"], errors["t"], (-math.exp(-0.7), 0.3 * math.exp(-0.7)), strict=True):
        assert abs(slope - truth) < 4.5 * error + 0.02 * abs(truth) + 1e-9


def test_sift_is_another_name_of_exact() -> None:
    scene = SCENES["disk"]
    assert teg.compile(scene.program, [t], discontinuities="sift").grad(**scene.values) == teg.compile(scene.program, [t]).grad(
        **scene.values
    )


def test_a_seed_decides_the_samples() -> None:
    first, again, other = (estimate(SCENES["disk"], "warp", 256, seed=s)[0]["t"] for s in (1, 1, 2))
    assert first == again != other


def test_a_program_without_the_parameter_has_slope_zero() -> None:
    program = teg.integral(teg.bracket(x < t), (x, 0, 1))
    for name in ESTIMATORS:
        assert teg.compile(program, [t, a], discontinuities=name).grad(t=0.5, a=1.0)["a"] == 0.0


def test_an_explanation_says_that_a_surface_is_estimated() -> None:
    f = teg.compile(SCENES["disk"].program, [t], discontinuities="warp", samples=64)
    assert [s["status"] for s in f.explain().data["surfaces"]] == ["estimated"]
    assert "discontinuities='warp'" in str(f.explain())
    assert teg.explain(SCENES["disk"].program, [t], discontinuities="sift").data["options"]["discontinuities"] == "exact"


# -- what does not apply -----------------------------------------------------------------------------------------------

SAMPLED = [name for name, e in ESTIMATORS.items() if not e.has_all_orders]
HALF = SCENES["half-plane"].program
k = teg.index("k")
NESTED = teg.integral(teg.sin(teg.integral(teg.bracket(y < t * x), (y, 0, 1))), (x, 0, 1))


@pytest.mark.parametrize("name", SAMPLED)
def test_what_an_estimator_does_not_do_is_an_error(name: str) -> None:
    f = teg.compile(HALF, [t], discontinuities=name)
    with pytest.raises(EstimatorError):
        f.hessian(t=0.5, a=1.0)
    with pytest.raises(EstimatorError):
        f.hvp({"t": 0.5, "a": 1.0}, {"t": 1.0})
    V = teg.array("V")
    nearest = teg.nearest(k, (x - V[k]) ** 2, (k, 0, teg.length(V)))
    with pytest.raises(EstimatorError, match="choices among data"):
        teg.compile(teg.integral(nearest, (x, 0, 1)), discontinuities=name).grad(V=[0.2, 0.6])
    with pytest.raises(EstimatorError):
        teg.compile(HALF, [t], backend="jax", discontinuities=name)
    with pytest.raises(EstimatorError):
        teg.compile(teg.integral(teg.delta(x - t), (x, 0, 1)), [t], discontinuities=name).grad(t=0.5)


@pytest.mark.parametrize("name", SAMPLED)
def test_sums_over_arrays_are_estimated_cell_by_cell(name: str) -> None:
    V = teg.array("V", 2)
    strips = teg.sum(teg.integral(teg.bracket((x > V[k, 0]) & (x < V[k, 1])) * (1 + x), (x, 0, 1)), (k, 0, teg.length(V, 0)))
    ends = [[0.25, 0.5], [0.375, 0.875]]
    slopes, errors = teg.compile(strips**2, [V], discontinuities=name, samples=2**13).grad_and_error(V=ends)
    truth = teg.compile(strips**2, [V]).grad(V=ends)["V"]
    biased = 0.1 if name in ("warp-blur", "differences", "spsa", "smooth") else 0.0
    assert (abs(slopes["V"] - truth) < 4.5 * errors["V"] + biased * abs(truth) + 1e-9).all()


@pytest.mark.parametrize("name", ["spsa", "warp", "warp-blur"])
def test_an_integral_inside_a_function_of_another_one_is_no_box(name: str) -> None:
    with pytest.raises(EstimatorError, match="no integral over a box"):
        teg.compile(NESTED, [t], discontinuities=name).grad(t=0.5)


@pytest.mark.parametrize(
    "options",
    [
        {"discontinuities": "sharp"},
        {"discontinuities": "exact", "samples": 100},
        {"discontinuities": "exact", "sigma": 0.1},
        {"discontinuities": "smooth", "sigma": 0.0},
        {"discontinuities": "smooth", "samples": 0},
        {"discontinuities": "smooth", "samples": 10, "order": 10},
        {"discontinuities": "smooth", "samples": 10, "rule": "adaptive"},
        {"discontinuities": "warp", "estimator": {"auxiliary": 2, "levels": 2}},
        {"discontinuities": "warp", "estimator": {"power": 0}},
        {"discontinuities": "warp-blur", "estimator": {"auxiliary": 0}},
        {"discontinuities": "differences", "estimator": {"steps": 1}},
        {"discontinuities": "differences", "estimator": {"richardson": 2}},
    ],
)
def test_options_are_checked(options: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        teg.compile(HALF, [t], **options)


def test_nests_of_four_integrals_are_differentiated_without_warping() -> None:
    w = teg.var("w")
    deep = teg.integral(teg.bracket(x + y + z + w < t), (x, 0, 1), (y, 0, 1), (z, 0, 1), (w, 0, 1))
    with pytest.raises(EstimatorError, match="up to 3"):
        teg.compile(deep, [t], discontinuities="warp").grad(t=1.5)
    scene = Scene(deep + 0 * Param.make("a", ()), {"t": 1.5, "a": 0.0})
    truth = (1.5**3 - 4 * 0.5**3) / 6
    slopes, errors = estimate(scene, "differences", 2**14, estimator={"step": 0.05})
    assert abs(slopes["t"] - truth) < 4.5 * errors["t"]


def test_functions_of_jax_have_no_estimators() -> None:
    pytest.importorskip("jax")
    with pytest.raises(EstimatorError, match="JAX"):
        teg.jax_function(HALF, params=[t], discontinuities="edge-mc")
    assert teg.jax_function(HALF, params=[t], discontinuities="sift").parameters == ("t", "a")


def test_parameters_may_have_the_names_of_coordinates() -> None:
    u0 = teg.param("u0")
    program = teg.integral(teg.bracket(x < u0) * (1 + x), (x, 0, 1))
    for name in SAMPLED:
        slopes, errors = teg.compile(program, [u0], discontinuities=name, samples=2**14).grad_and_error(u0=0.5)
        assert abs(slopes["u0"] - 1.5) < 4.5 * errors["u0"] + 0.01
