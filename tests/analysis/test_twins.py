"""Surfaces that stand across the variable of an inner integral, in non-linear uses of it.

∫₀¹ F(∫ [c·h(x) + y < b] w(x) dx) dy changes with b by F(W) - F(0), as long as the surface ends inside of (0, 1), whatever c is: W is the
inner integral where the condition holds. With c it changes by -∫ h(x₁) F′(m(x₁)) w(x₁) dx₁, where m(x₁) is the weight of all x on whose
side of the surface x₁ is not reached: those with h(x) < h(x₁) for c > 0, those with h(x) > h(x₁) for c < 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import teg
from teg.analysis.twins import as_twin
from teg.ir.expr import Expr

x, y, z, x1, z1 = teg.vars("x y z x1 z1")
b, c, d = teg.params("b c d")
IN_ALL = pytest.mark.parametrize("backend", ["c", "numpy", "jax"])
Function = Callable[[float], float]


class Family(NamedTuple):
    """h in the language, the weight of all x with a smaller h(x) and their number, and where x is; w is 1."""

    h: Callable[[Expr], Expr]
    at: Function
    below: Function
    range: tuple[float, float]


FAMILIES = {
    "line": Family(lambda u: u, lambda u: u, lambda u: u, (0.0, 1.0)),
    "sine": Family(teg.sin, math.sin, lambda u: u, (0.0, 1.0)),
    "parabola": Family(lambda u: u**2, lambda u: u * u, lambda u: 2 * abs(u), (-1.0, 1.0)),
}
USES: dict[str, tuple[Callable[[Expr], Expr], Function, Function]] = {
    "cube": (lambda m: m**3, lambda m: m**3, lambda m: 3 * m * m),
    "exp": (teg.exp, math.exp, math.exp),
    "root": (lambda m: teg.sqrt(m + 0.3), lambda m: math.sqrt(m + 0.3), lambda m: 0.5 / math.sqrt(m + 0.3)),
}


def _mean(f: Function, lo: float, hi: float) -> float:
    """Returns ∫ f, by Gauss's rule on both halves of the range."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    middle = 0.5 * (lo + hi)
    return sum(
        0.5 * (v - u) * w * f(u + 0.5 * (v - u) * (1 + s))
        for u, v in ((lo, middle), (middle, hi))
        for s, w in zip(nodes, weights, strict=True)
    )


def _gradient(family: Family, value: Function, rate: Function, lean: float) -> tuple[float, float]:
    """Returns the derivatives by b and by c for a surface that leans a little, to this side."""
    lo, hi = family.range
    size = hi - lo

    def inside(u: float) -> float:
        return family.below(u) if lean > 0 else size - family.below(u)

    return value(size) - value(0.0), -_mean(lambda u: family.at(u) * rate(inside(u)), lo, hi)


@IN_ALL
@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("family", FAMILIES)
def test_a_surface_across_the_inner_variable(x64: None, backend: str, family: str, use: str) -> None:
    shape, (written, value, rate) = FAMILIES[family], USES[use]
    inner = teg.integral(teg.bracket(c * shape.h(x) + y < b), (x, *shape.range))
    f = teg.compile(teg.integral(written(inner), (y, 0, 1)), [b, c], backend=backend)
    right, left = (np.array(_gradient(shape, value, rate, lean)) for lean in (1.0, -1.0))
    for lean, expected in ((1e-3, right), (1e-12, right), (-1e-9, left), (0.0, 0.5 * (right + left))):
        got = f.grad({"b": 0.5, "c": lean})
        assert np.array([got["b"], got["c"]]) == pytest.approx(expected, rel=1e-10), lean
    (tie,) = f.diagnose({"b": 0.5, "c": 0.0})
    assert tie.kind == "tie"
    assert "coincides" in str(tie)


