"""Literals of any size: the chart of a surface is chosen by numbers, not because a coefficient is written as one."""

from __future__ import annotations

import math

import pytest

import teg
from teg.analysis.nest import Binder
from teg.ir.expr import FALSE, TRUE
from teg.passes.eliminate.affine import match_affine
from teg.passes.eliminate.implicit import Implicit
from teg.passes.eliminate.steep import Graph, match_steep, steepness

x, y, z = teg.vars("x y z")
t, p = teg.params("t p")
UNIT = [Binder(v, teg.ir.expr.const(0.0), teg.ir.expr.const(1.0)) for v in (y, x)]
TINY = (1e-18, -1e-15, 1e-12, 1e-9)


def volume(condition: object, *domain: tuple[object, object, object]) -> teg.Expr:
    return teg.integral(teg.bracket(condition), *(domain or ((x, 0, 1), (y, 0, 1))))


def _steepness(g: teg.Expr) -> object:
    data = match_affine(g, [x, y])
    assert data is not None
    return steepness(g, data, UNIT)


def test_which_graphs_are_too_steep() -> None:
    assert _steepness(t - y - x**2) is FALSE
    assert _steepness(t - y - p * teg.sin(p * x)) is FALSE
    assert _steepness(t - 1e-3 * y - x**2) is FALSE
    assert _steepness(t - 1e-18 * y - x**2) is TRUE
    assert _steepness(t - 1e-18 * y - p * x**2) is TRUE
    assert _steepness(t - y - 1e12 * teg.exp(x)) is TRUE
    assert _steepness(t - y - teg.exp(20 * p * x)) not in (TRUE, FALSE)


def test_both_forms_only_where_the_parameters_decide() -> None:
    graph = match_affine(t - y - x**2, [x, y])
    assert graph is not None
    assert match_steep(t - y - x**2, graph, UNIT) is None
    assert isinstance(match_steep(t - 1e-18 * y - x**2, graph, UNIT), Implicit)
    assert isinstance(match_steep(t - y - teg.exp(20 * p * x), graph, UNIT), Graph)


@pytest.mark.parametrize("c", TINY)
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_tiny_literal(c: float, backend: str) -> None:
    # ∫√(t - c·y) dy by t
    at = 0.01
    expected = 1 / (math.sqrt(at) + math.sqrt(at - c))
    huge = volume(x * x / abs(c) + math.copysign(1.0, c) * y < t / abs(c))
    for e in (volume(x * x + c * y < t), volume(x * x + c * y < t, (y, 0, 1), (x, 0, 1)), huge):
        value, gradient = teg.compile(e, backend=backend).value_and_grad(t=at)
        assert value == pytest.approx(math.sqrt(at), rel=1e-7)
        assert gradient["t"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("c", [1e-18, 1e-13])
def test_a_tiny_literal_beside_other_functions(c: float) -> None:
    root = 0.7244919590005157  # of x⁴ + x = 1
    cases = [
        (volume(teg.exp(x) + c * y < t), 1.5, 1 / 1.5),
        (volume(x**4 + x + c * y < t), 1.0, 1 / (1 + 4 * root**3)),
        (volume(teg.sin(3 * x) + c * y < t, (x, 0, 0.5), (y, 0, 1)), 0.3, 1 / (3 * math.sqrt(1 - 0.09))),
        (volume(x * x + y * y + c * z < t, (x, -1, 1), (y, -1, 1), (z, 0, 1)), 0.25, math.pi),
        (volume(x * x + c * (y + z) < t, (x, 0, 1), (y, 0, 1), (z, 0, 1)), 0.01, 5.0),
        (volume(c * x * x + c * c * y < c * t), 0.01, 5.0),
        (volume(c * x * x + x < t, (x, 0, 1)), 0.3, 1.0),
    ]
    for e, at, expected in cases:
        assert teg.compile(e).grad(t=at)["t"] == pytest.approx(expected, rel=1e-11), e


@pytest.mark.parametrize("s", [0.25, 3.0])
def test_a_literal_times_a_parameter(s: float) -> None:
    for e in (
        volume(x * x + 1e-18 * p * y < t),
        volume(p * (x * x + 1e-16 * y) < p * t),
        volume(1e18 * p * x * x + y < 1e18 * p * t),
        volume(p * x * x + 1e-14 * y < p * t),
    ):
        assert teg.compile(e).grad(t=0.01, p=s)["t"] == pytest.approx(5.0, rel=1e-11), e


def test_a_parameter_that_makes_the_graph_steep() -> None:
    # the curve crosses the unit square between x = lo and x = hi
    f = teg.compile(volume(y * 1e-4 < teg.exp(p * x) * 1e-4 - t))
    for at in (1.0, 12.0, 40.0):
        lo, hi = (math.log(1e4 * (u + 1e-4 * w)) / at for u, w in ((0.01, 0.0), (0.01, 1.0)))
        inside = min(hi, 1.0) - min(lo, 1.0)
        assert f.grad(t=0.01, p=at)["t"] == pytest.approx(-inside * 1e4, rel=1e-9)


def test_second_derivatives_beside_a_tiny_literal() -> None:
    f = teg.compile(volume(x * x + 1e-16 * y < t))
    assert f.hessian(t=0.01)["t", "t"] == pytest.approx(-0.25 * 0.01**-1.5, rel=1e-9)


def test_a_small_root_of_a_quadratic_beside_a_large_one() -> None:
    for e, at, expected in (
        (volume(x * x - 2 * p * x + p < t, (x, 0, 1)), 1e9, 0.5e-9),
        (volume(1e-12 * x * x - p * x + 1 < t, (x, 0, 1)), 2.0, 0.5),
        (volume(1e-17 * x * x - p * x * (1 + y) + 1 < t), 1.0, math.log(2)),
    ):
        assert teg.compile(e).grad(t=0.5, p=at)["t"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.usefixtures("x64")
def test_tiny_and_huge_literals_in_jax() -> None:
    for e in (volume(x * x + 1e-18 * y < t), volume(1e15 * x * x + y < 1e15 * t)):
        assert teg.compile(e, backend="jax").grad(t=0.01)["t"] == pytest.approx(5.0, rel=1e-12)
