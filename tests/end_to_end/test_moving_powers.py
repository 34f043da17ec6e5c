"""Powers u^t of what moves, where t is a number or a parameter: shininess, a hinge, light on a sphere.

Against integrals in one variable in which both ends are smooth, and closed forms.
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
import pytest

import teg

x, y = teg.vars("x y")
a, s, t = teg.params("a s t")
BACKENDS = ["c", "numpy"]


def cap(square: complex, slope: complex, exponent: int) -> complex:
    """∫∫ max(0, slope·x + 0.5·y + 0.3)^(exponent/2) over the disk x² + y² < square, along the direction of the slope: from s0, where the
    power begins, to the radius, by s = s0 + (radius - s0)·sin²φ."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    phi, step = 0.25 * math.pi * (nodes + 1.0), 0.25 * math.pi * weights
    radius, size = np.sqrt(square), np.sqrt(slope * slope + 0.25)
    first = -0.3 / size
    length = radius - first
    chord = 2.0 * np.sqrt(length) * np.cos(phi) * np.sqrt(radius + first + length * np.sin(phi) ** 2)
    power = (size * length) ** (0.5 * exponent) * np.sin(phi) ** exponent
    return complex(np.sum(step * chord * power * 2.0 * length * np.sin(phi) * np.cos(phi)))


def cap_slopes(square: float, slope: float, exponent: int) -> dict[str, float]:
    h = 1e-30
    return {"a": cap(square + 1j * h, slope, exponent).imag / h, "s": cap(square, slope + 1j * h, exponent).imag / h}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("exponent", [1, 5, 7])
def test_a_power_of_a_line_in_a_disk(exponent: int, backend: str) -> None:
    inside = teg.where(x * x + y * y < a, teg.maximum(0, s * x + 0.5 * y + 0.3) ** (0.5 * exponent), 0)
    f = teg.compile(teg.integral(inside, (x, -1, 1), (y, -1, 1)), [a], backend=backend)
    value, gradient = f.value_and_grad(a=0.64, s=0.4)
    assert value == pytest.approx(cap(0.64, 0.4, exponent).real, rel=1e-9)
    assert gradient["a"] == pytest.approx(cap_slopes(0.64, 0.4, exponent)["a"], rel=1e-9)


@pytest.mark.parametrize("backend", BACKENDS)
def test_its_exponent_is_a_parameter(backend: str) -> None:
    inside = teg.where(x * x + y * y < a, teg.maximum(0, s * x + 0.5 * y + 0.3) ** t, 0)
    f = teg.compile(teg.integral(inside, (x, -1, 1), (y, -1, 1)), [a, s], backend=backend)
    for exponent in (3, 5):
        assert f.grad(a=0.64, s=0.4, t=0.5 * exponent) == pytest.approx(cap_slopes(0.64, 0.4, exponent), rel=1e-9)


@pytest.mark.parametrize("backend", [*BACKENDS, "jax"])
def test_a_hinge_for_every_exponent(backend: str, x64_for_jax: ModuleType) -> None:
    """∫ (x - s)^t from s to 1 is (1 - s)^(t + 1)/(t + 1), also where its derivative at a fixed point is singular."""
    f = teg.compile(teg.integral(teg.where(x > s, (x - s) ** t, 0), (x, 0, 1)), [s, t], backend=backend)
    for exponent in (-0.3, 0.3, 1.0, 1.4, 1.5, 1.6, 4.0):
        size = 0.6 ** (exponent + 1.0) / (exponent + 1.0)
        expected = {"s": -(0.6**exponent), "t": size * (math.log(0.6) - 1.0 / (exponent + 1.0))}
        assert f.grad(s=0.4, t=exponent) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("exponent", [1.2, 2.5])
def test_products_with_the_hessian(exponent: float) -> None:
    f = teg.compile(teg.integral(teg.maximum(0, x - s) ** t, (x, 0, 1)), s)
    assert f.hvp({"s": 0.4, "t": exponent}, {"s": 1.0})["s"] == pytest.approx(exponent * 0.6 ** (exponent - 1.0), rel=1e-7)


def shaded(tilt: teg.Expr, shininess: teg.Expr | float) -> teg.Expr:
    height = teg.sqrt(a - x * x - y * y)
    light = teg.maximum(0, (tilt * x + teg.sqrt(1 - tilt * tilt) * height) / teg.sqrt(a)) ** shininess
    return teg.integral(teg.where(x * x + y * y < a, light, 0), (x, -1, 1), (y, -1, 1))


def test_highlight_from_above() -> None:
    """Light along the axis: ∫∫ (z/radius)^t over the disk is 2π·a/(t + 2)."""
    f = teg.compile(shaded(s, 2.5), a)
    value, gradient = f.value_and_grad(a=0.64, s=0.0)
    assert value == pytest.approx(2.0 * math.pi * 0.64 / 4.5, rel=1e-9)
    assert gradient["a"] == pytest.approx(2.0 * math.pi / 4.5, rel=1e-8)