@IN_ALL
def test_two_inner_variables(x64: None, backend: str) -> None:
    inner = teg.integral(teg.bracket(c * x + d * z + y < b), (x, 0, 1), (z, 0, 1))
    f = teg.compile(teg.integral(teg.exp(inner), (y, 0, 1)), [b, c, d], backend=backend)
    for lean, by_c in ((1e-9, -1.0), (-1e-9, 2 - math.e), (0.0, 0.5 * (1 - math.e))):
        got = f.grad({"b": 0.5, "c": lean, "d": 0.0})
        assert (got["b"], got["c"]) == pytest.approx((math.e - 1, by_c), rel=1e-9), lean


@IN_ALL
@pytest.mark.parametrize("power", [1, 2])
def test_the_outer_variable_by_a_formula_or_isolated(x64: None, backend: str, power: int) -> None:
    inner = teg.integral(teg.bracket(c * x + y**power < b), (x, 0, 1))
    f = teg.compile(teg.integral(teg.exp(inner), (y, 0, 1)), [b, c], backend=backend)
    expected = (math.e - 1) * 0.5 ** (1 / power - 1) / power
    for lean in (0.0, 1e-13, -1e-13):
        assert f.grad({"b": 0.5, "c": lean})["b"] == pytest.approx(expected, rel=1e-11)


@IN_ALL
def test_two_integrals_of_one_surface(x64: None, backend: str) -> None:
    m = teg.integral(teg.bracket(c * x + y < b), (x, 0, 1))
    same, rest = teg.integral(teg.bracket(c * z + y < b), (z, 0, 1)), teg.integral(teg.bracket(c * x + y >= b), (x, 0, 1))
    f = teg.compile(teg.integral(teg.tuple(teg.exp(m) * same**2, teg.exp(m) * rest), (y, 0, 1)), [b, c], backend=backend)
    got = f.grad({"b": 0.5, "c": 0.0})
    assert got["b"] == pytest.approx([math.e, -1.0], rel=1e-12)


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_the_entropy_of_a_marginal(backend: str) -> None:
    """∫ p·log p dy over the chords p = 2√(t - y²) of a disk is t·(π + ½π·log t) less a half of πt."""
    p = teg.integral(teg.bracket(x * x + y * y < b), (x, -1, 1))
    parts = p * teg.log(p + 1e-300), teg.where(p > 0, p * teg.log(p), 0)
    f = teg.compile(teg.integral(teg.tuple(*parts), (y, -1, 1)), [b], backend=backend)
    assert f.grad(b=0.6)["b"] == pytest.approx([math.pi + 0.5 * math.pi * math.log(0.6)] * 2, rel=1e-10)


def test_second_derivatives() -> None:
    """The derivative by b is ∫ 3x²/(2√(b - c·x)) dx."""
    e = teg.integral(teg.integral(teg.bracket(c * x + y * y < b), (x, 0, 1)) ** 3, (y, 0, 1))
    f = teg.compile(e, [b, c], backend="c")
    for lean in (0.1, 0.01):
        got = f.hvp({"b": 0.5, "c": lean}, {"b": 1.0, "c": 0.0})
        by_both = [_mean(lambda u: rate(u) * 0.75 * u * u * (0.5 - lean * u) ** -1.5, 0.0, 1.0) for rate in (lambda u: -1.0, lambda u: u)]  # noqa: B023
        assert [got["b"], got["c"]] == pytest.approx(by_both, rel=1e-8)


def test_what_is_a_twin() -> None:
    rivals = "one", "other"
    surface = b - (c * x + y)
    inside = b - (c * x1 + y)
    assert as_twin(inside, surface, [x1], rivals) is not None
    assert as_twin(inside, surface, [z1], rivals) is None, "nothing inside is in it"
    assert as_twin(b - (d * x1 + y), surface, [x1], rivals) is None, "another surface"
    assert str(as_twin(b - (2 * x1 + y), b - (2 * x + y), [x1], rivals)) == "-2·(x1 - x) > 0"
    assert str(as_twin(b - (x1**2 + y), b - (x**2 + y), [x1], rivals)) == "x1² < x²"
    assert as_twin(b - (c * x1 + d * z1 + y), b - (c * x + d * z + y), [x1, z1], rivals) is not None
    assert as_twin(b - x1 * y, b - x * y, [x1], rivals) is None, "its rate is a variable"
