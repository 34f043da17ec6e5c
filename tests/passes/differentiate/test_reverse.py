"""Reverse mode equals forward mode, and costs one sweep."""

from __future__ import annotations

import math

import pytest

import teg
from teg import errors
from teg.ir.expr import ONE, ZERO
from teg.passes.differentiate.forward import tangent_of
from teg.passes.differentiate.reverse import gradient_of
from teg.pipeline import normal_form
from tests.references import Reference, untagged

x, y, z = teg.vars("x y z")
t, a, b = teg.params("t a b")


@pytest.mark.parametrize(
    ("e", "expected"),
    [
        (t * a, (a, t)),
        (t**3, (3 * t**2, ZERO)),
        (teg.integral(x * t, (x, 0, 1)), (teg.integral(x, (x, 0, 1)), ZERO)),
        (teg.integral(x, (x, a, t)), (t, -a)),
        (teg.integral(teg.bracket(x < t), (x, 0, 1)), (teg.integral(teg.delta(t - x), (x, 0, 1)), ZERO)),
        (teg.where(t < a, t, a), (teg.bracket(t < a), teg.where(t < a, 0, 1))),
        (t * a * teg.bracket(z < t), (a * teg.bracket(z < t) + t * a * teg.delta(t - z), t * teg.bracket(z < t))),
    ],
    ids=lambda e: str(e),
)
def test_normal_form(e: teg.Expr, expected: tuple[teg.Expr, teg.Expr]) -> None:
    assert tuple(gradient_of(e, [t, a])) == expected


@pytest.mark.parametrize("reference", untagged("slow"), ids=lambda r: r.id)
def test_reverse_equals_forward(reference: Reference) -> None:
    e = reference.build()
    ps = [teg.param(k) for k in reference.params]
    tol = 1e-10 if "3d-quadratic" in reference.tags else 1e-13  # slices of a ball that shrink to a point round more
    backward = teg.evaluate(teg.grad(e, ps), reference.params, tol=tol)
    forward = teg.evaluate(teg.tuple(*(teg.diff(e, p) for p in ps)), reference.params, tol=tol)
    scale = max([1.0, *(abs(v) for v in forward if v == v and abs(v) != float("inf"))])
    assert backward == pytest.approx(forward, rel=1e-13, abs=1e-13 * scale, nan_ok=True)


def test_nests_with_several_parameters() -> None:
    inner = teg.integral(teg.bracket(y < t * x) * teg.exp(a * y), (y, 0, 1))
    e = teg.integral(inner**2 * teg.bracket(x < a) / (1 + inner), (x, b, teg.integral(teg.bracket(z < t), (z, 0, 2))))
    f = teg.compile(e, [t, a, b])
    at = {"t": 0.7, "a": 0.6, "b": 0.1}
    assert teg.check_gradient(f, at, tol=1e-8)
    gradient = f.grad(at)
    for p in (t, a, b):
        assert teg.evaluate(teg.diff(e, p), at) == pytest.approx(gradient[p.name], rel=1e-12)


def test_a_branch_that_is_not_taken_gives_no_nan() -> None:
    e = teg.where(t > 0, t * a, teg.sqrt(t) / (t - t * a) ** 2)
    assert teg.evaluate(teg.grad(e, [t, a]), {t: 2.0, a: 1.0}) == (1.0, 2.0)


def test_tuples() -> None:
    assert gradient_of(teg.tuple(t, t * a), [t, a]) is teg.tuple((1, 0), (a, t))
    assert gradient_of(t + a, []) is teg.tuple()


def test_the_hessian_is_symmetric() -> None:
    e = teg.integral(teg.bracket(a * x + b * y < t) * teg.exp(x * y), (x, 0, 1), (y, 0, 1))
    f = teg.compile(e, [t, a, b], tol=1e-12)
    h = f.hessian(t=0.8, a=1.1, b=0.7)
    for i in "tab":
        for j in "tab":
            assert h[i, j] == pytest.approx(h[j, i], rel=1e-10)


def test_a_delta_is_carried_along() -> None:
    (g,) = gradient_of(teg.integral(teg.delta(t - x * x) * teg.exp(x), (x, 0, 1)), [t]).children
    root = 0.5**0.5  # d/dt exp(√t)/(2√t)
    assert teg.evaluate(g, {t: 0.5}) == pytest.approx(math.exp(root) * (1 / (4 * 0.5) - 1 / (4 * 0.5**1.5)), rel=1e-13)


def test_a_delta_of_a_variable_that_is_still_free_is_not_differentiated() -> None:
    with pytest.raises(errors.DeltaError):
        gradient_of(teg.delta(t - x) * x, [t])


def test_one_boundary_integral_a_surface_whatever_the_number_of_parameters() -> None:
    ps = teg.params(" ".join(f"p{i}" for i in range(40)))
    threshold: teg.Expr = ps[0]
    for i, p in enumerate(ps[1:], 1):
        threshold = threshold + teg.sin(i * p)
    e = normal_form(teg.integral(teg.bracket(x < threshold) * teg.exp(x), (x, 0, 1)))
    adjoint = gradient_of(e, ps)
    assert teg.size(adjoint) < 4 * teg.size(e) + 40
    forward = teg.tuple(*(tangent_of(e, {p: ONE}) for p in ps))
    at = {p.name: 0.01 for p in ps}
    assert teg.evaluate(adjoint, at) == pytest.approx(teg.evaluate(forward, at), rel=1e-13)


def test_a_parameter_in_several_terms_of_a_branch() -> None:
    """The cotangents of one parameter are one sum."""
    net = t + b - 0.3 * t
    f = teg.compile(teg.where(b < 2, net, net * t), [t, b])
    assert f.grad(t=1.3, b=0.2) == pytest.approx({"t": 0.7, "b": 1.0}, rel=1e-15)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_line_whose_slope_is_its_intercept(backend: str) -> None:
    """The area x < t·(y + 1) on a box, whose corner the line leaves at 2/t: its slope is 2/t² there."""
    box = (x, -1.2, 2), (y, -1, 1)
    f = teg.compile(teg.integral(teg.bracket(x - t * y - t < 0), *box), [t], backend=backend)
    assert f.hessian(t=1.3)["t", "t"] == pytest.approx(-4 / 1.3**3, rel=1e-12)
    assert f.hessian(t=-1.295)["t", "t"] == pytest.approx(1.44 / 1.295**3, rel=1e-12)
    length = teg.compile(teg.integral(teg.delta(x - t * y - t), *box), [t], backend=backend)
    value, grad = length.value_and_grad(t=1.3)
    assert (value, grad["t"]) == pytest.approx((2 / 1.3, -2 / 1.3**2), rel=1e-12)
