"""Random programs: value against an independent integrator, derivatives against differences, laws that must hold."""

from __future__ import annotations

import os
from typing import cast

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings

import teg
from teg.ir.traverse import substitute
from tests.end_to_end.strategies import Scene, scenes, x, y

TOLERANCE = 1e-9


def examples(n: int) -> settings:
    """n examples (TEG_EXAMPLES times as many to hunt for faults), the same ones in CI every time."""
    return settings(
        max_examples=n * int(os.environ.get("TEG_EXAMPLES", "1")),
        deadline=None,
        derandomize=bool(os.environ.get("CI")),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        print_blob=True,
    )


def close(a: object, b: object, tolerance: float = TOLERANCE) -> None:
    np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=tolerance, atol=tolerance)


def compiled(e: teg.Expr, scene: Scene, backend: str = "numpy") -> teg.Evaluator:
    return teg.compile(e, cast("list[teg.ir.expr.Param]", scene.parameters), backend=backend)


def gradient(e: teg.Expr, scene: Scene) -> list[float]:
    g = compiled(e, scene).grad(scene.values)
    return [float(g[k]) for k in scene.values]


# -- value and derivative -----------------------------------------------------------------------------------------------


@given(scenes(1))
@examples(30)
def test_value_in_one_variable(scene: Scene) -> None:
    close(compiled(scene.expression, scene)(scene.values), scene.reference())


@given(scenes(2))
@examples(10)
def test_value_in_two_variables(scene: Scene) -> None:
    close(compiled(scene.expression, scene)(scene.values), scene.reference())


@given(scenes(1))
@examples(15)
def test_gradient_in_one_variable(scene: Scene) -> None:
    f = compiled(scene.expression, scene)
    assume(not f.diagnose(scene.values))
    report = teg.check_gradient(f, scene.values, tol=1e-6)
    assert report, str(report)


@pytest.mark.slow
@given(scenes(2))
@examples(6)
def test_gradient_in_two_variables(scene: Scene) -> None:
    f = compiled(scene.expression, scene)
    assume(not f.diagnose(scene.values))
    report = teg.check_gradient(f, scene.values, tol=1e-5)
    assert report, str(report)


@given(scenes(1))
@examples(15)
def test_forward_equals_reverse(scene: Scene) -> None:
    e = scene.expression
    forward = teg.evaluate(teg.tuple(*(teg.diff(e, p) for p in scene.parameters)), scene.values)  # type: ignore[arg-type]
    close(forward, gradient(e, scene), 1e-11)


@given(scenes(2))
@examples(5)
def test_forward_equals_reverse_in_two_variables(scene: Scene) -> None:
    e = scene.expression
    forward = teg.evaluate(teg.tuple(*(teg.diff(e, p) for p in scene.parameters)), scene.values)  # type: ignore[arg-type]
    close(forward, gradient(e, scene))


@given(scenes(1))
@examples(5)
def test_the_hessian_is_symmetric_and_the_derivative_of_the_gradient(scene: Scene) -> None:
    e = scene.expression
    f = compiled(e, scene)
    assume(not f.diagnose(scene.values))
    h = f.hessian(scene.values)
    names = list(scene.values)
    close([h[a, b] for a in names for b in names], [h[b, a] for a in names for b in names], 1e-8)
    first = compiled(teg.diff(e, scene.parameters[0]), scene)  # type: ignore[arg-type]
    close([h["p0", b] for b in names], [first.grad(scene.values)[b] for b in names], 1e-8)


# -- backends -----------------------------------------------------------------------------------------------------------


@given(scenes(1))
@examples(4)
def test_c_agrees_with_numpy_in_one_variable(scene: Scene) -> None:
    agree(scene, "c")


@pytest.mark.slow
@given(scenes(2))
@examples(4)
def test_c_agrees_with_numpy_in_two_variables(scene: Scene) -> None:
    agree(scene, "c")


@pytest.mark.slow
@given(scenes(1))
@examples(4)
def test_jax_agrees_with_numpy(scene: Scene) -> None:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        agree(scene, "jax")
    finally:
        jax.config.update("jax_enable_x64", before)


