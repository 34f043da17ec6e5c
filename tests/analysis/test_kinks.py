"""Branches that are continuous, as extremes: a surface with many kinks stays one surface, and no kink has a δ."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import teg
from teg.analysis.surfaces import atoms_of
from teg.ir.traverse import size
from teg.pipeline import ESTIMATORS, compiled_outputs
from tests.backends.c_checks import in_c

x, y = teg.vars("x y")
t, p = teg.params("t p")
BACKENDS = ("numpy", "jax", pytest.param("c", marks=in_c))


def test_many_minima_and_maxima_in_one_condition() -> None:
    """Below x = t - Σ min(y, pₖ)/2 + Σ max(y, pₖ)/4 stands the integral of that over y: ∫min = p - p²/2 and ∫max = (1 + p²)/2."""
    places = (p, 0.5, 0.8)
    border = t - sum(teg.minimum(y, q) for q in places) / 2 + sum(teg.maximum(y, q) for q in places) / 4
    f = teg.compile(teg.integral(teg.bracket(x < border), (x, -2, 2), (y, 0, 1)), backend="numpy")
    numbers = (0.3, 0.5, 0.8)
    value, gradient = f.value_and_grad(t=0.4, p=0.3)
    exact = 2.4 - sum(q - q * q / 2 for q in numbers) / 2 + sum((1 + q * q) / 2 for q in numbers) / 4
    assert value == pytest.approx(exact, rel=1e-12)
    assert gradient["t"] == pytest.approx(1.0, rel=1e-12)
    assert gradient["p"] == pytest.approx(-(1 - 0.3) / 2 + 0.3 / 4, rel=1e-12)


def test_roofs_written_as_branches() -> None:
    """-|y - q| as a branch: the integral of u = t - Σ |y - q|/4 over y is t - Σ (q² + (1 - q)²)/8, and below x = u stands 2 more."""
    places = (p, 0.5, 0.6, 0.8)
    roofs = sum(teg.where(y < q, y - q, -(y - q)) for q in places) / 4
    f = teg.compile(teg.integral(teg.bracket(x < t + roofs), (x, -2, 2), (y, 0, 1)), [t, p], backend="numpy")
    value, gradient = f.value_and_grad(t=0.4, p=0.3)
    assert value == pytest.approx(2.4 - sum(q**2 + (1 - q) ** 2 for q in (0.3, 0.5, 0.6, 0.8)) / 8, rel=1e-12)
    assert gradient == pytest.approx({"t": 1.0, "p": (1 - 2 * 0.3) / 4}, rel=1e-12)


def folded(depth: int, x: object, t: object, least: Callable[..., Any], most: Callable[..., Any]) -> Any:
    """Returns a function that is bent and cut `depth` times."""
    e: Any = x + t  # type: ignore[operator]
    for k in range(depth):
        e = most(least(1.3 * e + 0.1 * k, 1 - 0.5 * e), 0.2 * e)
    return e


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", BACKENDS)
def test_deep_compositions(backend: str) -> None:
    """They have no surface that moves with a jump. The reference is a sum over a grid, exact but for a cell at each kink."""
    f = teg.compile(teg.integral(folded(4, x, t, teg.minimum, teg.maximum), (x, 0, 1)), backend=backend)
    value, gradient = f.value_and_grad(t=0.37)
    grid = np.linspace(0.0, 1.0, 2**20 + 1)
    assert value == pytest.approx(np.trapezoid(folded(4, grid, 0.37, np.minimum, np.maximum), grid), abs=1e-11)
    assert gradient["t"] == pytest.approx(folded(4, 1.0, 0.37, min, max) - folded(4, 0.0, 0.37, min, max), rel=1e-13)


def test_deep_compositions_stay_small() -> None:
    """The normal form and the gradient grow as the program does: each kink is one condition, and none has a δ."""
    sizes = []
    for depth in (4, 8, 16):
        e = teg.integral(folded(depth, x, t, teg.minimum, teg.maximum), (x, 0, 1))
        value, gradient = compiled_outputs(e, [t], 1, ESTIMATORS["exact"])
        assert len(atoms_of(value)) == 2 * depth
        sizes.append(size(gradient))
    assert sizes[2] - sizes[1] < 3 * (sizes[1] - sizes[0])
    report = str(teg.explain(teg.integral(folded(4, x, t, teg.minimum, teg.maximum), (x, 0, 1)), [t]))
    assert "surfaces that move" not in report


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", BACKENDS)
def test_extremes_of_very_different_sizes(backend: str) -> None:
    """As |·| a minimum of 1e18 and 1 was 0 in a condition: the value was off by a third, without a warning, and NaN for exponentials."""
    least, most = teg.minimum, teg.maximum
    large = most(least(least(least(1e18 * x, x + t), 1 - x), 1e20 * x * x), 0.1)
    f = teg.compile(teg.integral(large, (x, 0, 1)), backend=backend)
    value, gradient = f.value_and_grad(t=0.3)
    assert value == pytest.approx(0.3825, rel=1e-10)
    assert gradient["t"] == pytest.approx(0.35, rel=1e-8)
    steep = most(least(most(least(teg.exp(60 * x), x + t), 0.2 * x + 0.1), 1 - x), 0.5 * x * x)
    f = teg.compile(teg.integral(steep, (x, 0, 1)), backend=backend)
    first, last = (1 - 0.3) / 2, math.sqrt(3.0) - 1
    exact = first**2 / 2 + 0.3 * first + last - last**2 / 2 - first + first**2 / 2 + (1 - last**3) / 6
    assert f(t=0.3) == pytest.approx(exact, rel=1e-13)
    assert f.grad(t=0.3)["t"] == pytest.approx(first, rel=1e-13)


U = x - t
QUOTIENTS = {
    "a sign": (U / teg.maximum(U, -U), -2.0),
    "in a function": (teg.exp(U / teg.abs(U)), 1 / math.e - math.e),
    "a kink above": (teg.minimum(U, 2 * U) / U, 1.0),
    "a product with a sum": (teg.minimum(U, 2 * U) * (1 / U + 2), 1.0 - 4.0 * 0.4 - 2.0 * 0.6),
    "kinks above and below": (teg.maximum(U, 3 * U) / teg.minimum(U, 2 * U), -2.5),
    "kinks of kinks": (teg.minimum(teg.maximum(teg.minimum(U, 2 * U), 3 * U), 4 * U) / U, 1.0),
    "another denominator": (teg.minimum(U, 2 * U) / (1 + teg.abs(U)), -0.8 / 1.4 - 0.6 / 1.6),
}


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", QUOTIENTS)
def test_quotients_of_kinks_jump(name: str, backend: str) -> None:
    """u/|u| jumps although its parts do not; so does what it is the argument of."""
    e, slope = QUOTIENTS[name]
    assert teg.compile(teg.integral(e, (x, 0, 1)), backend=backend).grad(t=0.4)["t"] == pytest.approx(slope, rel=1e-9)
