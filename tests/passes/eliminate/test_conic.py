"""Ellipses by angle, against arcs that are measured by hand: gradients, ties, far and large circles, slices in three variables."""

from __future__ import annotations

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest

import teg
from teg.passes.eliminate.conic import match_conic

x, y, z = teg.vars("x y z")
t, a, b = teg.params("t a b")
pytestmark = pytest.mark.usefixtures("x64")
BACKENDS = ["numpy", "c", "jax"]


def arcs(radius: float, centre: tuple[float, float], box: tuple[float, float, float, float]) -> list[tuple[float, float]]:
    """The arcs of a circle inside a box (x from, x to, y from, y to), as angles."""
    cuts = [-math.pi, math.pi]
    for side in box[:2]:
        c = (side - centre[0]) / radius
        cuts += [s * math.acos(c) for s in (-1, 1) if abs(c) < 1]
    for side in box[2:]:
        s = (side - centre[1]) / radius
        cuts += [math.asin(s), math.copysign(math.pi, s) - math.asin(s)] if abs(s) < 1 else []
    found = []
    for p, q in pairwise(sorted(cuts)):
        at = centre[0] + radius * math.cos(0.5 * (p + q)), centre[1] + radius * math.sin(0.5 * (p + q))
        if box[0] < at[0] < box[1] and box[2] < at[1] < box[3]:
            found.append((p, q))
    return found


def slopes(radius: float, centre: tuple[float, float], box: tuple[float, float, float, float]) -> dict[str, float]:
    """The derivatives of the area of a disk in a box: by its square radius, and by its centre."""
    inside = arcs(radius, centre, box)
    return {
        "t": 0.5 * math.fsum(q - p for p, q in inside),
        "a": radius * math.fsum(math.sin(q) - math.sin(p) for p, q in inside),
        "b": radius * math.fsum(math.cos(p) - math.cos(q) for p, q in inside),
    }


# -- matching ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("g", "match"),
    [
        (t - x**2 - y**2, (1.0, (1.0, 0.0, 1.0))),
        (2 * (x - a) ** 2 + x * y + 3 * y**2 - t, (-1.0, (3.0, 0.5, 2.0))),
        (t - x**2 - (y - teg.exp(z)) ** 2, (1.0, (1.0, 0.0, 1.0))),
        (t - (x + 1e4 * y - a) ** 2 - 4 * (y - 1e4 * x) ** 2, (1.0, (1e8 + 4, 1e4 - 4e4, 1 + 4e8))),
        (t - x**2 - 1e-9 * y**2, (1.0, (1e-9, 0.0, 1.0))),
        (t - x**2 - 1e-30 * y**2, None),
        (t - (x + y) ** 2 - (x + 1.00001 * y) ** 2, None),
        (t - x**2 - a * y**2, None),  # may be a hyperbola
        (t - x**2 + y**2, None),
        (t - x**2 - y, None),
        (t - x**2 - x * y - 0.25 * y**2, None),  # a parabola that leans
        (t - x**2, None),
        (t - x**2 - y**4, None),
    ],
    ids=str,
)
def test_matches(g: teg.Expr, match: tuple[float, tuple[float, float, float]] | None) -> None:
    """Where it matches, L is as it must be: LᵀQL = 1, Q in the order of the variables, y first."""
    found = match_conic(g, [x, y, z])
    if match is None or found is None:
        assert found is match
        return
    sign, (first, mixed, second) = match
    root = np.array([[e.data for e in row] for row in found.inverse])
    assert found.variables == (y, x)
    assert found.sign == sign
    np.testing.assert_allclose(root.T @ np.array([[first, mixed], [mixed, second]]) @ root, np.eye(2), atol=1e-9)


# -- values ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_disk_in_a_box(backend: str) -> None:
    box = (-1.0, 1.0, -0.5, 1.0)
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t), (x, *box[:2]), (y, *box[2:])), backend=backend)
    random = np.random.default_rng(3)
    n = 60
    at = {"t": random.uniform(0.01, 4.0, n), "a": random.uniform(-1.5, 1.5, n), "b": random.uniform(-1.5, 1.5, n)}
    found, errors = f.grad_and_error(**at)
    for k in range(n):
        exact = slopes(math.sqrt(at["t"][k]), (at["a"][k], at["b"][k]), box)
        for p, value in exact.items():
            assert abs(found[p][k] - value) <= min(1e-11, 10 * errors[p][k]), (k, p)


