"""Curves in two variables: bilinear ones, and those that can be solved for either variable."""

from __future__ import annotations

import math

import numpy as np
import pytest

import teg
from teg.passes.eliminate.bilinear import Bilinear, match_bilinear
from teg.passes.eliminate.crossings import Curve, match_curve
from tests.passes.eliminate.differences import second_differences

x, y, z = teg.vars("x y z")
t, a, b, c, k, p, q = teg.params("t a b c k p q")
SQUARE = ((x, -1, 1), (y, -1, 1))
UNIT = ((x, 0, 1), (y, 0, 1))


def test_matches() -> None:
    assert match_bilinear(x * y - t, [x, y]) == Bilinear((y, x))
    assert match_bilinear((a - x) * (b - y) - t * x, [x, y]) == Bilinear((y, x))
    assert match_bilinear(x * y + x * x, [x, y]) is None
    assert match_bilinear(a * x + b * y, [x, y]) is None
    assert match_curve(x**2 + y**2 - t, [x, y]) == Curve((y, x))
    assert match_curve(teg.exp(x) + teg.exp(y) - t, [x, y]) == Curve((y, x))
    assert match_curve(teg.sin(x * y) + x - t, [x, y]) is None


@pytest.mark.parametrize("kk", [0.05, 1e-3, -1e-3, 1e-6, -1e-6, 1e-9, 0.0])
def test_a_bilinear_surface_through_its_saddle(kk: float) -> None:
    """[(y-c)(x-t) > k]: the derivatives by c and t are continuous through k = 0, where the hyperbola becomes two lines."""
    f = teg.compile(teg.integral(teg.bracket((y - c) * (x - t) > k), *UNIT), [c, t])
    at = {"c": 0.6, "t": 0.3, "k": kk}
    gradient = f.grad(at)
    if kk >= 0:
        c_exact = -((1 - 0.3) - kk / 0.4) + (0.3 - kk / 0.6)
        t_exact = -((1 - 0.6) - kk / 0.7) + (0.6 - kk / 0.3)
        assert gradient["c"] == pytest.approx(c_exact, rel=1e-10, abs=1e-10)
        assert gradient["t"] == pytest.approx(t_exact, rel=1e-10, abs=1e-10)
    else:
        assert teg.check_gradient(f, at, tol=1e-7)


def test_second_derivatives_of_a_bilinear_surface() -> None:
    f = teg.compile(teg.integral(teg.bracket((y - c) * (x - t) > k), *UNIT))
    at = {"c": 0.6, "t": 0.3, "k": 0.05}
    exact = f.hessian(at)
    for pair, quotient in second_differences(f, at).items():
        assert exact[pair] == pytest.approx(quotient, rel=1e-6, abs=1e-6)


def test_the_crossing_of_the_lines_may_lie_outside() -> None:
    f = teg.compile(teg.integral(teg.bracket(k * x * y + p * x + q * y < t), *UNIT), [t])
    kk, pp, qq = 0.8081166046430437, -0.8244642264810265, -0.20981658328406483
    at = {"k": kk, "p": pp, "q": qq, "t": -pp * qq / kk}
    exact = (math.log(abs(pp)) - math.log(abs(kk + pp))) / kk
    assert f.grad(at)["t"] == pytest.approx(exact, rel=1e-7)
    assert f.diagnose(at) == []


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_the_disk(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < t), *SQUARE), backend=backend)
    value, gradient = f.value_and_grad(t=0.5)
    assert value == pytest.approx(math.pi / 2, rel=1e-13)
    assert gradient["t"] == pytest.approx(math.pi, rel=1e-13)
    assert f.hessian(t=0.5)["t", "t"] == pytest.approx(0.0, abs=1e-12)


LONG = {"axes": x * x + a * y * y, "with a mixed term": x * x + a * y * y + x * y, "shifted": (x - 0.125) ** 2 + a * (y - 0.25) ** 2}


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
@pytest.mark.parametrize("name", LONG)
def test_ellipses_of_any_length(name: str, backend: str, x64_for_jax: None) -> None:
    """The area is πt/√det of the ellipse {q < t}, whatever the sign of a could be. Between charts the weights change in a part 1/√a of the
    curve, unless the charts know how long it is; from a = 1e14 on, t is small beside the values of q on the box."""
    f = teg.compile(teg.integral(teg.bracket(LONG[name] < t) * (2 + x - 0.125 * (name == "shifted")), *SQUARE), [t, a], backend=backend)
    digits, most = (2e-10, 8) if name == "shifted" else (2e-14, 17)
    for long in 10.0 ** np.arange(0, most + 1):
        det = long - 0.25 if "mixed" in name else long
        gradient = f.grad(t=0.3, a=long)
        assert gradient["t"] == pytest.approx(2 * math.pi / math.sqrt(det), rel=digits, abs=0)
        assert gradient["a"] == pytest.approx(-0.3 * math.pi * det**-1.5, rel=digits, abs=0)
        if name != "shifted":  # the mean of both sides
            assert f.grad(t=0.0, a=long)["t"] == pytest.approx(math.pi / math.sqrt(det), rel=digits, abs=0)


