"""Conditions with many roots, and with roots that nearly meet: values and derivatives, in every backend."""

from __future__ import annotations

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest

import teg

x, y = teg.vars("x y")
t, a = teg.params("t a")

# -- the number of roots is data -------------------------------------------------------------------------------------------


def stripes(k: float, c: float, t: float) -> tuple[float, float]:
    """How much of (0, 1) is in [sin(kx) + c·x < t], and its derivative by t: by changes of sign on a fine grid and bisection."""
    grid = np.linspace(0.0, 1.0, 200_001)
    g = np.sin(k * grid) + c * grid - t
    total, rate = 0.0, 0.0
    ends = [0.0]
    for i in np.flatnonzero((g[1:] > 0) != (g[:-1] > 0)):
        root = mpmath.findroot(lambda u: mpmath.sin(k * u) + c * u - t, (grid[i], grid[i + 1]), solver="anderson")
        ends.append(float(root))
        rate += 1.0 / abs(k * math.cos(k * ends[-1]) + c)
    ends.append(1.0)
    for p, q in pairwise(ends):
        m = 0.5 * (p + q)
        total += q - p if math.sin(k * m) + c * m < t else 0.0
    return total, rate


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_any_number_of_roots(backend: str, x64: None) -> None:
    inside = teg.sin(a * x) + 0.5 * x < t
    f = teg.compile(teg.integral(teg.bracket(inside), (x, 0, 1)), [t], backend=backend)
    value, slope = stripes(150.0, 0.5, 0.3)  # 48 roots
    assert f(t=0.3, a=150.0) == pytest.approx(value, abs=1e-12)
    assert f.grad(t=0.3, a=150.0)["t"] == pytest.approx(slope, rel=1e-11)
    assert f.value_and_error(t=0.3, a=150.0)[0] == pytest.approx(value, abs=1e-12)


def test_few_and_many_roots_in_a_batch() -> None:
    f = teg.compile(teg.integral(teg.bracket(teg.sin(a * x) + 0.5 * x < t), (x, 0, 1)), [t])
    rates = np.array([3.0, 400.0, 30.0])
    expected = [stripes(k, 0.5, 0.3) for k in rates]
    value, slopes = f.value_and_grad(t=0.3, a=rates)
    np.testing.assert_allclose(value, [v for v, _ in expected], atol=1e-12)
    np.testing.assert_allclose(slopes["t"], [s for _, s in expected], rtol=1e-11)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_many_roots_inside_another_integral_and_in_a_sum(backend: str) -> None:
    inside = teg.sin(90 * x + y) + 0.5 * x < t
    f = teg.compile(teg.integral(teg.bracket(inside), (x, 0, 1), (y, 0, 2)), [t], backend=backend, tol=1e-8)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    grid = (np.arange(100_000) + 0.5) / 100_000
    expected = sum(w * np.mean(np.sin(90 * grid + 1.0 + n) + 0.5 * grid < 0.3) for n, w in zip(nodes, weights, strict=True))
    assert f(t=0.3) == pytest.approx(expected, abs=2e-4)
    k, w = teg.index("k"), teg.array("w")
    g = teg.compile(teg.sum(teg.integral(teg.bracket(teg.sin(w[k] * x) + 0.5 * x < t), (x, 0, 1)), (k, 0, 2)), [t], backend=backend)
    first, second = stripes(4.0, 0.5, 0.3), stripes(250.0, 0.5, 0.3)
    assert g(t=0.3, w=[4.0, 250.0]) == pytest.approx(first[0] + second[0], abs=1e-12)
    assert g.grad(t=0.3, w=[4.0, 250.0])["t"] == pytest.approx(first[1] + second[1], rel=1e-11)


@pytest.mark.parametrize("degree", [20, 31])
def test_a_polynomial_has_as_many_roots_as_its_degree(degree: int) -> None:
    """Chebyshev's polynomial: cos(n·θ) < t, by the angles where it is t. It is written out in powers, or as its recurrence."""
    if degree == 20:
        coefficients = np.polynomial.chebyshev.cheb2poly([0] * degree + [1])
        e = sum(float(c) * x**i for i, c in enumerate(coefficients))
    else:
        e, before = 2 * x * x - 1, x
        for _ in range(degree - 2):
            e, before = 2 * x * e - before, e
    f = teg.compile(teg.integral(teg.bracket(e < t), (x, -1, 1)), [t])
    angle = math.acos(0.3)
    at = [(angle + 2 * math.pi * k) / degree for k in range(degree)] + [(2 * math.pi * k - angle) / degree for k in range(degree)]
    ends = [0.0, *sorted(v for v in at if 0 < v < math.pi), math.pi]
    expected = sum(math.cos(p) - math.cos(q) for p, q in pairwise(ends) if math.cos(degree * 0.5 * (p + q)) < 0.3)
    assert len(ends) == degree + 2
    assert f(t=0.3) == pytest.approx(expected, abs=1e-9)


# -- roots that nearly meet ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
@pytest.mark.parametrize("power", [2, 3, 4, 6])
@pytest.mark.parametrize("t_value", [1e-7, 1e-12, 1e-18])
def test_clusters(backend: str, power: int, t_value: float, x64: None) -> None:
    """[exp(x)·u^n < t·exp(x)·(2 + sin x)], u = x - 0.3: at u = ±(t·(2 + sin x))^(1/n), by iteration in 40 digits."""
    if backend == "jax" and power != 3:
        pytest.skip("one is enough: a compilation takes seconds")
    e = teg.bracket((x - 0.3) ** power < t * (2 + teg.sin(x)))
    f = teg.compile(teg.integral(e, (x, 0, 1)), [t], backend=backend)

    def end(sign: int) -> float:
        u = mpmath.mpf(0)
        for _ in range(200):
            u = sign * (mpmath.mpf(t_value) * (2 + mpmath.sin(mpmath.mpf(3) / 10 + u))) ** (mpmath.mpf(1) / power)
        return float(u)

    expected = end(1) - end(-1) if power % 2 == 0 else 0.3 + end(1)
    assert f(t=t_value) == pytest.approx(expected, abs=2e-11, rel=1e-7)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_cusp(backend: str) -> None:
    """The cardioid: its area is 3/2·πa², and at its cusp four roots meet."""
    q = x * x + y * y
    f = teg.compile(teg.integral(teg.bracket((q - a * x) ** 2 < a * a * q), (x, -3, 3), (y, -3, 3)), backend=backend)
    for v in (1.1, 0.7):
        value, gradient = f.value_and_grad(a=v)
        assert value == pytest.approx(1.5 * math.pi * v * v, rel=1e-9)
        assert gradient["a"] == pytest.approx(3 * math.pi * v, rel=1e-8)


def test_a_cluster_that_rounding_hides_is_told() -> None:
    """(x - 0.3)⁴ written out is known to 1e-17 only: its roots are lost where they are 1e-4 apart."""
    e = sum(float(c) * x**i for i, c in enumerate([0.0081, -0.108, 0.54, -1.2, 1.0]))
    f = teg.compile(teg.integral(teg.bracket(e < t), (x, 0, 1)), [t])
    with pytest.warns(teg.AccuracyWarning, match="misses the tolerance"):
        value = f(t=1e-18)
    value, error = f.value_and_error(t=1e-18)
    assert abs(value - 2 * 1e-18**0.25) <= error < 1e-2
    assert f(t=1e-6) == pytest.approx(2 * 1e-6**0.25, rel=1e-9)