@pytest.mark.parametrize("shift", [0.0, 4096.0, -65536.0])
@pytest.mark.parametrize("radius", [0.3, 1.0, 30.0, 1e4])
def test_far_and_large_circles(radius: float, shift: float) -> None:
    """A pixel that a circle cuts, wherever both are and however large the circle is."""
    lo, hi = teg.params("lo hi")
    pixel = teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t), (x, lo, hi), (y, lo, hi))
    f = teg.compile(pixel, [t, a, b, lo, hi], backend="c")
    for angle in (0.1, 0.7, 2.0, 4.0):
        centre = -radius * math.cos(angle), -radius * math.sin(angle)
        at = {"t": radius * radius, "a": centre[0] + shift, "b": centre[1] + shift, "lo": shift - 0.25, "hi": shift + 0.25}
        exact = slopes(math.sqrt(at["t"]), (at["a"] - shift, at["b"] - shift), (-0.25, 0.25, -0.25, 0.25))
        found, errors = f.grad_and_error(**at)
        for p, value in exact.items():
            size = max(abs(v) for v in exact.values()) if p != "t" else value
            assert abs(found[p] - value) <= max(1e-13 * radius, 1e-11) * size, (p, found[p], value)
            assert abs(found[p] - value) <= 10 * errors[p] + 1e-12 * radius * size


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_ellipse_that_leans(backend: str) -> None:
    q = 2 * (x - a) ** 2 + (x - a) * (y - b) + 3 * (y - b) ** 2
    f = teg.compile(teg.integral(teg.bracket(q < t) * x, (x, -9, 9), (y, -9, 9)), backend=backend)
    at = {"t": 0.7, "a": 0.3, "b": -0.2}
    unit = math.pi / math.sqrt(6 - 0.25)
    assert f(**at) == pytest.approx(unit * 0.7 * 0.3, abs=1e-9)
    found = f.grad(**at)
    assert [found[p] for p in "tab"] == pytest.approx([unit * 0.3, unit * 0.7, 0.0], abs=1e-12)
    assert f.hessian(**at)["t", "a"] == pytest.approx(unit, abs=1e-9)


def test_other_lines_and_conics_cut_the_arcs() -> None:
    body = teg.bracket(x**2 + y**2 < t) * teg.bracket(x + 2 * y < a) * teg.bracket((x - 1) ** 2 + y**2 < b)
    f = teg.compile(teg.integral(body, (x, -3, 3), (y, -3, 3)), backend="c")
    r, at = math.sqrt(0.9), {"t": 0.9, "a": 0.4, "b": 1.3}
    line, other = math.acos(0.4 / (r * math.sqrt(5))), math.acos((0.9 + 1 - 1.3) / (2 * r))
    tilt = math.atan2(2, 1)
    cuts = sorted([-math.pi, math.pi, tilt - line, tilt + line, -other, other])
    middles = [(q - p, 0.5 * (p + q)) for p, q in pairwise(cuts)]
    inside = [w for w, m in middles if r * (math.cos(m) + 2 * math.sin(m)) < 0.4 and 0.9 + 1 - 2 * r * math.cos(m) < 1.3]
    assert f.grad(**at)["t"] == pytest.approx(0.5 * math.fsum(inside), abs=1e-12)


# -- ties --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_same_circle_in_other_words(backend: str) -> None:
    one, other = teg.bracket(x**2 + y**2 < t), teg.bracket(teg.exp(x**2 + y**2) < teg.exp(t))
    square = ((x, -2, 2), (y, -2, 2))
    f = teg.compile(teg.integral(one * other, *square), backend=backend)
    assert f.grad(t=0.7)["t"] == pytest.approx(math.pi, abs=1e-11)
    g = teg.compile(teg.integral((one - other) ** 2, *square), backend=backend)
    assert g.grad(t=0.7)["t"] == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("backend", BACKENDS)