@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_ellipsoids_of_any_length(backend: str, x64_for_jax: None) -> None:
    """The derivative of 4/3·π·√(t³/(a·c)) by t is 2π·√(t/(a·c))."""
    ball = teg.integral(teg.bracket(x * x + a * y * y + c * z * z < t), *SQUARE, (z, -1, 1))
    f = teg.compile(ball, [t], backend=backend)
    for long in (1.0, 1e3, 1e6, 1e7, 1e8):
        assert f.grad(t=0.3, a=long, c=0.7 * long)["t"] == pytest.approx(2 * math.pi / long * math.sqrt(0.3 / 0.7), rel=1e-10, abs=0)


def test_the_second_derivative_counts_the_fluxes_of_the_charts() -> None:
    f = teg.compile(teg.integral(teg.bracket(x * x + y * y < t) * teg.exp(0.3 * x + 0.5 * y), *SQUARE))
    assert f.hessian(t=0.5)["t", "t"] == pytest.approx(0.27275021433, rel=1e-9)


CONICS = {
    "shifted disk": (((x - a) ** 2 + (y - b) ** 2 < t), {"a": 0.3, "b": -0.2, "t": 0.4}),
    "clipped disk": (((x - a) ** 2 + (y - b) ** 2 < t), {"a": 0.8, "b": 0.7, "t": 0.6}),
    "ellipse": ((a * x * x + b * y * y < t), {"a": 1.5, "b": 3.0, "t": 0.7}),
    "rotated ellipse": ((a * x * x + b * x * y + c * y * y < t), {"a": 2.0, "b": 1.1, "c": 1.5, "t": 0.6}),
    "parabola": ((y > a * x * x + t), {"a": 0.7, "t": -0.2}),
    "hyperbola": ((a * x * x - b * y * y > t), {"a": 1.3, "b": 0.8, "t": 0.2}),
    "exponentials": ((teg.exp(x) + teg.exp(a * y) < t), {"a": 1.2, "t": 2.3}),
    "power": ((x**4 + a * y**4 < t), {"a": 0.9, "t": 0.4}),
    "angle": ((teg.atan2(y + 2, x + 2) < t), {"t": 0.7}),
    "sine": ((y > teg.sin(3 * x) + t), {"t": 0.4}),
}


@pytest.mark.parametrize("name", CONICS)
def test_gradients_of_curves(name: str) -> None:
    condition, at = CONICS[name]
    f = teg.compile(teg.integral(teg.bracket(condition) * (1 + x * y + teg.exp(0.5 * y)), *SQUARE), tol=1e-11)
    report = teg.check_gradient(f, at, tol=2e-7)
    assert report, str(report)
    assert f.diagnose(at) == []


@pytest.mark.parametrize("name", ["shifted disk", "clipped disk", "ellipse", "exponentials", "sine", "parabola"])
def test_second_derivatives_of_curves(name: str) -> None:
    condition, at = CONICS[name]
    f = teg.compile(teg.integral(teg.bracket(condition) * (1 + x * y), *SQUARE), tol=1e-11)
    exact = f.hessian(at)
    for pair, quotient in second_differences(f, at, 1e-3).items():
        assert exact[pair] == pytest.approx(quotient, rel=2e-6, abs=2e-6), pair


def test_a_coefficient_goes_through_zero() -> None:
    """The mixed coefficient of a conic, and a coefficient of a square, may vanish at run time."""
    f = teg.compile(teg.integral(teg.bracket(a * x * x + b * x * y + c * y * y + x < t), *SQUARE))
    base = {"a": 1.0, "b": 0.7, "c": 1.3, "t": 0.5}
    for name in ("a", "b", "c"):
        gradients = [np.array(list(f.grad({**base, name: v}).values())) for v in (-1e-7, 0.0, 1e-7)]
        assert np.allclose(gradients[1], (gradients[0] + gradients[2]) / 2, rtol=0, atol=1e-9), name


def test_the_variable_of_a_chart_is_no_parameter() -> None:
    """Charts call their variable s, as a user may call a parameter."""
    s = teg.param("s")
    e = teg.integral(teg.bracket(x - t * y < s), (x, 0, 1), (y, 0, 1))
    free = teg.eliminate(teg.diff(e, s))
    assert teg.evaluate(free, {"s": 0.3, "t": 0.2}) == pytest.approx(1.0, rel=1e-14)
