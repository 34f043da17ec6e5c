"""Infinite integrals around a δ of several variables: finite bounds, the same value, nothing else changed."""

from __future__ import annotations

import math

import mpmath
import pytest

import teg
from teg.analysis.tails import is_unbounded
from teg.ir.integral import Integral
from teg.ir.node import postorder
from teg.passes.normalise.finite_bounds import with_finite_bounds

x, y = teg.vars("x y")
t = teg.param("t")
RING = teg.delta(x * x + y * y - t) * teg.exp(-x)


def test_charted_integrals_become_finite_and_again_nothing_changes() -> None:
    e = teg.integral(RING, (x, 0, math.inf), (y, -math.inf, math.inf))
    finite = with_finite_bounds(e)
    assert not any(is_unbounded(n) for n in postorder([finite]) if isinstance(n, Integral))
    assert with_finite_bounds(finite) is finite


def test_bounds_in_reverse_change_the_sign() -> None:
    """The sign of an integral from infinity once was lost where the surface moves."""
    down = with_finite_bounds(teg.integral(RING, (x, math.inf, 0), (y, 0, 1)))
    up = with_finite_bounds(teg.integral(RING, (x, 0, math.inf), (y, 0, 1)))
    values = [teg.compile(teg.eliminate(e), [t], backend="numpy", inaccurate="ignore")(2.0) for e in (down, up)]
    assert values[0] == pytest.approx(-values[1], rel=1e-9)


def test_the_value_is_preserved() -> None:
    """∫∫ δ(x² + y² - t) over the plane is π."""
    e = teg.integral(teg.delta(x * x + y * y - t), (x, -math.inf, math.inf), (y, -math.inf, math.inf))
    assert teg.evaluate(e, t=2.0) == pytest.approx(math.pi, rel=1e-10)


@pytest.mark.parametrize("backend", ["numpy", "c"])
@pytest.mark.parametrize("sign", [1, -1])
def test_surfaces_without_formulas_move_over_infinite_ranges(sign: int, backend: str) -> None:
    """The boundary of x⁶ + xy + y² < t, where y is between 0 and 1: the upper root of a quadratic."""
    level = 1.3
    bounds = (0, math.inf)[::sign]
    e = teg.integral(teg.bracket(x**6 + x * y + y**2 < t) * teg.exp(-(x**2) - y**2), (x, *bounds), (y, 0, 1))

    def density(u: mpmath.mpf) -> mpmath.mpf:
        root = mpmath.sqrt(u**2 + 4 * (level - u**6))
        return mpmath.exp(-(u**2) - ((root - u) / 2) ** 2) / root

    first = mpmath.findroot(lambda u: u**6 + u - (level - 1), 0.3)
    exact = float(mpmath.quad(density, [first, mpmath.mpf(level) ** (mpmath.mpf(1) / 6)]))
    found = teg.compile(e, [t], backend=backend, inaccurate="ignore").grad(t=level)["t"]
    assert found == pytest.approx(sign * exact, rel=1e-9)


@pytest.mark.parametrize(
    "e",
    [
        teg.integral(teg.exp(-x * t), (x, 0, math.inf)),
        teg.integral(teg.delta(x - t) * teg.exp(-y), (x, 0, 1), (y, 0, math.inf)),
        teg.integral(RING, (x, 0, 1), (y, 0, 1)),
    ],
)
def test_other_integrals_stay(e: teg.Expr) -> None:
    assert with_finite_bounds(e) is e