def test_tangent_sides_and_births(backend: str) -> None:
    f = teg.compile(teg.integral(teg.bracket(x**2 + y**2 < t), (x, -1, 1), (y, -1, 1)), backend=backend)
    assert f.grad(t=1.0)["t"] == pytest.approx(math.pi, abs=1e-7)
    assert f.grad(t=0.0)["t"] == pytest.approx(math.pi / 2, abs=1e-12)  # the mean of both sides
    assert f.grad(t=-0.1)["t"] == 0.0
    outside = teg.compile(teg.integral(teg.bracket(x**2 + y**2 > t), (x, -1, 1), (y, -1, 1)), backend=backend)
    assert outside.grad(t=0.0)["t"] == pytest.approx(-math.pi / 2, abs=1e-12)


def test_a_side_through_the_ends_of_quarters() -> None:
    f = teg.compile(teg.integral(teg.bracket(x**2 + y**2 < t) * teg.bracket(x < y), (x, -2, 2), (y, -2, 2)), backend="c")
    assert f.grad(t=0.5)["t"] == pytest.approx(math.pi / 2, abs=1e-13)


# -- three variables ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_slices_of_a_ball_and_of_a_surface_of_revolution(backend: str) -> None:
    cube = ((x, -1, 1), (y, -1, 1), (z, -1, 1))
    ball = teg.compile(teg.integral(teg.bracket(x**2 + y**2 + (z - a) ** 2 < t), *cube), backend=backend)
    found = ball.grad(t=0.49, a=0.1)
    assert (found["t"], found["a"]) == pytest.approx((2 * math.pi * 0.7, 0.0), abs=1e-11)
    bell = teg.compile(teg.integral(teg.bracket(x**2 + y**2 < t * teg.exp(-z)), *cube), backend=backend)
    assert bell.grad(t=0.3)["t"] == pytest.approx(math.pi * 2 * math.sinh(1.0), abs=1e-10)


def test_a_ball_cut_by_its_box() -> None:
    f = teg.compile(teg.integral(teg.bracket(x**2 + y**2 + z**2 < t), (x, 0, 1), (y, 0, 1), (z, 0, 1)), backend="c")
    r = 1.2  # an eighth of the sphere less three halves of caps, and no two caps meet
    assert f.grad(t=r * r)["t"] == pytest.approx((math.pi * r * r / 2 - 3 * math.pi * r * (r - 1) / 2) / (2 * r), abs=1e-10)


# -- work --------------------------------------------------------------------------------------------------------------


def test_a_disk_takes_few_evaluations() -> None:
    """Four quarters of nine nodes, as the integrands are of degree 2 in cosine and sine; cut by two sides of the box, two pieces more."""
    f = teg.compile(teg.integral(teg.bracket((x - a) ** 2 + (y - b) ** 2 < t), (x, -1, 1), (y, -1, 1)), backend="c")
    value = f.evaluations(t=0.3, a=0.1, b=0.2)
    assert f.evaluations(t=0.3, a=0.1, b=0.2, derivatives=1) - value <= 4 * 9
    assert f.evaluations(t=0.3, a=0.8, b=0.2, derivatives=1) - f.evaluations(t=0.3, a=0.8, b=0.2) <= 6 * 9


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("aspect", [1e4, 1e7, 1e9])
def test_a_long_ellipse_that_is_turned_loses_no_digits(backend: str, aspect: float) -> None:
    """Multiplied out, the squares of its axes cancel; the derivative of its area πt²/aspect is that of its axes."""
    c, s = math.cos(0.3), math.sin(0.3)
    inside = (c * x + s * y) ** 2 + (aspect * (c * y - s * x)) ** 2 < t * t
    f = teg.compile(teg.integral(teg.bracket(inside), (x, -1, 1), (y, -1, 1)), [t], backend=backend)
    assert aspect * f.grad(t=0.6)["t"] == pytest.approx(2 * math.pi * 0.6, rel=1e-12)


def bessel(radius: mpmath.mpf) -> mpmath.mpf:
    """The mean of exp(ξ) over a disk of this radius around 0."""
    return 2 * mpmath.besseli(1, radius) / radius


