"""Polynomials in sines and cosines: their frequency, and that the nodes integrate them to rounding."""

from __future__ import annotations

import mpmath
import pytest

import teg
from teg.analysis.evaluate import values_of
from teg.analysis.waves import frequency, gauss_nodes
from teg.ir.integral import Integral
from teg.numerics.quadrature import gauss_legendre

x = teg.var("x")
t = teg.param("t")


@pytest.mark.parametrize(
    ("e", "highest"),
    [(teg.sin(x), 1.0), (teg.cos(3 * x + t), 3.0), (teg.sin(2 * x) * teg.cos(x), 3.0), (teg.sin(x) ** 4, 4.0), (t * teg.cos(x) + 1, 1.0)],
)
def test_the_highest_frequency(e: teg.Expr, highest: float) -> None:
    assert frequency(e, x) == highest


@pytest.mark.parametrize("e", [teg.exp(x), teg.sin(x * x), teg.sin(t * x), 1 / teg.cos(x)])
def test_other_functions_have_none(e: teg.Expr) -> None:
    assert frequency(e, x) is None


@pytest.mark.parametrize("e", [teg.sin(x) ** 2 * teg.cos(2 * x), teg.cos(2 * x + 0.3)])
def test_the_nodes_integrate_to_rounding(e: teg.Expr) -> None:
    node = teg.integral(e, (x, 0, 2))
    assert isinstance(node, Integral)
    count = gauss_nodes(node)
    assert count is not None
    points, weights = gauss_legendre(count)
    found = sum(w * float(values_of([e], {x: 1.0 + p})[0]) for p, w in zip(points, weights, strict=True))
    exact = mpmath.quad(lambda u: values_of([e], {x: float(u)})[0], mpmath.linspace(0, 2, 9))
    assert found == pytest.approx(float(exact), abs=1e-14)


def test_too_many_waves_in_an_interval_have_no_number_of_nodes() -> None:
    node = teg.integral(teg.cos(5 * x), (x, 0, 2))
    assert isinstance(node, Integral)
    assert gauss_nodes(node) is None