def agree(scene: Scene, backend: str) -> None:
    one, other = (compiled(scene.expression, scene, b) for b in ("numpy", backend))
    batch = {k: v + np.linspace(0, 0.2, 3) for k, v in scene.values.items()}
    value, derivative = one.value_and_grad(batch)
    value2, derivative2 = other.value_and_grad(batch)
    close(value2, value, 1e-12)
    for k in derivative:
        close(derivative2[k], derivative[k], 1e-11)


# -- laws ---------------------------------------------------------------------------------------------------------------


def same(e: teg.Expr, other: teg.Expr, scene: Scene, tolerance: float = TOLERANCE) -> None:
    """Equal in value and gradient."""
    assume(not compiled(e, scene).diagnose(scene.values))
    close(compiled(other, scene)(scene.values), compiled(e, scene)(scene.values), tolerance)
    close(gradient(other, scene), gradient(e, scene), 10 * tolerance)


@given(scenes(1))
@examples(7)
def test_translation(scene: Scene) -> None:
    x0, x1, _, _ = scene.box
    shifted = cast(teg.Expr, substitute(scene.integrand, {x: x - 3}))
    same(scene.expression, teg.integral(shifted, (x, x0 + 3, x1 + 3)), scene)


@pytest.mark.slow
@given(scenes(2))
@examples(4)
def test_the_order_of_integration(scene: Scene) -> None:
    x0, x1, y0, y1 = scene.box
    same(scene.expression, teg.integral(scene.integrand, (y, y0, y1), (x, x0, x1)), scene)


@pytest.mark.parametrize("factor", [1e8, 1e-8, -1.0])
def test_scaling(factor: float) -> None:
    @given(scenes(1))
    @examples(5)
    def law(scene: Scene) -> None:
        x0, x1, _, _ = scene.box
        stretched = cast(teg.Expr, substitute(scene.integrand, {x: x / factor})) / factor
        same(scene.expression, teg.integral(stretched, (x, x0 * factor, x1 * factor)), scene)

    law()


@given(scenes(2))
@examples(4)
def test_scaling_one_axis_of_two(scene: Scene) -> None:
    x0, x1, y0, y1 = scene.box
    stretched = cast(teg.Expr, substitute(scene.integrand, {x: 1e8 * x, y: 1e-8 * y}))
    same(scene.expression, teg.integral(stretched, (x, x0 * 1e-8, x1 * 1e-8), (y, y0 * 1e8, y1 * 1e8)), scene)


@given(scenes(2), scenes(2))
@examples(4)
def test_partition_of_unity(scene: Scene, other: Scene) -> None:
    conditions = [a for a in teg.analysis.surfaces.atoms_of(other.integrand) if a.g.free]
    c = conditions[0]
    parts = scene.over(scene.integrand * teg.bracket(c)) + scene.over(scene.integrand * teg.bracket(~c))
    same(scene.expression, parts, scene)


@given(scenes(1))
@examples(7)
def test_reversed_bounds_flip_the_sign(scene: Scene) -> None:
    x0, x1, _, _ = scene.box
    same(scene.expression, -teg.integral(scene.integrand, (x, x1, x0)), scene)


@given(scenes(1))
@examples(7)
def test_a_domain_is_the_sum_of_its_parts(scene: Scene) -> None:
    x0, x1, _, _ = scene.box
    middle = scene.parameters[3]  # anywhere, outside too
    parts = teg.integral(scene.integrand, (x, x0, middle)) + teg.integral(scene.integrand, (x, middle, x1))
    assume(not compiled(parts, scene).diagnose(scene.values))
    same(scene.expression, parts, scene)


@given(scenes(1), scenes(1))
@examples(7)
def test_linearity(scene: Scene, other: Scene) -> None:
    together = scene.over(2 * scene.integrand - 3 * other.integrand)
    apart = 2 * scene.expression - 3 * scene.over(other.integrand)
    same(apart, together, scene)