@pytest.mark.parametrize("backend", BACKENDS)
def test_thin_ellipses_of_parameters(backend: str) -> None:
    """Around (0.3, 0.2), half-axes √t and b√t, turned by a: the integral of exp(x), and the values along a leaning one, to ε/b."""
    across, along = (y - 0.2) * teg.cos(a) - (x - 0.3) * teg.sin(a), (x - 0.3) * teg.cos(a) + (y - 0.2) * teg.sin(a)
    f = teg.compile(teg.integral(teg.bracket(along**2 + (across / b) ** 2 < t) * teg.exp(x), (x, -1, 1.5), (y, -1, 1.5)), backend=backend)
    with mpmath.workdps(40):
        mean = mpmath.exp(mpmath.mpf(0.3)) * mpmath.pi

        def exact(t: mpmath.mpf, a: mpmath.mpf, b: mpmath.mpf) -> mpmath.mpf:
            return mean * t * b * bessel(mpmath.sqrt(t * (mpmath.cos(a) ** 2 + (b * mpmath.sin(a)) ** 2)))

        for at in ((0.25, 0.4, 0.7), (0.25, 0.4, 7e-3), (0.25, 1.2, 1e-6), (0.25, 0.0, 1e-6), (0.25, math.pi / 2, 1e-7), (0.25, 0.4, 1e-8)):
            point = tuple(map(mpmath.mpf, at))
            value, gradient = f.value_and_grad(dict(zip("tab", at, strict=True)))
            lost = 1e-15 / at[2] + 1e-12
            assert value == pytest.approx(float(exact(*point)), rel=lost)
            assert gradient["t"] == pytest.approx(float(mpmath.diff(exact, point, (1, 0, 0))), rel=1e-12)
            assert gradient["b"] == pytest.approx(float(mpmath.diff(exact, point, (0, 0, 1))), rel=1e-12)
            assert gradient["a"] == pytest.approx(float(mpmath.diff(exact, point, (0, 1, 0))), abs=lost * value)


@pytest.mark.parametrize("backend", BACKENDS)
def test_strips_and_ellipses_that_are_much_larger_than_the_box(backend: str) -> None:
    """No point of a strip is a centre plus an offset, and points of a large ellipse cancel."""
    f = teg.compile(
        teg.integral(teg.bracket((a * (x - 0.1)) ** 2 + y * y < t) * teg.exp(x), (x, -1, 1), (y, -1, 1)), [t, a], backend=backend
    )
    ends = math.e - 1 / math.e
    for at in (0.0, 1e-12, 1e-5):
        value, gradient = f.value_and_grad(t=0.25, a=at)
        assert value == pytest.approx(ends, rel=1e-9)
        assert gradient["t"] == pytest.approx(2 * ends, rel=1e-9)
        assert gradient["a"] == pytest.approx(-4 * at * (1.01 * math.e - 5.41 / math.e), rel=1e-9)


@pytest.mark.parametrize("aspect", [1e6, 1e12, 1e16])
def test_a_thin_ellipse_whose_type_is_not_known(aspect: float) -> None:
    """By charts, about its centre: where multiplied out, its matrix cancels by the square of the aspect."""
    c, s = math.cos(0.4), math.sin(0.4)
    q = ((x - 0.3) * c + (y - 0.2) * s) ** 2 + a * ((y - 0.2) * c - (x - 0.3) * s) ** 2
    f = teg.compile(teg.integral(teg.bracket(q < t) * teg.exp(x), (x, -1, 1.5), (y, -1, 1.5)), [t, a])
    value, gradient = f.value_and_grad(t=0.25, a=aspect)
    with mpmath.workdps(30):
        unit = float(mpmath.exp(0.3) * mpmath.pi / mpmath.sqrt(aspect))
        exact = [float(mpmath.diff(lambda t: t * bessel(mpmath.sqrt(t * (c * c + s * s / aspect))), 0.25, k)) for k in (0, 1)]
    lost = 1e-10 + 2e-15 * math.sqrt(aspect)
    assert value == pytest.approx(unit * exact[0], rel=lost)
    assert gradient["t"] == pytest.approx(unit * exact[1], rel=lost)