def test_highlight_from_aside() -> None:
    """The light scales with the disk: its derivative by the square of the radius is its mean; and by the tilt, against differences."""
    f = teg.compile(shaded(s, 2.5), [a, s])
    value, gradient = f.value_and_grad(a=0.64, s=0.4)
    assert gradient["a"] == pytest.approx(value / 0.64, rel=1e-8)
    near, far = ((f(a=0.64, s=0.4 + h) - f(a=0.64, s=0.4 - h)) / (2.0 * h) for h in (5e-3, 1e-2))
    assert gradient["s"] == pytest.approx((4.0 * near - far) / 3.0, rel=1e-6)


# -- sharp highlights on a sphere ----------------------------------------------------------------------------------------


def highlight(exponent: float, light: tuple[complex, complex], radius: complex) -> complex:
    """∫∫ max(0, n·l)^exponent over the disk below a sphere with normals n: in spherical coordinates around the third axis, where the
    disk's element is r²·sin θ·cos θ dθ dφ; n·l > 0 up to an angle φ that is known."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    across, along = light
    total = 0j
    horizon = math.atan2(along.real, across.real)  # below it every φ is lit
    for low, high in ((0.0, horizon), (horizon, 0.5 * math.pi)):
        theta = 0.5 * (high - low) * (nodes + 1.0) + low
        steps = 0.5 * (high - low) * weights
        for angle, step in zip(theta, steps, strict=True):
            limit = np.pi + 0j if low == 0.0 else np.arccos(-along / (across * np.tan(angle)) + 0j)
            phi = 0.5 * limit * (nodes + 1.0)
            lit = across * math.sin(angle) * np.cos(phi) + along * math.cos(angle)
            total += step * math.sin(angle) * math.cos(angle) * limit * np.sum(weights * np.exp(exponent * np.log(lit)))
    return complex(total * radius**2)


def lit_sphere(exponent: teg.Expr | float, constant: float = 0.0) -> teg.Expr:
    height = teg.sqrt(a * a - x * x - y * y)
    shine = teg.maximum(0, (s * x + 0.9 * height) / a) ** exponent
    return teg.integral(teg.where(x * x + y * y < a * a, constant + shine, 0), (x, -1, 1), (y, -1, 1))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("exponent", [17, 17.5, 20, 60, 1000])
def test_a_sharp_highlight(exponent: float, backend: str) -> None:
    """No narrow feature hides where a power is small; at its zero natural bounds of it never come near it."""
    f = teg.compile(lit_sphere(t), [], backend=backend)
    expected = highlight(exponent, (0.4, 0.9), 0.8).real
    assert f(a=0.8, s=0.4, t=exponent) == pytest.approx(expected, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sharp_highlight_beside_a_constant(backend: str) -> None:
    f = teg.compile(lit_sphere(t, 0.3), [], backend=backend)
    expected = 0.3 * math.pi * 0.64 + highlight(20, (0.4, 0.9), 0.8).real
    assert f(a=0.8, s=0.4, t=20) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_derivative_of_a_sharp_highlight_by_its_exponent(backend: str) -> None:
    f = teg.compile(lit_sphere(t), [t], backend=backend)
    larger, smaller = (highlight(20 + d, (0.4, 0.9), 0.8).real for d in (1e-4, -1e-4))
    assert f.grad(a=0.8, s=0.4, t=20)["t"] == pytest.approx((larger - smaller) / 2e-4, rel=1e-6)


def test_the_derivative_of_a_sharp_highlight_by_its_light() -> None:
    h = 1e-20
    f = teg.compile(lit_sphere(t), [s], backend="c")
    assert f.grad(a=0.8, s=0.4, t=20)["s"] == pytest.approx(highlight(20, (0.4 + 1j * h, 0.9), 0.8).imag / h, rel=1e-9)


@pytest.mark.parametrize("exponent", [20.0, 100.0])
def test_the_derivative_of_a_sharp_highlight_by_the_radius(exponent: float) -> None:
    """√(a² - x² - y²) has a plain derivative, which has no bound: that of its integral counts."""
    f = teg.compile(lit_sphere(t), [a], backend="c")
    expected = 2.0 * highlight(exponent, (0.4, 0.9), 0.8).real / 0.8
    assert f.grad(a=0.8, s=0.4, t=exponent)["a"] == pytest.approx(expected, rel=1e-9)


def test_a_sharp_highlight_whose_exponent_is_a_number() -> None:
    f = teg.compile(lit_sphere(20), [a], backend="c")
    value, gradient = f.value_and_grad(a=0.8, s=0.4)
    expected = highlight(20, (0.4, 0.9), 0.8).real
    assert value == pytest.approx(expected, rel=1e-10)
    assert gradient["a"] == pytest.approx(2.0 * expected / 0.8, rel=1e-9)
